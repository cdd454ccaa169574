r"""A rigid or affine transform as ITK's text file (``.tfm``), the way Slicer reads and writes it.

.. math:: y = M (x - c) + c + b, \qquad M \text{ by rows, then } b, \text{ in Parameters; } c
          \text{ in FixedParameters}

Three things differ from a 4x4 matrix in m that maps CT to robot. Lengths are in mm. Axes are LPS; a
matrix of RAS coordinates is conjugated by diag(-1, -1, 1). And ITK stores the transform that
resamples an image, which takes points of the *fixed* frame to the *moving* one, the inverse of the
one that moves points: Slicer shows the file as "transform from parent" and its inverse as
"transform to parent". So the file of ``T_RC`` holds ``T_CR``, and a transform node loaded from it
moves what it holds, the CT, into the robot's frame. The robot's own axes are taken along in the
same way as CT's.

HDF5 files (``.h5``), Slicer's usual form, are read through h5py if it is there:
``/TransformGroup/0`` holds ``TransformType``, ``TransformParameters`` and
``TransformFixedParameters``, which mean the same.
"""

from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault, shown
from plumbline.experiments.slicer.points import FLIP, UNITS, check_axes
from plumbline.kinematics.files import read_file, reason
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.problem import Array

HEAD = "#Insight Transform File V1.0"
KINDS = (
    "AffineTransform_double_3_3",
    "AffineTransform_float_3_3",
    "MatrixOffsetTransformBase_double_3_3",
    "MatrixOffsetTransformBase_float_3_3",
)
GROUP = "TransformGroup"


def tfm_text(T_RC: ArrayLike, axes: str = "LPS") -> str:
    """The file's text for a transform (4, 4) [m], refused if singular, from CT to the robot."""
    T = np.asarray(T_RC, dtype=float)
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.allclose(T[3], (0, 0, 0, 1)):
        mend = "give rotation and translation over the row 0, 0, 0, 1"
        raise fault("transform", f"shape {T.shape}", "a finite (4, 4)", mend)
    if abs(np.linalg.det(T[:3, :3])) < 1e-12:
        raise fault("transform", "a matrix of rank below 3", "one with an inverse", "mend it")
    back = along(np.linalg.inv(T), axes, axes)
    numbers = [*back[:3, :3].ravel(), *(back[:3, 3] / UNITS["mm"])]
    parameters = " ".join(repr(float(value)) for value in numbers)
    lines = [HEAD, "#Transform 0", f"Transform: {KINDS[0]}", f"Parameters: {parameters}"]
    return "\n".join([*lines, "FixedParameters: 0 0 0", ""])


def read_tfm(path: str | Path, axes: str = "LPS") -> Array:
    """The one affine transform (4, 4) [m], else refused, that moves points along the axes asked."""
    file = Path(path).name
    try:
        text = read_file(path).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        found = f"no readable text ({reason(error)})"
        raise fault(file, found, "a .tfm", "save it as text in Slicer again") from None
    said = [line.partition(":") for line in text.splitlines() if not line.startswith("#")]
    check_kinds(file, [value.strip() for key, _, value in said if key.strip() == "Transform"])
    fields = {key.strip(): value for key, _, value in said}
    numbers = _numbers(file, fields, "Parameters", 12)
    return moving(file, numbers, _numbers(file, fields, "FixedParameters", 3), axes)


def check_kinds(file: str, kinds: list[str]) -> None:
    """Refuse all but one affine transform."""
    if len(kinds) != 1 or kinds[0] not in KINDS:
        found = ", ".join(kinds) or "no transform"
        mend = "harden the transform and save one linear transform"
        raise fault(f"{file}, Transform", shown(found), f"one {KINDS[0]}", mend)


def moving(file: str, numbers: Array, centre: Array, axes: str) -> Array:
    """The transform (4, 4) [m] that moves points, of ITK's parameters (12,) and centre (3,)."""
    A = numbers[:9].reshape(3, 3)
    back = homogeneous(A, (numbers[9:] + centre - A @ centre) * UNITS["mm"])
    if abs(np.linalg.det(back[:3, :3])) < 1e-12:
        raise fault(f"{file}, Parameters", "a matrix of rank below 3", "an inverse", "mend it")
    return along(np.linalg.inv(back).astype(np.float64), axes, axes)


def along(T: Array, ct_axes: str, robot_axes: str) -> Array:
    """A transform (4, 4) of LPS coordinates for other axes of CT and robot, or back."""
    turned = T.copy()
    if check_axes(ct_axes) == "RAS":
        turned[:3, :3] = turned[:3, :3] @ FLIP
    if check_axes(robot_axes) == "RAS":
        turned[:3] = FLIP @ turned[:3]
    return turned


def _numbers(file: str, fields: dict[str, str], key: str, count: int) -> Array:
    where = f"{file}, {key}"
    if key not in fields:
        raise fault(where, "nothing", f"{count} numbers", "save it in Slicer again")
    try:
        values = np.array([float(word) for word in fields[key].split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise fault(where, shown(fields[key].strip()), f"{count} numbers", "mend the line")
    return values


def read_h5(path: str | Path, axes: str = "LPS") -> Array:
    """The same of an HDF5 file (PlumblineError: no h5py, or no single affine transform)."""
    file = Path(path).name
    try:
        h5py = import_module("h5py")
    except ImportError:
        mend = "save it in Slicer as .tfm (text), or install h5py"
        raise fault(file, "HDF5, and no h5py to read it", "a .tfm", mend) from None
    try:
        data = BytesIO(read_file(path))
    except (OSError, ValueError) as error:
        found = f"no readable file ({reason(error)})"
        raise fault(file, found, "ITK's HDF5", "mend the path") from None
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
        raise fault(file, found, "ITK's HDF5", "save it in Slicer as .tfm (text)") from None
    except UnicodeDecodeError:
        raise fault(file, "no text", "ITK's HDF5", "save it in Slicer as .tfm (text)") from None
    if numbers.shape != (12,) or centre.shape != (3,) or not np.isfinite(numbers).all():
        found = f"{numbers.size} and {centre.size} numbers"
        raise fault(file, found, "12 and 3 finite ones", "save it in Slicer as .tfm (text)")
    return moving(file, numbers, centre, axes)


def _word(value: Any) -> str:
    """A text of HDF5, which may be an array of one text."""
    text = np.asarray(value[()]).ravel()[0]
    return text.decode() if isinstance(text, bytes) else str(text)
