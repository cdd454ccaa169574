"""A registration for people and for JSON: the transform, the markers, the targets, the trust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from plumbline.experiments.slicer.given import Transformed
from plumbline.optim.core.quantities import counted
from plumbline.optim.registration import Registration
from plumbline.optim.registration.constants import DOUBTFUL

MM = 1e3


@dataclass(frozen=True)
class Refused:
    """A method of the comparison that these markers give nothing by."""

    method: str  # its name
    reason: str  # why, in one line


def content(
    answer: Registration,
    others: Sequence[Registration | Refused] = (),
    transforms: Sequence[Transformed] = (),
) -> dict[str, Any]:
    """The answer beside what other methods find, and transforms; lengths in m, angles in deg."""
    return {
        **answer.to_dict(),
        "methods": [_summary(other) for other in (answer, *others)],
        "transforms": [_elsewhere(answer, other) for other in transforms],
    }


def _summary(answer: Registration | Refused) -> dict[str, Any]:
    """One line of a comparison of methods."""
    if isinstance(answer, Refused):
        return {"method": answer.method, "refused": answer.reason}
    targets = answer.to_dict()["targets"]
    return {
        "method": answer.method,
        "refused": None,
        "used": [answer.labels[k] for k in answer.used],
        "fre": answer.fre,
        "calculation_error": answer.calculation_error,
        "tre_rms": {t["label"]: t["tre_rms"] for t in targets},
        "measured_error": {t["label"]: t["measured_error"] for t in targets},
    }


def _origin(answer: Registration) -> str:
    """Where the size of the noise is from."""
    if np.isinf(answer.dof):
        return "as stated"
    both = "as stated, mended by the misfits" if answer.surprise >= DOUBTFUL else "estimated"
    return f"{both}, {answer.dof:.0f} freedoms"


def _elsewhere(answer: Registration, other: Transformed) -> dict[str, Any]:
    """A transform found elsewhere: its misfit, and where it puts targets beside the answer."""
    recording, T = answer.recording, other.T_RC
    markers, targets = recording.markers, recording.targets
    left = markers.ct @ T[:3, :3].T + T[:3, 3] - markers.robot
    kept = [k for k, label in enumerate(markers.labels) if label not in answer.shifted]
    apart = targets.ct @ T[:3, :3].T + T[:3, 3] - answer.map(targets.ct)
    within = [
        bool(answer.tre(p).holds(d)[0]) if not answer.unknown else None
        for p, d in zip(targets.ct, apart, strict=True)
    ]
    return {
        "name": other.name,
        "inverted": other.inverted,
        "fre": float(np.sqrt(np.mean(np.sum(left[kept] ** 2, axis=1)))),
        "apart": dict(zip(targets.labels, np.linalg.norm(apart, axis=1).tolist(), strict=True)),
        "within95": dict(zip(targets.labels, within, strict=True)),
    }


def print_registration(answer: Registration, found: dict[str, Any]) -> None:
    """Print an answer and its content, lengths in mm but for the transform."""
    console = Console(highlight=False, soft_wrap=True)
    shape = answer.condition
    count = f"{len(answer.labels)} markers, {counted(len(answer.trust), 'target')}"
    console.print(
        f"[bold]{_plain(answer.recording.name)}[/bold]: {count}; method {answer.method}\n"
    )
    console.print("T_RC, from CT to robot (m)")
    for row in answer.T_RC:
        console.print("  " + "  ".join(f"{value:12.8f}" for value in row))
    misfits = ", ".join(f"{m['label']} {m['misfit'] * MM:.2f}" for m in found["markers"])
    spread = " × ".join(f"{value * MM:.0f}" for value in shape.spread)
    std = found["noise"]["std"] * MM
    fre, mean = answer.fre * MM, answer.calculation_error * MM
    console.print("\nMarkers")
    console.print(f"  FRE {fre:.2f} mm, mean misfit {mean:.2f} mm ({_plain(misfits)})")
    console.print(f"  best triple {shape.angle:.1f} deg (60 is best), spread {spread} mm")
    console.print(f"  noise of a misfit {std:.2f} mm per axis, {_origin(answer)}")
    _print_targets(console, found)
    _print_methods(console, found)
    for note in found["notes"]:
        console.print(f"• {_plain(note)}")


def _print_targets(console: Console, found: dict[str, Any]) -> None:
    if not found["targets"]:
        console.print("\nNo target rows: add one of role target to see how far to trust it there.")
        return
    table = Table("target", "robot x, y, z (mm)", "TRE RMS", "95 % semi-axes", "measured")
    for t in found["targets"]:
        place = ", ".join(f"{value * MM:.2f}" for value in t["robot"])
        axes = " × ".join(_mm(value) for value in t["semi_axes95"] or [None])
        error = "" if t["measured_error"] is None else _mm(t["measured_error"])
        table.add_row(_plain(t["label"]), place, _mm(t["tre_rms"]), axes, error)
    console.print("\nTargets, errors in mm", table, "\nHow far to trust it", sep="\n")
    for t in found["targets"]:
        console.print(f"  {_plain(t['trust'])}")


def _print_methods(console: Console, found: dict[str, Any]) -> None:
    """The same markers by every method."""
    names = [_plain(t["label"]) for t in found["targets"]]
    table = Table("method", "markers", "FRE", *[f"TRE {name}" for name in names])
    for line in found["methods"]:
        if line["refused"] is None:
            tre = [_mm(value) for value in line["tre_rms"].values()]
            table.add_row(line["method"], _plain(", ".join(line["used"])), _mm(line["fre"]), *tre)
    console.print("\nBy every method (mm; TRE predicted)", table, sep="\n")
    for line in found["methods"]:
        if line["refused"] is not None:
            console.print(f"• {line['method']} finds nothing: {_plain(line['refused'])}")
    for line in found["transforms"]:
        console.print(f"• {_plain(_told(line))}")


def _told(line: dict[str, Any]) -> str:
    """A transform found elsewhere, in one line."""
    turned = " (its inverse: the file maps robot to CT)" if line["inverted"] else ""
    said = f"{line['name']}{turned}: FRE {_mm(line['fre'])} mm"
    inside = {None: "not known whether within", True: "inside", False: "outside"}
    for label, apart in line["apart"].items():
        where = inside[line["within95"][label]]
        said += f"; {label} {_mm(apart)} mm from here, {where} the 95 % region of the transform"
    return said


def _mm(length: float | None) -> str:
    return "not known" if length is None else f"{length * MM:.2f}"


def _plain(text: str) -> str:
    """Text of a file as the console shows it: printable, and no markup."""
    return "".join(c if c.isprintable() else "?" for c in text).replace("[", "\\[")
