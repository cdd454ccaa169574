"""HPIPM asked directly, in the library that CasADi brings: the same programmes."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ours_programme import fit as fit

Array = NDArray[np.float64]


def version() -> str:
    """Of CasADi, which brings it."""
    return f"in CasADi {version_of('casadi')}"


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """Median of one programme [ms]."""
    return {"error": found.hpipm[0], "p99": found.hpipm[1], "solved": found.solved}
