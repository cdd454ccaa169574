r"""Noise that differs from axis to axis and from row to row, as one number and a shape about it.

.. math:: \sigma_{na} = \sigma\, s_{na}, \qquad \frac1{N k} \sum_{n,a} s_{na}^2 = 1

A residual is divided by its shape, so that all of them have the one noise :math:`\sigma` again.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault, shown
from plumbline.optim.recording.constants import LARGEST, TIP_AXES
from plumbline.optim.recording.origin import Array, Origin


def with_noise_shape(
    context: dict[str, Any], observation: str, rows: int, joints: int, origin: Origin
) -> dict[str, Any]:
    """The context with ``noise_axes`` and ``noise_rows`` made into ``noise_std`` and its shape.

    Args:
        context: What a recording is made of; ``noise_axes`` (k,) and ``noise_rows`` (N,) are 1
            sigma of an axis [m, or rad or m of a joint]. Given both, the axes' ratios count.
        observation: Kind of observation.
        rows: N.
        joints: n, whose second encoders or efforts are the axes of their kinds.
        origin: Where they were read.

    Raises:
        PlumblineError: A number is not positive, or there are too few or too many.
    """
    axes, each = context.pop("noise_axes", None), context.pop("noise_rows", None)
    if axes is None and each is None:
        return context
    size = joints if observation in ("joint_position", "joint_torque") else TIP_AXES
    across = np.ones(size) if axes is None else _positive(axes, "noise_std", size, origin)
    along = np.ones(rows) if each is None else _positive(each, "noise_std", rows, origin)
    if observation not in ("tip_position", "pose", "joint_position") and axes is not None:
        found = f"{size} axes of {observation}"
        raise fault("noise_std", found, "one number", "its axes are not an instrument's")
    spread = np.sqrt(np.mean(across**2))
    whole = float(spread if each is None else np.sqrt(np.mean(along**2)))
    ratio = np.outer(along / np.sqrt(np.mean(along**2)), across / spread)
    if observation == "pose":  # of rotations the axes are not told apart
        ratio = np.hstack([ratio, np.tile(ratio.mean(axis=1, keepdims=True), 3)])
    return {**context, "noise_std": whole, "noise_shape": ratio}


def _positive(values: ArrayLike, name: str, size: int, origin: Origin) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (size,):
        raise fault(name, f"{array.size} numbers", f"{size}", "give one for each, or one for all")
    broken = np.flatnonzero(~((array > 0.0) & (array < LARGEST)))
    if len(broken):
        where = origin.at(name, broken[0]) if origin.lines is not None else name
        raise fault(where, shown(float(array[broken[0]])), "a positive number", "give 1 sigma")
    return array
