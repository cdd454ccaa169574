"""Mechanisms of links, base and tool that the library lacks."""

from dataclasses import replace
from typing import Self

import numpy as np

from plumbline.experiments.reality import chances
from plumbline.experiments.reality.arm import Array, loads
from plumbline.experiments.reality.body_effects import LinkMechanism, link_vector
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.session import lagged

RANGES = Ranges("unseen")
CAGE = 0.4  # turns of the cage for one of the ring


class BearingRunout(Mechanism):
    r"""A joint's axis nutates as it turns: the bearing runs out across the axis.

    .. math:: \vartheta = \text{size}\, (\cos(k q + \varphi), \sin(k q + \varphi), 0)

    ISO 230-7 (2015): tilt error motion of an axis of rotation. The cage turns at about 0.4 of
    the ring's speed, so that the order k of its m balls is 0.4 m and no integer.

    A tilt of `size` rad across the axis of one joint, `order` times a turn.
    """

    joint: int = 1
    order: float = 1.2
    phase: float = 0.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Three to nine balls that are not alike."""
        order = CAGE * float(rng.choice([3, 4, 6, 7, 8, 9]))
        return cls(0.0, chances.turning(scene, rng), order, chances.phase(rng))

    def body(self, scene: Scene) -> Scene:
        angle = self.order * scene.session.q[:, self.joint - 1] + self.phase
        flat = np.zeros_like(angle)
        tilt = self.size * np.stack([np.cos(angle), np.sin(angle), flat], axis=1)
        if self.joint == 1:
            return scene.turned_base(tilt)
        return scene.flexed(self.joint - 2, np.hstack([np.zeros_like(tilt), tilt]))


class Draught(Mechanism):
    r"""A door opens: the stand shrinks at once and comes back slowly.

    .. math:: \text{twist} = \text{size}\; w\, [t \ge t_0]\, e^{-(t - t_0) / T}

    ISO 230-3 (2020): the environment's temperature variation error; thin parts follow the air
    within minutes.

    A twist of `size` times the weights [1, rad/m], from a moment on, fading [s].
    """

    weights: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    moment: float = 0.0
    fading: float = 100.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Within the session, over before it ends."""
        weights, length = chances.twist(rng), np.ptp(scene.session.time)
        opens, fades = (float(RANGES.one(name, rng) * length) for name in ("opens", "fades"))
        return cls(0.0, weights, float(scene.session.time[0]) + opens, fades)

    def body(self, scene: Scene) -> Scene:
        since = scene.session.time - self.moment
        course = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / self.fading), 0.0)
        moved = self.size * course[:, None] * np.array(self.weights)
        return replace(scene, base=scene.base + moved)


class FloorSag(Mechanism):
    r"""The floor gives where the arm leans, and less elsewhere.

    .. math:: \Delta p = \text{size} \exp(-|x - x_0|^2 / 2 w^2)\, g / |g|

    with x the foot of the arm's centre of gravity: the middle of a plate between joists sinks, its
    edge does not (Timoshenko and Woinowsky-Krieger 1959, Theory of Plates and Shells: the influence
    surface of a supported plate, here a bell).

    A sink of `size` m with the weight above the middle; places and width [m] on the floor.
    """

    middle: tuple[float, ...] = (0.0, 0.0)
    width: float = 0.1

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """A middle that the weight comes to, and a bell narrower than its way."""
        feet = weight_above(scene)
        middle = chances.vector(feet[int(rng.integers(len(feet)))])
        return cls(0.0, middle, chances.spread(feet) * RANGES.one("bell", rng))

    def body(self, scene: Scene) -> Scene:
        away = np.sum((weight_above(scene) - np.array(self.middle)) ** 2, axis=1)
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        sunk = self.size * np.exp(-0.5 * away / self.width**2)[:, None] * down
        return replace(scene, base=scene.base + np.hstack([sunk, np.zeros_like(sunk)]))


def weight_above(scene: Scene) -> Array:
    """Where on the floor the arm's centre of gravity stands (N, 2) [m]."""
    frames = scene.frames()[:, 1:]
    centres = frames[..., :3, 3] + np.einsum("nijk,ik->nij", frames[..., :3, :3], scene.arm.com)
    share = scene.arm.mass / scene.arm.mass.sum()
    return np.asarray(np.einsum("i,nik->nk", share, centres)[:, :2])


class LooseBolt(Mechanism):
    r"""One bolt of the foot has lost its preload: the base opens beyond the moment that is left.

    .. math:: \vartheta = \text{size} \max(0, M \cdot u - M_0) / (M_{max} - M_0) \text{ about } u

    Below M_0 the joint is closed and stiff, above it the gap opens, to one side alone (Bickford
    2008, Introduction to the Design and Behavior of Bolted Joints: joint separation).

    An opening of `size` rad under the largest moment; moments in N m, `turn` in rad.
    """

    turn: float = 0.0  # of the axis u about the base's z
    preload: float = 0.0
    largest: float = 1.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Open in a quarter to a half of the rows."""
        turn = chances.phase(rng)
        moment = cls(0.0, turn)._moment(scene)
        closed = float(np.quantile(moment, RANGES.one("closed", rng)))
        return cls(0.0, turn, closed, float(moment.max()))

    def _moment(self, scene: Scene) -> Array:
        _, moment = loads(scene.arm, scene.frames())
        return np.asarray(moment[:, 0] @ self._axis)

    @property
    def _axis(self) -> Array:
        return np.array([np.cos(self.turn), np.sin(self.turn), 0.0])

    def body(self, scene: Scene) -> Scene:
        beyond = np.maximum(self._moment(scene) - self.preload, 0.0) / (self.largest - self.preload)
        return scene.turned_base(np.outer(self.size * beyond, self._axis))


class ThermalBow(LinkMechanism):
    r"""A link heated on one side bows, until the heat has soaked through.

    .. math:: \vartheta = \text{size}\, (T_{near} - T_{far}) / \Delta T, \qquad
              \text{shift} = \tfrac12 L \vartheta

    The far side lags behind the near one; a free beam with a linear difference across it bends to a
    constant curvature (Boley and Weiner 1960, Theory of Thermal Stresses).

    An end rotation of `size` rad for the difference `rise` [K]; the far side lags [s].
    """

    rise: float = 10.0
    delay: float = 200.0
    side: tuple[float, ...] = (0.0, 1.0, 0.0)  # towards the heat, in the link's frame

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """A long link; heat that takes a tenth to three tenths of the session to soak through."""
        link = chances.long_link(scene, rng)
        along = link_vector(scene, link - 1)[0]
        side = np.cross(along, chances.unit(rng))
        side /= np.linalg.norm(side)
        rise = float(np.ptp(scene.session.warmth))
        soaks = float(RANGES.one("soaks", rng) * np.ptp(scene.session.time))
        return cls(0.0, link, rise, soaks, chances.vector(side))

    def body(self, scene: Scene) -> Scene:
        session, i = scene.session, self.link - 1
        across = session.warmth - lagged(session.time, session.warmth, self.delay)
        along, side = link_vector(scene, i)[0], np.array(self.side)
        length = float(np.linalg.norm(along))
        bend = np.concatenate([-0.5 * length * side, np.cross(side, along / length)])
        return scene.flexed(i, self.size * (across / self.rise)[:, None] * bend)


class ToolRocking(Mechanism):
    r"""A tool on a worn seat rocks from one face to the other as gravity turns over.

    .. math:: \Delta p_{tool} = \text{size}\, \tanh((g \cdot u - b) / s)\, v

    with g the direction of gravity in the flange. A seat constrained twice has two stable places
    and little between them (Slocum 1992, Precision Machine Design, ch. 7).

    A step of twice `size` m along `way` where gravity along `face` passes `bias`.
    """

    face: tuple[float, ...] = (1.0, 0.0, 0.0)
    way: tuple[float, ...] = (1.0, 0.0, 0.0)
    bias: float = 0.0
    softness: float = 0.1

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Any face, any way."""
        bias, softness = RANGES.one("bias", rng), RANGES.one("softness", rng)
        return cls(0.0, chances.unit(rng), chances.unit(rng), bias, softness)

    def body(self, scene: Scene) -> Scene:
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        along = down @ (scene.frames()[:, -1, :3, :3] @ np.array(self.face)).T
        rocked = np.tanh((along - self.bias) / self.softness)
        return replace(scene, tool=scene.tool + self.size * rocked[:, None] * np.array(self.way))
