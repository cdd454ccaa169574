r"""Where bodies were and how fast: what torques make of them and what was read, weighed.

Gravity and coupling are of where the arm is. An encoder's noise grows by them: where a load changes
by K with a place, an error :math:`\delta q` of that place is one of :math:`K \delta q / (J
\omega^2)` of what turns with an inertia J, and behind heavy links K / J is 1000 / s^2. So states
are not what readings are when smoothed, but

.. math:: \min_q \sum_{k, j} \frac{(q - y)_{k, j}^2}{\sigma_j^2}
          + \sum_{k, j} \frac{(e_{k+1} - e_k)_j^2}{s_j^2},
          \qquad e_j = \frac{1}{J_j} \bigl(M (\ddot q - a(q, \dot q))\bigr)_j

of readings y and of accelerations a that known drives make; e is what a drive gives beyond what is
known of it, over the inertia that it turns. Its changes s are as large as they are found to be:
where one drive is wrong it alone is not believed, and its neighbours are moved by what it did. With
:math:`\omega_j^3 = s_j / (\sigma_j \Delta t)`, readings tell of e what is slower than
:math:`\omega_j`, a share :math:`\omega_j \Delta t / 3` of what there is to know, so that

.. math:: s_j^2 \leftarrow \frac{3}{\omega_j \Delta t} \overline{(e_{k+1} - e_k)_j^2}

(MacKay 1992, Neural Computation 4(3):415). All joints and all times are solved at once, by the
derivatives of a (Bell 1994, SIAM J. Optim. 4(3):626): worked out from the states of the pass before
alone, they run off where :math:`\omega^2 < K / J`.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion.carried import model_of
from plumbline.optim.diagnosis.motion.clock import mean_of_ends
from plumbline.optim.diagnosis.motion.constants import BELIEVED
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.windows import Array
from plumbline.optim.diagnosis.prior import FINEST


@dataclass(frozen=True, eq=False)
class States:
    """States of one run, what moves them and what was read.

    Attributes:
        dt: Time from sample to sample [s].
        read: Readings (K, n) [rad].
        place: Places (K, n) [rad].
        speed: Speeds (K, n) [rad/s].
        masses: Mass matrices, each row over the inertia of its joint (K, n, n).
        mean: Accelerations that torques make, in the mean of each step (K - 1, n) [rad/s^2].
        bent: What places are behind steps' ends, as trapezia have those (K, n) [rad].
        by_place: Derivatives of accelerations by places (K, n, n) [1/s^2].
        by_speed: The same by speeds (K, n, n) [1/s].
    """

    dt: float
    read: Array
    place: Array
    speed: Array
    masses: Array
    mean: Array
    bent: Array
    by_place: Array
    by_speed: Array

    @property
    def acceleration(self) -> Array:
        """Accelerations (K, n) [rad/s^2]."""
        inner = np.diff(self.place + self.bent, 2, axis=0) / self.dt**2
        return np.concatenate([self.mean[:1], inner, self.mean[-1:]])

    @property
    def off(self) -> Array:
        """Accelerations beyond those that torques make (K, n) [rad/s^2]; none at the ends."""
        known = np.concatenate([self.mean[:1], mean_of_ends(self.mean), self.mean[-1:]])
        return np.asarray(self.acceleration - known)

    @property
    def changes(self) -> Array:
        """Of what drives give beyond what is known, over inertias (K - 3, n) [rad/s^2]."""
        beyond = np.einsum("kij,kj->ki", self.masses[1:-1], self.off[1:-1])
        return np.diff(beyond, axis=0)

    def settled(self, weights: Array) -> Self:
        """Where the sum is least, changes of what drives give weighed by so much (n,) [s^4]."""
        (K, n), changes = self.place.shape, self.changes
        if not len(changes):
            return self
        by = self._by_places()
        with np.errstate(over="ignore"):  # of a way that runs off, as no robot's does
            size = np.sum([np.sum(slope**2, axis=2) for slope in by], axis=0)
        if not np.isfinite(size).all():
            return self
        most = np.minimum(weights, BELIEVED / size)[:, None]
        bands, right = np.zeros((K, len(by), n, n)), self.read - self.place
        bands[:, 0] = np.eye(n)
        for i, slope in enumerate(by):
            weighed = slope.transpose(0, 2, 1) * most
            right[i : K - 3 + i] -= np.einsum("kij,kj->ki", weighed, changes)
            for j in range(i, len(by)):
                bands[i : K - 3 + i, j - i] += weighed @ by[j]
        return self._moved(_solved(bands, right))

    def _by_places(self) -> list[Array]:
        """Derivatives of a change by each of the four places about it, each (K - 3, n, n)."""
        one, slope = np.eye(self.place.shape[1]) / self.dt**2, self.by_speed[1:-1] / (2 * self.dt)
        three = one + slope, -2 * one - self.by_place[1:-1], one - slope
        before, at, after = (self.masses[1:-1] @ x for x in three)
        return [-before[:-1], before[1:] - at[:-1], at[1:] - after[:-1], after[1:]]

    def _moved(self, step: Array) -> Self:
        """The same so far on (K, n) [rad]: speeds are those that places and accelerations make."""
        rates = self.by_place, step, self.by_speed, np.gradient(step, self.dt, axis=0)
        more = np.einsum("kij,kj->ki", *rates[:2]) + np.einsum("kij,kj->ki", *rates[2:])
        mean, place = self.mean + mean_of_ends(more), self.place + step
        ends, half = np.diff(place + self.bent, axis=0) / self.dt, self.dt / 2 * mean
        inner = mean_of_ends(ends) - np.diff(half, axis=0) / 2
        speed = np.concatenate([ends[:1] - half[:1], inner, ends[-1:] + half[-1:]])
        return replace(self, place=place, speed=speed, mean=mean)


def believed(dt: float, weights: Array, squares: Array, noise: Array) -> Array:
    """Weights (n,) [s^4] of what drives give beyond what is known.

    Args:
        dt: Time from sample to sample [s].
        weights: Those by which states were found (n,).
        squares: Of its changes, in the mean (n,) [rad^2/s^4].
        noise: Of what was read, less these states (n,) [rad^2].
    """
    told = (np.sqrt(weights) * dt) ** (-1 / 3) * dt / 3  # a share of what there is to know
    found = np.maximum(noise, FINEST**2) * told / np.maximum(squares, 1e-300)
    return np.asarray(np.minimum(found, BELIEVED * dt**4))


def slopes_at(
    r: MotionRecording, states: tuple[Array, Array, Array], masses: Array
) -> tuple[Array, Array]:
    """Derivatives of accelerations under held torques by places and by speeds, both (K, n, n).

    Of places, speeds and accelerations (K, n); other joints stand at zero.
    """
    model = model_of(r)
    data, index, K = model.createData(), list(r.index), len(masses)
    neutral, own = pin.neutral(model), np.ix_(index, index)
    moved = np.zeros((3, K, model.nv))
    moved[..., index] = states
    by_place, by_speed = np.empty((2, K, r.n, r.n))
    for k, (q, v, a) in enumerate(moved.transpose(1, 0, 2)):
        there = pin.integrate(model, neutral, q)
        slopes = pin.computeRNEADerivatives(model, data, there, v, a)
        by_place[k], by_speed[k] = (x[own] for x in slopes[:2])
    found = [np.asarray(-np.linalg.solve(masses, x), float) for x in (by_place, by_speed)]
    return found[0], found[1]


def _solved(bands: Array, right: Array) -> Array:
    """Solution (K, n) of a symmetric system: its blocks (K, reach, n, n), from the diagonal on."""
    K, reach, n, _ = bands.shape
    lower = np.zeros((reach * n, K * n))
    for below in range(reach * n):
        for column in range(n):
            ahead, row = divmod(below + column, n)
            if ahead < reach:
                lower[below, column : (K - ahead) * n : n] = bands[: K - ahead, ahead, column, row]
    return np.asarray(scipy.linalg.solveh_banded(lower, right.ravel(), lower=True)).reshape(K, n)
