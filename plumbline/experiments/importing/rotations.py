"""Rotations as a laboratory writes them, as unit quaternions, scalar first."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError, shown
from plumbline.experiments.importing import targets
from plumbline.experiments.importing.tables import Array

ROUNDED = 1e-3  # [1] off orthonormal: five times what four decimals leave
ENTRIES = (12, 16)  # of the upper three rows, of all four


def turned(table: pd.DataFrame, rotation: str) -> pd.DataFrame:
    """``rx,ry,rz`` of a table, a rotation vector or three angles, as ``qw,qx,qy,qz``.

    Raises:
        PlumblineError: One of them is missing, or there are no such axes.
    """
    missing = [name for name in targets.ROTATION if name not in table]
    if missing:
        raise PlumblineError(f"rx without {', '.join(missing)}: expected all of rx, ry, rz")
    angles = table[list(targets.ROTATION)].to_numpy(dtype=float, copy=True)
    try:
        found = (Rotation.from_rotvec(angles) if rotation == "rotvec"
                 else Rotation.from_euler(rotation, angles))  # fmt: skip
    except ValueError:
        raise PlumblineError(
            f"--rotation {rotation}: expected rotvec, or three axes such as xyz (fixed) or ZYX "
            "(moving)"
        ) from None
    return _with(table, targets.ROTATION, found)


def posed(table: pd.DataFrame, factor: float) -> pd.DataFrame:
    """``pose1..pose16`` (or 12), a rigid matrix a row, as ``x,y,z`` [m] and a quaternion.

    Whether rows or columns come first is told by the order that makes them rigid in every row;
    ``factor`` is the unit [m] that all columns were multiplied with. Else refused.
    """
    names = [str(c) for c in table if str(c).startswith("pose")]
    doubled = [c for c in (*"xyz", *targets.QUATERNION, *targets.ROTATION) if c in table]
    if names != [f"pose{k}" for k in range(1, len(names) + 1)] or len(names) not in ENTRIES:
        raise PlumblineError(f"pose: found {', '.join(names)}, expected pose1.. to 12 or to 16")
    if doubled:
        raise PlumblineError(f"pose and {doubled[0]}: both tell where the tip is; map one of them")
    entries = table[names].to_numpy(dtype=float)
    R, t = _rigid(entries, factor)
    placed = table.assign(**dict(zip("xyz", t.T, strict=True)))
    return _with(placed, names, Rotation.from_matrix(R))


def _rigid(entries: Array, factor: float) -> tuple[Array, Array]:
    """Rotations (N, 3, 3) and places (N, 3) [m] of whichever order is rigid."""
    N, count = entries.shape
    orders = (
        entries.reshape(N, count // 4, 4),
        entries.reshape(N, 4, count // 4).transpose(0, 2, 1),
    )
    off = [_off(T / factor) for T in orders]
    best = int(off[1].max() < off[0].max())
    if not off[best].max() <= ROUNDED or off[1 - best].max() <= ROUNDED:
        row = int(off[best].argmax())
        raise PlumblineError(
            f"pose: {shown(entries[row].tolist())}: found {off[best][row]:.2g} away from a rigid "
            f"4 x 4 matrix, expected {ROUNDED:g} and this of one order, rows or columns first"
        )
    T = orders[best]
    return T[:, :3, :3] / factor, T[:, :3, 3]


def _off(T: Array) -> Array:
    """How far each matrix (N, 3 or 4, 4) is from a rigid one, the largest entry (N,)."""
    R = T[:, :3, :3]
    bent = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    last = np.abs(T[:, 3:] - np.eye(4)[3]).max(axis=(1, 2), initial=0.0)
    return np.maximum(np.maximum(bent, last), np.abs(np.linalg.det(R) - 1.0))


def _with(table: pd.DataFrame, old: Sequence[str], found: Rotation) -> pd.DataFrame:
    """A table with quaternions in place of other columns."""
    quaternion = found.as_quat(canonical=True)[:, [3, 0, 1, 2]]
    return table.drop(columns=list(old)).assign(
        **dict(zip(targets.QUATERNION, quaternion.T, strict=True))
    )
