"""What goes wrong in a joint: the true angle against the encoder's reading.

    q_true = q + e(q, load torque, approach side, path)

Sizes are in rad (m for a slide) unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from plumbline.experiments.reality.arm import Array, load_torque, point_torque
from plumbline.experiments.reality.scene import Mechanism, Scene


@dataclass(frozen=True)
class JointMechanism(Mechanism):
    """A mechanism of one joint, which adds `error` to its true position."""

    joint: int

    @property
    def element(self) -> int | None:
        """The joint, from 1."""
        return self.joint

    def body(self, scene: Scene) -> Scene:
        """The scene with the joint displaced."""
        q = scene.q.copy()
        q[:, self.joint - 1] += self.error(scene)
        return replace(scene, q=q)

    def error(self, scene: Scene) -> Array:
        """Displacement (N,) [rad or m] of the joint."""
        raise NotImplementedError

    def reading(self, scene: Scene) -> Array:
        """The joint's encoder readings (N,)."""
        return scene.session.q[:, self.joint - 1]


@dataclass(frozen=True)
class JointOffset(JointMechanism):
    """The zero mark is off: e = size."""

    effect: ClassVar[str] = "joint_offset"
    limit: ClassVar[float] = 0.03

    def error(self, scene: Scene) -> Array:
        """Constant."""
        return np.full(scene.session.rows, self.size)

    def parameters(self) -> dict[str, object]:
        """The offset."""
        return {"offset": self.size}


@dataclass(frozen=True)
class JointScale(JointMechanism):
    """The encoder counts wrongly: e = size q (size is a ratio)."""

    effect: ClassVar[str] = "joint_scale"
    limit: ClassVar[float] = 0.02

    def error(self, scene: Scene) -> Array:
        """In proportion to the reading."""
        return self.size * self.reading(scene)

    def parameters(self) -> dict[str, object]:
        """The relative scale error."""
        return {"scale": self.size}


@dataclass(frozen=True)
class JointCompliance(JointMechanism):
    """The drive twists under the load torque, less and less as it stiffens.

    e = size tau / (1 + stiffening |tau| / max |tau|), size in rad/(N m). Strain-wave
    drives show this in their makers' data as stiffnesses K1 < K2 < K3 over ranges of torque.
    The largest torque is that of the rows, unless it is given.
    """

    stiffening: float = 0.2
    largest: float | None = None
    effect: ClassVar[str] = "joint_compliance"
    limit: ClassVar[float] = 1e-2
    typical: ClassVar[float] = 1e-5

    def error(self, scene: Scene) -> Array:
        """Twist under gravity."""
        torque = self._torque(scene)
        peak = max(float(np.abs(torque).max()), 1e-12) if self.largest is None else self.largest
        return self.size * torque / (1.0 + self.stiffening * np.abs(torque) / peak)

    def pinned(self, scene: Scene) -> Mechanism:
        """With the largest torque of the scene's rows."""
        peak = max(float(np.abs(self._torque(scene)).max()), 1e-12)
        return replace(self, largest=peak if self.largest is None else self.largest)

    def _torque(self, scene: Scene) -> Array:
        return load_torque(scene.arm, scene.frames())[:, self.joint - 1]

    def parameters(self) -> dict[str, object]:
        """Compliance at small load, and how the drive stiffens."""
        return {"compliance": self.size, "stiffening": self.stiffening}


@dataclass(frozen=True)
class Backlash(JointMechanism):
    """The joint lags behind by half the play on the side it came from: e = -size/2 direction."""

    effect: ClassVar[str] = "backlash"
    limit: ClassVar[float] = 0.02

    def error(self, scene: Scene) -> Array:
        """Half the play, against the approach."""
        return -0.5 * self.size * scene.session.direction[:, self.joint - 1]

    def parameters(self) -> dict[str, object]:
        """Full width of the play."""
        return {"width": self.size}


@dataclass(frozen=True)
class Hysteresis(JointMechanism):
    """Play carried along the path of the rows; the final approach is too short to cross it.

    The output follows only once the play of half-width size is used up: z_k = clip(z_{k-1}, q_k -
    size, q_k + size).
    """

    start: float = 0.0
    effect: ClassVar[str] = "hysteresis"
    limit: ClassVar[float] = 0.02

    def error(self, scene: Scene) -> Array:
        """Output of the play less the input."""
        q = self.reading(scene)
        out = np.empty_like(q)
        last = q[0] + self.start * self.size
        for k, here in enumerate(q):
            last = min(max(last, here - self.size), here + self.size)
            out[k] = last
        return out - q

    def parameters(self) -> dict[str, object]:
        """Half-width of the play, and where in it the session began (-1 to 1)."""
        return {"half_width": self.size, "start": self.start}


@dataclass(frozen=True)
class TransmissionRipple(JointMechanism):
    """Once and twice per turn: e = size (w1 sin(q + p1) + w2 sin(2 q + p2))."""

    once: tuple[float, float] = (1.0, 0.0)
    twice: tuple[float, float] = (0.0, 0.0)
    effect: ClassVar[str] = "transmission_ripple"
    limit: ClassVar[float] = 0.01

    def error(self, scene: Scene) -> Array:
        """Two harmonics."""
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


@dataclass(frozen=True)
class GearRipple(JointMechanism):
    """Ripple of a gear: e = size sin(order q + phase); the order need not be an integer."""

    order: float = 17.0
    phase: float = 0.0
    effect: ClassVar[str] = "gear_ripple"
    limit: ClassVar[float] = 5e-3

    def error(self, scene: Scene) -> Array:
        """One harmonic of high order."""
        return self.size * np.sin(self.order * self.reading(scene) + self.phase)

    def parameters(self) -> dict[str, object]:
        """Amplitude [rad], order [1/turn], phase [rad]."""
        return {"amplitude": self.size, "order": self.order, "phase": self.phase}


@dataclass(frozen=True)
class JointCoupling(JointMechanism):
    """Another joint drags this one along: e = size q_source (size is a ratio)."""

    source: int = 1
    effect: ClassVar[str] = "joint_coupling"
    limit: ClassVar[float] = 0.02

    def error(self, scene: Scene) -> Array:
        """In proportion to the source joint's reading."""
        return self.size * scene.session.q[:, self.source - 1]

    def parameters(self) -> dict[str, object]:
        """Ratio and source joint."""
        return {"ratio": self.size, "source": self.source}


@dataclass(frozen=True)
class Payload(Mechanism):
    """An unknown mass of `size` kg at the tip twists every drive.

    Stiffnesses are in N m/rad (N/m for a slide). The controller is taken to have allowed for the
    arm's own weight, so only the unknown mass shows.
    """

    stiffness: tuple[float, ...] = ()
    effect: ClassVar[str] = "payload"
    limit: ClassVar[float] = 300.0
    typical: ClassVar[float] = 1.0

    def body(self, scene: Scene) -> Scene:
        """The scene with every joint twisted by the load."""
        frames = scene.frames()
        flange = frames[:, -1]
        tip = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], scene.tool)
        torque = point_torque(scene.arm, frames, tip, self.size * scene.arm.gravity)
        return replace(scene, q=scene.q + torque / np.asarray(self.stiffness))

    def parameters(self) -> dict[str, object]:
        """Mass [kg] and drive stiffnesses."""
        return {"mass": self.size, "stiffness": list(self.stiffness)}


@dataclass(frozen=True)
class Latency(Mechanism):
    """The device reports where the arm was `size` seconds ago: q_true = q - size velocity."""

    effect: ClassVar[str] = "latency"
    limit: ClassVar[float] = 0.2

    def body(self, scene: Scene) -> Scene:
        """The scene a moment earlier."""
        return replace(scene, q=scene.q - self.size * scene.session.velocity)

    def parameters(self) -> dict[str, object]:
        """Delay [s]."""
        return {"delay": self.size}
