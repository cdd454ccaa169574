r"""What a set of terms leaves of a linear problem, ready to be scanned.

Taking one term back is an update of low rank: with
:math:`A = G_{BB} + \Lambda`, :math:`H = G_{\cdot B} A^{-1}` and the Schur complement
:math:`S_e = ((A^{-1})_{ee})^{-1}`,

.. math:: G'_{B \setminus e} = G'_B + H_e S_e H_e^T

(Henderson and Searle 1981, SIAM Review 23(1), eq. 8), so that asking all slots of a model again
costs one factorisation in all. A term more is a factorisation of its own: of terms that do nearly
the same, errors of one update after the other grow without bound.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, cholesky
from plumbline.optim.diagnosis.posterior.evidence import Gathered, Term


@dataclass(frozen=True)
class SelectedTerm:
    """One candidate that is in the model, at the scale of its prior."""

    index: int
    scale: float


def stack(
    candidates: Sequence[Term], chosen: Sequence[SelectedTerm], variance: float
) -> tuple[Columns, Array]:
    """Columns (K,) of the terms and their prior precisions (K,) in units of 1 / noise^2."""
    if not chosen:
        return np.empty(0, dtype=np.intp), np.empty(0)
    columns = [candidates[c.index].columns for c in chosen]
    each = np.array([variance / c.scale**2 for c in chosen])
    return np.concatenate(columns), np.repeat(each, [len(own) for own in columns])


@dataclass(frozen=True, eq=False)
class Reduced:
    r"""A linear problem given some terms."""

    linear: Linear  # the whole problem
    gathered: Gathered  # its candidates in batches
    candidates: Sequence[Term]  # the same one by one
    chosen: tuple[SelectedTerm, ...]  # the terms
    variance: float  # of the noise that weighs their priors
    precision: Array  # prior precisions of the terms' columns (K,)
    # :math:`A^{-1}` (K', K') before terms went, columns (K,) of it that stayed, and a root (K', k)
    # of what it lost with the others
    before: tuple[Array, Columns, Array]
    blocks: tuple[Array, ...]  # the batches' Gram blocks, given the terms
    b: Array  # correlation with the target (P,), given the terms; NaN of columns not asked
    tt: float  # square of the target, given the terms
    n: float  # equations left

    @classmethod
    def given(
        cls,
        linear: Linear,
        gathered: Gathered,
        candidates: Sequence[Term],
        chosen: Sequence[SelectedTerm],
        variance: float,
        own: Linear | None = None,
    ) -> Self:
        """Given these terms, none or more, at this noise variance, of whose columns is ``own``."""
        (columns, precision), asked = stack(candidates, chosen, variance), gathered.asked
        unit, root, hidden, tt, n = linear.given(columns, precision, asked, own)
        b = np.full(len(linear.b), np.nan)
        b[asked] = linear.b[asked] - root @ hidden
        blocks = _moved([batch.blocks for batch in gathered], gathered, root, -1.0)
        whole = unit.T @ unit, np.arange(len(columns)), np.empty((len(columns), 0))
        terms = tuple(chosen)
        return cls(
            linear, gathered, candidates, terms, variance, precision, whole, blocks, b, tt, n
        )

    @cached_property
    def inverse(self) -> Array:
        """:math:`A^{-1}` (K, K), worked out when it is asked for: of a slot it rarely is."""
        inverse, kept, gone = self.before
        if len(kept) == len(inverse):
            return inverse
        return np.asarray(inverse[np.ix_(kept, kept)] - gone[kept] @ gone[kept].T)

    def without(self, term: SelectedTerm) -> Self:
        """Given all terms but one, by an update of low rank."""
        part = self._parts[term.index]
        own = self.inverse[:, part]
        schur = np.linalg.inv(own[part])
        lower = cholesky((schur + schur.T) / 2, np.diag(schur))
        gone, rest = own @ lower, np.delete(np.arange(len(own)), part)
        sizes = (np.diag(self.inverse) - np.einsum("ij,ij->i", gone, gone))[rest]
        hidden, precision = gone.T @ self.linear.b[self._columns], self.precision[rest]
        root, b = self._beside.T @ gone, self.b.copy()
        b[self.gathered.asked] += root @ hidden
        return replace(
            self,
            chosen=tuple(c for c in self.chosen if c.index != term.index),
            precision=precision,
            before=(self.inverse, rest, gone),
            blocks=_moved(self.blocks, self.gathered, root, 1.0),
            b=b,
            tt=self.tt + float(hidden @ hidden),
            n=self.linear.n - (len(precision) - float(precision @ sizes)),
        )

    def of(self, term: SelectedTerm) -> tuple[Array, Array, float, float]:
        """What all terms but one leave of this one's own columns: its block (k, k), b, tt and n."""
        part = self._parts[term.index]
        schur, z = np.linalg.inv(self.inverse[part, part]), self._values[part]
        share = np.sum((self.inverse[:, part] @ schur) * self.inverse[:, part], axis=1)
        change, own = schur @ z, self.precision[part]
        block = (schur + schur.T) / 2 - np.diag(own)
        used = len(own) - float(self.precision @ share)
        return block, change, self.tt + float(z @ change), self.n + used

    def block(self, a: Columns, b: Columns) -> Array:
        """Gram block of some columns (k,) and others (m,), given the terms."""
        block, mine = self.linear.block, self._columns
        return np.asarray(block(a, b) - block(a, mine) @ self.inverse @ block(mine, b))

    @cached_property
    def _columns(self) -> Columns:
        """Columns of the terms (K,)."""
        return stack(self.candidates, self.chosen, self.variance)[0]

    @cached_property
    def _beside(self) -> Array:
        """Gram block of the terms and what is asked (K, R), gathered once for all of these."""
        return self.linear.block(self._columns, self.gathered.asked)

    @cached_property
    def _values(self) -> Array:
        """:math:`A^{-1} b_B` (K,)."""
        return np.asarray(self.inverse @ self.linear.b[self._columns])

    @cached_property
    def _parts(self) -> dict[int, slice]:
        """Where each term's columns are among those of all terms."""
        ends = np.cumsum([0, *(len(self.candidates[c.index].columns) for c in self.chosen)])
        spans = (slice(a, z) for a, z in itertools.pairwise(ends.tolist()))
        return dict(zip((c.index for c in self.chosen), spans, strict=True))


def _moved(
    blocks: Sequence[Array], gathered: Gathered, root: Array, sign: float
) -> tuple[Array, ...]:
    """Blocks of the batches with what a root (R, K) spans added, or taken away."""
    seen = [root[places] for places in gathered.places]
    pairs = zip(blocks, seen, strict=True)
    return tuple(block + sign * (own @ own.transpose(0, 2, 1)) for block, own in pairs)
