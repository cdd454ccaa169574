r"""Rounds of fit and weight: first robust, then with variances of largest likelihood.

Robust rounds minimise Cauchy's loss (Holland and Welsch 1977) with a scale that shrinks with the
residuals, so that a start that is centimetres off is no harm:

.. math:: w_j = \frac{1}{1 + (e_j / c\,\hat\sigma)^2}, \quad c = 2.385, \quad
          \hat\sigma = \sqrt{N / (N - P)}\, |e|_{(h)} / \Phi^{-1}(\tfrac{1}{2} + \tfrac{h}{2 N}),
          \quad h = (N + P) / 2

P unknowns can meet P of N readings exactly: the median of few is nothing for a wrong fit, the h-th
is not (Rousseeuw and Leroy 1987, ch. 3). It judges where the rounds ended; on their way, when many
readings may still be gross, the scale is that of the median, h = N / 2.

Rounds of largest likelihood then take turns between the unknowns and the variances
(expectation-maximisation): with H the Hessian of the weighted cost, the expected square of reading
j's error is :math:`e_j^2 + J_j H^{-1} J_j^T`, and that of a shape's coefficient
:math:`c^2 + (H^{-1})_{cc}`. A range of variance :math:`\sigma_d^2 + (g \tan\theta)^2`, its second
part from the spot that spreads over depths, moves the point along the beam; across the plane that
is times :math:`\cos^2\theta`, and flange and board add a constant:
:math:`\sigma^2(\theta) = a + b \sin^2\theta`.

What the rows say of the beam once every plane and shape is eliminated: with A the Jacobian times
the root of the weights, its columns scaled by the unknowns' sizes S, and Q an orthonormal basis of
the nuisances' columns,

.. math:: (I - Q Q^T) A_b = U\, \mathrm{diag}(s)\, V^T, \qquad
          \Sigma_b = S V\, \mathrm{diag}(s^{-2})\, V^T S

(Schur's complement). A direction without rows behind it has s = 0 and an infinite variance; it must
never be dropped, which would give it none.

Whether the finder's scale is off is one more column beside the fit, which has none. A range that
is read as :math:`d (1 + s)` puts its point :math:`s\, d \cos\theta` off the board. With Q of all
columns and a the weighted column of that, what the fit leaves of it tells s (Frisch and Waugh 1933,
Econometrica 1(4)):

.. math:: \tilde a = (I - Q Q^T)\, a, \qquad
          \hat s = \frac{\tilde a^T e}{\tilde a^T \tilde a}, \qquad
          \sigma_s = \frac{1}{|\tilde a|}

The boards' and the arm's smooth shapes are among the columns: what they may be, s is not.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.direct import prior_kinds


def marginal_covariance(problem: Problem, J: Array, weights: Array) -> Array:
    """Covariance (5, 5) of the beam's unknowns; astronomic where rows (N, P) say nothing."""
    A = J * np.sqrt(weights)[:, None] * problem.scale
    free = _beside(A[:, constants.BEAM :], A[:, : constants.BEAM])
    _, s, Vt = np.linalg.svd(free, full_matrices=False)
    root = problem.scale[: constants.BEAM, None] * Vt.T / np.maximum(s, constants.NOTHING)
    return np.asarray(root @ root.T)


def _beside(columns: Array, others: Array) -> Array:
    """What of others (N, ...) no mixture of some columns (N, k) makes."""
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    Q = U[:, sizes > constants.NUISANCE_RANK * sizes[0]]
    return np.asarray(others - Q @ (Q.T @ others))


@dataclass(frozen=True)
class Variance:
    """Variance of a reading's equation over its incidence."""

    normal: float  # a, at normal incidence [m^2]
    slant: float = 0.0  # b, added in proportion to sin^2 of the incidence [m^2]

    def at(self, incidence: Array) -> Array:
        """Variances (N,) [m^2] at angles (N,) [rad]."""
        grown = self.normal + self.slant * np.sin(incidence) ** 2
        return np.asarray(np.maximum(grown, constants.VARIANCE_FLOOR * self.normal))


def fit_variance(squares: Array, incidence: Array) -> Variance:
    """The variance of largest likelihood, given expected squares of errors (N,) [m^2].

    Fisher scoring: least squares of the squares over (1, sin^2), weighted by the inverse variance
    squared, and no less than a twentieth of the mean at either end. It has a slope where twice the
    gain in log-likelihood is more than log N (Schwarz 1978, Ann. Statist. 6(2)): weights by one
    that 40 readings do not tell follow their noise, and errors stated of them held 88 %.
    """
    slope = np.sin(incidence) ** 2
    mean = max(float(np.mean(squares)), np.finfo(float).tiny)
    most = float(slope.max(initial=0.0))
    if most < constants.LEAST_SLANT:
        return Variance(mean)
    A = np.column_stack([np.ones_like(slope), slope])
    found = np.array([mean, 0.0])
    for _ in range(constants.VARIANCE_ROUNDS):
        w = 1.0 / np.maximum(A @ found, constants.LEAST * mean) ** 2
        normal = (A * w[:, None]).T @ A
        found = np.linalg.solve(normal, A.T @ (w * squares))
        low = constants.VARIANCE_FLOOR * mean
        a = max(found[0], low)
        far = max(a + most * found[1], low)
        found = np.array([a, (far - a) / most])
    sloped = A @ found
    gain = np.sum(np.log(mean / sloped) + squares / mean - squares / sloped)
    told = gain > np.log(len(squares))
    return Variance(float(found[0]), float(found[1])) if told else Variance(mean)


FREE = (constants.BOW, constants.ARM)  # kinds whose spread the readings tell


@dataclass(frozen=True, eq=False)
class LikelyFit:
    """Where the rounds ended."""

    x: Array  # the unknowns (P,)
    relative: Array  # weights of all rows over the readings' mean: what they weigh stays in m
    errors: Array  # residuals of all rows [m]
    leverage: Array  # share of each row that the fit takes up (N,)
    beam: Array  # covariance of the beam's unknowns (5, 5), all others eliminated
    covariance: Array  # of the unknowns (P, P), within what the rows determine
    variance: Variance  # of a reading, over its incidence
    # standard deviations [m] of the prior's kinds: a board's shape, the arm's, the bias
    spreads: Array


def robust_fit(
    problem: Problem, start: Array, rounds: int = constants.ROBUST_ROUNDS
) -> tuple[Array, Array, float]:
    """Unknowns (P,), errors (N,) [m] and their robust sigma [m], by Cauchy's loss."""
    mapped, x = Mapped(problem), np.array(start)
    for _ in range(rounds):
        e, J = rows_at(mapped, x)
        sigma = _robust_sigma(e, len(x))
        w = 1.0 / (1.0 + (e / (constants.CAUCHY * sigma)) ** 2)
        step = _step(problem, J, e, w)
        x = x + step
        if np.max(np.abs(step) / problem.scale) < constants.ROBUST_SETTLED:
            break
    e, _ = rows_at(mapped, x)
    return x, e, _robust_sigma(e, len(x), met=len(x))


def likely_fit(
    problem: Problem, start: Array, incidence: Array, first: Variance, spreads: Array
) -> LikelyFit:
    """Unknowns (P,) and variances of largest likelihood together, incidence (N,) [rad].

    ``spreads`` (3,) [m] are those of the prior's kinds to start from; that of the bias stays.
    """
    mapped, x = Mapped(problem), np.array(start)
    variance, kinds = first, prior_kinds(problem)
    for _ in range(constants.LINEAR_ROUNDS):
        e, J = rows_at(mapped, x)
        before = x
        x, variance, spreads, settled = _turns(problem, (x, e, J), incidence, variance, spreads)
        if settled and np.max(np.abs(x - before) / problem.scale) < constants.RESTED:
            break
    e, J = rows_at(mapped, x)
    w = _weights(variance, incidence, spreads[kinds])
    covariance = _inverse(problem, J, w)
    leverage = w * np.einsum("ni,ni->n", J @ covariance, J)
    beam = marginal_covariance(problem, J, w)
    relative = w / w[: len(incidence)].mean()
    return LikelyFit(x, relative, e, leverage, beam, covariance, variance, spreads)


def _turns(
    problem: Problem,
    at: tuple[Array, Array, Array],
    incidence: Array,
    variance: Variance,
    spreads: Array,
) -> tuple[Array, Variance, Array, bool]:
    """Turns between unknowns and variances, about one linearisation (x, e, J)."""
    x, e, J = at
    count, kinds = len(incidence), prior_kinds(problem)
    for _ in range(constants.LIKELY_ROUNDS):
        w = _weights(variance, incidence, spreads[kinds])
        covariance = _inverse(problem, J, w)
        step = -covariance @ (J.T @ (w * e))
        left = e + J @ step
        squares = left**2 + np.einsum("ni,ni->n", J @ covariance, J)
        before = (variance, spreads)
        variance = fit_variance(squares[:count], incidence)
        spreads = np.array(spreads)
        for kind in FREE:
            own = squares[count:][kinds == kind]
            spreads[kind] = np.sqrt(np.mean(own)) if len(own) else 0.0
        if _settled(before, (variance, spreads)):
            return x + step, variance, spreads, True
    return x + step, variance, spreads, False


def rows_at(mapped: Mapped, x: Array) -> tuple[Array, Array]:
    """Residuals (N,) and Jacobian (N, P) of all rows, unweighted."""
    parts = [(r[:, 0], J.reshape(-1, len(x))) for _, r, J in mapped.jacobians(x)]
    return np.concatenate([r for r, _ in parts]), np.concatenate([J for _, J in parts])


def _weights(variance: Variance, incidence: Array, spreads: Array) -> Array:
    """Weights of the readings, and of the prior's rows by their spreads (L,) [m]."""
    squares = np.concatenate([variance.at(incidence), spreads**2])
    return np.asarray(1.0 / np.maximum(squares, constants.LEAST_SIGMA**2))


def _settled(before: tuple[Variance, Array], after: tuple[Variance, Array]) -> bool:
    one, two = ([v.normal, v.slant, *(s[list(FREE)] ** 2)] for v, s in (before, after))
    most = max(two[0], *two[2:])
    return bool(np.all(np.abs(np.subtract(one, two)) <= constants.VARIANCE_SETTLED * most))


def _robust_sigma(errors: Array, unknowns: int, *, met: int = 0) -> float:
    """Scatter [m] by the quantile of the errors (N,) that a fit to ``met`` of them leaves."""
    count = len(errors)
    share = 0.5 + min(met, count - 1) / (2.0 * count)
    size = np.quantile(np.abs(errors), share, method="hazen") / ndtri((1.0 + share) / 2.0)
    return float(max(np.sqrt(count / max(count - unknowns, 1)) * size, constants.LEAST_SIGMA))


def _step(problem: Problem, J: Array, e: Array, w: Array) -> Array:
    """Gauss and Newton's step (P,); the shortest one where the rows leave it open."""
    root = np.sqrt(w)
    A = J * root[:, None] * problem.scale
    return np.asarray(
        -problem.scale * np.linalg.lstsq(A, root * e, rcond=constants.NUISANCE_RANK)[0]
    )


def _inverse(problem: Problem, J: Array, w: Array) -> Array:
    """Covariance (P, P) of the unknowns within what the rows determine: nothing else moves them."""
    A = J * np.sqrt(w)[:, None] * problem.scale
    values, vectors = np.linalg.eigh(A.T @ A)
    known = values > constants.KNOWN * values[-1]
    root = vectors[:, known] / np.sqrt(values[known]) * problem.scale[:, None]
    return np.asarray(root @ root.T)


def scale_told(
    solution: Solution, fit: LikelyFit, distance: Array, incidence: Array
) -> tuple[float, float]:
    """The scale's deviation and its standard error, by readings (N,) [m] at angles (N,) [rad]."""
    e, J = rows_at(solution.mapped, solution.x)
    root = np.sqrt(fit.relative * np.mean(1.0 / fit.variance.at(incidence)))
    a = np.zeros(len(e))
    a[: len(distance)] = distance * np.cos(incidence)
    left = _beside(J * root[:, None] * solution.problem.scale, a * root)
    size = max(float(np.linalg.norm(left)), constants.NOTHING)
    return float(left @ (root * e)) / size**2, 1.0 / size
