"""``plumbline apply MODEL FOLDER``: what was found on one recording, tried on another one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.pages import write_page
from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, Report, check_outputs, say

if TYPE_CHECKING:
    from plumbline.optim.model import Applied

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.toml", help="What --model wrote.")]
Folder = Annotated[Path, typer.Argument(help="Another recording of the same robot.")]


def apply(
    model: ModelFile,
    folder: Folder,
    json: Json = None,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Try a model on another recording: before, after, and whether it still holds."""
    check_outputs({"--json": json, "--report": report}, [folder], overwrite=overwrite)
    found = _tried(model, folder)
    said = [f"Not carried over: {', '.join(found.left_out)}."] if found.left_out else []
    said += [f"Note: {note}." for note in found.judged.failures]
    write_page(report, found)
    content = {"model": str(model)} | found.to_dict()
    say(json, quiet, content, "\n".join([found.words, *said]))


def _tried(path: Path, folder: Path) -> Applied:
    from plumbline.optim.diagnosis.motion.recording import MotionRecording
    from plumbline.optim.loading import load, load_model, load_to_diagnose
    from plumbline.optim.model import Drives
    from plumbline.optim.model import apply as apply_model

    model = load_model(path)
    if not isinstance(model, Drives):
        return apply_model(model, load_to_diagnose(folder))
    other = load(folder)
    if not isinstance(other, MotionRecording):
        what = f"{folder}: found {other.observation}, expected a motion"
        raise PlumblineError(f"{what} as in {model.recording}; give a motion of the same drives")
    return model.tried(other)
