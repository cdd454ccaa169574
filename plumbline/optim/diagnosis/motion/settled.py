"""A motion's states, pass by pass: bodies where they were, and what pushes each joint there."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from plumbline.optim.diagnosis.motion.bodies import free, over_steps
from plumbline.optim.diagnosis.motion.carried import Carried
from plumbline.optim.diagnosis.motion.clock import mean_of_ends
from plumbline.optim.diagnosis.motion.constants import AT_ONCE, KNOWN, PASSES
from plumbline.optim.diagnosis.motion.rollout import pushed
from plumbline.optim.diagnosis.motion.states import States, believed, slopes_at
from plumbline.optim.diagnosis.motion.windows import Array, Drives

Signals = Any  # whose own module asks this one


@dataclass(frozen=True, eq=False)
class _Moving:
    """What moves the bodies of all samples by their drives, at states that were found."""

    signals: Signals
    drives: Drives

    @cached_property
    def bodies(self) -> tuple[Array, Array, Array]:
        """Masses (M, n, n), inertias, the others free (M, n), gravity and Coriolis (M, n)."""
        chosen, masses, h = self.signals.bodies
        every, rows = (masses, free(masses), h), np.arange(len(self.signals.q))
        masses, alone, h = (
            np.asarray(scipy.interpolate.interp1d(chosen, x, axis=0)(rows), float) for x in every
        )
        return masses, alone, h

    @cached_property
    def torque(self) -> Array:
        """What drives give over each step (M - 1, n) [N m]."""
        s = self.signals
        given = [pushed(s.windows(j, s.starts), *drive) for j, drive in enumerate(self.drives)]
        return np.column_stack(given)

    @cached_property
    def accelerations(self) -> tuple[Array, Array]:
        """In the mean of each step, and by how much they change (M - 1, n) [rad/s^2]."""
        s, (masses, _, h) = self.signals, self.bodies
        return over_steps(s.recording, s.dt, (s.posture, s.turning), (masses, h), self.torque)

    def runs(self, read: Array, slopes: tuple[Array, Array]) -> Iterator[tuple[slice, States]]:
        """States of each stretch of a run, at most so many samples at once."""
        s, (masses, alone, _), (mean, change) = self.signals, self.bodies, self.accelerations
        for begin, end in pairwise([*np.unique(s.first), len(s.q)]):
            bent = np.zeros((end - begin, s.recording.n))
            bent[1:] = s.dt**2 / 12 * np.cumsum(change[begin : end - 1], axis=0)
            parts = -(-(end - begin) // AT_ONCE)
            for a, b in pairwise(np.linspace(begin, end, parts + 1).astype(int).tolist()):
                now = slice(a, b)
                yield now, States(
                    s.dt, read[now], s.posture[now], s.speed[now],
                    masses[now] / alone[now, :, None], mean[a : b - 1],
                    bent[a - begin : b - begin], *(x[now] for x in slopes),
                )  # fmt: skip


def settled(s: Signals, drives: Drives) -> Signals:
    r"""The same, its states by what was read and by what drives make of the bodies.

    With torques t beyond gravity and Coriolis, and others that give way,

    .. math:: J_j a_j = t_j - p_j, \qquad J_j = 1 / (M^{-1})_{jj}, \qquad
              p = t - J M^{-1} t + (M - J) (\ddot q - M^{-1} t)

    in which p is of the others alone: no drive is judged by a load that its own was taken for.
    """
    n = s.recording.n
    weights, now = np.full(n, (KNOWN**3 * s.dt) ** -2.0), s
    for _ in range(PASSES):
        moved, read = _Moving(now, drives), s.q - s.recording.lead * now.speed
        mean, masses = moved.accelerations[0], moved.bodies[0]
        middle = np.concatenate([mean[:1], mean_of_ends(mean), mean[-1:]])
        slopes = slopes_at(s.recording, (now.posture, now.turning, middle), masses)
        found, squares, noise = np.empty((3, *s.q.shape)), [], []
        for rows, states in moved.runs(read, slopes):
            one = states.settled(weights)
            found[:, rows] = one.place, one.speed, one.acceleration
            squares.append(one.changes**2)
            noise.append((one.read - one.place) ** 2)
        squares_of, of_noise = (np.concatenate(x).mean(axis=0) for x in (squares, noise))
        weights = believed(s.dt, weights, squares_of, of_noise)
        now = replace(s, posture=found[0], speed=found[1], acceleration=found[2])
    return _pushed(now, drives)


def carrying(s: Signals, carried: Carried) -> Signals:
    """The same states, and what pushes each joint there if the tip carries this."""
    none = ((), np.empty(0))
    drives = s.drives or (none,) * s.recording.n
    bodies = replace(s.recording, carried=carried)
    return _pushed(replace(s, recording=bodies, q=s.read, pushes=None), drives)


def _pushed(now: Signals, drives: Drives) -> Signals:
    """At states that were found, what was read less its bends, and pushes of other joints."""
    moved, n = _Moving(now, drives), now.recording.n
    none = np.zeros((len(now.q), n, n))
    (masses, alone, h), mean = moved.bodies, moved.accelerations[0]
    q, off = now.q - now.recording.lead * now.speed, np.zeros_like(now.q)
    for rows, states in moved.runs(q.copy(), (none, none)):
        q[rows] += states.bent
        off[rows] = states.off
    pushes = np.zeros_like(q)
    pulls = np.einsum("kij,kj->ki", masses, off) - alone * off
    own = moved.torque - mean_of_ends(h) - mean_of_ends(alone) * mean
    pushes[1:] = own + mean_of_ends(pulls)
    return replace(now, q=q, pushes=pushes, read=now.q)
