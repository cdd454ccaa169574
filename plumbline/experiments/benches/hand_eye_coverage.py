"""Whether stated errors hold.

``python -m plumbline.experiments.benches.hand_eye_coverage [--json OUT]``

A reality that the model does not have: boards a little bent, an arm whose links and joint zeros are
off by 0.34 mm at the flange, and slanted beams that read too long by another amount in every
set-up. In how many of the set-ups does the truth lie within 1.96 stated standard errors: along the
beam, across it, and for the beam's direction?
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality.ranging.finder import Finder
from plumbline.experiments.reality.ranging.scene import (
    Instrument,
    Programme,
    Scene,
    calibration,
    draw_scene,
    plan,
    remounted,
)
from plumbline.experiments.reproduce.hand_eye_trials import PER_SCENE, readings_of
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.calibrate import Calibration, calibrate
from plumbline.optim.hand_eye.options import HandEyeOptions
from plumbline.optim.hand_eye.readings import Readings

DRAWS = 300  # set-ups: a share of 95 % is then known to 1.3 %
NORMAL_95 = 1.96  # standard errors that hold 95 % of a normal distribution
UNLIKE = Instrument(accuracy=0.34e-3)
MOST_SKEW = 0.4  # share of a spot's growth that is bias, at most: 0.1 mm at 30 deg
PARTS = {"r along the beam": [2], "r across the beam": [0, 1], "direction of v": [3, 4]}


@dataclass(frozen=True)
class Line:
    """One part of the answer."""

    what: str  # which
    covered: float  # share of true values within 1.96 standard errors
    error: float  # true error, root mean square [m or rad]
    std: float  # stated error, root mean square [m or rad]


@dataclass(frozen=True)
class Coverage:
    """All that was measured; names of the fields are the keys of the JSON."""

    draws: int
    lines: tuple[Line, ...]
    as_before: tuple[Line, ...]


def draws(seed: int, count: int) -> Iterator[tuple[Finder, Readings]]:
    """Range finders and their readings, `count` of them, `PER_SCENE` a programme."""
    for number in range(count):
        if number % PER_SCENE == 0:
            scene, programme = _planned(seed, number)
        rng = np.random.default_rng([seed, number, 2])
        skew = rng.uniform(0.0, MOST_SKEW)
        other = replace(scene, instrument=replace(scene.instrument, skew=skew))
        while True:
            mounted = remounted(other, rng)
            try:
                survey = calibration(mounted, rng, programme)
            except ValueError:  # a beam that misses its board
                continue
            break
        yield mounted.finder, readings_of(survey)


def _planned(seed: int, number: int) -> tuple[Scene, Programme]:
    rng = np.random.default_rng([seed, number, 1])
    while True:
        scene = draw_scene(rng, UNLIKE)
        try:
            return scene, plan(scene, rng)
        except ValueError:  # boards out of reach
            continue


def measure(seed: int = 0, count: int = DRAWS) -> Coverage:
    """Coverage by the whole model, and by one whose arm and slanted beams are without error."""
    found, plain = [], []
    for truth, readings in draws(seed, count):
        found.append(errors(truth, calibrate(readings)))
        plain.append(errors(truth, calibrate(readings, HandEyeOptions(arm=0, bias=0.0))))
    return Coverage(count, _lines(np.array(found)), _lines(np.array(plain)))


def errors(truth: Finder, found: Calibration) -> Array:
    """True errors and stated ones (2, 5): of r across the beam, twice, and along, of v, twice."""
    across = np.linalg.svd(truth.v[None])[2][1:]
    axes = np.vstack([across, truth.v])
    r, v = found.beam.r - truth.r, found.beam.v - truth.v
    of_r = np.diag(axes @ found.covariance[:3, :3] @ axes.T)
    of_v = np.diag(across @ found.covariance[3:, 3:] @ across.T)
    stated = np.sqrt(np.concatenate([of_r, of_v]))
    return np.stack([np.concatenate([axes @ r, across @ v]), stated])


def _lines(found: Array) -> tuple[Line, ...]:
    lines = []
    for what, columns in PARTS.items():
        true, stated = found[:, 0, columns], found[:, 1, columns]
        inside = np.abs(true) < NORMAL_95 * stated
        sizes = [float(np.sqrt(np.mean(x**2))) for x in (true, stated)]
        lines.append(Line(what, float(inside.mean()), *sizes))
    return tuple(lines)


def tables(found: Coverage) -> list[Table]:
    """How often the truth lies within the stated errors."""
    table = Table(title=f"{found.draws} set-ups unlike the model", title_justify="left")
    for heading in ("part", "covered", "true [mm, mrad]", "stated", "covered, arm as drawn"):
        table.add_column(heading, justify="left" if heading == "part" else "right")
    for line, before in zip(found.lines, found.as_before, strict=True):
        sizes = (f"{line.error * 1e3:.2f}", f"{line.std * 1e3:.2f}")
        table.add_row(line.what, f"{line.covered:.1%}", *sizes, f"{before.covered:.1%}")
    return [table]


def main(json: Json = None, seed: int = 0, count: int = DRAWS) -> None:
    """Measure how often the truth lies within the stated errors."""
    tell(lambda: measure(seed, count), tables, json)


if __name__ == "__main__":
    typer.run(main)
