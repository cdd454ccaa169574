"""How a session goes: where the arm is sent, from which side, when, and how warm it gets.

A session visits random poses of the whole joint range, or of a box of 0.2 to 0.4 m (a surgical
space). Some joints hold still between readings, some poses are visited twice, the clock runs
unevenly, and the arm warms up.
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, forward, point_torque
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Session

RANGES = Ranges("session")
SLIDE = 0.2  # m of a slide where a turning joint has a radian
STEPS = 15  # of damped least squares to a goal


def draw_session(
    arm: Arm,
    rows: int,
    rng: np.random.Generator,
    *,
    tool: Array,
    surgical: bool = False,
    moving: bool = False,
) -> Session:
    """Draw the course of a recording of N rows.

    ``surgical`` keeps the tip, (3,) in the flange frame [m], within a box of 0.2 to 0.4 m;
    ``moving`` reads while the arm moves.
    """
    q = boxed(arm, rows, tool, rng) if surgical else spread(arm, rows, rng)
    q = _revisit(q, rng)
    time = np.cumsum(RANGES.many("period", rng, rows))
    velocity = np.zeros_like(q)
    no = RANGES.chances["unsided"].share
    direction = rng.choice([-1.0, 0.0, 1.0], size=q.shape, p=[(1 - no) / 2, no, (1 - no) / 2])
    if moving:
        velocity = RANGES.near("velocity", rng, q.shape) * np.where(arm.prismatic, SLIDE, 1.0)
        direction = np.sign(velocity)
    warmth, ambient = climate(time, rng)
    parts = RANGES.whole("parts", rng)
    group = np.floor(np.arange(rows) * parts / rows) + 1.0
    return Session(q, time, warmth, ambient, direction, velocity, group)


def spread(arm: Arm, rows: int, rng: np.random.Generator) -> Array:
    """Poses (N, n) over the whole joint range, some joints holding still from row to row."""
    q = rng.uniform(arm.lower, arm.upper, (rows, arm.joints))
    held = rng.random(q.shape) < RANGES.chances["held"].share
    for k in range(1, rows):
        q[k] = np.where(held[k], q[k - 1], q[k])
    return q


def _revisit(q: Array, rng: np.random.Generator) -> Array:
    again = q.copy()
    for k in range(3, len(q)):
        if RANGES.happens("repeated", rng):
            again[k] = again[rng.integers(0, k - 1)]
    return again


def climate(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Temperatures of arm and air (N,) [degC]: a warm-up on a slow wave of the air's."""
    clock = time - time[0]
    span = max(float(clock[-1]), 1.0)
    names = ("swing", "swing_period", "swing_phase", "air", "rise", "settle")
    swing, period, phase, air, rise, settle = (RANGES.one(name, rng) for name in names)
    ambient = 21.0 + air + swing * np.sin(2.0 * np.pi * clock / (span * period) + phase)
    return ambient + rise * (1.0 - np.exp(-clock / (span * settle))), ambient


def lagged(time: Array, true: Array, delay: float, first: float | None = None) -> Array:
    """What follows true values (N,) with a time constant `delay` [s], from the first of them on.

    Such as a thermometer a temperature; or it begins at ``first``.
    """
    shown = np.empty_like(true)
    shown[0] = true[0] if first is None else first
    for k in range(1, len(true)):
        keep = np.exp(-(time[k] - time[k - 1]) / delay)
        shown[k] = keep * shown[k - 1] + (1.0 - keep) * true[k]
    return shown


def tips(arm: Arm, q: Array, tool: Array) -> tuple[Array, Array]:
    """Tip positions (N, 3) [m] and position Jacobians (N, 3, n) of the drawing, base frame."""
    frames = forward(arm, q)
    points = frames[:, -1, :3, 3] + frames[:, -1, :3, :3] @ tool
    columns = [point_torque(arm, frames, points, axis) for axis in np.eye(3)]
    return points, np.stack(columns, axis=1)


def reach(arm: Arm, q: Array, goal: Array, tool: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Bring the drawing's tip to goals (N, 3) [m] by damped least squares from q (N, n).

    Joint positions (N, n), and which rows arrived within 1e-6 m near the joint range.
    """
    for _ in range(STEPS):
        points, jacobian = tips(arm, q, tool)
        q = q + correction(jacobian, goal - points)
    points, _ = tips(arm, q, tool)
    near = np.linalg.norm(goal - points, axis=1) < 1e-6
    inside = np.all((q > arm.lower - 0.3) & (q < arm.upper + 0.3), axis=1)
    return q, near & inside


def correction(jacobian: Array, gap: Array) -> Array:
    """Least-squares joint steps (N, n) for tip displacements (N, 3) [m], half a radian at most."""
    square = jacobian @ np.swapaxes(jacobian, 1, 2) + 1e-8 * np.eye(3)
    step = np.einsum("nij,ni->nj", jacobian, np.linalg.solve(square, gap[..., None])[..., 0])
    size = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-12)))


def box_middle(arm: Arm, tool: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """A pose (n,) away from the ends of the joint range, and its tip (3,) [m]."""
    quarter = 0.25 * (arm.upper - arm.lower)
    centre = rng.uniform(arm.lower + quarter, arm.upper - quarter)
    return centre, tips(arm, centre[None], tool)[0][0]


def starts(arm: Arm, centre: Array, about: str, rows: int, rng: np.random.Generator) -> Array:
    """Poses (rows, n) strewn around one pose, as widely as a box or a socket asks for."""
    off = RANGES.near(about, rng, (rows, arm.joints))
    return np.asarray(centre + off * np.where(arm.prismatic, SLIDE, 1.0))


def boxed(arm: Arm, rows: int, tool: Array, rng: np.random.Generator) -> Array:
    """Poses (N, n) whose tips fill a box of 0.2 to 0.4 m, if one is found, directions varying."""
    side = RANGES.one("box", rng)
    for _ in range(50):
        centre, middle = box_middle(arm, tool, rng)
        goal = middle + rng.uniform(-0.5 * side, 0.5 * side, (3 * rows, 3))
        q, good = reach(arm, starts(arm, centre, "box", 3 * rows, rng), goal, tool)
        if good.sum() >= rows:
            return q[good][:rows]
    raise PlumblineError(f"no box of {side:.2f} m within reach of {arm.name}: take a smaller one")


def socketed(
    arm: Arm, rows: int, tool: Array, rng: np.random.Generator
) -> tuple[Array, NDArray[np.int64]]:
    """Poses that touch 2 to 4 sockets, if in reach: joints (N, n), the sockets (N,) from 0."""
    count = RANGES.whole("sockets", rng)
    for _ in range(50):
        centre, middle = box_middle(arm, tool, rng)
        sockets = middle + RANGES.many("socket", rng, (count, 3))
        number = np.asarray(rng.integers(0, count, 3 * rows))
        q, good = reach(arm, starts(arm, centre, "socket", 3 * rows, rng), sockets[number], tool)
        chosen = number[good][:rows]
        if good.sum() >= rows and len(np.unique(chosen)) == count:
            return q[good][:rows], chosen
    raise PlumblineError(f"no sockets within reach of {arm.name}: shorten the tool")
