r"""Families of functions against the causes of a model, by evidence, in products worked out once.

For every set S of causes and every family f the log weight is that of the model with f in the place
of S, against the model itself; see :mod:`plumbline.optim.diagnosis.discrepancy.outside` for what is
made of them. With :math:`A = G_{BB} + \Lambda = L L^T` of the columns B that are kept, a family's
block given them is :math:`G_{ff} - (L^{-1} G_{Bf})^T L^{-1} G_{Bf}`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.dependences import Dependence
from plumbline.optim.diagnosis.linearise.linear import FLATTEST, cholesky
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, block_evidence
from plumbline.optim.diagnosis.prior import (
    ALL_SETS,
    CAUSES_WIDTH,
    EACH_LEFT_OUT,
    FAMILY_ODDS,
    LOG_SCALE_WEIGHTS,
    WORTH_TRYING,
)


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """A model's columns and the families that compete with them, as products once worked out.

    Attributes:
        G: Gram matrix of the model's columns (P, P).
        b: Their correlation with the target (P,).
        tt: Square of the target.
        n: Number of equations.
        precision: Flat priors for the nuisances, wide ones for the effects (P,).
        groups: Families of equally many columns: which, their blocks (C, k, k), their products
            with the model's columns (P, C, k) and with the target (C, k).
        log_prior: Log odds of each family (F,).
        noise: The prior of the noise.
        log_likelihood: Of the model, noise integrated out, up to what all kinds of noise share.
        floor: The least of the precisions, which keeps the products solvable.
    """

    G: Array
    b: Array
    tt: float
    n: float
    precision: Array
    groups: tuple[tuple[NDArray[np.intp], Array, Array, Array], ...]
    log_prior: Array
    noise: NoisePrior
    log_likelihood: float
    floor: float

    @classmethod
    def of(
        cls,
        ports: Ports,
        found: Sequence[Dependence],
        noise: NoisePrior,
        spread: Array | None = None,
    ) -> ModelComparison:
        """From a model's columns; those that are not always fitted are effects.

        Args:
            ports: The model's columns and target, divided by ``spread`` already.
            found: The families.
            noise: The prior of the noise.
            spread: Relative noise of every component of a reading (m,); alike if not given.
        """
        spread = np.ones(ports.target.shape[1]) if spread is None else spread
        A, t = ports.base.reshape(len(ports.base), ports.target.size), ports.target.ravel()
        G, b, tt, n = A @ A.T, A @ t, float(t @ t), float(t.size)
        floor = max(1e-11 * float(np.diag(G).max(initial=0.0)), FLATTEST)
        precision = np.full(len(A), floor)
        left = tt - float(b @ np.linalg.solve(G + np.diag(precision), b)) if len(A) else tt
        precision[ports.always :] = max(
            float(noise.variance(max(left, 0.0), n)) / CAUSES_WIDTH**2, floor
        )
        groups = []
        sizes = np.array([len(f.columns) for f in found])
        for k in np.unique(sizes):
            members = np.flatnonzero(sizes == k)
            C = np.stack([(found[int(i)].columns / spread).reshape(k, -1) for i in members])
            cross = np.einsum("pe,cke->pck", A, C, optimize=True)
            groups.append((members, C @ C.transpose(0, 2, 1), cross, C @ t))
        shares = np.array([f.log_prior for f in found])
        log_prior = np.log(FAMILY_ODDS) + shares - logsumexp(shares)
        variance = float(noise.variance(max(left, 0.0), n))
        likely = -0.5 * (noise.freedom + n) * np.log(variance)
        likely -= len(ports.target) * float(np.log(spread).sum())
        likely -= 0.5 * float((spread != 1.0).sum()) * np.log(len(ports.target))  # Schwarz (1978)
        return cls(G, b, tt, n, precision, tuple(groups), log_prior, noise, float(likely), floor)

    def weights(
        self, causes: Sequence[NDArray[np.intp]], log_priors: Array
    ) -> tuple[list[tuple[int, ...]], Array]:
        """Sets of causes that give up their place, and log weights (S, F) of every family there.

        Of few causes all sets are tried, of more each alone, all, and all but one, of many each
        alone. Where not all families are tried, they are those that do well in the first sets.
        """
        numbers = range(len(causes))
        few, many = len(causes) <= ALL_SETS, len(causes) > EACH_LEFT_OUT
        alone = [(i,) for i in numbers]
        whole = [] if many else [tuple(numbers)]
        thorough = list(dict.fromkeys([(), *whole, *(alone if few else [])]))
        sizes: Sequence[int] = (
            range(1, len(causes)) if few else (1,) if many else (1, len(causes) - 1)
        )
        sets = [c for size in sizes for c in combinations(numbers, size)]
        rest = [gone for gone in sets if gone not in thorough]
        found = [self._in_place_of(gone, causes, log_priors) for gone in thorough]
        count = len(found[0])
        good = {int(i) for w in found for i in np.argsort(-w)[:WORTH_TRYING]}
        narrow = self.only(np.array(sorted(good), dtype=np.intp))
        found += [narrow._in_place_of(gone, causes, log_priors, count) for gone in rest]
        return [*thorough, *rest], np.stack(found)

    def only(self, kept: NDArray[np.intp]) -> ModelComparison:
        """The same comparison among fewer families; each keeps its number and its odds."""
        groups = []
        for members, blocks, cross, products in self.groups:
            mine = np.flatnonzero(np.isin(members, kept))
            if len(mine):
                groups.append((members[mine], blocks[mine], cross[:, mine], products[mine]))
        return replace(self, groups=tuple(groups))

    def _in_place_of(
        self,
        gone: tuple[int, ...],
        causes: Sequence[NDArray[np.intp]],
        log_priors: Array,
        count: int | None = None,
    ) -> Array:
        """Log weights (F,) of every family in place of some causes, against the whole model."""
        kept = np.ones(len(self.b), dtype=bool)
        for i in gone:
            kept[causes[i]] = False
        against = 0.0
        conditional = _Conditional.of(self, kept)
        found = conditional.families(count) + self.log_prior
        for i in gone:
            against += conditional.cause(causes[i]) + log_priors[i]
            kept = kept.copy()
            kept[causes[i]] = True
            conditional = _Conditional.of(self, kept)
        return found - against


@dataclass(frozen=True, eq=False)
class _Conditional:
    """What is left of a comparison given some of the model's columns."""

    comparison: ModelComparison
    kept: NDArray[np.bool_]
    lower: Array
    hidden: Array
    tt: float
    n: float

    @classmethod
    def of(cls, comparison: ModelComparison, kept: NDArray[np.bool_]) -> _Conditional:
        A, precision = comparison.G[np.ix_(kept, kept)], comparison.precision[kept]
        lower = cholesky(A + np.diag(precision), np.diag(A))
        hidden = _solved(lower, comparison.b[kept])
        inverse = _solved(lower, np.eye(len(A)))
        used = len(A) - float(np.sum(precision * np.sum(inverse**2, axis=0)))
        # What the flat priors hold back for the sake of the algebra is no residual.
        z = solve_triangular(lower, hidden, lower=True, trans="T") if len(A) else hidden
        held = comparison.floor * float(z @ z)
        tt = max(comparison.tt - float(hidden @ hidden) - held, 0.0)
        return cls(comparison, kept, lower, hidden, tt, comparison.n - used)

    def _evidence(self, blocks: Array, cross: Array, products: Array) -> Array:
        """Log evidence (C,) of blocks (C, k, k) with products (P, C, k) and (C, k)."""
        P, C, k = cross.shape
        seen = _solved(self.lower, cross.reshape(P, C * k)[self.kept]).reshape(
            len(self.hidden), C, k
        )
        block = blocks - np.einsum("pci,pcj->cij", seen, seen, optimize=True)
        b = products - np.einsum("pci,p->ci", seen, self.hidden)
        by_scale = block_evidence(block, b, self.tt, self.n, self.comparison.noise)
        return np.asarray(logsumexp(by_scale + LOG_SCALE_WEIGHTS, axis=1))

    def families(self, count: int | None = None) -> Array:
        """Log evidence (F,) of every family; none for those that are not tried."""
        groups = self.comparison.groups
        out = np.full(count or sum(len(g[0]) for g in groups), -np.inf)
        for members, blocks, cross, products in groups:
            out[members] = self._evidence(blocks, cross, products)
        return out

    def cause(self, columns: NDArray[np.intp]) -> float:
        """Log evidence of one cause of the model given what is kept."""
        comparison = self.comparison
        block = comparison.G[np.ix_(columns, columns)][None]
        cross = comparison.G[:, None, columns]
        return float(self._evidence(block, cross, comparison.b[columns][None])[0])


def _solved(lower: Array, values: Array) -> Array:
    """What a triangular factor (K, K) makes of columns (K, ...); of none, none."""
    if not len(lower):
        return values
    return np.asarray(solve_triangular(lower, values, lower=True))
