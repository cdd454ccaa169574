r"""Numbers that a fit found, and those of frame, tool and sockets among them.

The fit knows small changes: a shift s and a turn w about the middle c of the data. What a reader
wants is the origin t and the rotation vector :math:`\varphi` of the frame:

.. math:: \delta t = s + w \times (t - c), \qquad \delta\varphi = J_l(\varphi)^{-1} w

with the left Jacobian of the rotation vector (Sola, Deray, Atchuthan 2018, eq. 145).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import measured

MEANING = {
    "frame": "origin of the robot's base in the device's frame",
    "frame r": "rotation vector from the robot's base to the device's frame",
    "tool": "tip in the tip frame",
    "tool r": "rotation vector of the tool in the tip frame",
    "socket": "place of the socket in the robot's base frame",
}


@dataclass(frozen=True)
class Known:
    """A found number."""

    value: float  # its value [unit]
    std: float  # its standard error [unit]
    unit: str  # its unit
    doc: str = ""  # what it is, in a few words

    def __str__(self) -> str:
        """``0.2403 ± 0.0061 mm``."""
        return measured(self.value, self.std, self.unit)


def meaning_of(name: str) -> tuple[str, str]:
    """Unit and meaning of a nuisance by its name, such as ``frame rx`` or ``socket 3 x``."""
    kind, last = name.split()[0], name.split()[-1]
    turning = last.startswith("r")
    return ("rad" if turning else "m"), MEANING[f"{kind} r" if turning else kind]


def told(
    names: tuple[str, ...],
    covariance: Array,
    T_device_base: Array,
    centre: Array,
    tool: Array,
    R_tip_tool: Array,
    sockets: Mapping[int, Array],
) -> dict[str, Known]:
    """Every nuisance by its name, such as ``frame rx``, ``tool z`` or ``socket 3 x``.

    Of what :class:`~plumbline.optim.model.fitted.Fitted` holds; the covariance (k, k) is that of
    small changes of these unknowns (k), turns of the frame about the centre.
    """
    size = len(names)
    A = np.eye(size)
    at = {name: k for k, name in enumerate(names)}
    values = dict.fromkeys(names, 0.0)
    if "frame x" in at:
        R, t = (
            scipy.spatial.transform.Rotation.from_matrix(T_device_base[:3, :3]),
            T_device_base[:3, 3],
        )
        turn = [at[f"frame r{c}"] for c in "xyz"]
        A[np.ix_([at[f"frame {c}"] for c in "xyz"], turn)] = -_cross(t - centre)
        A[np.ix_(turn, turn)] = np.linalg.inv(left_jacobian(R.as_rotvec()))
        values |= _named("frame ", t) | _named("frame r", R.as_rotvec())
    if "tool x" in at:
        values |= _named("tool ", tool)
    if "tool rx" in at:
        turned = scipy.spatial.transform.Rotation.from_matrix(R_tip_tool).as_rotvec()
        turn = [at[f"tool r{c}"] for c in "xyz"]
        A[np.ix_(turn, turn)] = np.linalg.inv(left_jacobian(turned))
        values |= _named("tool r", turned)
    for label, place in sockets.items():
        values |= _named(f"socket {label} ", place)
    variance = np.diag(A @ covariance @ A.T)
    std = np.sqrt(np.maximum(variance, 0.0))
    return {
        name: Known(float(values[name]), float(s), *meaning_of(name))
        for name, s in zip(names, std, strict=True)
    }


def left_jacobian(phi: Array) -> Array:
    """The left Jacobian (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(phi))
    hat = _cross(phi)
    if angle < 1e-6:
        return np.eye(3) + hat / 2
    a = (1 - np.cos(angle)) / angle**2
    b = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * hat + b * hat @ hat)


def _cross(v: Array) -> Array:
    return np.cross(v, np.eye(3)).T


def _named(begin: str, values: Array) -> dict[str, float]:
    return {f"{begin}{c}": float(v) for c, v in zip("xyz", values, strict=True)}
