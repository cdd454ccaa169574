"""What becomes of an angle, in words, and what the cards of sweeps and maps say of many."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from plumbline.optim.core.problem import Array


class Status(StrEnum):
    """Whether a needle can be held at an angle; if not, why."""

    SAFE = "safe"
    REACH = "out of reach"
    LIMIT = "joint limit"
    SINGULAR = "near a singularity"
    COLLISION = "collision"
    INSIDE = "tip inside the body"
    BLOCKED = "path blocked"
    JUMP = "joint jump"


MEANING = {
    Status.SAFE: "held within joint limits, away from singularities, clear of all around",
    Status.REACH: "no posture of the arm holds the needle there, whatever its joint limits",
    Status.LIMIT: "only postures beyond the joint limits hold the needle there",
    Status.SINGULAR: "the smallest singular value of the needle's task is below its limit",
    Status.COLLISION: "arm or needle come nearer to the body, the scene or each other than allowed",
    Status.BLOCKED: "the way from the tip to the lesion comes nearer to a solid than allowed",
    Status.INSIDE: "the stand-off is too short: the needle would not come from outside of the body",
    Status.JUMP: "the path there leaps to another posture of the arm",
}


def meanings(counts: Iterable[tuple[Status, int]]) -> list[str]:
    """How many angles there are of each status, and what it means."""
    return [f"{number} {kind.value}: {MEANING[kind]}" for kind, number in counts]


def most(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    """The largest finite one of some values, in words."""
    found = values[np.isfinite(values)]
    return f"at most {form.format(factor * found.max())} {unit}".strip() if len(found) else "none"


def least(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    """The least finite one of some values, in words."""
    found = values[np.isfinite(values)]
    return f"at least {form.format(factor * found.min())} {unit}".strip() if len(found) else "none"


def span(angles: Array) -> str:
    """How many angles [rad], and from where to where."""
    low, high = np.degrees(angles.min()), np.degrees(angles.max())
    return f"{len(angles)} from {low:.0f} to {high:.0f} deg"
