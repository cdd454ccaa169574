"""A transform as ITK's HDF5 file (``.h5``), Slicer's usual form: read through h5py if it is there.

``/TransformGroup/0`` holds ``TransformType``, ``TransformParameters`` and
``TransformFixedParameters``, which mean what they mean in a ``.tfm``; see
:mod:`plumbline.experiments.slicer.tfm`.
"""

from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.experiments.slicer.points import refusal
from plumbline.experiments.slicer.tfm import check_kinds, moving
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.core.problem import Array

GROUP = "TransformGroup"


def read_h5(path: str | Path, axes: str = "LPS") -> Array:
    """The transform (4, 4) [m] that moves points, "to parent", along the axes asked for.

    Raises:
        PlumblineError: There is no h5py, or the file holds no single affine transform.
    """
    file = Path(path).name
    try:
        h5py = import_module("h5py")
    except ImportError:
        mend = "save it in Slicer as .tfm (text), or install h5py"
        raise refusal(file, "HDF5, and no h5py to read it", "a .tfm", mend) from None
    try:
        data = BytesIO(read_file(path))
    except (OSError, ValueError) as error:
        found = f"no readable file ({reason(error)})"
        raise refusal(file, found, "ITK's HDF5", "mend the path") from None
    try:
        with h5py.File(data, "r") as content:
            group = content[GROUP]
            kinds = [_word(group[key]["TransformType"]) for key in sorted(group)]
            check_kinds(file, kinds)
            (key,) = group
            numbers = np.array(group[key]["TransformParameters"], dtype=float).ravel()
            centre = np.array(group[key]["TransformFixedParameters"], dtype=float).ravel()
    except (OSError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        found = f"no transform ({type(error).__name__})"
        raise refusal(file, found, "ITK's HDF5", "save it in Slicer as .tfm (text)") from None
    except UnicodeDecodeError:
        raise refusal(file, "no text", "ITK's HDF5", "save it in Slicer as .tfm (text)") from None
    if numbers.shape != (12,) or centre.shape != (3,) or not np.isfinite(numbers).all():
        found = f"{numbers.size} and {centre.size} numbers"
        raise refusal(file, found, "12 and 3 finite ones", "save it in Slicer as .tfm (text)")
    return moving(file, numbers, centre, axes)


def _word(value: Any) -> str:
    """A text of HDF5, which may be an array of one text."""
    text = np.asarray(value[()]).ravel()[0]
    return text.decode() if isinstance(text, bytes) else str(text)
