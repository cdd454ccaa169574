"""``plumbline scan FOLDER``: a block's face angles, and a scan laid on the surface of CT."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.pages import print_answer, write_page
from plumbline.experiments.console.outputs import (
    Json,
    Quiet,
    Report,
    check_distinct,
    check_output,
    talks,
    write_json,
)


def scan(
    folder: Annotated[Path, typer.Argument(help="A recording of kind surface_scan.")],
    beam: Annotated[
        Path | None,
        typer.Option(metavar="HANDEYE.json", help="The beam, as handeye --json wrote it."),
    ] = None,
    json: Json = None,
    report: Report = None,
    quiet: Quiet = False,
) -> None:
    """Rebuild a scan; say the angles of its faces, or where CT lies for the robot."""
    check_output(json, "--json", [folder])
    check_output(report, "--report", [folder])
    check_distinct({"--json": json, "--report": report})
    from plumbline.optim.hand_eye.scan import ScanOptions
    from plumbline.optim.hand_eye.scan import scan as rebuild
    from plumbline.optim.hand_eye.scan_recording import beam_from_json, load_scan

    recording = load_scan(folder)
    given = ScanOptions() if beam is None else ScanOptions(*beam_from_json(beam))
    answer = rebuild(recording, given)
    write_json(json, answer.to_dict())
    write_page(report, answer)
    if talks(json, quiet):
        print_answer(answer)
