"""What draws of mechanisms ask for: a joint, a load, a direction, the size of a cloud."""

import numpy as np
from numpy.typing import ArrayLike

from plumbline.experiments.reality.arm import Array, load_torque
from plumbline.experiments.reality.body_effects import link_vector
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Scene

RANGES = Ranges("library")
TURN = 2.0 * np.pi  # [rad]
LOADED = 0.05  # least swing of a joint's load over the largest of all joints
LONG = 0.12  # [m] of a link that bends


def any_joint(scene: Scene, rng: np.random.Generator) -> int:
    """A joint, from 1."""
    return int(rng.integers(1, scene.arm.joints + 1))


def turning(scene: Scene, rng: np.random.Generator, beyond: int = 0) -> int:
    """A revolute joint, from 1, of those beyond a number."""
    joints = np.flatnonzero(~scene.arm.prismatic) + 1
    return int(rng.choice(joints[joints > beyond]))


def loaded(scene: Scene, rng: np.random.Generator) -> tuple[int, float]:
    """A revolute joint, from 1, whose load changes, and the largest load [N m] that it bears."""
    torque = np.where(scene.arm.prismatic, 0.0, torques(scene))
    swing = np.ptp(torque, axis=0)
    joint = int(rng.choice(np.flatnonzero(swing >= LOADED * swing.max())))
    return joint + 1, float(np.abs(torque[:, joint]).max())


def long_link(scene: Scene, rng: np.random.Generator) -> int:
    """A link behind a revolute joint, from 1, that is long enough to bend."""
    lengths = [np.linalg.norm(link_vector(scene, i)[0]) for i in range(scene.arm.joints)]
    return int(rng.choice(np.flatnonzero((np.array(lengths) > LONG) & ~scene.arm.prismatic))) + 1


def torques(scene: Scene) -> Array:
    """Gravity's load on every joint (N, n) [N m, or N for a slide]."""
    return load_torque(scene.arm, scene.frames())


def vector(values: ArrayLike) -> tuple[float, ...]:
    """Numbers (k,) as a mechanism keeps them."""
    return tuple(np.asarray(values, dtype=float).tolist())


def unit(rng: np.random.Generator) -> tuple[float, ...]:
    """A direction (3,), every one as likely."""
    u: Array = rng.normal(size=3)
    return vector(u / np.linalg.norm(u))


def twist(rng: np.random.Generator) -> tuple[float, ...]:
    """Weights (6,) of a base's motion."""
    return vector(RANGES.near("twist", rng, 6))


def phase(rng: np.random.Generator) -> float:
    """An angle within a turn [rad]."""
    return float(rng.uniform(0.0, TURN))


def sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(rng.choice([-1.0, 1.0]))


def spread(points: Array) -> float:
    """Root mean square distance of points (N, k) from their middle."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
