"""One draw for every mechanism: which element, which phase, which period.

A draw fixes everything about a mechanism but its strength, which the unabsorbed gap sets
afterwards.
"""

from collections.abc import Callable

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import body_effects as body
from plumbline.experiments.reality import chances
from plumbline.experiments.reality import end_effects as end
from plumbline.experiments.reality import joint_effects as joint
from plumbline.experiments.reality import outside_effects as outside
from plumbline.experiments.reality.chances import any_joint, phase, turning, twist, unit, vector
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen import UNSEEN

Draw = Callable[[Scene, np.random.Generator], Mechanism]
RANGES = Ranges("library")
LEANS = 0.2  # share of a joint's largest load that a link must lean with to either side
STIFF = 2e4  # N m/rad of the drives of an arm of 20 kg
RIGID = 1e9  # N/m of a slide


def _ripple(scene: Scene, rng: np.random.Generator) -> Mechanism:
    once, twice = ((RANGES.one("ripple", rng), phase(rng)) for _ in range(2))
    form = rng.integers(3)  # once, twice, or both
    once = once if form != 1 else (0.0, 0.0)
    twice = twice if form != 0 else (0.0, 0.0)
    return joint.TransmissionRipple(0.0, turning(scene, rng), once, twice)


def _gear(scene: Scene, rng: np.random.Generator) -> Mechanism:
    order = RANGES.one("gear_order", rng)
    order = round(order, None if RANGES.happens("whole_order", rng) else 2)
    return joint.GearRipple(0.0, turning(scene, rng), float(order), phase(rng))


def _coupling(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Neighbours that both turn."""
    turns = set(np.flatnonzero(~scene.arm.prismatic).tolist())
    pairs = [(j, k) for j in sorted(turns) for k in (j - 1, j + 1) if k in turns]
    dragged, source = pairs[int(rng.integers(len(pairs)))]
    return joint.JointCoupling(chances.sign(rng), dragged + 1, source + 1)


def _geometry(scene: Scene, rng: np.random.Generator) -> Mechanism:
    chosen = rng.random(3) < RANGES.chances["dimension"].share
    chosen[rng.integers(3)] = True
    weights = vector(np.where(chosen, RANGES.near("geometry", rng, 3), 0.0))
    return body.LinkGeometry(0.0, any_joint(scene, rng), weights)


def _payload(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Drives that all twist alike under the load, give or take a tenth."""
    stiff = STIFF * (scene.arm.mass.sum() / 20.0) ** 1.5
    spread = stiff * RANGES.many("drive", rng, scene.arm.joints)
    return joint.Payload(0.0, vector(np.where(scene.arm.prismatic, RIGID, spread)))


def _loose(scene: Scene, rng: np.random.Generator) -> Mechanism:
    rows = scene.session.rows
    chosen = rng.choice(np.arange(1, rows), size=3, replace=False)
    if RANGES.happens("in_a_row", rng):
        chosen = np.arange(3) + rng.integers(1, rows - 3)
    return outside.LooseTool(0.0, tuple(sorted(chosen.tolist())), unit(rng))


def _spot(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """A spot that some readings are near: its width reaches a sixth to a third of the cloud."""
    points, _ = scene.pose_in_device()
    centre = points[int(rng.integers(len(points)))]
    width = chances.spread(points) * RANGES.one("spot", rng)
    return outside.MagneticSpot(0.0, vector(centre), width, unit(rng))


def _cross(scene: Scene, rng: np.random.Generator) -> Mechanism:
    first = turning(scene, rng)
    others = np.flatnonzero(~scene.arm.prismatic) + 1
    other = int(rng.choice(others[others != first]))
    order, mesh = (float(RANGES.whole(name, rng)) for name in ("cross_order", "cross_mesh"))
    return outside.CrossRipple(0.0, first, other, order, mesh, phase(rng))


def _needle(scene: Scene, rng: np.random.Generator) -> tuple[float, ...]:
    """The needle points from the flange to the tip, give or take three degrees."""
    axis = scene.tool[0] / np.linalg.norm(scene.tool[0]) + RANGES.near("needle", rng, 3)
    return vector(axis / np.linalg.norm(axis))


def _play(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Sided by the approach, or at times by the weight of a link that leans both ways."""
    torque = chances.torques(scene)
    least = LEANS * np.abs(torque).max(axis=0)
    leaning = np.flatnonzero((torque.max(axis=0) > least) & (torque.min(axis=0) < -least)) + 1
    if len(leaning) and RANGES.happens("seated_by_load", rng):
        seat = RANGES.one("play_seat", rng)
        return joint.LoadedPlay(0.0, int(rng.choice(leaning)), seat)
    return joint.Backlash(0.0, any_joint(scene, rng))


def _coupled_play(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Play of a joint further in, which the cables run across."""
    joints = np.flatnonzero(~scene.arm.prismatic) + 1
    dragged = int(rng.choice(joints[1:]))
    return joint.CoupledPlay(0.0, dragged, int(rng.choice(joints[joints < dragged])))


def _slip(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Re-seated once, or anew in each group of the session."""
    if RANGES.happens("once", rng):
        return end.ToolSlip(0.0, (unit(rng),), (RANGES.one("moment", rng),))
    groups = int(np.ptp(scene.session.group))
    return end.ToolSlip(0.0, tuple(unit(rng) for _ in range(groups)))


def _breath(scene: Scene, rng: np.random.Generator) -> Mechanism:
    way, period, begun = unit(rng), RANGES.one("breath", rng), RANGES.one("breath_begun", rng)
    return end.Respiration(0.0, way, period, begun, RANGES.whole("breath_power", rng))


LIBRARY: dict[str, Draw] = {
    "joint_offset": lambda s, r: joint.JointOffset(0.0, any_joint(s, r)),
    "joint_scale": lambda s, r: joint.JointScale(0.0, any_joint(s, r)),
    "joint_compliance": lambda s, r: joint.JointCompliance(
        0.0, turning(s, r), RANGES.one("stiffening", r)
    ),
    # Any bearing but the first, whose tilt is its mounting's.
    "joint_tilt": lambda s, r: body.JointTilt(0.0, turning(s, r, 1), RANGES.one("unequal", r)),
    "backlash": _play,
    "coupled_play": _coupled_play,
    "hysteresis": lambda s, r: joint.Hysteresis(0.0, any_joint(s, r), RANGES.one("start", r)),
    "transmission_ripple": _ripple,
    "gear_ripple": _gear,
    "joint_coupling": _coupling,
    "link_geometry": _geometry,
    "link_thermal": lambda s, r: body.LinkThermal(0.0),
    "link_flex": lambda s, r: body.LinkFlex(0.0, chances.long_link(s, r)),
    "tool_slip": _slip,
    "needle_bending": lambda s, r: end.NeedleBending(0.0, _needle(s, r)),
    "base_drift": lambda s, r: body.BaseDrift(0.0, twist(r), RANGES.one("drift_rate", r)),
    "base_bump": lambda s, r: body.BaseBump(0.0, twist(r), RANGES.one("moment", r)),
    "base_compliance": lambda s, r: body.BaseCompliance(0.0, RANGES.one("unequal", r)),
    "needle_sag": lambda s, r: end.NeedleSag(0.0, _needle(s, r)),
    "payload": _payload,
    "sensor_scale": lambda s, r: end.SensorScale(0.0),
    "sensor_distortion": lambda s, r: end.SensorDistortion(0.0, str(r.choice(["radial", "depth"]))),
    "latency": lambda s, r: joint.Latency(0.0),
    "respiration": _breath,
}

OUTSIDE: dict[str, Draw] = {
    "cross_ripple": _cross,
    "magnetic_spot": _spot,
    "stick_slip": lambda s, r: outside.StickSlip(0.0, turning(s, r), int(r.integers(2**31))),
    "loose_tool": _loose,
}

SIGNED = {
    "joint_offset", "joint_scale", "joint_coupling", "coupled_play", "sensor_scale",
    "sensor_distortion",
}  # fmt: skip
ORDER = [
    "link_geometry", "link_thermal", "joint_coupling", "joint_offset", "joint_scale", "backlash",
    "coupled_play", "hysteresis", "transmission_ripple", "gear_ripple", "cross_ripple",
    "stick_slip", "latency", "joint_compliance", "payload", "joint_tilt", "link_flex",
    "tool_slip", "loose_tool", "needle_sag", "needle_bending", "base_drift", "base_bump",
    "base_compliance", "respiration", "sensor_scale", "sensor_distortion",
    "magnetic_spot", *UNSEEN,
]  # fmt: skip

JOINT_ONLY = {
    "joint_offset", "joint_scale", "joint_compliance", "backlash", "hysteresis",
    "transmission_ripple", "gear_ripple", "joint_coupling", "coupled_play", "latency",
}  # fmt: skip
DEVICE_ONLY = {"sensor_scale", "sensor_distortion", "latency", "respiration"}


def offered(observation: str) -> tuple[str, ...]:
    """Names of the library effects that make sense in an observation."""
    if observation == "joint_position":
        return tuple(name for name in LIBRARY if name in JOINT_ONLY)
    if observation == "fixed_point":
        return tuple(name for name in LIBRARY if name not in DEVICE_ONLY)
    return tuple(LIBRARY)


def outside_offered(observation: str) -> tuple[str, ...]:
    """Names of the outside mechanisms that make sense in an observation."""
    turned = ("cross_ripple", "stick_slip")
    if observation == "joint_position":
        return turned
    return (*turned, "loose_tool", *(() if observation == "fixed_point" else ("magnetic_spot",)))


def draw(name: str, scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Draw a mechanism by name, refused if unknown; strength 0, but for its sign."""
    known = LIBRARY | OUTSIDE | UNSEEN
    if name not in known:
        raise PlumblineError(f"Mechanism {name!r} not recognised; known: {', '.join(known)}")
    return known[name](scene, rng)
