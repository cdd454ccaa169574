r"""What a set of terms leaves of a linear problem, ready to be scanned.

Taking one term back is an update of low rank: with :math:`A = G_{BB} + \Lambda`,
:math:`H = G_{\cdot B} A^{-1}` and the Schur complement :math:`S_e = ((A^{-1})_{ee})^{-1}`,

.. math:: G'_{B \setminus e} = G'_B + H_e S_e H_e^T

(Henderson and Searle 1981, SIAM Review 23(1), eq. 8), so that asking all slots of a model again
costs one factorisation in all.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, cholesky
from plumbline.optim.diagnosis.posterior.evidence import Batch, Term


@dataclass(frozen=True)
class SelectedTerm:
    """One candidate that is in the model, at the scale of its prior."""

    index: int
    scale: float


def stack(
    candidates: Sequence[Term], chosen: Sequence[SelectedTerm], variance: float
) -> tuple[Columns, Array]:
    """Columns (K,) of the terms and their prior precisions (K,) in units of 1 / noise^2."""
    columns = [candidates[c.index].columns for c in chosen]
    precision = [np.full(len(candidates[c.index].columns), variance / c.scale**2) for c in chosen]
    if not columns:
        return np.empty(0, dtype=np.intp), np.empty(0)
    return np.concatenate(columns), np.concatenate(precision)


@dataclass(frozen=True, eq=False)
class Reduced:
    r"""A linear problem given some terms."""

    linear: Linear  # the whole problem
    gathered: Sequence[Batch]  # its candidates in batches
    candidates: Sequence[Term]  # the same one by one
    chosen: tuple[SelectedTerm, ...]  # the terms
    variance: float  # of the noise that weighs their priors
    precision: Array  # prior precisions of the terms' columns (K,)
    lower: Array | None  # the Cholesky factor L (K, K), or none after an update
    root: Array  # :math:`G_{\cdot B} L^{-T}` (P, K)
    blocks: tuple[Array, ...]  # the batches' Gram blocks, given the terms
    b: Array  # correlation with the target (P,), given the terms
    tt: float  # square of the target, given the terms
    n: float  # equations left

    @classmethod
    def given(
        cls,
        linear: Linear,
        gathered: Sequence[Batch],
        candidates: Sequence[Term],
        chosen: Sequence[SelectedTerm],
        variance: float,
    ) -> Reduced:
        """Given these terms, none or more, at this noise variance."""
        columns, precision = stack(candidates, chosen, variance)
        lower, root, hidden, tt, n = linear.given(columns, precision)
        blocks, b = tuple(batch.blocks for batch in gathered), linear.b - root @ hidden
        terms = tuple(chosen)
        nothing = cls(
            linear, gathered, candidates, terms, variance, precision, lower, root, blocks, b, tt, n
        )
        return replace(nothing, blocks=nothing._moved(root, -1.0))

    def without(self, term: SelectedTerm) -> Reduced:
        """Given all terms but one, by an update of low rank; to be scanned, not to be added to."""
        part, (_, H, _) = self._part(term), self._solved
        block, change, tt, n = self.of(term)
        schur = block + np.diag(self.precision[part])
        seen = H[:, part] @ cholesky(schur, np.diag(schur))
        rest = tuple(c for c in self.chosen if c.index != term.index)
        blocks, b = self._moved(seen, 1.0), self.b + H[:, part] @ change
        return replace(self, chosen=rest, lower=None, blocks=blocks, b=b, tt=tt, n=n)

    def of(self, term: SelectedTerm) -> tuple[Array, Array, float, float]:
        """What all terms but one leave of this one's own columns: its block (k, k), b, tt and n."""
        part, (inverse, _, z) = self._part(term), self._solved
        schur = np.linalg.inv(inverse[part, part])
        share = np.sum((inverse[:, part] @ schur) * inverse[:, part], axis=1)
        change, own = schur @ z[part], self.precision[part]
        block = (schur + schur.T) / 2 - np.diag(own)
        used = len(own) - float(self.precision @ share)
        return block, change, self.tt + float(z[part] @ change), self.n + used

    def _part(self, term: SelectedTerm) -> slice:
        """Where a term's columns are among those of all terms."""
        sizes = {c.index: len(self.candidates[c.index].columns) for c in self.chosen}
        first = sum(sizes[i] for i in itertools.takewhile(lambda i: i != term.index, sizes))
        return slice(first, first + sizes[term.index])

    @cached_property
    def _solved(self) -> tuple[Array, Array, Array]:
        """:math:`A^{-1}`, H and :math:`z = A^{-1} b_B`."""
        assert self.lower is not None
        columns, _ = stack(self.candidates, self.chosen, self.variance)
        unit = np.linalg.inv(self.lower)
        return unit.T @ unit, self.root @ unit, unit.T @ (unit @ self.linear.b[columns])

    def _moved(self, root: Array, sign: float) -> tuple[Array, ...]:
        """The blocks with what a root (P, K) spans added, or taken away."""
        seen = [root[batch.columns] for batch in self.gathered]
        pairs = zip(self.blocks, seen, strict=True)
        return tuple(block + sign * (own @ own.transpose(0, 2, 1)) for block, own in pairs)
