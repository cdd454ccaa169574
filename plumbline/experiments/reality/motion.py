"""A motion in MuJoCo: motors follow a path, links follow the motors as well as their drives can.

    tau = Kp (q_ref(t - delay) - q) + Kd (q_ref' - q') + bias(q, q')

    q_link = q_motor + delta,      k delta + c delta' = load,      |delta| <= play / 2 is free

Every joint is a motor, and where the drive yields, a second joint behind it. The motor's encoder
reads q_motor; a link-side encoder, and the tip, see q_link. Bodies follow the standard
Denavit-Hartenberg rows: the hinge of joint i turns about z of frame i - 1.

The command reaches the motors late; since encoders are read, not commands, that alone makes no gap.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, Shape, link_frame
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.recorder import quaternions

RANGES = Ranges("motion")
WARM_UP = 1.0  # s
KP, KD = 900.0, 60.0  # per unit of the inertia that a motor moves
ROTOR = 0.8  # kg m^2 (kg for a slide): a rotor's inertia behind its gear
STIFFEST = 2e5  # N m/rad of a drive that has play or friction but hardly yields
STEP = 5e-4  # s


@dataclass(frozen=True)
class Trouble:
    """All that is physically wrong, in SI units."""

    drives: dict[int, Drive] = field(default_factory=dict)  # drives that yield, by joint from 0
    payload: float = 0.0  # unknown mass at the tip [kg]
    # (coulomb [N m], breakaway [N m], Stribeck velocity [rad/s]) by joint from 0, at the link's
    # bearing
    friction: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    tissue: float = 0.0  # stiffness of what the tip pushes against [N/m]; 0 for nothing
    latency: float = 0.0  # age of what the device or the link's encoder reports [s]


@dataclass(frozen=True)
class Course:
    """A path: sums of two sines a joint."""

    centre: Array  # (n,) [rad or m]
    swing: Array  # (2, n) amplitudes [rad or m]
    rate: Array  # (2, n) angular frequencies [rad/s]
    phase: Array  # (2, n) [rad]
    times: Array  # (N,) times of the readings after the warm-up [s]
    delay: float  # by how much the command comes late [s]

    @classmethod
    def draw(cls, arm: Arm, rows: int, rng: np.random.Generator) -> Course:
        """A path within the joint range, at most about 1 rad/s, read every 0.05 to 0.2 s."""
        half = 0.5 * (arm.upper - arm.lower)
        swing = half * RANGES.many("swing", rng, (2, arm.joints))
        speed = RANGES.many("speed", rng, (2, arm.joints)) * np.where(arm.prismatic, 0.15, 1.0)
        times = np.cumsum(RANGES.many("uneven", rng, rows) * RANGES.one("period", rng))
        middle, phase = 0.5 * (arm.upper + arm.lower), rng.uniform(0.0, 2.0 * np.pi, swing.shape)
        return cls(middle, swing, speed / swing, phase, times, RANGES.one("delay", rng))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Reference positions (T, n) and velocities (T, n) at times (T,)."""
        angle = self.rate * time[:, None, None] + self.phase
        q = self.centre + np.sum(self.swing * np.sin(angle), axis=1)
        return q, np.sum(self.swing * self.rate * np.cos(angle), axis=1)


@dataclass(frozen=True)
class Motion:
    """What happened at the readings."""

    q: Array  # (N, n) motor encoders [rad or m]
    velocity: Array  # (N, n) of the motors
    effort: Array  # (N, n) torques of the motors [N m or N]
    link: Array  # (N, n) link-side positions, as old as the latency
    tip: Array  # (N, 3) tip in the base frame [m], as old as the latency
    push: Array  # (3,) where the tissue lies [m]


def engine() -> Any:
    """MuJoCo's module (PlumblineError: it is not installed)."""
    try:
        return import_module("mujoco")
    except ImportError:
        raise PlumblineError("moving cases need MuJoCo: pip install 'plumbline[mujoco]'") from None


def move(arm: Arm, tool: Array, course: Course, trouble: Trouble) -> Motion:
    """Move the arm along a course; tool (3,) [m] is where its tip really is."""
    mujoco = engine()
    model = mujoco.MjModel.from_xml_string(mjcf(arm, tool, trouble.drives, trouble.payload))
    data = mujoco.MjData(model)
    place = Places.of(model, arm)
    steps = int((WARM_UP + float(course.times[-1])) / STEP) + 2
    clock = np.arange(steps, dtype=np.float64) * STEP
    reference, rate = course.at(np.asarray(clock - course.delay))
    data.qpos[place.motor] = reference[0]
    mujoco.mj_forward(model, data)
    for joint, drive in trouble.drives.items():  # begin at rest, not with a jolt
        data.qpos[place.drive[joint]] = -data.qfrc_bias[place.drive[joint]] / drive.stiffness
    mujoco.mj_forward(model, data)
    push = data.site_xpos[0].copy()
    wanted = np.round((WARM_UP + course.times) / STEP).astype(int)
    late = np.round((WARM_UP + course.times - trouble.latency) / STEP).astype(int)
    n = arm.joints
    seen, old = np.zeros((steps, 3, n)), np.zeros((steps, n + 3))
    for k in range(steps):
        mujoco.mj_forward(model, data)
        q, v = data.qpos[place.motor], data.qvel[place.motor]
        old[k, :n], old[k, n:] = place.link(data.qpos), data.site_xpos[0]
        tau = data.qfrc_bias[place.motor] + place.inertia * (
            KP * (reference[k] - q) + KD * (rate[k] - v)
        )
        seen[k] = q, v, tau
        data.qfrc_applied[:] = 0.0
        _load(mujoco, model, data, place, trouble, push)
        data.qfrc_applied[place.motor] += tau
        mujoco.mj_step(model, data)
    if any(warning.number for warning in data.warning) or not np.isfinite(seen).all():
        raise PlumblineError(
            f"{arm.name}: the motion is unstable; take another arm or a shorter step"
        )
    q, velocity, effort = np.moveaxis(seen[wanted], 1, 0)
    return Motion(q, velocity, effort, old[late, :n], old[late, n:], push)


@dataclass(frozen=True)
class Places:
    """Where motors and drives stand among MuJoCo's coordinates (all joints have one)."""

    motor: NDArray[np.intp]  # (n,) of the motors
    drive: NDArray[np.intp]  # (n,) of the drives, -1 where the drive is rigid
    inertia: Array  # (n,) inertia that each motor moves in the zero posture, which sets its gains
    flange: int  # number of the flange's body

    @classmethod
    def of(cls, model: Any, arm: Arm) -> Places:
        """Look the names up."""
        names = {model.joint(k).name: k for k in range(model.njnt)}
        motor = np.array([names[f"motor{i + 1}"] for i in range(arm.joints)])
        drive = np.array([names.get(f"drive{i + 1}", -1) for i in range(arm.joints)])
        return cls(motor, drive, model.dof_M0[motor], int(model.body("flange").id))

    def link(self, qpos: Array) -> Array:
        """Link-side positions (n,)."""
        return np.asarray(qpos[self.motor] + np.where(self.drive >= 0, qpos[self.drive], 0.0))


def _load(mujoco: Any, model: Any, data: Any, place: Places, trouble: Trouble, push: Array) -> None:
    """Forces that the model itself lacks: springs with play, bearings, tissue."""
    for joint, drive in trouble.drives.items():
        if drive.play:
            delta = float(data.qpos[place.drive[joint]])
            beyond = delta - np.clip(delta, -0.5 * drive.play, 0.5 * drive.play)
            data.qfrc_applied[place.drive[joint]] -= drive.stiffness * beyond
    for joint, (coulomb, breakaway, slow) in trouble.friction.items():
        v = float(data.qvel[place.motor[joint]] + data.qvel[place.drive[joint]])
        size = coulomb + (breakaway - coulomb) * np.exp(-((v / slow) ** 2))
        drag = size * np.tanh(v / 5e-3)
        # The bearing brakes the link against the frame, so motor and drive both feel it.
        data.qfrc_applied[[place.motor[joint], place.drive[joint]]] -= drag
    if trouble.tissue:
        tip = data.site_xpos[0]
        force = np.array([-trouble.tissue * (tip[0] - push[0]), 0.0, 0.0])
        mujoco.mj_applyFT(model, data, force, np.zeros(3), tip, place.flange, data.qfrc_applied)


@dataclass(frozen=True)
class Drive:
    """What lies between a motor and its link."""

    stiffness: float = STIFFEST  # [N m/rad]
    play: float = 0.0  # width within which nothing is transmitted [rad]


def link_inertia(arm: Arm, i: int) -> Array:
    """Principal moments (3,) [kg m^2] of a link: a rod along its length, 6 cm thick."""
    length = float(np.hypot(arm.a[i], arm.d[i])) + 0.06
    return np.full(3, arm.mass[i] * (length**2 / 12.0 + 0.06**2 / 4.0))


def fixed_part(arm: Arm, i: int) -> Array:
    """T (4, 4) from frame i - 1 to frame i, of a joint at zero."""
    return np.asarray(link_frame(arm, np.zeros(1), Shape.of(arm, 1), i)[0])


def mjcf(arm: Arm, tool: Array, drives: dict[int, Drive], payload: float = 0.0) -> str:
    """The model as MJCF text, of an arm with its real masses, its tip (3,) [m] in the last frame.

    Drives that yield are given by joint from 0, all others are rigid; an unknown mass [kg] is at
    the tip.
    """
    body = _end(arm, tool, payload)
    for i in reversed(range(arm.joints)):
        body = _joint(arm, i, drives.get(i), body)
    gravity = _words(arm.gravity)
    return (
        '<mujoco><compiler angle="radian"/>'
        f'<option timestep="{STEP}" gravity="{gravity}" integrator="implicitfast"/>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )


def _end(arm: Arm, tool: Array, payload: float) -> str:
    """The flange: its tip, and what hangs there."""
    place = _placed(fixed_part(arm, arm.joints - 1))
    weight = ""
    if payload > 0.0:
        small = _words(np.full(3, 1e-4 * payload))
        inertia = f'<inertial pos="0 0 0" mass="{payload}" diaginertia="{small}"/>'
        weight = f'<body pos="{_words(tool)}">{inertia}</body>'
    return f'<body name="flange" {place}><site name="tip" pos="{_words(tool)}"/>{weight}</body>'


def _joint(arm: Arm, i: int, drive: Drive | None, inner: str) -> str:
    """Motor, drive and link of one joint, with all that hangs on it."""
    kind = "slide" if arm.prismatic[i] else "hinge"
    place = _placed(fixed_part(arm, i - 1)) if i else ""
    T = fixed_part(arm, i)
    centre = T[:3, :3] @ arm.com[i] + T[:3, 3]
    link = (
        f'<inertial pos="{_words(centre)}" mass="{arm.mass[i]}" '
        f'diaginertia="{_words(link_inertia(arm, i))}"/>{inner}'
    )
    motor = f'<joint name="motor{i + 1}" type="{kind}" axis="0 0 1" armature="{ROTOR}"/>'
    if drive is None:
        return f"<body {place}>{motor}{link}</body>"
    # The spring of a drive with play is worked out step by step, outside of the model.
    stiffness = 0.0 if drive.play else drive.stiffness
    damping = 0.3 * np.sqrt(drive.stiffness)
    elastic = (
        f'<joint name="drive{i + 1}" type="{kind}" axis="0 0 1" armature="0.05" '
        f'stiffness="{stiffness}" damping="{damping}"/>'
    )
    rotor = '<inertial pos="0 0 0" mass="0.001" diaginertia="1e-5 1e-5 1e-5"/>'
    return f"<body {place}>{motor}{rotor}<body>{elastic}{link}</body></body>"


def _placed(T: Array) -> str:
    return f'pos="{_words(T[:3, 3])}" quat="{_words(quaternions(T[None, :3, :3])[0])}"'


def _words(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)
