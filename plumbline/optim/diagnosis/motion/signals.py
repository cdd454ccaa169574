r"""A recording on one even clock: commands, positions, speeds, loads and inertias, run by run.

Runs end where the group changes, where rows are no longer held out, and where the clock leaps.
Rows that begin to be held out go on with their run: how they begin is what came before.
Gravity, Coriolis and the other joints' pull enter as data, from Pinocchio at the measured state:
:math:`h_i` and :math:`M_{ii}(q)`. So every joint is a small problem of its own.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects.motion_effect import Seen
from plumbline.kinematics.law import Law
from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion import constants
from plumbline.optim.diagnosis.motion.bodies import bodies_at, free
from plumbline.optim.diagnosis.motion.carried import model_of
from plumbline.optim.diagnosis.motion.clock import on_even_clock
from plumbline.optim.diagnosis.motion.fit import evaluated
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.settled import settled
from plumbline.optim.diagnosis.motion.units import sizes_of
from plumbline.optim.diagnosis.motion.windows import Array, Drives, Windows
from plumbline.optim.diagnosis.prior import MOST_FOLDS

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Signals:
    """M samples of n joints, evenly spaced within a run.

    Attributes:
        recording: Where they are from.
        dt: Time from sample to sample [s].
        time: Time (M,) [s].
        command: Commands (M, n).
        q: Measured positions (M, n) [rad].
        posture: The same smoothed, where loads are worked out: those know no reading's noise.
        speed: Their smoothed derivatives (M, n) [rad/s].
        acceleration: Theirs (M, n) [rad/s^2].
        first: Where the run of each sample begins (M,).
        group: Group of each sample (M,).
        held: Whether no fit may see it (M,).
        length: Samples of a window after its start.
        averaged: Noise of a sample, as a share of a reading's: between two they are averaged.
        pushes: By what torque (M, n) [N m] the other joints push each that stands still over the
            step to a sample, given what drives them; None where they are taken to go as read.
        drives: What drives them, each joint's causes with their values; none if all are ideal.
        behind: By how long Coriolis torques are of earlier speeds [s]: of those that a simulator's
            step began with, where the places are by those that it ended with.
        read: What was read (M, n) [rad], where positions are less what of them is known; else None.
    """

    recording: MotionRecording
    dt: float
    time: Array
    command: Array
    q: Array
    posture: Array
    speed: Array
    acceleration: Array
    first: Integers
    group: Integers
    held: NDArray[np.bool_]
    length: int
    averaged: float
    pushes: Array | None = None
    drives: Drives = ()
    behind: float = 0.0
    read: Array | None = None

    @property
    def sigma(self) -> float | None:
        """Stated noise of a sample [rad]; None if unknown."""
        stated = self.recording.noise_std
        return None if stated is None else stated * self.averaged

    @property
    def finite(self) -> bool:
        """Whether no state runs off, as of bodies or drives that are far from what they are."""
        pushes = 0.0 if self.pushes is None else self.pushes
        states = (self.q, self.posture, self.speed, self.acceleration, pushes)
        return all(bool(np.isfinite(x).all()) for x in states)

    @cached_property
    def bodies(self) -> tuple[Integers, Array, Array]:
        """Samples (K,) [even], masses (K, n, n) [kg m^2], gravity and Coriolis (K, n) [N m]."""
        M = len(self.q)
        chosen = np.unique(np.linspace(0, M - 1, min(M, constants.MOST_STATES)).astype(np.int64))
        return chosen, *bodies_at(self.recording, self.posture[chosen], self.turning[chosen])

    @property
    def turning(self) -> Array:
        """Speeds that Coriolis torques are of (M, n) [rad/s]."""
        return self.speed - self.behind * self.acceleration

    @cached_property
    def loads(self) -> tuple[Array, Array]:
        """Torque of gravity, Coriolis and other joints, and inertia: both (M, n) [N m, kg m^2].

        Straight between the states at which they are worked out.
        """
        chosen, masses, h = self.bodies
        inertia = np.diagonal(masses, axis1=1, axis2=2)
        law = self.recording.law
        if self.pushes is not None:
            inertia = free(masses)
        elif law.known or law.pushes:
            # A servo that follows ideally yields to what it holds; what accelerates is noise to it.
            a = self.acceleration[chosen]
            h = h + np.einsum("kij,kj->ki", masses, a) - inertia * a
        if not law.pushes:  # a torque moves what the file states, be it as light as a wrist
            inertia = np.maximum(inertia, constants.LEAST_INERTIA)
        load, inertia = scipy.interpolate.interp1d(chosen, np.stack([h, inertia]), axis=1)(
            np.arange(len(self.q))
        )
        return load, inertia

    @cached_property
    def bare(self) -> Array:
        """Inertia about each joint with all at zero, the others free (n,) [kg m^2]."""
        if not self.has_masses:
            return np.ones(self.recording.n)
        model, index = model_of(self.recording), list(self.recording.index)
        M = pin.crba(model, model.createData(), pin.neutral(model))[np.ix_(index, index)]
        M += constants.LEAST_INERTIA * 1e-3 * np.eye(len(M))
        return np.asarray(1 / np.diagonal(np.linalg.inv(M)))

    @property
    def has_masses(self) -> bool:
        """Whether the robot's file states any mass."""
        return any(inertia.mass > 0 for inertia in self.recording.robot.model.inertias)

    @cached_property
    def starts(self) -> Integers:
        """Where windows start (W,), the counted parts of which follow one another.

        What follows positions has as much before the first as a window is long, if that is a
        quarter of its run at most: how it began is then forgotten, by a planned way too. Rows held
        out all count where it goes on.
        """
        settle, follows = self.settle, self.recording.law.follows
        begins = np.unique(np.append(self.first, np.flatnonzero(np.diff(self.held)) + 1))
        ends = np.append(begins[1:], len(self.q))
        found = []
        for begin, end in zip(begins, ends, strict=True):
            room = end - begin - 1 - self.length
            late = min(self.length, room // 4) if follows else 0
            early = min(max(round(constants.LONGEST_DELAY / self.dt), late), max(room, 0))
            if self.first[begin] < begin and follows:
                early = -min(settle + 1, begin - self.first[begin])
            found.append(np.arange(begin + early, end - self.length, self.length - settle))
        return np.concatenate(found) if found else np.empty(0, np.int64)

    @property
    def training(self) -> Integers:
        """Where the windows (W,) start that fits take: none that is held out."""
        known = self.starts[self.folds != 0] if self.held.any() else self.starts
        return spread(known, self.most)

    @property
    def most(self) -> int:
        """Windows that a fit takes."""
        wanted = round(constants.LOOKED_AT / (self.length * self.dt))
        return min(max(wanted, constants.LEAST_WINDOWS), constants.MOST_WINDOWS)

    @property
    def settle(self) -> int:
        """Samples of a window that do not count."""
        law = self.recording.law
        return max(round(self.length * constants.SETTLE[law] / constants.LENGTH[law]), 1)

    def windows(self, joint: int, starts: Integers) -> Windows:
        """Windows of one joint, counted from 0."""
        r, (h, inertia), size = self.recording, self.loads, sizes_of(self.recording.slides)[joint]
        return Windows(
            r.law, self.dt, float(r.kp[joint]), float(r.kd[joint]), self.command[:, joint],
            self.first, self.q[:, joint], self.posture[:, joint], self.speed[:, joint],
            h[:, joint], inertia[:, joint],
            starts, self.length, self.settle, size, self.bare[joint], self._push(joint),
            tuple((self.posture[:, k], self.speed[:, k]) for k in range(r.n) if k != joint),
            None if self.pushes is None else self.pushes[:, joint],
        )  # fmt: skip

    def seen(self, joint: int) -> Seen:
        """What a joint did."""
        h, inertia = self.loads
        speed = self.speed[:, joint] / sizes_of(self.recording.slides)[joint]
        if self.recording.law.pushes:
            return Seen(speed, self.command[:, joint], np.zeros_like(speed))
        u = self.command[:, joint]
        asked = np.gradient(np.gradient(u, self.dt), self.dt)
        return Seen(speed, inertia[:, joint] * np.gradient(speed, self.dt) + h[:, joint], asked)

    def _push(self, joint: int) -> float:
        """Half of the largest torque that was asked for [N m]: the joint's usual load."""
        if not self.recording.law.pushes:
            return 1.0
        return max(float(np.abs(self.command[:, joint]).max()) / 2, constants.LEAST_INERTIA)

    @cached_property
    def folds(self) -> Integers:
        """What is left out together, of each window (W,): groups, else stretches of time.

        Where rows are held out, they are fold 0 and all others -1, never left out.
        """
        if self.held.any():
            return np.where(self.held[self.starts + self.length], 0, -1)
        groups, number = np.unique(self.group[self.starts], return_inverse=True)
        if len(groups) > 1:
            return number % MOST_FOLDS
        return np.arange(len(self.starts)) * MOST_FOLDS // max(len(self.starts), 1)

    @property
    def held_out_by(self) -> str:
        """What is left out together, as a verdict calls it."""
        several = len(np.unique(self.group)) > 1 and not self.held.any()
        return "groups" if several else "time"


def signals_of(
    recording: MotionRecording,
    most: int = constants.MOST_SAMPLES,
    drives: Drives = (),
    *,
    read: bool = True,
) -> Signals:
    """A recording on an even clock, at most so many samples a window.

    Under torques the other joints' accelerations are part of a load: states are those that the
    drives make of the bodies and that were read, weighed.

    Args:
        recording: What was recorded.
        most: Samples of a window.
        drives: What is known of each joint's drive; ideal ones if nothing is.
        read: Whether its places were read, not made up: those are where loads are worked out.

    Raises:
        PlumblineError: No run of it is as long as a window.
    """
    if recording.law == Law.HELD:
        most = constants.MOST_HELD
    follows = recording.law.ideal or recording.law == Law.HELD
    s = _smoothed(recording, constants.POSTURE if follows else constants.SMOOTH, most)
    if not (recording.law.pushes and read):
        return s
    known = drives or (((), np.empty(0)),) * recording.n
    late = dict.fromkeys((0.0, recording.lead))
    found = [settled(replace(s, behind=behind), known) for behind in late]
    best = min(found, key=lambda one: _misfit(one, known)) if len(found) > 1 else found[0]
    return replace(best, drives=drives)


def _misfit(signals: Signals, drives: Drives) -> float:
    """Sum over the joints of the logarithm of what their drives leave."""
    all_windows = [signals.windows(j, signals.training) for j in range(signals.recording.n)]
    squares = [
        evaluated(w, *drive, slopes=False).square
        for w, drive in zip(all_windows, drives, strict=True)
        if len(w)
    ]
    return float(np.sum(np.log(np.maximum(squares, 1e-300))))


def _smoothed(r: MotionRecording, seconds: float, most: int) -> Signals:
    """The same, its speeds and accelerations smoothed over so long."""
    group = np.zeros(len(r), np.int64) if r.group is None else r.group
    held = np.zeros(len(r), bool) if r.held_out is None else r.held_out
    step = np.diff(r.time)
    dt = float(np.median(step[step > 0]))
    begun = (np.diff(group) != 0) | (step > constants.LONGEST_GAP * dt) | (step <= 0)
    cut = begun | (np.diff(held) != 0)
    bounds = np.concatenate([[0], np.flatnonzero(cut) + 1, [len(r)]])
    longest = float(max(r.time[b - 1] - r.time[a] for a, b in pairwise(bounds)))
    span = min(constants.LENGTH[r.law], longest / 3)
    dt = max(dt, span / most)
    length = int(span / dt)
    if length < 10:
        raise PlumblineError(
            f"{r.name}: rows {dt:.3g} s apart, the longest run {longest:.3g} s; at most "
            f"{constants.LENGTH[r.law] / 10:.3g} s expected and {30 * dt:.3g} s at least; record "
            "for longer without a gap, or mend 'time' if it is in ms"
        )
    runs = [(a, b) for a, b in pairwise(bounds) if b - a > 1]
    parts = [on_even_clock(r, slice(a, b), dt, seconds) for a, b in runs]
    sizes = [len(p[0]) for p in parts]
    begins = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    for k, ((_, end), (a, _)) in enumerate(pairwise(runs), 1):
        if a == end and held[a] > held[a - 1] and not begun[a - 1]:
            begins[k] = begins[k - 1]
    kept = [a for a, _ in runs]
    joined = (np.concatenate(x) for x in zip(*parts, strict=True))
    time, command, q, posture, speed, acceleration, square = joined
    return Signals(
        r, dt, time, command, q, posture, speed, acceleration, np.repeat(begins, sizes),
        np.repeat(group[kept], sizes), np.repeat(held[kept], sizes), length,
        float(np.sqrt(np.mean(square))),
    )  # fmt: skip


def spread(starts: Integers, most: float) -> Integers:
    """At most so many of them, in blocks that are spread evenly: neighbours are one roll-out."""
    count = max(round(most), 1)
    if len(starts) <= count:
        return starts
    blocks = -(-count // constants.BLOCK)
    first = np.linspace(0, len(starts) - constants.BLOCK, blocks).astype(np.int64)
    chosen = np.unique(np.maximum(first[:, None] + np.arange(constants.BLOCK), 0))
    return starts[chosen][:count]
