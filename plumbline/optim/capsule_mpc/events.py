r"""What a control step reports: how its command came about, and all that was not as it should be.

A pair with the gap g, its distance less D, overlaps where what its D asks beyond touching, the
margin m, is used up: :math:`-g - m > 0`.

Which obstacles get the statement's slots where there are more of them: those that come nearest.

An obstacle's rank is the least distance of its capsule to any that moves, along what is foreseen of
it over the horizon and with all else as it stands,

.. math:: \min_{0 \le i \le p}\ \min_r\ d(x_0, O(i)) - r_r - r_O

and one that is left out is a danger if it can come within its margin before everything stands,

.. math:: \min_{0 \le i \le T}\ \min_r\ d(x_0, O(i)) - \rho_r(T) - D < 0

with :math:`\rho` the reach of what moves in a step and a stop after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.capsules import nearest
from plumbline.optim.capsule_mpc.bodies import Obstacle, foreseen
from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.constants import KEPT, MM, NO_SEAT, OBEYED, OFF, SLACK
from plumbline.optim.capsule_mpc.obeying import Astray
from plumbline.optim.capsule_mpc.planning import Plan
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Seated:
    """Obstacles with a slot, and what is known of the others."""

    kept: list[Obstacle]  # those with a slot
    dropped: int = 0  # how many have none
    gap: float = NO_SEAT  # least distance less its D of those [mm]
    danger: bool = False  # whether one of those can come within its margin before everything stands


class Seating:
    """Gives slots to obstacles."""

    def __init__(self, statement: Statement, steps: int) -> None:
        """For motions that end after so many steps."""
        self.statement, self.steps = statement, steps

    @cached_property
    def _links(self) -> Compiled:
        """``(x, within) -> ends (6 C,), radii (C,), reaches (C,)`` of all that moves."""
        own = self.statement
        x, _, _ = own.symbols
        within, ends, radii, reaches = cs.SX.sym("w", own.n), [], [], []
        for body, part in zip(own.bodies, own.parts, strict=True):
            c = cs.SX(cs.DM(body.constants))
            for link, reach in zip(
                body.capsules(x[part], c), body.reach(x[part], c, within[part]), strict=True
            ):
                ends.append(link.axis.ends)
                radii.append(cs.SX(link.radius))
                reaches.append(reach)
        outputs = [cs.densify(cs.vertcat(*values)) for values in (ends, radii, reaches)]
        return Compiled(cs.Function("links", [x, within], outputs), False)

    def seat(self, x0: Array, obstacles: Sequence[Obstacle]) -> Seated:
        """Those that come nearest to the capsules at x0 (n,), as many as there are slots for."""
        own = self.statement
        balls = sum(o.a == o.b for o in obstacles)
        if len(obstacles) - min(balls, own.balls) <= own.slots:
            return Seated(list(obstacles))
        gaps, reach = self._gaps(x0, obstacles)
        order = np.argsort(gaps[: own.settings.p + 1].min(axis=(0, 2)), kind="stable")
        taken = self._taken(obstacles, [int(k) for k in order])
        rest = [k for k in range(len(obstacles)) if k not in taken]
        soon = gaps[: self.steps + 1, rest] - reach
        here = float(gaps[0, rest].min())
        kept = [obstacles[k] for k in sorted(taken)]
        return Seated(kept, len(rest), here, bool(soon.min() < 0.0))

    def _gaps(self, x0: Array, obstacles: Sequence[Obstacle]) -> tuple[Array, Array]:
        """Distances less D (T, K, C) at this and later steps, and reaches (C,) [mm]."""
        own = self.statement
        s = own.settings
        ends, radii, reach = (v.copy() for v in self._links(x0, self.steps * s.dt * own.speed))
        links = ends.reshape(-1, 2, 3)
        table = foreseen(obstacles, len(obstacles), 1 + max(s.p, self.steps), s.dt, 0)
        shape = (*table.shape[:2], len(links))
        axes = np.broadcast_to(table[:, :, None, :6], (*shape, 6)).reshape(-1, 2, 3)
        shafts = np.broadcast_to(links, (*shape, 2, 3)).reshape(-1, 2, 3)
        found = nearest(shafts, axes).distance.reshape(shape)
        # Between two steps an obstacle may come nearer by half of its way at most.
        half = np.linalg.norm(table[:, :, 7:], axis=2) / 2
        half[0] = 0.0
        margin = s.apart[1]
        return found - radii - (table[:, :, 6] + half)[:, :, None] - margin, reach

    def _taken(self, obstacles: Sequence[Obstacle], order: list[int]) -> set[int]:
        """Numbers of those with a slot: a sphere takes a capsule's where spheres have none left."""
        slots, balls, taken = self.statement.slots, self.statement.balls, set()
        for k in order:
            ball = obstacles[k].a == obstacles[k].b
            if ball and balls:
                balls -= 1
            elif slots:
                slots -= 1
            else:
                continue
            taken.add(k)
        return taken


class Mode(Enum):
    """Where a command comes from, best first."""

    PLAN = "plan"
    ONE_STEP = "one-step"
    BRAKE = "brake"
    STOP = "stop"


class Trouble(Enum):
    """Kinds of events."""

    BAD_MEASUREMENT = "bad-measurement"
    BAD_GOAL = "bad-goal"
    BAD_OBSTACLE = "bad-obstacle"
    TOO_MANY_OBSTACLES = "too-many-obstacles"
    INSIDE_MARGIN = "inside-margin"
    CONTACT = "contact"
    SLACK = "slack"
    CANNOT_BE_MET = "cannot-be-met"
    SOLVER_FAILED = "solver-failed"
    OVER_BUDGET = "over-budget"
    FAULT = "fault"
    HELD_BACK = "held-back"
    LATE = "late"
    OFF_HOLD = "off-hold"
    STOPPED = "stopped"


@dataclass(frozen=True)
class Event:
    """One thing that was not as it should be."""

    trouble: Trouble  # what kind
    words: str  # one line: the value, the limit, what was done
    value: float | None = None  # the value, where there is one [m, m/s or s]


@dataclass(frozen=True)
class Command:
    """What to do until the next step."""

    rate: Array  # rate (n,) of every state, within the limits [m/s, or rad/s of a joint]
    mode: Mode  # where it comes from
    events: tuple[Event, ...]  # what was not as it should be
    # least distance of any pair, less its D, where the step began [m]; of all obstacles, those too
    # that the statement has no slot for
    gap: float
    slack: float  # of the plan [m]
    seconds: float  # time that the step took [s]
    path: Array | None  # states (p, n) of the plan, if one came in time [m, or rad]

    def __repr__(self) -> str:
        wrong = ", ".join(sorted(trouble.value for trouble in self.troubles())) or "no trouble"
        return f"<Command: {self.mode.value}, gap {MM * self.gap:.3g} mm, {wrong}>"

    def troubles(self) -> set[Trouble]:
        """The kinds of its events."""
        return {event.trouble for event in self.events}


@lru_cache(maxsize=16)
def margins_function(shape: StatementShape) -> cs.Function:
    """``(x, stage) -> (pairs,)``: what every pair's D asks beyond touching [mm]."""
    statement = shape.statement
    x, _, stage = statement.symbols
    beyond = [pair.least - pair.radii for pair in statement.pairs]
    found = cs.cse(cs.densify(cs.vertcat(cs.SX(0, 1), *beyond)))
    return cs.Function("margins", [x, stage], [found])


def inside(gaps: Array, margins: Array) -> list[Event]:
    """A start inside of a margin: of the pairs' gaps and the margins in their D (P,) [mm]."""
    gap, overlap = float(gaps.min(initial=np.inf)), float((-gaps - margins).max(initial=-np.inf))
    if gap >= -SLACK:
        return []
    if overlap > 0.0:
        return [Event(Trouble.CONTACT, f"{overlap:.3f} mm of overlap, expected none", gap / MM)]
    words = f"{-gap:.3f} mm inside of the margin, expected 0"
    return [Event(Trouble.INSIDE_MARGIN, words, gap / MM)]


def entered(first: float, events: Sequence[Event], least: float) -> list[Event]:
    """A margin that is entered by more than ``least`` in the step to come; said once a step."""
    known = any(e.trouble in (Trouble.INSIDE_MARGIN, Trouble.CONTACT) for e in events)
    if known or first >= -least:
        return []
    words = f"within the step up to {-first:.3f} mm inside of a margin, expected 0"
    return [Event(Trouble.INSIDE_MARGIN, words, first / MM)]


def off_hold(off: float) -> Event:
    """What must stay zero and is not [mm]."""
    words = f"what is held is off by {off:.3f} mm, expected at most {OFF:g}; put right on the way"
    return Event(Trouble.OFF_HOLD, words, off / MM)


def held_back(gap: float) -> Event:
    """No rate of a plan's passes, and what the stop at hand comes to [mm]."""
    words = "no rate of the plan's passes; stopped"
    return Event(Trouble.HELD_BACK, words + (f", {-gap:.3f} mm in a margin" if gap < 0.0 else ""))


def left_out(seen: int, own: Statement, seated: Seated) -> list[Event]:
    """Obstacles without a slot."""
    if not seated.dropped:
        return []
    words = (
        f"{seen} obstacles, at most {own.slots} capsules and {own.balls} spheres; "
        f"{seated.dropped} left out, the nearest "
        f"{seated.gap:.1f} mm from its margin{', within reach: stopped' if seated.danger else ''}"
    )
    return [Event(Trouble.TOO_MANY_OBSTACLES, words, float(seen))]


def moves_otherwise(k: int, seen: Obstacle, stated: Obstacle) -> Event:
    """An obstacle, from 0, whose places do not go by its velocity."""
    speed, said = (float(np.linalg.norm(o.velocity)) for o in (seen, stated))
    words = f"obstacle {k + 1}: its places move by {speed:.0f} mm/s, {said:.0f} stated; as seen"
    return Event(Trouble.BAD_OBSTACLE, words, speed / MM)


def acts_late(k: int, later: float) -> Event:
    """Rates of a body, from 0, act otherwise than was told [s]."""
    words = f"instrument {k + 1}: rates act {1e3 * later:+.0f} ms later than told; as seen"
    return Event(Trouble.LATE, words, later)


def unseen(k: int, way: float, steps: int) -> Event:
    """A body, from 0, that is seen in one place while it was sent on [mm]."""
    words = (
        f"instrument {k + 1}: seen in one place for {steps} steps, to the last bit, while it was "
        f"sent {way:.1f} mm: its reading repeats itself, or it is held; stopped until "
        "it is seen elsewhere, or reset()"
    )
    return Event(Trouble.BAD_MEASUREMENT, words, way / MM)


def astray(k: int, unit: float, one: Astray) -> Event:
    """An axis of a body, from 0, that does not go where it is sent."""
    way, name = unit * float(one.sent.max()), "mm" if unit == 1 / MM else "mrad"
    words = (
        f"instrument {k + 1}: sent {MM * way:.1f} {name} within {one.seconds:.1f} s, not seen to "
        f"go {100 * OBEYED:.0f} % of it: it is held, turned round, or another thing is seen; "
        "stopped until it is seen there, or reset()"
    )
    return Event(Trouble.BAD_MEASUREMENT, words, way)


def not_evaded(k: int, overlap: float) -> Event:
    """Every known way of a body, from 0, ends in what comes [mm]."""
    words = f"instrument {k + 1}: no way out of what comes, {overlap:.3f} mm of overlap at best"
    return Event(Trouble.CANNOT_BE_MET, words, overlap / MM)


class AtGoal:
    """Says where bodies cannot be at their goals, all at theirs and the rest as it stands."""

    def __init__(self, statement: Statement) -> None:
        """Judges goals that are states, as those of instruments by their tips are, no others."""
        x = statement.symbols[0]
        self._states = statement.by_states
        # At rest nothing is under way, and lateness takes nothing.
        self._rest = slice(-statement.n - 2, -statement.n), statement.stepped
        self._tight = statement.blank[self._rest[0]]
        words = []
        for one, other in (pair.labels for pair in statement.pairs):
            what = other if other.isdecimal() else "an obstacle"  # slots are not as they were given
            words.append(f"{one} and {what} nearer than allowed")
        for k, (body, part) in enumerate(zip(statement.bodies, statement.parts, strict=True)):
            limits = body.limits(x[part], cs.SX(cs.DM(body.constants))).numel()
            words += [f"{k + 1} beyond its depths or cone"] * limits
        self._words = words
        self._room = Compiled(_room(statement.shape), False)

    def said(self, goal: Array, here: Array) -> list[Event]:
        """What falls shortest at a goal (g,) [mm] under parameters of the present (t,)."""
        if not self._states:
            return []
        at_rest = here.copy()
        at_rest[self._rest[0]], at_rest[self._rest[1]] = self._tight, 0.0
        room = self._room(goal, at_rest)[0]
        k = int(room.argmin())
        if room[k] >= -SLACK:
            return []
        words = f"goal: instrument {self._words[k]}, by {-room[k]:.3f} mm; stays short of it"
        return [Event(Trouble.BAD_GOAL, words, float(room[k]) / MM)]


@lru_cache(maxsize=16)
def _room(shape: StatementShape) -> cs.Function:
    own = shape.statement
    x, _, stage = own.symbols
    out = cs.vertcat(own.clearances(x, stage), own.limits)
    return cs.Function("room", [x, stage], [cs.cse(cs.densify(out))])


def impossible(statement: Statement) -> list[Event]:
    """Pairs of shafts whose trocars are nearer than their D in the first stage."""
    both = [(pair, pair.most) for pair in statement.pairs if pair.most is not None]
    short = cs.vertcat(cs.SX(0, 1), *(pair.plain - most for pair, most in both))
    stage = statement.stages(np.zeros(statement.goals), [])[0]
    found = cs.Function("short", [statement.symbols[2]], [cs.densify(short)])(stage)
    values = (float(value) for value in found.full().ravel())
    return [
        Event(
            Trouble.CANNOT_BE_MET,
            f"shafts {' and '.join(pair.labels)}: trocars nearer than their margin by "
            f"{value:.3f} mm; they keep {100 * KEPT:.0f} % of the trocars' distance",
            value / MM,
        )
        for (pair, _), value in zip(both, values, strict=True)
        if value > 0.0
    ]


def shortfalls(plan: Plan) -> list[Event]:
    """What a plan does not keep."""
    found = []
    if plan.slack > SLACK:
        words = f"plan falls short of its distances by {plan.slack:.3f} mm, expected 0"
        found.append(Event(Trouble.SLACK, words, plan.slack / MM))
    if plan.lasting > SLACK:
        words = (
            f"distances cannot be met within the horizon, short by {plan.lasting:.3f} mm at best"
        )
        found.append(Event(Trouble.CANNOT_BE_MET, words, plan.lasting / MM))
    return found
