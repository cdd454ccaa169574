r"""The part of a model that is a matter of geometry alone: placements and zeros that never change.

.. math:: T'_{i-1,i} = T_{i-1,i}\, J_i(\delta_i)

A kind of effect counts if what it does to joints, placements and tool is the same whatever the row
says; which kinds do is found by asking one of each, so that a user's own effects are seen, too.

What a file can hold of an arm's efforts: bodies, gravity, and torques of single joints.

.. math:: \tau_i = \tau_i^{bodies} + I \ddot q_i + d \dot q_i + c \operatorname{sign} \dot q_i
          + k (q_i - q_{mid}) + p

An effect on bodies counts if what it does to them is the same whatever the row says.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect, Stage, State
from plumbline.kinematics.effects.cable_spring import CableSpring
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform, by_columns, constant, homogeneous
from plumbline.kinematics.link_table import LinkTable, drawn_rows
from plumbline.kinematics.oracle import pin
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.observation import closed_chain
from plumbline.optim.measurement.torque import BODIES
from plumbline.optim.model.arm import Arm, efforts_of
from plumbline.optim.model.constants import ASKED, SAME_CONSTANT
from plumbline.optim.model.fitted import by_effect
from plumbline.optim.model.statement import acts_on_places
from plumbline.optim.recording.kinds import EFFORTS


@lru_cache(maxsize=8)
def fixed_part(arm: Arm) -> Arm:
    """The arm with those of its effects that a description of links alone can hold."""
    fixed = arm.kinds_that(_is_fixed)
    return arm.of([k for k, e in enumerate(arm.effects) if type(e) in fixed])


def placements(arm: Arm) -> tuple[Array, ...]:
    """Placement (4, 4) of every joint in its parent, zeros included, last of the tip (n + 1)."""
    fixed = fixed_part(arm)
    moved, shift, _, _ = _asked(fixed)[0]
    found = []
    for joint, T, delta in zip(fixed.chain.joints, moved, shift, strict=False):
        motion = joint.motion(cs.SX(float(delta)))
        found.append(T @ homogeneous(cs.DM(motion.R).full(), cs.DM(motion.t).full()))
    return (*found, moved[-1])


def tool_of(arm: Arm) -> Array:
    """``T_tip_tool`` (4, 4) [m], with what fixed effects add to it."""
    _, _, tool, turned = _asked(fixed_part(arm))[0]
    return homogeneous(turned, tool)


def corrected_chain(arm: Arm) -> Chain:
    """The chain with the placements; its Pinocchio model is the nominal one's."""
    *moved, T_last_tip = placements(arm)
    joints = tuple(
        replace(joint, T_parent_joint=T) for joint, T in zip(arm.chain.joints, moved, strict=True)
    )
    return replace(arm.chain, joints=joints, T_last_tip=T_last_tip)


def corrected_table(arm: Arm) -> LinkTable:
    """The corrected chain as rows of link parameters."""
    return drawn_rows(corrected_chain(arm))


def fixed_pose(arm: Arm, q: Array) -> Array:
    """``T_base_tool`` (N, 4, 4) [m] of the corrected links at postures (N, n)."""
    return np.asarray(fixed_part(arm).placement(q))


def _is_fixed(arm: Arm, effect: Effect) -> bool:
    if not acts_on_places(effect) or effect.port not in (Stage.JOINT, Stage.LINK, Stage.TOOL):
        return False
    first, *others = _asked(arm)
    for other in others:
        for one, two in zip(first, other, strict=True):
            if not np.allclose(one, two, rtol=0.0, atol=SAME_CONSTANT):
                return False
    return True


def _asked(arm: Arm) -> list[tuple[Array, Array, Array, Array]]:
    """Placements, joint shifts, tool and its turn at rows drawn at random."""
    symbols, n = arm.statement.symbols, arm.chain.n
    parts = by_effect(arm.effects, [cs.SX(value) for value in arm.values])
    effects = [(effect, own) for effect, own in parts if acts_on_places(effect)]
    state = State.ideal(arm.chain, symbols, constant(arm.tool))
    state = replace(state, R_tip_tool=constant(arm.R_tip_tool))
    state, _ = closed_chain(state, effects, Transform.identity())
    T = cs.horzcat(*[cs.vertcat(cs.vec(p.R), p.t) for p in state.placements])
    turned = cs.vec(state.R_tip_tool)
    out = cs.densify(cs.vertcat(cs.vec(T), state.q - symbols["q"], state.tool, turned))
    made = cs.Function("asked", [cs.vertcat(*symbols.values())], [out])
    drawn = np.hstack([_drawn(arm, name, symbol.numel()) for name, symbol in symbols.items()])
    found = []
    for row in over_rows(made, drawn)[0][:, 0]:
        placed, rest = by_columns(row[: 12 * (n + 1)].reshape(n + 1, 12)), row[12 * (n + 1) :]
        found.append((placed, rest[:n], rest[n : n + 3], rest[n + 3 :].reshape(3, 3).T))
    return found


def _drawn(arm: Arm, name: str, width: int) -> Array:
    """A column over its fitted range: what happened at one moment shows before and after it."""
    rng = np.random.default_rng(len(name))
    low, high = arm.ranges.get(name, np.array([[-1.0] * width, [1.0] * width]))
    return rng.uniform(low, high, (ASKED, width))


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
    for effect, values in by_effect(arm.effects, arm.values):
        attribute = attribute_of(effect, names)
        value = max(float(values[0]), 0.0) if effect.parameters else 0.0
        if attribute and effect.element is not None:
            own = found.setdefault(effect.element, {})
            own[attribute] = own.get(attribute, 0.0) + value
            if isinstance(effect, CableSpring) and value:
                own["springref"] = effect.middle - float(values[1]) / value
    return found


def held_by(arm: Arm, names: Mapping[str, str], *, gravity: bool) -> Arm:
    """The arm with those effects on efforts that a format's attributes, and ``gravity``, hold."""
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
    for k, (row, one) in enumerate(zip(weights, own, strict=True)):
        if not np.array_equal(row, one.toDynamicParameters()):  # a body may have no mass
            own[k] = pin.Inertia.FromDynamicParameters(row)
    return own, gravity
