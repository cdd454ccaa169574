"""``plumbline handeye FOLDER``: where a range finder's beam sits on the flange."""

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
