"""As one would type it: NumPy, and SciPy with finite differences; all markers count alike."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
PACKAGE = "scipy"
LEVER = 0.1  # [m] that a radian weighs as much as
MOST = 3.0  # share of an effort that is read beyond it, for all ways alike


def registration(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms."""
    found = np.tile(np.eye(4), (len(given["ct"]), 1, 1))
    for k, (ct, robot) in enumerate(zip(given["ct"], given["robot"], strict=True)):
        a, b = ct.mean(axis=0), robot.mean(axis=0)
        R = Rotation.align_vectors(robot - b, ct - a)[0].as_matrix()
        found[k, :3, :3], found[k, :3, 3] = R, b - R @ a
    return found


def hand_eye(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups."""
    return np.array(
        [_frame_and_tool(f, s) for f, s in zip(given["flange"], given["seen"], strict=True)]
    )


def _frame_and_tool(flange: Array, seen: Array) -> Array:
    def residuals(x: Array) -> Array:
        frame, tool = _placed(x[:6]), _placed(x[6:])
        apart = np.linalg.inv(seen) @ (frame @ flange @ tool)
        turn = Rotation.from_matrix(apart[:, :3, :3]).as_rotvec()
        return np.concatenate([apart[:, :3, 3].ravel(), LEVER * turn.ravel()])

    T = seen[0] @ np.linalg.inv(flange[0])
    start = np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec(), np.zeros(6)])
    return _placed(least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x[6:])


def _placed(x: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(x[3:]).as_matrix(), x[:3]
    return T


def tips(x: Array, q: Array) -> Array:
    """Tips (N, 3) [m] of rows (n, 4), tool (3,), frame's place and turn (6,)."""
    n = q.shape[1]
    d, a, alpha, theta = x[: 4 * n].reshape(n, 4).T
    p = np.broadcast_to(x[4 * n : 4 * n + 3], (len(q), 3))
    for j in reversed(range(n)):
        c, s = np.cos(q[:, j] + theta[j]), np.sin(q[:, j] + theta[j])
        ca, sa = np.cos(alpha[j]), np.sin(alpha[j])
        y, z = ca * p[:, 1] - sa * p[:, 2], sa * p[:, 1] + ca * p[:, 2] + d[j]
        r = p[:, 0] + a[j]
        p = np.column_stack([c * r - s * y, s * r + c * y, z])
    place, turn = x[-6:-3], Rotation.from_rotvec(x[-3:]).as_matrix()
    return np.asarray(p @ turn.T + place)


def dh(given: Mapping[str, Array]) -> Array:
    """All parameters."""
    frame = given["frame"]
    turn = Rotation.from_matrix(frame[:3, :3]).as_rotvec()
    start = np.concatenate([given["dh"].ravel(), given["tool"], frame[:3, 3], turn])

    def residuals(x: Array) -> Array:
        return (tips(x, given["q"]) - given["tips"]).ravel()

    return np.asarray(least_squares(residuals, start, x_scale="jac", max_nfev=100).x)


def dh_misses(given: Mapping[str, Array], found: Array) -> Array:
    """Distances of tips on rows not fitted (N,) [m]."""
    return np.linalg.norm(tips(found, given["q_new"]) - given["tips_new"], axis=1)


def efforts(x: Array, given: Mapping[str, Array], end: str) -> Array:
    """Efforts (N, n) [N m]."""
    dry, viscous, rotor, scale, zero = x.reshape(5, -1)
    v, a = given[f"v{end}"], given[f"a{end}"]
    whole = given[f"rigid{end}"] + dry * np.sign(v) + viscous * v + rotor * a
    return np.asarray((1 + scale) * whole + zero)


def torque(given: Mapping[str, Array]) -> Array:
    """All parameters."""
    n = given["q"].shape[1]
    lower = np.concatenate([np.zeros(3 * n), np.full(n, -0.9), np.full(n, -np.inf)])
    upper = np.repeat([np.inf, np.inf, np.inf, MOST, np.inf], n)

    def residuals(x: Array) -> Array:
        return (efforts(x, given, "") - given["tau"]).ravel()

    start = np.maximum(np.zeros(5 * n), lower + 1e-3)
    found = least_squares(residuals, start, bounds=(lower, upper), x_scale="jac", max_nfev=200)
    return np.asarray(found.x)


def torque_misses(given: Mapping[str, Array], found: Array) -> Array:
    """Efforts missed on rows not fitted (N, n) [N m]."""
    return efforts(found, given, "_new") - given["tau_new"]


def rolled(x: Array, given: Mapping[str, Array], joint: int, starts: Array) -> Array:
    """Predicted minus measured (W, K) [rad]: a lag is exact for commands that run straight."""
    offset, delay, lag = x
    dt, length, settle = float(given["dt"]), int(given["length"]), int(given["settle"])
    u, q = given["u"][:, joint], given["q"][:, joint]
    at = starts[:, None] + np.arange(length + 1)
    c = np.interp(at - delay / dt, np.arange(len(u)), u) + offset
    ratio = lag / dt
    stays = np.exp(-1 / (ratio + 1e-9))
    late = ratio * (1 - stays)
    drive = (1 - late) * c[:, 1:] + (late - stays) * c[:, :-1]
    begin = stays * q[starts][:, None]
    out = lfilter([1.0], [1.0, -stays], drive, axis=1, zi=begin)[0]
    return np.asarray((out - q[at[:, 1:]])[:, settle:])


def motion(given: Mapping[str, Array]) -> list[Array]:
    """Offset, delay and lag (n, 3)."""
    lower, upper = np.array([-0.5, -0.02, 0.0]), np.array([0.5, 0.25, 0.5])
    found = []
    for j in range(given["q"].shape[1]):

        def residuals(x: Array, joint: int = j) -> Array:
            return rolled(x, given, joint, given["fit"]).ravel()

        scale = (0.05, 0.03, 0.03)
        solved = least_squares(residuals, given["start"], bounds=(lower, upper), x_scale=scale)
        found.append(solved.x)
    return found


def motion_misses(given: Mapping[str, Array], found: list[Array]) -> Array:
    """What windows not fitted are missed by (n, W, K) [rad]."""
    return np.stack([rolled(x, given, j, given["judge"]) for j, x in enumerate(found)])
