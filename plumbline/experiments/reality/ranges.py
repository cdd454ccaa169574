"""Ranges that simulators draw from: ``ranges.toml``, a table a kind, each with unit and reason.

``name = [low, high, unit, reason]``; with ``"log"`` behind them, even over the logarithm. Under
``spread`` a table has ``[1 sigma, unit, reason]`` of what is normal about zero, and under
``chance`` ``[share, reason]``.
"""

import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from plumbline.experiments.reality.arm import Array


class Range(NamedTuple):
    """Between what something is drawn."""

    low: float
    high: float
    unit: str
    why: str
    law: str = "uniform"  # or ``log``


class Spread(NamedTuple):
    """How far something lies from zero."""

    size: float | list[float]
    unit: str
    why: str


class Chance(NamedTuple):
    """How often something happens."""

    share: float
    why: str


def table(name: str) -> dict[str, Any]:
    """A file beside this one."""
    return tomllib.loads(resources.files(__package__).joinpath(name).read_text(encoding="utf-8"))


READ = table("ranges.toml")
TABLES: Mapping[str, Mapping[str, Range]] = {
    kind: {name: Range(*row) for name, row in rows.items() if isinstance(row, list)}
    for kind, rows in READ.items()
}
SPREADS: Mapping[str, Mapping[str, Spread]] = {
    kind: {name: Spread(*row) for name, row in rows.get("spread", {}).items()}
    for kind, rows in READ.items()
}
CHANCES: Mapping[str, Mapping[str, Chance]] = {
    kind: {name: Chance(*row) for name, row in rows.get("chance", {}).items()}
    for kind, rows in READ.items()
}


class Ranges:
    """The ranges of one kind, by name."""

    def __init__(self, kind: str) -> None:
        self.of, self.spreads, self.chances = TABLES[kind], SPREADS[kind], CHANCES[kind]

    def many(
        self, name: str, rng: np.random.Generator, size: int | tuple[int, ...] | None
    ) -> Array:
        """Numbers of that shape."""
        low, high, _, _, law = self.of[name]
        if law == "log":
            return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high), size)))
        return np.asarray(rng.uniform(low, high, size))

    def one(self, name: str, rng: np.random.Generator) -> float:
        """A number."""
        return float(self.many(name, rng, None))

    def near(
        self, name: str, rng: np.random.Generator, size: int | tuple[int, ...] | None = None
    ) -> Array:
        """Numbers of that shape, normal about zero."""
        return np.asarray(rng.normal(0.0, self.spreads[name].size, size))

    def happens(self, name: str, rng: np.random.Generator) -> bool:
        """Whether it does, this time."""
        return bool(rng.random() < self.chances[name].share)

    def whole(self, name: str, rng: np.random.Generator) -> int:
        """A whole number, both ends included."""
        return int(rng.integers(int(self.of[name].low), int(self.of[name].high) + 1))
