r"""What a file can hold of an arm's efforts: bodies, gravity, and torques of single joints.

.. math:: \tau_i = \tau_i^{bodies} + I \ddot q_i + d \dot q_i + c \operatorname{sign} \dot q_i
          + k (q_i - q_{mid}) + p

An effect on bodies counts if what it does to them is the same whatever the row says.
"""

from collections.abc import Mapping
from dataclasses import replace

import casadi as cs
import numpy as np
import pinocchio as pin

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.cable_spring import CableSpring
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.torque import BODIES
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.efforts import efforts_of
from plumbline.optim.recording.kinds import EFFORTS

# An effect of the drives, and the attribute of a joint that is its first parameter.
MUJOCO = {
    "rotor_inertia": "armature",
    "coulomb_friction": "frictionloss",
    "viscous_friction": "damping",
    "cable_spring": "stiffness",
}
URDF = {"coulomb_friction": "friction", "viscous_friction": "damping"}


def attribute_of(effect: Effect, names: Mapping[str, str]) -> str:
    """The attribute of a joint that holds an effect; empty where none does.

    Damping is in proportion to the speed: friction of another power is none.
    """
    if getattr(effect, "power", 1.0) != 1.0:
        return ""
    return names.get(effect.name, "")


def drives_of(arm: Arm, names: Mapping[str, str]) -> dict[int, dict[str, float]]:
    """Attributes by joint (from 1), as a format names them."""
    found: dict[int, dict[str, float]] = {}
    first = 0
    for effect in arm.effects:
        attribute = attribute_of(effect, names)
        value = max(float(arm.values[first]), 0.0) if effect.parameters else 0.0
        if attribute and effect.element is not None:
            own = found.setdefault(effect.element, {})
            own[attribute] = own.get(attribute, 0.0) + value
            if isinstance(effect, CableSpring) and value:
                own["springref"] = effect.middle - float(arm.values[first + 1]) / value
        first += len(effect.parameters)
    return found


def held_by(arm: Arm, names: Mapping[str, str], *, gravity: bool) -> Arm:
    """The arm with those of its effects on efforts that a format holds.

    Args:
        arm: The arm.
        names: The attributes that the format has.
        gravity: Whether it says where gravity points.
    """
    kept = [k for k, e in enumerate(arm.effects)
            if attribute_of(e, names) or _on_bodies(arm, k, gravity=gravity)]  # fmt: skip
    return arm.of(kept)


def sliding(arm: Arm) -> Arm:
    """The arm with its dry friction as it slides: a file has one number for it."""
    slides = [e.sliding if isinstance(e, CoulombFriction) else e for e in arm.effects]
    return replace(arm, effects=tuple(slides))


def _on_bodies(arm: Arm, k: int, *, gravity: bool) -> bool:
    if arm.observation != EFFORTS or arm.effects[k].port not in BODIES:
        return False
    state = efforts_of(arm.of([k])).bodies()
    constant = not cs.symvar(cs.vertcat(cs.vec(state.inertial), state.gravity))
    turned = constant and np.abs(cs.evalf(state.gravity).full()[:, 0] - arm.chain.gravity).max() > 0
    return constant and (gravity or not turned)


def bodies_of(held: Arm) -> tuple[list[pin.Inertia], Array]:
    """What every body weighs (n), and gravity (3,) in the base frame [m/s^2]."""
    own = [held.chain.model.inertias[k + 1] for k in range(held.chain.n)]
    if held.observation != EFFORTS:
        return own, held.chain.gravity
    fixed = held.of([k for k, e in enumerate(held.effects) if e.port in BODIES])
    state = efforts_of(fixed).bodies()
    weights = cs.evalf(cs.densify(state.inertial)).full()
    gravity = cs.evalf(cs.densify(state.gravity)).full()[:, 0]
    return [_body(row, one) for row, one in zip(weights, own, strict=True)], gravity


def _body(row: Array, own: pin.Inertia) -> pin.Inertia:
    """From ten parameters; the robot's own where they are the same: a body may have no mass."""
    same = np.array_equal(row, own.toDynamicParameters())
    return own if same else pin.Inertia.FromDynamicParameters(row)
