r"""Is the set-up right? A wrong one is found by another simple one that explains far more.

The misfit of a set-up is what it leaves after the best frame F, tool d and sockets s,

.. math:: \operatorname{median}_i |F\,(p_i + R_i d) + t - y_i| \quad\text{or}\quad
          \operatorname{median}_i |p_i + R_i d - s_{k(i)}|

(the minimum by squares). Signs of joints, zeros off by quarters of a turn, swapped columns, joints
that count from others, mirrored axes, inverted poses, measurements or a joint a row late, rows in
other sockets, DH rows of the other convention and the other robots of the package are tried in
turn, and what mends a part of the rows (:mod:`plumbline.optim.recording.from_a_row_on`). A gap of
the robot itself, however large, is mended by none of them.
"""

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import scipy

from plumbline.errors import PlumblineError, one_line
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot, bundled_names
from plumbline.optim.recording import constants
from plumbline.optim.recording.from_a_row_on import least, matched, mended_from_a_row_on
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.slips import (
    QUARTERS,
    counted_from_others,
    moved_zero,
    named,
    signs,
    swapped,
    swaps,
    turned_round,
    turned_signs,
    whole_turns,
    zeros,
)
from plumbline.optim.recording.table import Array, Integers
from plumbline.optim.rigid import nearest_rotation, rotations, some_of


class Other(NamedTuple):
    """Another set-up."""

    change: str  # what is other in it, in words
    recording: Recording
    q: Array  # its joint readings (N, n)


# x, y, z, and qw, qx, qy, qz of the rotations seen in a mirror
MIRROR = np.array([1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class WrongSetUp:
    """A set-up that explains a recording far better than its own."""

    change: str  # what is other in it, in words
    # what the recording's own set-up leaves, in the median [m], or [rad] for encoders
    misfit: float
    left: float  # what the other one leaves
    unit: str = "m"  # of both

    @property
    def words(self) -> str:
        """The likely fault in one line, without the way out."""
        return (
            f"rows miss the model by {self.misfit:.2g} {self.unit}, but by {self.left:.2g} "
            f"{self.unit} with {self.change}"
        )


def plausible(recording: Recording) -> float:
    """The largest plausible noise of one axis: a hundredth of the reach [m], or of a radian.

    Trackers, arms and calibrated cameras are a hundred times finer; what is coarser hides every
    gap that a robot with a set-up that is right has ever shown.
    """
    turning = recording.kind.encoders and any(
        recording.chain.kinds[j] == "revolute" for j in recording.measured_joints
    )
    if recording.kind.efforts:
        return np.inf  # drives differ by decades, and so does what their efforts are read with
    return constants.PLAUSIBLE * (1.0 if turning else recording.reach)


def refuse_wrong_set_up(recording: Recording) -> None:
    """Refuse a recording that another simple set-up explains far better, and name that."""
    wrong = wrong_set_up(recording)
    if wrong is not None:
        mend = "mend it, or take it as it is with --force (in Python: force=True)"
        raise PlumblineError(one_line(f"{recording.name}: {wrong.words}; {mend}"))


def wrong_set_up(recording: Recording) -> WrongSetUp | None:
    """The simple set-up that explains the rows far better, its columns called as in the file."""
    wrong, called = _wrong_set_up(recording), recording.in_file
    if wrong is None or not called:
        return wrong
    told = re.sub(r"\b[qm]\d+\b", lambda m: called.get(m[0], m[0]), wrong.change)
    return replace(wrong, change=told)


def _wrong_set_up(recording: Recording) -> WrongSetUp | None:
    """The simple set-up that leaves the least, if it leaves a tenth of what the recording's does.

    None as well where the misfit is below :data:`ASKED` of :func:`plausible`, or where there are
    fewer than :data:`FEWEST_POSTURES` postures: those say too little of anything. Of 180 drawn gaps
    of the robot alone above that limit, the best other set-up left a third at the least.
    """
    if recording.element is not None:
        return None  # what reads ranges and fiducials has refused what is no plane, no body
    if recording.kind.efforts:
        return None  # what moves the bodies tells their signs and order itself: see checks
    if len(np.unique(np.round(recording.q, 6), axis=0)) < constants.FEWEST_POSTURES:
        return None
    if recording.kind.encoders:
        return _wrong_encoder(recording)
    own = missed(recording.select(some_of(len(recording))))
    if not own > constants.ASKED * plausible(recording):
        return None
    return _mended(_Rows(recording), own)


class _Rows:
    """A recording's rows as a key: what is read and then fitted is searched once."""

    def __init__(self, r: Recording) -> None:
        self.recording = r
        arrays = (r.q, r.measured, r.tool_offset, r.socket, r.time, r.velocity)
        same = id(r.chain), id(r.robot), r.observation, r.always  # which the key keeps alive
        self._key = same, *(a if a is None else a.tobytes() for a in arrays)

    def __hash__(self) -> int:
        """By all that is asked."""
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        """Whether the same would be asked."""
        return isinstance(other, _Rows) and self._key == other._key


@lru_cache(maxsize=2)
def _mended(rows: _Rows, own: float) -> WrongSetUp | None:
    """The simple set-up that leaves a tenth of what the recording's own does, at most."""
    recording = rows.recording
    r = recording.select(some := some_of(len(recording)))
    others = itertools.chain(_others(r), _a_row_off(recording, some))
    tried: list[tuple[str, float]] = []
    for _, each in itertools.groupby(others, key=lambda other: id(other.recording)):
        changes, of, q = zip(*each, strict=True)
        tried += zip(changes, _missed(of[0], np.stack(q)).tolist(), strict=True)
    left = min(left for _, left in tried)
    part = mended_from_a_row_on(recording)
    if part and part.left < constants.MENDED * min(own, left):
        return WrongSetUp(*part)
    if not left < constants.MENDED * own:
        return None
    alike = [
        change for change, other in tried if other <= max(2.0 * left, constants.ONE_SET_UP * own)
    ]
    return WrongSetUp(", or ".join(alike[: constants.LISTED_SET_UPS]), own, left)


def missed(r: Recording) -> float:
    """Median misfit [m] after the best frame, tool and sockets, as far as they are fitted."""
    return float(_missed(r, r.q[None])[0])


def _missed(r: Recording, q: Array) -> Array:
    """The same (S,) by each of several joint readings (S, N, n)."""
    T = r.chain.placement(q.reshape(-1, q.shape[2])).reshape(*q.shape[:2], 4, 4)
    R, p = T[..., :3, :3], T[..., :3, 3] + T[..., :3, :3] @ r.tool_offset
    fitted = "tool" in r.always
    if r.socket is not None and r.kind.sockets:
        return _apart_in_sockets(R, p, np.unique(r.socket, return_inverse=True)[1], fitted)
    F, gaps = matched(R, p, r.measured[:, :3], fitted)
    squares = np.sum(gaps**2, axis=2)
    if r.kind.oriented:
        turned = _turned(F[:, None] @ R, r.measured[:, 3:], fitted)
        squares = squares + (constants.LEVER * turned) ** 2
    return np.asarray(np.sqrt(np.median(squares, axis=1)))


def _apart_in_sockets(R: Array, p: Array, socket: Integers, fit_tool: bool) -> Array:
    """Median distances (S,) [m] of the tips from the middle of their socket, with the best tool."""
    hot = np.eye(int(socket.max()) + 1)[socket]
    a = _about_middle(p, hot)
    if fit_tool:
        inner = _about_middle(R.reshape(*p.shape[:2], 9), hot).reshape(R.shape)
        a = a + (inner @ least(inner, -a)[:, None, :, None])[..., 0]
    return np.asarray(np.median(np.linalg.norm(a, axis=2), axis=1))


def _about_middle(values: Array, hot: Array) -> Array:
    """Values (..., N, k) less their mean over the rows that share a one in hot (N, s)."""
    return values - hot @ (hot.T @ values / hot.sum(axis=0)[:, None])


def _turned(R: Array, quaternions: Array, fit_tool: bool) -> Array:
    """Angles (S, N) of rotations (S, N, 3, 3) to measured ones, after the best tool's turn."""
    between = R.transpose(0, 1, 3, 2) @ rotations(quaternions)
    if fit_tool:
        between = between @ nearest_rotation(between.sum(axis=1)).transpose(0, 2, 1)[:, None]
    cosine = (np.trace(between, axis1=2, axis2=3) - 1.0) / 2.0
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _a_row_off(recording: Recording, some: Integers) -> Iterator[Other]:
    """What was measured, or a joint, a row too late or early, of postures that are no path."""
    if recording.kind.sockets or recording.time is not None or recording.velocity is not None:
        return
    for by, side in ((1, "late"), (-1, "early")):
        met = some[(some + by >= 0) & (some + by < len(recording))]
        moved = replace(recording.select(met), measured=recording.measured[met + by])
        yield Other(f"what was measured a row too {side}", moved, moved.q)
        kept = recording.select(met)
        for j, own in enumerate(np.eye(recording.q.shape[1], dtype=bool)):
            q = np.where(own, recording.q[met + by], kept.q)
            yield Other(f"q{j + 1} a row too {side}", kept, q)


def _others(r: Recording) -> Iterator[Other]:
    """Other simple set-ups with what is other in them, the likeliest first."""
    turns = r.chain.turning
    slips = signs(r.q), zeros(r.q, turns), swaps(r.q), turned_round(r.q)
    for slip in itertools.chain(*slips, counted_from_others(r.q, turns)):
        yield Other(slip.change, r, slip.q)
    for change, other in _other_recordings(r):
        yield Other(change, other, other.q)
    # Two changes at once are named where one does not do.
    for j, quarter in product(np.flatnonzero(turns).tolist(), (1, 3, 2)):
        change = f"{QUARTERS[quarter]} added to q{j + 1} and its sign turned"
        yield Other(change, r, moved_zero(turned_signs(r.q, [j]), j, quarter))
    most = r.chain.n if r.chain.n <= constants.MOST_SIGNS else 1
    for count in range(2, most + 1):
        for joints in combinations(range(r.chain.n), count):
            yield Other(f"the signs of {named(joints)} turned", r, turned_signs(r.q, joints))


def _other_recordings(r: Recording) -> Iterator[tuple[str, Recording]]:
    """Measurements, sockets or robots that are other."""
    if r.measured.shape[1]:
        mirrored = replace(r, measured=r.measured * MIRROR[: r.measured.shape[1]])
        yield "the device's axes mirrored (left-handed: turn the sign of z)", mirrored
    if r.kind.oriented:
        yield "each pose inverted: it is the device's in the tip's frame", _inverted(r)
        yield from _positions_alone(r)
    if r.robot.dh:
        rows = "the DH rows modified (Craig's), each with the a and alpha of the link before"
        yield rows, replace(r, chain=_modified(r.robot, r.chain.tip_frame))
    if r.kind.sockets:
        yield from _sockets_by_place(r)
    for name, other in _bundled_chains().items():
        if other.kinds == r.chain.kinds and name != r.robot.name:
            yield f"the robot {name}", replace(r, chain=other)


@cache
def _bundled_chains() -> dict[str, Chain]:
    """Chains of the robots of the package by name, read once: few recordings ask for one alone."""
    return {name: Robot.bundled(name).chain() for name in bundled_names()}


def _sockets_by_place(r: Recording) -> Iterator[tuple[str, Recording]]:
    """As many sockets as given, each row in the one that its tip lies in (k-means)."""
    assert r.socket is not None
    count = len(np.unique(r.socket))
    if 1 < count <= len(r) // constants.IN_A_SOCKET:
        tips = r.chain.tips(r.q, r.tool_offset)
        rng = np.random.default_rng(0)
        found = scipy.cluster.vq.kmeans(tips, count, iter=constants.SOCKET_STARTS, rng=rng)[0]
        places = scipy.cluster.vq.vq(tips, found)[0].astype(np.int64)
        yield "rows in the socket where their tip lies: mend socket", replace(r, socket=places)


def _inverted(r: Recording) -> Recording:
    """The device's poses in the tip's frame taken for the tip's in the device's."""
    back = rotations(r.measured[:, 3:]).transpose(0, 2, 1)
    places = -np.einsum("nij,nj->ni", back, r.measured[:, :3])
    turns = r.measured[:, 3:] * [1.0, -1.0, -1.0, -1.0]
    return replace(r, measured=np.column_stack([places, turns]))


def _modified(robot: Robot, tip_frame: str) -> Chain:
    """The chain of rows whose a and alpha lead to their joint, the first ones part of the base."""
    rows = robot.dh or ()
    after = [*rows[1:], replace(rows[-1], a=0.0, alpha=0.0)]
    moved = [replace(row, a=k.a, alpha=k.alpha) for row, k in zip(rows, after, strict=True)]
    return Robot.from_dh(moved, tip_frame=robot.default_tip).chain(tip_frame)


def _positions_alone(r: Recording) -> Iterator[tuple[str, Recording]]:
    """Positions mirrored in one axis or in two that are swapped, beside rotations that are not."""
    y = r.measured
    for axis, name in enumerate("xyz"):
        turned = y * np.where(np.arange(y.shape[1]) == axis, -1.0, 1.0)
        yield f"the sign of {name} turned, rotations as they are", replace(r, measured=turned)
    for i, j in combinations(range(3), 2):
        change = f"{'xyz'[i]} and {'xyz'[j]} swapped, rotations as they are"
        yield change, replace(r, measured=swapped(y, i, j))


def _wrong_encoder(r: Recording) -> WrongSetUp | None:
    """The second encoder that another joint, the other sign or a quarter of a turn explains."""
    for j in r.measured_joints:
        if not r.chain.turning[j]:
            continue
        read = r.measured[:, j]
        own = _scatter(read - r.q[:, j])
        against = f"the sign of m{j + 1} turned: m{j + 1} runs against q{j + 1}"
        tried = [(against, _scatter(read + r.q[:, j]))]
        tried += [
            (f"m{j + 1} taken for joint {i + 1}", _scatter(read - r.q[:, i]))
            for i in range(r.q.shape[1])
            if i != j
        ]
        change, left = min(tried, key=lambda pair: pair[1])
        if own > constants.PLAUSIBLE and left < constants.MENDED * own:
            return WrongSetUp(change, own, left, "rad")
        off = float(np.median(read - r.q[:, j]))
        quarter = round(off / (np.pi / 2))
        left = abs(off - quarter * np.pi / 2)
        mounted = "joint_offset" in r.always  # at any angle, as the recording says
        if quarter % 4 and max(left, own) < constants.PLAUSIBLE and not mounted:
            change = f"{QUARTERS[-quarter % 4]} added to m{j + 1}"
            return WrongSetUp(change, abs(off), left, "rad")
    own = _together(r, r.q)
    if not own > constants.PLAUSIBLE:
        return None
    for other in _a_row_off(r, np.arange(len(r))):
        left = _together(other.recording, other.q)
        if left < constants.MENDED * own:
            return WrongSetUp(other.change, own, left, "rad")
    part = mended_from_a_row_on(r)
    return WrongSetUp(*part, "rad") if part else None


def _together(r: Recording, q: Array) -> float:
    """Median [rad] over rows of how far the worst joint is off its encoder's middle."""
    joints = [j for j in r.measured_joints if r.chain.turning[j]]
    off = np.exp(1j * (r.measured[:, joints] - q[:, joints]))
    off = np.angle(off / off.mean(axis=0))
    return float(np.median(np.abs(off).max(axis=1))) if joints else 0.0


def _scatter(values: Array) -> float:
    """Median distance of angles from their median, to a turn; gross errors do not move it."""
    values = values - 2 * np.pi * whole_turns(values)
    return float(np.median(np.abs(values - np.median(values))))
