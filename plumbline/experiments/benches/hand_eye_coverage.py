"""Whether stated errors hold.

``python -m plumbline.experiments.benches.hand_eye_coverage [--json OUT]``

A reality that the model does not have: boards a little bent, an arm whose links and joint zeros are
off by 0.34 mm at the flange, and slanted beams that read too long by another amount in every
set-up. In how many of the set-ups does the truth lie within 1.96 stated standard errors: along the
beam, across it, and for the beam's direction?
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality.ranging import scene as ranging
from plumbline.experiments.reality.ranging.finder import Finder
from plumbline.experiments.reproduce.hand_eye_trials import PER_SCENE, programme, readings_of
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.calibrate import Calibration, HandEyeOptions, calibrate
from plumbline.optim.hand_eye.readings import Readings

DRAWS = 300  # set-ups: a share of 95 % is then known to 1.3 %
NORMAL_95 = 1.96  # standard errors that hold 95 % of a normal distribution
UNLIKE = ranging.Instrument(accuracy=0.34e-3)
MOST_SKEW = 0.4  # share of a spot's growth that is bias, at most: 0.1 mm at 30 deg
PARTS = {"r along the beam": [2], "r across the beam": [0, 1], "direction of v": [3, 4]}


def draws(seed: int, count: int) -> Iterator[tuple[Finder, Readings]]:
    """Range finders and their readings, `count` of them, `PER_SCENE` a programme."""
    for number in range(count):
        if number % PER_SCENE == 0:
            scene, planned = programme(seed, number, UNLIKE)
        rng = np.random.default_rng([seed, number, 2])
        skew = rng.uniform(0.0, MOST_SKEW)
        other = replace(scene, instrument=replace(scene.instrument, skew=skew))
        while True:
            mounted = ranging.remounted(other, rng)
            try:
                survey = ranging.calibration(mounted, rng, planned)
            except ValueError:  # a beam that misses its board
                continue
            break
        yield mounted.finder, readings_of(survey)


def measure(seed: int = 0, count: int = DRAWS) -> pd.DataFrame:
    """Coverage by the whole model, and by one whose arm and slanted beams are without error."""
    found, plain = [], []
    for truth, readings in draws(seed, count):
        found.append(errors(truth, calibrate(readings)))
        plain.append(errors(truth, calibrate(readings, HandEyeOptions(arm=0, bias=0.0))))
    whole, bare = np.array(found), np.array(plain)
    lines = []
    for what, columns in PARTS.items():
        true, stated = whole[:, 0, columns], whole[:, 1, columns]
        rms = [1e3 * float(np.sqrt(np.mean(x**2))) for x in (true, stated)]
        lines.append({
            "part": what, "covered": _covered(whole[:, :, columns]), "true [mm, mrad]": rms[0],
            "stated": rms[1], "covered, arm as drawn": _covered(bare[:, :, columns]),
        })  # fmt: skip
    return pd.DataFrame(lines)


def _covered(found: Array) -> float:
    """Share of true errors (N, 2, k) within 1.96 of the stated ones beside them."""
    return float(np.mean(np.abs(found[:, 0]) < NORMAL_95 * found[:, 1]))


def errors(truth: Finder, found: Calibration) -> Array:
    """True errors and stated ones (2, 5): of r across the beam, twice, and along, of v, twice."""
    across = np.linalg.svd(truth.v[None])[2][1:]
    axes = np.vstack([across, truth.v])
    r, v = found.beam.r - truth.r, found.beam.v - truth.v
    of_r = np.diag(axes @ found.covariance[:3, :3] @ axes.T)
    of_v = np.diag(across @ found.covariance[3:, 3:] @ across.T)
    stated = np.sqrt(np.concatenate([of_r, of_v]))
    return np.stack([np.concatenate([axes @ r, across @ v]), stated])


@as_command
def coverage(seed: int = 0, count: int = DRAWS) -> Found:
    """Measure how often the truth lies within the stated errors."""
    return {"set-ups unlike the model": measure(seed, count)}


if __name__ == "__main__":
    typer.run(coverage)
