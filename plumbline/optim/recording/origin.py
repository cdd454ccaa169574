"""Where rows and settings came from: what is found wrong with them later still names the place."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import Spot, shown
from plumbline.optim.recording.constants import FIRST_ROW

HEADER = "the header being row 1"

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


def row_numbers(chosen: NDArray[np.bool_]) -> tuple[int, ...]:
    """Numbers of the rows that a mask (N,) picks, as an editor counts: the header is row 1."""
    return tuple((FIRST_ROW + np.flatnonzero(chosen)).tolist())


@dataclass(frozen=True)
class Origin:
    """Where rows came from, so that a fault found late can still name the place."""

    file: str = "arrays"  # name of the file, or ``"arrays"``
    # line number (N,) of each row in the file; None for arrays, counted from 0
    lines: Integers | None = None
    # where each setting stands, by its name: ``{"noise_std": "dataset.toml, row 3, ..."}``
    keys: Mapping[str, str] = field(default_factory=dict)

    def key(self, name: str) -> str:
        """Where a setting stands, or just its name."""
        return self.keys.get(name, name)

    def at(self, column: str, index: int | np.integer | None = None) -> Spot:
        """``samples.csv, row 17, column 'q3'`` for the row of that index."""
        if index is None:
            return Spot.at(self.file, None, column)
        if self.lines is None:
            words = f"{self.file}, row {int(index)} (from 0), column {shown(column)}"
            return Spot(words, self.file, int(index), column)
        return Spot.at(self.file, int(self.lines[index]), column)
