r"""What the efforts of a row should have read: bodies, gravity, then drives, then what reads them.

.. math:: r_i = \frac{\epsilon}{\sigma_i} \left( \tau_i(q, \dot q, \ddot q; \theta)
          - \tau_i^{read} \right)

Effects act in this order: on bodies, payload and gravity; then the torque that moves them is closed
(Newton and Euler); then drives: friction, springs, rotors, the scale and zero of the reading. Every
joint is weighed by its own noise :math:`\sigma_i`; the common :math:`\epsilon` brings residuals to
the size that the diagnosis expects of any recording.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import Effect, Stage, State
from plumbline.kinematics.frames import constant
from plumbline.kinematics.tree import Tree, dynamics_of_chain, laden
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import UNIT
from plumbline.optim.recording.recording import Recording

BODIES = (Stage.LINK, Stage.TOOL, Stage.BASE)
DRIVES = (Stage.ACTUATION,)

Applied = Sequence[tuple[Effect, list[cs.SX]]]


def effort_weights(recording: Recording) -> Array:
    """Residual for one newton metre, joint by joint (n,) [1/(N m)]."""
    noise = recording.noise_by_joint
    if noise is None:
        raise PlumblineError("efforts without a noise: recordings are made by build_recording")
    return np.asarray(UNIT / noise)


def own_units(recording: Recording) -> Array:
    """What brings a row's residuals into the unit that was measured: (n,) of efforts, else (1,)."""
    if not recording.kind.efforts:
        return np.ones(1)
    return 1.0 / effort_weights(recording)


def newton_metres(recording: Recording) -> float:
    """Newton metres for one unit of residual, for the root mean square of all joints [N m]."""
    noise = recording.noise_by_joint
    return 1.0 if noise is None else float(np.sqrt(np.mean(noise**2)) / UNIT)


def stated_noise(recording: Recording) -> float | None:
    """Noise of one component of the residual, as stated [m, rad, or weighed]; None if it is not."""
    if not recording.kind.efforts or recording.noise_std is None:
        return recording.noise_std
    return UNIT


def torque_residual(
    recording: Recording,
    state: State,
    effects: Applied,
    apply: Callable[[State, Applied, Sequence[Stage]], State],
) -> cs.SX:
    """Weighed residual (n,) of one row; ``apply`` applies the effects of some stages in order."""
    torque = moved(state, effects, apply).torque
    return constant(effort_weights(recording)) * (torque - state.row["measured"])


def moved(
    state: State, effects: Applied, apply: Callable[[State, Applied, Sequence[Stage]], State]
) -> State:
    """The state with what moves the bodies, and what the drives read, joint by joint.

    The chain is a :class:`Tree`, at a row's joints, velocities and accelerations; ``apply`` applies
    the effects of some stages in their order.
    """
    chain, row = state.chain, state.row
    assert isinstance(chain, Tree)
    dynamics = dynamics_of_chain(chain)
    inertial = laden(chain, row.get("payload", 0.0), state.tool)
    state = replace(state, inertial=inertial, gravity=constant(chain.gravity))
    state = apply(state, effects, BODIES)
    carried = dynamics.inverse(
        row["q"], row["velocity"], row["acceleration"], state.inertial, state.gravity
    )
    state = replace(state, carried=carried, torque=carried)
    return apply(state, effects, DRIVES)
