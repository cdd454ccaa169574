r"""The published phantom and its frame, and draws of its readings.

Markers A to E and lesions L, M, H in CT coordinates: table 1 of Chen et al. The robot coordinates
of the markers are not known any more; of the robot's frame there remain the lesion M as predicted
from A-B-C and, for theta = 10 deg and beta = 45 deg, tip and top of the needle. With the z axes of
CT and robot antiparallel, as a box on a table has them, a turn :math:`\varphi` about z and a shift
are left, found by least squares on the three points:

.. math:: R_{RC} = R_z(\varphi)\, \mathrm{diag}(1, -1, -1)

Methods are timed on them one by one, as a robot's controller does it, written plainly in NumPy,
each as short as it can be; and all draws at once, by the library's own. Rounds alternate between
the methods, so that a busy machine slows all alike; the median of the rounds counts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Self

import numpy as np

from plumbline.kinematics.frames import homogeneous
from plumbline.optim import registration
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import Needle, tip_and_top

MM = 1e-3  # [m/mm]

MARKERS = dict(
    zip(
        "ABCDE",
        MM
        * np.array([(10, 20, 147), (110, 120, 147), (60, -10, 80), (90, -10, 20), (20, 150, 147)]),
        strict=True,
    )
)
LESIONS = dict(
    zip("LMH", MM * np.array([(50, 150, 39), (50, 130, 63), (50, 120, 76)]), strict=True)
)
PITCH = MM * np.array([5.0, 1.0, 1.0])  # of the CT's readings: slices along x [m]
CONTROL = 0.1 * MM  # of the robot: 1 sigma per axis [m]
NEEDLE = Needle(length=401 * MM, standoff=150 * MM)
THETA, BETA = np.deg2rad(10.0), np.deg2rad(45.0)  # the paper's angle [rad]
PUBLISHED = MM * np.array(
    [(528.96, -325.92, 619.34), (554.75, -322.40, 471.62), (623.69, -313.01, 76.70)]
)  # lesion M, tip and top, robot coordinates [m]
ROUNDS, SINGLES = 11, 100  # whose median counts, and draws of each that are done one by one
BASELINES = {3: "ABC", 4: "ABCE", 5: "ABCDE"}


def published_frame() -> Array:
    """``T_RC`` (4, 4) [m] from the three published points."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    tip, top = tip_and_top(flip, LESIONS["M"], NEEDLE, THETA, BETA)
    ours = np.array([flip[:3, :3] @ LESIONS["M"], tip, top])
    a, b = (points[:, :2] - points[:, :2].mean(axis=0) for points in (ours, PUBLISHED))
    phi = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(phi), np.sin(phi)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ flip[:3, :3]
    return homogeneous(R, PUBLISHED.mean(axis=0) - (R @ flip[:3, :3] @ ours.mean(axis=0)))


def published_errors(T_RC: Array) -> tuple[float, float, float]:
    """Distances of lesion, tip and top from the published ones [m]."""
    tip, top = tip_and_top(T_RC, LESIONS["M"], NEEDLE, THETA, BETA)
    lesion = T_RC[:3, :3] @ LESIONS["M"] + T_RC[:3, 3]
    lesion_away, tip_away, top_away = np.linalg.norm(
        np.array([lesion, tip, top]) - PUBLISHED, axis=1
    )
    return float(lesion_away), float(tip_away), float(top_away)


def axis_tilt() -> float:
    """How far the published needle's angle from the z axis is from theta [rad]."""
    along = PUBLISHED[2] - PUBLISHED[0]
    return float(np.arccos(-along[2] / np.linalg.norm(along)) - THETA)


@dataclass(frozen=True, eq=False)
class Trial:
    """Draws of what CT and robot would read."""

    T_RC: Array  # the true frame (4, 4) [m]
    ct: Array  # markers as read in CT (N, 5, 3) [m]
    robot: Array  # markers as touched by the robot (N, 5, 3) [m]
    own: Array  # error of a lesion's own reading in CT (N, 3) [m]

    @classmethod
    def drawn(cls, T_RC: Array, draws: int, rng: np.random.Generator, *, normal: bool) -> Self:
        """Draw readings.

        CT errors are uniform over the pitch, as rounding to slices and pixels makes them; or, with
        ``normal``, normal with the same variances. The robot's are normal.
        """
        points = np.array(list(MARKERS.values()))
        shape = (draws, len(points) + 1, 3)
        off = rng.normal(0.0, np.sqrt(1 / 12), shape) if normal else rng.uniform(-0.5, 0.5, shape)
        off = off * PITCH
        touched = points @ T_RC[:3, :3].T + T_RC[:3, 3]
        robot = touched + rng.normal(0.0, CONTROL, (draws, len(points), 3))
        return cls(T_RC, points + off[:, :-1], robot, off[:, -1])

    def first(self, draws: int) -> Self:
        """The first of the draws."""
        return type(self)(self.T_RC, self.ct[:draws], self.robot[:draws], self.own[:draws])

    def chosen(self, names: str) -> tuple[Array, Array]:
        """Readings of some markers, (N, n, 3) each [m]."""
        k = ["ABCDE".index(name) for name in names]
        return self.ct[:, k], self.robot[:, k]

    def found(self, method: registration.Method, names: str) -> Array:
        """``T_RC`` (N, 4, 4) of every draw, from some of the markers."""
        return method.batch(*self.chosen(names), noise())

    def errors(self, T: Array, lesion: str) -> Array:
        """Found minus true place (N, 3) of a lesion [m], its own reading included."""
        f = LESIONS[lesion]
        found = np.einsum("nij,nj->ni", T[:, :3, :3], f + self.own) + T[:, :3, 3]
        return found - (self.T_RC[:3, :3] @ f + self.T_RC[:3, 3])

    def calculation_errors(self, T: Array) -> Array:
        """Misfit of each of the five markers (N, 5) [m], whose mean is eq. 16."""
        mapped = np.einsum("nij,nkj->nki", T[:, :3, :3], self.ct) + T[:, None, :3, 3]
        return np.linalg.norm(mapped - self.robot, axis=2)

    def coverage(self, T: Array, method: registration.Method, names: str, lesion: str) -> float:
        """Share of the draws within the 95 % region that is predicted at the true markers."""
        points = np.array([MARKERS[name] for name in names])
        robot = points @ self.T_RC[:3, :3].T + self.T_RC[:3, 3]
        recording = registration.build_fiducials(points, robot, noise=noise(), labels=tuple(names))
        answer = registration.register(recording, registration.RegistrationOptions(method))
        region = answer.tre(LESIONS[lesion], PITCH / np.sqrt(12.0))
        return float(region.foreseen.holds(self.errors(T, lesion)).mean())


def noise() -> registration.MarkerNoise:
    """How well markers are read: the stated resolutions, which the draws have exactly."""
    return registration.MarkerNoise.from_resolution(PITCH, CONTROL, freedoms=np.inf)


@dataclass(frozen=True)
class Ratio:
    """Time of least squares over that of the three-point frame."""

    single: float  # one registration after the other
    batch: float  # all draws at once


def ratios(trial: Trial) -> dict[str, Ratio]:
    """Of least squares on three, four and five markers."""
    cases: dict[str, tuple[str, registration.Method, Callable[[Array, Array], Array]]] = {
        "three-point": ("ABC", registration.ThreePoint(), three_point_once),
        **{
            f"least squares, {n} markers": (names, registration.Kabsch(), least_squares_once)
            for n, names in BASELINES.items()
        },
    }
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    for _ in range(ROUNDS):
        for name, (names, method, once) in cases.items():
            spent[name].append(_spent(method, once, *trial.chosen(names)))
    medians = {name: np.median(pairs, axis=0) for name, pairs in spent.items()}
    base = medians.pop("three-point")
    return {
        name: Ratio(float(t[0] / base[0]), float(t[1] / base[1])) for name, t in medians.items()
    }


def _spent(
    method: registration.Method, once: Callable[[Array, Array], Array], ct: Array, robot: Array
) -> tuple[float, float]:
    pairs = list(zip(ct[:SINGLES], robot[:SINGLES], strict=True))
    stated = noise()
    start = perf_counter()
    for c, r in pairs:
        once(c, r)
    middle = perf_counter()
    method.batch(ct, robot, stated)
    return middle - start, perf_counter() - middle


def three_point_once(ct: Array, robot: Array) -> Array:
    """``T_RC`` (4, 4) of three markers (3, 3) [m]: two frames and a product."""
    R = _axes(robot).T @ _axes(ct)
    return homogeneous(R, robot[0] - R @ ct[0])


def least_squares_once(ct: Array, robot: Array) -> Array:
    """``T_RC`` (4, 4) of n markers (n, 3) [m]: Kabsch's rotation by one SVD."""
    p, q = ct.mean(axis=0), robot.mean(axis=0)
    U, _, Vt = np.linalg.svd((robot - q).T @ (ct - p))
    U[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = U @ Vt
    return homogeneous(R, q - R @ p)


def _axes(m: Array) -> Array:
    """Rows ``e1, e2, e3`` (3, 3) of three markers (3, 3)."""
    along, side = m[1] - m[0], m[2] - m[0]
    normal = _cross(along, side)
    e1, e3 = along / np.sqrt(along @ along), normal / np.sqrt(normal @ normal)
    return np.array([e1, _cross(e3, e1), e3])


def _cross(a: Array, b: Array) -> Array:
    """What np.cross does, without its overhead for one pair."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
