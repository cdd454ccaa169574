r"""The control problem, stated once in symbols; every solver takes it from here.

.. math:: \min_u\ \sum_{i=1}^{p} |y_{des} - y(x(k+i|k))|^2
          + dt^2 \sum_{i=0}^{p-1} \big(e\, |w(i)|^2 + c\, |w(i) - w(i-1)|^2\big) \quad\text{s.t.}

          x(i+1) = x(i) + dt\, u(i), \quad |u(i)| \le \alpha(i)\, v_{max}, \quad
          |u(i) - u(i-1)| \le dt\, a_{max}, \quad d_{rj},\, d_{rh} \ge d_s \ \text{at all times}

with the Euclidean norm for each tip. The first sum is the patent's cost. The second keeps commands
smooth; its weights are ``effort`` and ``smooth`` of the settings, and may be 0. In it w is the rate
u beyond that of the path that is to be followed, if there is one and it is one of states: what the
path itself asks for is no effort, or a smooth command would stay behind it (:mod:`.linearised`).
The rate that was last commanded is u(-1).
Dynamics and speed limits are linear, so what is stated in symbols is one stage: what is tracked,
what is held, the limits, and the pairs of capsules with the distance that each must keep. The
stages differ by their parameters only. Between two stages a pair keeps its distance because at both
it keeps a wider one (:mod:`.pairs`), so a stage knows the step d that leads to it, too. The
present state cannot be changed, so stages are counted from 1 to p, where the patent's sum runs from
0 to p - 1.

"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.capsules import Segment, squared_distance
from plumbline.optim.capsule_mpc.bodies import Body, Obstacle, SymbolicCapsule, foreseen
from plumbline.optim.capsule_mpc.constants import MM, OBSTACLE
from plumbline.optim.capsule_mpc.pairs import Moving, Pair, unmoved
from plumbline.optim.capsule_mpc.settings import Noise, Settings
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class StatementShape:
    """A statement apart from its constants, such as the places of its trocars."""

    key: Hashable  # all that its functions depend on
    statement: Statement = field(compare=False, repr=False)  # one that has this shape


@dataclass(frozen=True, eq=False)
class Statement:
    """What moves, among how many obstacles, under which settings."""

    bodies: tuple[Body, ...]  # what moves
    slots: int  # capsules among the obstacles at most
    settings: Settings = field(default_factory=Settings)  # horizon, speeds, distances
    # spheres among the obstacles at most; a sphere costs less than a capsule. One that may be
    # faster than a tip wants a slot: what it sweeps is a capsule (:mod:`.sweeps`)
    balls: int = 0

    def __post_init__(self) -> None:
        if not self.bodies or min(self.slots, self.balls) < 0:
            raise PlumblineError(
                f"statement: found {len(self.bodies)} bodies, {self.slots} + {self.balls} "
                "obstacles, expected at least 1 and 0 each; name what moves"
            )

        for k, body in enumerate(self.bodies):
            for name, of in (("speed", "v_max"), ("acceleration", "a_max"), ("jerk", "j_max")):
                found = getattr(body, name)
                if not (np.isfinite(found).all() and (found > 0.0).all()):
                    raise PlumblineError(
                        f"body {k + 1}: {name} {found}, expected finite and above 0; set its {of}"
                    )

    @property
    def n(self) -> int:
        """Number of states of all bodies."""
        return sum(body.size for body in self.bodies)

    @cached_property
    def unit(self) -> Array:
        """What one unit of every state is (n,) [m, or rad]."""
        return np.concatenate([body.unit for body in self.bodies])

    @cached_property
    def speed(self) -> Array:
        """Largest rate (n,) of every state."""
        return np.concatenate([body.speed for body in self.bodies])

    @cached_property
    def acceleration(self) -> Array:
        """Largest change (n,) of every state's rate."""
        return np.concatenate([body.acceleration for body in self.bodies])

    @cached_property
    def jerk(self) -> Array:
        """Largest change (n,) of every state's acceleration."""
        return np.concatenate([body.jerk for body in self.bodies])

    @cached_property
    def groups(self) -> tuple[int, ...]:
        """Sizes of the groups of states whose rates are bounded by Euclidean norm."""
        return tuple(size for body in self.bodies for size in body.groups)

    @cached_property
    def step(self) -> Array:
        """Largest change (p, n) of every state's group in each step of the horizon."""
        return self.alpha * self.speed

    @cached_property
    def alpha(self) -> Array:
        """Time of each step of the horizon times its confidence (p, 1) [s]."""
        return self.settings.dt * self.settings.confidence.along(self.settings.p)[:, None]

    @cached_property
    def ramp(self) -> Array:
        """By how much a step can be longer than the last one (p, n)."""
        ahead = np.arange(1, self.settings.p + 1)[:, None]
        return ahead * self.settings.dt**2 * self.acceleration

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Where each body's states stand in the state of all."""
        return slices(body.size for body in self.bodies)

    @cached_property
    def blocks(self) -> tuple[slice, ...]:
        """Where each of the groups stands there."""
        return slices(self.groups)

    @cached_property
    def goals(self) -> int:
        """Numbers that are tracked."""
        return int(self.residual.numel())

    @cached_property
    def symbols(self) -> tuple[cs.SX, cs.SX, cs.SX]:
        """A stage's state x (n,), the present state x0 (n,), and the stage's parameters (t,)."""
        x, x0 = cs.SX.sym("x", self.n), cs.SX.sym("x0", self.n)
        constants = cs.SX.sym("c", sum(self._counts))
        tracked = self._over_bodies("tracked", x, constants).numel()
        obstacles = OBSTACLE * (self.slots + self.balls)
        size = tracked + obstacles + constants.numel() + self.n + self.n + 2 + self.n
        return x, x0, cs.SX.sym("stage", size)

    @cached_property
    def _counts(self) -> tuple[int, ...]:
        return tuple(len(body.constants) for body in self.bodies)

    @property
    def constants(self) -> cs.SX:
        """The constants of all bodies."""
        return self._constants_in(self.symbols[2])

    def _constants_in(self, stage: cs.SX) -> cs.SX:
        return stage[self.stepped.start - sum(self._counts) : self.stepped.start]

    @cached_property
    def shape(self) -> StatementShape:
        """What its functions depend on: statements of one shape share them."""
        bodies = tuple(body.shape for body in self.bodies)
        # The level of noise is a parameter of a stage.
        settings = replace(self.settings, noise=Noise())
        return StatementShape((bodies, self.slots, self.balls, settings), self)

    @cached_property
    def width(self) -> int:
        """Number of parameters of a stage."""
        return int(self.symbols[2].numel())

    @property
    def tracked(self) -> cs.SX:
        """What is compared with the goals (g,)."""
        return self._over_bodies("tracked", self.symbols[0], self.constants)

    @cached_property
    def residual(self) -> cs.SX:
        """What the cost is the sum of squares of (g,) [mm]."""
        tracked = self.tracked
        return tracked - self.symbols[2][: tracked.numel()]

    @cached_property
    def by_states(self) -> bool:
        """Whether goals are states, as those of instruments by their tips are."""
        x, tracked = self.symbols[0], self.tracked
        return bool(tracked.numel() == x.numel() and (tracked - x).is_zero())

    @cached_property
    def held(self) -> cs.SX:
        """What must stay zero (h,) [mm]."""
        return self._over_bodies("held", self.symbols[0], self.constants)

    @cached_property
    def limits(self) -> cs.SX:
        """What must stay positive (l,)."""
        return self._over_bodies("limits", self.symbols[0], self.constants)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Pairs of capsules of different bodies, of one, then of a body and an obstacle."""
        return self.pairs_at(self.symbols[0])

    def pairs_at(
        self, x: cs.SX, d: cs.SX | None = None, stage: cs.SX | None = None
    ) -> tuple[Pair, ...]:
        """The same at another state (n,), after another step (n,), with other parameters (t,)."""
        stage = self.symbols[2] if stage is None else stage
        d = stage[self.stepped] if d is None else d
        own = [self._moving(k, x, d, stage) for k in range(len(self.bodies))]
        tight, safe = stage[-self.n - 2 : -self.n], MM * self.settings.safe
        # Sums of a random part, sqrt(2) and 1 times, and of a bias, twice and once.
        random = (2 * tight[1] - tight[0]) / (2 - np.sqrt(2.0))
        error = (random, tight[1] - random)
        pair = partial(Pair.of, error=error, safe=safe)
        found = [
            pair(a, b, tight[0], False)
            for i, first in enumerate(own)
            for second in own[i + 1 :]
            for a in first
            for b in second
        ]
        for body, links in zip(self.bodies, own, strict=True):
            found += [pair(links[m], links[n], tight[0], False) for m, n in body.own_pairs]
        others = self._obstacles(stage)
        found += [
            pair(a, other, tight[1], True, k >= self.slots)
            for first in own
            for a in first
            for k, other in enumerate(others)
        ]
        return tuple(found)

    def _moving(self, k: int, x: cs.SX, d: cs.SX, stage: cs.SX) -> list[Moving]:
        """The capsules of a body."""
        body, part = self.bodies[k], self.parts[k]
        c = self._split(self._constants_in(stage))[k]
        lever = partial(body.lever, x[part], c)
        before = [capsule.axis for capsule in body.capsules(x[part] - d[part], c)]
        bows = body.sagitta(x[part], c, d[part])
        columns = zip(body.capsules(x[part], c), before, bows, body.through(c), strict=True)
        return [Moving(*column, lever, str(k + 1)) for column in columns]

    def _obstacles(self, stage: cs.SX) -> list[Moving]:
        found = []
        for k in range(self.slots + self.balls):
            o = stage[self.goals + OBSTACLE * k :][:OBSTACLE]
            now, before = (
                SymbolicCapsule(Segment.of(o[:6]), o[6]),
                Segment(o[:3] - o[7:], o[3:6] - o[7:]),
            )
            found.append(Moving(now, before, cs.SX(0.0), None, unmoved, f"obstacle {k + 1}"))
        return found

    def _over_bodies(self, what: str, x: cs.SX, constants: cs.SX, *more: float) -> cs.SX:
        found = [cs.SX(0, 1)]
        for body, part, c in zip(self.bodies, self.parts, self._split(constants), strict=True):
            found.append(getattr(body, what)(x[part], c, *more))
        return cs.vertcat(*found)

    def _split(self, constants: cs.SX) -> list[cs.SX]:
        return [constants[part] for part in slices(self._counts)]

    @cached_property
    def pace(self) -> cs.SX:
        """Bound (n,) on the rate of each state's group in a step that begins at x."""
        return self._over_bodies("pace", self.symbols[0], self.constants, self.settings.dt)

    @cached_property
    def stepped(self) -> slice:
        """Where the step (n,) that leads to x stands among a stage's parameters."""
        return slice(self.width - 3 * self.n - 2, self.width - 2 * self.n - 2)

    @cached_property
    def moved(self) -> slice:
        """Where the step that was last commanded (n,) stands among a stage's parameters."""
        return slice(self.width - 2 * self.n - 2, self.width - self.n - 2)

    def stages(
        self,
        goal: ArrayLike,
        obstacles: Sequence[Obstacle],
        move: ArrayLike | None = None,
        stray: float = 0.0,
    ) -> Array:
        """Parameters of all stages (p, t), in the units of the inside.

        Args:
            goal: What is to be reached (g,), or a path of it (p, g) [mm].
            obstacles: At most ``slots`` [mm].
            move: The step (n,) that was last commanded, dt u [mm, or units]; none from rest.
            stray: Bias beyond what is stated [mm].

        Raises:
            PlumblineError: More obstacles than slots, or a goal of another size.
        """
        s, wanted = self.settings, np.asarray(goal, dtype=float)
        capsules, balls = self.seated(obstacles)
        if wanted.shape not in ((self.goals,), (s.p, self.goals)):
            raise PlumblineError(
                f"goal: found shape {wanted.shape}, expected ({self.goals},) or "
                f"({s.p}, {self.goals}); give what each body tracks"
            )
        out = self._template.copy()
        g, c = self.goals, self.goals + OBSTACLE * self.slots
        out[:, :g] = wanted
        found = foreseen([*capsules, *balls], len(capsules) + len(balls), s.p, s.dt)
        found = found.reshape(s.p, -1)
        size = OBSTACLE * len(capsules)
        out[:, g : g + size] = found[:, :size]
        out[:, c : c + found.shape[1] - size] = found[:, size:]
        out[:, -self.n - 2 : -self.n] += (2 * stray, stray)
        if move is not None:
            out[:, self.moved] = out[:, self.stepped] = move
        return out

    def seated(self, obstacles: Sequence[Obstacle]) -> tuple[list[Obstacle], list[Obstacle]]:
        """Capsules and spheres by their slots (PlumblineError: more than there are slots for)."""
        spheres = [obstacle for obstacle in obstacles if obstacle.a == obstacle.b]
        capsules = [obstacle for obstacle in obstacles if obstacle.a != obstacle.b]
        capsules += spheres[self.balls :]
        if len(capsules) > self.slots:
            raise PlumblineError(
                f"obstacles: found {len(obstacles)}, expected at most {self.slots} capsules and "
                f"{self.balls} spheres; state the problem with more slots"
            )
        return capsules, spheres[: self.balls]

    def present(self, stages: Array) -> Array:
        """Parameters of the present (t,): those of the first stage, obstacles where they are."""
        count, out = self.slots + self.balls, stages[0].copy()
        table = out[self.goals : self.goals + OBSTACLE * count].reshape(count, OBSTACLE)
        table[:, :3] -= table[:, 7:]
        table[:, 3:6] -= table[:, 7:]
        return out

    @cached_property
    def blank(self) -> Array:
        """Parameters of a stage (t,) with nothing there."""
        return self._template[0]

    @cached_property
    def _template(self) -> Array:
        """Parameters of all stages with no obstacle there, and goals at zero."""
        s, count = self.settings, self.slots + self.balls
        out = np.zeros((s.p, self.width))
        empty = foreseen([], count, s.p, s.dt).reshape(s.p, -1)
        out[:, self.goals : self.goals + OBSTACLE * count] = empty
        out[:, self.goals + OBSTACLE * count :] = self._last
        return out

    @cached_property
    def _last(self) -> Array:
        s = self.settings
        constants = np.concatenate([body.constants for body in self.bodies])
        within = np.cumsum(self.step, axis=0)
        still = np.zeros((s.p, 2 * self.n))
        return np.hstack([np.tile(constants, (s.p, 1)), still, s.noise.tightening(s.p), within])

    @property
    def clearances(self) -> cs.Function:
        """``(x, stage) -> (pairs,)``: distance of every pair less its D [mm]."""
        return _clearances(self.shape)


def slices(sizes: Iterable[int]) -> tuple[slice, ...]:
    """Where parts of such sizes stand, one behind the other."""
    return tuple(slice(a, b) for a, b in pairwise(np.cumsum([0, *sizes]).tolist()))


@lru_cache(maxsize=32)
def _clearances(shape: StatementShape) -> cs.Function:
    statement = shape.statement
    x, _, stage = statement.symbols
    gaps = [cs.sqrt(squared_distance(pair.one, pair.two)) - pair.least for pair in statement.pairs]
    found = cs.cse(cs.densify(cs.vertcat(cs.SX(0, 1), *gaps)))
    return cs.Function("clearances", [x, stage], [found])
