r"""How far blocks of rows agree: what share of their number rows are worth where a model is open.

At a fit the gradients :math:`g_b` of blocks sum to nought. Of independent rows their size is known:
with normal equations A, shares :math:`H_b = A^{-1} A_b` and noise :math:`\sigma^2`,

.. math:: \frac 1x = \frac{\sigma^2 \sum_b (\mathrm{tr} H_b - \mathrm{tr} H_b^2)}
          {\sum_b g_b^T A^{-1} g_b}

estimates the power :math:`\zeta` of the likelihood whose posterior is as wide as estimates differ
from block to block (Lyddon, Holmes and Walker 2019, Biometrika 106(2); on such powers where a model
is nearly right, Miller and Dunson 2019, J. Am. Stat. Assoc. 114:527). A few blocks differ by chance
too: x is about chi-square of as many degrees of freedom :math:`\nu` as its variance says, over
:math:`\nu \zeta` (Satterthwaite 1946, Biometrics Bull. 2(6)). Beforehand rows are independent as
probably as not, else every share is as probable, and the share is the mean of what the rows leave,

.. math:: \hat\zeta = \frac{L(1) + \int_0^1 \zeta L(\zeta) d\zeta}{L(1) + \int_0^1 L(\zeta)d\zeta},
          \qquad L(\zeta) = \zeta^{\nu/2} e^{-\nu x \zeta / 2} .
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaln

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import JITTER
from plumbline.optim.diagnosis.linearise.linear import solved


def agreement(
    columns: Array, left: Array, blocks: NDArray[np.intp], readings: float | None = None
) -> float:
    """The share: at most 1, and at least what one reading of each block would say.

    Where no direction is seen by more than one block, none can disagree, and the share is 1.

    Args:
        columns: What is fitted (K, N, m).
        left: What the fit leaves (N, m).
        blocks: Block of every row (N,).
        readings: How many residuals count; all of them if not given.
    """
    numbers = np.unique(blocks)
    seen = np.array([np.abs(columns[:, blocks == b]).max(axis=(1, 2)) > 0.0 for b in numbers])
    alone = seen.sum(axis=0) < 2  # a gross row's own: what its prior holds back is no disagreement
    own = np.linalg.qr(columns[alone].reshape(-1, left.size).T)[0]
    both = np.concatenate([columns[~alone], left[None]]).reshape(-1, left.size)
    *_, left = both = (both - both @ own @ own.T).reshape(-1, *left.shape)
    parts = [both[:-1, blocks == b].reshape(len(both) - 1, left[blocks == b].size) for b in numbers]
    slopes = [p @ left[blocks == b].ravel() for p, b in zip(parts, numbers, strict=True)]
    count = left.size if readings is None else readings
    sigma2 = float(np.sum(left**2)) / max(count - len(columns), 1)
    return share_of([part @ part.T for part in parts], slopes, sigma2, count)


def share_of(
    grams: Sequence[Array], slopes: Sequence[Array], sigma2: float, readings: float
) -> float:
    """The share from the blocks' sums.

    Args:
        grams: Gram matrix (K, K) of each block.
        slopes: Gradient (K,) of each block at the fit of all.
        sigma2: Variance that the fit leaves.
        readings: How many there are.
    """
    A = sum(grams, start=np.zeros_like(grams[0]))
    size = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    A, both = A / np.outer(size, size), np.outer(size, size)
    inverse = solved(A + JITTER * np.eye(len(A)), np.eye(len(A)))
    found = sum(float(g / size @ inverse @ (g / size)) for g in slopes)
    H = np.stack([inverse @ (gram / both) for gram in grams])
    squares = H @ H
    mean = float(np.einsum("bii->", H - squares))
    if mean <= 10.0 * JITTER * len(A):  # what the jitter itself leaves is one of these
        return 1.0
    total, free = squares.sum(axis=0), max(readings - len(A), 1.0)
    second = float(np.einsum("bii->", squares - 2.0 * H @ squares) + np.sum(total * total.T))
    # Less than of a known noise: what the fit leaves tells the noise as well.
    freedom = mean**2 * (free + 2.0) / max(free * second - mean**2, mean**2 / readings)
    x = found / max(sigma2 * mean, np.finfo(float).tiny)
    return float(np.clip(_expected(x, freedom), len(grams) / readings, 1.0))


def _expected(x: float, freedom: float) -> float:
    """The expected share where blocks are so far apart, of so many degrees of freedom."""
    c, a = max(0.5 * freedom * x, np.finfo(float).tiny), 0.5 * freedom + np.array([1.0, 2.0])
    with np.errstate(divide="ignore"):  # of next to nothing
        logs = np.append(-c, gammaln(a) + np.log(gammainc(a, c)) - a * np.log(c))
    one, every, mean = np.exp(logs - logs.max())
    return float((one + mean) / (one + every))
