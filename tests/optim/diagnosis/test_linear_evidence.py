"""Laws of the linear problem and its evidence, against dense sums that know no shortcut.

Eliminating columns of prior precision L / v is marginalising them: what is left is the problem
under the dense noise covariance v (I + X_B L^-1 X_B^T).
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import invgamma, multivariate_normal, multivariate_t, norm

from plumbline.kinematics.effects.joint_compliance import JointCompliance
from plumbline.optim.core.mapped import Gram
from plumbline.optim.diagnosis.linearise.linear import Linear, orthonormal
from plumbline.optim.diagnosis.posterior.evidence import (
    Candidate,
    NoisePrior,
    _eigen,
    batches,
    block_evidence,
    evidence_of_all,
    scan,
)
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.prior import LOG_SCALE_WEIGHTS, SCALES
from tests.designs import candidates, statistics

N = 40
SIZES = (1, 2, 1, 2, 2, 1)
SEEDS = (0, 1, 2)


def drawn(seed, columns=9, rows=N):
    """Correlated columns (N, P) of unlike lengths, and a target (N,)."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(rows, columns)) @ (np.eye(columns) + 0.4 * rng.normal(size=(columns,) * 2))
    X *= np.exp(rng.normal(size=columns))
    return X, X @ rng.normal(size=columns) + rng.normal(size=rows)


def marginal(X, t, out, precision):
    """G, b, tt and n once the columns ``out`` are noise of their prior's covariance."""
    own = X[:, out]
    weight = np.linalg.inv(np.eye(len(t)) + own @ np.diag(1 / precision) @ own.T)
    return X.T @ weight @ X, X.T @ weight @ t, t @ weight @ t, np.trace(weight)


def assert_same(found, expected):
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


# Elimination


@pytest.mark.parametrize("seed", SEEDS)
def test_eliminating_columns_is_marginalising_them_under_their_prior(seed):
    X, t = drawn(seed)
    out, precision = np.array([1, 4, 6]), np.array([0.3, 2.0, 50.0])
    left = statistics(X, t).without(out, precision)
    assert_same((left.G, left.b, left.tt, left.n), marginal(X, t, out, precision))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_factored_form_is_the_same_elimination(seed):
    X, t = drawn(seed)
    out, precision = np.array([0, 5]), np.array([1.5, 0.2])
    linear = statistics(X, t)
    _, root, hidden, tt, n = linear.given(out, precision, np.arange(len(linear.b)))
    found = (linear.G - root @ root.T, linear.b - root @ hidden, tt, n)
    assert_same(found, marginal(X, t, out, precision))
    some = np.array([1, 4])
    np.testing.assert_array_equal(linear.given(out, precision, some)[1], root[some])


def test_eliminating_nuisances_first_is_eliminating_all_at_once():
    X, t = drawn(3)
    a, b = np.array([0, 3]), np.array([2, 7])
    prior = np.array([1e-9, 1e-9, 2.0, 4.0])
    twice = statistics(X, t).without(a, prior[:2]).given(b, prior[2:], b)
    once = statistics(X, t).given(np.concatenate([a, b]), prior, b)
    assert_same(twice[3:], once[3:])


def test_a_flat_prior_leaves_the_residual_of_least_squares():
    X, t = drawn(4)
    out = np.arange(4)
    left = statistics(X, t).without(out, np.full(4, 1e-10))
    best = np.linalg.lstsq(X[:, out], t, rcond=None)[0]
    assert left.tt == pytest.approx(np.sum((t - X[:, out] @ best) ** 2), rel=1e-8)
    assert left.n == pytest.approx(N - 4, abs=1e-6)


def test_columns_that_are_one_and_the_same_are_no_error():
    twice = Linear(np.ones((2, 2)), np.ones(2), 1.0, 5.0)
    both, nothing = np.arange(2), np.zeros(2)
    assert twice.solve(both, nothing).sum() == pytest.approx(1.0)
    assert twice.without(both, nothing).tt == pytest.approx(0.0, abs=1e-12)


def test_unknowns_are_absolute_wherever_the_problem_is_linearised():
    A, y = drawn(5, columns=4)
    x, scale = np.array([0.3, -2.0, 5.0, 0.1]), np.array([1e-3, 0.1, 2.0, 7.0])
    r = A @ x - y
    linear = Linear.about(Gram(A.T @ A, A.T @ r, float(r @ r), float(N)), x, scale)
    z = linear.solve(np.arange(4), np.zeros(4))
    np.testing.assert_allclose(z * scale, np.linalg.lstsq(A, y, rcond=None)[0], rtol=1e-8)
    trial = np.array([1.0, -1.0, 2.0])
    some = np.array([0, 1, 3])
    expected = np.sum((A[:, some] @ (scale[some] * trial) - y) ** 2)
    assert linear.square_at(some, trial) == pytest.approx(expected, rel=1e-8)


# Reductions


def reduced(seed, chosen, variance=0.7):
    X, t = drawn(seed)
    linear, found = statistics(X, t), candidates(SIZES)
    left = Reduced.given(linear, batches(linear, found), found, chosen, variance)
    return left, found, X, t


def numbers(left):
    return (*left.blocks, left.b, left.tt, left.n)


CHOSEN = (SelectedTerm(1, 3.0), SelectedTerm(3, 0.1), SelectedTerm(5, 1.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_reduction_is_the_dense_problem_given_its_terms(seed):
    left, found, X, t = reduced(seed, CHOSEN)
    out = np.concatenate([found[c.index].columns for c in CHOSEN])
    prior = np.concatenate([[0.7 / c.scale**2] * SIZES[c.index] for c in CHOSEN])
    G, b, tt, n = marginal(X, t, out, prior)
    blocks = [G[batch.columns[:, :, None], batch.columns[:, None, :]] for batch in left.gathered]
    assert_same(numbers(left), (*blocks, b, tt, n))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("gone", range(len(CHOSEN)))
def test_taking_a_term_back_is_never_having_added_it(seed, gone):
    left = reduced(seed, CHOSEN)[0].without(CHOSEN[gone])
    rest = [c for c in CHOSEN if c is not CHOSEN[gone]]
    assert_same(numbers(left), numbers(reduced(seed, rest)[0]))


@pytest.mark.parametrize("gone", range(len(CHOSEN)))
def test_what_all_others_leave_of_a_term_is_known_without_taking_it_back(gone):
    left, found, *_ = reduced(1, CHOSEN)
    block, b, tt, n = left.of(CHOSEN[gone])
    whole, columns = left.without(CHOSEN[gone]), found[CHOSEN[gone].index].columns
    (place,) = [
        (k, int(np.flatnonzero(batch.members == CHOSEN[gone].index)[0]))
        for k, batch in enumerate(left.gathered)
        if CHOSEN[gone].index in batch.members
    ]
    np.testing.assert_allclose(block, whole.blocks[place[0]][place[1]], atol=1e-9)
    np.testing.assert_allclose(b, whole.b[columns], atol=1e-9)
    assert (tt, n) == pytest.approx((whole.tt, whole.n))


# Evidence


def evidence(X, t, noise, limits=None):
    """Log Bayes factors (S,) of the columns X together, at every scale."""
    s = statistics(X, t)
    return block_evidence(s.G[None], s.b[None], s.tt, s.n, noise, limits)[0]


def settled_variance(X, t, noise, s):
    """The noise variance that reproduces itself, by dense algebra."""
    v = noise.variance(t @ t, len(t))
    for _ in range(200):
        Q = t @ np.linalg.inv(np.eye(len(t)) + s**2 / v * X @ X.T) @ t
        v = noise.variance(Q, len(t))
    return v


CASES = [(0.0, 1), (0.3, 1), (0.3, 2), (2.0, 2)]  # strength of the signal, columns


def signal(strength, columns, seed=6):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(N, columns))
    return X, strength * X @ rng.normal(size=columns) + rng.normal(0.0, 0.5, N)


@pytest.mark.parametrize(("strength", "columns"), CASES)
def test_evidence_is_a_ratio_of_student_densities(strength, columns):
    """Exact at a fixed ratio of prior to noise, where the noise integrates to a Student density.

    The noise is found by three steps of an iteration: what is left of it is the tolerance. At
    scales far below the signal they do not suffice, and the sum over scales ignores those anyway.
    """
    X, t = signal(strength, columns)
    noise = NoisePrior(0.5, 100.0)
    nothing = multivariate_t.logpdf(t, shape=0.25 * np.eye(N), df=100.0)
    for s, found in zip(SCALES, evidence(X, t, noise), strict=True):
        if s < strength / 3:
            continue
        ratio = s**2 / settled_variance(X, t, noise, s)
        shape = 0.25 * (np.eye(N) + ratio * X @ X.T)
        exact = multivariate_t.logpdf(t, shape=shape, df=100.0) - nothing
        assert found == pytest.approx(exact, rel=3e-3, abs=2e-3)


@pytest.mark.parametrize(("strength", "columns"), CASES)
def test_evidence_is_the_marginal_likelihood_over_all_noises(strength, columns):
    """The prior of the effect is as wide at any noise; the sum over sigma is on a fine grid.

    In the ratio of prior to noise the noise is set to its best value instead. At the scales that
    count this is good to a tenth, where evidence is counted in units of one.
    """
    X, t = signal(strength, columns)
    v = np.exp(np.linspace(np.log(0.05), np.log(20.0), 200))
    weight = invgamma.logpdf(v, 50.0, scale=50.0 * 0.25) + np.log(v)  # the grid is logarithmic

    def log_density(K):
        return logsumexp(weight + [multivariate_normal.logpdf(t, cov=x * np.eye(N) + K) for x in v])

    exact = [log_density(s**2 * X @ X.T) for s in SCALES] - log_density(np.zeros((N, N)))
    found = evidence(X, t, NoisePrior(0.5, 100.0))
    assert logsumexp(found + LOG_SCALE_WEIGHTS) == pytest.approx(
        logsumexp(exact + LOG_SCALE_WEIGHTS), abs=0.1
    )


@pytest.mark.parametrize(
    "limits", [(0.0, np.inf), (-np.inf, 0.0), (-0.05, 0.1), (0.0, 0.7), (-np.inf, -0.4)]
)
@pytest.mark.parametrize("strength", [0.0, 0.2, -0.2])
def test_a_bounded_effect_has_the_evidence_of_what_is_within_its_bounds(limits, strength):
    """The noise is known for certain here, so the integral between the bounds is all there is."""
    rng = np.random.default_rng(7)
    x, sigma = rng.normal(size=N), 0.5
    t = strength * x + rng.normal(0.0, sigma, N)
    found = evidence(x[:, None], t, NoisePrior(sigma, 1e8), np.array([[limits]]))
    for s, ours in zip(SCALES, found, strict=True):
        whole = np.diff(norm.cdf(limits, scale=s))[0]

        def density(z, s=s, whole=whole):
            gain = (x @ t * z - 0.5 * x @ x * z**2) / sigma**2
            return norm.pdf(z, scale=s) / whole * np.exp(gain)

        peak = x @ t / (x @ x)
        ends = np.clip([-3.0, peak - 0.5, peak, peak + 0.5, 3.0], *limits)
        pieces = pairwise(sorted({*ends, *np.clip([-0.45, 0.0], *limits)}))
        exact = sum(quad(density, a, b, epsabs=0, epsrel=1e-9)[0] for a, b in pieces)
        assert ours == pytest.approx(np.log(exact), abs=1e-5)


def test_the_wrong_side_of_a_bound_earns_nothing():
    x = np.random.default_rng(8).normal(size=N)
    stiff = Candidate(JointCompliance(joint=2), np.array([0]), 0.0)
    scores = []
    for sign in (1.0, -1.0):
        linear = statistics(x[:, None], sign * 0.3 * x)
        gathered = batches(linear, [stiff])
        left = Reduced.given(linear, gathered, [stiff], [], 1.0)
        scores.append(float(scan(left, gathered, NoisePrior.of(0.2), 1).log_bayes[0]))
    assert scores[0] > 10
    assert scores[1] < 0


@pytest.mark.parametrize("factor", [1e-3, 40.0])
@pytest.mark.parametrize("freedom", [0.0, 100.0])
def test_evidence_does_not_depend_on_the_unit_of_the_readings(factor, freedom):
    X, t = signal(0.5, 2)
    limits = np.array([[[0.0, 3.0], [-np.inf, np.inf]]])
    one = evidence(X, t, NoisePrior(0.5, freedom), limits)
    other = evidence(factor * X, factor * t, NoisePrior(factor * 0.5, freedom), limits)
    np.testing.assert_allclose(other, one, rtol=1e-9)


def scanned(X, t, found):
    linear = statistics(X, t)
    gathered = batches(linear, found)
    nothing = Reduced.given(linear, gathered, found, [], 1.0)
    return scan(nothing, gathered, NoisePrior.of(1.0), len(found)).log_bayes


def test_neither_the_order_of_rows_nor_of_columns_matters():
    X, t = drawn(9)
    found = candidates(SIZES)
    straight = scanned(X, t, found)
    rng = np.random.default_rng(10)
    rows, columns = rng.permutation(N), rng.permutation(X.shape[1])
    np.testing.assert_allclose(scanned(X[rows], t[rows], found), straight, rtol=1e-9)
    place = np.argsort(columns)
    moved = [Candidate(c.effect, place[c.columns], c.log_prior) for c in found]
    np.testing.assert_allclose(scanned(X[:, columns], t, moved), straight, rtol=1e-9)
    turned = scanned(X, t, found[::-1])
    np.testing.assert_allclose(turned[::-1], straight, rtol=1e-9)


def test_a_scan_is_the_mean_over_the_grid_of_scales():
    X, t = signal(0.3, 2)
    own = candidates([2])
    by_scale = evidence(X, t, NoisePrior.of(1.0), own[0].limits[None]) + LOG_SCALE_WEIGHTS
    assert np.exp(LOG_SCALE_WEIGHTS).sum() == pytest.approx(1.0)
    assert scanned(X, t, own)[0] == pytest.approx(logsumexp(by_scale), rel=1e-10)


def test_a_column_of_nothing_is_no_evidence_either_way():
    X, t = signal(0.3, 1)
    np.testing.assert_allclose(evidence(0 * X, t, NoisePrior.of(0.5)), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_batches_that_are_weighed_together_are_each_weighed_as_alone(seed):
    rng = np.random.default_rng(seed)
    asked = []
    for k, bounded in ((1, True), (2, False), (3, True), (2, True)):
        X = rng.normal(size=(5, 8, k))
        blocks, b = X.transpose(0, 2, 1) @ X, rng.normal(size=(5, k))
        limits = rng.uniform(0.0, 2.0, (5, k, 2)) * [-1.0, 1.0]
        asked.append((blocks, b, limits if bounded else None))
    together = evidence_of_all(asked, 9.0, 30.0, NoisePrior())
    alone = [block_evidence(blocks, b, 9.0, 30.0, NoisePrior(), s) for blocks, b, s in asked]
    assert_same([together], [np.concatenate(alone)])


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4, -1.2])
@pytest.mark.parametrize("small", [0.0, 1e-9, 1.0, 3.0])
def test_pairs_of_columns_are_turned_into_their_own_directions(turn, small):
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    block = R @ np.diag([3.0, small]) @ R.T
    values, vectors = _eigen(block[None])
    np.testing.assert_allclose(vectors[0].T @ vectors[0], np.eye(2), atol=1e-14)
    np.testing.assert_allclose(vectors[0] * values[0] @ vectors[0].T, block, atol=1e-14)


def test_columns_that_repeat_each_other_have_a_basis(monkeypatch):
    """Singular values of 54 columns of rank 14 were not found: a diagnosis ended with that."""

    def never(*_args, **_options):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", never)
    rng = np.random.default_rng(3)
    span = rng.normal(size=(60, 4)) * [1e-6, 1.0, 1e3, 1.0]
    columns = np.hstack([span[:, rng.integers(0, 4, 20)], span, np.zeros((60, 1))])
    columns[:, :9] *= 1.0 + 1e-15 * rng.normal(size=(60, 9))
    basis = orthonormal(columns)
    assert basis.shape == (60, 4)
    np.testing.assert_allclose(basis.T @ basis, np.eye(4), atol=1e-12)
    left = columns - basis @ (basis.T @ columns)
    np.testing.assert_array_less(
        np.linalg.norm(left, axis=0), 1e-10 * np.linalg.norm(span, axis=0).max()
    )
    assert orthonormal(np.empty((60, 0))).shape == (60, 0)
