"""What is wrong with a pointing task: one line with the value, the limit and the way out."""

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.constants import ORTHONORMAL, ROUNDING


def array(value: ArrayLike, name: str, shape: tuple[int, ...], hint: str) -> Array:
    """A finite array of a shape; refused if it is none."""
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise PlumblineError(f"{name}: numbers of shape {shape} expected; {hint}") from None
    if found.shape != shape:
        raise PlumblineError(f"{name}: shape {found.shape}, {shape} expected; {hint}")
    if not np.isfinite(found).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(found))[0])
        raise PlumblineError(f"{name}: {found[where]} at {where}, finite numbers expected; {hint}")
    return found


def rigid(matrix: ArrayLike, name: str) -> Array:
    """A rigid transform (4, 4) [m]; refused if it is none, saying by how much."""
    T = array(matrix, name, (4, 4), "give a homogeneous matrix, translation in m")
    R = T[:3, :3]
    off = float(np.abs(R.T @ R - np.eye(3)).max())
    if off > ORTHONORMAL or np.linalg.det(R) < 0.0:
        what = "a mirror" if np.linalg.det(R) < 0.0 else f"off a rotation by {off:.1e}"
        raise PlumblineError(f"{name}: {what}, {ORTHONORMAL:.0e} allowed; give a rigid transform")
    if np.abs(T[3] - [0, 0, 0, 1]).max() > ROUNDING:
        last = f"last row {T[3].round(6).tolist()}, [0, 0, 0, 1] expected"
        raise PlumblineError(f"{name}: {last}; transpose it, or give a rigid transform")
    return T
