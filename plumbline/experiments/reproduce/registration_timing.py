"""How long the three-point frame and least squares take, one by one and all draws at once.

One by one, as a robot's controller does it, both are written plainly in NumPy, each as short as it
can be; all at once they are the library's own. Rounds alternate between the methods, so that a busy
machine slows all alike; the median of the rounds counts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from plumbline.experiments.reproduce.registration_trial import Array, Trial, noise
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.registration import Kabsch, Method, ThreePoint

ROUNDS, SINGLES = 11, 100
BASELINES = {3: "ABC", 4: "ABCE", 5: "ABCDE"}


@dataclass(frozen=True)
class Ratio:
    """Time of least squares over that of the three-point frame."""

    single: float  # one registration after the other
    batch: float  # all draws at once


def ratios(trial: Trial) -> dict[str, Ratio]:
    """Of least squares on three, four and five markers."""
    cases: dict[str, tuple[str, Method, Callable[[Array, Array], Array]]] = {
        "three-point": ("ABC", ThreePoint(), three_point_once),
        **{
            f"least squares, {n} markers": (names, Kabsch(), least_squares_once)
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
    method: Method, once: Callable[[Array, Array], Array], ct: Array, robot: Array
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
    return _transform(R, robot[0] - R @ ct[0])


def least_squares_once(ct: Array, robot: Array) -> Array:
    """``T_RC`` (4, 4) of n markers (n, 3) [m]: Kabsch's rotation by one SVD."""
    p, q = ct.mean(axis=0), robot.mean(axis=0)
    U, _, Vt = np.linalg.svd((robot - q).T @ (ct - p))
    U[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = U @ Vt
    return _transform(R, q - R @ p)


def _transform(R: Array, t: Array) -> Array:
    return homogeneous(R, t)


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
