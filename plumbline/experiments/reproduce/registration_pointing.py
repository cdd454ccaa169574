"""Sweeps of the needle about the published lesion M, planned for bundled arms."""

from dataclasses import dataclass
from time import perf_counter, process_time

import numpy as np

from plumbline.experiments.reproduce import registration_trial as trial
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import Aim, AngleMap, Box, Sweep, plan_sweep, safe_angle_map

# The markers lie on its top, z = 147 mm, and on its side, y = -10 mm; the other faces are guessed.
PHANTOM = Box((0.0, -10 * trial.MM, 0.0), (120 * trial.MM, 160 * trial.MM, 147 * trial.MM))
ANGLES = 100  # of a sweep
RINGS = np.deg2rad(np.arange(10.0, 61.0, 10.0))
AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 15.0))


@dataclass(frozen=True, eq=False)
class Pointed:
    """What an arm at the published place can do."""

    arm: str  # its name
    found: AngleMap  # which angles are safe
    sweep: Sweep  # the widest arc of safe azimuths at one theta
    published: Sweep  # the published angle alone
    first: float  # time of the first plan, compilation included [s]
    later: float  # median time of later plans [s]
    # median time of the processor in them, which other programs do not stretch [s]
    later_cpu: float

    @property
    def rcm_error(self) -> float:
        """Largest distance of the tool centre point from the lesion, by Pinocchio [m]."""
        return float(np.nanmax(self.sweep.rcm_error))


def phantom_aim(arm: str, T_RC: Array) -> Aim:
    """A bundled arm with the published needle at lesion M of the phantom."""
    return Aim(Robot.bundled(arm).chain(), T_RC, trial.LESIONS["M"], trial.NEEDLE, PHANTOM)


def pointed(arm: str, T_RC: Array, repeats: int = 3) -> Pointed:
    """Map the safe angles, then plan the widest arc of one ring."""
    aim = phantom_aim(arm, T_RC)
    found = safe_angle_map(aim, RINGS, AZIMUTHS)
    theta, beta = widest_arc(found)
    seconds = []
    for _ in range(1 + repeats):
        start, cpu = perf_counter(), process_time()
        sweep = plan_sweep(aim, theta, beta)
        seconds.append((perf_counter() - start, process_time() - cpu))
    published = plan_sweep(aim, trial.THETA, trial.BETA)
    later = np.median(seconds[1:], axis=0)
    return Pointed(arm, found, sweep, published, seconds[0][0], float(later[0]), float(later[1]))


def widest_arc(found: AngleMap, count: int = ANGLES) -> tuple[float, Array]:
    """The ring with the longest run of safe azimuths: its theta, and azimuths (count,) [rad]."""
    best, start, ring = 0, 0, 0
    for i, safe in enumerate(found.safe):
        for j, length in enumerate(_runs(safe)):
            if length > best:
                best, start, ring = length, j, i
    step = float(found.beta[1] - found.beta[0])
    first = float(found.beta[start])
    beta = first + step * max(best - 1, 0) * np.linspace(0.0, 1.0, count)
    return float(found.theta[ring]), beta - 2 * np.pi * (beta[-1] > 2 * np.pi)


def _runs(safe: Array) -> list[int]:
    """How many safe ones follow each of a ring's azimuths, itself included, going round once."""
    around = np.concatenate([safe, safe])
    count = len(safe)
    return [int(np.argmin(np.append(around[j : j + count], False))) for j in range(count)]
