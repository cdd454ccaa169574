"""An arm for MuJoCo: every joint a motor, and where the drive yields, a second joint behind it.

    q_link = q_motor + delta,      k delta + c delta' = load,      |delta| <= play / 2 is free

The motor's encoder reads q_motor; a link-side encoder, and the tip, see q_link. Bodies follow the
standard Denavit-Hartenberg rows: the hinge of joint i turns about z of frame i - 1.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Arm, Array
from plumbline.experiments.reality.recorder import quaternions

ROTOR = 0.8  # kg m^2 (kg for a slide): a rotor's inertia behind its gear
STIFFEST = 2e5  # N m/rad of a drive that has play or friction but hardly yields
STEP = 5e-4  # s


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
    """T (4, 4) from frame i - 1, turned by its joint, to frame i."""
    ct, st = np.cos(arm.theta[i]), np.sin(arm.theta[i])
    ca, sa = np.cos(arm.alpha[i]), np.sin(arm.alpha[i])
    return np.array(
        [
            [ct, -st * ca, st * sa, arm.a[i] * ct],
            [st, ct * ca, -ct * sa, arm.a[i] * st],
            [0.0, sa, ca, arm.d[i]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


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
    last = fixed_part(arm, arm.joints - 1)
    place = f'pos="{_words(last[:3, 3])}" quat="{_words(quaternions(last[None, :3, :3])[0])}"'
    weight = ""
    if payload > 0.0:
        small = _words(np.full(3, 1e-4 * payload))
        inertia = f'<inertial pos="0 0 0" mass="{payload}" diaginertia="{small}"/>'
        weight = f'<body pos="{_words(tool)}">{inertia}</body>'
    return f'<body name="flange" {place}><site name="tip" pos="{_words(tool)}"/>{weight}</body>'


def _joint(arm: Arm, i: int, drive: Drive | None, inner: str) -> str:
    """Motor, drive and link of one joint, with all that hangs on it."""
    kind = "slide" if arm.prismatic[i] else "hinge"
    place = ""
    if i:
        before = fixed_part(arm, i - 1)
        turn = quaternions(before[None, :3, :3])[0]
        place = f'pos="{_words(before[:3, 3])}" quat="{_words(turn)}"'
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


def _words(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)
