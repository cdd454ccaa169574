r"""The part of a model that is a matter of geometry alone: placements and zeros that never change.

.. math:: T'_{i-1,i} = T_{i-1,i}\, J_i(\delta_i)

A kind of effect counts if what it does to joints, placements and tool is the same whatever the row
says; which kinds do is found by asking one of each, so that a user's own effects are seen, too.
"""

from dataclasses import replace
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect, Stage, State
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform, by_columns, constant, homogeneous
from plumbline.kinematics.link_table import LinkTable, drawn_rows
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.observation import closed_chain
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import ASKED, SAME_CONSTANT
from plumbline.optim.model.statement import acts_on_places


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
    state, _ = _state(arm)
    T = cs.horzcat(*[cs.vertcat(cs.vec(p.R), p.t) for p in state.placements])
    shift = state.q - arm.statement.symbols["q"]
    out = cs.vertcat(cs.vec(T), shift, state.tool, cs.vec(state.R_tip_tool))
    found = _at_random(arm, out)
    n = arm.chain.n
    return [_parted(row, n) for row in found]


def _parted(row: Array, n: int) -> tuple[Array, Array, Array, Array]:
    T, rest = by_columns(row[: 12 * (n + 1)].reshape(n + 1, 12)), row[12 * (n + 1) :]
    return T, rest[:n], rest[n : n + 3], rest[n + 3 :].reshape(3, 3).T


def _at_random(arm: Arm, out: cs.SX) -> Array:
    symbols = arm.statement.symbols
    row = cs.vertcat(*symbols.values())
    drawn = np.hstack([_drawn(arm, name, symbol.numel()) for name, symbol in symbols.items()])
    made = cs.Function("asked", [row], [cs.densify(out)])
    return over_rows(made, drawn)[0][:, 0]


def _drawn(arm: Arm, name: str, width: int) -> Array:
    """A column over its fitted range: what happened at one moment shows before and after it."""
    rng = np.random.default_rng(len(name))
    low, high = arm.ranges.get(name, np.array([[-1.0] * width, [1.0] * width]))
    return rng.uniform(low, high, (ASKED, width))


def _state(arm: Arm) -> tuple[State, Transform]:
    values, effects = arm.values.tolist(), []
    for effect in arm.effects:
        size = len(effect.parameters)
        if acts_on_places(effect):
            effects.append((effect, [cs.SX(v) for v in values[:size]]))
        values = values[size:]
    state = State.ideal(arm.chain, arm.statement.symbols, constant(arm.tool))
    state = replace(state, R_tip_tool=constant(arm.R_tip_tool))
    return closed_chain(state, effects, Transform.identity())
