"""``plumbline handeye FOLDER`` and ``plumbline scan FOLDER``: a range finder on an arm.

Where its beam sits on the flange; a block's face angles, and a scan laid on the surface of CT.
"""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.pages import hand_out
from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, Report, check_outputs


def handeye(
    folder: Annotated[Path, typer.Argument(help="A recording of kind plane_range.")],
    json: Json = None,
    poses: Annotated[
        int, typer.Option("--next", min=0, max=50, help="How many next poses to suggest.")
    ] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the next poses' candidates.")] = 0,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate a range finder on an arm from readings on planes."""
    check_outputs({"--json": json, "--report": report}, [folder], overwrite=overwrite)
    from plumbline.optim.hand_eye.answer import hand_eye
    from plumbline.optim.hand_eye.calibrate import HandEyeOptions

    found = hand_eye(folder, HandEyeOptions(poses=poses, seed=seed))
    hand_out(found, found.to_dict(), json, report, quiet)


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
