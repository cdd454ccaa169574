"""Files of a laboratory into a recording in one call: the command ``import``, unasked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

from plumbline.experiments.importing import reading, tables, writing
from plumbline.experiments.importing.asked import asked
from plumbline.experiments.importing.understood import understand
from plumbline.optim.loading import load


class Asked(TypedDict, total=False):
    """What else an import may be told, as by the command's options of these names."""

    units: str | Sequence[str]  # of what has none of its own; else SI
    observation: str  # kind of recording, where columns tell not
    robot: str  # a known one's name, or a file of URDF or MJCF
    tip_frame: str
    tool: str  # the tip in the tip frame, "0,0,200mm"
    noise: str | float  # the instrument's 1 sigma per axis, "0.1mm" or m
    gap: float  # [s] within which readings of several files belong together
    shift: Mapping[str, float]  # [s] to add to a file's clock
    derive: str | Sequence[str]  # what to derive from the path: velocity, acceleration, direction
    still: float  # [rad] of motion that counts as none
    rotation: str  # how rx, ry, rz turn: rotvec, xyz, ZYX, ...


def import_files(
    files: str | Path | Sequence[str | Path],
    to: str | Path,
    columns: Mapping[str, str] | None = None,
    **options: Unpack[Asked],
) -> Any:
    """Files as a recording's folder, and that recording, checked.

    Args:
        files: CSV, Parquet, MATLAB, bags or MCAP.
        to: The folder; it must not exist, or be empty.
        columns: What columns mean, ``{"q#": "J#:deg", "x": "tip x:mm"}``.
        **options: ``units``, ``robot``, ``noise``, ...: see :class:`Asked`.

    Raises:
        PlumblineError: They cannot be understood, or make no recording; one line says why.
    """
    paths = [files] if isinstance(files, str | Path) else files
    target = Path(to)
    lines = [f"{name}={source}" for name, source in (columns or {}).items()]
    raws = tables.told_apart([raw for path in paths for raw in reading.read(Path(path))])
    request = asked(options, lines, None, raws)
    found = understand(raws, request.request)
    settings = writing.described(target, found, request.settings)
    return writing.write(found, settings, request.files, target, load)
