"""The choice of rows: greedily, each in the light of those before it, from a pool within reach.

For each choice a few hundred rows of the pool are looked at, drawn anew; that comes as near to the
best rows as looking at all of them, but for a few per cent (Mirzasoleiman et al. 2015, AAAI 29,
theorem 1). The best of these is then changed in one joint, side or mass at a time for as long as
that makes it better (coordinate exchange, Meyer and Nachtsheim 1995, Technometrics 37(1)): few
random postures come near the corner of the joints' range where two explanations differ most.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.diagnosis.constants import EXCHANGES, GLANCE, MOST_RIVALS, POOL, ROWS
from plumbline.optim.diagnosis.design import future_rows
from plumbline.optim.diagnosis.design.course import Course
from plumbline.optim.diagnosis.design.explanations import Contest
from plumbline.optim.diagnosis.design.separation import Beliefs, Criterion, divergences, resolution
from plumbline.optim.diagnosis.prior import REST_PAYS


@dataclass(frozen=True)
class DesignOptions:
    """How the next rows are chosen."""

    count: int = ROWS  # how many rows
    seed: int = 0  # of the pool and of the forecast
    pool: int = POOL  # how many rows within reach are considered
    # ``"recorded"`` or ``"limits"``, see
    # :func:`plumbline.optim.diagnosis.design.future_rows.draw_rows`
    within: str = future_rows.RECORDED
    criterion: Criterion = resolution  # what makes a row good
    rivals: int = MOST_RIVALS  # how many explanations at the most
    patience: float = 1.0  # longest rest of all rows together, over the recording's length
    compare: bool = True  # whether rows at random are forecast as well
    glance: int = GLANCE  # how many rows of the pool are looked at for each choice
    # how often, at most, a row is changed in one thing to make it better
    exchanges: int = EXCHANGES
    # of several recordings the one whose device stands, for which rows are proposed; the first that
    # says where the tip is, if empty
    recording: str = ""

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if self.count < 1:
            raise PlumblineError(f"count {self.count}: give at least 1")
        if self.pool < self.count:
            raise PlumblineError(f"pool {self.pool}: give at least the {self.count} rows asked for")


@dataclass(frozen=True, eq=False)
class Chosen:
    """Rows that were chosen, and what is expected of them."""

    rows: future_rows.FutureRows  # the rows, in their order
    beliefs: Beliefs  # what is expected after them
    gram: Array  # their Gram matrix (P, P), in units of scale and noise
    # for each row, the two models that it does most to tell apart
    pairs: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Design:
    """What rows are chosen from, and for."""

    contest: Contest  # the explanations that compete
    pool: future_rows.FutureRows  # rows within reach
    options: DesignOptions  # how to choose

    @classmethod
    def of(cls, contest: Contest, options: DesignOptions) -> Self:
        """Draw the pool of a contest."""
        contest = contest.of(options.recording)
        recording = contest.model.recording
        pool = future_rows.draw_rows(
            recording, options.pool, options.seed, within=options.within, sockets=_sockets(contest)
        )
        return cls(contest, pool, options)

    @cached_property
    def _derivative(self) -> cs.Function:
        p = self.contest.model.problem
        jacobian = cs.densify(cs.jacobian(p.residual, p.x).T)
        return cs.Function("derivative", [p.x, p.row], [jacobian])

    def jacobians(self, rows: Array) -> Array:
        """Jacobians (N, m, P) of rows (N, k), in units of scale and noise."""
        found = over_rows(self._derivative, rows, self.contest.model.start)[0]
        return np.asarray(found * self.contest.weights)

    def choose(self) -> Chosen:
        """The best rows of the pool, the next always in the light of those before."""
        course, beliefs = Course(self.contest.model), Beliefs.of(self.contest.rivals)
        gram = np.zeros((len(self.contest.weights),) * 2)
        rng = np.random.default_rng([self.options.seed, 12])
        free = np.ones(len(self.pool), dtype=bool)
        pairs: list[tuple[int, int]] = []
        for _ in range(self.options.count):
            open_rows = np.flatnonzero(free & self._bearable(course))
            if not len(open_rows):
                break
            seen = np.sort(rng.permutation(open_rows)[: self.options.glance])
            J = self.jacobians(course.rows_next(self.pool.select(seen)))
            best = int(np.argmax(self.options.criterion(beliefs, J)))
            free[seen[best]] = False
            row, J_row = self._exchanged(course, beliefs, self.pool.select([seen[best]]), J[best])
            row, J_row = self._rested(course, beliefs, row, J_row)
            pairs.append(_pair(beliefs, J_row))
            beliefs = beliefs.after(J_row)
            gram = gram + J_row.T @ J_row
            course = course.then(row)
        return Chosen(
            self.pool.select(slice(0, 0)) if course.taken is None else course.taken,
            beliefs,
            gram,
            tuple(pairs),
        )

    def _exchanged(
        self, course: Course, beliefs: Beliefs, row: future_rows.FutureRows, J: Array
    ) -> tuple[future_rows.FutureRows, Array]:
        """A row and its Jacobian (m, P), changed in one thing after another while that pays."""
        recording, options = self.contest.model.recording, self.options
        for turn in range(options.exchanges):
            seed = [options.seed, 14, beliefs.gathered, turn]
            others = future_rows.changed_in_one(recording, row, seed, within=options.within)
            if not len(others):
                break
            tried = np.concatenate([J[None], self.jacobians(course.rows_next(others))])
            best = int(np.argmax(options.criterion(beliefs, tried)))
            if best == 0:
                break
            row, J = others.select([best - 1]), tried[best]
        return row, J

    def _rested(
        self, course: Course, beliefs: Beliefs, row: future_rows.FutureRows, J: Array
    ) -> tuple[future_rows.FutureRows, Array]:
        """A row and its Jacobian (m, P), without the rest before it if that adds little."""
        if row.wait is None or not row.wait.any():
            return row, J
        at_once = replace(row, wait=np.zeros(1))
        J_at_once = self.jacobians(course.rows_next(at_once))[0]
        tried = np.stack([np.zeros_like(J), J, J_at_once])
        nothing, rested, at_once_gain = self.options.criterion(beliefs, tried)
        pays = rested - nothing > REST_PAYS * (at_once_gain - nothing)
        return (row, J) if pays else (at_once, J_at_once)

    @property
    def _at_once(self) -> Flags:
        """Rows (N,) without a rest before them."""
        wait = self.pool.wait
        return np.ones(len(self.pool), dtype=bool) if wait is None else np.asarray(wait <= 0.0)

    def _bearable(self, course: Course) -> Flags:
        """Rows (N,) whose rest does not make the whole too long."""
        wait, time = self.pool.wait, course.recording.time
        if wait is None or time is None or not course.is_timed:
            return self._at_once
        return course.waited + wait <= self.options.patience * float(np.ptp(time)) + 1e-9

    def random_grams(self, counts: tuple[int, ...], orders: int) -> Array:
        """Gram matrices (orders, counts, P, P) of ever more rows at random, without rests."""
        found = []
        for order in range(orders):
            rng = np.random.default_rng([self.options.seed, 13, order])
            picked = rng.permutation(np.flatnonzero(self._at_once))[: max(counts)]
            course = Course(self.contest.model)
            J = self.jacobians(course.rows_in_order(self.pool.select(picked)))
            sums = np.cumsum(J.transpose(0, 2, 1) @ J, axis=0)
            found.append([sums[min(n, len(sums)) - 1] for n in counts])
        return np.array(found)


def _pair(beliefs: Beliefs, row: Array) -> tuple[int, int]:
    """The two models that a row does most to tell apart, the more probable one first."""
    p = beliefs.probabilities
    told = np.outer(p, p) * np.exp(-beliefs.information) * divergences(beliefs, row[None])[..., 0]
    told = told + told.T
    i, j = np.unravel_index(int(np.argmax(np.triu(told, 1))), told.shape)
    return (int(i), int(j)) if p[i] >= p[j] else (int(j), int(i))


def _sockets(contest: Contest) -> Array | None:
    """Fitted places (s, 3) of the sockets in the base frame [m]."""
    nuisance = contest.model.nuisance
    if not nuisance.sockets.numel():
        return None
    places = cs.Function("sockets", [nuisance.x], [nuisance.sockets])
    return np.asarray(places(contest.model.start[: nuisance.size]).full().T)
