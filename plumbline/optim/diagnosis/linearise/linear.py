r"""Linear least squares in its sufficient statistics, and the elimination of columns.

About a fit the residual is linear, :math:`r \approx X z - t`, so all that any subset of effects
needs is :math:`G = X^T X`, :math:`b = X^T t` and :math:`t^T t`. Taking columns out under a Gaussian
prior of precision :math:`\Lambda` (in units of the noise) leaves, by Woodbury's identity,

.. math:: G' = G - G_{\cdot B} (G_{BB} + \Lambda)^{-1} G_{B \cdot}, \qquad
          b' = b - G_{\cdot B} (G_{BB} + \Lambda)^{-1} b_B
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, qr
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dtrtri

from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.diagnosis.constants import FLATTEST, JITTER

Columns = Indices


@dataclass(frozen=True, eq=False)
class Linear:
    """Sufficient statistics of a linear problem with P columns and n equations."""

    G: Array  # gram matrix (P, P)
    b: Array  # correlation with the target (P,)
    tt: float  # square of the target
    n: float  # equations left, after what was eliminated

    @classmethod
    def about(cls, gram: Gram, x: Array, scale: Array) -> Linear:
        """From normal equations at x, so that the unknowns are absolute, in units of scale."""
        z = x / scale
        G = np.outer(scale, scale)
        G *= gram.matrix
        g = gram.vector * scale
        square = gram.square - 2 * float(z @ g) + float(z @ G @ z)
        return cls(G, np.asarray(G @ z - g), square, gram.count)

    def share(self, of: float) -> Linear:
        """The same where all rows together are worth a share of their number."""
        return Linear(of * self.G, of * self.b, of * self.tt, of * self.n)

    def without(self, columns: Columns, precision: Array) -> Linear:
        """Eliminate columns whose prior precision (k,) is in units of 1 / noise^2."""
        A = self.G[np.ix_(columns, columns)] + np.diag(precision)
        cross = self.G[:, columns]
        weights = solved(A, np.column_stack([cross.T, self.b[columns]]))
        G = cross @ weights[:, :-1]
        np.subtract(self.G, G, out=G)
        b = self.b - cross @ weights[:, -1]
        tt = self.tt - self.b[columns] @ weights[:, -1]
        used = np.trace(solved(A, self.G[np.ix_(columns, columns)]))
        return Linear(G, b, max(float(tt), 0.0), self.n - float(used))

    def only(self, columns: Columns) -> Linear:
        """The same with some columns alone, all others absent."""
        return Linear(self.G[np.ix_(columns, columns)], self.b[columns], self.tt, self.n)

    def block(self, rows: Columns, columns: Columns) -> Array:
        """Gram block (k, m) of some columns and others: its whole rows lie together in memory."""
        return np.asarray(self.G[rows].take(columns, axis=1))

    def given(
        self, columns: Columns, precision: Array, asked: Columns, own: Linear | None = None
    ) -> tuple[Array, Array, Array, float, float]:
        r"""What is left given some columns, in factored form, without working out all of it.

        The inverse of their Cholesky factor L (K, K); of the columns a that are asked (R,)
        :math:`R = G_{aB} L^{-T}` (R, K), and :math:`h = L^{-1} b_B` (K,), such that
        :math:`G'_{aa} = G_{aa} - R R^T` and :math:`b'_a = b_a - R h`; the target's square, and
        equations. ``own`` is the problem of the columns alone, where it is known.
        """
        unit, hidden, tt, n = (own or self.only(columns)).factored(precision)
        # By a triangle, which is half of the work.
        root = dtrmm(1.0, unit, self.block(columns, asked), lower=1).T
        return unit, np.asarray(root), hidden, tt, n

    def factored(self, precision: Array) -> tuple[Array, Array, float, float]:
        """L^-1 (K, K) of the Cholesky factor of all columns, L^-1 b (K,), and what they leave.

        That is the target's square, and equations.
        """
        if not len(precision):
            return np.zeros((0, 0)), np.zeros(0), self.tt, self.n
        A, own = self.G.copy(), np.diag(self.G)
        np.einsum("ii->i", A)[:] += precision + JITTER * own
        unit, _ = dtrtri(cholesky(A, own), lower=1)
        hidden = unit @ self.b
        used = len(A) - float(precision @ np.sum(unit**2, axis=0))
        return unit, hidden, max(self.tt - float(hidden @ hidden), 0.0), self.n - used

    def solve(self, columns: Columns, precision: Array) -> Array:
        """Best values (k,) of some columns, all others absent."""
        A = self.G[np.ix_(columns, columns)] + np.diag(precision)
        return solved(A, self.b[columns])

    def square_at(self, columns: Columns, z: Array) -> float:
        """Residual sum of squares at given values (k,) of some columns, all others absent."""
        return float(self.tt - 2 * z @ self.b[columns] + z @ self.G[np.ix_(columns, columns)] @ z)


def cholesky(A: Array, size: Array) -> Array:
    """The lower Cholesky factor of symmetric matrices (..., K, K), also where rounding spoilt them.

    What was subtracted from a large Gram matrix carries that one's rounding: where a prior is
    weaker than this, the matrix may come out indefinite. It then gets as much of its size as makes
    up for the rounding (Higham 2002, Accuracy and Stability of Numerical Algorithms, ch. 10).

    Args:
        A: The matrices.
        size: Diagonal of what each was before anything was subtracted (..., K).
    """
    with suppress(np.linalg.LinAlgError):
        return np.asarray(np.linalg.cholesky(A))
    least = A.shape[-1] * np.finfo(float).eps
    size = np.maximum(size, np.finfo(float).tiny)[..., None] * np.eye(A.shape[-1])
    for more in least * 10.0 ** np.arange(-np.log10(least)):
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(A + more * size))
    raise np.linalg.LinAlgError("a matrix that is not positive by far more than rounding")


def solved(A: Array, right: Array) -> Array:
    """A^-1 times what stands on the right (K, ...), A symmetric, also where rounding spoilt it."""
    try:
        return np.asarray(np.linalg.solve(A, right))
    except np.linalg.LinAlgError:
        return np.asarray(cho_solve((cholesky(A, np.diag(A)), True), right))


def flat_prior(linear: Linear, count: int) -> Array:
    """Precision (count,) of a prior so wide that it only keeps the algebra regular."""
    size = float(np.diag(linear.G)[:count].max(initial=0.0))
    return np.full(count, max(1e-12 * size, FLATTEST))


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis (n, r) of what columns (n, p) span, whatever their units.

    One after the other, that which is farthest from those before it: of many columns that repeat
    each other singular values may not be found.
    """
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, upper, _ = qr(unit, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(upper))
    return np.asarray(basis[:, : len(sizes)][:, sizes > 1e-10 * sizes.max(initial=0.0)])
