r"""A surgical arm as it was built, and a camera that reads its tip: plain NumPy.

The BH-7 of Chen et al.: a slide, four turning joints, a needle. Every link was made a little wrong,
in d, a, alpha, theta and, since a workshop knows nothing of Denavit and Hartenberg, in a tilt beta
about the third direction as well:

    T_k = Rz(theta_k + q_k) Tz(d_k) Tx(a_k) Rx(alpha_k) Ry(beta_k)

The camera stands apart, its readings have noise of one size on every axis, and joints do not
come back to the very same place. The size of the errors is set by what the paper states: the mean
misfit of the drawing's arm, registered on four points, before any fit.

Any other arm can be crooked in the same five ways, before a device unlike the fit's: the joints
give way under the arm's weight,

    q_i <- q_i + c_i tau_i(q),

the device sees depth worse than its other two axes, and some readings are of another point.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Arm, Array, Shape, forward, load_torque, rotations
from plumbline.experiments.reality.ranges import Ranges

RANGES = Ranges("tips")
# d [m], a [m], alpha [deg], theta [deg]; the last row is the needle.
BH7 = (
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 0.2, 0.0, 0.0),
    (0.0, 0.2, 0.0, 0.0),
    (-0.170, 0.0, -90.0, -90.0),
    (0.145, 0.0, -90.0, 0.0),
    (0.150, 0.0, 0.0, 0.0),
)
LOWER = np.array([0.05, -1.3, -1.8, -1.8, -1.6])  # [m, rad] of the joints
UPPER = np.array([0.30, 1.3, 1.8, 1.8, 1.6])  # [m, rad]
JOINTS = 5  # a slide and four that turn
CORNERS = np.array([[-1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]]) / 2.0  # [edges]
CANDIDATES = 200  # poses of which those nearest to the corners are taken
PARALLEL = 1e-9  # |sin alpha| below which two axes are parallel
LENGTH, ANGLE = 2e-3, np.deg2rad(0.5)  # [m], [rad]: 1 sigma of errors before they are scaled


@dataclass(frozen=True)
class Built:
    """The links of an arm."""

    rows: Array  # (6, 5) d [m], a [m], alpha [rad], theta [rad], beta [rad]

    @classmethod
    def drawing(cls) -> Self:
        """As the drawing has them."""
        table = np.array(BH7)
        table[:, 2:] = np.deg2rad(table[:, 2:])
        return cls(np.hstack([table, np.zeros((len(table), 1))]))

    def with_errors(self, errors: Array) -> Self:
        """With errors (6, 5) added."""
        return replace(self, rows=self.rows + errors)

    def tips(self, q: Array) -> Array:
        """Tips of the needle (N, 3) [m] in the base, at joint positions (N, 5) [m, rad]."""
        point = np.zeros((len(q), 3))
        for k in reversed(range(len(self.rows))):
            d, a, alpha, theta, beta = self.rows[k]
            height = d + (q[:, 0] if k == 0 else 0.0)
            turn = theta + (q[:, k] if 0 < k < JOINTS else np.zeros(len(q)))
            tilt = rotations(np.array([alpha, 0.0, 0.0])) @ rotations(np.array([0.0, beta, 0.0]))
            point = point @ tilt.T + np.array([a, 0.0, 0.0])
            c, s = np.cos(turn), np.sin(turn)
            x, y, z = point.T
            point = np.column_stack([c * x - s * y, s * x + c * y, z + height])
        return point


@dataclass(frozen=True)
class Camera:
    """Where the camera stands, and how well it sees."""

    R: Array  # its axes in the base (3, 3)
    t: Array  # its place in the base (3,) [m]
    noise: float  # 1 sigma of one axis of a reading [m]

    def read(self, tips: Array, rng: np.random.Generator) -> Array:
        """Readings (N, 3) [m] in the camera's frame."""
        return np.asarray((tips - self.t) @ self.R + rng.normal(0.0, self.noise, tips.shape))


@dataclass(frozen=True)
class Box:
    """A surgical space."""

    centre: Array  # its middle (3,) in the base [m]
    size: Array  # its edges (3,) [m]

    def holds(self, points: Array) -> Array:
        """Which points (N, 3) lie in it."""
        return np.asarray((np.abs(points - self.centre) <= self.size / 2.0).all(axis=1))


SURGICAL = Box(np.array([0.33, 0.0, -0.03]), np.array([0.30, 0.40, 0.25]))


@dataclass(frozen=True)
class Session:
    """One arm in front of one camera."""

    built: Built  # the arm as it was built
    camera: Camera  # the camera
    q: Array  # joint readings (N, 5) [m, rad]
    tips: Array  # camera readings (N, 3) [m]
    registration_q: Array  # joint readings of the registration points (4, 5)
    registration_tips: Array  # camera readings of them (4, 3) [m]
    wander: tuple[float, float]  # 1 sigma of a joint's return, slide [m] and turn [rad]

    def visit(self, q: Array, rng: np.random.Generator) -> Array:
        """Camera readings (N, 3) [m] of an arm sent to readings (N, 5)."""
        return self.camera.read(self.built.tips(wandering(q, self.wander, rng)), rng)


def wandering(q: Array, wander: tuple[float, float], rng: np.random.Generator) -> Array:
    """Where joints come to rest (N, 5) when they are sent to q (N, 5)."""
    sizes = np.array([wander[0]] + [wander[1]] * (JOINTS - 1))
    return np.asarray(q + sizes * rng.normal(size=q.shape))


def poses(count: int, rng: np.random.Generator, box: Box | None = None) -> Array:
    """Joint readings (N, 5) over the joint ranges, of the drawing's arm with its tip in the box."""
    drawing, found = Built.drawing(), np.empty((0, JOINTS))
    while len(found) < count:
        q = rng.uniform(LOWER, UPPER, (4 * count, JOINTS))
        found = np.vstack([found, q if box is None else q[box.holds(drawing.tips(q))]])
    return found[:count]


def registration_poses(rng: np.random.Generator, box: Box) -> Array:
    """Four poses (4, 5) whose tips lie near four corners of the box that no plane holds."""
    q = poses(CANDIDATES, rng, box)
    tips = Built.drawing().tips(q)
    corners = box.centre + CORNERS * box.size
    nearest = np.linalg.norm(tips[:, None] - corners, axis=2).argmin(axis=0)
    return q[nearest]


def rigid(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that bring points (N, 3) nearest to others (Kabsch 1976)."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - b).T @ (source - a))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R, b - R @ a


def drawn_misfits(session: Session) -> Array:
    """Misfits (N, 3) [m] of the drawing's arm, the camera registered on the four points."""
    drawing = Built.drawing()
    R, t = rigid(session.registration_tips, drawing.tips(session.registration_q))
    return np.asarray(drawing.tips(session.q) - session.tips @ R.T - t)


def draw_errors(rng: np.random.Generator, length: float, angle: float) -> Array:
    """Manufacturing errors (6, 5) of one size for lengths [m] and one for angles [rad]."""
    errors = rng.normal(size=(len(BH7), 5)) * np.array([length] * 2 + [angle] * 3)
    errors[-1, 4] = 0.0  # the needle ends in a point: nothing turns behind it
    return errors


def draw_camera(rng: np.random.Generator, noise: float) -> Camera:
    """A camera about two metres away, looking anywhere."""
    R = rotations(RANGES.many("turn", rng, 3))
    return Camera(np.asarray(R), RANGES.near("camera", rng, 3) + np.array([0.3, 0.0, 2.0]), noise)


def draw_session(
    seed: int,
    *,
    readings: int,
    before: float,
    noise: float,
    wander: tuple[float, float] = (2e-5, 5e-5),
    box: Box | None = SURGICAL,
    tilt: float = 1.0,
) -> Session:
    """An arm whose errors give a stated mean misfit before any fit [m], and so many readings.

    ``noise`` is 1 sigma of one axis of the camera [m], ``wander`` of a joint's return, slide [m]
    and turn [rad]; of the errors' betas the arm has the part ``tilt``. Readings are taken in the
    box; with None over the whole workspace.
    """
    rng = np.random.default_rng(seed)
    errors, camera = draw_errors(rng, LENGTH, ANGLE), draw_camera(rng, noise)
    errors[:, 4] *= tilt
    q = poses(readings, rng, box)
    q_four = registration_poses(rng, box or SURGICAL)
    blank = np.empty((0, 3))
    first = Session(Built.drawing(), camera, q, blank, q_four, blank, wander)

    def at(scale: float) -> Session:
        """The same session, noise and all, with errors of another size."""
        chance = np.random.default_rng([seed, 1])
        session = replace(first, built=Built.drawing().with_errors(scale * errors))
        return replace(
            session, tips=session.visit(q, chance), registration_tips=session.visit(q_four, chance)
        )

    low, high = 0.0, 1.0
    while _mean(at(high)) < before:
        high *= 2.0
    for _ in range(50):
        middle = (low + high) / 2.0
        low, high = (middle, high) if _mean(at(middle)) < before else (low, middle)
    return at(high)


def _mean(session: Session) -> float:
    return float(np.linalg.norm(drawn_misfits(session), axis=1).mean())


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
    R = rotations(RANGES.many("turn", rng, 3))
    axes = np.array([1.0, 1.0, reality.depth])
    noise = reality.noise * axes / np.sqrt(np.mean(axes**2))
    measured = (tips - RANGES.near("device", rng, 3)) @ R + rng.normal(size=tips.shape) * noise
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
