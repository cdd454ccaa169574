"""An exported MJCF alone, moved by commands in MuJoCo: the proof that it does what it says."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault
from plumbline.optim.core.problem import Array
from plumbline.optim.model.constants import REST


def replay(mjcf: str, time: ArrayLike, command: ArrayLike, start: ArrayLike = ()) -> Array:
    """What the joints of an MJCF with actuators do (N, nu) [rad or m] in MuJoCo.

    Args:
        mjcf: The file's text.
        time: Time (N,) [s], ascending.
        command: Commands (N, nu), straight between the samples.
        start: Where the joints are at first (nu,) [rad or m]; by default where the first command,
            held for a while, puts them.

    Raises:
        PlumblineError: MuJoCo is not installed, cannot read it, or has other actuators.
    """
    if find_spec("mujoco") is None:
        raise fault(
            "replay", "no MuJoCo", "it installed", "pip install 'plumbline-robotics[mujoco]'"
        )
    mujoco: Any = import_module("mujoco")
    rollout: Any = import_module("mujoco.rollout")
    try:
        model = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as error:
        raise PlumblineError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    t, u = np.asarray(time, dtype=float), np.asarray(command, dtype=float)
    if u.shape != (len(t), model.nu):
        raise fault("command", f"an array {u.shape}", f"({len(t)}, {model.nu})", "one an actuator")
    even = np.arange(t[0] - REST, t[-1], model.opt.timestep)
    asked = np.column_stack([np.interp(even, t, one) for one in u.T])
    data = mujoco.MjData(model)
    joints = model.actuator_trnid[:, 0]
    places = model.jnt_qposadr[joints]
    data.qpos[places] = np.asarray(start, dtype=float) if np.size(start) else u[0]
    if model.na:
        filtered = model.actuator_actnum > 0
        data.act[model.actuator_actadr[filtered]] = u[0][filtered]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, state, full)
    states, _ = rollout.rollout(model, data, state, asked)
    after = even + model.opt.timestep
    q = states[0][:, 1 + places]  # the clock stands first
    return np.column_stack([np.interp(t, after, one) for one in q.T])
