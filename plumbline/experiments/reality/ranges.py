"""Ranges that simulators draw from: ``ranges.toml``, a table a kind, each with unit and reason.

``name = [low, high, unit, reason]``; with ``"log"`` behind them, even over the logarithm.
"""

import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import NamedTuple

import numpy as np

from plumbline.experiments.reality.arm import Array


class Range(NamedTuple):
    """Between what something is drawn."""

    low: float
    high: float
    unit: str
    why: str
    law: str = "uniform"  # or ``log``


TABLES: Mapping[str, Mapping[str, Range]] = {
    kind: {name: Range(*row) for name, row in table.items()}
    for kind, table in tomllib.loads(
        resources.files(__package__).joinpath("ranges.toml").read_text(encoding="utf-8")
    ).items()
}


class Ranges:
    """The ranges of one kind, by name."""

    def __init__(self, kind: str) -> None:
        self.of = TABLES[kind]

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

    def whole(self, name: str, rng: np.random.Generator) -> int:
        """A whole number, both ends included."""
        return int(rng.integers(int(self.of[name].low), int(self.of[name].high) + 1))
