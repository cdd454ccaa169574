"""HPIPM asked directly, in the library that CasADi brings: the same programmes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from ours import raced

PACKAGE = "casadi"


def programme(given: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Median and 99th percentile of one programme [ms], and the share that was solved."""
    found = raced()
    return {"error": found.hpipm[0], "p99": found.hpipm[1], "solved": found.solved}
