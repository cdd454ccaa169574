r"""Whether what the causes leave is more than noise: lack of fit.

What is left of n readings has a square of :math:`r^2` times that of the noise, which is known as
from :math:`\nu` readings. If it is noise, :math:`r^2 \sim F_{n, \nu}`; if something unlisted as
large as :math:`\tau` comes in that follows nothing recorded, :math:`r^2 \sim (1 + \tau^2 /
\sigma^2) F_{n, \nu}`, with :math:`\tau` summed over the sizes of all effects.

Standard errors from blocks of rows: how far estimates move when a block is left out.

Where something is missing in the model, what it leaves is no noise: rows near each other err alike,
and however many they are, the estimates of another recording differ by more than the rows' number
tells. With the normal equations A and gradient g of each block b, one step of Gauss and Newton from
the fit of all rows gives the fit without it, and the jackknife (Efron and Tibshirani 1993, ch. 11;
by blocks, Kuensch 1989, Annals of Statistics 17(3))

.. math:: \delta_b = (A - A_b)^{-1} g_b, \qquad
          s^2 = \frac{B - 1}{B} \sum_b (\delta_b - \bar\delta)^2.

The same is taken of the fits without each fold, for which effects were chosen anew: what is chosen
together with an effect moves its estimate too. The larger counts.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtrc, expit, fdtr, logit, logsumexp

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import JITTER
from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.linearise.linear import solved
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.folds import blocks_of
from plumbline.optim.diagnosis.predict.held_out import Evaluation
from plumbline.optim.diagnosis.predict.shrink import FoldModel
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible

SIZES = np.geomspace(
    prior.SCALES[0], prior.SCALES[-1], 201
)  # usual ones, as finely as a noise may be known
LOG_SIZE_WEIGHTS = np.interp(np.log(SIZES), np.log(prior.SCALES), prior.LOG_SCALE_WEIGHTS)
LOG_SIZE_WEIGHTS = LOG_SIZE_WEIGHTS - logsumexp(LOG_SIZE_WEIGHTS)


def lack_of_fit(noise: NoiseLevel, selected: SelectedModel) -> float:
    """Probability that what is left is of something unlisted that follows nothing recorded.

    A noise that is implausible is none. Else the noise may be larger than it is stated, or than
    repeats tell.
    """
    if noise.sigma > plausible(selected.model.recording):
        return 1.0
    if noise.source == "fit":
        return 0.0
    more = 1.0 + np.append(0.0, (prior.USUAL * SIZES / noise.sigma) ** 2)
    left = max(noise.ratio, prior.ROUNDING) ** 2 / more
    n, known = freedom_of(selected), 3 * noise.repeats or prior.STATED_NOISE_FREEDOM
    alone, *shaped = 0.5 * (n * np.log(left) - (n + known) * np.log(known + n * left))
    return float(
        expit(logit(prior.UNLISTED * prior.FORMLESS) + logsumexp(shaped + LOG_SIZE_WEIGHTS) - alone)
    )


def is_noisier(noise: NoiseLevel, selected: SelectedModel) -> bool:
    """Whether what is left exceeds a stated noise by far and not by chance, as noise may."""
    n = freedom_of(selected)
    above = noise.ratio > prior.EARNED and chdtrc(n, n * noise.ratio**2) < prior.ALARM
    return bool(above) and noise.source == "given" and lack_of_fit(noise, selected) <= 0.5


def is_quieter(noise: NoiseLevel, selected: SelectedModel) -> bool:
    """Whether what is left is below a stated noise by more than chance and its own error are."""
    return bool(list(quieter(noise, freedom_of(selected), "")))


def quieter(noise: NoiseLevel, freedom: float, unit: str) -> Iterator[str]:
    """What is said of a stated noise [unit] that so many readings of what is left are far below."""
    below = fdtr(freedom, prior.STATED_NOISE_FREEDOM, noise.ratio**2) < prior.ALARM
    if below and noise.source == "given":
        yield (
            f"noise smaller than stated: {quantity(noise.ratio * noise.sigma, unit)} a reading is "
            f"left, {noise.ratio:.2g} times noise_std, which hides what is smaller; leave it out, "
            "and it is estimated"
        )


def freedom_of(selected: SelectedModel) -> float:
    """Readings that the fit leaves."""
    return float(max(selected.best.gram.count - selected.best.problem.size, 1.0))


def implausible_noise(
    recording: Recording, noise: NoiseLevel, evaluation: Evaluation, *, timed: bool
) -> float:
    """What is taken for noise [m or rad] where no set-up that is right leaves as much; else 0.

    Where nothing but the fit tells the noise, rows left out tell how much of it the fit hides,
    unless a cause runs with time, which they do not foretell.
    """
    left = noise.sigma
    if noise.source == "fit" and not timed:
        left = max(left, evaluation.rms_after / evaluation.per_point)
    return left if left > plausible(recording) else 0.0


def is_far(gap: Gap, noise: NoiseLevel) -> bool:
    """Whether rows left out are missed by far more than their noise, whatever the fit leaves."""
    return noise.source != "fit" and gap.is_far


def noisiest_joint(recording: Recording, selected: SelectedModel) -> str:
    """What is said where a joint's second encoder scatters more than the others', if one does."""
    joint, ratio, _ = _noisiest(recording, selected)
    found = ratio**2 >= prior.ANISOTROPY
    return f"joint {joint}'s error changes from reading to reading" if found else ""


def noisier_encoder(recording: Recording, selected: SelectedModel) -> Iterator[str]:
    """What is said of noise that is stated for all, where that of one is more, not by chance."""
    joint, ratio, chance = _noisiest(recording, selected)
    if ratio**2 >= prior.ANISOTROPY and chance < prior.ALARM:
        yield (
            f"joint {joint}'s second encoder scatters {ratio:.2g} times as much as all of them do: "
            "its own noise, or an error that changes from reading to reading"
        )


def _noisiest(recording: Recording, selected: SelectedModel) -> tuple[int, float, float]:
    """Of second encoders the joint that scatters most, by how many times all do, and its chance."""
    if not recording.kind.encoders:
        return 0, 0.0, 1.0
    r = selected.best.mapped.residuals(selected.best.x)[selected.best.problem.weights > 0]
    each = np.mean(r**2, axis=0)
    k = int(np.argmax(each))
    ratio = each[k] / max(float(np.mean(each)), np.finfo(float).tiny)
    chance = each.size * chdtrc(len(r), len(r) * ratio)
    return recording.measured_joints[k] + 1, float(np.sqrt(ratio)), float(chance)


CAME = "depends on the way it came"  # of a joint


def turned_sides(selected: SelectedModel, words: str) -> Iterator[str]:
    """What is said where an unlisted side of approach is that of a play of less than nothing."""
    if not ("side of approach" in words or words.endswith(CAME)):
        return
    left = selected.selection.reduce(selected.chosen)
    pulls = {
        c.effect.element: left.b[c.columns][0]
        for c in selected.selection.candidates
        if isinstance(c.effect, Backlash) and c.effect.by == "direction"
    }
    joint = max(pulls, key=lambda j: abs(pulls[j]), default=None)
    if words.endswith(CAME) and words != f"joint {joint}'s error {CAME}":
        return
    if joint is not None and pulls[joint] < 0.0:
        yield (
            f"joint {joint} goes further on the side that it comes from, which no play does: "
            f"direction{joint} is 1 where it came from below"
        )


def block_errors(selected: SelectedModel, models: Sequence[FoldModel] = ()) -> Array:
    """Standard errors (P,) of a fit's unknowns.

    Args:
        selected: The model, fitted to all rows.
        models: What was chosen and fitted without each fold: where others are chosen with it, an
            effect's estimate moves further than without a block.
    """
    best, S = selected.best, selected.best.problem.scale
    blocks = blocks_of(selected.model.recording)
    A = best.gram.matrix * np.outer(S, S)
    ridge = JITTER * np.diag(np.diag(A))
    moved = np.array(
        [
            solved(A - gram.matrix * np.outer(S, S) + ridge, gram.vector * S) * S
            for gram in best.mapped.grams(best.x, blocks)
        ]
    )
    errors = np.sqrt((len(moved) - 1) * np.var(moved, axis=0))
    return np.maximum(errors, _chosen_anew(selected, models))


def _chosen_anew(selected: SelectedModel, models: Sequence[FoldModel]) -> Array:
    """Errors (P,) by the folds that chose an effect all the same; 0 where fewer than two did."""
    errors = np.zeros(selected.best.problem.size)
    values = [_values(model) for model in models]
    for term in selected.model.terms:
        found = np.array([known[term.effect] for known in values if term.effect in known])
        if len(found) > 1 and found.size:
            size = [p.scale for p in term.effect.parameters]
            errors[term.columns] = np.sqrt((len(models) - 1) * np.var(found, axis=0)) * size
    return errors


def _values(model: FoldModel) -> dict[Effect, Array]:
    """Each effect's values, in units of their scales."""
    ends = np.cumsum([len(effect.parameters) for effect in model.effects], dtype=int)
    pairs = zip(model.effects, ends, strict=True)
    return {effect: model.values[k - len(effect.parameters) : k] for effect, k in pairs}


def is_seen(recording: Recording, selected: SelectedModel, gap: Gap, chance: float) -> bool:
    """Whether rows that no fit has seen tell of a gap, whatever it is to be called.

    What foretells them does, and so do rows kept back that are missed by more than chance, of whose
    ratio to a noise that is known this is the limit, would miss them by.
    """
    if selected.chosen and gap.shrink_ci95[0] > 0.0:
        return True
    return recording.held_out is not None and gap.after > chance * gap.noise_floor
