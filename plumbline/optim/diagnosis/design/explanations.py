r"""The leading explanations of a recording: the verdict, and what else its rows leave possible.

The verdict is one model among its neighbours, in which one cause is swapped for another, left out
or added. Against the verdict such a neighbour has the odds that the search gave it, slot by slot,

.. math:: \frac{P(\text{swapped})}{P(\text{verdict})} = \frac{w_{c'} B_{c'}}{w_c B_c}, \qquad
          \frac{P(\text{left out})}{P(\text{verdict})} = \frac{1 - \pi}{\pi\, w_c B_c}

Variants of one cause (a moment, an order) count as one explanation, represented by the best.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.design.separation import Rivals
from plumbline.optim.diagnosis.findings import Key, Verdict
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.prior import (
    EXCLUDED_SHARE,
    LEAST_WEIGHT,
    MOST_LOG_ODDS,
    NO_EVIDENCE,
    NUISANCE_WIDTH,
    WIDE_PRIOR,
)
from plumbline.optim.diagnosis.verdict.words import blame_of
from plumbline.optim.measurement.observation import Model, build_model

NOTHING = "no effect"


@dataclass(frozen=True)
class Explanation:
    """One model of the recording.

    Attributes:
        terms: Its effects as the selection problem numbers them, with the scales of their priors.
        keys: What a verdict would call them.
        weight: How probable it is, the verdict's own model being one.
        label: Its causes in words.
    """

    terms: tuple[SelectedTerm, ...]
    keys: frozenset[Key]
    weight: float
    label: str

    @classmethod
    def of(
        cls, selection: SelectionProblem, terms: tuple[SelectedTerm, ...], weight: float
    ) -> Explanation:
        """Some of all candidates; an effect of the user's own is called by its stage."""
        keys, candidates = selection.keys(terms), selection.candidates
        chosen = [candidates[c.index] for c in terms]
        named = [blame_of(key, chosen).label for key in sorted(keys, key=str)]
        return cls(terms, keys, weight, " and ".join(named) if named else NOTHING)


def explanations(
    selected: SelectedModel, verdict: Verdict, most: int = 6
) -> tuple[Explanation, ...]:
    """The verdict's model and its most probable neighbours, the most probable first.

    What the verdict calls confounded with a cause counts for no less than the data allow.

    Args:
        selected: Where the search ended.
        verdict: What was made of it.
        most: How many explanations at the most.
    """
    merged: dict[frozenset[Key], Explanation] = {}
    for one in _neighbours(selected):
        old = merged.get(one.keys)
        best = one if old is None or one.weight > old.weight else old
        merged[one.keys] = replace(best, weight=one.weight + (old.weight if old else 0.0))
    own = merged.pop(selected.selection.keys(selected.chosen))
    for keys in _confounded(selected, verdict):
        if keys in merged:
            least = float(np.exp(-NO_EVIDENCE))
            merged[keys] = replace(merged[keys], weight=max(merged[keys].weight, least))
    others = [e for e in merged.values() if e.weight >= LEAST_WEIGHT]
    # Ties are broken by name, so that the order of the library does not matter.
    others.sort(key=lambda e: (-e.weight, e.label))
    kept = [replace(own, weight=max(own.weight, 1.0)), *others[: most - 1]]
    return tuple(sorted(kept, key=lambda e: -e.weight))


def _neighbours(selected: SelectedModel) -> Iterator[Explanation]:
    """The model itself, then one slot changed, emptied or added at a time."""
    selection, chosen = selected.selection, selected.chosen
    reduced = selection.reduce(chosen)
    yield Explanation.of(selection, chosen, 1.0)
    for slot in chosen:
        log_odds, scores = selection.scan(reduced.without(slot))
        kept = tuple(c for c in chosen if c.index != slot.index)
        gain = float(log_odds[slot.index])
        yield Explanation.of(selection, kept, _weight(-gain))
        log_odds = log_odds - gain
        for i in np.flatnonzero(log_odds > np.log(LEAST_WEIGHT)).tolist():
            if i != slot.index:
                model = (*kept, SelectedTerm(i, float(scores.scale[i])))
                yield Explanation.of(selection, model, _weight(log_odds[i]))
    log_odds, scores = selected.whole_selection.scan(reduced)
    for i in np.flatnonzero(log_odds > np.log(LEAST_WEIGHT)).tolist():
        model = (*chosen, SelectedTerm(i, float(scores.scale[i])))
        excluded = selection.candidates[i].key in selected.excluded
        weight = min(_weight(log_odds[i]), EXCLUDED_SHARE if excluded else np.inf)
        yield Explanation.of(selection, model, weight)


def _weight(log_odds: float) -> float:
    """Odds against the verdict's model; those of a cause that was excluded may be beyond all."""
    return float(np.exp(min(log_odds, MOST_LOG_ODDS)))


def _confounded(selected: SelectedModel, verdict: Verdict) -> Iterator[frozenset[Key]]:
    own = selected.selection.keys(selected.chosen)
    for cause in verdict.causes:
        for rival in cause.confounded_with:
            yield (own - {(cause.effect, cause.element)}) | {(rival.effect, rival.element)}


@dataclass(frozen=True, eq=False)
class Contest:
    """Explanations as Gaussians about one linearisation.

    Attributes:
        rivals: The explanations.
        model: A model of all their effects at once; it starts where it is linearised, at the
            verdict's fit, with all other effects at their null.
        sigma: Noise of one equation [m or rad].
    """

    rivals: Rivals
    model: Model
    sigma: float

    @property
    def weights(self) -> Array:
        """Factor (P,) from a Jacobian's columns to units of scale and noise."""
        return self.model.problem.scale / self.sigma


def contest(selected: SelectedModel, candidates: tuple[Explanation, ...]) -> Contest:
    """Fit every explanation to the recording, linearised about the verdict's fit.

    Args:
        selected: Where the search ended.
        candidates: The explanations.
    """
    indices = sorted({c.index for e in candidates for c in e.terms})
    model = _all_together(selected, indices)
    linear = Linear.about(Mapped(model.problem).gram(model.start), model.start, model.problem.scale)
    sigma = float(np.sqrt(selected.selection.variance(selected.chosen)))
    terms = dict(zip(indices, model.terms[len(selected.fixed) :], strict=True))
    always = model.fixed + sum(len(e.parameters) for e in selected.fixed)
    prior = _Prior.of(model)
    fits = []
    for e in candidates:
        parts = [
            np.arange(terms[c.index].columns.start, terms[c.index].columns.stop) for c in e.terms
        ]
        for part, c in zip(parts, e.terms, strict=True):
            prior = prior.with_width(part, c.scale)
        fits.append(_posterior(linear, np.concatenate([np.arange(always), *parts]), prior, sigma))
    _, largest = _posterior(linear, np.arange(len(model.start)), prior, sigma)
    weights = np.array([e.weight for e in candidates])
    rivals = Rivals(
        labels=tuple(e.label for e in candidates),
        probabilities=weights / weights.sum(),
        means=np.stack([mean for mean, _ in fits]),
        covariances=np.stack([C for _, C in fits]),
        largest=largest,
    )
    return Contest(rivals, model, sigma)


def _all_together(selected: SelectedModel, indices: Sequence[int]) -> Model:
    """A model with some of the search's candidates, about the verdict's fit."""
    old = selected.model
    effects = [*selected.fixed, *(selected.selection.candidates[i].effect for i in indices)]
    model = build_model(old.recording, effects, nuisance=old.nuisance, weights=old.problem.weights)
    return replace(model, start=model.started(selected.best.by_name))


@dataclass(frozen=True, eq=False)
class _Prior:
    """Independent Gaussians over all unknowns (P,), in units of scale."""

    width: Array
    centre: Array

    @classmethod
    def of(cls, model: Model) -> _Prior:
        """Wide about the fit for what is always fitted, about the null for effects."""
        own = np.arange(len(model.start)) < model.fixed
        centre = np.where(own, model.start / model.problem.scale, 0.0)
        return cls(np.where(own, NUISANCE_WIDTH, WIDE_PRIOR), centre)

    def with_width(self, columns: Columns, width: float) -> _Prior:
        """The same with another width of some unknowns."""
        changed = self.width.copy()
        changed[columns] = width
        return replace(self, width=changed)


def _posterior(
    linear: Linear, columns: Columns, prior: _Prior, sigma: float
) -> tuple[Array, Array]:
    """Mean (P,) and covariance (P, P) in units of scale, of the columns that a model has."""
    precision = 1.0 / prior.width[columns] ** 2
    A = linear.G[np.ix_(columns, columns)] / sigma**2 + np.diag(precision)
    root = np.sqrt(np.diag(A))
    inverse = np.linalg.inv(A / np.outer(root, root)) / np.outer(root, root)
    size = len(linear.b)
    mean, C = np.zeros(size), np.zeros((size, size))
    target = linear.b[columns] / sigma**2 + precision * prior.centre[columns]
    mean[columns] = inverse @ target
    C[np.ix_(columns, columns)] = (inverse + inverse.T) / 2
    return mean, C
