"""mujoco.sysid on efforts: MuJoCo's inverse dynamics in place of its roll-out, the same terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

Array = NDArray[np.float64]
TERMS = ("dry", "viscous", "rotor", "scale", "zero")
BOUNDS = {
    "dry": (0, 50),
    "viscous": (0, 200),
    "rotor": (0, 50),
    "scale": (-0.9, 2),
    "zero": (-20, 20),
}  # [N m], [N m s/rad], [kg m^2], [1], [N m]; fmt: skip


def version() -> str:
    """Of MuJoCo."""
    return str(mujoco.__version__)


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


def fit(given: Mapping[str, Array]) -> Any:
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


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """RMS of the efforts on rows not fitted [N m]."""
    misses = _torques(_model(given), found, given, "_new") - given["tau_new"]
    return {"error": float(np.sqrt(np.mean(misses**2)))}
