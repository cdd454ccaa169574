r"""Postures of an arm of the VS060's build that bring its flange to given poses, in closed form.

The last three axes meet in the wrist's centre, d_6 behind the flange:

    W = p - d_6 z,   rho = +-hypot(W_x, W_y),   h = d_1 - W_z

The upper arm (a_2) and the forearm (a_3, d_4) form a triangle over (rho, h), which the law of
cosines solves, elbow up or down; what remains of the orientation is z-y-z,

    R_36 = Rz(q_4) Ry(q_5) Rz(q_6).

Two shoulders, two elbows and two wrists make eight postures.
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Arm, Array

BRANCHES = 8


def inverse(arm: Arm, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
    """All postures (N, 8, 6) [rad] of flange poses (N, 4, 4) in the base frame [m].

    And which of them exist within the joint ranges (N, 8), of an arm of the VS060's build.
    """
    centre = poses[:, :3, 3] - arm.d[5] * poses[:, :3, 2]
    q = np.zeros((len(poses), BRANCHES, 6))
    there = np.zeros((len(poses), BRANCHES), dtype=bool)
    for shoulder in (0, 1):
        for elbow in (0, 1):
            first, found = _first_three(arm, centre, shoulder, elbow)
            rest = _behind_elbow(arm, first, poses[:, :3, :3])
            for wrist in (0, 1):
                k = 4 * shoulder + 2 * elbow + wrist
                q[:, k, :3], q[:, k, 3:] = first, _last_three(rest, wrist)
                there[:, k] = found
    q = np.asarray((q + np.pi) % (2.0 * np.pi) - np.pi)
    inside = np.all((q >= arm.lower) & (q <= arm.upper), axis=2)
    return q, there & inside


def _first_three(
    arm: Arm, centre: Array, shoulder: int, elbow: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Turn, shoulder and elbow (N, 3) that bring the wrist's centre (N, 3) into place."""
    side, bend = 1.0 - 2.0 * shoulder, 1.0 - 2.0 * elbow
    turn = np.arctan2(side * centre[:, 1], side * centre[:, 0])
    rho, drop = side * np.hypot(centre[:, 0], centre[:, 1]), arm.d[0] - centre[:, 2]
    upper, fore = arm.a[1], np.hypot(arm.a[2], arm.d[3])
    span = np.hypot(rho, drop)
    cosine = (span**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    knee = bend * np.arccos(np.clip(cosine, -1.0, 1.0))
    lift = np.arctan2(drop, rho) - np.arctan2(fore * np.sin(knee), upper + fore * np.cos(knee))
    # The forearm's line lies this far ahead of the elbow's x axis.
    lead = np.arctan2(-arm.d[3], arm.a[2])
    first = np.stack([turn, lift - arm.theta[1], knee - lead - arm.theta[2]], axis=1)
    return first, np.abs(cosine) < 1.0 - 1e-4


def _behind_elbow(arm: Arm, first: Array, turn: Array) -> Array:
    """What the wrist must turn by (N, 3, 3): R_03^T R, with R_03 = Rz(q_1) Ry(q_2 + q_3 + ...)."""
    lift = first[:, 1] + first[:, 2] + arm.theta[1] + arm.theta[2]
    c, s = np.cos(first[:, 0])[:, None], np.sin(first[:, 0])[:, None]
    x, y = turn[:, 0], turn[:, 1]
    ahead, aside, up = c * x + s * y, c * y - s * x, turn[:, 2]
    c, s = np.cos(lift)[:, None], np.sin(lift)[:, None]
    return np.stack([c * ahead - s * up, aside, s * ahead + c * up], axis=1)


def _last_three(rest: Array, wrist: int) -> Array:
    """Wrist angles (N, 3) for the wrist's own rotations (N, 3, 3)."""
    sign = 1.0 - 2.0 * wrist
    bend = sign * np.arccos(np.clip(rest[:, 2, 2], -1.0, 1.0))
    roll = np.arctan2(sign * rest[:, 1, 2], sign * rest[:, 0, 2])
    spin = np.arctan2(sign * rest[:, 2, 1], -sign * rest[:, 2, 0])
    return np.stack([roll, bend, spin], axis=1)
