r"""How far blocks of rows agree: what share of their number rows are worth where a model is open.

At a fit the gradients :math:`g_b` of blocks sum to nought. Of independent rows their size is known:
with normal equations A, shares :math:`H_b = A^{-1} A_b` and noise :math:`\sigma^2`,

.. math:: \zeta = \min\left(1,\ \frac{\sigma^2 \sum_b (\mathrm{tr} H_b - \mathrm{tr} H_b^2)}
          {\sum_b g_b^T A^{-1} g_b}\right)

is the power of the likelihood whose posterior is as wide as estimates differ from block to block
(Lyddon, Holmes and Walker 2019, Biometrika 106(2); on such powers where a model is nearly right,
Miller and Dunson 2019, J. Am. Stat. Assoc. 114:527).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import JITTER, solved


def agreement(columns: Array, left: Array, blocks: NDArray[np.intp]) -> float:
    """The share: at most 1, and at least what one reading of each block would say.

    Where no direction is seen by more than one block, none can disagree, and the share is 1.

    Args:
        columns: What is fitted (K, N, m).
        left: What the fit leaves (N, m).
        blocks: Block of every row (N,).
    """
    size = np.sqrt(np.maximum(np.einsum("knm,knm->k", columns, columns), np.finfo(float).tiny))
    unit = columns / size[:, None, None]
    numbers = np.unique(blocks)
    parts = [unit[:, blocks == b].reshape(len(unit), -1) for b in numbers]
    grams = [part @ part.T for part in parts]
    A = sum(grams, start=np.zeros((len(unit), len(unit))))
    inverse = solved(A + JITTER * np.eye(len(A)), np.eye(len(A)))
    slopes = [p @ left[blocks == b].ravel() for p, b in zip(parts, numbers, strict=True)]
    found = sum(float(g @ inverse @ g) for g in slopes)
    shares = [inverse @ gram for gram in grams]
    freedom = sum(float(np.trace(H) - np.sum(H * H.T)) for H in shares)
    if freedom <= 10.0 * JITTER * len(unit):  # what the jitter itself leaves is one of these
        return 1.0
    sigma2 = float(np.sum(left**2)) / max(left.size - len(unit), 1)
    share = sigma2 * freedom / max(found, np.finfo(float).tiny)
    return float(np.clip(share, len(numbers) / left.size, 1.0))
