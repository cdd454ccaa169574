"""What is said of a registration: targets and how far to trust them, markers, the transform."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.experiments.slicer.given import Transformed
from plumbline.optim.registration import METHODS, Registration, RegistrationOptions, register
from plumbline.optim.registration.constants import DOUBTFUL

MM = 1e3  # in a metre


Lines = Sequence[Mapping[str, Any]]


def page(answer: Registration, methods: Lines = (), transforms: Lines = ()) -> Page:
    """The page of an answer, with what :func:`compared` and :func:`elsewhere` tell of it."""
    told = answer.to_dict()
    doubtful = bool(answer.unknown) or answer.surprise < DOUBTFUL
    return Page(
        name=answer.recording.name,
        verdict="Doubtful" if doubtful else f"Markers fit to {MM * answer.fre:.2f} mm",
        tone="outside-library" if doubtful else "explained",
        lead=answer.trust or ("No target rows: add one of role target to see how far to trust it "
                              "there.",),
        tiles=_tiles(answer, told),
        parts=(*_targets(told), partial(_picture, answer), _markers(answer, told),
               _frame(answer, transforms), *_methods(methods)),
        warnings=tuple(f"not to be relied on: {line}" for line in answer.judged.failures),
        sha256=answer.recording.sha256,
    )  # fmt: skip


def compared(answer: Registration) -> list[dict[str, Any]]:
    """What every method makes of the same markers, a line each [m], the answer's own first."""
    lines = [_summary(answer)]
    for name in METHODS:
        if name == answer.method:
            continue
        try:
            lines.append(_summary(register(answer.recording, RegistrationOptions(name))))
        except PlumblineError as error:
            lines.append({"method": name, "refused": str(error)})
    return lines


def _summary(answer: Registration) -> dict[str, Any]:
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


def elsewhere(answer: Registration, other: Transformed) -> dict[str, Any]:
    """A transform found elsewhere: its misfit, and where it puts targets beside the answer [m]."""
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


def _tiles(answer: Registration, told: Mapping[str, Any]) -> list[Tile]:
    shape, noise = answer.condition, f"{MM * told['noise']['std']:.2g} mm"
    return [
        Tile("misfit of markers (FRE)", f"{MM * answer.fre:.2f} mm", "root mean square"),
        Tile("mean misfit", f"{MM * answer.calculation_error:.2f} mm", "of all markers"),
        Tile("noise of a misfit", noise, f"per axis, {_origin(answer)}"),
        Tile("shape", f"{shape.angle:.1f} deg", "best triple; 60 is best"),
        Tile("markers", f"{len(answer.used)} of {len(answer.labels)}", f"by {answer.method}"),
    ]


def _origin(answer: Registration) -> str:
    if np.isinf(answer.dof):
        return "as stated"
    both = "as stated, mended by the misfits" if answer.surprise >= DOUBTFUL else "estimated"
    return f"{both}, {answer.dof:.0f} freedoms"


def _targets(told: Mapping[str, Any]) -> list[Part]:
    if not told["targets"]:
        return []
    rows = []
    for t in told["targets"]:
        place = [f"{MM * v:.2f}" for v in t["robot"]]
        axes = " × ".join(_mm(v) for v in t["semi_axes95"] or [None])
        rows.append([t["label"], *place, _mm(t["tre_rms"]), axes, _mm(t["measured_error"], "")])
    columns = ("target", "x", "y", "z", "TRE, RMS", "95 % semi-axes", "measured error")
    shown = len(columns) if any(row[-1] for row in rows) else len(columns) - 1
    grid = Grid(columns[:shown], [row[:shown] for row in rows], range(1, shown))
    return [Part("Targets in the robot's frame", ("All in mm.",), grid)]


def _picture(answer: Registration) -> Picture:
    from plumbline.experiments.report.registration.figures import misfits_and_targets

    besides = "_and_targets" if len(answer.recording.targets.labels) else ""
    return Picture.of(f"registration.misfits{besides}", misfits_and_targets(answer))


def _markers(answer: Registration, told: Mapping[str, Any]) -> Part:
    rows = []
    for k in np.argsort(-answer.misfits):
        state = "moved" if answer.labels[k] in answer.shifted else ""
        state = state or ("used" if k in answer.used else "not used")
        left = [f"{MM * v:+.2f}" for v in answer.residuals[k]]
        rows.append([answer.labels[k], f"{MM * answer.misfits[k]:.2f}", *left, state])
    grid = Grid(("marker", "misfit", "dx", "dy", "dz", "in the fit"), rows, range(1, 5))
    words = ("What is left of each marker, largest first, in mm along the robot's axes.",)
    return Part("Markers", words, grid, tuple(told["notes"]))


def _frame(answer: Registration, transforms: Lines) -> Part:
    rows = [[f"{v:.8f}" for v in row] for row in answer.T_RC]
    words = ("T_RC, lengths in m: a point of CT, times it, is in the robot's frame.",)
    grid = Grid(("", "", "", ""), rows, range(4), sorts=False)
    return Part("The transform", words, grid, [_beside(line) for line in transforms])


def _methods(lines: Lines) -> list[Part]:
    if len(lines) < 2:
        return []
    found = [line for line in lines if line["refused"] is None]
    rows = [
        [line["method"], ", ".join(line["used"]), _mm(line["fre"]),
         *map(_mm, line["tre_rms"].values())]
        for line in found
    ]  # fmt: skip
    refused = [f"{line['method']} finds nothing: {line['refused']}"
               for line in lines if line["refused"] is not None]  # fmt: skip
    columns = ("method", "markers", "FRE", *(f"TRE {name}" for name in found[0]["tre_rms"]))
    return [
        Part("By every method", ("In mm.",), Grid(columns, rows, range(2, len(columns))), refused)
    ]


def _beside(line: Mapping[str, Any]) -> str:
    turned = " (its inverse: the file maps robot to CT)" if line["inverted"] else ""
    said = f"{line['name']}{turned}: FRE {_mm(line['fre'])} mm"
    inside = {None: "not known whether within", True: "inside", False: "outside"}
    for label, apart in line["apart"].items():
        where = inside[line["within95"][label]]
        said += f"; {label} {_mm(apart)} mm from here, {where} the 95 % region of the transform"
    return said


def _mm(length: float | None, unknown: str = "not known") -> str:
    return unknown if length is None else f"{MM * length:.2f}"
