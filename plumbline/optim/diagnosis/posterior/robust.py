r"""Gross errors: rows that not even all effects together can explain.

Every row is predicted from all others by the whole library at once, each effect under its own
prior. With :math:`H_k` the row's leverage, the deletion statistic (Belsley, Kuh, Welsch 1980,
sec. 2.1)

.. math:: D_k = r_k^T (I - H_k)^{-1} r_k / \sigma^2

is chi-square with m degrees of freedom; sigma is taken from the median of D itself, so that the
gross rows do not set their own standard. A row that a real effect moves is predicted by the library
and is kept.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular
from scipy.special import betaln, chdtri, gammaincinv, logit, logsumexp

from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.linearise.linear import Linear, cholesky, flat_prior
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.measurement.correlated import postures
from plumbline.optim.measurement.observation import rotation_lever
from plumbline.optim.recording.recording import Recording


def distrusted_rows(pool: Pool) -> NDArray[np.bool_]:
    """Rows (N,) taken for gross errors; at most a fifth of all.

    By the whole library: a nominal fit takes the few rows in a gear's pit for gross ones.
    """
    rows = len(pool.model.recording)
    bad = np.zeros(rows, dtype=bool)
    sigma2, freedom = _first_guess(pool), pool.model.problem.freedom
    for _ in range(prior.ROUNDS):
        statistic = _deletion_statistics(pool, bad, sigma2)
        scale = _size(statistic, freedom, ~bad)
        limit = prior.ANISOTROPY * chdtri(freedom, prior.ALARM / rows)
        found = statistic > limit * scale
        if not found.any() or found.sum() > prior.MOST_GROSS_SHARE * rows:
            break
        if (found | bad).sum() == bad.sum():
            break
        bad |= found
        sigma2 = sigma2 * float(np.clip(scale, 0.1, 1.0))
    return bad & ~follows_something(bad, pool.model.recording)


def follows_something(found: NDArray[np.bool_], recording: Recording) -> NDArray[np.bool_]:
    r"""Rows (N,) of those found that lie where something recorded says: these are no accidents.

    Of k of N rows found, m are in a range of n rows of what was recorded. If that range attracts
    them, all k are in it as probably as not, and any fewer alike; against k rows anywhere

    .. math:: B = \binom Nk \Big/ \binom nm \binom{N - n}{k - m} \times
              \begin{cases} 1/2 & m = k \\ 1/2k & m < k \end{cases}

    whose mean over all ranges of all that was recorded exceeds 1/q by chance in no more than q
    (Markov).
    """
    follows = np.zeros(len(found), dtype=bool)
    columns = _recorded(recording)
    while (found & ~follows).sum() >= prior.FEWEST_BETWEEN:
        more = _in_a_range(found[~follows], [values[~follows] for values in columns])
        if not more.any():
            break
        follows[~follows] = more
    return follows


def _in_a_range(found: NDArray[np.bool_], columns: Sequence[Array]) -> NDArray[np.bool_]:
    """Those of the rows found (N,) in the range that explains them best; none if by accident."""
    k, N = float(found.sum()), float(len(found))
    logs, within = [], []
    for values in columns:
        shares = np.linspace(0.0, 1.0, prior.PLACES + 1)
        edges = np.unique(np.quantile(values, shares, method="nearest"))
        above = values >= edges[:, None]
        low, high = np.triu_indices(len(edges) + 1, 1)
        n = -np.diff(np.append(above.sum(axis=1), 0)[[low, high]], axis=0)[0]
        m = -np.diff(np.append((above & found).sum(axis=1), 0)[[low, high]], axis=0)[0]
        log = _log_ways(k, N) - _log_ways(m, n) - _log_ways(k - m, N - n)
        log = log - np.log(np.where(m == k, 2.0, 2.0 * k))
        best = int(np.argmax(log))
        logs.append(float(logsumexp(log) - np.log(len(log))))
        upper = np.append(edges, np.inf)[high[best]]
        within.append((values >= edges[low[best]]) & (values < upper))
    odds = float(logsumexp(logs)) - np.log(len(logs)) + logit(prior.ALARM)
    return found & within[int(np.argmax(logs))] & (odds > 0.0)


def _log_ways(some: Array | float, of: Array | float) -> Array:
    """Log number of ways to choose some of so many."""
    return np.asarray(-np.log1p(of) - betaln(np.asarray(of) - some + 1.0, np.asarray(some) + 1.0))


def _recorded(recording: Recording) -> list[Array]:
    """All (N,) that a row's error may follow: its number, postures, places, and what goes along."""
    along = (recording.payload, recording.temperature, recording.group)
    found = [np.arange(float(len(recording))), *(x for x in along if x is not None)]
    if not recording.stand_in and recording.element is None:
        found += [*recording.q.T, *recording.chain.placement(recording.q)[:, :3, 3].T]
    return [np.asarray(values, dtype=float) for values in found if np.ptp(values) > 0]


def distrusted_by_fit(residuals: Array) -> NDArray[np.bool_]:
    """Rows (N,) whose residuals (N, m) under a good fit are far beyond the others'.

    For recordings so long that no single row has leverage.
    """
    rows, m = residuals.shape
    square = (residuals**2).sum(axis=1)
    scale = np.median(square) / _typical(m)
    bad = square > prior.ANISOTROPY * chdtri(m, prior.ALARM / rows) * scale
    return bad if bad.sum() <= prior.MOST_GROSS_SHARE * rows else np.zeros(rows, dtype=bool)


def far_off(residuals: Array) -> NDArray[np.bool_]:
    """Gross errors (N,) among rows kept back: missed ten times as far as the others.

    What is missed by less may be what the causes cannot foretell, which the gap has to show.
    """
    missed = np.linalg.norm(residuals, axis=1)
    return distrusted_by_fit(residuals) & (
        missed > prior.GROSS_KEPT_BACK * float(np.median(missed))
    )


def distrusted_given(solution: Solution, sigma: float, recording: Recording) -> NDArray[np.bool_]:
    """Rows (N,) that a fitted model misses by far, those it was fitted without among them.

    Args:
        solution: The fit; rows of weight 0 are judged as predictions.
        sigma: The noise if it is known, else 0; a model that misses every row accuses none.
        recording: The rows.
    """
    weights = solution.problem.weights
    m, rows, freedom = solution.problem.equations, len(weights), solution.problem.freedom
    found = np.empty(rows)
    inverse = np.linalg.pinv(solution.gram.matrix, hermitian=True)
    for part, r, J in solution.mapped.jacobians(solution.x):
        H = J @ inverse @ J.transpose(0, 2, 1)
        sign = np.where(weights[part] > 0, -1.0, 1.0)[:, None, None]
        values, vectors = np.linalg.eigh(np.eye(m) + sign * H)
        turned = np.einsum("nji,nj->ni", vectors, r)
        found[part] = (turned**2 / np.maximum(values, 1e-3)).sum(axis=1)
    scale = max(_size(found, freedom, weights > 0), sigma**2)
    bad = found > prior.ANISOTROPY * chdtri(freedom, prior.ALARM / rows) * scale
    if bad.sum() > prior.MOST_GROSS_SHARE * rows:
        return weights == 0
    return bad & ~follows_something(bad, recording)


def _size(squares: Array, freedom: int | Array, of: NDArray[np.bool_]) -> float:
    """Median square of some rows over that of chi-square with as many degrees of freedom."""
    if isinstance(freedom, int):
        return float(np.median(squares[of])) / float(_typical(freedom))
    return float(np.median(squares[of] / _typical(freedom[of])))


def lone_rows(recording: Recording) -> NDArray[np.bool_]:
    """Rows (N,) of markers that are touched once: what is wrong with them is the marker's place."""
    if not recording.kind.fiducials or recording.element is None:
        return np.zeros(len(recording), dtype=bool)
    return np.asarray(np.bincount(recording.element)[recording.element] == 1)


def noise_lever(solution: Solution, recording: Recording) -> float:
    """Ratio of the noises of position and rotation that a fit of poses has left [m]."""
    r = solution.mapped.residuals(solution.x)[solution.problem.weights > 0]
    spread = np.median(np.abs(r[:, :3])) / max(float(np.median(np.abs(r[:, 3:]))), 1e-300)
    return rotation_lever(recording) * float(np.clip(spread, *prior.LEVER_CHANGE))


def _first_guess(pool: Pool) -> float:
    """Noise variance: as stated, else a tenth of the nominal residual's robust variance."""
    if pool.noise.sigma:
        return pool.noise.sigma**2
    r = Mapped(pool.model.problem).residuals(pool.x)
    squares, every = (r**2).sum(axis=1), np.ones(len(r), dtype=bool)
    return max(_size(squares, pool.model.problem.freedom, every) / 10, pool.noise.least**2)


def _first_of_copies(recording: Recording) -> Indices:
    """Of every row (N,) the one that stands for it: itself, or the first that it is a copy of."""
    if recording.alike < 1.0:
        return np.arange(len(recording))
    _, first, of = np.unique(postures(recording), return_index=True, return_inverse=True)
    return np.asarray(first[of])


def _deletion_statistics(pool: Pool, bad: NDArray[np.bool_], sigma2: float) -> Array:
    r"""D (N,) of every row under the whole library fitted to the rows that are trusted.

    The first of copies stands for all, which would foretell each other. A row that the fit counts w
    times takes as much of its own misfit, :math:`I - w_k H_k`; one that it does not count is
    foretold, :math:`I + H_k`.
    """
    problem, linear = pool.model.problem, pool.whole
    first = _first_of_copies(pool.model.recording)
    weights = np.where(bad, 0.0, np.bincount(first, problem.weights, len(first)))
    if (weights != problem.weights).any():
        trusted = Mapped(replace(problem, weights=weights))
        linear = Linear.about(trusted.gram(pool.x), pool.x, problem.scale)
    G = linear.G.copy()
    # Readings without any noise must not leave the algebra without a prior.
    size = np.diag(G).copy()
    precision = np.full(problem.size, max(sigma2, 1e-14 * float(size.max())))
    precision[: pool.always] = flat_prior(linear, pool.always)
    G[np.diag_indices_from(G)] += precision
    lower = cholesky(G, size)
    shift = cho_solve((lower, True), linear.b) - pool.x / problem.scale
    found, m = np.empty(len(bad)), problem.equations
    for part, r, J in Mapped(problem).jacobians(pool.x):
        A = J * problem.scale
        left = r + A @ shift
        flat = solve_triangular(lower, A.reshape(-1, problem.size).T, lower=True)
        half = np.asarray(flat.T).reshape(A.shape)
        own = np.where(weights[part] > 0.0, -weights[part], 1.0)[:, None, None]
        values, vectors = np.linalg.eigh(np.eye(m) + own * (half @ half.transpose(0, 2, 1)))
        turned = np.einsum("nji,nj->ni", vectors, left)
        found[part] = (turned**2 / np.maximum(values, 1e-6)).sum(axis=1) / sigma2
    return found[first]


def _typical(freedom: Array | int) -> Array:
    """Median of chi square with so many degrees of freedom."""
    return np.asarray(2.0 * gammaincinv(np.asarray(freedom) / 2.0, 0.5))
