"""The leading explanations of a recording: the states of the joint posterior, by their causes.

A state is a set of terms with its posterior probability. States that differ in variants of a cause
(a moment, an order) or in single gross rows are one explanation, as probable as all of them
together and represented by the best; a state with an unlisted mechanism is none.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.design.separation import Rivals
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.prior import LEAST_TOLD, WIDE_PRIOR
from plumbline.optim.diagnosis.verdict.words import blame_of
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.model.making import number_of

NOTHING = "no effect"


@dataclass(frozen=True)
class LeadingExplanation:
    """One model of the recording."""

    # its effects as the selection problem numbers them, with the scales of their priors
    terms: tuple[SelectedTerm, ...]
    keys: frozenset[Key]  # what a verdict would call them
    probability: float  # how probable it is among the library's explanations
    label: str  # its causes in words

    @classmethod
    def of(
        cls, selection: SelectionProblem, terms: tuple[SelectedTerm, ...], probability: float
    ) -> Self:
        """Some of all candidates; an effect of the user's own is called by its stage."""
        keys, candidates = selection.keys(terms), selection.candidates
        chosen = [candidates[c.index] for c in terms]
        named = [blame_of(key, chosen).label for key in sorted(keys, key=str)]
        return cls(terms, keys, probability, " and ".join(named) if named else NOTHING)


def explanations(selected: SelectedModel, most: int = 6) -> tuple[LeadingExplanation, ...]:
    """What may explain a recording, the most probable first.

    Args:
        selected: Where the search ended, with the states of the joint posterior about it.
        most: How many explanations at the most.
    """
    selection = selected.selection
    states = selected.states or ((0.0, selected.chosen),)
    weights = np.exp([log - states[0][0] for log, _ in states])
    best: dict[frozenset[Key], tuple[SelectedTerm, ...]] = {}
    share: dict[frozenset[Key], float] = {}
    for weight, (_, terms) in zip((weights / weights.sum()).tolist(), states, strict=True):
        keys = selection.keys(terms)
        best.setdefault(keys, terms)  # the best state comes first
        share[keys] = share.get(keys, 0.0) + weight
    found = [LeadingExplanation.of(selection, best[keys], p) for keys, p in share.items()]
    # Ties are broken by name, so that the order of the library does not matter.
    found.sort(key=lambda e: (-e.probability, e.label))
    return tuple(e for e in found[:most] if e.probability >= LEAST_TOLD)


@dataclass(frozen=True, eq=False)
class Contest:
    """Explanations as Gaussians about one linearisation."""

    rivals: Rivals  # the explanations
    # A model of all their effects at once; it starts where it is linearised, at the verdict's fit,
    # with all other effects at their null
    model: MeasurementModel
    sigma: float  # noise of one equation [m or rad]

    @property
    def weights(self) -> Array:
        """Factor (P,) from a Jacobian's columns to units of scale and noise."""
        return self.model.problem.scale / self.sigma

    def of(self, recording: str) -> Self:
        """Of several recordings the contest for rows of one of them; else itself.

        Args:
            recording: Its name; the first that says where the tip is, if empty.

        Raises:
            PlumblineError: There is none of that name.
        """
        whole = self.model.recording
        if whole.session is None:
            return self
        k = number_of(whole.session, recording)
        part = whole.session.parts[k]
        # Its rows with the columns of all, as the statement reads them; a path begins with them.
        own = replace(
            whole.select(whole.part == k),
            observation=part.observation,
            tool_offset=part.tool_offset,
            whole=None,
        )
        return replace(self, model=replace(self.model, recording=own))


def contest(selected: SelectedModel, candidates: tuple[LeadingExplanation, ...]) -> Contest:
    """Fit every explanation to the recording, linearised about the verdict's fit.

    Args:
        selected: Where the search ended.
        candidates: The explanations.
    """
    indices, old = sorted({c.index for e in candidates for c in e.terms}), selected.model
    effects = [*selected.fixed, *(selected.selection.candidates[i].effect for i in indices)]
    model = build_model(old.recording, effects, nuisance=old.nuisance, weights=old.problem.weights)
    model = replace(model, start=model.started(selected.best.by_name))
    linear = Linear.about(Mapped(model.problem).gram(model.start), model.start, model.problem.scale)
    sigma = float(np.sqrt(selected.selection.variance(selected.chosen)))
    terms = dict(zip(indices, model.terms[len(selected.fixed) :], strict=True))
    always = model.fixed + sum(len(e.parameters) for e in selected.fixed)
    # Priors in units of scale: wide about the fit of what is always fitted, else about the null.
    own = np.arange(len(model.start)) < model.fixed
    centre = np.where(own, model.start / model.problem.scale, 0.0)
    width, fits = np.full(len(own), WIDE_PRIOR), []
    for e in candidates:
        parts = [
            np.arange(terms[c.index].columns.start, terms[c.index].columns.stop) for c in e.terms
        ]
        for part, c in zip(parts, e.terms, strict=True):
            width[part] = c.scale
        columns = np.concatenate([np.arange(always), *parts])
        fits.append(_posterior(linear, columns, width[columns], centre[columns], sigma))
    weights = np.array([e.probability for e in candidates])
    rivals = Rivals(
        labels=tuple(e.label for e in candidates),
        probabilities=weights / weights.sum(),
        means=np.stack([mean for mean, _ in fits]),
        covariances=np.stack([C for _, C in fits]),
    )
    return Contest(rivals, model, sigma)


def _posterior(
    linear: Linear, columns: Columns, width: Array, centre: Array, sigma: float
) -> tuple[Array, Array]:
    """Mean (P,) and covariance (P, P) in units of scale, of the columns (k,) that a model has."""
    precision = 1.0 / width**2
    A = linear.G[np.ix_(columns, columns)] / sigma**2 + np.diag(precision)
    root = np.sqrt(np.diag(A))
    inverse = np.linalg.inv(A / np.outer(root, root)) / np.outer(root, root)
    size = len(linear.b)
    mean, C = np.zeros(size), np.zeros((size, size))
    target = linear.b[columns] / sigma**2 + precision * centre
    mean[columns] = inverse @ target
    C[np.ix_(columns, columns)] = (inverse + inverse.T) / 2
    return mean, C
