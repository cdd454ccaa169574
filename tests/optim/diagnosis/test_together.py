"""Laws of the evidence of several terms together: in columns or in rows, it is that of the rows."""

import numpy as np
import pytest

from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, log_within
from plumbline.optim.diagnosis.posterior.together import Together

OWNER = np.repeat(np.arange(4), [1, 3, 2, 4])
SCALES = np.array([[1.0, 0.1, 3.0, 0.3], [0.3, 1.0, 1.0, 10.0]])
FREE, BOUNDED = (-np.inf, np.inf), (0.0, 1.5)


def terms(rows, noise, bounds, seed=0):
    rng = np.random.default_rng([seed, rows])
    X = rng.normal(size=(rows, len(OWNER)))
    t = X[:, 1:4] @ rng.normal(size=3) + noise.sigma * rng.normal(size=rows)
    linear = Linear(X.T @ X, X.T @ t, float(t @ t), float(rows))
    return Together(linear, noise, OWNER, np.tile(bounds, (len(OWNER), 1))), X, t


def of_rows(asked, X, t, s):
    """By the covariance of the rows, and the noise of a fit that it weighs."""

    def fitted(v):
        C = (X * s**2) @ X.T + v * np.eye(len(t))
        return v * float(t @ np.linalg.solve(C, t)), C

    base = asked.noise.variance(float(t @ t), len(t))
    before, v = None, 0.01
    for _ in range(8):
        before, v = v, float(asked.noise.variance(fitted(v)[0], len(t)))
        if min(v, before) >= 0.85 * max(v, before):
            break
    C = fitted(before)[1]
    log = -0.5 * np.linalg.slogdet(C / before)[1]
    log -= 0.5 * (asked.noise.freedom + len(t)) * np.log(v / base)
    gain = s[:, None] ** 2 * X.T @ np.linalg.inv(C)
    std = np.sqrt(v / before * np.diag(np.diag(s**2) - gain @ X * s**2))
    return log + float(log_within(asked.limits, gain @ t, std[None]).sum()), v


@pytest.mark.parametrize("bounds", [FREE, BOUNDED])
@pytest.mark.parametrize("rows", [3, 6, 10, 40])
def test_terms_have_the_evidence_of_the_rows_of_more_equations_than_columns_or_fewer(rows, bounds):
    asked, X, t = terms(rows, NoisePrior.of(0.2), bounds)
    for scales in SCALES:
        (log,), (v,) = asked.evidence(scales[None], 0.01)
        assert (log, v) == pytest.approx(of_rows(asked, X, t, scales[OWNER]), rel=1e-9)


def test_a_noise_below_rounding_leaves_of_few_rows_an_evidence():
    asked, _, _ = terms(4, NoisePrior.of(1e-10), BOUNDED)
    assert np.isfinite(asked.evidence(SCALES, 0.01)).all()
