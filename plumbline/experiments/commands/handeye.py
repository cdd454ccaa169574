"""``plumbline handeye FOLDER`` and ``plumbline scan FOLDER``: a range finder on an arm.

Where its beam sits on the flange; a block's face angles, and a scan laid on the surface of CT.
"""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.out import Out, with_report


@with_report
def handeye(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="A recording of kind plane_range.")],
    poses: Annotated[
        int, typer.Option("--next", min=0, max=50, help="How many next poses to suggest.")
    ] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the next poses' candidates.")] = 0,
) -> None:
    """Calibrate a range finder on an arm from readings on planes."""
    out.check([folder])
    from plumbline.optim.hand_eye.answer import hand_eye
    from plumbline.optim.hand_eye.calibrate import HandEyeOptions

    found = hand_eye(folder, HandEyeOptions(poses=poses, seed=seed))
    out.hand_out(found, found.to_dict())


@with_report
def scan(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="A recording of kind surface_scan.")],
    beam: Annotated[
        Path | None,
        typer.Option(metavar="HANDEYE.json", help="The beam, as handeye --json wrote it."),
    ] = None,
) -> None:
    """Rebuild a scan; say the angles of its faces, or where CT lies for the robot."""
    out.check([folder])
    from plumbline.optim.hand_eye.scan import ScanOptions
    from plumbline.optim.hand_eye.scan import scan as rebuild
    from plumbline.optim.hand_eye.scan_recording import beam_from_json, load_scan

    recording = load_scan(folder)
    given = ScanOptions() if beam is None else ScanOptions(*beam_from_json(beam))
    answer = rebuild(recording, given)
    out.hand_out(answer, answer.to_dict())
