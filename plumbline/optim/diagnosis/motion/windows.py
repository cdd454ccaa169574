"""Windows of one joint's motion: its commands, its measured start and the samples that count."""

import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion.constants import OPEN, POSTURE, RATIO_STEP

Array = NDArray[np.float64]
Effects = tuple[MotionEffect, ...]
Drives = tuple[tuple[Effects, Array], ...]  # effects of each joint, with their values
Integers = NDArray[np.int64]
SMOOTH = (Law.VELOCITY, Law.SMOOTH)  # commands that run smoothly between rows


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one joint, all of one length."""

    law: Law  # what the joint's command is
    dt: float  # time from sample to sample [s]
    kp: float  # known gain [N m/rad]; zero if there is none
    kd: float  # known damping [N m s/rad]
    command: Array  # commands of the joint's whole recording (N,)
    first: Integers  # where in it the run of each sample begins (N,): no command is older
    q: Array  # measured positions (N,) [rad]
    posture: Array  # the same smoothed (N,) [rad]
    speed: Array  # measured speeds (N,) [rad/s]
    load: Array  # torque of gravity and of the other joints (N,) [N m]
    inertia: Array  # inertia about the joint (N,) [kg m^2]
    start: Integers  # sample at which each window starts (W,)
    length: int  # samples after it (H)
    settle: int  # how many of those do not count, since what nobody measured settles in them
    size: float = 1.0  # what a radian is in the unit of ``q``
    bare: float = 1.0  # inertia about the joint at its zero, the others free [kg m^2]
    push: float = 1.0  # what a newton metre of command is in this joint's usual ones
    others: tuple[tuple[Array, Array], ...] = ()  # places and speeds (N,) of each other joint
    pushes: Array | None = None  # of the other joints, over the step to each sample (N,) [N m]

    def __len__(self) -> int:
        """How many windows there are."""
        return len(self.start)

    @property
    def drive(self) -> Law:
        """The law of a step, which knows only its ends."""
        return Law.POSITION if self.law == Law.SMOOTH else self.law

    @cached_property
    def samples(self) -> Integers:
        """Indices of the samples that count (W, H - settle)."""
        return self.start[:, None] + np.arange(self.settle + 1, self.length + 1)

    @cached_property
    def measured(self) -> Array:
        """What was measured there (W, H - settle) [rad]."""
        return self.q[self.samples]

    @cached_property
    def ways(self) -> dict[Hashable, Array]:
        """Ways that a servo plans, as last worked out."""
        return {}

    @cached_property
    def given(self) -> Array:
        """Load and inertia (R, steps, 2) of every step of the roll-outs."""
        begin, steps, _ = self.passes
        at = begin[:, None] + np.arange(1, steps.max(initial=0) + 1)
        return np.stack(self.loads(np.minimum(at, len(self.q) - 1)), axis=-1)

    def sizes(self, effects: Effects) -> Array:
        """Factors (P,) by which widths, bounds and starts of parameters grow for this joint."""
        return np.array([self._size(e) for e in effects], dtype=float)

    def _size(self, effect: MotionEffect) -> float:
        if effect.of_command and self.law.pushes:
            return self.push
        return self.size if effect.parameter.unit in ("rad", "rad/s") else 1.0

    def loads(self, at: Integers) -> tuple[Array, Array]:
        """Load and inertia for the steps that end at samples (...): what pushes feels their mean.

        An ideal servo yields to its load where it is, at the sample itself.
        """
        if not self.law.known and not self.law.pushes:
            return self.load[at], self.inertia[at]
        load, inertia = ((x[at] + x[at - 1]) / 2 for x in (self.load, self.inertia))
        return (load if self.pushes is None else load + self.pushes[at]), inertia

    def level(self, misses: Array) -> Array:
        """Misses (W, K, ...) without what a window's unknown start makes of them."""
        if not OPEN.get(self.law, 0):
            return misses
        starts, columns = self._starts, misses.reshape(*misses.shape[:2], -1)
        return (columns - starts @ (starts.T @ columns)).reshape(misses.shape)

    @cached_property
    def _starts(self) -> Array:
        """An orthonormal basis (K, a) of what unknown starts make of a window."""
        even = np.linspace(-1.0, 1.0, self.length - self.settle)
        return np.linalg.qr(np.vander(even, OPEN[self.law]))[0]

    def integrated(self, features: Array) -> Array:
        """What functions (n, F) that act on a drive's rate or torque do to its place (n, F)."""
        order = OPEN.get(self.law, 0)
        if not order:
            return features
        W, K = len(self), self.length - self.settle
        found = features.reshape(W, K, -1)
        for _ in range(order):
            found = np.cumsum(found, axis=1) / K
        return self.level(found).reshape(W * K, -1)

    @cached_property
    def passes(self) -> tuple[Integers, Integers, Integers]:
        """Samples where roll-outs begin and how many they take (R,), and that of each window (W,).

        A servo on position forgets where it began, so windows that follow one another are one
        roll-out, with as much before the first as a window is long: what a servo plans, and how
        play lies, are then as the commands before have it.
        """
        if not self.law.follows or not len(self):
            steps = np.full(len(self), self.length, np.int64)
            return self.start, steps, np.arange(len(self), dtype=np.int64)
        run = self.first[self.start]
        new = (np.diff(self.start) > self.length) | (np.diff(run) != 0)
        row = np.concatenate([[0], np.cumsum(new)]).astype(np.int64)
        heads = np.flatnonzero(np.concatenate([[True], new]))
        known = run[heads] + round(POSTURE / 2 / self.dt)  # speeds have rows on both sides
        begin = np.maximum(self.start[heads] - self.length, np.minimum(known, self.start[heads]))
        ends = self.start[np.append(heads[1:], len(self)) - 1] + self.length
        return begin, ends - begin, row

    @cached_property
    def reach(self) -> tuple[Integers, Integers, Integers]:
        """Samples (R, steps + 1) of the roll-outs, and the first and last of each one's run."""
        begin, steps, _ = self.passes
        return self.reach_of(begin, int(steps.max(initial=0)))

    def reach_of(self, begin: Integers, steps: int) -> tuple[Integers, Integers, Integers]:
        """The same of other roll-outs (R,)."""
        at = np.minimum(begin[:, None] + np.arange(steps + 1), len(self.command) - 1)
        return at, self.first[at], self.last[at]

    def asked(
        self, shift: float, late: float, reach: tuple[Integers, Integers, Integers]
    ) -> tuple[Array, Array, Array]:
        """Commands (R, steps + 1) obeyed so much later [s], and their derivatives by that.

        What trails a ramp by ``late`` [s] takes the mean of a step, what does not its end: of
        that, too.
        """
        at, first, last = reach
        shift += self.law.holds * self.dt  # what stood over the sample before this one
        place = np.clip(at - shift / self.dt, first, last)
        low = np.minimum(place.astype(np.int64), len(self.command) - 2)
        f, slope = place - low, self.slope[low]
        if self.law.holds:
            return self.command[low] + f * slope, -slope / self.dt, np.zeros_like(f)
        mean, by_late = share_of_mean(late / self.dt) if self.law.ideal else (1.0, 0.0)
        if self.law in SMOOTH:
            return self._smooth(low, f, mean, by_late)
        corner = self.corner[low]  # which within a step is off its line
        off = f * (1 - f) * corner
        straight = self.command[low] + f * slope - mean * off
        return straight, ((1 - 2 * f) * mean * corner - slope) / self.dt, -by_late / self.dt * off

    def _smooth(
        self, low: Integers, f: Array, mean: float, by_late: float
    ) -> tuple[Array, Array, Array]:
        u, bend = self.command, self.bend
        u, bend = u - mean * bend / 12, bend - mean * bend_of(bend, self.first) / 12
        ends = self.ends[low]
        slope = np.where(ends, 0.0, u[low + 1] - u[low])
        bends = [np.where(ends, 0.0, bend[low + k]) for k in (0, 1)]
        more = -by_late * ((1 - f) * self.bend[low] + f * self.bend[low + 1]) / 12 / self.dt
        less = -between_slope(slope, bends, f) / self.dt
        return between(u[low], slope, bends, f), less, more

    @cached_property
    def last(self) -> Integers:
        """Where in the recording the run of each sample ends (N,): no command is later."""
        begins, run = np.unique(self.first, return_inverse=True)
        return np.append(begins[1:], len(self.first))[run] - 1

    @cached_property
    def ends(self) -> NDArray[np.bool_]:
        """Whether the next sample's command (N - 1,) is of another run."""
        return np.diff(self.first) > 0

    @cached_property
    def slope(self) -> Array:
        """First differences of the commands (N - 1,), none where a run ends."""
        return np.where(self.ends, 0.0, np.diff(self.command))

    @cached_property
    def bend(self) -> Array:
        """Second differences of the commands (N,), none where a run begins or ends."""
        return bend_of(self.command, self.first)

    @cached_property
    def corner(self) -> Array:
        """A quarter of both of a step's ends' (N - 1,), none where a run ends."""
        return np.where(self.ends, 0.0, (self.bend[:-1] + self.bend[1:]) / 4)


def share_of_mean(ratio: float) -> tuple[float, float]:
    r"""How far what lags by so many samples takes a step's mean, and not its end; its derivative.

    Commands that run smoothly have over a step the mean of the ends less :math:`\delta^2 / 12`, of
    second differences; a lag of ratio r weighs what they are off a straight line by
    :math:`6 (r - 2 r^2 + (r + 2 r^2)\, e^{-1/r}) / (1 - e^{-1/r})` of that: all for long ones.
    """
    ahead = ratio + RATIO_STEP * (1 + ratio)
    here, there = (_share(r) for r in (ratio, ahead))
    return here, (there - here) / (ahead - ratio)


def _share(r: float) -> float:
    stays, square = math.exp(-1 / (r + 1e-9)), 2 * r**2
    return 6 * (r - square + stays * (r + square)) / (1 - stays)


def bend_of(u: Array, first: NDArray[np.int64]) -> Array:
    """Second differences (N,), none where a run begins or ends."""
    found = np.zeros_like(u)
    found[1:-1] = np.where(first[2:] == first[:-2], u[2:] - 2 * u[1:-1] + u[:-2], 0.0)
    return found


def between(start: Array, slope: Array, bends: list[Array], f: Array) -> Array:
    """A share f of a step on, by its ends and their second differences (Everett's formula)."""
    back, on = ((x**3 - x) / 6 for x in (1 - f, f))
    return np.asarray(start + f * slope + back * bends[0] + on * bends[1])


def between_slope(slope: Array, bends: list[Array], f: Array) -> Array:
    """Its derivative by f."""
    back, on = ((3 * x**2 - 1) / 6 for x in (1 - f, f))
    return np.asarray(slope - back * bends[0] + on * bends[1])
