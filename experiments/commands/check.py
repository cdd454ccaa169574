"""``plumbline check FOLDER``: can this recording be used? If not, why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands import Json, Quiet, check_output, talks, write_json


def check(
    folder: Annotated[Path, typer.Argument(help="A recording: dataset.toml and samples.csv.")],
    json: Json = None,
    quiet: Quiet = False,
) -> None:
    """Read and check a recording; say what is in it and what is odd."""
    check_output(json, "--json", [folder])
    from optim.loading import load_recording

    recording = load_recording(folder)
    write_json(
        json,
        {
            "name": recording.name,
            "observation": recording.observation,
            "rows": len(recording),
            "robot": recording.robot.name,
            "joints": list(recording.chain.joint_names),
            "tip_frame": recording.tip_frame,
            "noise_std": recording.noise_std,
            "sha256": recording.sha256,
            "notes": list(recording.notes),
        },
    )
    if talks(json, quiet):
        typer.echo(recording.describe())
