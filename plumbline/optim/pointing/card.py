"""Words that the cards of sweeps and maps are made of."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from plumbline.optim.pointing.given import Array
from plumbline.optim.pointing.status import MEANING, Status


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
