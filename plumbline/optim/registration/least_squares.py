r"""Rigid least squares: all readings alike (Kabsch), or each by its own covariance.

.. math:: \min_{R, t, s} \sum_i |q_i - s R p_i - t|^2, \qquad
          \min_{R, t} \sum_i d_i^T (R\, \Sigma_{C,i} R^T + \Sigma_{R,i})^{-1} d_i, \quad
          d_i = q_i - R p_i - t

The first is in closed form by an SVD (Kabsch 1976; with a scale Umeyama 1991). Slices of 5 mm
against 1 mm in plane make CT's readings poor along one axis of CT; that axis turns with R, so the
weights of the second do, too. From the first on, damped Newton steps find it,

.. math:: (H + \mu\, |\mathrm{diag}\, H|)\, x = -g, \qquad T \leftarrow \mathrm{move}(T, x)

for one or many draws at once: each has a damping of its own, and only steps that lower its sum of
squares are kept (Madsen, Nielsen, Tingleff 2004, sec. 2.4). Derivatives are those of the symbolic
statement (:mod:`.statement`).

What every method of registration offers, and what it hands to the report.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from plumbline.declared import Declared
from plumbline.optim.core.judged import Judgement, judged_by_gram
from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solvers import Solver
from plumbline.optim.registration import constants
from plumbline.optim.registration.markers import MarkerNoise, Markers, rows_of
from plumbline.optim.registration.statement import derivatives, problem, sensitivity
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class Fit:
    """A transform and how the markers move it; the report judges it."""

    T_RC: Array  # from CT to robot (4, 4) [m]
    centre: Array  # the point (3,) of frame R that the derivatives are taken at [m]
    # derivative (k, n, 6) of the pose by each marker's coordinates, CT first: displacement at the
    # centre [m/m], rotation vector [rad/m] and, where k = 7, the relative scale [1/m]
    jacobian: Array
    used: tuple[int, ...]  # which markers (from 0) the transform rests on
    scale: float = 1.0  # lengths in R over lengths in C
    shifted: tuple[int, ...] = ()  # markers found to have moved
    notes: tuple[str, ...] = ()  # what is odd, one line each
    doubt: str = ""  # why the error of this fit cannot be predicted; empty where it can
    # whether what was iterated converged; a closed form has nothing to judge
    judged: Judgement = field(default_factory=Judgement)


@runtime_checkable
class Method(Protocol):
    """A frozen dataclass of typed options; a new method is one file and one line in ``METHODS``."""

    @property
    def name(self) -> str:
        """What the command line calls it."""

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers' coordinates."""

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of many draws of the same markers (..., n, 3) [m], unchecked."""


def move(T: Array, centre: Array, x: Array) -> Array:
    """Poses (N, 4, 4) displaced by x (N, 6): v [m] at the centre (N, 3), then rotation [rad]."""
    turn = scipy.spatial.transform.Rotation.from_rotvec(x[:, 3:6]).as_matrix().astype(np.float64)
    moved = T.copy()
    moved[:, :3, :3] = turn @ T[:, :3, :3]
    arm = T[:, :3, 3] - centre
    moved[:, :3, 3] = centre + x[:, :3] + np.einsum("nij,nj->ni", turn, arm)
    return moved


def minimise(rows: Array) -> tuple[Array, Array]:
    """Minimum (N, 4, 4) of N draws of n markers' rows (N, n, 18), and the squares (N,) there."""
    T, squares = np.empty((len(rows), 4, 4)), np.empty(len(rows))
    for start in range(0, len(rows), constants.CHUNK):
        part = slice(start, start + constants.CHUNK)
        T[part], squares[part] = _minimise(rows[part])
    return T, squares


def _minimise(rows: Array) -> tuple[Array, Array]:
    """The same for one chunk; draws that have settled leave the work."""
    centre = rows[..., 3:6].mean(axis=1)
    T = rigid_match(rows[..., :3], rows[..., 3:6])
    H, g, square = derivatives(rows, T, centre)
    mu, active = np.zeros(len(rows)), np.arange(len(rows))
    for _ in range(constants.STEPS):
        x = _step(H[active], g[active], mu[active])
        last = np.abs(x).max(axis=1) <= constants.NEARLY
        done = active[last]
        T[done] = move(T[done], centre[done], x[last])
        active, x = active[~last], x[~last]
        if not len(active):
            break
        trial = move(T[active], centre[active], x)
        H2, g2, square2 = derivatives(rows[active], trial, centre[active])
        better = square2 <= square[active] * (1 + constants.NO_WORSE)
        kept = active[better]
        T[kept], H[kept], g[kept] = trial[better], H2[better], g2[better]
        square[kept] = square2[better]
        mu[kept] = np.where(
            mu[kept] > constants.LEAST_DAMPING, mu[kept] / constants.MORE_DAMPING, 0.0
        )
        worse = active[~better]
        mu[worse] = np.maximum(constants.MORE_DAMPING * mu[worse], constants.LEAST_DAMPING)
        active = active[mu[active] < constants.HOPELESS]
        if not len(active):
            break
    return T, square


def _step(H: Array, g: Array, mu: Array) -> Array:
    """Damped steps (N, 6); the damping makes up for a Hessian that has no minimum."""
    size = np.abs(np.diagonal(H, axis1=1, axis2=2))
    damped = np.asarray(H + mu[:, None, None] * size[:, :, None] * np.eye(6), dtype=np.float64)
    x = np.linalg.solve(damped, g[..., None])[..., 0]
    return -x.astype(np.float64)


def judged_fit(markers: Markers, T: Array) -> Judgement:
    """Whether ``T_RC`` (4, 4) is a minimum, by the derivatives of the statement there."""
    centre = markers.robot.mean(axis=0)
    H, g, square = derivatives(markers.rows[None], T[None], centre[None])
    about = Gram(H[0], g[0], float(square[0]), 3.0 * len(markers))
    return Judgement.of([judged_by_gram(about, "the fit of the markers")])


@lru_cache(maxsize=16)
def best_fit(markers: Markers) -> tuple[Array, float]:
    """The most probable ``T_RC`` (4, 4) and its sum of whitened squares, of 3 n - 6 freedoms."""
    T, squares = minimise(markers.rows[None])
    return T[0], float(squares[0])


@dataclass(frozen=True)
class Kabsch(Declared):
    """All markers weigh the same, along all axes."""

    #: also find the scale; rigid bodies have none, but a CT's pitch may be wrong
    scale: bool = False

    name: ClassVar[str] = "kabsch"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        T_RC = rigid_match(markers.ct, markers.robot, scale=self.scale)
        size = float(np.cbrt(np.linalg.det(T_RC[:3, :3])))
        centre = markers.robot.mean(axis=0)
        J = sensitivity(_alike(markers), T_RC, centre, scale=self.scale)
        return Fit(T_RC, centre, J, tuple(range(len(markers))), size)

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m]; noise changes nothing."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        return rigid_match(c, r, scale=self.scale)


def _alike(markers: Markers) -> Markers:
    """The markers as this method sees them: one covariance for all, in the robot's frame."""
    n = len(markers)
    one = np.broadcast_to(np.eye(3), (n, 3, 3))
    return replace(markers, ct_cov=np.zeros((n, 3, 3)), robot_cov=one)


@dataclass(frozen=True)
class Anisotropic(Declared):
    """Each reading weighs by its own covariance; without any stated, it is Kabsch's fit."""

    # what solves the stated problem; damped Gauss-Newton steps if none is given
    solver: Solver | None = None

    name: ClassVar[str] = "anisotropic"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        T_RC = best_fit(markers)[0] if self.solver is None else _solved(self.solver, markers)
        centre = markers.robot.mean(axis=0)
        J = sensitivity(markers, T_RC, centre)
        every = tuple(range(len(markers)))
        return Fit(T_RC, centre, J, every, judged=judged_fit(markers, T_RC))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all draws with the same noise."""
        rows, _ = draws(ct, robot, noise)
        return minimise(rows)[0].reshape(*np.shape(ct)[:-2], 4, 4)


def draws(ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None) -> tuple[Array, Markers]:
    """Rows (N, n, 18) of draws (..., n, 3) [m] of markers with one noise, and the first of them."""
    c, r = (np.asarray(v, float).reshape(-1, *np.shape(v)[-2:]) for v in (ct, robot))
    first = Markers.of(c[0], r[0], noise)
    return rows_of(c, r, first.ct_cov, first.robot_cov), first


def _solved(solver: Solver, markers: Markers) -> Array:
    """``T_RC`` (4, 4) by a solver, from Kabsch's fit."""
    start, centre = rigid_match(markers.ct, markers.robot), markers.robot.mean(axis=0)
    found = solver.solve(problem(markers, start, centre), np.zeros(6))
    return move(start[None], centre[None], found.x[None])[0]
