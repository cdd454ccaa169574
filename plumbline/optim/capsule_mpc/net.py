r"""What a command and the stop after it would lead to: the judge of a command before it goes out.

The command's step and all steps of its stop are cut into substeps, and on each of them every pair's
distance is bounded from below (:mod:`.pairs`) at the obstacles' places at that time,

.. math:: g = \min_k\ (d_k - b_k) - D

with b the sagitta of what moves on an arc; limits of the states are taken at the substeps' ends.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.capsules import squared_distance
from plumbline.optim.capsule_mpc.compiled import Compiled, native_function
from plumbline.optim.capsule_mpc.constants import OBSTACLE, SUBSTEPS, WORSE
from plumbline.optim.capsule_mpc.pairs import farthest, on_the_way
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Clearances:
    """What a motion leads to."""

    gaps: Array  # least distance less D of every pair (P,) on all of the way [mm]
    first: float  # the least of any pair in the first step [mm]
    rooms: Array  # least room to every limit of the states (l,)

    @property
    def clear(self) -> bool:
        """Whether nothing falls short."""
        return float(min(self.gaps.min(initial=0.0), self.rooms.min(initial=0.0))) >= -WORSE

    def no_worse(self, rest: Self) -> bool:
        """Whether distances are short by no more than others, at worst and in all; no limit is."""
        short, at_rest = np.maximum(-self.gaps - WORSE, 0.0), np.maximum(-rest.gaps, 0.0)
        worst = short.max(initial=0.0) <= at_rest.max(initial=0.0)
        inside = (self.rooms >= np.minimum(rest.rooms, 0.0) - WORSE).all()
        return bool(worst and short.sum() <= at_rest.sum() and inside)


def substep(statement: Statement) -> cs.Function:
    """``(x, d, end, part, stage) -> (P + l,)``: gaps from x to x + d, then rooms.

    Obstacles are where they are ``end`` steps after the stage, and have moved for ``part`` steps.
    """
    x, _, stage = statement.symbols
    d, end, part = (cs.SX.sym(k, m) for k, m in (("d", statement.n), ("end", 1), ("part", 1)))
    moved, begin = cs.SX(stage), statement.goals
    for k in range(statement.slots + statement.balls):
        at = begin + OBSTACLE * k
        step = stage[at + 7 : at + 10]
        moved[at : at + 6] = stage[at : at + 6] + end * cs.vertcat(step, step)
        moved[at + 7 : at + 10] = part * step
    found = [cs.SX(0, 1)]
    for pair in statement.pairs_at(x + d, d, moved):
        now, before = (pair.one, pair.two), pair.before
        least = on_the_way(squared_distance(*before), squared_distance(*now), farthest(now, before))
        found.append(least - pair.bow - pair.asked)
    limits = cs.substitute(statement.limits, x, x + d)
    out = cs.cse(cs.densify(cs.vertcat(*found, limits)))
    return cs.Function("substep", [x, d, end, part, stage], [out])


@lru_cache(maxsize=32)
def _mapped(shape: StatementShape, steps: int, compiler: bool) -> tuple[cs.Function, bool]:
    count = SUBSTEPS * steps
    return native_function(substep(shape.statement).map("net", "serial", count, [4], []), compiler)


class Net:
    """Judges motions of so many steps."""

    def __init__(self, statement: Statement, steps: int, compiled: bool) -> None:
        """Build, and compile, what judges; the first time, this may take some seconds."""
        self._function = Compiled(*_mapped(statement.shape, steps, compiled))
        self._dt, self._pairs = statement.settings.dt, len(statement.pairs)
        self._end = np.arange(1, SUBSTEPS * steps + 1) / SUBSTEPS
        self._part = np.full(SUBSTEPS * steps, 1 / SUBSTEPS)

    def judge(self, x0: Array, rates: Array, present: Array) -> Clearances:
        """What rates (T, n) lead to from x0 (n,), with the parameters of the present (t,)."""
        d = np.repeat(rates * (self._dt / SUBSTEPS), SUBSTEPS, axis=0)
        x = x0 + np.cumsum(d, axis=0) - d
        found = self._function(x, d, self._end, self._part, present)[0].reshape(len(d), -1)
        gaps, rooms = found[:, : self._pairs], found[:, self._pairs :]
        first = float(gaps[:SUBSTEPS].min(initial=np.inf))
        every = gaps.min(axis=0, initial=np.inf), rooms.min(axis=0, initial=np.inf)
        return Clearances(every[0], first, every[1])
