r"""The closed form on one plane (Zeng et al. 2017, eqs. 5, 13-15), and its selection loop.

The plane's equation, up to its offset, which differences of two readings are without, is

.. math:: f(R, t, d) = n^T \big(R\,(r + d\,v) + t\big)

Pure translations t_j, in the flange frame at the group's first pose, give

.. math:: (d_j - d_0)\, p = -n^T t_j, \quad p = n^T v
          \quad\Rightarrow\quad
          n = -g\, p, \quad g = \Big[\sum t_j t_j^T\Big]^{-1} \sum t_j\, (d_j - d_0)

so that :math:`|n| = 1` makes :math:`p = \pm 1/|g|`, and :math:`n_z > 0` chooses the sign: of n and
p together, which leaves :math:`n^T v = p` the same equation. Three orientations or more give v by
least squares; :math:`v_z > 0` holds for a finder that looks ahead. Rotations with translations give
r from :math:`f(R_j, t_j, d_j) - f(R_0, t_0, d_0)` with the normal in the base frame (eq. 15). Each
equation is linear in its unknown: its value at 0 and its Jacobian are all of it.

The loop rebuilds all points, drops the reading whose point lies farthest from their principal plane
and solves again, until there are too few; the iterate of least repeatability on marks is kept.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.problem import Array, Integers
from plumbline.optim.hand_eye.accuracy import Marks, repeatability
from plumbline.optim.hand_eye.constants import ALIKE, FLAT, LEAST_GROUP, LEAST_GROUPS, LEAST_SPAN
from plumbline.optim.hand_eye.readings import Beam, Readings, principal_plane


def height(n: cs.SX, r: cs.SX, v: cs.SX, pose: cs.SX) -> cs.SX:
    """f, of a pose's thirteen numbers R (column by column), t [m] and d [m]."""
    R, t, d = cs.reshape(pose[:9], 3, 3), pose[9:12], pose[12]
    return cs.dot(n, R @ (r + d * v) + t)


@lru_cache(maxsize=1)
def translation() -> cs.Function:
    """(t_j - t_0 in the flange's frame, d_j - d_0) -> eq. 13 over p, linear in m."""
    m, row = cs.SX.sym("m", 3), cs.SX.sym("row", 4)
    pose = cs.vertcat(cs.vec(cs.SX.eye(3)), row[:3], 0)
    nothing = cs.SX.zeros(3, 1)
    # The range's own part is d m^T v, and m^T v = 1.
    return _linear(m, row, height(m, nothing, nothing, pose) + row[3])


@lru_cache(maxsize=1)
def component() -> cs.Function:
    """(n, p) -> what eq. 14 leaves for v, linear in v."""
    v, row = cs.SX.sym("v", 3), cs.SX.sym("row", 4)
    return _linear(v, row, cs.dot(row[:3], v) - row[3])


@lru_cache(maxsize=1)
def rotation() -> cs.Function:
    """(n, v, pose and range j, pose and range 0) -> eq. 15, linear in r."""
    r, row = cs.SX.sym("r", 3), cs.SX.sym("row", 32)
    n, v, here, first = row[:3], row[3:6], row[6:19], row[19:]
    return _linear(r, row, height(n, r, v, here) - height(n, r, v, first))


def _linear(x: cs.SX, row: cs.SX, equation: cs.SX) -> cs.Function:
    """An equation linear in x, as row -> (its Jacobian (1, k), its value at x = 0)."""
    value = cs.substitute(equation, x, 0)
    outputs = [cs.densify(cs.jacobian(equation, x)), cs.densify(value)]
    return cs.Function("equation", [row], outputs)


def system(equation: cs.Function, rows: Array) -> tuple[Array, Array]:
    """Matrix (N, 3) and right-hand side (N,) of rows: A x = b in the sense of least squares."""
    matrix, value = over_rows(equation, rows)
    return np.asarray(matrix[:, :, 0]), np.asarray(-value[:, 0, 0])


@dataclass(frozen=True, eq=False)
class Slope:
    """What one group of pure translations tells."""

    R: Array  # the group's orientation (3, 3)
    g: Array  # slope of the range over translations in the flange frame (3,)
    n: Array  # the plane's unit normal in that frame (3,), n_z > 0
    p: float  # its component along the beam


@dataclass(frozen=True, eq=False)
class SinglePlane:
    """The closed form's result."""

    beam: Beam  # the beam
    normal: Array  # the plane's unit normal in the base frame (3,), away from the flange
    length: float  # length of v before it was normalised: 1 where all is well


def slope(group: Readings) -> Slope:
    """Slope and normal of one group of four pure translations or more, in three directions."""
    if len(group) < LEAST_GROUP:
        raise PlumblineError(
            f"motion {group.motion[0]}: {len(group)} readings, at least {LEAST_GROUP} expected for "
            "three translations; take more"
        )
    R0 = group.R[0]
    moves = (group.t[1:] - group.t[0]) @ R0
    A, b = system(translation(), np.column_stack([moves, group.distance[1:] - group.distance[0]]))
    gram = A.T @ A
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[::-1], 0.0))
    if not spread[-1] > FLAT * spread[0]:
        _refuse_repeated(group)
        raise PlumblineError(
            f"motion {group.motion[0]}: translations within a plane ({spread[-1] * 1e3:.2g} mm "
            f"beside {spread[0] * 1e3:.3g} mm), three directions expected; change the stand-off too"
        )
    g = np.asarray(-np.linalg.solve(gram, A.T @ b), dtype=float)
    if not g.any():
        raise PlumblineError(
            f"motion {group.motion[0]}: the range stays at {group.distance[0]:.4g} m while the "
            "flange moves, a change expected; look whether the finder or its log is held"
        )
    n = -g / np.linalg.norm(g)
    n = n if n[2] > 0.0 else -n
    return Slope(R0, g, n, float(-(n @ g) / (g @ g)))


def _refuse_repeated(group: Readings) -> None:
    """Refuse readings of too few poses, however often each was read."""
    poses = group.distinct
    if poses < LEAST_GROUP:
        raise PlumblineError(
            f"motion {group.motion[0]}: {poses} distinct poses in {len(group)} readings, at least "
            f"{LEAST_GROUP} expected for three translations; move between the readings"
        )


def closed_form(readings: Readings) -> SinglePlane:
    """The beam from the readings of one plane, in groups of motions.

    Three groups or more of pure translations at different orientations, and one that turns.

    Raises:
        PlumblineError: Motions that leave the beam open; the message says which.
    """
    groups = list(readings.motions())
    moved = [group.is_translation for group in groups]
    slopes = [slope(group) for group, still in zip(groups, moved, strict=True) if still]
    v, length = _direction(slopes)
    mean = np.mean([s.R @ s.n * np.sign(s.n @ v) for s in slopes], axis=0)  # along the beams
    normal = np.asarray(mean / np.linalg.norm(mean))
    turning = [group for group, still in zip(groups, moved, strict=True) if not still]
    return SinglePlane(Beam(_origin(turning or [readings], normal, v), v), normal, length)


def _direction(slopes: list[Slope]) -> tuple[Array, float]:
    if len(slopes) < LEAST_GROUPS:
        raise PlumblineError(
            f"{len(slopes)} groups of pure translations, at least {LEAST_GROUPS} orientations "
            "expected; keep the flange's orientation within a group"
        )
    N, p = system(component(), np.array([[*s.n, s.p] for s in slopes]))
    sizes = np.linalg.svd(N, compute_uv=False)
    if sizes[-1] < ALIKE * sizes[0]:
        raise PlumblineError(
            "no rotation between the groups: their orientations see the plane alike "
            f"(singular values {sizes[-1]:.1e} beside {sizes[0]:.2g}); tilt the flange between them"
        )
    v = np.asarray(np.linalg.lstsq(N, p, rcond=None)[0], dtype=float)
    length = float(np.linalg.norm(v))
    return v / length, length


def _origin(groups: list[Readings], normal: Array, v: Array) -> Array:
    """R (3,) by least squares over groups, each about its own first reading."""
    rows, right = [], []
    for group in groups:
        at = group.rows
        once = np.ones((len(at) - 1, 1))
        given = np.hstack([once * np.concatenate([normal, v]), at[1:], once * at[0]])
        matrix, values = system(rotation(), given)
        rows.append(matrix)
        right.append(values)
    A = np.concatenate(rows)
    sizes = np.linalg.svd(A, compute_uv=False) if len(A) >= 3 else np.zeros(1)
    if len(A) < 3 or sizes[-1] < ALIKE * max(sizes[0], LEAST_SPAN) or sizes[0] < ALIKE:
        raise PlumblineError(
            f"no rotation that shows r: {len(A) + len(groups)} readings see the plane from "
            "directions that leave it open; turn the flange by 10 deg or more, about two axes"
        )
    return np.asarray(np.linalg.lstsq(A, np.concatenate(right), rcond=None)[0])


@dataclass(frozen=True, eq=False)
class Selection:
    """The course of the loop."""

    best: SinglePlane  # the iterate of least repeatability
    first: SinglePlane  # the closed form on all readings
    curve: Array  # repeatability (I,) [m] of every iterate, the first of all readings
    kept: int  # iteration that was kept, from 0: so many readings were dropped
    dropped: Integers  # readings in the order in which they were dropped, by their names (I - 1,)
    readings: Readings  # the readings that the kept iterate rests on


def select(readings: Readings, marks: Marks, most: int | None = None) -> Selection:
    """Run the loop on one plane until the closed form has too few data, or ``most`` are dropped.

    Raises:
        PlumblineError: The closed form fails on all readings.
    """
    found = [closed_form(readings)]
    curve, left = [repeatability(found[0].beam, marks)], readings
    dropped: list[int] = []
    while most is None or len(dropped) < most:
        points = found[-1].beam.points(left.R, left.t, left.distance)
        worst = int(np.argmax(np.abs(principal_plane(points).distances(points))))
        name, left = int(left.row[worst]), left.select(np.arange(len(left)) != worst)
        try:
            found.append(closed_form(left))
        except PlumblineError:
            break
        dropped.append(name)
        curve.append(repeatability(found[-1].beam, marks))
    kept = int(np.argmin(curve))
    rest = readings.select(~np.isin(readings.row, dropped[:kept]))
    order = np.array(dropped, dtype=np.int64)
    return Selection(found[kept], found[0], np.array(curve), kept, order, rest)
