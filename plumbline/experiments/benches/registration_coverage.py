"""Coverage of registration: is a target where its region of 95 % says?

``python -m plumbline.experiments.benches.registration_coverage [--draws N]``

Markers and a target are scattered over 15 cm, read in CT and touched by a robot, in ways that the
model of the noise does not have: rounded to 5 mm slices, with heavy tails (Student's t of 3
freedoms), some markers worse than others, one of them moved, each touched 0.5 mm beside its middle,
or all with a pointer bent by 0.3 mm. The true error of the target, its own
reading in CT included, is held against the region, the noise stated rightly, 1.5 times too small,
or not at all.
"""

from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
import typer
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.console.measured import Found, as_command
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import Share
from plumbline.optim.registration import MarkerNoise, build_fiducials, register
from plumbline.optim.registration.constants import FINE
from plumbline.optim.registration.words import trust

MARKERS = (3, 4, 6, 10, 30)  # of a phantom
HALF = 75e-3  # [m] of the cube that markers lie in
NARROW = 25e-3  # [m]: markers that spread less along their second axis are drawn again
SLICES = (5e-3, 1e-3, 1e-3)  # [m] pitch of CT
THIN = (2e-3, 1e-3, 1e-3)  # [m] the same in thin slices
ALIKE = (1.4e-3, 1.4e-3, 1.4e-3)  # [m] and as fine along all axes
ROBOT = 0.15e-3  # [m] standard deviation of a touch
TOO_SMALL = 1.5  # true noise over the stated one, where that is misstated
STATED = {"rightly": 1.0, f"{TOO_SMALL:g} x too small": TOO_SMALL, "not": None}


@dataclass(frozen=True)
class Reality:
    """What is unlike the model."""

    pitch: tuple[float, float, float] = THIN  # of CT's readings (3) [m]
    # readings are rounded to the pitch; if not, normal with the same variance
    rounded: bool = False
    # freedoms of Student's t that CT and robot err by, scaled to the stated variance
    tails: float | None = None
    unlike: bool = False  # each marker is read 0.4 to 1.6 times as well as stated
    moved: bool = False  # the robot finds one marker 2 to 20 mm away
    aside: float = 0.0  # every touch is so far off the middle, in a direction of its own [m]
    together: float = 0.0  # all touches are off the middle by the same, as by a bent pointer [m]


REALITIES = {
    "as the model": Reality(),
    "alike axes": Reality(ALIKE),
    "5 mm slices": Reality(SLICES, rounded=True),
    "heavy tails": Reality(tails=3.0),
    "some worse": Reality(unlike=True),
    "one moved": Reality(moved=True),
    "0.5 mm aside": Reality(aside=0.5e-3),
    "pointer bent": Reality(together=0.3e-3),
}


@dataclass(frozen=True, eq=False)
class Draw:
    """One phantom."""

    ct: Array  # markers and, last, the target in CT (n + 1, 3) [m]
    robot: Array  # markers by the robot (n, 3) [m]
    target: Array  # where the target is, in the robot's frame (3,) [m]


def draw(reality: Reality, n: int, rng: np.random.Generator) -> Draw:
    """A phantom of n markers, read."""
    places = np.vstack([_scene(n, rng), rng.uniform(-0.8 * HALF, 0.8 * HALF, 3)])
    R, t = Rotation.random(rng=rng).as_matrix(), rng.uniform(-1.0, 1.0, 3)
    true = places @ R.T + t
    size = rng.uniform(0.4, 1.6, (n + 1, 1)) / np.sqrt(1.12) if reality.unlike else 1.0
    pitch = np.array(reality.pitch)
    if reality.rounded:
        phase = rng.uniform(size=3) * pitch
        ct = np.round((places + phase) / pitch) * pitch - phase
    else:
        ct = places + size * _errors(reality, n + 1, rng) * pitch / np.sqrt(12.0)
    robot = true[:-1] + ROBOT * _errors(reality, n, rng)
    robot += reality.aside * _directions(n, rng) + reality.together * _directions(1, rng)
    if reality.moved:
        robot[rng.integers(n)] += rng.uniform(2e-3, 20e-3) * _directions(1, rng)[0]
    return Draw(ct, robot, true[-1])


def _scene(n: int, rng: np.random.Generator) -> Array:
    """Places of n markers (n, 3) [m] that are not nearly on a line."""
    while True:
        points = rng.uniform(-HALF, HALF, (n, 3))
        if np.linalg.svd(points - points.mean(axis=0))[1][1] > NARROW * np.sqrt(n / 4):
            return points


def _errors(reality: Reality, n: int, rng: np.random.Generator) -> Array:
    """Errors (n, 3) of variance one."""
    nu = reality.tails
    if nu is None:
        return rng.normal(size=(n, 3))
    return rng.standard_t(nu, (n, 3)) / np.sqrt(nu / (nu - 2.0))


def _directions(n: int, rng: np.random.Generator) -> Array:
    d = rng.normal(size=(n, 3))
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


class Judged(NamedTuple):
    """One region: whether it held the target, was called good, and was as near as that promises."""

    held: bool
    good: bool
    near: bool
    half_axis: float


def measured(name: str, n: int, stated: str, draws: int, seed: int) -> dict[str, Any]:
    """One cell; the same phantoms however the noise is stated.

    Held are the regions that held the target; known the draws that were given a region; good those
    that were called good, of which so many were as near as that promises; half axis is the median
    of the regions' longest [mm].
    """
    reality, times = REALITIES[name], STATED[stated]
    number = list(REALITIES).index(name)
    noise = None
    if times is not None:
        noise = MarkerNoise.from_resolution(np.array(reality.pitch) / times, ROBOT / times)
    regions: list[Judged] = []
    for k in range(draws):
        drawn = draw(reality, n, np.random.default_rng([seed, number, n, k]))
        try:
            answer = register(build_fiducials(drawn.ct[:-1], drawn.robot, noise=noise))
        except PlumblineError:
            continue
        region = answer.tre(drawn.ct[-1], None)
        if region.unknown:
            continue
        error = region.robot - drawn.target
        regions.append(
            Judged(
                bool(region.holds(error)[0]),
                trust(answer, region, "it").startswith("it: good"),
                float(np.linalg.norm(error)) <= FINE,
                float(region.semi_axes()[0]),
            )
        )
    good = [r for r in regions if r.good]
    return {
        "noise": stated, "reality": name, "markers": n,
        "held": Share.count_of(sum(r.held for r in regions), len(regions)),
        "known": len(regions), "good": len(good), "good and near": sum(r.near for r in good),
        "half axis [mm]": 1e3 * float(np.median([r.half_axis for r in regions]))
        if regions else np.nan,
    }  # fmt: skip


@as_command
def coverage(
    draws: Annotated[int, typer.Option(min=1, help="Phantoms a cell.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> Found:
    """Measure how often a target lies in its region, in realities unlike the model."""
    cells = product(STATED, REALITIES, MARKERS)
    lines = [measured(name, n, stated, draws, seed) for stated, name, n in cells]
    return {f"targets inside their region of 95 %, {draws} draws": pd.DataFrame(lines)}


if __name__ == "__main__":
    typer.run(coverage)
