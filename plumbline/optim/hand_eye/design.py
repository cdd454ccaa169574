r"""The best next poses: those after which rebuilt points are known best.

.. math:: \min\ \mathrm{tr}\, Q\, \Sigma', \qquad
          \Sigma' = \Sigma - \frac{\Sigma a\, a^T \Sigma}{\sigma^2 + a^T \Sigma a}, \qquad
          Q = \overline{J_d^T J_d},\ \ J_d = [I \;\; d\, I]\, \partial (r, v) / \partial x

one pose after the other (greedy design for prediction: Fedorov 1972): a is the equation of a new
reading, sigma its standard deviation at that incidence, d the ranges that were read. Candidates aim
at points that were seen already, from poses turned about them and shifted along the beam, within
the incidence and the ranges that the recording has; with joint readings, the arm must reach them,
by damped Newton steps on the pose's error for all of them at once (Nakamura and Hanafusa 1986):

.. math:: q \leftarrow q + J^T (J J^T + \mu I)^{-1} \begin{bmatrix} t^* - t \\ \tfrac12 \sum_i
          R_{:i} \times R^*_{:i} \end{bmatrix}
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as cs
import numpy as np
import scipy

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.calibrate import Calibration
from plumbline.optim.hand_eye.readings import Readings, unit
from plumbline.optim.hand_eye.reweighting import rows_at


@lru_cache(maxsize=4)
def _error(chain: Chain) -> cs.Function:
    """(q, R*, t*) -> the pose's error (6,) and its Jacobian by q, negative."""
    q, goal = cs.SX.sym("q", chain.n), cs.SX.sym("goal", 12)
    T = chain.forward(q)
    R_goal, t_goal = cs.reshape(goal[:9], 3, 3), goal[9:]
    turn = sum((cs.cross(T.R[:, i], R_goal[:, i]) for i in range(3)), cs.SX(3, 1)) / 2
    error = cs.vertcat(t_goal - T.t, turn)
    row = cs.vertcat(q, goal)
    return cs.Function("error", [row], [cs.densify(error), cs.densify(-cs.jacobian(error, q).T)])


def reach(chain: Chain, near: Array, T: Array) -> tuple[Array, Flags]:
    """Postures (N, n) that bring the tip to poses (N, 4, 4) [m], from near ones; which arrive."""
    q = np.array(near)
    goals = np.hstack([np.swapaxes(T[:, :3, :3], 1, 2).reshape(-1, 9), T[:, :3, 3]])
    for _ in range(constants.REACH_STEPS):
        error, J = over_rows(_error(chain), np.hstack([q, goals]))
        gram = J @ np.swapaxes(J, 1, 2) + constants.DESIGN_DAMPING * np.eye(6)
        step = np.einsum("nij,ni->nj", J, np.linalg.solve(gram, error[:, 0, :, None])[..., 0])
        size = np.linalg.norm(step, axis=1, keepdims=True)
        q = q + step / np.maximum(1.0, size / constants.LONGEST_STEP)
    error, _ = over_rows(_error(chain), np.hstack([q, goals]))
    arrived = np.abs(error[:, 0]).max(axis=1) < constants.ARRIVED
    return q, arrived & np.all((q >= chain.lower) & (q <= chain.upper), axis=1)


@dataclass(frozen=True, eq=False)
class NextPose:
    """A pose worth measuring."""

    position: Array  # of the flange in the base frame (3,) [m]
    quaternion: Array  # its orientation (4,), scalar first
    plane: int  # which plane the beam meets
    distance: float  # the range to be expected [m]
    incidence: float  # angle between beam and normal [rad]
    point_std: float  # standard error of rebuilt points with this pose and those before it [m]
    q: Array | None  # joint readings that reach it (n,) [rad or m]; None where the arm is not known


def next_poses(
    calibration: Calibration,
    count: int = 5,
    *,
    seed: int = 0,
    chain: Chain | None = None,
    q: Array | None = None,
) -> tuple[NextPose, ...]:
    """The poses that would sharpen rebuilt points most, best first, within the arm's reach.

    ``q`` are its joint readings at the calibration's own readings (N, n) [rad or m].
    """
    rng = np.random.default_rng(seed)
    found, source = candidates(calibration, rng)
    postures = None
    if chain is not None and q is not None:
        postures, good = reach(chain, q[source], homogeneous(found.R, found.t))
        found, source, postures = found.select(good), source[good], postures[good]
    equations, sigma, incidence = _equations(calibration, found, source)
    chosen, stds = greedy(calibration, equations, sigma, count)
    return tuple(
        NextPose(
            position=found.t[k],
            quaternion=scipy.spatial.transform.Rotation.from_matrix(found.R[k]).as_quat(
                scalar_first=True
            ),
            plane=int(found.plane[k]),
            distance=float(found.distance[k]),
            incidence=float(incidence[k]),
            point_std=float(std),
            q=None if postures is None else postures[k],
        )
        for k, std in zip(chosen, stds, strict=True)
    )


def candidates(calibration: Calibration, rng: np.random.Generator) -> tuple[Readings, Array]:
    """Readings (C) that could be taken, their ranges as expected, and the rows that they follow."""
    c, r = calibration, calibration.readings
    source = rng.integers(0, len(r), constants.TRIES)
    turns = scipy.spatial.transform.Rotation.from_rotvec(
        _ball(rng, constants.TRIES) * constants.LARGEST_TILT
    ).as_matrix()
    R = turns @ r.R[source]
    stand = rng.uniform(r.distance.min(), r.distance.max(), constants.TRIES)
    aim = c.beam.points(r.R[source], r.t[source], r.distance[source])
    t = aim - np.einsum("nij,nj->ni", R, c.beam.r + stand[:, None] * c.beam.v)
    found = replace(r.select(source), R=R, t=t, distance=stand)
    incidence = _angles(c, found)
    allowed = incidence <= max(float(c.incidence.max()), constants.LEAST_INCIDENCE)
    return found.select(allowed), source[allowed]


def _ball(rng: np.random.Generator, count: int) -> Array:
    """Points (N, 3) of the unit ball, even over their distance from its centre."""
    way = rng.normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(0, 1, (count, 1))


def _angles(c: Calibration, found: Readings) -> Array:
    """Incidence (C,) [rad], pi / 2 and more where the beam leaves the board."""
    index = np.searchsorted(c.readings.planes, found.plane)
    normals = c.frames.B[index, :, 2]
    return np.arccos(np.clip(np.sum((found.R @ c.beam.v) * normals, axis=1), -1.0, 1.0))


def _equations(c: Calibration, found: Readings, source: Array) -> tuple[Array, Array, Array]:
    """Equations (C, P) of new readings, their sigmas (C,) [m] and incidences (C,) [rad]."""
    incidence = _angles(c, found)
    problem = c.solution.problem
    # A candidate lies where its source did: the same bow. Its plane's number must be kept.
    rows = problem.rows[source].copy()
    index = np.searchsorted(c.readings.planes, found.plane)
    rows[:, :13] = c.frames.carried(found, index).rows
    _, J = rows_at(Mapped(problem.on(rows)), c.x)
    return J, np.sqrt(c.variance.at(incidence)), incidence


def goal(c: Calibration) -> Array:
    """Q (P, P): mean square of rebuilt points' errors over the ranges that were read."""
    x = cs.SX.sym("x", 5)
    d = float(np.mean(c.readings.distance))
    spread = float(np.std(c.readings.distance))
    v = unit(x[3:])
    jacobian = cs.Function("jacobian", [x], [cs.jacobian(cs.vertcat(x[:3], v), x)])
    J = np.asarray(jacobian(c.x[:5]).full())
    near, far = (np.hstack([np.eye(3), k * np.eye(3)]) @ J for k in (d - spread, d + spread))
    Q = np.zeros((len(c.fit.x),) * 2)
    Q[:5, :5] = (near.T @ near + far.T @ far) / 2.0
    return Q


def greedy(
    c: Calibration, equations: Array, sigma: Array, count: int
) -> tuple[list[int], list[float]]:
    """Which equations (of C) to take, one after the other, and the point error after each [m]."""
    Q, S = goal(c), c.fit.covariance.copy()
    chosen: list[int] = []
    stds: list[float] = []
    for _ in range(min(count, len(equations))):
        SA = equations @ S
        spread = np.einsum("cp,cp->c", SA, equations)
        gain = np.einsum("cp,pq,cq->c", SA, Q, SA) / (sigma**2 + spread)
        gain[chosen] = -np.inf
        k = int(np.argmax(gain))
        S = S - np.outer(SA[k], SA[k]) / (sigma[k] ** 2 + spread[k])
        chosen.append(k)
        stds.append(float(np.sqrt(max(np.trace(Q @ S), 0.0))))
    return chosen, stds


def point_std(c: Calibration) -> float:
    """Standard error of rebuilt points over the ranges that were read [m]."""
    return float(np.sqrt(np.trace(goal(c) @ c.fit.covariance)))
