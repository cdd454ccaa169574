"""Mechanisms of single joints that the library lacks."""

from typing import Self

import numpy as np

from plumbline.experiments.reality import chances
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import GearRipple, JointMechanism
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.session import lagged

RANGES = Ranges("unseen")
HARDENING = 1.5  # power of the depth that pushes back, as of spheres in contact (Hertz)
EDGE = 0.05  # rad over which a worn tooth takes over from a whole one
PICKS = 0.15  # share of the largest load that seats the pulley


class CableCreep(JointMechanism):
    r"""A cable that creeps under load: what it gives now is what it bore before.

    .. math:: T \dot y = \tau - y, \qquad e = \text{size}\; y / \tau_{max}

    The delayed part of a Kelvin-Voigt solid (Findley, Lai and Onaran 1976, Creep and Relaxation of
    Nonlinear Viscoelastic Materials); the prompt part is taken to be compensated.

    Stretch of `size` rad under the largest load [N m], with a time constant [s].
    """

    largest: float = 1.0
    constant: float = 60.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Forgets over two to eight readings."""
        joint, largest = chances.loaded(scene, rng)
        step = float(np.median(np.diff(scene.session.time)))
        return cls(0.0, joint, largest, RANGES.one("forgets", rng) * step)

    def _error(self, scene: Scene) -> Array:
        torque, time = self.torque(scene), scene.session.time
        return self.size * lagged(time, torque, self.constant, first=0.0) / self.largest


class EncoderInterpolation(JointMechanism):
    r"""An encoder that interpolates between its 2^k lines with unequal and shifted quadratures.

    .. math:: e = \text{size}\,[\operatorname{atan2}((1 + b) \sin\theta + o, \cos\theta) - \theta],
              \qquad \theta = 2^k q

    Heydemann (1981), Applied Optics 20(19): an offset o shows once a line, unequal gains b twice.

    `size` is the reading's weight: one over the lines of a true encoder, free here.
    """

    bits: int = 5
    offset: float = 0.2
    gain: float = 0.4

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Eight to 128 lines, both quadrature errors of like size."""
        offset = RANGES.one("offset", rng)
        gain = offset * RANGES.one("gain", rng)
        return cls(0.0, chances.turning(scene, rng), RANGES.whole("bits", rng), offset, gain)

    def alike(self) -> tuple[tuple[Mechanism, ...], ...]:
        """Gears with one tooth a line, two, or both together are what a library may take it for."""
        once, twice = (
            tuple(GearRipple(1e-4, self.joint, order, phase) for phase in (0.0, np.pi / 2.0))
            for order in (2.0**self.bits, 2.0 ** (self.bits + 1))
        )
        return once, twice, (*once, *twice)

    def _error(self, scene: Scene) -> Array:
        angle = 2.0**self.bits * self.reading(scene)
        sine, cosine = (1.0 + self.gain) * np.sin(angle) + self.offset, np.cos(angle)
        seen = np.arctan2(sine, cosine)
        return np.asarray(self.size * np.angle(np.exp(1j * (seen - angle))))


class EndCushion(JointMechanism):
    r"""Near the end of its range a joint runs into its cushion and stops a little short.

    .. math:: e = -s\, \text{size} \max(0, s (q - c) / h)^{1.5}, \qquad s = \pm 1

    Merritt (1967), Hydraulic Control Systems, ch. 3: flow through a closing orifice; the pressure
    rises faster than the way.

    Short by `size` [rad or m] at the depth [rad or m] beyond where the cushion begins.
    """

    begins: float = 1.0
    depth: float = 0.5
    side: float = 1.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Felt in the last tenth to quarter of the readings."""
        joint, side = chances.any_joint(scene, rng), chances.sign(rng)
        out = side * scene.session.q[:, joint - 1]
        begins = float(np.quantile(out, RANGES.one("cushioned", rng)))
        return cls(0.0, joint, side * begins, max(float(out.max()) - begins, 1e-3), side)

    def _error(self, scene: Scene) -> Array:
        pressed = np.maximum(self.side * (self.reading(scene) - self.begins), 0.0) / self.depth
        return np.asarray(-self.side * self.size * pressed**HARDENING)


class FlexsplineLoad(JointMechanism):
    r"""A strain-wave drive whose twice-a-turn error grows with what it carries.

    .. math:: e = \text{size}\, (\tau / \tau_{max}) \sin(2 q + \varphi)

    The circular spline is not round, and the flexspline follows it the more the harder it is
    pressed: Ghorbel, Gandhi and Alpeter (2001), Journal of Mechanical Design 123(1), "On the
    kinematic error in harmonic drive gears", which shows the error change with the load.

    An amplitude of `size` rad under the largest load [N m].
    """

    largest: float = 1.0
    phase: float = 0.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Any loaded joint, any phase."""
        return cls(0.0, *chances.loaded(scene, rng), chances.phase(rng))

    def _error(self, scene: Scene) -> Array:
        share = self.torque(scene) / self.largest
        return self.size * share * np.sin(2.0 * self.reading(scene) + self.phase)


class GearPit(JointMechanism):
    r"""A pit in one tooth of the output gear: the joint falls in and climbs out.

    .. math:: e = -\text{size} \exp(-(q - c)^2 / 2 w^2), \quad q - c \text{ wrapped to a turn}

    Randall (1982), Journal of Mechanical Design 104(2), "A new method of modeling gear faults".

    A dip of `size` rad, `width` rad wide at one sigma, at one angle [rad].
    """

    centre: float = 0.0
    width: float = 0.1

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Where some reading is, a seventh to a quarter of a radian wide."""
        joint = chances.turning(scene, rng)
        centre = float(rng.choice(scene.session.q[:, joint - 1]))
        return cls(0.0, joint, centre, 2.0 * RANGES.one("pit", rng))

    def _error(self, scene: Scene) -> Array:
        away = np.angle(np.exp(1j * (self.reading(scene) - self.centre)))
        return np.asarray(-self.size * np.exp(-0.5 * (away / self.width) ** 2))


class HubSlip(JointMechanism):
    r"""A clamped hub slips on its shaft once, when the load has been largest, and stays there.

    .. math:: e = \text{size}\, [k > k_s]

    Budynas and Nisbett (2011), Shigley's Mechanical Engineering Design, sec. 7-7: the holding power
    of set screws and clamps is a limit, and what slips does not come back.

    A step of `size` rad in one joint after the time `moment` [s].
    """

    moment: float = 0.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """At the largest load of the middle three fifths of the session."""
        joint, _ = chances.loaded(scene, rng)
        rows = scene.session.rows
        middle = slice(rows // 5, rows - rows // 5)
        worst = int(np.abs(chances.torques(scene)[middle, joint - 1]).argmax()) + middle.start
        return cls(0.0, joint, float(scene.session.time[worst]))

    def _error(self, scene: Scene) -> Array:
        return np.where(scene.session.time > self.moment, self.size, 0.0)


class LoadWindup(JointMechanism):
    r"""Gear friction in proportion to the load: the side of approach shows where the joint carries.

    .. math:: e = -\text{size}\; d\, |\tau| / \tau_{max}, \qquad d = -1, 0, 1

    Hamon, Gautier and Garrec (2010), IROS, "Dynamic identification of robots with a dry friction
    model depending on load and velocity".

    A wind-up of `size` rad to either side under the largest load [N m].
    """

    largest: float = 1.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Any loaded joint."""
        return cls(0.0, *chances.loaded(scene, rng))

    def _error(self, scene: Scene) -> Array:
        share = np.abs(self.torque(scene)) / self.largest
        return -self.size * share * scene.session.direction[:, self.joint - 1]


class MaxwellSlip(JointMechanism):
    r"""Friction that winds up over travel and forgets slowly: four springs that slip one by one.

    .. math:: z_m \leftarrow \operatorname{clip}(z_m + \Delta q, -w_m, w_m), \qquad
              e = -\text{size} \sum_m z_m / \sum_m w_m

    Al-Bender, Lampaert and Swevers (2005), IEEE Transactions on Automatic Control 50(11): the
    generalised Maxwell-slip model. The joint remembers its last turning points, not its last side.

    Wind-up of `size` rad once all springs slip; widths [rad] of travel until each one does.
    """

    widths: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Springs that slip after 0.2 to 3 rad."""
        widths = np.sort(RANGES.many("slips", rng, 4))
        return cls(0.0, chances.turning(scene, rng), chances.vector(widths))

    def _error(self, scene: Scene) -> Array:
        width = np.array(self.widths)
        travel = self.travel(scene)
        wound, out = np.zeros(len(width)), np.empty(len(travel))
        for k, step in enumerate(travel):
            wound = np.clip(wound + step, -width, width)
            out[k] = wound.sum() / width.sum()
        return -self.size * out


class MotorHeat(JointMechanism):
    r"""A joint's zero wanders with the heat of its own motor: with how much it has moved of late.

    .. math:: H \leftarrow H e^{-\Delta t / T} + |\Delta q|, \qquad e = \text{size}\; H / H_{max}

    Heisel, Richter and Wurst (1997), CIRP Annals 46(1), "Thermal behaviour of industrial robots and
    possibilities for error compensation".

    `size` rad at the largest heat, counted in radians of way; cools with a constant [s].
    """

    cooling: float = 100.0
    largest: float = 1.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Cools within a twentieth to a fifth of the session."""
        joint = chances.turning(scene, rng)
        cooling = float(RANGES.one("cools", rng) * np.ptp(scene.session.time))
        trial = cls(0.0, joint, cooling)
        return cls(0.0, joint, cooling, float(trial._heat(scene).max()))

    def _heat(self, scene: Scene) -> Array:
        time = scene.session.time
        way = np.abs(self.travel(scene))
        heat = np.zeros(len(way))
        for k in range(1, len(way)):
            kept = heat[k - 1] * np.exp(-(time[k] - time[k - 1]) / self.cooling)
            heat[k] = kept + way[k]
        return heat

    def _error(self, scene: Scene) -> Array:
        return self.size * self._heat(scene) / self.largest


class WornBelt(JointMechanism):
    r"""A run of worn teeth in a toothed belt: the pulley settles against one flank or the other.

    .. math:: e = \text{size}\, \tanh(\tau / s) \cdot
              \tfrac12 [\tanh((q - a) / b) - \tanh((q - c) / b)]

    Where the teeth are whole nothing happens; where they are worn the load picks the flank (Gates
    2014, Light Power and Precision Manual, on tooth clearance and backlash of synchronous belts).

    A clearance of `size` rad to each flank, worn from one angle to another [rad].
    """

    largest: float = 1.0
    start: float = -0.5
    end: float = 0.5

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """A third to a half of the readings are on worn teeth."""
        joint, largest = chances.loaded(scene, rng)
        low = RANGES.one("worn_from", rng)
        high = low + RANGES.one("worn_for", rng)
        start, end = np.quantile(scene.session.q[:, joint - 1], [low, high])
        return cls(0.0, joint, largest, float(start), float(end))

    def _error(self, scene: Scene) -> Array:
        q, torque = self.reading(scene), self.torque(scene)
        worn = 0.5 * (np.tanh((q - self.start) / EDGE) - np.tanh((q - self.end) / EDGE))
        return np.asarray(self.size * np.tanh(torque / (PICKS * self.largest)) * worn)
