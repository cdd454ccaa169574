"""``plumbline check FOLDER``: can this recording be used? If not, why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from plumbline.experiments.console.outputs import Json, Quiet, check_output, talks, write_json


def check(
    folder: Annotated[Path, typer.Argument(help="A recording: dataset.toml and samples.csv.")],
    json: Json = None,
    quiet: Quiet = False,
) -> None:
    """Read and check a recording of any kind; say what is in it, what is odd and what reads it."""
    check_output(json, "--json", [folder])
    from plumbline.optim.recording.loading import open_folder

    kind = open_folder(folder).settings.word("observation")
    said = {
        "plane_range": _ranges,
        "surface_scan": _scan,
        "fiducials": _fiducials,
        "tracking": _tracking,
    }
    content, words = said.get(kind or "", _diagnosable)(folder)
    write_json(json, content)
    if talks(json, quiet):
        print(words)


def _diagnosable(folder: Path) -> tuple[dict[str, Any], str]:
    """A recording that ``diagnose`` reads, for JSON and in words."""
    from plumbline.optim.recording.loading import load_recording

    recording = load_recording(folder)
    content = {
        "name": recording.name,
        "observation": recording.observation,
        "rows": len(recording),
        "robot": recording.robot.name,
        "joints": list(recording.chain.joint_names),
        "tip_frame": recording.tip_frame,
        "noise_std": recording.noise_std,
        "sha256": recording.sha256,
        "notes": list(recording.notes),
        "command": "plumbline diagnose FOLDER",
    }
    return content, recording.describe()


def _ranges(folder: Path) -> tuple[dict[str, Any], str]:
    from plumbline.optim.hand_eye.recording import load_ranges

    found = load_ranges(folder)
    chain, marks, held = found.chain, found.marks, found.held_out
    return _elsewhere(
        {
            "name": found.name,
            "observation": "plane_range",
            "rows": len(found.readings),
            "planes": len(found.readings.planes),
            "marked": 0 if marks is None else len(marks.mark),
            "held_out": 0 if held is None else len(held),
            "joints": [] if chain is None else list(chain.joint_names),
            "tip_frame": None if chain is None else chain.tip_frame,
            "noise_std": found.noise_std,
            "sha256": found.sha256,
            "notes": list(found.notes),
        }
    )


def _scan(folder: Path) -> tuple[dict[str, Any], str]:
    from plumbline.optim.hand_eye.scan_recording import load_scan

    found = load_scan(folder)
    return _elsewhere(
        {
            "name": found.name,
            "observation": "surface_scan",
            "rows": len(found),
            "faces": list(found.labels),
            "surface": 0 if found.surface is None else len(found.surface),
            "targets": list(found.target_labels),
            "sha256": found.sha256,
            "notes": list(found.notes),
        }
    )


def _fiducials(folder: Path) -> tuple[dict[str, Any], str]:
    from plumbline.optim.registration.fiducials import load_fiducials

    found = load_fiducials(folder)
    return _elsewhere(
        {
            "name": found.name,
            "observation": "fiducials",
            "rows": len(found.markers) + len(found.targets),
            "markers": list(found.markers.labels),
            "targets": list(found.targets.labels),
            "noise_stated": found.noise is not None,
            "sha256": found.sha256,
            "notes": list(found.notes),
        }
    )


def _tracking(folder: Path) -> tuple[dict[str, Any], str]:
    from plumbline.optim.recording.columns import elsewhere_columns
    from plumbline.optim.recording.loading import open_folder

    opened = open_folder(folder)
    table = opened.table
    elsewhere_columns(table, "tracking")
    table.block(list(table.columns))
    return _elsewhere(
        {
            "name": opened.name,
            "observation": "tracking",
            "rows": len(table),
            "columns": list(table.columns),
            "notes": list(table.notes),
        }
    )


def _elsewhere(content: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """A recording that another command reads, in words of the same shape."""
    from plumbline.optim.recording.kinds import ELSEWHERE

    command = ELSEWHERE[content["observation"]].command
    facts = {k.replace("_", " "): v for k, v in content.items() if k not in ("name", "notes")}
    facts["sha256"] = content.get("sha256", "")[:12]
    facts["read by"] = command
    width = max(map(len, facts))
    lines = [f"{key:<{width}}  {_cell(value)}" for key, value in facts.items() if _cell(value)]
    notes = [f"note: {note}" for note in content["notes"]]
    words = "\n".join([f"Recording {content['name']!r}", *lines, *notes])
    return {**content, "command": command}, words


def _cell(value: object) -> str:
    """A fact in words; nothing where there is nothing to say."""
    from plumbline.errors import listed

    if isinstance(value, list):
        return listed(value)
    return "" if value is None else str(value)
