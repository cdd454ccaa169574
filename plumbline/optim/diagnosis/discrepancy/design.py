r"""The columns of what may be at work, dense, row by row, and the linear problem that they make."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import Self

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.constants import CHUNK_NUMBERS
from plumbline.optim.core.problem import Array
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import JITTER
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence
from plumbline.optim.diagnosis.linearise import linear
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.agreement import agreement
from plumbline.optim.diagnosis.posterior.correlation import Left
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, Term, block_evidence
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.measurement.correlated import Whitening


@dataclass(frozen=True, eq=False)
class FamilyDesign:
    """Columns of the library about the fit, nuisances projected out of whatever is added.

    Attributes:
        base: Columns of nuisances and candidates (P, E), in units of the noise's spread.
        target: What they are to explain (E,).
        spread: Relative noise of every component (m,).
        shared: What no row carries, of the same columns.
        always: How many columns are nuisances.
        live: Which residuals there are (N, m); E of them.
        plain: The columns before rows that know of each other were told apart (P, N, m).
        measured: The target before (N, m).
        white: How that is done.
        gone: How many residuals count no more, since a row's own displacement takes them.
    """

    base: Array
    target: Array
    spread: Array
    shared: linear.Linear
    always: int
    live: NDArray[np.bool_]
    plain: Array
    measured: Array
    white: Whitening
    gone: float = 0.0

    @classmethod
    def of(
        cls, ports: Ports, spread: Array, shared: linear.Linear, pool: Pool, rows: NDArray[np.intp]
    ) -> Self:
        """About a fit, on some of a recording's rows."""
        divided = ports.divided(spread)
        white = Whitening.of(pool.model.recording.select(rows), ports.gross)
        base, target = white(divided.base), white(divided.target[None])
        return cls(
            _kept(base, ports.live),
            _kept(target, ports.live)[0],
            spread,
            shared,
            pool.always,
            ports.live,
            divided.base,
            divided.target,
            white,
        )

    def beyond(self, moved: Array) -> Self:
        """What no displacement along given directions (k, N, m), a row's own of any size, moves."""
        unit, sizes, _ = np.linalg.svd(np.moveaxis(moved / self.spread, 0, 2), full_matrices=False)
        there = sizes > 1e-10 * sizes.max(initial=np.finfo(float).tiny)  # as of rounding
        basis = unit * there[:, None, :]

        def rest(block: Array) -> Array:
            held = np.einsum("nmr,pnm->pnr", basis, block)
            return np.asarray(block - np.einsum("nmr,pnr->pnm", basis, held))

        plain, target = rest(self.plain), rest(self.measured[None])[0]
        base, seen = self.white(plain), self.white(target[None])
        return replace(
            self,
            base=_kept(base, self.live),
            target=_kept(seen, self.live)[0],
            plain=plain,
            measured=target,
            gone=self.gone + float(self.white.root**2 @ there.sum(axis=1)),
        )

    def _flat(self, block: Array) -> Array:
        """Columns (k, N, m) as (k, E), in units of the noise's spread."""
        return _kept(self.white(block / self.spread), self.live)

    @cached_property
    def _nuisances(self) -> Array:
        """An orthonormal basis (E, r) of what the nuisances span."""
        return linear.orthonormal(self.base[: self.always].T)

    def _seen(self, block: Array) -> Array:
        """Columns (k, E) of a block (k, N, m) without what the nuisances take up."""
        flat = self._flat(block)
        return np.asarray(flat - (flat @ self._nuisances) @ self._nuisances.T)

    def visible(self, block: Array) -> float:
        """Root of the squares of columns (k, N, m) that the nuisances leave."""
        return float(np.linalg.norm(self._seen(block)))

    def without(self, own: Array, ones: Array) -> Callable[[Array], Array]:
        """Takes from columns (k, N, m) each sum of them that is, with own ones (p, N, m), a column.

        Any of some (s, N, m), up to what nuisances take up.
        """
        beside, others = linear.orthonormal(self._seen(own).T), self._seen(ones)
        least = prior.SAME_FORM * np.linalg.norm(others, axis=1)

        def rest(columns: Array) -> Array:
            return np.asarray(columns - (columns @ beside) @ beside.T)

        others = rest(others)

        def less(block: Array) -> Array:
            for _ in range(len(block)):
                seen = rest(self._seen(block))
                w = np.linalg.lstsq(seen @ seen.T, seen @ others.T, rcond=1e-10)[0].T
                alike = w @ seen
                is_one = np.linalg.norm(others - alike, axis=1) <= least
                is_one &= np.linalg.norm(alike, axis=1) > least
                if not is_one.any():
                    break
                first = w[np.argmax(is_one)]
                block = block - np.tensordot(np.outer(first, first) / (first @ first), block, 1)
            return block

        return less

    def columns(self, more: Sequence[Array]) -> Array:
        """Its own columns and blocks (k, N, m) of more behind them (P, E)."""
        added = [self._flat(block) for block in more]
        return np.concatenate([self.base, *added])

    def left(
        self,
        more: Sequence[Array],
        terms: Sequence[Term],
        state: Sequence[SelectedTerm],
        variance: float,
    ) -> Left:
        """What a state leaves of the rows and takes up of them, at the noise of one of them."""
        own, precision = stack(terms, state, variance)
        columns = np.concatenate([np.arange(self.always), own + self.always]).astype(np.intp)
        A = self.columns(more)[columns]
        G = A @ A.T
        flat = np.full(self.always, JITTER * max(float(np.diag(G).max(initial=0.0)), 1e-300))
        z = linear.solved(G + np.diag(np.concatenate([flat, precision])), A @ self.target)
        plain = np.concatenate([self.plain, *(block / self.spread for block in more)])[columns]
        rows = np.asarray(self.measured - np.einsum("pnm,p->nm", plain, z))
        free = plain[: self.always].reshape(self.always, rows.size)
        free = linear.orthonormal(free.T).T if len(free) else free
        taken = np.concatenate([free.reshape(-1, *rows.shape), plain[self.always :]])
        flat = np.zeros(len(free))
        ended = np.concatenate([flat, z[self.always :]])
        return Left(rows, taken, np.concatenate([flat, precision]), ended)

    def agreement(
        self,
        more: Sequence[Array],
        terms: Sequence[Term],
        blocks: NDArray[np.intp],
        state: Sequence[SelectedTerm],
        variance: float,
    ) -> float:
        """How far blocks (N,) of rows agree about a state, see :func:`agreement`; 1 if wholly."""
        own, _ = stack(terms, state, variance)
        columns = np.concatenate([np.arange(self.always), own + self.always]).astype(np.intp)
        left = self.left(more, terms, state, variance).rows
        A = self.columns(more)[columns].reshape(len(columns), *left.shape)
        return agreement(A, self.white(left[None])[0], blocks, float(self.live.sum()))

    def with_more(self, more: Sequence[Array]) -> tuple[linear.Linear, list[linear.Columns]]:
        """The linear problem without nuisances, with blocks (k, N, m) of columns behind its own."""
        A = self.columns(more)
        G, b = A @ A.T, A @ self.target
        P = len(self.base)
        G[:P, :P] += self.shared.G
        b[:P] += self.shared.b
        tt = float(self.target @ self.target) + self.shared.tt
        count = self.white.count(self.live) - self.gone + self.shared.n
        whole = linear.Linear(G, b, tt, count)
        sizes = np.cumsum([P, *(len(block) for block in more)])
        columns = [np.arange(a, z) - self.always for a, z in pairwise(sizes.tolist())]
        kept = np.arange(self.always, len(A))
        if self.always:
            whole = whole.without(np.arange(self.always), linear.flat_prior(whole, self.always))
        return whole.only(kept), columns

    def with_listed(self, more: Sequence[Array]) -> tuple[Self, list[linear.Columns]]:
        """With blocks (k, N, m) of the library's columns behind its own, and which these are."""
        base = self.columns(more)
        sizes = np.cumsum([len(self.base), *(len(block) for block in more)])
        own, shared = len(base) - len(self.base), self.shared
        G, b = np.pad(shared.G, (0, own)), np.pad(shared.b, (0, own))
        plain = np.concatenate([self.plain, *(block / self.spread for block in more)])
        wide = replace(self, base=base, plain=plain, shared=replace(shared, G=G, b=b))
        return wide, [np.arange(a, z) - self.always for a, z in pairwise(sizes.tolist())]

    def worth_trying(
        self,
        found: Sequence[Dependence],
        shares: Array,
        pool: Pool,
        chosen: Sequence[SelectedTerm],
        gross: Array,
    ) -> NDArray[np.intp]:
        """Families that do best conditional on the chosen causes, on none, or on all but one.

        Each with the shifts of single rows that may be gross (R, m, N, m), and without them.
        """
        log = self._conditional(found, pool, looks(pool, chosen), gross) + shares
        best = np.max(log - np.logaddexp.reduce(log, axis=1, keepdims=True), axis=0)
        return np.sort(np.argsort(-best, kind="stable")[: prior.MOST_FAMILIES])

    def most(
        self, found: Sequence[Dependence], shares: Array, pool: Pool, state: Sequence[SelectedTerm]
    ) -> float:
        """Log evidence of all families together given a state, weighed by their shares."""
        return float(np.logaddexp.reduce(self._conditional(found, pool, [state])[0] + shares))

    def _conditional(
        self,
        found: Sequence[Dependence],
        pool: Pool,
        states: Sequence[Sequence[SelectedTerm]],
        gross: Array | None = None,
    ) -> Array:
        """Log evidence (S, F) of every family given each state, then each with gross rows too."""
        given, own = [], [self.base[:0]]
        if gross is not None and len(gross):
            own.append(self._flat(gross.reshape(-1, *self.live.shape)))
        for state, rows in product(states, own):
            basis = linear.orthonormal(np.concatenate([self.base[pool.columns(state)], rows]).T)
            left = self.target - basis @ (basis.T @ self.target)
            given.append((basis, left, self.white.count(self.live) - float(basis.shape[1])))

        def evidence(part: Sequence[int]) -> list[Array]:
            C = np.stack([self._flat(found[i].columns) for i in part])
            squares = C @ C.transpose(0, 2, 1)
            return [_evidence(C, squares, *look, pool.noise) for look in given]

        parts, log = list(self._alike(found)), np.empty((len(given), len(found)))
        for part, each in zip(parts, side_by_side(evidence, parts), strict=True):
            log[:, part] = each
        return log

    def _alike(self, found: Sequence[Dependence]) -> Iterator[list[int]]:
        """Numbers of families of as many columns, as many at a time as memory is meant for."""
        sizes = np.array([len(f.columns) for f in found])
        for k in np.unique(sizes).tolist():
            members, count = (
                np.flatnonzero(sizes == k),
                max(CHUNK_NUMBERS // (k * self.live.size), 1),
            )
            yield from (members[i : i + count].tolist() for i in range(0, len(members), count))


def _kept(block: Array, live: NDArray[np.bool_]) -> Array:
    """Columns (k, N, m) as (k, E), those residuals that there are."""
    return block.reshape(len(block), -1) if live.all() else block[:, live]


def _evidence(
    C: Array, squares: Array, basis: Array, left: Array, n: float, noise: NoisePrior
) -> Array:
    """Log evidence (F,) of families (F, k, E), of such Gram blocks, given a basis (E, r)."""
    seen = (C.reshape(-1, C.shape[2]) @ basis).reshape(*C.shape[:2], -1)
    blocks = squares - seen @ seen.transpose(0, 2, 1)
    by_scale = block_evidence(blocks, C @ left, float(left @ left), n, noise)
    return np.asarray(np.logaddexp.reduce(by_scale + prior.LOG_SCALE_WEIGHTS, axis=1))


def looks(pool: Pool, chosen: Sequence[SelectedTerm]) -> list[list[SelectedTerm]]:
    """States given which families are tried: the causes, none, and all causes but one."""
    keys = dict.fromkeys(pool.candidates[c.index].key for c in chosen)
    found = [list(chosen), []]
    if 1 < len(keys) <= prior.MANY_CAUSES:
        found += [[c for c in chosen if pool.candidates[c.index].key != key] for key in keys]
    return found
