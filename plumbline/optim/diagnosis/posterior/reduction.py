r"""What a set of terms leaves of a linear problem, ready to be scanned.

Adding one term is an update of low rank, and so is taking one back: with
:math:`A = G_{BB} + \Lambda`, :math:`H = G_{\cdot B} A^{-1}` and the Schur complement
:math:`S_e = ((A^{-1})_{ee})^{-1}`,

.. math:: G'_{B \setminus e} = G'_B + H_e S_e H_e^T

(Henderson and Searle 1981, SIAM Review 23(1), eq. 8), so that asking all slots of a model again
costs one factorisation in all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import JITTER, Columns, Linear, cholesky
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
    chosen: tuple[SelectedTerm, ...]  # the terms
    columns: Columns  # columns of the terms (K,)
    starts: dict[int, slice]  # where each term's columns are among these, by index of the term
    precision: Array  # prior precisions of the terms' columns (K,)
    root: Array  # :math:`G_{\cdot B} L^{-T}` (P, K)
    lower: Array | None  # L (K, K), or none after an update
    blocks: tuple[Array, ...]  # the batches' Gram blocks, given the terms
    b: Array  # correlation with the target (P,), given the terms
    tt: float  # square of the target, given the terms
    n: float  # equations left

    @classmethod
    def nothing(cls, linear: Linear, gathered: Sequence[Batch]) -> Reduced:
        """Given no term at all."""
        blocks = tuple(batch.blocks for batch in gathered)
        root, none = np.zeros((len(linear.b), 0)), np.zeros(0)
        return cls(
            linear,
            gathered,
            (),
            np.empty(0, np.intp),
            {},
            none,
            root,
            None,
            blocks,
            linear.b,
            linear.tt,
            linear.n,
        )

    @classmethod
    def given(
        cls,
        linear: Linear,
        gathered: Sequence[Batch],
        candidates: Sequence[Term],
        chosen: Sequence[SelectedTerm],
        variance: float,
    ) -> Reduced:
        """Given these terms at this noise variance."""
        columns, precision = stack(candidates, chosen, variance)
        left = linear.given(columns, precision)
        blocks = []
        for batch in gathered:
            seen = left.root[batch.columns]
            blocks.append(batch.blocks - seen @ seen.transpose(0, 2, 1))
        starts: dict[int, slice] = {}
        first = 0
        for term in chosen:
            last = first + len(candidates[term.index].columns)
            starts[term.index] = slice(first, last)
            first = last
        b = linear.b - left.root @ left.hidden
        return cls(
            linear,
            gathered,
            tuple(chosen),
            columns,
            starts,
            precision,
            left.root,
            left.lower,
            tuple(blocks),
            b,
            left.tt,
            left.n,
        )

    def plus(self, term: SelectedTerm, candidates: Sequence[Term], variance: float) -> Reduced:
        """Given one term more."""
        columns, precision = stack(candidates, [term], variance)
        cross = self.linear.G[:, columns] - self.root @ self.root[columns].T
        own = cross[columns]
        size = np.diag(self.linear.G)[columns]
        lower = cholesky(own + np.diag(precision + JITTER * np.abs(np.diag(own))), size)
        inverse = np.linalg.inv(lower)
        more = cross @ inverse.T
        hidden = inverse @ self.b[columns]
        used = len(columns) - float(np.sum(precision * np.sum(inverse**2, axis=0)))
        # The terms already chosen give up some of what they used: cross is Lambda A^-1 G_Be there.
        used -= float(np.sum(more[self.columns] ** 2 / self.precision[:, None]))
        first = self.root.shape[1]
        return replace(
            self,
            chosen=(*self.chosen, term),
            columns=np.concatenate([self.columns, columns]),
            starts={**self.starts, term.index: slice(first, first + len(columns))},
            precision=np.concatenate([self.precision, precision]),
            root=np.hstack([self.root, more]),
            lower=None,
            blocks=self._moved(more, -1.0),
            b=self.b - more @ hidden,
            tt=max(self.tt - float(hidden @ hidden), 0.0),
            n=self.n - used,
        )

    def overlap(self, a: Columns, b: Columns) -> float:
        """Largest squared correlation of columns a with columns b, given the terms."""
        G = self.linear.G
        cross = G[np.ix_(a, b)] - self.root[a] @ self.root[b].T
        one = G[a, a] - np.sum(self.root[a] ** 2, axis=1)
        two = G[b, b] - np.sum(self.root[b] ** 2, axis=1)
        return float(np.max(cross**2 / np.maximum(np.outer(one, two), 1e-300)))

    def without(self, term: SelectedTerm) -> Reduced:
        """Given all terms but one; to be scanned, not to be updated further."""
        if self.lower is None:
            raise ValueError("a term can be taken back only from a fresh reduction")
        part = self.starts[term.index]
        inverse, H, z = self._solved
        own = inverse[part, part]
        schur = np.linalg.inv(own)
        given = H[:, part] @ cholesky((schur + schur.T) / 2, np.diag(schur))
        change = schur @ z[part]
        share = np.sum((inverse[:, part] @ schur) * inverse[:, part], axis=1)
        used = own.shape[0] - float(self.precision @ share)
        return replace(
            self,
            chosen=tuple(c for c in self.chosen if c.index != term.index),
            lower=None,
            blocks=self._moved(given, 1.0),
            b=self.b + H[:, part] @ change,
            tt=self.tt + float(z[part] @ change),
            n=self.n + used,
        )

    def of(self, term: SelectedTerm) -> tuple[Array, Array, float, float]:
        """What all terms but one leave of this one's own columns: its block (k, k), b, tt and n.

        The Schur complement that :meth:`without` takes back is the block with its prior.
        """
        part = self.starts[term.index]
        inverse, _, z = self._solved
        schur = np.linalg.inv(inverse[part, part])
        share = np.sum((inverse[:, part] @ schur) * inverse[:, part], axis=1)
        change, own = schur @ z[part], self.precision[part]
        used = len(own) - float(self.precision @ share)
        block = (schur + schur.T) / 2 - np.diag(own)
        return block, change, self.tt + float(z[part] @ change), self.n + used

    @cached_property
    def _solved(self) -> tuple[Array, Array, Array]:
        """:math:`A^{-1}`, H and :math:`z = A^{-1} b_B`."""
        assert self.lower is not None
        unit = np.linalg.inv(self.lower)
        return unit.T @ unit, self.root @ unit, unit.T @ (unit @ self.linear.b[self.columns])

    def _moved(self, root: Array, sign: float) -> tuple[Array, ...]:
        blocks = []
        for batch, block in zip(self.gathered, self.blocks, strict=True):
            seen = root[batch.columns]
            blocks.append(block + sign * (seen @ seen.transpose(0, 2, 1)))
        return tuple(blocks)
