r"""The evidence of several terms together, in as many numbers as there are columns, or rows.

With :math:`A = S G S + \sigma^2 I` of the terms' columns at their widths S, nuisances eliminated,

.. math:: \log B = -\tfrac12 \log\det (A / \sigma^2)
          - \tfrac{\nu_0 + n}{2} \log \frac{\nu_0 \sigma_0^2 + Q}{\nu_0 \sigma_0^2 + t^T t},
          \qquad Q = t^T t - b^T S A^{-1} S b .

Where equations are fewer than columns, :math:`G = B^T B` and :math:`b = B^T c` with a B of as many
rows, and (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, app. A.3) with
:math:`M = B S^2 B^T + \sigma^2 I`

.. math:: \det (A / \sigma^2) = \det (M / \sigma^2), \qquad
          Q = t^T t - c^T c + \sigma^2 c^T M^{-1} c .
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtri

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear, cholesky
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, log_within


class _Solved(NamedTuple):
    """What all terms together leave at so many scales and variances of the noise."""

    square: Array  # of the target (S,)
    occam: Array  # log of the share of their priors that is left (S,)
    moments: Callable[[], tuple[Array, Array]]  # means, variances over the noise's (S, K)


@dataclass(frozen=True, eq=False)
class Together:
    """Terms (C), of a linear problem's columns one after the other (K)."""

    linear: Linear  # the problem, nuisances eliminated
    noise: NoisePrior  # the prior of the noise
    owner: NDArray[np.intp]  # of every column the term (K,)
    limits: Array  # of every column's number (K, 2)

    def evidence(self, scales: Array, variance: float) -> tuple[Array, Array]:
        """Log evidence (S,) of all terms against none, and the noise that they leave (S,).

        The share of their priors within their limits is left out.

        Args:
            scales: Their scales, so many ways (S, C).
            variance: Of the noise, a guess.
        """
        linear, noise, s = self.linear, self.noise, scales[:, self.owner]
        at = self._in_columns(s) if len(self.owner) <= linear.n else self._in_rows(s)
        base = float(noise.variance(linear.tt, linear.n))
        found: list[_Solved] = []

        def left(v: Array) -> tuple[Array, float]:
            found[:] = [at(v)]
            return found[0].square, linear.n

        v = noise.settled(left, np.full(len(s), variance))
        log = found[0].occam - 0.5 * (noise.freedom + linear.n) * np.log(v / base)
        if np.isfinite(self.limits).any():
            mean, square = found[0].moments()
            std = s * np.sqrt(v[:, None] * square)
            log = log + log_within(self.limits, mean, std).sum(axis=1)
        return log, v

    def _in_columns(self, s: Array) -> Callable[[Array], _Solved]:
        """At some scales (S, K), by A."""
        linear = self.linear
        G = linear.G * (s[:, :, None] * s[:, None, :])
        b = linear.b * s

        def at(v: Array) -> _Solved:
            lower, hidden = _factors(G, b, linear.tt, v)

            def moments() -> tuple[Array, Array]:
                inverse = np.stack([dtrtri(one, lower=1)[0] for one in lower])
                return s * np.einsum("skj,sk->sj", inverse, hidden), np.sum(inverse**2, axis=1)

            left = np.maximum(linear.tt - np.sum(hidden**2, axis=1), 0.0)
            return _Solved(left, _occam(lower, v), moments)

        return at

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        """B (r, K), of as many rows as equations are left, and c (r,)."""
        values, vectors = np.linalg.eigh(self.linear.G)
        told = values > len(values) * np.finfo(float).eps * values.max(initial=0.0)
        told[: len(values) - int(np.ceil(self.linear.n))] = False  # the rest is rounding's
        root = np.sqrt(values[told])
        return root[:, None] * vectors[:, told].T, vectors[:, told].T @ self.linear.b / root

    def _in_rows(self, s: Array) -> Callable[[Array], _Solved]:
        """At some scales (S, K), by M."""
        B, c = self._rows
        M, wide, known = (B * s[:, None, :] ** 2) @ B.T, np.tile(c, (len(s), 1)), float(c @ c)
        rest = max(self.linear.tt - known, 0.0)

        def at(v: Array) -> _Solved:
            lower, hidden = _factors(M, wide, known / float(v.min()), v)

            def moments() -> tuple[Array, Array]:
                U = np.linalg.solve(lower, np.broadcast_to(B, (len(s), *B.shape)))
                square = np.maximum(1.0 - s**2 * np.sum(U**2, axis=1), 0.0) / v[:, None]
                return s**2 * np.einsum("sr,srk->sk", hidden, U), square

            return _Solved(rest + v * np.sum(hidden**2, axis=1), _occam(lower, v), moments)

        return at


def _occam(lower: Array, v: Array) -> Array:
    """Log of det(A / v)^(-1/2) by its Cholesky factors (S, K, K)."""
    log = -np.log(np.einsum("sii->si", lower)).sum(axis=1)
    return np.asarray(log + 0.5 * lower.shape[1] * np.log(v))


def _factors(G: Array, b: Array, most: float, variance: Array) -> tuple[Array, Array]:
    """Of Gram matrices (S, K, K) and variances (S,) of the noise, and what stands on the right.

    The lower Cholesky factors L (S, K, K) and L^-1 b (S, K), which is the last row of the factor
    of A bordered by b: with ``most`` in its corner, no less than b^T A^-1 b, that is definite.
    """
    K = G.shape[1]
    A = np.empty((len(G), K + 1, K + 1))
    A[:, :K, :K], A[:, K, :K] = G, b
    np.einsum("sii->si", A)[:, :K] += variance[:, None]
    A[:, K, K] = 2.0 * most + 1.0
    try:
        lower = np.asarray(np.linalg.cholesky(A))
    except np.linalg.LinAlgError:
        lower = cholesky(A[:, :K, :K], np.einsum("sii->si", G))
        return lower, np.asarray(np.linalg.solve(lower, b[:, :, None]))[:, :, 0]
    return lower[:, :K, :K], lower[:, K, :K]
