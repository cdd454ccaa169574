"""``plumbline scan FOLDER``: a block's face angles, and a scan laid on the surface of CT."""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.pages import hand_out
from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, Report, check_outputs


def scan(
    folder: Annotated[Path, typer.Argument(help="A recording of kind surface_scan.")],
    beam: Annotated[
        Path | None,
        typer.Option(metavar="HANDEYE.json", help="The beam, as handeye --json wrote it."),
    ] = None,
    json: Json = None,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Rebuild a scan; say the angles of its faces, or where CT lies for the robot."""
    check_outputs({"--json": json, "--report": report}, [folder], overwrite=overwrite)
    from plumbline.optim.hand_eye.scan import ScanOptions
    from plumbline.optim.hand_eye.scan import scan as rebuild
    from plumbline.optim.hand_eye.scan_recording import beam_from_json, load_scan

    recording = load_scan(folder)
    given = ScanOptions() if beam is None else ScanOptions(*beam_from_json(beam))
    answer = rebuild(recording, given)
    hand_out(answer, answer.to_dict(), json, report, quiet)
