r"""A surface as points: ``surface.csv`` with x, y, z, or the triangles of ``surface.stl``.

A triangle a, b, c gives points even over its area,

.. math:: p = (1 - \sqrt{u})\, a + \sqrt{u} (1 - w)\, b + \sqrt{u}\, w\, c, \qquad u, w \sim U(0, 1)

(Osada et al. 2002), so many that neighbours lie closer together than a spot is wide.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plumbline.errors import fault
from plumbline.optim.hand_eye.constants import LARGEST_SURFACE, LEAST_SURFACE, SURFACE_POINTS
from plumbline.optim.recording.loading import read_bytes
from plumbline.optim.recording.origin import Array
from plumbline.optim.recording.table import read_table


def surface_points(place: Path, metres: float) -> Array | None:
    """Points (M, 3) [m] of the surface in a folder; None without one.

    Args:
        place: The folder.
        metres: Metres in the files' unit.

    Raises:
        PlumblineError: The file is no surface, or in another unit.
    """
    csv, stl = "surface.csv", "surface.stl"
    if (place / csv).exists():
        name, table = csv, read_table(csv, read_bytes(place, csv))
        table.require(("x", "y", "z"))
        points = table.block(("x", "y", "z"))
    elif (place / stl).exists():
        name, points = stl, sampled(triangles(read_bytes(place, stl)))
    else:
        return None
    points = points * metres
    if len(points) < LEAST_SURFACE:
        raise fault(name, f"{len(points)} points", f"{LEAST_SURFACE} or more", "give the surface")
    size = float(np.ptp(points, axis=0).max())
    if size > LARGEST_SURFACE:
        mend = 'looks like millimetres: write surface_unit = "mm" in dataset.toml'
        raise fault(name, f"a surface of {size:.4g} m", f"at most {LARGEST_SURFACE:g} m", mend)
    return points


def triangles(data: bytes) -> Array:
    """Triangles (T, 3, 3) of an STL file, binary or text.

    Raises:
        PlumblineError: It is neither, or a coordinate is not finite.
    """
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if count > 0 and len(data) == 84 + 50 * count:
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(data, kind, offset=84)["corners"].astype(float)
    else:
        corners = _from_text(data)
    if not len(corners) or not np.isfinite(corners).all():
        mend = "write it again, binary or as text"
        raise fault("surface.stl", "no triangles, or some that are not finite", "an STL file", mend)
    return corners


def _from_text(data: bytes) -> Array:
    words = [line.split() for line in data.decode("ascii", errors="replace").splitlines()]
    corners = [w[1:] for w in words if len(w) == 4 and w[0] == "vertex"]
    try:
        found = np.array(corners, dtype=float)
    except ValueError:
        return np.empty((0, 3, 3))
    return found.reshape(-1, 3, 3) if len(found) % 3 == 0 else np.empty((0, 3, 3))


def sampled(corners: Array) -> Array:
    """Points (`SURFACE_POINTS`, 3) even over triangles (T, 3, 3), the same in every run."""
    a, b, c = np.swapaxes(corners, 0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not area.sum() > 0.0:
        raise fault("surface.stl", "triangles without area", "a surface", "write it again")
    rng = np.random.default_rng(0)
    k = rng.choice(len(area), SURFACE_POINTS, p=area / area.sum())
    u, w = np.sqrt(rng.uniform(size=(SURFACE_POINTS, 1))), rng.uniform(size=(SURFACE_POINTS, 1))
    return np.asarray((1.0 - u) * a[k] + u * (1.0 - w) * b[k] + u * w * c[k])
