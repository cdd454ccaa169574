"""A registration's page: where targets are and how far to trust it, markers, other methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.experiments.report.registration.figures import misfits_and_targets
from plumbline.experiments.report.registration.text import content
from plumbline.optim.registration import Registration
from plumbline.optim.registration.constants import DOUBTFUL

MM = 1e3


def page(answer: Registration, found: Mapping[str, Any] | None = None) -> Page:
    """The page of an answer.

    Args:
        answer: The answer.
        found: Its content, with other methods and transforms where they were tried.
    """
    told = found or content(answer)
    doubtful = bool(answer.unknown) or answer.surprise < DOUBTFUL
    return Page(
        name=answer.recording.name,
        verdict="Doubtful" if doubtful else f"Markers fit to {MM * answer.fre:.2f} mm",
        tone="outside-library" if doubtful else "explained",
        lead=answer.trust or ("No target rows: how far to trust it there is not known.",),
        tiles=_tiles(answer, told),
        parts=(*_targets(told), *_markers(answer, told), _frame(answer), *_methods(told)),
        warnings=tuple(f"not to be relied on: {line}" for line in answer.judged.failures),
        sha256=answer.recording.sha256,
    )


def _tiles(answer: Registration, told: Mapping[str, Any]) -> list[Tile]:
    shape = answer.condition
    return [
        Tile("misfit of markers (FRE)", f"{MM * answer.fre:.2f} mm", "root mean square"),
        Tile("mean misfit", f"{MM * answer.calculation_error:.2f} mm", "of all markers"),
        Tile("noise of a misfit", f"{MM * told['noise']['std']:.2g} mm", "per axis"),
        Tile("shape", f"{shape.angle:.1f} deg", "best triple; 60 is best"),
        Tile("markers", f"{len(answer.used)} of {len(answer.labels)}", f"by {answer.method}"),
    ]


def _targets(told: Mapping[str, Any]) -> list[Part]:
    if not told["targets"]:
        return []
    rows = []
    for t in told["targets"]:
        place = [f"{MM * v:.2f}" for v in t["robot"]]
        axes = " × ".join(_mm(v) for v in t["semi_axes95"] or [None])
        rows.append([t["label"], *place, _mm(t["tre_rms"]), axes, _mm(t["measured_error"], "")])
    columns = ("target", "x", "y", "z", "TRE, RMS", "95 % semi-axes", "measured error")
    return [Part("Targets in the robot's frame", ("All in mm.",), Grid(columns, rows, range(1, 7)))]


def _markers(answer: Registration, told: Mapping[str, Any]) -> list[Part | Picture]:
    order = np.argsort(-answer.misfits)
    rows = []
    for k in order:
        state = "moved" if answer.labels[k] in answer.shifted else ""
        state = state or ("used" if k in answer.used else "not used")
        left = [f"{MM * v:+.2f}" for v in answer.residuals[k]]
        rows.append([answer.labels[k], f"{MM * answer.misfits[k]:.2f}", *left, state])
    grid = Grid(("marker", "misfit", "dx", "dy", "dz", "in the fit"), rows, range(1, 5))
    picture = Picture(
        "misfits",
        "Misfits of the markers and what they make of the targets",
        "Bars are in mm; a marker that is not used is hollow. Whiskers hold 95 of 100 targets.",
        (misfits_and_targets(answer),),
        wide=True,
    )
    words = ("What is left of each marker, largest first, in mm along the robot's axes.",)
    return [picture, Part("Markers", words, grid, tuple(told["notes"]))]


def _frame(answer: Registration) -> Part:
    rows = [[f"{v:.8f}" for v in row] for row in answer.T_RC]
    words = ("T_RC, lengths in m: a point of CT, times it, is in the robot's frame.",)
    return Part("The transform", words, Grid(("", "", "", ""), rows, range(4), sorts=False))


def _methods(told: Mapping[str, Any]) -> list[Part]:
    if len(told["methods"]) < 2:
        return []
    names = [t["label"] for t in told["targets"]]
    rows = [
        [line["method"], ", ".join(line["used"]), _mm(line["fre"]),
         *map(_mm, line["tre_rms"].values())]
        for line in told["methods"]
        if line["refused"] is None
    ]  # fmt: skip
    refused = [f"{line['method']} finds nothing: {line['refused']}"
               for line in told["methods"] if line["refused"] is not None]  # fmt: skip
    columns = ("method", "markers", "FRE", *(f"TRE {name}" for name in names))
    return [
        Part("By every method", ("In mm.",), Grid(columns, rows, range(2, len(columns))), refused)
    ]


def _mm(length: float | None, unknown: str = "not known") -> str:
    return unknown if length is None else f"{MM * length:.2f}"
