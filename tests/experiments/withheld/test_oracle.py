"""Laws of the oracle: its evidence is the integral it claims to be, and nothing beats it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from plumbline.experiments.withheld.calibration import calibration
from plumbline.experiments.withheld.oracle import Ensemble, Rival, _evidence, admitted
from plumbline.optim.diagnosis.prior import LOG_SCALE_WEIGHTS, SCALES

SIGMA, GAP, ROWS = 1e-4, (0.3, 0.8), 60


def rival(rng: np.random.Generator, k: int, name: str, one_sided: bool = False) -> Rival:
    """A rival with random columns, of physical scale about the noise."""
    columns = 1e-4 * rng.normal(size=(ROWS, k))
    lower = np.zeros(k) if one_sided else np.full(k, -20.0)
    return Rival((name, None), columns, lower, np.full(k, 20.0), 0.0)


@pytest.fixture(scope="module")
def ensemble() -> Ensemble:
    """Eight rivals, some resembling each other."""
    rng = np.random.default_rng(4)
    rivals = [rival(rng, 1 + j % 3, f"r{j}", one_sided=j == 4) for j in range(6)]
    near = rivals[0].columns + 2e-5 * rng.normal(size=(ROWS, 1))
    rivals.append(Rival(("near", None), near, np.array([-20.0]), np.array([20.0]), -0.5))
    far = 1e-9 * rng.normal(size=(ROWS, 1))
    rivals.append(Rival(("hidden", None), far, np.array([-20.0]), np.array([20.0]), 0.0))
    return Ensemble.of(rivals, SIGMA, GAP, rng)


def test_what_can_never_show_is_no_rival(ensemble: Ensemble) -> None:
    assert "hidden" not in {r.key[0] for r in ensemble.rivals}
    assert len(ensemble.rivals) == 7


def test_draws_lie_within_bounds_and_gap(ensemble: Ensemble) -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        k, z = ensemble.draw(rng)
        drawn = ensemble.rivals[k]
        ratio = np.sqrt(np.mean((drawn.columns @ z) ** 2)) / SIGMA
        assert GAP[0] <= ratio <= GAP[1]
        assert (z >= drawn.lower).all()
        assert (z <= drawn.upper).all()


@pytest.mark.parametrize("one_sided", [False, True])
def test_evidence_of_one_column_is_its_integral(one_sided: bool) -> None:
    rng = np.random.default_rng(6)
    one = rival(rng, 1, "a", one_sided)
    two = rival(rng, 1, "b")
    alone = Ensemble.of([one, two], SIGMA, GAP, rng)
    t = one.columns[:, 0] * 0.5 + SIGMA * rng.normal(size=ROWS)

    def integrand(z: float, r: Rival, s: float, likelihood: bool) -> float:
        if not admitted(r, np.array([[z]]), SIGMA, GAP)[0]:
            return 0.0
        prior = np.exp(-0.5 * (z / s) ** 2) / (s * np.sqrt(2 * np.pi))
        x = r.columns[:, 0] * z
        return prior * np.exp((t @ x - 0.5 * x @ x) / SIGMA**2) if likelihood else prior

    def total(r: Rival, likelihood: bool) -> float:
        size = np.sqrt(np.mean(r.columns**2)) / SIGMA
        ends = [GAP[0] / size, GAP[1] / size]
        return sum(
            np.exp(w) * sign * quad(integrand, sign * a, sign * b, (r, s, likelihood))[0]
            for w, s in zip(LOG_SCALE_WEIGHTS, SCALES, strict=True)
            for sign, a, b in ((1, *ends), (-1, *ends))
        )

    exact = np.array([total(r, True) / total(r, False) for r in alone.rivals])
    found = np.mean([alone.posterior(t, np.random.default_rng(k)) for k in range(20)], axis=0)
    assert found == pytest.approx(exact / exact.sum(), abs=0.02)


def test_the_gaussian_part_is_the_ratio_of_two_normal_densities() -> None:
    rng = np.random.default_rng(7)
    r, t = rival(rng, 3, "a"), 1e-4 * rng.normal(size=ROWS)
    found = _evidence(r, t, SIGMA).log_bayes
    for scale, value in zip(SCALES, found, strict=True):
        C = SIGMA**2 * np.eye(ROWS) + scale**2 * r.columns @ r.columns.T
        log_det = np.linalg.slogdet(C / SIGMA**2)[1]
        expected = -0.5 * log_det - 0.5 * (t @ np.linalg.solve(C, t) - t @ t / SIGMA**2)
        assert value == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_the_oracle_s_probabilities_are_those_that_come_true(ensemble: Ensemble) -> None:
    rng = np.random.default_rng(8)
    said, right = [], []
    for _ in range(140):
        k, z = ensemble.draw(rng)
        t = ensemble.rivals[k].columns @ z + SIGMA * rng.normal(size=ROWS)
        posterior = ensemble.posterior(t, rng)
        said.append([(float(p), j == k) for j, p in enumerate(posterior)])
        right.append(int(np.argmax(posterior)) == k)
    found = calibration(said)
    assert found.ece < 0.04
    assert np.mean(right) == pytest.approx(np.mean([max(p for p, _ in s) for s in said]), abs=0.09)


def test_no_simpler_judge_beats_the_oracle(ensemble: Ensemble) -> None:
    """Least squares with BIC knows neither scales nor bounds nor the range of the gap."""
    rng = np.random.default_rng(9)
    wins = np.zeros(2)
    for _ in range(140):
        k, z = ensemble.draw(rng)
        t = ensemble.rivals[k].columns @ z + SIGMA * rng.normal(size=ROWS)
        scores = []
        for r in ensemble.rivals:
            left = t - r.columns @ np.linalg.lstsq(r.columns, t, rcond=None)[0]
            scores.append(left @ left / SIGMA**2 + r.columns.shape[1] * np.log(ROWS))
        wins += [np.argmax(ensemble.posterior(t, rng)) == k, np.argmin(scores) == k]
    assert wins[0] >= wins[1]
