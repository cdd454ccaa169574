r"""One step without a horizon: a quadratic program on control barrier functions.

.. math:: \min_{x_1} |y(x_1) - y_{ref}|^2 \quad\text{s.t.}\quad
          h_r(x_1) \ge (1 - \gamma)\, h_r(x_0), \qquad |x_1 - x_0| \le dt\, v_{max}

with h_r a pair's distance less D, linearised at x0 (Ames et al. 2017, IEEE TAC 62(8); in discrete
time Agrawal and Sreenath 2017, RSS). It lets distances shrink by a share gamma a step at most, so
it brakes before it touches; where it starts inside of the margin it asks to leave it at that rate.
The reference is one step on the straight way to the goal. It sees nothing coming, so alone it gets
stuck where the straight way ends; but it has the size of one stage, and behind the guide, which
looks at whole ways (:mod:`.guide`), it does as well as the horizon. It is the controller's default.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.banded_qp import BandedQp, native
from plumbline.optim.capsule_mpc.compiled import Compiled, backend
from plumbline.optim.capsule_mpc.linearised import Linearised, within_norms
from plumbline.optim.capsule_mpc.planning import Plan, Ready
from plumbline.optim.capsule_mpc.statement import Shape, Statement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OneStep:
    """Options of one step."""

    gamma: float = 0.3  # share of its distance that a pair may lose in a step, in (0, 1]
    compiled: bool = True  # whether to compile, where there is a compiler

    def ready(self, statement: Statement) -> Ready:
        """Build for one statement."""
        plain = replace(statement.settings, p=1, effort=0.0, smooth=0.0)
        one = replace(statement, settings=plain)
        linearised = Linearised(one, self.compiled)
        linearised.prepare()
        BandedQp().prepare()
        return _OneStepReady(self, statement, linearised, Compiled(_tracked(one.shape), False))


@lru_cache(maxsize=32)
def _tracked(shape: Shape) -> cs.Function:
    x, _, stage = shape.statement.symbols
    return cs.Function("tracked", [x, stage], [cs.densify(shape.statement.tracked)])


@dataclass(frozen=True, eq=False)
class _OneStepReady:
    options: OneStep
    statement: Statement
    linearised: Linearised
    tracked: Compiled

    @property
    def backend(self) -> str:
        """``"compiled"`` or ``"casadi"``."""
        return backend(self.linearised.native, native())

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        """The same step held for the rest of the horizon."""
        gamma, goals = self.options.gamma, self.statement.goals
        first = stages[:1].copy()
        here = self.tracked(x0, stages[0])[0]
        way = first[0, :goals] - here
        most = float(self.linearised.statement.step.max())
        points = way.reshape(-1, 3) if goals % 3 == 0 else way[:, None]
        far = float(np.linalg.norm(points, axis=1).max())
        first[0, :goals] = here + way * min(1.0, most / max(far, 1e-9))
        # A row may matter while its value is below what a step changes, over gamma.
        first[:, -self.statement.n :] /= gamma
        qp = self.linearised.about(x0[None], x0, first)
        decayed = np.where(qp.present, (1 - gamma) * (qp.G @ x0) + gamma * qp.h, qp.h)
        found = BandedQp().solve(replace(qp, h=decayed), x0[None])
        slack = float(found.slack.max(initial=0.0))
        step = within_norms(found.x[0] - x0, qp.first, qp.groups)
        ahead = np.tile(x0 + step, (len(stages), 1))
        solved = found.solved and bool(np.isfinite(found.x).all())
        return Plan(ahead, solved, slack, found.iterations, "one step", slack)
