"""The arm, its tips and what is left of each row, as data of a scene that a reader can turn."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.experiments.report.diagnosis.arm import skeleton, typical_posture, upright
from plumbline.experiments.report.diagnosis.subject import Array, Subject
from plumbline.optim.core.quantities import significant

MOST_TIPS = 400  # drawn: each is an arrow that a telephone must turn smoothly
LONGEST = 0.12  # of the scene's radius: the arrow of a row of the 95th percentile before
AXIS = 0.15  # [m]: of the base frame's arrows


def scene(subject: Subject) -> str:
    """The scene as JSON, lengths in m; empty where rows are no tips."""
    recording = subject.recording
    if not recording.kind.device:
        return ""
    R = upright(recording.chain.gravity)
    body = skeleton(recording.chain, typical_posture(recording.q), recording.tool_offset).turned(R)
    tips = recording.chain.tips(recording.q, recording.tool_offset) @ R.T
    # Residuals are predicted less measured, in the device's frame; arrows go to the measured tip.
    to_base = _turn(tips, recording.measured[:, :3])
    arrows = [-to_base.apply(r[:, :3]) for r in (subject.before, subject.after)]
    some = np.unique(np.linspace(0, len(tips) - 1, min(len(tips), MOST_TIPS)).astype(int))
    points = np.vstack([body.points, tips])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    largest = float(np.percentile(subject.sizes[0], 95.0)) or 1.0
    factor = LONGEST * radius / largest  # from mm to m of the scene
    data: dict[str, Any] = {
        "joints": _short(body.joints), "links": [_short(link) for link in (*body.links, body.tool)],
        "turns": _shares(subject, len(body.links), ("joint", "actuation")),
        "shares": _shares(subject, len(body.links), ("link", "tool")), "tips": _short(tips[some]),
        "before": _short(arrows[0][some]), "after": _short(arrows[1][some]),
        "rows": subject.rows[some].tolist(), "unit": subject.unit, "azimuth": 0.9,
        "sizes": [[significant(v) for v in sizes[some]] for sizes in subject.sizes],
        "middle": _short(middle), "radius": round(radius, 4), "largest": round(largest, 6),
        "factor": round(factor, 6), "factor_words": f"{significant(1e3 * factor, 2)}",
        "axes": [[_short(AXIS * R[:, k]), name] for k, name in enumerate("xyz")],
    }  # fmt: skip
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def _turn(tips: Array, measured: Array) -> Rotation:
    """The rotation that brings measured tips onto those of the model."""
    return Rotation.align_vectors(tips - tips.mean(axis=0), measured - measured.mean(axis=0))[0]


def _shares(subject: Subject, count: int, stages: Sequence[str]) -> list[float]:
    """Share of each joint, or of each link and the tool."""
    found = np.zeros(count + 1)
    for place in subject.verdict.where:
        if place.stage not in stages:
            continue
        if place.stage == "tool":
            found[-1] += place.share
        elif place.element is not None and place.element <= count:
            found[place.element - 1] += place.share
    return [round(float(share), 3) for share in found]


def _short(values: Array) -> Any:
    return np.round(np.nan_to_num(values), 5).tolist()
