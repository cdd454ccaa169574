"""What goes wrong in a joint: the true angle against the encoder's reading.

    q_true = q + e(q, load torque, approach side, path)

Sizes are in rad (m for a slide) unless said otherwise.
"""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.arm import Array, load_torque, point_torque
from plumbline.experiments.reality.scene import Mechanism, Scene


class JointMechanism(Mechanism, ABC):
    """A mechanism of one joint, which adds an error (N,) [rad or m] to its true position."""

    joint: int

    def reading(self, scene: Scene) -> Array:
        """The joint's encoder readings (N,)."""
        return scene.session.q[:, self.joint - 1]

    def travel(self, scene: Scene) -> Array:
        """By how much these change from row to row (N,)."""
        return np.diff(self.reading(scene), prepend=self.reading(scene)[:1])

    def torque(self, scene: Scene) -> Array:
        """What gravity loads it with (N,) [N m or N]."""
        return load_torque(scene.arm, scene.frames())[:, self.joint - 1]

    def body(self, scene: Scene) -> Scene:
        q = scene.q.copy()
        q[:, self.joint - 1] += self._error(scene)
        return replace(scene, q=q)

    @abstractmethod
    def _error(self, scene: Scene) -> Array:
        """Error (N,) of the joint's position [rad or m]."""


class JointOffset(JointMechanism):
    """The zero mark is off: e = size."""

    def _error(self, scene: Scene) -> Array:
        return np.full(scene.session.rows, self.size)


class JointScale(JointMechanism):
    """The encoder counts wrongly: e = size q (size is a ratio)."""

    def _error(self, scene: Scene) -> Array:
        return self.size * self.reading(scene)


class JointCompliance(JointMechanism):
    """The drive twists under the load torque, less and less as it stiffens.

    e = size tau / (1 + stiffening |tau| / max |tau|), size in rad/(N m). Strain-wave
    drives show this in their makers' data as stiffnesses K1 < K2 < K3 over ranges of torque.
    The largest torque is that of the rows, unless it is given.
    """

    stiffening: float = 0.2
    largest: float | None = None

    def _error(self, scene: Scene) -> Array:
        torque = self.torque(scene)
        peak = _peak(torque) if self.largest is None else self.largest
        return self.size * torque / (1.0 + self.stiffening * np.abs(torque) / peak)

    def pinned(self, scene: Scene) -> Mechanism:
        """With the largest torque of the scene's rows."""
        given = self.largest is not None
        return self if given else replace(self, largest=_peak(self.torque(scene)))


def _peak(torque: Array) -> float:
    return max(float(np.abs(torque).max()), 1e-12)


class Backlash(JointMechanism):
    """The joint lags behind by half the play on the side it came from: e = -size/2 direction."""

    def _error(self, scene: Scene) -> Array:
        return -0.5 * self.size * scene.session.direction[:, self.joint - 1]


class LoadedPlay(JointMechanism):
    """Play of a link that its own weight pushes aside: e = size/2 tanh(torque / seat).

    The seat [N m] is the torque that friction holds, a share of the largest.
    """

    seat: float = 0.02

    def _error(self, scene: Scene) -> Array:
        torque = self.torque(scene)
        return 0.5 * self.size * np.tanh(torque / (self.seat * _peak(torque)))


class CoupledPlay(JointMechanism):
    """Cables of another joint, slack on the side it came from: e = -size/2 direction_source."""

    source: int = 1

    def _error(self, scene: Scene) -> Array:
        return -0.5 * self.size * scene.session.direction[:, self.source - 1]


class Hysteresis(JointMechanism):
    """Play carried along the path of the rows; the final approach is too short to cross it.

    The output follows only once the play of half-width size is used up: z_k = clip(z_{k-1}, q_k -
    size, q_k + size). The session began at `start` in the play, -1 to 1.
    """

    start: float = 0.0

    def _error(self, scene: Scene) -> Array:
        q = self.reading(scene)
        out = np.empty_like(q)
        last = q[0] + self.start * self.size
        for k, here in enumerate(q):
            last = min(max(last, here - self.size), here + self.size)
            out[k] = last
        return out - q


class TransmissionRipple(JointMechanism):
    """Once and twice per turn: e = size (w1 sin(q + p1) + w2 sin(2 q + p2))."""

    once: tuple[float, float] = (1.0, 0.0)
    twice: tuple[float, float] = (0.0, 0.0)

    def _error(self, scene: Scene) -> Array:
        q = self.reading(scene)
        first = self.once[0] * np.sin(q + self.once[1])
        return self.size * (first + self.twice[0] * np.sin(2.0 * q + self.twice[1]))

    def parameters(self) -> dict[str, object]:
        """Amplitudes [rad] in phase with sin and cos, for orders 1 and 2."""
        named: dict[str, object] = {}
        for order, (weight, phase) in ((1, self.once), (2, self.twice)):
            named[f"sine_{order}"] = self.size * weight * float(np.cos(phase))
            named[f"cosine_{order}"] = self.size * weight * float(np.sin(phase))
        return named


class GearRipple(JointMechanism):
    """Ripple of a gear: e = size sin(order q + phase); the order need not be an integer."""

    order: float = 17.0
    phase: float = 0.0

    def _error(self, scene: Scene) -> Array:
        return self.size * np.sin(self.order * self.reading(scene) + self.phase)


class JointCoupling(JointMechanism):
    """Another joint drags this one along: e = size q_source (size is a ratio)."""

    source: int = 1

    def _error(self, scene: Scene) -> Array:
        return self.size * scene.session.q[:, self.source - 1]


class Payload(Mechanism):
    """An unknown mass of `size` kg at the tip twists every drive.

    Stiffnesses are in N m/rad (N/m for a slide). The controller is taken to have allowed for the
    arm's own weight, so only the unknown mass shows.
    """

    stiffness: tuple[float, ...] = ()

    def body(self, scene: Scene) -> Scene:
        frames, tip = scene.tip()
        torque = point_torque(scene.arm, frames, tip, self.size * scene.arm.gravity)
        return replace(scene, q=scene.q + torque / np.asarray(self.stiffness))


class Latency(Mechanism):
    """The device reports where the arm was `size` seconds ago: q_true = q - size velocity."""

    def body(self, scene: Scene) -> Scene:
        return replace(scene, q=scene.q - self.size * scene.session.velocity)
