"""Triangles of a file: STL, OBJ or PLY, as coal reads them."""

from pathlib import Path
from typing import Any

import coal
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array, Integers


def triangles_of(file: Path, largest: int) -> tuple[Array, Integers]:
    """Corners (V, 3) in the file's unit, and three of them each (F, 3), or refuse.

    A file of more than the ``largest`` number of bytes is refused, too.
    """
    if not file.is_file():
        raise PlumblineError(f"mesh {str(file)!r}: no regular file; give an STL, OBJ or PLY")
    if file.stat().st_size > largest:
        raise PlumblineError(
            f"mesh {file.name!r}: {file.stat().st_size} bytes, at most {largest}; "
            "decimate the surface"
        )
    loader: Any = coal.MeshLoader()
    try:
        model = loader.load(str(file))
    except (ValueError, RuntimeError) as fault:
        said = " ".join(str(fault).split(str(file))[-1].split("Hint")[0].split())
        why = said.strip(" .:\"'")[:120] or "no surface that can be read"
        raise PlumblineError(f"mesh {file.name!r}: {why}; give an STL, OBJ or PLY") from None
    faces = [[model.tri_indices(k)[i] for i in range(3)] for k in range(model.num_tris)]
    return np.array(model.vertices()).reshape(-1, 3), np.array(faces, dtype=np.int64)
