r"""What is always fitted and never blamed: the device's frame, the tool, sockets.

The device's frame starts from the best match of what the model says and what was measured, and is
corrected by a small twist in symbols, so that it is smooth wherever it is. Where it is not fitted
the readings are in the robot's base frame: a match would hide a part of the gap.

Planes and markers: what a range should have read, and how far planes and CT's slices reach.

.. math:: d = \frac{n_k^T (p_k - o)}{n_k^T v}

with the beam from o along v, plane k through p_k with the normal n_k away from the finder, all in
the base frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import State
from plumbline.kinematics.frames import Transform, constant, rotation
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement import constants
from plumbline.optim.measurement.registering import registered, tool_turn
from plumbline.optim.measurement.session import Own
from plumbline.optim.recording.recording import Recording, Session, one_hot_sockets, socket_labels
from plumbline.optim.recording.session import apart
from plumbline.optim.rigid import basis

Anchor = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Symbols of the nuisances, their starts and where they enter."""

    x: cs.SX  # unknowns (p,)
    names: tuple[str, ...]  # their names (p)
    scale: Array  # typical sizes (p,)
    start: Array  # registered values (p,)
    T_device_world: Transform = field(default_factory=Transform.identity)  # the device's frame
    # correction of the tool offset (3,) [m]
    tool: cs.SX = field(default_factory=lambda: cs.SX(3, 1))
    # correction of the tool's orientation, for poses (3, 3)
    R_tip_tool: cs.SX = field(default_factory=lambda: cs.SX.eye(3))
    # places of the sockets in the base frame (3, s) [m]
    sockets: cs.SX = field(default_factory=lambda: cs.SX(3, 0))
    # normals of the planes away from the finder (3, K), in the base frame
    normals: cs.SX = field(default_factory=lambda: cs.SX(3, 0))
    # A point on each plane (3, K) in the base frame [m]
    points: cs.SX = field(default_factory=lambda: cs.SX(3, 0))
    # residuals that no row carries (known distances of sockets) [m]
    shared: cs.SX = field(default_factory=lambda: cs.SX(0, 1))
    # where the device's frame was registered: its start (4, 4) and the middle of the data (3,) [m],
    # about which it turns; None where no frame is fitted
    anchor: Anchor | None = None
    # what is each recording's own, where there are several, in these unknowns
    own: tuple[Own, ...] = ()
    parts: tuple[Nuisance, ...] = ()  # each recording's nuisances in unknowns of its own

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    @property
    def lower(self) -> Array:
        """Bounds so wide that they never bind (p,)."""
        return self.start - constants.WIDE_BOUNDS * self.scale

    @property
    def upper(self) -> Array:
        """Bounds so wide that they never bind (p,)."""
        return self.start + constants.WIDE_BOUNDS * self.scale


def nuisances_of(recording: Recording, anchor: Anchor | None = None) -> Nuisance:
    """The nuisances of a recording's kind of observation, started near their place."""
    if recording.several:
        return _of_session(recording)
    if recording.kind.joints:
        return Nuisance(cs.SX(0, 1), (), np.empty(0), np.empty(0))
    if recording.kind.sockets:
        return _socket_places(recording)
    if recording.kind.ranges:
        return _beam_and_planes(recording, anchor or recording.anchor)
    return _device_frame(recording, anchor)


Block = tuple[cs.SX, Sequence[str], float]  # unknowns, their names and their typical size


def _of_blocks(blocks: Sequence[Block], start: Array | None = None, **parts: Any) -> Nuisance:
    """Nuisances of unknowns one below the other, started at zero unless given."""
    symbols = [cs.vec(symbol) for symbol, _, _ in blocks]
    names = tuple(name for _, own, _ in blocks for name in own)
    scale = np.array([size for _, own, size in blocks for _ in own])
    start = np.zeros(len(names)) if start is None else start
    return Nuisance(cs.vertcat(*symbols), names, scale, start, **parts)


def _along(what: str, axes: Iterable[str] = "xyz") -> list[str]:
    return [f"{what}{axis}" for axis in axes]


def _device_frame(recording: Recording, anchor: Anchor | None) -> Nuisance:
    blocks: list[Block] = []
    parts: dict[str, Any] = {}
    if "frame" in recording.always:
        anchor = anchor or (registered(recording), recording.measured[:, :3].mean(axis=0))
        parts["anchor"] = T_start, centre = anchor
        shift, turn = cs.SX.sym("frame_t", 3), cs.SX.sym("frame_w", 3)
        # Turned about the middle of the data, where turn and shift are least entangled.
        R = rotation(turn)
        t = constant(centre) + R @ constant(T_start[:3, 3] - centre) + shift
        parts["T_device_world"] = Transform(R @ constant(T_start[:3, :3]), t)
        blocks += [(shift, _along("frame "), constants.FRAME_SCALE[0])]
        blocks += [(turn, _along("frame r"), constants.FRAME_SCALE[1])]
    if "tool" in recording.always:
        parts |= _tool(blocks, recording.kind.oriented)
    start = np.zeros(sum(len(names) for _, names, _ in blocks))
    if "R_tip_tool" in parts:
        start[-3:] = tool_turn(recording, parts["anchor"][0] if "anchor" in parts else np.eye(4))
    return _of_blocks(blocks, start, **parts)


def _tool(blocks: list[Block], turning: bool) -> dict[str, Any]:
    """Correct the tool's offset, and its turn if asked, by unknowns that join the blocks."""
    tool, turn = cs.SX.sym("tool", 3), cs.SX.sym("tool_w", 3)
    blocks.append((tool, _along("tool "), constants.TOOL_SCALE))
    if not turning:
        return {"tool": tool}
    blocks.append((turn, _along("tool r"), constants.FRAME_SCALE[1]))
    return {"tool": tool, "R_tip_tool": rotation(turn)}


def _beam_and_planes(recording: Recording, anchor: Anchor | None) -> Nuisance:
    """Where the beam starts and points on the flange, and where every plane stands."""
    if anchor is None:
        raise PlumblineError("ranges without a start: recordings are made by ranges_to_diagnose")
    beam, planes = anchor
    count = len(planes)
    shift, turn = cs.SX.sym("beam_t", 3), cs.SX.sym("beam_w", 2)
    tilt, off = cs.SX.sym("plane_w", 2, count), cs.SX.sym("plane_t", count)
    # The third axis after a small turn about the other two.
    tilted = [rotation(cs.vertcat(tilt[:, k], 0))[:, 2] for k in range(count)]
    normals = [constant(basis(p[3:])) @ n for p, n in zip(planes, tilted, strict=True)]
    points = [constant(p[:3]) + off[k] * normals[k] for k, p in enumerate(planes)]
    named = [f"plane {k} " for k in range(1, count + 1)]
    leaning = [name for plane in named for name in _along(f"{plane}r", "xy")]
    blocks = [
        (shift, _along("beam "), constants.TOOL_SCALE),
        (turn, _along("beam r", "xy"), constants.FRAME_SCALE[1]),
        (tilt, leaning, constants.FRAME_SCALE[1]),
        (off, [f"{plane}offset" for plane in named], constants.FRAME_SCALE[0]),
    ]
    return _of_blocks(
        blocks,
        tool=shift,
        R_tip_tool=constant(basis(beam[3:])) @ rotation(cs.vertcat(turn, 0)),
        normals=cs.horzcat(*normals),
        points=cs.horzcat(*points),
        anchor=anchor,
    )


def _socket_places(recording: Recording) -> Nuisance:
    tips = recording.chain.tips(recording.q, recording.tool_offset)
    hot = one_hot_sockets(recording)
    start = ((hot.T @ tips) / hot.sum(axis=0)[:, None]).ravel()
    sockets = cs.SX.sym("sockets", 3, hot.shape[1])
    names = [name for k in socket_labels(recording) for name in _along(f"socket {k} ")]
    blocks: list[Block] = [(sockets, names, constants.FRAME_SCALE[0])]
    parts = {"sockets": sockets, "shared": _known_distances(recording, sockets)}
    if "tool" in recording.always:
        parts |= _tool(blocks, turning=False)
        start = np.append(start, np.zeros(3))
    return _of_blocks(blocks, start, **parts)


def _known_distances(recording: Recording, sockets: cs.SX) -> cs.SX:
    """A known distance counts as much as all rows of its two sockets together."""
    if recording.socket_distance is None or recording.socket is None:
        return cs.SX(0, 1)
    labels = list(socket_labels(recording))
    pairs = recording.socket_pairs or tuple(pairwise(labels))[::2]
    rows = []
    for a, b in pairs:
        if a in labels and b in labels:
            apart = sockets[:, labels.index(a)] - sockets[:, labels.index(b)]
            # Sockets may start at one place, where a plain norm has no derivative.
            gap = cs.sqrt(cs.sumsqr(apart) + constants.COINCIDENT**2)
            count = np.isin(recording.socket, (a, b)).sum()
            rows.append(np.sqrt(count) * (gap - recording.socket_distance))
    return cs.vertcat(*rows) if rows else cs.SX(0, 1)


def _of_session(recording: Recording) -> Nuisance:
    """Each recording's own nuisances side by side; what is shared is one for all of them."""
    session = apart(recording)[0]
    unknowns: dict[str, tuple[cs.SX, float, float]] = {}
    own, parts, pulls, anchor = list[Own](), list[Nuisance](), list[cs.SX](), None
    for k, part in enumerate(session.parts):
        nuisance = nuisances_of(part, anchor if "frame" in session.shared else None)
        anchor = anchor or nuisance.anchor
        names = [_name_in(session, k, name) for name in nuisance.names]
        for name, size, at in zip(names, nuisance.scale, nuisance.start, strict=True):
            unknowns.setdefault(name, (cs.SX.sym(name), float(size), float(at)))
        columns = np.array([list(unknowns).index(name) for name in names], dtype=np.intp)
        mine = cs.vertcat(*(unknowns[name][0] for name in names))
        parts.append(nuisance)
        own.append(_own(session, k, nuisance, mine, columns))
        weight = _weight(recording, k)
        pulls.append(cs.substitute(nuisance.shared, nuisance.x, mine) / weight)
    symbols, scales, start = zip(*unknowns.values(), strict=True) if unknowns else ((), (), ())
    return Nuisance(
        cs.vertcat(*symbols) if symbols else cs.SX(0, 1),
        tuple(unknowns),
        np.array(scales),
        np.array(start),
        shared=cs.vertcat(*pulls),
        own=tuple(own),
        parts=tuple(parts),
    )


def _name_in(session: Session, k: int, name: str) -> str:
    shared = name.split()[0] in session.shared or f"{name.split()[0]}s" in session.shared
    return name if shared else f"{name} of {session.parts[k].name}"


def _own(session: Session, k: int, nuisance: Nuisance, mine: cs.SX, columns: Any) -> Own:
    """One recording's nuisances in the session's unknowns, its tool in the first one's frame."""
    part = session.parts[k]
    found = [nuisance.T_device_world.R, nuisance.T_device_world.t, nuisance.tool]
    found += [nuisance.R_tip_tool, nuisance.sockets]
    R, t, tool, turn, sockets = (cs.substitute(e, nuisance.x, mine) for e in found)
    between = np.linalg.inv(session.parts[0].chain.T_last_tip) @ part.chain.T_last_tip
    T = Transform.from_matrix(between)
    return Own(
        Transform(R, t), T.point(constant(part.tool_offset) + tool), T.R @ turn, sockets, columns
    )


def _weight(recording: Recording, k: int) -> float:
    """Noise of one recording over that of all."""
    if recording.noise_shape is None or recording.part is None:
        return 1.0
    return float(np.mean(recording.noise_shape[recording.part == k, :3]))


HALVES = "half widths"


def on_its_plane(state: State, R_base_tip: cs.SX, nuisance: Nuisance) -> State:
    """The closed chain with its range as its reading, and where and how the beam meets the plane.

    What it reads is where the beam starts; R_base_tip (3, 3) is the flange's.
    """
    assert nuisance.anchor is not None
    planes = nuisance.anchor[1]
    here = cs.vertcat(*(state.row["element"] == k for k in range(1, len(planes) + 1)))
    turned = R_base_tip @ state.R_tip_tool
    normal, way = nuisance.normals @ here, turned[:, 2]
    length = cs.dot(normal, nuisance.points @ here - state.reading) / cs.dot(normal, way)
    meets = state.reading + length * way
    axes = [constant(basis(plane[3:])[:, :2].T) @ (meets - plane[:3]) for plane in planes]
    spot = cs.horzcat(*axes) @ here
    return replace(state, reading=length, normal=turned.T @ normal, spot=spot)


def spans_of_parts(recording: Recording) -> dict[str, tuple[float, float]]:
    """Half width of each plane and pitch of each of CT's axes, as the effects' scope has them."""
    if recording.kind.ranges:
        halves = half_widths(recording)
        return {f"plane{k}": (half, half) for k, half in enumerate(halves.tolist(), start=1)}
    pitch = recording.pitch
    if not recording.kind.fiducials or pitch is None:
        return {}
    return {f"pitch{a}": (h, h) for a, h in enumerate(pitch.tolist())}


def half_widths(recording: Recording) -> Array:
    """How far the beams reach over each plane, from its middle (K,) [m]."""
    whole, _ = recording.path
    if HALVES not in whole.derived:
        spots, part = spots_at_start(whole), whole.element
        count = range(1, len(whole.elements) + 1)
        far = [np.abs(spots[part == k]).max(initial=constants.LEAST_HALF) for k in count]
        whole.derived[HALVES] = np.array(far)
    return np.asarray(whole.derived[HALVES])


def spots_at_start(recording: Recording) -> Array:
    """Where the beams meet the planes (N, 2) [m], from their middles, as the fit starts."""
    assert recording.anchor is not None
    assert recording.element is not None
    beam, planes = recording.anchor
    T = recording.chain.placement(recording.q)
    on_flange = beam[:3] + recording.measured * beam[3:]
    points = np.einsum("nij,nj->ni", T[:, :3, :3], on_flange) + T[:, :3, 3]
    axes = np.stack([basis(plane[3:])[:, :2] for plane in planes])[recording.element - 1]
    return np.einsum("nji,nj->ni", axes, points - planes[recording.element - 1, :3])


def cosines_at_start(recording: Recording) -> tuple[Array, Array]:
    """Cosines (N,) of the incidence, and slopes (N, 2) as the beam sees them, as the fit starts."""
    assert recording.anchor is not None
    assert recording.element is not None
    beam, planes = recording.anchor
    turned = recording.chain.placement(recording.q)[:, :3, :3] @ basis(beam[3:])
    normal = np.einsum("nji,nj->ni", turned, planes[recording.element - 1, 3:])
    return normal[:, 2], normal[:, :2] / normal[:, 2:]
