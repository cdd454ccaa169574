"""Laws of noise that wanders beside what is fitted: that takes up a part of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

from plumbline.experiments.benches.ar1 import NOISES, clean
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.posterior.correlation import Left, correlation_of
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem
from plumbline.optim.diagnosis.prior import CORRELATIONS
from plumbline.optim.diagnosis.verdict.explanation import _correlation
from tests.benches import bench
from tests.designs import statistics, wandering
from tests.few_effects import few_and


@pytest.fixture(scope="module")
def rows():
    return replace(bench("ur5", "tip_position"), group=None)


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_what_is_fitted_takes_up_noise_that_wanders_as_generalised_least_squares_do(rows, rho):
    """The gain is a restricted likelihood's: of rows without what flat columns span.

    By dense matrices: with K whose rows are orthogonal to A, K t is normal with covariance K R K^T.
    """
    few = rows.select(np.arange(30))
    rng, N = np.random.default_rng(5), len(few)
    slow = np.linspace(-1.0, 1.0, N)[:, None, None] ** np.arange(3)  # of time, as noise is
    columns = np.einsum("nik,mj->ijnmk", slow, np.eye(3)).reshape(-1, N, 3, 3)[:, :, :, 0]
    columns = np.concatenate([columns, rng.normal(size=(4, N, 3))])
    A = columns.reshape(len(columns), -1).T
    basis = np.linalg.qr(A)[0].T.reshape(-1, N, 3)
    basis = basis[: np.linalg.matrix_rank(A)]
    t = wandering((N, 3), rho, rng)
    flat = basis.reshape(len(basis), -1)
    left = (t.ravel() - flat.T @ (flat @ t.ravel())).reshape(N, 3)
    K = scipy.linalg.null_space(flat).T
    apart = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))

    def likely(r):
        V = K @ np.kron(r**apart, np.eye(3)) @ K.T
        x = K @ t.ravel()
        square = x @ np.linalg.solve(V, x)
        return -0.5 * (np.linalg.slogdet(V)[1] + len(x) * np.log(square))

    none = np.zeros(len(basis))
    told, odds = correlation_of(left, few, NoisePrior(), fitted=Left(left, basis, none, none))
    gains = {r: likely(r) - likely(0.0) for r in CORRELATIONS}
    best = max(gains, key=gains.get)
    price = 0.5 * np.log(left.size)
    asked = gains[best] > price + 5.0
    assert told.wander == (best if asked else 0.0)
    assert odds == pytest.approx(gains[best] - price if asked else 0.0, abs=1e-6)
    assert (told.wander > 0.0) == (rho > 0.0)


@pytest.mark.parametrize(("many", "wander"), [(False, 0.8), (True, 0.0)])
def test_what_many_causes_may_take_up_is_asked_for_no_noise(rows, many, wander):
    """A model of many causes is open: that rows near each other err alike is told by blocks."""
    rng, n = np.random.default_rng(2), len(rows)
    slow = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), 12))[0]
    columns = np.einsum("nk,mj->kjnm", slow, np.eye(3)).reshape(-1, n, 3)
    noise = wandering((n, 3), 0.9, rng)
    none = np.zeros(len(columns))
    left = Left(noise - slow @ (slow.T @ noise), columns, none, none)
    model = SimpleNamespace(recording=rows, problem=SimpleNamespace(weights=np.ones(n)))
    asked = JointProblem(
        statistics(np.zeros((3 * n, 0)), noise.ravel()), (), NoisePrior(),
        np.zeros(0), np.zeros(0, dtype=bool), np.zeros((2, 0), dtype=int),
    )  # fmt: skip
    alt = SimpleNamespace(
        problem=asked, rows=np.arange(n), left=lambda *_: left, spread=np.ones((n, 3))
    )
    selected = SimpleNamespace(pool=SimpleNamespace(model=model, noise=NoisePrior()))
    found = _correlation(selected, alt, [], many=many)
    assert found.wander == pytest.approx(wander, abs=0.21)


@pytest.mark.parametrize("number", [5, 8])
def test_of_few_rows_and_no_stated_noise_one_that_wanders_is_no_mechanism(number):
    """Of 30 rows a function of time, or a bump, does nearly as much as noise does by itself."""
    drifting = NOISES["drift"](
        clean(number, 0, rows=(30, 31)), np.random.default_rng([0, number, 29])
    )
    options = replace(few_and("respiration"), force=True)
    found = diagnose(replace(drifting, noise_std=None), options)
    assert found.recording.wander > 0.5
    assert found.verdict.outside_probability < 0.1
    assert not found.verdict.causes
