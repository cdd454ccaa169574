r"""Where the device's frame and the tool are, before anything is corrected.

.. math:: \min_{R, s, r, X} \sum_i |p_i - R (t_i + A_i r) - s|^2 + \lambda^2 |Z_i - R A_i X|^2

with the measured places p and turns Z, the tips t and their turns A by the model, the place r and
the turn X of the tool on the tip. Given R the others have a closed form, and given them R has
(Arun 1987; turns alone: Shah 2013, J. Mechanisms Robotics 5(3)). Where a wrist alone moves, tips
without their tool tell nothing of R, and such a descent may end elsewhere: it starts at the best
match of the tips and at the 24 rotations of a cube, of which one is within 63 degrees of any R.
"""

import numpy as np
import scipy

from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import FRAME_SCALE, REGISTERING_STEPS
from plumbline.optim.recording.recording import Recording
from plumbline.optim.rigid import nearest_rotation, rigid_match, rotations, some_of

# [m/rad]: a radian that a frame is off counts as the metres by which it is off as often.
TURN = FRAME_SCALE[0] / FRAME_SCALE[1]
Turns = tuple[Array, Array]  # of the model's tips and as recorded (N, 3, 3) each


def registered(recording: Recording) -> Array:
    """``T_device_world`` (4, 4) that carries the model's tips and turns nearest to the measured."""
    tips = recording.chain.tips(recording.q, recording.tool_offset)
    measured = recording.measured[:, :3]
    some = some_of(len(tips))
    first = rigid_match(tips, measured)[:3, :3]
    A = recording.chain.placement(recording.q[some])[:, :3, :3]
    oriented = recording.kind.oriented
    seen = rotations(recording.measured[some, 3:]) if oriented else np.zeros((len(some), 3, 3))
    R = _descended(first, tips[some], measured[some], (A, seen), "tool" in recording.always)
    return homogeneous(R, measured.mean(axis=0) - R @ tips.mean(axis=0))


def _descended(first: Array, tips: Array, measured: Array, turns: Turns, free: bool) -> Array:
    """The rotation (3, 3) of least cost that steps from any start end at."""
    cube = scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    R = np.concatenate([first[None], cube])
    t, p = tips - tips.mean(axis=0), measured - measured.mean(axis=0)
    for _ in range(REGISTERING_STEPS):
        R = nearest_rotation(_towards(R, t, p, turns, free)[0])
    cost = _towards(R, t, p, turns, free)[1]
    best = cost <= cost.min() + np.finfo(float).eps * np.sum(p**2)
    return np.asarray(R[np.argmax(best)])  # of equals, that nearest to the tips' own match


def _towards(R: Array, t: Array, p: Array, turns: Turns, free: bool) -> tuple[Array, Array]:
    """What the next rotations are nearest to (k, 3, 3), and the cost of these (k,)."""
    A, seen = turns
    tips, X = np.broadcast_to(t, (len(R), *t.shape)), np.broadcast_to(np.eye(3), R.shape)
    back = np.einsum("nj,kji->kni", p, R)
    if free:
        lever = A - A.mean(axis=0)
        tool = (back - t).reshape(len(R), -1) @ np.linalg.pinv(lever.reshape(-1, 3)).T
        tips, X = t + np.einsum("nij,kj->kni", lever, tool), mounted(R[:, None] @ A, seen)
    turned = A @ X[:, None]
    aim = np.einsum("ni,knj->kij", p, tips)
    aim += TURN**2 * np.einsum("nij,knlj->kil", seen, turned)
    off = np.sum((back - tips) ** 2, axis=(1, 2))
    if seen.any():
        off += TURN**2 * np.sum((R[:, None] @ turned - seen) ** 2, axis=(1, 2, 3))
    return aim, off


def mounted(R_device_tip: Array, seen: Array) -> Array:
    """``R_tip_tool`` (..., 3, 3) by the mean over N rows of both (..., N, 3, 3), (N, 3, 3)."""
    return nearest_rotation(np.einsum("...nji,njk->...ik", R_device_tip, seen))


def tool_turn(recording: Recording, T_device_world: Array) -> Array:
    """Rotation vector (3,) of the tool on the tip, by the mean over the rows [rad].

    What is tracked may be mounted in any way, and of a half turn no pose's residual has a slope.
    """
    R_device_tip = T_device_world[:3, :3] @ recording.chain.placement(recording.q)[:, :3, :3]
    turn = mounted(R_device_tip, rotations(recording.measured[:, 3:]))
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec())
