r"""Drives as MJCF: bodies as the robot's file has them, and an actuator of its own for every joint.

A servo on position is a spring to its command, damped, with dry friction about it,

.. math:: I \ddot q + d \dot q + F \operatorname{sign} \dot q + h = k_p (c_f - q), \qquad
          F = k_p b, \quad k_p = 1 / k

:math:`b` half the play: slow motion of a spring against dry friction is the play operator
(Prandtl 1928, ZAMM 8(2), the model of elastic and plastic elements in series); :math:`k` the
servo's compliance. A dead band stops a slow servo as short of its command, and is held so where
there is no play. Where no compliance was found the spring is so stiff that its own frequency is
``STIFF``. The spring itself is late by :math:`2 \zeta / \omega`, which the lag of the filter, then
the delay, is shorter by. A servo of second order is as slow by a rotor. What a format has no word
for (a largest speed) is told.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from xml.etree import ElementTree

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.link_export import words, xml_text
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.motion.carried import weighed
from plumbline.optim.diagnosis.motion.constants import LEAST_INERTIA
from plumbline.optim.model.constants import DAMPED, LEAST_DAMPED, MJCF_STEP, SAMPLE, SPAN, STIFF
from plumbline.optim.model.driven import Driven, Servo
from plumbline.optim.model.export.exported import Exported, Lack, has_mujoco, must_agree
from plumbline.optim.model.export.mjcf import FRICTION, world

# What MuJoCo's actuators cannot be told.
NO_WORD = ("velocity_limit", "acceleration_limit")
TURN = 2 * np.pi  # [rad]


@dataclass(frozen=True)
class Actuator:
    """One joint's actuator and joint in MuJoCo's numbers."""

    gain: float  # force per command [N m/rad, N m s/rad or 1]
    # force at rest, per position and per velocity [N m, N m/rad, N m s/rad]
    bias: tuple[float, float, float]
    filter: float = 0.0  # time constant in front of it [s]; 0 for none
    delay: float = 0.0  # how late commands are obeyed [s]
    force: float = 0.0  # largest force either way [N m]; 0 for any
    friction: float = 0.0  # dry friction at the joint [N m]
    damping: float = 0.0  # viscous friction there [N m s/rad]
    rotor: float = 0.0  # inertia there [kg m^2]


def drives_mjcf(drives: Driven) -> Exported:
    """The robot with these drives as MJCF, read again by MuJoCo where it is installed.

    Raises:
        PlumblineError: Read again, it does not stand where the robot's file has it; or these are
            a controlled tip's axes, and there is no robot to write.
    """
    if drives.of_axes:
        raise PlumblineError(
            f"{drives.recording}: drives of a tip's axes, a robot's expected; its controller takes "
            "them: mpc.Plant.of(answer)"
        )
    lacked = {number: _lacked(drives.law, servo) for number, servo in drives.servos.items()}
    lacks, whole, stays = _sizes(drives, lacked)
    robot, numbers = commanded(drives)
    root = _root(drives, robot, numbers)
    said = [f"Drives of {drives.robot.name} as found on {drives.recording}.",
            "Delays need MuJoCo 3.5 or later.",
            *(f"Not in this file: {lack}: {lack.words}" for lack in lacks)]  # fmt: skip
    root.insert(0, ElementTree.Comment("\n" + "\n".join(said).replace("--", "-") + "\n"))
    text = xml_text(root)
    error = _read_again(robot, text)
    must_agree(drives.recording, "MJCF misses the robot", float(np.nan_to_num(error)))
    return Exported(text, "", error, lacks, whole, stays, "rad")


def actuator_of(law: Law, servo: Servo, kp: float, kd: float) -> Actuator:
    """A joint's drive in MuJoCo's numbers; what was found of it that they cannot hold is left out.

    Known gains are kp [N m/rad] and kd [N m s/rad]; 0 where they are not.
    """
    offset, late = servo.value("actuation_offset"), max(servo.value("actuation_delay"), 0.0)
    lag, strongest = servo.value("actuation_lag"), servo.value("torque_limit")
    inertia, scale = servo.inertia + LEAST_INERTIA, 1.0 + servo.value("actuation_gain")
    rubs = {
        "friction": servo.value("coulomb_friction"), "damping": servo.value("viscous_friction"),
        "rotor": servo.value("rotor_inertia"),
    }  # fmt: skip
    if not law.follows:
        kv = inertia * STIFF if law in (Law.VELOCITY, Law.RATE) else 0.0
        gain = kv or 1.0
        bias = (gain * offset, 0.0, -kv)
        return Actuator(gain * scale, bias, lag, late, strongest, **rubs)
    yields = servo.value("servo_stiffness")
    stiffness = kp / (1 + kp * yields) if kp else 1 / yields if yields else inertia * STIFF**2
    # Share of critical damping: the spring is no later than what was found.
    ratio = np.clip((lag + late) * np.sqrt(stiffness / inertia) / 2, LEAST_DAMPED, DAMPED)
    damping = kd if kp else 2 * float(ratio) * np.sqrt(stiffness * inertia)
    inside, s = servo.value("actuation_play", inside=True), servo.value("servo_bandwidth") / TURN
    if s:  # a rotor makes the spring as slow
        rubs["rotor"] = max(s**2 * stiffness - inertia, 0.0)
        damping = stiffness * 2 * s
    elif inside and not kp:  # its lag is the loop's own
        damping, lag = max(damping, stiffness * lag), 0.0
    elif not kp:
        own = damping / stiffness
        lag, late = max(lag - own, 0.0), late - max(own - lag, 0.0)
    play = inside + servo.value("actuation_play", inside=False)
    play = play or servo.value("actuation_deadband")
    return Actuator(
        stiffness * scale, (stiffness * offset, -stiffness, -damping), lag, max(late, 0.0),
        strongest, **rubs | {"friction": rubs["friction"] + stiffness * play},
    )  # fmt: skip


def commanded(drives: Driven) -> tuple[Robot, dict[int, int]]:
    """The robot with all joints that were not commanded locked, and its joints' numbers there."""
    model = weighed(drives.robot, drives.index, drives.carried)
    index = [model.idx_vs[j] for j in range(1, model.njoints)]
    locked = [j for j, place in enumerate(index, start=1) if place not in drives.index]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    names = [str(name) for name in model.names][1:]
    numbers = {k: names.index(name) + 1 for k, name in enumerate(drives.joints, start=1)}
    return replace(drives.robot, model=model), numbers


def _root(drives: Driven, robot: Robot, numbers: Mapping[int, int]) -> ElementTree.Element:
    whole = robot.dynamics()
    made = {
        k: actuator_of(drives.law, servo, float(drives.kp[k - 1]), float(drives.kd[k - 1]))
        for k, servo in drives.servos.items()
    }
    own = {
        numbers[k]: {
            "armature": a.rotor + (0.0 if drives.law.pushes else LEAST_INERTIA),
            "frictionloss": a.friction,
            "damping": a.damping,
        }
        for k, a in made.items()
    }
    inertias = [whole.model.inertias[j] for j in range(1, whole.model.njoints)]
    placed = [joint.T_parent_joint for joint in whole.joints]
    root, bodies = world(robot, whole.joints, whole.parents, placed, inertias, own)
    for k, servo in drives.servos.items():
        if servo.value("coulomb_friction", soft=True):  # MuJoCo's own, where a file says no other
            for joint in bodies[numbers[k]].findall("joint"):
                for key in FRICTION:
                    joint.attrib.pop(key, None)
    option = root.find("option")
    if option is not None:
        option.attrib |= {"timestep": repr(MJCF_STEP), "integrator": "implicitfast"}
    actuators = ElementTree.SubElement(root, "actuator")
    for k, actuator in made.items():
        ElementTree.SubElement(actuators, "general", _attributes(drives.joints[k - 1], actuator))
    return root


def _attributes(joint: str, a: Actuator) -> dict[str, str]:
    own = {"name": joint, "joint": joint, "gainprm": words(np.array([a.gain]))}
    own |= {"biastype": "affine", "biasprm": words(np.array(a.bias))}
    if a.filter:
        own |= {"dyntype": "filterexact", "dynprm": repr(float(a.filter))}
    if a.delay:
        kept = str(int(a.delay / MJCF_STEP) + 2)
        own |= {"delay": repr(float(a.delay)), "nsample": kept, "interp": "linear"}
    if a.force:
        own["forcerange"] = words(np.array([-a.force, a.force]))
    return own


def _lacked(law: Law, servo: Servo) -> tuple[MotionEffect, ...]:
    names = set(NO_WORD)
    if not law.follows:
        names |= {"actuation_deadband", "actuation_play", "servo_stiffness"}
    elif any(effect.name == "actuation_play" for effect in servo.effects):
        names |= {"actuation_deadband"}
    return tuple(effect for effect in servo.effects if effect.name in names)


def _sizes(
    drives: Driven, lacked: Mapping[int, tuple[MotionEffect, ...]]
) -> tuple[tuple[Lack, ...], float, float]:
    """What stays out, and the RMS of all effects and of those [rad], by sines over the spans.

    Torques alone take an arm anywhere, so that of these no size is told.
    """
    if drives.law.pushes:
        named = [
            (f"{e.name} {k}", e.words.format(element=k)) for k, es in lacked.items() for e in es
        ]
        return tuple(Lack(name, said, np.nan, "rad") for name, said in named), np.nan, np.nan
    time = np.arange(0.0, SPAN, SAMPLE)
    n = len(drives.joints)
    low, high = np.array([drives.servos[k].span if k in drives.servos else np.zeros(2)
                          for k in range(1, n + 1)]).T  # fmt: skip
    phase = 2 * np.pi * np.outer(time, 0.1 + 0.07 * np.arange(n))  # [Hz], one a joint
    command = (low + high) / 2 + (high - low) / 2 * np.sin(phase)
    every = drives.rollout(time, command)
    ideal = drives.without({k: s.effects for k, s in drives.servos.items()})
    lacks = []
    for number, effects in lacked.items():
        for effect in effects:
            less = drives.without({number: (effect,)}).rollout(time, command)
            said = effect.words.format(element=number)
            lacks.append(Lack(f"{effect.name} {number}", said, _rms(less - every), "rad"))
    whole = _rms(ideal.rollout(time, command) - every)
    stays = _rms(drives.without(lacked).rollout(time, command) - every)
    return tuple(sorted(lacks, key=lambda lack: -lack.size)), whole, stays


def _rms(apart: Array) -> float:
    return float(np.sqrt(np.mean(apart**2)))


def _read_again(robot: Robot, text: str) -> float:
    """Largest difference of a joint's place from Pinocchio's [m or a rotation's entry]."""
    if not has_mujoco():
        return float("nan")
    mujoco = import_module("mujoco")
    read = mujoco.MjModel.from_xml_string(text)
    data, own = mujoco.MjData(read), robot.model.createData()
    rng = np.random.default_rng(0)
    worst = 0.0
    for q in rng.uniform(-1.0, 1.0, (5, read.nq)):
        data.qpos[:] = q
        mujoco.mj_kinematics(read, data)
        pin.forwardKinematics(robot.model, own, pin.integrate(
            robot.model, pin.neutral(robot.model), q))  # fmt: skip
        for j in range(1, robot.model.njoints):
            there = np.hstack([data.xmat[j].reshape(3, 3), data.xpos[j][:, None]])
            worst = max(worst, float(np.abs(there - own.oMi[j].homogeneous[:3]).max()))
    return worst
