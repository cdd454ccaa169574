r"""Labelled points of a Slicer file as a table, and what its axes mean.

.. math:: p_{RAS} = \mathrm{diag}(-1, -1, 1)\, p_{LPS}

The table has the columns ``label, x, y, z, description``, one row a point, in m, along the axes
that were asked for.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault, shown
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.core.problem import Array

AXES = ("LPS", "RAS")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}  # of UCUM, as Slicer writes them
COLUMNS = ("label", "x", "y", "z", "description")
FLIP = np.diag([-1.0, -1.0, 1.0])


def refusal(where: str, found: str, expected: str, mend: str) -> PlumblineError:
    """The error to raise: where it is, what is there, what should be, and how to mend it."""
    return PlumblineError(str(fault(where, found, expected, mend)))


def check_axes(axes: str, where: str = "axes") -> str:
    """LPS or RAS.

    Raises:
        PlumblineError: It is neither.
    """
    if axes not in AXES:
        mend = "state the axes that the coordinates are given along"
        raise refusal(where, shown(axes), " or ".join(AXES), mend)
    return axes


def axes_changed(points: ArrayLike, source: str, target: str) -> Array:
    """Points (..., 3) given along ``source`` axes, along ``target`` axes: both LPS or RAS."""
    values = np.array(points, dtype=float)
    if check_axes(source) != check_axes(target):
        values = values @ FLIP
    return values


def points_table(
    labels: Sequence[str], points: ArrayLike, descriptions: Sequence[str] | None = None
) -> pd.DataFrame:
    """A table of points (n, 3) [m]."""
    values = np.asarray(points, dtype=float).reshape(-1, 3)
    table = pd.DataFrame(values, columns=list("xyz"))
    table.insert(0, "label", list(labels))
    table["description"] = [""] * len(values) if descriptions is None else list(descriptions)
    return table


def read_text(path: str | Path, kind: str) -> str:
    """A Slicer file's text.

    Raises:
        PlumblineError: It cannot be read, or is no UTF-8; `kind` is what was expected.
    """
    file = Path(path).name
    try:
        return read_file(path).decode("utf-8-sig")
    except OSError as error:
        raise refusal(file, f"no readable file ({reason(error)})", kind, "mend the path") from None
    except UnicodeDecodeError:
        raise refusal(file, "no UTF-8 text", kind, "save it in Slicer again") from None
