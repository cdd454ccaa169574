"""One draw for every mechanism: which element, which phase, which period.

A draw fixes everything about a mechanism but its strength, which the unabsorbed gap sets
afterwards.
"""

from collections.abc import Callable, Sequence

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import body_effects as body
from plumbline.experiments.reality import end_effects as end
from plumbline.experiments.reality import joint_effects as joint
from plumbline.experiments.reality import outside_effects as outside
from plumbline.experiments.reality.arm import Array, load_torque
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen import UNSEEN

Draw = Callable[[Scene, np.random.Generator], Mechanism]
TURN = 2.0 * np.pi


def _pick(choices: Sequence[int], rng: np.random.Generator) -> int:
    return int(choices[int(rng.integers(len(choices)))])


def _joint(scene: Scene, rng: np.random.Generator) -> int:
    return int(rng.integers(1, scene.arm.joints + 1))


def _turning(scene: Scene, rng: np.random.Generator) -> int:
    return _pick(list(np.flatnonzero(~scene.arm.prismatic) + 1), rng)


def _other(scene: Scene, first: int, rng: np.random.Generator) -> int:
    turning = [int(j) + 1 for j in np.flatnonzero(~scene.arm.prismatic) if j + 1 != first]
    return _pick(turning, rng)


def _unit(rng: np.random.Generator) -> tuple[float, ...]:
    u: Array = rng.normal(size=3)
    return tuple(float(v) for v in u / np.linalg.norm(u))


def _twist(rng: np.random.Generator) -> tuple[float, ...]:
    """Weights of a base motion: metres and about a radian per metre of arm."""
    return tuple(float(v) for v in rng.normal(size=6) * [1.0, 1.0, 1.0, 1.5, 1.5, 1.5])


def _ripple(scene: Scene, rng: np.random.Generator) -> Mechanism:
    once = (float(rng.uniform(0.7, 1.0)), float(rng.uniform(0.0, TURN)))
    twice = (float(rng.uniform(0.7, 1.0)), float(rng.uniform(0.0, TURN)))
    form = rng.integers(3)
    once = once if form != 1 else (0.0, 0.0)
    twice = twice if form != 0 else (0.0, 0.0)
    return joint.TransmissionRipple(0.0, _turning(scene, rng), once, twice)


def _gear(scene: Scene, rng: np.random.Generator) -> Mechanism:
    order = float(np.exp(rng.uniform(np.log(3.0), np.log(250.0))))
    if rng.random() < 0.5:
        order = float(round(order))
    turning = _turning(scene, rng)
    return joint.GearRipple(0.0, turning, round(order, 2), float(rng.uniform(0.0, TURN)))


def _coupling(scene: Scene, rng: np.random.Generator) -> Mechanism:
    n = scene.arm.joints
    pairs = [
        (j, k)
        for j in range(1, n + 1)
        for k in (j - 1, j + 1)
        if 1 <= k <= n and not scene.arm.prismatic[[j - 1, k - 1]].any()
    ]
    dragged, source = pairs[int(rng.integers(len(pairs)))]
    return joint.JointCoupling(float(rng.choice([-1.0, 1.0])), dragged, source)


def _geometry(scene: Scene, rng: np.random.Generator) -> Mechanism:
    chosen = rng.random(3) < 0.5
    chosen[rng.integers(3)] = True
    weights = tuple(float(w) for w in np.where(chosen, rng.normal(size=3) * [1.0, 1.0, 2.0], 0.0))
    return body.LinkGeometry(0.0, _joint(scene, rng), weights)


def _flex(scene: Scene, rng: np.random.Generator) -> Mechanism:
    long = [
        i + 1
        for i in range(scene.arm.joints)
        if np.linalg.norm(body.link_vector(scene, i)[0]) > 0.12 and not scene.arm.prismatic[i]
    ]
    return body.LinkFlex(0.0, _pick(long, rng))


def _payload(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Drives that all twist alike under the load, give or take a tenth."""
    stiff = 2e4 * (scene.arm.mass.sum() / 20.0) ** 1.5
    spread = stiff * rng.uniform(0.9, 1.1, scene.arm.joints)
    spread = np.where(scene.arm.prismatic, 1e9, spread)
    return joint.Payload(0.0, tuple(float(v) for v in spread))


def _loose(scene: Scene, rng: np.random.Generator) -> Mechanism:
    rows = scene.session.rows
    chosen = rng.choice(np.arange(1, rows), size=3, replace=False)
    if rng.random() < 0.5:
        chosen = np.arange(3) + rng.integers(1, rows - 3)
    return outside.LooseTool(0.0, tuple(sorted(int(r) for r in chosen)), _unit(rng))


def _spot(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """A spot that some readings are near: its width reaches a sixth to a third of the cloud."""
    points, _ = scene.pose_in_device()
    centre = points[int(rng.integers(len(points)))]
    size = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    width = size * float(rng.uniform(0.3, 0.6))
    return outside.MagneticSpot(0.0, tuple(float(v) for v in centre), width, _unit(rng))


def _cross(scene: Scene, rng: np.random.Generator) -> Mechanism:
    first = _turning(scene, rng)
    return outside.CrossRipple(
        0.0, first, _other(scene, first, rng), float(rng.integers(2, 7)), float(rng.integers(1, 4)),
        float(rng.uniform(0.0, TURN)),
    )  # fmt: skip


def _sag(scene: Scene, rng: np.random.Generator) -> Mechanism:
    return end.NeedleSag(0.0, _needle(scene, rng))


def _needle(scene: Scene, rng: np.random.Generator) -> tuple[float, ...]:
    """The needle points from the flange to the tip, give or take three degrees."""
    axis = scene.tool[0] / np.linalg.norm(scene.tool[0]) + rng.normal(0.0, 0.05, 3)
    return tuple(float(v) for v in axis / np.linalg.norm(axis))


def _tilt(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Any bearing but the first, whose tilt is its mounting's."""
    turning = [int(j) + 1 for j in np.flatnonzero(~scene.arm.prismatic) if j > 0]
    return body.JointTilt(0.0, _pick(turning, rng), float(rng.uniform(-0.15, 0.15)))


def _play(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Sided by the approach, or, in one of three, by the weight of a link that leans both ways."""
    torque = load_torque(scene.arm, scene.frames())
    least = 0.2 * np.abs(torque).max(axis=0)
    leaning = np.flatnonzero((torque.max(axis=0) > least) & (torque.min(axis=0) < -least)) + 1
    if len(leaning) and rng.random() < 1.0 / 3.0:
        seat = float(rng.uniform(0.005, 0.03))
        return joint.LoadedPlay(0.0, _pick(leaning.tolist(), rng), seat)
    return joint.Backlash(0.0, _joint(scene, rng))


def _coupled_play(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Play of a joint further in, which the cables run across."""
    turning = [int(j) + 1 for j in np.flatnonzero(~scene.arm.prismatic)]
    dragged = _pick(turning[1:], rng)
    return joint.CoupledPlay(0.0, dragged, _pick([j for j in turning if j < dragged], rng))


def _slip(scene: Scene, rng: np.random.Generator) -> Mechanism:
    """Re-seated once, or anew in each group of the session."""
    if rng.random() < 0.6:
        return end.ToolSlip(0.0, (_unit(rng),), (float(rng.uniform(0.2, 0.8)),))
    groups = int(np.ptp(scene.session.group))
    return end.ToolSlip(0.0, tuple(_unit(rng) for _ in range(groups)))


def _breath(scene: Scene, rng: np.random.Generator) -> Mechanism:
    return end.Respiration(
        0.0, _unit(rng), float(rng.uniform(3.0, 6.0)), float(rng.uniform(0.0, np.pi)),
        int(rng.integers(2, 4)),
    )  # fmt: skip


LIBRARY: dict[str, Draw] = {
    "joint_offset": lambda s, r: joint.JointOffset(0.0, _joint(s, r)),
    "joint_scale": lambda s, r: joint.JointScale(0.0, _joint(s, r)),
    "joint_compliance": lambda s, r: joint.JointCompliance(
        0.0, _turning(s, r), stiffening=float(r.uniform(0.1, 0.3))
    ),
    "joint_tilt": _tilt,
    "backlash": _play,
    "coupled_play": _coupled_play,
    "hysteresis": lambda s, r: joint.Hysteresis(0.0, _joint(s, r), float(r.uniform(-1.0, 1.0))),
    "transmission_ripple": _ripple,
    "gear_ripple": _gear,
    "joint_coupling": _coupling,
    "link_geometry": _geometry,
    "link_thermal": lambda s, r: body.LinkThermal(0.0),
    "link_flex": _flex,
    "tool_slip": _slip,
    "needle_bending": lambda s, r: end.NeedleBending(0.0, _needle(s, r)),
    "base_drift": lambda s, r: body.BaseDrift(0.0, _twist(r), float(r.uniform(0.5, 3.0))),
    "base_bump": lambda s, r: body.BaseBump(0.0, _twist(r), float(r.uniform(0.2, 0.8))),
    "base_compliance": lambda s, r: body.BaseCompliance(0.0, float(r.uniform(-0.15, 0.15))),
    "needle_sag": _sag,
    "payload": _payload,
    "sensor_scale": lambda s, r: end.SensorScale(0.0),
    "sensor_distortion": lambda s, r: end.SensorDistortion(0.0, str(r.choice(["radial", "depth"]))),
    "latency": lambda s, r: joint.Latency(0.0),
    "respiration": _breath,
}

OUTSIDE: dict[str, Draw] = {
    "cross_ripple": _cross,
    "magnetic_spot": _spot,
    "stick_slip": lambda s, r: outside.StickSlip(0.0, _turning(s, r), int(r.integers(2**31))),
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
    """Draw a mechanism by name; strength 0, but for its sign.

    Raises:
        PlumblineError: There is no mechanism of that name.
    """
    known = LIBRARY | OUTSIDE | UNSEEN
    if name not in known:
        raise PlumblineError(f"Mechanism {name!r} not recognised; known: {', '.join(known)}")
    return known[name](scene, rng)
