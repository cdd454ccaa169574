r"""Events in words: the value, the limit, what was done.

A pair with the gap g, its distance less D, overlaps where what its D asks beyond touching, the
margin m, is used up: :math:`-g - m > 0`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.events import Event, Trouble
from plumbline.optim.capsule_mpc.pairs import KEPT
from plumbline.optim.capsule_mpc.planning import Plan
from plumbline.optim.capsule_mpc.seating import Seated
from plumbline.optim.capsule_mpc.statement import Shape, Statement

Array = NDArray[np.float64]
SLACK = 1e-3  # [mm] of slack, or inside of a margin, that is worth a report


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
        return [Event(Trouble.CONTACT, f"{overlap:.3f} mm of overlap, expected none", gap)]
    words = f"{-gap:.3f} mm inside of the margin, expected 0"
    return [Event(Trouble.INSIDE_MARGIN, words, gap)]


def entered(first: float, events: Sequence[Event], least: float) -> list[Event]:
    """A margin that is entered by more than ``least`` in the step to come; said once a step."""
    known = any(e.trouble in (Trouble.INSIDE_MARGIN, Trouble.CONTACT) for e in events)
    if known or first >= -least:
        return []
    words = f"within the step up to {-first:.3f} mm inside of a margin, expected 0"
    return [Event(Trouble.INSIDE_MARGIN, words, first)]


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
            value,
        )
        for (pair, _), value in zip(both, values, strict=True)
        if value > 0.0
    ]


def shortfalls(plan: Plan) -> list[Event]:
    """What a plan does not keep."""
    found = []
    if plan.slack > SLACK:
        words = f"plan falls short of its distances by {plan.slack:.3f} mm, expected 0"
        found.append(Event(Trouble.SLACK, words, plan.slack))
    if plan.lasting > SLACK:
        words = (
            f"distances cannot be met within the horizon, short by {plan.lasting:.3f} mm at best"
        )
        found.append(Event(Trouble.CANNOT_BE_MET, words, plan.lasting))
    return found


def first_line(error: Exception) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {error}".splitlines()[0]
