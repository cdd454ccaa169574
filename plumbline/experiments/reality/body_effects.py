"""What goes wrong between the joints: links, base and tool."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.arm import Array, loads, rotations
from plumbline.experiments.reality.scene import Mechanism, Scene

Vector = tuple[float, ...]


class LinkMechanism(Mechanism):
    """A mechanism of one link."""

    link: int


class LinkGeometry(LinkMechanism):
    """One link is not as drawn: d + size w_d [m], a + size w_a [m], alpha + size w_alpha [rad]."""

    weights: Vector = (1.0, 0.0, 0.0)

    def body(self, scene: Scene) -> Scene:
        d, a, alpha = scene.shape.d.copy(), scene.shape.a.copy(), scene.shape.alpha.copy()
        for table, weight in zip((d, a, alpha), self.weights, strict=True):
            table[:, self.link - 1] += self.size * weight
        return replace(scene, shape=replace(scene.shape, d=d, a=a, alpha=alpha))

    def parameters(self) -> dict[str, object]:
        """Changes of d [m], a [m] and alpha [rad]."""
        return {k: self.size * w for k, w in zip(("d", "a", "alpha"), self.weights, strict=True)}


class LinkThermal(Mechanism):
    """All lengths grow with the arm's true temperature: L (1 + size (T - reference)), size in 1/K.

    The thermometer in the recording lags behind the arm, or hangs beside it and misses the warm-up
    altogether.
    """

    reference: float = 20.0

    def body(self, scene: Scene) -> Scene:
        growth = 1.0 + self.size * (scene.session.warmth - self.reference)[:, None]
        shape = replace(scene.shape, d=scene.shape.d * growth, a=scene.shape.a * growth)
        return replace(scene, shape=shape)


class LinkFlex(LinkMechanism):
    """A link bends sideways as a cantilever of length L; size is 1/(E I) in 1/(N m^2).

    End force F and moment M from all that hangs outboard, own weight w = m g / L spread along it:

        deflection = F L^3/3 + M x u L^2/2 + w L^4/8,   rotation = u x F L^2/2 + M L + u x w L^3/6

    with only the parts across the link's direction u counted (Euler-Bernoulli).
    """

    def body(self, scene: Scene) -> Scene:
        i, frames = self.link - 1, scene.frames()
        force, moment = loads(scene.arm, frames)
        outboard = self.link < scene.arm.joints
        none = np.zeros((scene.session.rows, 3))
        turn = frames[:, self.link, :3, :3]
        f = _into(turn, force[:, self.link] if outboard else none)
        m = _into(turn, moment[:, self.link] if outboard else none)
        own = _into(turn, np.tile(scene.arm.mass[i] * scene.arm.gravity, (len(turn), 1)))
        return scene.flexed(i, self.size * cantilever(link_vector(scene, i), f, m, own))


def _into(turn: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("nji,nj->ni", turn, vector))


def link_vector(scene: Scene, i: int) -> Array:
    """(N, 3) [m] from frame i to frame i + 1, in the latter's coordinates."""
    shape = scene.shape
    d, a, alpha = shape.d[:, i], shape.a[:, i], shape.alpha[:, i]
    return np.stack([a, d * np.sin(alpha), d * np.cos(alpha)], axis=1)


def cantilever(link: Array, force: Array, moment: Array, weight: Array) -> Array:
    """End displacement and rotation (N, 6) for E I = 1; link [m] and loads (N, 3) in its frame."""
    length = np.linalg.norm(link, axis=1, keepdims=True)
    u = link / length

    def across(vector: Array) -> Array:
        return np.asarray(vector - u * np.sum(u * vector, axis=1, keepdims=True))

    f, m, w = across(force), across(moment), across(weight)
    shift = f * length**3 / 3.0 + np.cross(m, u) * length**2 / 2.0 + w * length**3 / 8.0
    turn = np.cross(u, f) * length**2 / 2.0 + m * length + np.cross(u, w) * length**2 / 6.0
    return np.concatenate([shift, turn], axis=1)


class JointTilt(Mechanism):
    """A bearing leans under the moment M across its axis: angle = size (1 +- unequal) M.

    The housing is stiffer about one direction, a quarter turn from the other. Size is in rad/(N m).
    """

    joint: int = 1
    unequal: float = 0.0

    def body(self, scene: Scene) -> Scene:
        frames = scene.frames()
        _, moment = loads(scene.arm, frames)
        housing, end = frames[:, self.joint - 1], frames[:, self.joint]
        softness = self.size * np.array([1.0 + self.unequal, 1.0 - self.unequal, 0.0])
        lean = np.einsum("nji,nj->ni", housing[:, :3, :3], moment[:, self.joint - 1]) * softness
        lean = np.einsum("nij,nj->ni", housing[:, :3, :3], lean)
        reach = end[:, :3, 3] - housing[:, :3, 3]
        moved = np.einsum("nij,nj->ni", rotations(lean), reach) - reach
        inside = np.swapaxes(end[:, :3, :3], 1, 2)
        both = [np.einsum("nij,nj->ni", inside, part) for part in (moved, lean)]
        return scene.flexed(self.joint - 1, np.hstack(both))

    def parameters(self) -> dict[str, object]:
        """Compliance about two directions across the axis [rad/(N m)]."""
        return {"compliance": [self.size * (1.0 + self.unequal), self.size * (1.0 - self.unequal)]}


class BaseMotion(Mechanism, ABC):
    """The base moves by size w times a course over the session; w in m and, for turns, rad."""

    weights: Vector = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def body(self, scene: Scene) -> Scene:
        course = self._course(scene.session.progress)
        moved = self.size * course[:, None] * np.array(self.weights)
        return replace(scene, base=scene.base + moved)

    @abstractmethod
    def _course(self, progress: Array) -> Array:
        """Course (N,) over the session's progress from 0 to 1."""

    def parameters(self) -> dict[str, object]:
        """The whole twist [m, rad], and its course."""
        told = {key: getattr(self, key) for key in self.named}
        return {"twist": [self.size * w for w in self.weights], **told}


class BaseDrift(BaseMotion):
    """The base creeps: twist = size w (1 - exp(-rate s)) / (1 - exp(-rate)).

    s runs from 0 to 1 over the session. Size is in m; the rotational weights are in rad/m.
    """

    rate: float = 1.0

    def _course(self, progress: Array) -> Array:
        return np.asarray(np.expm1(-self.rate * progress) / np.expm1(-self.rate))


class BaseBump(BaseMotion):
    """Somebody knocks the base at one moment, a part of the session: twist = size w from then."""

    moment: float = 0.5

    def _course(self, progress: Array) -> Array:
        return np.asarray((progress >= self.moment).astype(float))


class BaseCompliance(Mechanism):
    """The table tilts with the load's moment M about the foot: angle = size k M.

    k differs between x and y. Size is in rad/(N m).
    """

    unequal: float = 0.1

    def body(self, scene: Scene) -> Scene:
        _, moment = loads(scene.arm, scene.frames())
        axes = np.array([1.0 + self.unequal, 1.0 - self.unequal, 0.0])
        return scene.turned_base(self.size * moment[:, 0] * axes)

    def parameters(self) -> dict[str, object]:
        """Tilt compliance about x and y [rad/(N m)]."""
        return {"compliance": [self.size * (1.0 + self.unequal), self.size * (1.0 - self.unequal)]}
