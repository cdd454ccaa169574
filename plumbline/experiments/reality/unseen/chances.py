"""What every draw of an unseen mechanism asks for: a joint, a load, a direction."""

import numpy as np

from plumbline.experiments.reality.arm import Array, load_torque
from plumbline.experiments.reality.scene import Scene

TURN = 2.0 * np.pi
LOADED = 0.05  # least swing of a joint's load over the largest of all joints


def turning(scene: Scene, rng: np.random.Generator) -> int:
    """A revolute joint, from 1."""
    return int(rng.choice(np.flatnonzero(~scene.arm.prismatic))) + 1


def loaded(scene: Scene, rng: np.random.Generator) -> tuple[int, float]:
    """A revolute joint, from 1, whose load changes, and the largest load [N m] that it bears."""
    torque = np.where(scene.arm.prismatic, 0.0, torques(scene))
    swing = np.ptp(torque, axis=0)
    joint = int(rng.choice(np.flatnonzero(swing >= LOADED * swing.max())))
    return joint + 1, float(np.abs(torque[:, joint]).max())


def torques(scene: Scene) -> Array:
    """Gravity's load on every joint (N, n) [N m, or N for a slide]."""
    return load_torque(scene.arm, scene.frames())


def unit(rng: np.random.Generator) -> tuple[float, ...]:
    """A direction (3,), every one as likely."""
    u: Array = rng.normal(size=3)
    return tuple(float(v) for v in u / np.linalg.norm(u))


def sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(rng.choice([-1.0, 1.0]))


def seconds(scene: Scene, low: float, high: float, rng: np.random.Generator) -> float:
    """A time [s] between two shares of the session's length."""
    return float(rng.uniform(low, high) * np.ptp(scene.session.time))
