"""mujoco.sysid on motions and on efforts.

Of a motion each joint is a body of its own on a hinge without gravity, its actuator a filter
(``filterexact``) before a servo that is stiff enough to be ideal. Delay and offset act on the
predicted signal, as sysid has them; every window is a sequence that begins at its measured place.
Of efforts MuJoCo's inverse dynamics stand in place of its roll-out.
"""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

Array = NDArray[np.float64]
PACKAGE = "mujoco"
SUB = 4  # steps of the simulation within a sample
TERMS = ("dry", "viscous", "rotor", "scale", "zero")
BOUNDS = {
    "dry": (0, 50),
    "viscous": (0, 200),
    "rotor": (0, 50),
    "scale": (-0.9, 3),
    "zero": (-20, 20),
}  # [N m], [N m s/rad], [kg m^2], [1], [N m]; fmt: skip


def _spec(dt: float, lag: float) -> Any:
    """One joint: inertia 1, a servo of 200 rad/s, critically damped."""
    step = dt / SUB
    return mujoco.MjSpec.from_string(f"""
<mujoco><option timestep="{step}" gravity="0 0 0" integrator="implicit"/>
 <worldbody><body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <joint name="j" type="hinge" axis="0 0 1"/></body></worldbody>
 <actuator><general name="a" joint="j" dyntype="filterexact" dynprm="{lag}"
  gainprm="40000" biastype="affine" biasprm="0 -40000 -400"/></actuator>
 <sensor><jointpos name="p" joint="j"/></sensor></mujoco>""")


def _sequences(given: Mapping[str, Array], joint: int, starts: Array) -> Any:
    dt, length = float(given["dt"]), int(given["length"])
    spec = _spec(dt, 0.03)
    model = spec.compile()
    u, q = given["u"][:, joint], given["q"][:, joint]
    state, control, sensed = [], [], []
    for s in starts:
        at = s + np.arange(length + 1)
        begin = np.array([q[s]])
        state.append(sysid.create_initial_state(model, begin, np.zeros(1), begin))
        state[-1][0] = s * dt  # its clock is the recording's
        control.append(sysid.TimeSeries(at * dt, u[at][:, None]))
        sensed.append(sysid.TimeSeries.from_names(at * dt, q[at][:, None], model))
    names = [f"w{k}" for k in range(len(starts))]
    return sysid.ModelSequences("joint", spec, names, state, control, sensed)


def _residual(given: Mapping[str, Array], joint: int, starts: Array) -> Any:
    dt, settle = float(given["dt"]), int(given["settle"])
    u = given["u"][:, joint]
    clock = np.arange(len(u)) * dt

    def rolled(param_dicts: Any, control_signal: Any, **passed: Any) -> Any:
        """Commands are delayed and shifted before they are rolled out."""
        control = []
        for own, one in zip(param_dicts, control_signal, strict=True):
            asked = np.interp(one.times - own["delay"].value[0], clock, u)
            asked = asked + own["offset"].value[0]
            control.append(sysid.TimeSeries(one.times, asked[:, None], one.signal_mapping))
        return sysid.sysid_rollout(control_signal=control, **passed)

    def compared(params: Any, predicted: Any, measured: Any, *_: Any, **__: Any) -> Any:
        """The samples that count, unweighted."""
        t = measured.times[1 + settle :]
        there, seen = predicted.resample(t), measured.resample(t)
        return there.data - seen.data, there, seen

    return sysid.build_residual_fn(
        models_sequences=[_sequences(given, joint, starts)], custom_rollout=rolled,
        modify_residual=compared, n_threads=1,
    )  # fmt: skip


def _params(start: Array) -> Any:
    params = sysid.ParameterDict()
    params.add(sysid.Parameter("offset", start[0], -0.5, 0.5))
    params.add(sysid.Parameter("delay", start[1], -0.02, 0.25))

    def lagged(spec: Any, p: Any) -> None:
        spec.actuator("a").dynprm[0] = p.value[0]

    params.add(sysid.Parameter("lag", start[2], 1e-4, 0.5, modifier=lagged))
    return params


def motion(given: Mapping[str, Array]) -> Any:
    """Offset, delay and lag (n, 3)."""
    found = []
    for j in range(given["q"].shape[1]):
        residual = _residual(given, j, given["fit"])
        params, _ = sysid.optimize(_params(given["start"]), residual, verbose=False)
        found.append(params.as_vector())
    return found


def motion_misses(given: Mapping[str, Array], found: Any) -> Array:
    """What windows not fitted are missed by [rad], joint after joint."""
    made = [_residual(given, j, given["judge"])(x, _params(x))[0] for j, x in enumerate(found)]
    return np.concatenate([part.ravel() for joint in made for part in joint])


def _torques(
    model: Any, values: Mapping[str, Array], given: Mapping[str, Array], end: str
) -> Array:
    """Efforts (N, n) [N m]: bodies, armature and damping are MuJoCo's."""
    model.dof_armature[:], model.dof_damping[:] = values["rotor"], values["viscous"]
    data = mujoco.MjData(model)
    out = np.empty_like(given[f"q{end}"])
    for k, (q, v, a) in enumerate(
        zip(given[f"q{end}"], given[f"v{end}"], given[f"a{end}"], strict=True)
    ):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    out += values["dry"] * np.sign(given[f"v{end}"])  # its own is softened near standstill
    return np.asarray((1 + values["scale"]) * out + values["zero"])


def _model(given: Mapping[str, Array]) -> Any:
    model = mujoco.MjModel.from_xml_string(str(given["urdf"]))
    model.opt.gravity[:] = given["gravity"]
    return model


def torque(given: Mapping[str, Array]) -> Any:
    """All parameters, by sysid's own optimizer."""
    n, model = given["q"].shape[1], _model(given)
    params = sysid.ParameterDict()
    for name in TERMS:
        low, high = BOUNDS[name]
        start = np.full(n, max(low, 0.0) + 1e-3)
        params.add(sysid.Parameter(name, start, np.full(n, low), np.full(n, high)))

    def residual(x: Array, own: Any, **_: Any) -> Any:
        columns = []
        for column in np.atleast_2d(x.T):
            own.update_from_vector(column)
            values = {name: own[name].value for name in TERMS}
            columns.append((_torques(model, values, given, "") - given["tau"]).ravel())
        made = np.array(columns).T
        return [made if x.ndim > 1 else made[:, 0]], None, None

    found, _ = sysid.optimize(params, residual, verbose=False)
    return {name: found[name].value.copy() for name in TERMS}


def torque_misses(given: Mapping[str, Array], found: Any) -> Array:
    """Efforts missed on rows not fitted (N, n) [N m]."""
    return _torques(_model(given), found, given, "_new") - given["tau_new"]
