"""``plumbline apply MODEL FOLDER``: what was found on one recording, tried on another one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.console.outputs import (
    Json,
    Quiet,
    check_output,
    talks,
    write_json,
)

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.toml", help="What --model wrote.")]
Folder = Annotated[Path, typer.Argument(help="Another recording of the same robot.")]


def apply(model: ModelFile, folder: Folder, json: Json = None, quiet: Quiet = False) -> None:
    """Try a model on another recording: before, after, and whether it still holds."""
    check_output(json, "--json", [folder])
    from plumbline.optim.model import Model
    from plumbline.optim.model import apply as apply_model
    from plumbline.optim.recording.loading import load_recording

    found = apply_model(Model.load(model), load_recording(folder))
    write_json(json, {"model": str(model)} | found.to_dict())
    if talks(json, quiet):
        print(found.words)
        if found.left_out:
            print(f"Not carried over: {', '.join(found.left_out)}.")
        for note in found.judged.failures:
            print(f"Note: {note}.")
