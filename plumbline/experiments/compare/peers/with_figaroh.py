"""figaroh as its examples have it: base parameters of all links, friction, rotors and zeros."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import RegressorBuilder, RegressorConfig
from numpy.typing import NDArray

Array = NDArray[np.float64]
PACKAGE = "figaroh"
CONFIG = RegressorConfig(has_friction=True, has_actuator_inertia=True, has_joint_offset=True)
LEAST = 1e-6  # figaroh's own: columns with a smaller square carry nothing


def _regressor(given: Mapping[str, Array], end: str) -> Array:
    model = pin.buildModelFromXML(str(given["urdf"]))
    model.gravity.linear = given["gravity"]
    robot = SimpleNamespace(model=model, data=model.createData())
    rows = (given[f"q{end}"], given[f"v{end}"], given[f"a{end}"])
    driven = {"act_idxv": list(range(model.nv))}
    return np.asarray(RegressorBuilder(robot, CONFIG).build_basic_regressor(*rows, driven))


def torque(given: Mapping[str, Array]) -> Any:
    """Columns that are left, and the base parameters."""
    W = _regressor(given, "")
    kept = np.flatnonzero((W**2).sum(axis=0) > LEAST)
    names = [f"p{k}" for k in kept]
    tau = given["tau"].T.ravel()  # joint after joint, as its rows are
    decomposer = QRDecomposer()
    decomposer.double_decomposition(tau, W[:, kept], names, None)
    base = kept[np.asarray(decomposer.get_base_indices())]
    return base, np.linalg.lstsq(W[:, base], tau, rcond=None)[0]


def torque_misses(given: Mapping[str, Array], found: Any) -> Array:
    """Efforts missed on rows not fitted [N m]."""
    base, phi = found
    return np.asarray(_regressor(given, "_new")[:, base] @ phi - given["tau_new"].T.ravel())
