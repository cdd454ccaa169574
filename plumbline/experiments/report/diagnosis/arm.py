r"""The arm at a recorded posture, its parts coloured by their share of the gap.

Orthographic projection seen from azimuth :math:`\alpha` and elevation :math:`\epsilon`:

.. math:: u = -x \sin\alpha + y \cos\alpha, \qquad
          v = z \cos\epsilon - (x \cos\alpha + y \sin\alpha) \sin\epsilon

From joint to joint the line first follows the joint's axis, then its normal, as the arm itself
mostly does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.kinematics.chain import Chain
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import Place

ELEVATION = np.deg2rad(18.0)  # of the eye above the floor
AZIMUTHS = np.deg2rad(np.arange(15.0, 375.0, 15.0))
SCALE_BARS = (0.05, 0.1, 0.2, 0.5, 1.0)  # [m]


@dataclass(frozen=True, eq=False)
class Skeleton:
    """An arm reduced to points in the base frame [m]."""

    joints: Array  # origins of the joints (n, 3)
    links: tuple[Array, ...]  # corners (k, 3) of each joint's link, from its joint to the next (n)
    tool: Array  # from the tip frame to the tool's tip (2, 3)

    @property
    def points(self) -> Array:
        """All of them, the base's origin first (k, 3)."""
        return np.vstack([np.zeros((1, 3)), self.joints, *self.links, self.tool])

    def turned(self, R: Array) -> Skeleton:
        """The same arm turned by R (3, 3) about the base's origin."""
        return Skeleton(self.joints @ R.T, tuple(p @ R.T for p in self.links), self.tool @ R.T)


def upright(gravity: Array) -> Array:
    """Rotation (3, 3) after which gravity (3,) points down the paper, whatever the mounting."""
    size = float(np.linalg.norm(gravity))
    up = -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    return np.asarray(pin.Quaternion.FromTwoVectors(up, np.array([0.0, 0.0, 1.0])).matrix())


def skeleton(chain: Chain, q: Array, tool_offset: Array) -> Skeleton:
    """The arm at posture q (n,), with its tool tip at ``tool_offset`` (3,) in the tip frame [m]."""
    data = chain.model.createData()
    pin.forwardKinematics(chain.model, data, chain.configuration(q))
    placements = [data.oMi[j + 1].homogeneous for j in range(chain.n)]
    T_base_tip = placements[-1] @ chain.T_last_tip
    origins = np.array([T[:3, 3] for T in [*placements, T_base_tip]])
    links = []
    for joint, T, start, end in zip(chain.joints, placements, origins, origins[1:], strict=False):
        axis = T[:3, :3] @ joint.axis
        corner = start + axis * float(axis @ (end - start))
        links.append(np.array([start, corner, end]))
    tip = T_base_tip[:3, :3] @ tool_offset + T_base_tip[:3, 3]
    return Skeleton(origins[:-1], tuple(links), np.array([T_base_tip[:3, 3], tip]))


def typical_posture(q: Array) -> Array:
    """The recorded posture (n,) nearest to the medians of all (N, n), in spreads of each joint."""
    spread = np.where(q.std(axis=0) > 0.0, q.std(axis=0), 1.0)
    return np.asarray(q[np.argmin(np.linalg.norm((q - np.median(q, axis=0)) / spread, axis=1))])


def arm(subject: Subject) -> Figure:
    """The arm, grey where it is innocent."""
    recording = subject.recording
    posture = typical_posture(recording.q)
    body = skeleton(recording.chain, posture, recording.tool_offset).turned(
        upright(recording.chain.gravity)
    )
    azimuth = best_azimuth(body.points)
    share = _Shares.of(subject.verdict.where)
    with style.drawing(3.3, 3.6) as (figure, axes):
        axes.set_aspect("equal")
        axes.axis("off")
        _ground(axes, body, azimuth, share)
        _links(axes, body, azimuth, share)
        _joints(axes, body, azimuth, share)
        _scale_bar(axes, project(body.points, azimuth))
        low, high = np.asarray(axes.dataLim.get_points())
        pad = 0.1 * float((high - low).max())  # room for discs, about half of which lie outside
        axes.set(xlim=(low[0] - pad, high[0] + pad), ylim=(low[1] - pad, high[1] + pad))
        return figure


@dataclass(frozen=True)
class _Shares:
    """Shares by stage and element, relative to the largest."""

    places: tuple[Place, ...]
    largest: float

    @classmethod
    def of(cls, places: Sequence[Place]) -> _Shares:
        return cls(tuple(places), max((p.share for p in places), default=1.0) or 1.0)

    def colour(self, stage: str, element: int | None = None) -> tuple[float, ...]:
        # A joint's drive stands at the joint.
        at = ("joint", "actuation") if stage == "joint" else (stage,)
        total = sum(p.share for p in self.places if p.stage in at and p.element == element)
        return tuple(style.SHARES(float(np.clip(total / self.largest, 0.0, 1.0))))


def project(points: Array, azimuth: float) -> Array:
    """Points (N, 3) on the paper (N, 2), seen from that azimuth [rad]."""
    x, y, z = np.asarray(points).T
    ahead = x * np.cos(azimuth) + y * np.sin(azimuth)
    across = -x * np.sin(azimuth) + y * np.cos(azimuth)
    return np.column_stack([across, z * np.cos(ELEVATION) - ahead * np.sin(ELEVATION)])


def best_azimuth(points: Array) -> float:
    """Where to stand so that the arm's parts lie far apart on the paper."""

    def spread(azimuth: float) -> float:
        return float(np.linalg.slogdet(np.cov(project(points, azimuth).T) + 1e-12 * np.eye(2))[1])

    return max((float(a) for a in AZIMUTHS), key=spread)


def _ground(axes: Axes, body: Skeleton, azimuth: float, share: _Shares) -> None:
    """The base's plate and the arm's shadow on its level."""
    reach = float(np.ptp(body.points, axis=0).max())
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    disc = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)]) * 0.09 * reach
    plate = project(disc, azimuth)
    path = np.vstack([np.zeros((1, 3)), *body.links, body.tool]) * [1.0, 1.0, 0.0]
    shadow = project(path, azimuth)
    axes.plot(*shadow.T, color=style.FAINT, linewidth=4.0, alpha=0.25, solid_joinstyle="round")
    axes.fill(*plate.T, color=share.colour("base"), linewidth=0.0)
    stand = project(np.vstack([np.zeros(3), body.joints[0]]), azimuth)
    axes.plot(*stand.T, color=share.colour("base"), linewidth=7.0)


def _links(axes: Axes, body: Skeleton, azimuth: float, share: _Shares) -> None:
    for k, link in enumerate(body.links, start=1):
        line = project(link, azimuth)
        axes.plot(*line.T, color=share.colour("link", k), linewidth=6.0, solid_joinstyle="round")
    tool = project(body.tool, azimuth)
    axes.plot(*tool.T, color=share.colour("tool"), linewidth=3.0)
    axes.plot(*tool[-1], marker="o", markersize=4.5, color=share.colour("tool"))


def _joints(axes: Axes, body: Skeleton, azimuth: float, share: _Shares) -> None:
    """Numbered discs; joints that hide one another are fanned out."""
    places = _apart(project(body.joints, azimuth))
    for k, (place, true) in enumerate(zip(places, project(body.joints, azimuth), strict=True), 1):
        if not np.allclose(place, true):
            axes.plot(*np.array([true, place]).T, color=style.MUTED, linewidth=0.8, zorder=3)
        axes.plot(
            *place, marker="o", markersize=15, color=share.colour("joint", k), zorder=4,
            markeredgecolor=style.PAPER, markeredgewidth=1.2,
        )  # fmt: skip
        axes.annotate(
            str(k), place, ha="center", va="center_baseline", fontsize=8.5, fontweight="bold",
            color=style.INK, zorder=5,
        )  # fmt: skip


def _apart(places: Array) -> Array:
    """Points (n, 2) moved sideways until none covers another."""
    least = 0.085 * float(np.ptp(places, axis=0).max() + 1e-9)
    moved = [places[0]]
    for place in places[1:]:
        candidate = place
        for _ in range(20):
            if all(np.linalg.norm(candidate - other) >= least for other in moved):
                break
            candidate = candidate + np.array([0.5 * least, 0.1 * least])
        moved.append(candidate)
    return np.array(moved)


def _scale_bar(axes: Axes, points: Array) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max())
    length = min(SCALE_BARS, key=lambda bar: abs(bar - 0.2 * extent))
    y = low[1] - 0.12 * extent
    axes.plot([high[0] - length, high[0]], [y, y], color=style.MUTED, linewidth=1.4)
    axes.annotate(
        f"{1e3 * length:.0f} mm", (high[0] - 0.5 * length, y), xytext=(0, -3), ha="center",
        textcoords="offset points", va="top", color=style.MUTED, fontsize=8.5,
    )  # fmt: skip
