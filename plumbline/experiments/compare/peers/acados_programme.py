"""acados on the same programmes; it is not on the index, so its environment says why not."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from acados_template import AcadosOcpQpSolver
from numpy.typing import NDArray

Array = NDArray[np.float64]


def version() -> str:
    """Of acados."""
    return version_of("acados_template")


def fit(given: Mapping[str, Array]) -> Any:
    """A solver of quadratic programmes."""
    return AcadosOcpQpSolver


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """Nothing that can be compared yet."""
    return {}
