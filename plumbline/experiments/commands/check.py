"""``plumbline check FOLDER``: can this recording be used? If not, why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from plumbline.experiments.commands.out import Out, with_out

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.motion.recording import MotionRecording
    from plumbline.optim.hand_eye.recording import RangeRecording
    from plumbline.optim.hand_eye.scan_recording import ScanRecording
    from plumbline.optim.recording.loading import Folder
    from plumbline.optim.recording.recording import Recording
    from plumbline.optim.recording.session import SessionFile
    from plumbline.optim.registration.fiducials import Fiducials


@with_out
def check(
    out: Out, folder: Annotated[Path, typer.Argument(help="A recording, or a session of several.")]
) -> None:
    """Read and check a recording of any kind; say what is in it, what is odd and what reads it."""
    out.check([folder])
    out.say(*examined(folder))


def examined(folder: Path) -> tuple[dict[str, Any], str]:
    """What is in a recording of any kind, for JSON and in words; refused if it is none."""
    from plumbline.optim.loading import load, load_to_diagnose
    from plumbline.optim.recording.loading import open_folder
    from plumbline.optim.recording.session import is_session, open_session

    if is_session(folder):
        return _session(open_session(folder))
    opened = open_folder(folder)
    kind = opened.settings.word("observation") or ""
    told: dict[str, Callable[[Any], dict[str, Any]]] = {
        "plane_range": _ranges,
        "surface_scan": _scan,
        "fiducials": _fiducials,
    }
    if kind in ("motion", "tracking"):
        return _motion(load(folder))
    if kind == "fiducials" and _touched_again(opened):
        return _diagnosable(load_to_diagnose(folder))
    if kind in told:
        found = load(folder)
        facts = told[kind](found) | {"sha256": found.sha256, "notes": list(found.notes)}
        return _elsewhere(kind, found.name, facts)
    return _diagnosable(load(folder))


def _touched_again(opened: Folder) -> bool:
    """Whether a marker has several rows, which ``diagnose`` alone reads."""
    labels = opened.table.columns.get("label", ())
    return len({label.strip() for label in labels}) < len(labels)


def _facts(recording: Recording | MotionRecording, joints: Sequence[str]) -> dict[str, Any]:
    """What recordings that ``diagnose`` reads have in common."""
    return {
        "name": recording.name, "observation": recording.observation, "rows": len(recording),
        "robot": recording.robot.name, "joints": list(joints), "noise_std": recording.noise_std,
        "sha256": recording.sha256, "notes": list(recording.notes),
        "command": "plumbline diagnose FOLDER",
    }  # fmt: skip


def _diagnosable(recording: Recording) -> tuple[dict[str, Any], str]:
    content = _facts(recording, recording.chain.joint_names) | {"tip_frame": recording.tip_frame}
    if recording.noise_by_joint is not None:
        content["noise_by_joint"] = recording.noise_by_joint.tolist()
    words = recording.describe()
    if recording.stand_in:
        content |= {"robot": None, "joints": [], "tip_frame": None}
        words += "\nread by  plumbline diagnose FOLDER"
    return content, words


def _session(session: SessionFile) -> tuple[dict[str, Any], str]:
    from plumbline.optim.core.quantities import counted
    from plumbline.optim.diagnosis.motion.recording import MotionRecording
    from plumbline.optim.diagnosis.several.sections import refuse_unlike
    from plumbline.optim.loading import parts_of_session

    found = parts_of_session(session)
    refuse_unlike(found, session.shared)
    motion = [isinstance(part, MotionRecording) for part in found]
    parts = [(_motion if m else _diagnosable)(p) for p, m in zip(found, motion, strict=True)]
    content = {
        "name": session.name,
        "recordings": [facts for facts, _ in parts],
        "shared": list(session.shared),
        "command": "plumbline diagnose FOLDER",
    }
    shared = f", shared: {', '.join(session.shared)}" if session.shared else ""
    head = f"Session {session.name!r}: {counted(len(parts), 'recording')}{shared}"
    return content, "\n\n".join([head, *(words for _, words in parts)])


def _motion(recording: MotionRecording) -> tuple[dict[str, Any], str]:
    content = _facts(recording, recording.joints) | {"commands": str(recording.law)}
    return content, f"{recording.describe()}\n{'read by':<13}{content['command']}"


def _ranges(found: RangeRecording) -> dict[str, Any]:
    chain, marks, held = found.chain, found.marks, found.held_out
    return {
        "rows": len(found.readings),
        "planes": len(found.readings.planes),
        "marked": 0 if marks is None else len(marks.mark),
        "held_out": 0 if held is None else len(held),
        "joints": [] if chain is None else list(chain.joint_names),
        "tip_frame": None if chain is None else chain.tip_frame,
        "noise_std": found.noise_std,
    }


def _scan(found: ScanRecording) -> dict[str, Any]:
    return {
        "rows": len(found),
        "faces": list(found.labels),
        "surface": 0 if found.surface is None else len(found.surface),
        "targets": list(found.target_labels),
    }


def _fiducials(found: Fiducials) -> dict[str, Any]:
    """Refused where registration would refuse the markers: on one line, mirrored, exchanged."""
    from plumbline.optim.registration import checks

    checks.check(found.checked())
    return {
        "rows": len(found.markers) + len(found.targets),
        "markers": list(found.markers.labels),
        "targets": list(found.targets.labels),
        "noise_stated": found.noise is not None,
    }


def _elsewhere(kind: str, name: str, facts: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """A recording that another command reads, in words of the same shape."""
    from plumbline.optim.recording.kinds import ELSEWHERE

    content, command = {"name": name, "observation": kind, **facts}, ELSEWHERE[kind].command
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
