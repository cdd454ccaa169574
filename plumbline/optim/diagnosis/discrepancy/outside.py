r"""The candidate that a closed list lacks: an unknown, smooth dependence on something recorded.

The verdict's model M competes with M and one family f of
:mod:`plumbline.optim.diagnosis.discrepancy.dependences`, and with every model in which f takes the
place of some causes S, so that no confounded effect hides the unknown:

.. math:: \log\frac{p(M \setminus S + f)}{p(M)} = \log B_f + \log\pi_f
          - \sum_{c \in S} (\log B_c + \log\pi_c)

each Bayes factor conditional on what is there already. What these models weigh together gives the
probability of the unknown, of what it depends on, and of every cause given it. Rows that are
distrusted count as one more cause, each shifted on its own, so that what they have in common is
told from chance: a family may take their place too. Components of a
reading may be noisier than others; both kinds of noise are weighed, so that no family is paid for
explaining the noise of one axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.dependences import Dependence, dependences
from plumbline.optim.diagnosis.discrepancy.jumps import LOG_GROSS
from plumbline.optim.diagnosis.discrepancy.model_comparison import ModelComparison
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.prior import (
    EXTREME,
    FAINT_ODDS,
    FIRST_SLOT_ODDS,
    HETEROSCEDASTIC,
    LEAST_SPREAD,
    MOST_COMPARED_ROWS,
    MOST_GROSS_ROWS,
    NEXT_SLOT_ODDS,
    NOISE_NEGLIGIBLE,
    RICHER,
    SLIPPED_ODDS,
    USUAL,
)
from plumbline.optim.measurement.observation import Model
from plumbline.optim.recording.recording import Recording

GROSS_ROWS: Key = ("gross rows", None)  # what is distrusted, as a cause that others may replace


@dataclass(frozen=True, eq=False)
class Outside:
    """What was found beyond the model's own effects.

    Attributes:
        log_odds: Log odds of any family, added or in place of whatever causes, against none.
        words: On what the best family depends.
        stage: Where it would sit.
        element: Its joint or link.
        inclusion: Inclusion probability of each cause, given the families.
        richer: The best family that holds a cause in a richer form and is more probable than its
            plain form, in words, by cause.
    """

    log_odds: float
    words: str
    stage: str
    element: int | None
    inclusion: Mapping[Key, float] = field(default_factory=dict)
    richer: Mapping[Key, str] = field(default_factory=dict)

    @classmethod
    def slipped(cls, rows: Sequence[int], inclusion: Mapping[Key, float]) -> Outside:
        """What rows (from 0) say that one shift of the tool displaced."""
        listed = ", ".join(str(k + 1) for k in rows)
        words = f"rows {listed}: one shift of the tool explains them"
        return cls(SLIPPED_ODDS, words, "tool", None, inclusion)

    @property
    def probability(self) -> float:
        """Probability that something smooth and unknown is at work."""
        return float(expit(self.log_odds))


def look_outside(
    model: Model,
    x: Array,
    noise: NoisePrior,
    fixed: int,
    seed: int = 0,
    log_priors: Mapping[Key, float] | None = None,
) -> Outside:
    """Let the families compete with a fitted model, added to it or in place of its causes.

    Args:
        model: Nuisances, then ``fixed`` effects that count as nuisances, then the chosen ones.
        x: Its fit (P,).
        noise: The prior of the noise.
        fixed: How many of its effects are always fitted.
        seed: Of the random features.
        log_priors: Log odds of each chosen cause before the data; even odds if not given.
    """
    rows = _rows(model, x)
    causes = _causes(model, fixed)
    always = min((int(c.min()) for c in causes.values()), default=model.problem.size)
    ports, z = Ports.about(model, x, rows, always), x / model.problem.scale
    offered = dependences(model.recording.select(rows), ports, noise, seed)
    found = [f for f in offered if f.columns.any()]  # what no row shows has no odds to keep
    priors = np.array([(log_priors or {}).get(key, 0.0) for key in causes])
    if ports.gross.any():
        missed = ports.target - np.einsum("pnm,p->nm", ports.base, z)
        z = np.concatenate([z, missed[ports.gross].ravel() / USUAL])
        priors = np.append(priors, ports.gross.sum() * LOG_GROSS)
        ports = ports.given(ports.own_shifts())
        causes[GROSS_ROWS] = np.arange(len(x), len(z))
    sets, log_weights = _weighed(ports, found, z, causes, priors, noise)
    outside = _summed(found, list(causes), sets, log_weights)
    if outside.log_odds > FAINT_ODDS:
        return outside
    noisiest = _noisiest_joint(model.recording, ports, z, noise.least)
    if noisiest is None:
        return replace(outside, words="", stage="", element=None)
    words = f"joint {noisiest}'s error changes from reading to reading"
    return replace(outside, words=words, stage="joint", element=noisiest)


def _rows(model: Model, x: Array) -> NDArray[np.intp]:
    """Rows that are looked at: distrusted ones too, if few and not far off.

    Nothing smooth moves one row by a hundred times what it moves the others; with such a row no
    width of a prior would fit both.
    """
    rows = _spread(len(model.recording))
    gross = model.problem.weights[rows] == 0
    if not gross.any():
        return rows
    if gross.sum() > MOST_GROSS_ROWS or gross.all():
        return rows[~gross]
    missed = np.linalg.norm(Mapped(model.problem).residuals(x)[rows], axis=1)
    usual = float(np.sqrt(np.mean(missed[~gross] ** 2)))
    return rows[~gross | (missed <= EXTREME * usual)]


def _weighed(
    ports: Ports,
    found: Sequence[Dependence],
    z: Array,
    causes: Mapping[Key, NDArray[np.intp]],
    log_priors: Array,
    noise: NoisePrior,
) -> tuple[list[tuple[int, ...]], Array]:
    """Sets of causes and log weights (S, F), summed over noise that is even and that is not."""
    spread = _spread_of_noise(ports, z, noise.least)
    even = ModelComparison.of(ports, found, noise)
    uneven = ModelComparison.of(ports.divided(spread), found, noise, spread)
    both = uneven.log_likelihood > even.log_likelihood - NOISE_NEGLIGIBLE
    comparisons = [even, uneven] if both else [even]
    likely = np.array([r.log_likelihood for r in comparisons])
    shares = likely - logsumexp(likely)
    answers = [r.weights(list(causes.values()), log_priors) for r in comparisons]
    weighed = [share + log for share, (_, log) in zip(shares, answers, strict=True)]
    return answers[0][0], np.asarray(logsumexp(weighed, axis=0))


def look_beyond(selected: SelectedModel, noise: NoisePrior, seed: int = 0) -> Outside:
    """The same of what a search has found.

    Args:
        selected: Where the search ended.
        noise: The prior of the noise.
        seed: Of the random features.
    """
    odds = np.log(NEXT_SLOT_ODDS if len(selected.chosen) > 1 else FIRST_SLOT_ODDS)
    priors: dict[Key, float] = {}
    for term in selected.chosen:
        candidate = selected.selection.candidates[term.index]
        priors[candidate.key] = priors.get(candidate.key, 0.0) + candidate.log_prior + odds
    return look_outside(selected.model, selected.best.x, noise, len(selected.fixed), seed, priors)


def _causes(model: Model, fixed: int) -> dict[Key, NDArray[np.intp]]:
    """Columns of every cause of a model, variants together."""
    found: dict[Key, NDArray[np.intp]] = {}
    for term in model.terms[fixed:]:
        key = (term.effect.name, term.effect.element)
        mine = np.arange(term.columns.start, term.columns.stop)
        found[key] = np.concatenate([found[key], mine]) if key in found else mine
    return found


def _summed(
    found: Sequence[Dependence],
    causes: Sequence[Key],
    sets: Sequence[tuple[int, ...]],
    log_weights: Array,
) -> Outside:
    """From log weights (S, F) of every family in place of every set, against the model itself.

    A family that holds a cause of the model in a richer form is no unknown; it is told apart.
    """
    same = np.array([[key in f.extends for f in found] for key in causes], dtype=bool)
    same = same.reshape(len(causes), len(found))
    unknown = ~same.any(axis=0)
    by_family = logsumexp(log_weights, axis=0)
    known = float(np.logaddexp(0.0, logsumexp(np.where(unknown, -np.inf, by_family))))
    best = found[int(np.argmax(np.where(unknown, by_family, -np.inf)))]
    log_odds = float(logsumexp(np.where(unknown, by_family, -np.inf))) - known
    whole = float(np.logaddexp(0.0, logsumexp(by_family)))
    inclusion, richer = {}, {}
    for i, key in enumerate(causes):
        if key == GROSS_ROWS:
            continue
        gone = np.array([i in members for members in sets])[:, None]
        lost = float(logsumexp(np.where(gone & ~same[i], log_weights, -np.inf)))
        inclusion[key] = float(1.0 - np.exp(min(lost - whole, 0.0)))
        mine = np.where(same[i], by_family, -np.inf)
        if mine.max(initial=-np.inf) > max(0.0, whole - RICHER):
            richer[key] = found[int(np.argmax(mine))].words
    return Outside(log_odds, best.words, best.stage, best.element, inclusion, richer)


def _spread_of_noise(ports: Ports, z: Array, least: float) -> Array:
    """RMS of every component of the residual (m,), over that of all; none is below the least."""
    r = ports.target - np.einsum("pnm,p->nm", ports.base, z)
    each = np.maximum(np.mean(r**2, axis=0), least**2)
    return np.asarray(np.sqrt(np.maximum(each / float(each.mean()), LEAST_SPREAD)))


def _noisiest_joint(recording: Recording, ports: Ports, z: Array, least: float) -> int | None:
    """The joint, from 1, whose second encoder scatters more than the others', if one does."""
    if recording.observation != "joint_position":
        return None
    spread = _spread_of_noise(ports, z, least)
    k = int(np.argmax(spread))
    return recording.measured_joints[k] + 1 if spread[k] >= HETEROSCEDASTIC else None


def _spread(count: int) -> NDArray[np.intp]:
    """At most :data:`MOST_ROWS` rows, evenly spread."""
    if count <= MOST_COMPARED_ROWS:
        return np.arange(count)
    return np.linspace(0, count - 1, MOST_COMPARED_ROWS).astype(np.intp)
