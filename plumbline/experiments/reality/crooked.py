r"""An arm whose links, joints and tool are all a little wrong, before a device unlike the fit's.

Every row is off in d, a, alpha and theta, and the axes that the drawing has parallel are tilted by
beta about the third direction; the joints give way under the arm's weight,

    q_i <- q_i + c_i tau_i(q),

the device sees depth worse than its other two axes, and some readings are of another point.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Arm, Array, Shape, forward, load_torque, rotations

PARALLEL = 1e-9  # |sin alpha| below which two axes are parallel


@dataclass(frozen=True)
class Reality:
    """What is unlike the model, and by how much."""

    length: float = 5e-4  # 1 sigma of errors of d and a [m]
    angle: float = 1e-3  # 1 sigma of errors of alpha, theta and beta [rad]
    tool: float = 2e-3  # 1 sigma of each coordinate of the tool's error [m]
    noise: float = 1e-4  # root mean square of the device's noise over its axes [m]
    depth: float = 1.0  # noise of the device's third axis over that of the others
    compliance: float = 0.0  # 1 sigma of the joints' compliance [rad/(N m)]
    gross: int = 0  # rows that are grossly wrong
    push: tuple[float, float] = (2e-3, 1e-2)  # how far off those are, least and most [m]


@dataclass(frozen=True, eq=False)
class Crooked:
    """One draw: what the joints said, what the device saw, and the truth behind it."""

    q: Array  # joint readings (N, n) [rad or m]
    measured: Array  # tips (N, 3) in the device's frame [m]
    nominal_tool: Array  # the tool as it is believed to be (3,) in the tip frame [m]
    truth: dict[str, float]  # errors by name, ``joint 2 a`` or ``tool x`` [m or rad]
    gross: NDArray[np.bool_]  # which rows are grossly wrong (N,)


def parallel_rows(arm: Arm) -> Array:
    """Rows (n,) whose axis is parallel to the next; the last has none."""
    return np.append(np.abs(np.sin(arm.alpha[:-1])) < PARALLEL, False)


def draw_crooked(
    arm: Arm, reality: Reality, rows: int, rng: np.random.Generator, *, tool: Array
) -> Crooked:
    """Draw an arm, N readings and a device that sees its tip; its nominal tool is (3,) [m]."""
    n = arm.joints
    errors = rng.normal(size=(n, 5)) * np.array([reality.length] * 2 + [reality.angle] * 3)
    errors[:, 4] *= parallel_rows(arm)
    off = rng.normal(0.0, reality.tool, 3)
    give = np.where(arm.prismatic, 0.0, np.abs(rng.normal(0.0, reality.compliance, n)))
    q = rng.uniform(arm.lower, arm.upper, (rows, n))
    tips = crooked_tips(arm, errors, give, q, tool + off)
    R = rotations(rng.uniform(-1.5, 1.5, 3))
    axes = np.array([1.0, 1.0, reality.depth])
    noise = reality.noise * axes / np.sqrt(np.mean(axes**2))
    measured = (tips - rng.normal(0.0, 0.5, 3)) @ R + rng.normal(size=tips.shape) * noise
    gross = np.zeros(rows, dtype=bool)
    gross[rng.choice(rows, reality.gross, replace=False)] = True
    push = rng.normal(size=(rows, 3))
    push *= (rng.uniform(*reality.push, rows) / np.linalg.norm(push, axis=1))[:, None]
    measured[gross] += push[gross]
    return Crooked(q, measured, tool, _truth(errors, off), gross)


def crooked_tips(arm: Arm, errors: Array, give: Array, q: Array, tool: Array) -> Array:
    """Tips (N, 3) in the base [m] of an arm with errors (n, 5) of d, a, alpha, theta, beta.

    Errors are in m and rad, compliances (n,) in rad/(N m), readings (N, n) in rad or m; the tool
    (3,) is in the last link's frame [m].
    """
    shape = Shape.of(arm, len(q))
    shape.flex[:, :, 4] = errors[:, 4]
    shape = replace(
        shape, d=shape.d + errors[:, 0], a=shape.a + errors[:, 1], alpha=shape.alpha + errors[:, 2]
    )
    built = replace(arm, theta=arm.theta + errors[:, 3])
    bent = q + give * load_torque(arm, forward(built, q, shape))
    last = forward(built, bent, shape)[:, -1]
    return np.asarray(last[:, :3, :3] @ tool + last[:, :3, 3])


def _truth(errors: Array, off: Array) -> dict[str, float]:
    keys = ("d", "a", "alpha", "theta", "beta")
    found = {
        f"joint {j} {key}": float(value)
        for j, row in enumerate(errors, start=1)
        for key, value in zip(keys, row, strict=True)
    }
    return found | {f"tool {axis}": float(v) for axis, v in zip("xyz", off, strict=True)}
