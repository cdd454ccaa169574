r"""A set-up that is right in one part of the rows and wrong in the rest.

A reading that was lost, a second file in other units, a device that was put elsewhere: up to some
row, or from one on, all is well. The frame F, shift t and tool d of the rows that meet the model
together are those of the window of successive rows that leaves most rows a tenth of the misfit,

.. math:: |F\,(p_i + R_i d) + t - y_i| < 0.1\, \operatorname{median}_k |\ldots|_k,

found again from these (Fischler and Bolles 1981, Commun. ACM 24(6)). The part is the stretch with
most such rows over others; what mends the rows next to it, with F, t and d as they are, is named.
Where those that are right are too few to fix a frame, the rest does, paired some rows off.

The frame that carries predicted tips onto measured ones, and the tool where it is free.

What is left are the gaps after the best frame F, shift t and, where it is free, tool d, all by
squares,

.. math:: \min_{F, t, d} \sum_i |F\,(p_i + R_i d) + t - y_i|^2
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import NamedTuple, Self

import numpy as np
import scipy

from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.tool_slip import ToolSlip
from plumbline.optim.recording import constants
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.slips import signs, swaps, zeros
from plumbline.optim.recording.table import Array, Flags, Integers
from plumbline.optim.rigid import best_rotation, some_of


class Mended(NamedTuple):
    """What mends the rest of the rows."""

    change: str  # what is other in them, in words
    missed: float  # by how much they miss the model as they are, in the median [m]
    left: float  # what is left of that


class Tips(NamedTuple):
    """Tips, or joints that turn, as predicted, and as measured; of several windows of rows too."""

    R: Array  # rotations (..., N, 3, 3) of tips
    p: Array  # places (..., N, 3) [m], or angles (..., N, k) [rad]
    y: Array  # the same as measured

    def of(self, rows: Integers | slice) -> Self:
        """Those of some rows, or of windows (W, n) of them."""
        return type(self)(*(each[rows] for each in self))


class Frame(NamedTuple):
    """A frame and a tool, or those of several windows of rows."""

    F: Array  # the device's frame (..., 3, 3)
    t: Array  # its shift (..., 3) [m]
    d: Array  # what the tool is other than stated (..., 3) [m]

    @classmethod
    def of(cls, tips: Tips, fit_tool: bool) -> Self:
        """The best of some tips; the tool as it is unless it is fitted."""
        F = matched(*tips, fit_tool)[0]
        J = np.broadcast_to(np.eye(3), tips.R.shape)
        J = np.concatenate([F[..., None, :, :] @ tips.R, J], axis=-1) if fit_tool else J
        z = least(J, tips.y - tips.p @ np.swapaxes(F, -1, -2))
        return cls(F, z[..., -3:], z[..., :3] if fit_tool else np.zeros_like(z))

    def missed(self, tips: Tips) -> Array:
        """By how much tips (N,) [m] are missed."""
        predicted = (tips.p + tips.R @ self.d) @ self.F.T + self.t
        return np.asarray(np.linalg.norm(predicted - tips.y, axis=1))


class Zeros(NamedTuple):
    """Zeros of second encoders, or those of several windows of rows."""

    off: Array  # (..., k) [rad], to a turn

    @classmethod
    def of(cls, joints: Tips) -> Self:
        """The mean of some readings of them."""
        return cls(np.angle(np.exp(1j * (joints.y - joints.p)).mean(axis=-2)))

    def missed(self, joints: Tips) -> Array:
        """By how much joints (N,) [rad] are missed."""
        off = np.exp(1j * (joints.y - joints.p - self.off))
        return np.asarray(np.linalg.norm(np.angle(off), axis=1))


Fitted = Frame | Zeros
Fit = Callable[[Tips], Fitted]


def mended_from_a_row_on(r: Recording) -> Mended | None:
    """What mends the rows before or after those that meet the model together, if anything does.

    All that is right and all that is mended are together most rows.
    """
    if r.kind.sockets or r.kind.efforts or len(r) < 2 * constants.FEWEST_POSTURES:
        return None
    fit: Fit = Zeros.of if r.kind.encoders else partial(Frame.of, fit_tool="tool" in r.always)
    return _beside_a_part(r, fit) or _beside_a_few(r, fit)


def _beside_a_part(r: Recording, fit: Fit) -> Mended | None:
    """What mends the rows next to those that are right as they are."""
    tips = _tips(r, r.q, r.measured)
    near = constants.MENDED * float(np.median(fit(tips).missed(tips)))
    frame = _most_met(tips, near, fit)
    first, last = _stretch(frame.missed(tips) < near)
    before = first > len(r) - last
    rest = np.arange(first)[::-1] if before else np.arange(last, len(r))
    missed = frame.missed(tips.of(rest))
    near = constants.MENDED * float(np.median(missed)) if len(rest) else 0.0
    elsewhere = _elsewhere(frame, tips.of(rest), near, fit) if len(rest) else ()
    tried = chain(_as_in(frame, r, rest), elsewhere, _misread(frame, r, rest, near))
    run, change, left = max(
        ((_run(left < near), change, left) for change, left in tried),
        key=lambda each: each[0],
        default=(0, "", missed),
    )
    told = run >= constants.FEWEST_MENDED and last - first >= constants.FEWEST_POSTURES
    if not told or run + last - first <= len(r) / 2:
        return None
    where = f"in the first {run} rows" if before else f"from row {last + 1} on"
    return Mended(f"{change} {where}", *(float(np.median(e[:run])) for e in (missed, left)))


def _beside_a_few(r: Recording, fit: Fit) -> Mended | None:
    """By how many rows all but some of the first are late or early, where these fix no frame.

    Along a path, rows that are late may be a lag: there the first must show that they are none.
    """
    tips = _tips(r, r.q, r.measured)
    near = constants.MENDED * float(np.median(fit(tips).missed(tips)))
    path = r.time is not None or r.velocity is not None
    for by, change in _rows_off():
        start, end = max(0, -by), len(r) - max(0, by)
        paired = tips.of(slice(start, end))._replace(y=tips.y[start + by : end + by])
        frame = _most_met(paired, near, fit)
        left = frame.missed(paired)
        first, last = _stretch(left < near)
        missed = frame.missed(tips)
        run = _run(missed[:first][::-1] < near)
        needed = constants.FEWEST_MENDED if path else min(first, constants.FEWEST_MENDED)
        if run >= needed and last - first > len(r) / 2:
            where = f" from row {first + 1} on" if first else ""
            sizes = (float(np.median(e[first:last])) for e in (missed, left))
            return Mended(change + where, *sizes)
    return None


def _rows_off() -> Iterator[tuple[int, str]]:
    """By how many rows measurements may be late, or early (negative), and in words."""
    for by in (*range(1, constants.ROWS_OFF + 1), *range(-constants.ROWS_OFF, 0)):
        count = "a row" if abs(by) == 1 else f"{abs(by)} rows"
        yield by, f"what was measured {count} too {'late' if by > 0 else 'early'}"


def _tips(r: Recording, q: Array, measured: Array) -> Tips:
    if r.kind.encoders:
        joints = [j for j in r.measured_joints if r.chain.turning[j]]
        return Tips(np.empty((len(q), 0)), q[:, joints], measured[:, joints])
    T = r.chain.placement(q)
    return Tips(T[:, :3, :3], T[:, :3, 3] + T[:, :3, :3] @ r.tool_offset, measured[:, :3])


def _most_met(tips: Tips, near: float, fit: Fit) -> Fitted:
    """The frame that most tips meet, of those of windows of successive rows."""
    size = constants.FEWEST_POSTURES
    starts = some_of(len(tips.p) - size + 1, constants.WINDOWS)
    windows = fit(tips.of(starts[:, None] + np.arange(size)))
    frames = (type(windows)(*each) for each in zip(*windows, strict=True))
    best = max(frames, key=lambda frame: np.sum(frame.missed(tips) < near))
    for _ in range(constants.FRAME_STEPS):
        met = np.flatnonzero(best.missed(tips) < near)
        if len(met) < size:
            break
        best = fit(tips.of(met))
    return best


def _stretch(met: Flags) -> tuple[int, int]:
    """The stretch of rows, from one up to another, with most that meet it over those that do not.

    Bentley (1984), Commun. ACM 27(9).
    """
    total = np.concatenate([[0], np.cumsum(np.where(met, 1, -1))])
    lowest = np.minimum.accumulate(total)
    last = int(np.argmax(total - lowest))
    return int(np.argmin(total[: last + 1])), last


def _run(met: Flags) -> int:
    """How many of the first rows most of all meet it over those that do not."""
    return int(np.argmax(np.concatenate([[0], np.cumsum(np.where(met, 1, -1))])))


def _as_in(frame: Fitted, r: Recording, rest: Integers) -> Iterator[tuple[str, Array]]:
    """What else rows may be, in words, and by how much they (k,) then miss the model."""
    measured, q = r.measured, r.q[rest]
    for by, change in _rows_off():
        there = np.clip(rest + by, 0, len(r) - 1)
        left = frame.missed(_tips(r, q, measured[there]))
        yield change, np.where(there == rest + by, left, np.inf)
    for slip in chain(signs(q), zeros(q, r.chain.turning), swaps(q)):
        yield slip.change, frame.missed(_tips(r, slip.q, measured[rest]))


def _elsewhere(frame: Fitted, rest: Tips, near: float, fit: Fit) -> Iterator[tuple[str, Array]]:
    """Other zeros, tip or frame of all rows, farther off than any step of the library's.

    What is nearer may be that, or a play that was approached from one side and then the other.
    """
    if len(rest.p) < constants.FEWEST_POSTURES:
        return
    other = _most_met(rest, near, fit)
    left = other.missed(rest)
    whole = bool(np.mean(left < near) > constants.WHOLE)
    if isinstance(frame, Zeros) and isinstance(other, Zeros):
        apart = np.abs(np.angle(np.exp(1j * (other.off - frame.off)))).max(initial=0.0)
        if whole and apart > 2.0 * Backlash.play.upper:
            yield "other zeros of the encoders", left
    if isinstance(frame, Frame) and isinstance(other, Frame):
        gaps = rest.y - (rest.p + rest.R @ frame.d) @ frame.F.T - frame.t
        slipped = least(frame.F @ rest.R, gaps)
        if np.abs(slipped).max() > ToolSlip.x.upper:
            yield "another tip of the tool", frame._replace(d=frame.d + slipped).missed(rest)
        shift = np.abs(frame.F.T @ (other.t - frame.t)).max() / BaseBump.x.upper
        turn = scipy.spatial.transform.Rotation.from_matrix(frame.F.T @ other.F).as_rotvec()
        if whole and max(shift, np.abs(turn).max() / BaseBump.rx.upper) > 1.0:
            yield "another frame of the device", left


def _misread(
    frame: Fitted, r: Recording, rest: Integers, near: float
) -> Iterator[tuple[str, Array]]:
    """One joint that stands still as it reads, or counts from elsewhere, where it alone would do.

    What it is off by is farther than any play.
    """
    if not isinstance(frame, Frame):
        return
    for j in np.flatnonzero(r.chain.turning).tolist():
        left, angle = _by_one_joint(frame, r, rest, j)
        run, read = _run(left < near), r.q[rest, j]
        met = np.flatnonzero(left[:run] < near)
        if run < constants.FEWEST_POSTURES:
            continue
        off = np.exp(1j * (angle - read)[met])
        if np.abs(np.angle(off)).max() <= Backlash.play.upper:
            continue
        if np.ptp(read[:run]) == 0.0:
            yield f"q{j + 1} as it moves: it reads {read[0]:.5g} rad", left
        elif abs(np.mean(off)) > constants.ONE_ANGLE:
            yield f"{np.degrees(np.angle(np.mean(off))):.0f} degrees added to q{j + 1}", left


def _by_one_joint(frame: Frame, r: Recording, rest: Integers, j: int) -> tuple[Array, Array]:
    r"""By how much rows (k,) miss the model whatever joint j reads, and at which angle [rad].

    The tip is on a circle about the axis, :math:`c + a \cos\theta + b \sin\theta`, by three points.
    """
    at, q = [], r.q[rest].copy()
    for turn in range(3):
        q[:, j] = turn * 2.0 * np.pi / 3.0
        tips = _tips(r, q, r.measured[rest])
        at.append(tips.p + tips.R @ frame.d)
    c = np.mean(at, axis=0)
    a, b = at[0] - c, (at[1] - at[2]) / np.sqrt(3.0)
    gap = (r.measured[rest, :3] - frame.t) @ frame.F - c
    angle = np.arctan2(np.sum(gap * b, axis=1), np.sum(gap * a, axis=1))
    nearest = np.cos(angle)[:, None] * a + np.sin(angle)[:, None] * b
    return np.asarray(np.linalg.norm(gap - nearest, axis=1)), angle


UNIT_CROSSES = np.cross(np.eye(3)[None], np.eye(3)[:, None]).reshape(3, 9)


def matched(R: Array, p: Array, measured: Array, fit_tool: bool) -> tuple[Array, Array]:
    """The best frame's rotation (..., 3, 3), and measured minus predicted (..., N, 3) in it [m].

    R (..., N, 3, 3) and p (..., N, 3) [m] are the tips' as predicted, by as many set-ups as may be,
    or in as many windows of rows, each as measured (N, 3) or (..., N, 3); ``fit_tool`` frees the
    tool.
    """
    a, y = p - p.mean(axis=-2, keepdims=True), measured - measured.mean(axis=-2, keepdims=True)
    inner, tool = R - R.mean(axis=-3, keepdims=True), np.zeros((*p.shape[:-2], 1, 3, 1))
    F, v = best_rotation(a, y), a
    for _ in range(constants.FRAME_STEPS if fit_tool else 0):
        J = np.concatenate([-cross(v), inner], axis=-1)
        tool = tool + least(J, y @ F - v)[..., None, 3:, None]
        v = a + (inner @ tool)[..., 0]
        F = best_rotation(v, y)
    return F, y - v @ np.swapaxes(F, -1, -2)


def least(J: Array, gaps: Array) -> Array:
    """Unknowns (..., k) that make gaps (..., N, 3) least by their columns (..., N, 3, k)."""
    J = J.reshape(*J.shape[:-3], -1, J.shape[-1])
    J_T = np.swapaxes(J, -1, -2)
    values, vectors = np.linalg.eigh(J_T @ J)
    told = values > constants.HARDLY_TOLD**2 * values[..., -1:]
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    turned = np.swapaxes(vectors, -1, -2) @ (J_T @ gaps.reshape(*J.shape[:-1], 1))
    return np.asarray((vectors @ (inverse[..., None] * turned))[..., 0])


def cross(v: Array) -> Array:
    """Matrices (..., 3, 3) that take the cross products of vectors (..., 3) with another."""
    return np.asarray(v @ UNIT_CROSSES).reshape(*v.shape, 3)
