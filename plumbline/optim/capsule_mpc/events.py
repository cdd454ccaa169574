"""What a control step reports: how its command came about, and all that was not as it should be."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.planning import Plan

Array = NDArray[np.float64]


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
    OFF_HOLD = "off-hold"
    STOPPED = "stopped"


@dataclass(frozen=True)
class Event:
    """One thing that was not as it should be."""

    trouble: Trouble  # what kind
    words: str  # one line: the value, the limit, what was done
    value: float | None = None  # the value, where there is one


@dataclass(frozen=True)
class Command:
    """What to do until the next step."""

    rate: Array  # rate (n,) of every state, within the limits [mm/s, or units/s of a joint]
    mode: Mode  # where it comes from
    events: tuple[Event, ...]  # what was not as it should be
    # least distance of any pair, less its D, where the step began [mm]; of all obstacles, those too
    # that the statement has no slot for
    gap: float
    slack: float  # of the plan [mm]
    seconds: float  # time that the step took [s]
    plan: Plan | None  # the plan, if one came in time

    def __repr__(self) -> str:
        """Where it comes from, the gap, and what was not as it should be."""
        wrong = ", ".join(sorted(trouble.value for trouble in self.troubles())) or "no trouble"
        return f"<Command: {self.mode.value}, gap {self.gap:.3g} mm, {wrong}>"

    def troubles(self) -> set[Trouble]:
        """The kinds of its events."""
        return {event.trouble for event in self.events}
