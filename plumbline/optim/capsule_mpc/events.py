r"""What a control step reports: how its command came about, and all that was not as it should be.

A pair with the gap g, its distance less D, overlaps where what its D asks beyond touching, the
margin m, is used up: :math:`-g - m > 0`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.optim.capsule_mpc.constants import KEPT, MM, OFF, SLACK
from plumbline.optim.capsule_mpc.planning import Plan
from plumbline.optim.capsule_mpc.scene import Obstacle
from plumbline.optim.capsule_mpc.seating import Seated
from plumbline.optim.capsule_mpc.statement import Shape, Statement
from plumbline.optim.core.problem import Array


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
def margins_function(shape: Shape) -> cs.Function:
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


def left_out(seen: int, room: int, seated: Seated) -> list[Event]:
    """Obstacles without a slot."""
    if not seated.dropped:
        return []
    words = (
        f"{seen} obstacles, at most {room}; {seated.dropped} left out, the nearest "
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


def not_evaded(k: int, overlap: float) -> Event:
    """Every known way of a body, from 0, ends in what comes [mm]."""
    words = f"instrument {k + 1}: no way out of what comes, {overlap:.3f} mm of overlap at best"
    return Event(Trouble.CANNOT_BE_MET, words, overlap / MM)


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


def first_line(error: Exception) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {error}".splitlines()[0]
