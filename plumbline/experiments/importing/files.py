"""Files of a laboratory into a recording in one call: the command ``import``, unasked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plumbline.experiments.importing import reading, tables, writing
from plumbline.experiments.importing.asked import asked
from plumbline.experiments.importing.understood import understand
from plumbline.optim.loading import load


def import_files(
    files: str | Path | Sequence[str | Path],
    to: str | Path,
    columns: Mapping[str, str] | None = None,
    **options: Any,
) -> Any:
    """Files as a recording's folder, and that recording, checked.

    Args:
        files: CSV, Parquet, MATLAB, bags or MCAP.
        to: The folder; it must not exist, or be empty.
        columns: What columns mean, ``{"q#": "J#:deg", "x": "tip x:mm"}``.
        **options: ``units``, ``observation``, ``robot``, ``tip_frame``, ``tool``, ``noise``,
            ``gap``, ``shift``, ``derive``, ``still``, ``rotation``, as the command's.

    Raises:
        PlumblineError: They cannot be understood, or make no recording; one line says why.
    """
    paths = [files] if isinstance(files, str | Path) else files
    target = Path(to)
    lines = [f"{name}={source}" for name, source in (columns or {}).items()]
    request = asked(options, lines, None)
    raws = tables.told_apart([raw for path in paths for raw in reading.read(Path(path))])
    found = understand(raws, request.request)
    settings = {"name": target.resolve().name, "observation": found.observation}
    return writing.write(found, settings | dict(request.settings), request.files, target, load)
