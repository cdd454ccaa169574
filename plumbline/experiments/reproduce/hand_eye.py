"""Range-finder hand-eye calibration on planes (Zeng et al. 2017) made again, beside ours.

The paper's instruments, simulated: 200 set-ups of a VS060-like arm before three boards, 60 readings
a board. Every method gets the same readings and is judged on marks that it has not seen.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from plumbline.experiments.reproduce import (
    ABOUT,
    Compared,
    Reproduction,
    Table,
    figure,
    hand_eye_trials,
)
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.hand_eye.constants import BIAS_STD

SET_UPS, DETAILED = 200, 25  # all, as in the paper, and those on which what takes longer is done
MM = 1e3  # in a metre
LONGEST = 40  # iterations of a selection loop that are shown
TOLD = ABOUT["hand-eye"]
METHODS = {key: words.format(gross=hand_eye_trials.GROSS) for key, words in TOLD["methods"].items()}
ACCURACY: dict[str, str] = TOLD["accuracy"]
PAPER: dict[str, dict[str, float]] = TOLD["paper"]  # mm


def run(
    seed: int, progress: Progress | None = None, *, set_ups: int = SET_UPS, detailed: int = DETAILED
) -> Reproduction:
    """Simulate the set-ups and try every method on each."""
    trials, details = trials_of(seed, progress, set_ups, detailed)
    found = figures(trials, details)
    rows = tuple((words, found[key]) for key, words in METHODS.items())
    shown = Compared("Repeatability on marks that no method has seen", rows)
    counts = {"trials": len(trials), "details": len(details)}
    told = Reproduction.of("hand-eye", found, tables(found), **counts)
    return replace(told, compared=(shown,))


def trials_of(
    seed: int, progress: Progress | None, set_ups: int, detailed: int
) -> tuple[list[hand_eye_trials.Trial], list[hand_eye_trials.Detail]]:
    """All trials, and the details of some."""
    chosen = set(np.linspace(0, set_ups - 1, detailed).astype(int).tolist())
    trials, details = [], []
    for number in range(set_ups):
        case = hand_eye_trials.set_up(seed, number)
        trials.append(hand_eye_trials.trial(case))
        if number in chosen:
            details.append(hand_eye_trials.detail(case, trials[-1], seed, number))
        (progress or silent)(f"set-up {number + 1} of {set_ups}", (number + 1) / set_ups)
    return trials, details


def figures(
    trials: Sequence[hand_eye_trials.Trial], details: Sequence[hand_eye_trials.Detail]
) -> dict[str, Any]:
    """The figures by name, mm and deg."""
    lengths = _joined([t.lengths for t in trials]) | _joined([d.lengths for d in details])
    angles = np.rad2deg(np.concatenate([d.angles for d in details]))
    found: dict[str, Any] = {
        key: _mm(values, **PAPER.get(key, {}))
        for key, values in lengths.items()
        if np.isfinite(values).all()  # without OpenCV there is no camera
    }
    found["best"]["half_of_three_planes"] = found["three_planes"]["value"] / 2.0
    return found | {
        "as_aimed": {
            key: _mm(values, paper=PAPER.get(key, {}).get("paper"))
            for key, values in _joined([t.as_aimed for t in trials]).items()
        },
        "angle_error": figure(
            float(angles.mean()), "deg", 0.4, std=float(angles.std()), max=float(angles.max())
        ),
        "gross": found["gross"] | _gross(trials, details),
        "selection": selection_figures(trials),
        "beta_over_alpha": [
            {"ratio": ratio, **_mm(np.array([d.ratios[k] for d in details]))}
            for k, ratio in enumerate(hand_eye_trials.RATIOS)
        ],
        "covariance": _honesty(trials),
    }


def _joined(several: Sequence[hand_eye_trials.Lengths]) -> hand_eye_trials.Lengths:
    return {key: np.concatenate([one[key] for one in several]) for key in several[0]}


def _gross(
    trials: Sequence[hand_eye_trials.Trial], details: Sequence[hand_eye_trials.Detail]
) -> dict[str, object]:
    chosen = np.linspace(0, len(trials) - 1, len(details)).astype(int)
    clean = float(np.mean([trials[k].lengths["best"] for k in chosen]))
    return {
        "share": hand_eye_trials.GROSS,
        "clean": clean * MM,
        "loss": float(np.mean([d.lengths["gross"] for d in details])) / clean - 1.0,
        "named": float(np.mean([d.named for d in details])),
        "three_planes": float(np.mean([d.spoilt_three for d in details])) * MM,
    }


def _honesty(trials: Sequence[hand_eye_trials.Trial]) -> dict[str, object]:
    """Root mean square of true errors over stated standard errors: 1 where they are honest."""
    error, std = np.array([(t.error, t.std) for t in trials]).T
    # The prior of a bias that these beams hardly have is r along the beam's, and nothing else's.
    plain = np.sqrt(std**2 - BIAS_STD**2)
    whole, without = (float(np.sqrt(np.mean((error / s) ** 2))) for s in (std, plain))
    return figure(whole, "1", without_bias=without)


def selection_figures(trials: Sequence[hand_eye_trials.Trial]) -> dict[str, object]:
    """The selection loop's mean curve, and at which iteration its minimum lay."""
    kept = np.array([s.kept for t in trials for s in t.selections])
    return {
        "kept": figure(float(np.median(kept)), "1", None, paper_iterations=[7, 4, 10]),
        "curve": (mean_curve(trials) * MM).tolist(),
        "unit": "mm",
    }


def mean_curve(trials: Sequence[hand_eye_trials.Trial]) -> Array:
    """Mean repeatability [m] over iterations, as far as half of the loops reach."""
    curves = [s.curve[:LONGEST] for t in trials for s in t.selections]
    reached = [sum(len(c) > k for c in curves) for k in range(LONGEST)]
    last = sum(count > len(curves) / 2 for count in reached)
    # Loops that ended earlier would leave the mean, and bend it: only those that reach the end.
    whole = [c[:last] for c in curves if len(c) >= last]
    return np.asarray(np.mean(whole, axis=0))


def tables(f: dict[str, Any]) -> tuple[Table, ...]:
    """The same for people."""
    aimed, curve = f["as_aimed"], f["selection"]["curve"]
    steps = range(0, len(curve), 4)
    shown = [key for key in METHODS if key in aimed]
    loop = ("repeatability", *(f"{curve[k]:.2f}" for k in steps))
    ratios = f["beta_over_alpha"]
    return (
        Table.of("hand-eye.methods", [(words, *_pair(f[key])) for key, words in METHODS.items()]),
        Table.of(
            "hand-eye.aimed",
            [(METHODS[k], _pair(f[k])[0], _pair(aimed[k])[0], _pair(f[k])[1]) for k in shown],
        ),
        Table.of(
            "hand-eye.accuracy",
            [(words, *_pair(f[key])) for key, words in ACCURACY.items() if key in f],
        ),
        Table.of("hand-eye.weights", [(f"{one['ratio']:.0e}", _pair(one)[0]) for one in ratios]),
        Table.of("hand-eye.loop", [loop], ("iteration", *map(str, steps))),
    )


def _pair(entry: dict[str, Any]) -> tuple[str, str]:
    ours = f"{entry['value']:.3f} ± {entry['std']:.3f}"
    paper = f"{entry['paper']:.2f}" if "paper" in entry else "–"
    spread = f" ± {entry['paper_std']:.2f}" if "paper_std" in entry else ""
    return ours, paper + spread


def _mm(values: Array, **paper: float | None) -> dict[str, Any]:
    """A figure of lengths [m] in mm: mean, std and largest."""
    v = values * MM
    return figure(float(v.mean()), "mm", std=float(v.std()), max=float(v.max()), **paper)
