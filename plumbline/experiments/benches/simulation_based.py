r"""Do parameters and probabilities come from the posterior that they are stated with?

``python -m plumbline.experiments.benches.simulation_based [--count N] [--seed S]``

Arms are drawn from the library itself: with chance one half one cause, its parameters from
:math:`N(0, \tau^2)` in units of their scales, :math:`\tau` 1 or 3, within their bounds. If the
posterior is right, the share of it below the truth is uniform (Talts, Betancourt, Simpson, Vehtari
and Gelman 2018, arXiv 1804.06788, theorem 1), and so is, with V uniform and p the probability of a
cause that is there (g = 1) or not (g = 0),

.. math:: u = (1 - g) (1 - p) V + g\, (1 - p V).

One parameter and one statement a case, so that all are independent. The band holds whole histograms
of uniform ranks in 95 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd
from scipy.stats import norm

from plumbline.experiments.benches.ar1 import clean, recorded
from plumbline.experiments.benches.asking import Asked, Verdict, counted, key_of, run_bench
from plumbline.experiments.console.measured import Found
from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.effects.effect import Effect
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.recording.recording import Recording

BINS = 10  # of a rank histogram: some ten draws a bin at a hundred cases (Talts 2018, sec. 5.1)
LEVEL = 0.95  # of the band
DRAWS = 10_000  # histograms from which the band is taken
NOTHING = 0.5  # chance that nothing is wrong
WIDTHS = (1.0, 3.0)  # in units of a parameter's scale
WORTH = 0.05  # least probability of a statement that is looked at
# Families that are scanned finely are left to the withheld check: their variants are never equal.
PLAIN = tuple(effect for effect in EFFECTS if effect.scanned is None and not effect.in_motion)


@dataclass(frozen=True)
class Histogram:
    """Ranks of one sort."""

    of: str  # parameters or probabilities
    ranks: int  # how many
    counts: tuple[int, ...]  # of each bin
    low: float  # lower edge of the band
    high: float  # upper edge
    inside: bool  # whether all bins lie within


@dataclass(frozen=True)
class Truth:
    """What was put into a recording."""

    key: Key | None  # effect and element; none if nothing is wrong
    variant: str = ""  # what tells it from its siblings
    values: tuple[tuple[str, float], ...] = ()  # its parameters by name [unit]


def histogram(name: str, ranks: Sequence[float]) -> Histogram:
    """Count ranks, 0 to 1, and hold them against the band."""
    counts = np.histogram(np.clip(ranks, 0.0, 1.0), BINS, (0.0, 1.0))[0]
    middle, reach = len(ranks) / BINS, _reach(len(ranks))
    inside = bool(np.abs(counts - middle).max() <= reach) if len(ranks) else True
    bins = tuple(int(c) for c in counts)
    return Histogram(name, len(ranks), bins, max(middle - reach, 0.0), middle + reach, inside)


@cache
def _reach(ranks: int) -> float:
    """How far the farthest bin of a uniform histogram is from its mean in 95 % of draws."""
    drawn = np.random.default_rng(0).multinomial(ranks, np.full(BINS, 1.0 / BINS), DRAWS)
    return float(np.quantile(np.abs(drawn - ranks / BINS).max(axis=1), LEVEL))


def drawn(recording: Recording, rng: np.random.Generator) -> tuple[Truth, Effect | None, Array]:
    """A cause from the prior, or none: its effect and its parameters."""
    scope = scope_of(recording)
    offered = [family.candidates(scope) for family in PLAIN]
    offered = [list(variants) for variants in offered if variants]
    if rng.random() < NOTHING:
        return Truth(None), None, np.zeros(0)
    variants = offered[int(rng.integers(len(offered)))]
    effect = variants[int(rng.integers(len(variants)))]
    width = float(rng.choice(WIDTHS))
    values = np.array([_within(p.lower, p.upper, p.scale * width, rng) for p in effect.parameters])
    named = zip((p.name for p in effect.parameters), values.tolist(), strict=True)
    return Truth((effect.name, effect.element), effect.variant, tuple(named)), effect, values


def _within(lower: float, upper: float, width: float, rng: np.random.Generator) -> float:
    """A normal number within bounds [unit]."""
    low, high = float(norm.cdf(lower / width)), float(norm.cdf(upper / width))
    return float(width * norm.ppf(rng.uniform(low, high)))


def with_cause(recording: Recording, effect: Effect, values: Array) -> Recording:
    """The recording as it would have been with the effect at work."""
    model = build_model(recording, [effect])
    there, null = model.start.copy(), model.start
    there[model.fixed :] = values
    mapped = Mapped(model.problem)
    moved = mapped.residuals(there) - mapped.residuals(null)
    return replace(recording, measured=recording.measured + moved.reshape(len(recording), -1))


def case_of(number: int, seed: int) -> tuple[Recording, Truth]:
    """One recording and what was put into it."""
    rng = np.random.default_rng([seed, number, 37])
    case = clean(number, seed)
    ideal = recorded(case, np.zeros((case.rows, 3)))
    truth, effect, values = drawn(ideal, rng)
    moved = ideal if effect is None else with_cause(ideal, effect, values)
    noise = rng.normal(0.0, case.noise_std, ideal.measured.shape)
    return replace(moved, measured=moved.measured + noise), truth


def rank_of_parameter(truth: Truth, verdict: Verdict, rng: np.random.Generator) -> float | None:
    """Share of the stated posterior below one of the true parameters; none if it is not named."""
    true = dict(truth.values)
    for cause in verdict["causes"]:
        if key_of(cause) == truth.key and cause.get("variant", "") == truth.variant:
            stated = cause["parameters"]
            known = [n for n in stated if n in true and float(stated[n].get("std") or 0.0) > 0.0]
            if known:
                name = str(rng.choice(known))
                off = true[name] - float(stated[name]["value"])
                return float(norm.cdf(off / float(stated[name]["std"])))
    return None


def rank_of_probability(truth: Truth, verdict: Verdict, rng: np.random.Generator) -> float | None:
    """Rank of whether a cause is there within its probability; none if nothing is stated."""
    stated: dict[Key, float] = {}
    for cause in (*verdict["causes"], *verdict.get("candidates", ())):
        key = key_of(cause)
        stated[key] = max(stated.get(key, 0.0), min(float(cause["probability"]), 1.0))
    worth = sorted((key for key, p in stated.items() if p >= WORTH), key=str)
    if not worth:
        return None
    key, v = worth[int(rng.integers(len(worth)))], float(rng.random())
    return 1.0 - stated[key] * v if key == truth.key else (1.0 - stated[key]) * v


def found(ask: Asked, count: int, seed: int) -> Found:
    """Draw, ask and rank."""
    parameters, probabilities = [], []
    for number in counted(range(count), "case"):
        recording, truth = case_of(number, seed)
        verdict = ask(recording)
        rng = np.random.default_rng([seed, number, 41])
        parameters.append(rank_of_parameter(truth, verdict, rng))
        probabilities.append(rank_of_probability(truth, verdict, rng))
    sorts = {"parameters": parameters, "probabilities": probabilities}
    made = [histogram(n, [r for r in ranks if r is not None]) for n, ranks in sorts.items()]
    table = pd.DataFrame({h.of: h.counts for h in made})
    table.insert(0, "rank from", [k / BINS for k in range(BINS)])
    bands = [{"of": h.of, "low": h.low, "high": h.high, "inside": h.inside} for h in made]
    return {"ranks": table, "band of 95 %": pd.DataFrame(bands)}


if __name__ == "__main__":
    WORDS = "Rank the truth within what is stated, over arms drawn from the library."
    run_bench(found, WORDS, 200)
