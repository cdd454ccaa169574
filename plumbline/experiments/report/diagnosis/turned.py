"""The arm, its tips and what is left of each row as a scene to turn: its data, and in a notebook.

There it is a page of its own in a frame, nothing fetched.
"""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.report.diagnosis.arm import skeleton, typical_posture, upright
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.page.page import environment
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import significant
from plumbline.optim.diagnosis.answer import Diagnosis

MOST_TIPS = 400  # drawn: each is an arrow that a telephone must turn smoothly
LONGEST = 0.12  # of the scene's radius: the arrow of a row of the 95th percentile before
AXIS = 0.15  # [m]: of the base frame's arrows


@dataclass(frozen=True)
class Turned:
    """A scene that a reader can turn by dragging."""

    name: str  # of the recording
    page: str  # the whole of it, one HTML file

    def __repr__(self) -> str:
        return f"<scene of {self.name[:60]}: shown in a notebook>"

    def _repr_html_(self) -> str:
        """The page in a frame that may run its own script and reach nothing else."""
        given = html.escape(self.page, quote=True)
        style = "width:100%;height:36rem;border:0"
        return f'<iframe sandbox="allow-scripts" srcdoc="{given}" style="{style}"></iframe>'


def turned(answer: Diagnosis) -> Turned:
    """The arm, its tips, what is left of each row and the parts that account for it, in 3-D.

    Args:
        answer: Of tips or poses.

    Raises:
        PlumblineError: What was observed has no places.
    """
    subject = Subject.of(answer)
    data = scene(subject)
    if not data:
        kind = subject.recording.observation
        raise PlumblineError(f"scene: {kind} observed, tips or poses expected; take answer.plot()")
    page = environment().get_template("page/scene.html.j2")
    return Turned(subject.recording.name, page.render(data=data))


def scene(subject: Subject) -> str:
    """The scene as JSON, lengths in m; empty where rows are no tips."""
    recording = subject.recording
    if not recording.kind.device:
        return ""
    R = upright(recording.chain.gravity)
    body = skeleton(recording.chain, typical_posture(recording.q), recording.tool_offset).turned(R)
    tips = recording.chain.tips(recording.q, recording.tool_offset) @ R.T
    # Residuals are predicted less measured, in the device's frame; arrows go to the measured tip.
    both = (places - places.mean(axis=0) for places in (tips, recording.measured[:, :3]))
    to_base = Rotation.align_vectors(*both)[0]
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
