"""Which effects: a path through the models that evidence leads.

Slots are filled until emptiness wins; every pair is tried, so that two effects that only work
together are found; then each slot is asked again in the light of the others, and those that depend
on the same at one place as a pair.
"""

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import (
    Candidate,
    NoisePrior,
)
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import (
    TermProblem,
    added_evidence,
    climbed,
    extended,
    numbers_of,
)


@dataclass(frozen=True, eq=False)
class SelectionProblem(TermProblem):
    """The selection problem: a linear problem without nuisances, its candidates and its noise."""

    linear: Linear  # the problem with the nuisances eliminated
    candidates: tuple[Candidate, ...]  # all candidates
    noise: NoisePrior  # the prior of the noise
    allowed: NDArray[np.bool_]  # which candidates may be chosen (C,)
    asked: NDArray[np.intp] = field(init=False)  # numbers of these
    # log of each candidate's share (C,), -inf for those that are not allowed
    log_priors: Array = field(init=False)
    of_effect: NDArray[np.intp] = field(init=False)  # number of each candidate's effect (C,)
    effect_shares: Array = field(init=False)  # share of every effect (K,), allowed or not

    def __post_init__(self) -> None:
        """What is asked, and its shares, follow from the candidates."""
        object.__setattr__(self, "asked", np.flatnonzero(self.allowed))
        shares = np.array([c.log_prior for c in self.candidates])
        object.__setattr__(self, "log_priors", np.where(self.allowed, shares, -np.inf))
        of_effect = numbers_of([c.effect.name for c in self.candidates])
        object.__setattr__(self, "of_effect", of_effect)
        object.__setattr__(self, "effect_shares", np.bincount(of_effect, np.exp(shares)))

    def keys(self, terms: Sequence[SelectedTerm]) -> frozenset[Key]:
        """What a verdict would call some terms, their variants aside."""
        return frozenset(self.candidates[c.index].key for c in terms)

    @cached_property
    def causes(self) -> NDArray[np.intp]:
        """Which cause each candidate is a variant of (C,)."""
        return numbers_of([c.key for c in self.candidates])

    @cached_property
    def dependences(self) -> list[Hashable]:
        """What each candidate depends on, and where."""
        effects = [c.effect for c in self.candidates]
        return [(e.stage, e.element, e.depends_on) for e in effects]

    def log_slot(self, filled: int) -> float:
        """Log odds that one slot more is filled: one cause more is rare."""
        return float(np.log(prior.NEXT_SLOT_ODDS if filled else prior.FIRST_SLOT_ODDS))


def select(
    selection: SelectionProblem, *, thorough: bool = True, before: Sequence[SelectedTerm] = ()
) -> list[SelectedTerm]:
    """The model that evidence leads to.

    Args:
        selection: The selection problem.
        thorough: Whether every pair is tried as a start, and long models are asked again.
        before: What was chosen about an earlier fit: the path from nothing may miss it.
    """
    chosen = extended(selection, [])
    if thorough and len(chosen) <= prior.MANY_SLOTS:
        chosen = _better_pair(selection, chosen, [])
    elif before and len(chosen) <= prior.MANY_SLOTS:
        chosen = _better_of(selection, chosen, extended(selection, before))
    if not thorough and len(chosen) > prior.MANY_SLOTS:
        return chosen
    if len(chosen) > prior.MANY_SLOTS:
        return climbed(selection, chosen, 1)
    found = climbed(selection, chosen, prior.ROUNDS)
    again = _pairs_again(selection, found)
    return found if again is found else climbed(selection, again, prior.ROUNDS)


def _pairs_again(selection: SelectionProblem, chosen: list[SelectedTerm]) -> list[SelectedTerm]:
    """Of several that depend on the same at one place the best pair in their stead, if better.

    Three forms of a friction may do what two others are, and no exchange of one leads there.
    """
    alike = Counter(selection.dependences[t.index] for t in chosen)
    for dependence in (dependence for dependence, count in alike.items() if count > 1):
        rest = [t for t in chosen if selection.dependences[t.index] != dependence]
        chosen = _better_pair(selection, chosen, rest, dependence)
    return chosen


def _better_pair(
    selection: SelectionProblem,
    chosen: list[SelectedTerm],
    rest: list[SelectedTerm],
    dependence: Hashable = None,
) -> list[SelectedTerm]:
    """Start again from some terms and the best pair, where that leads to a better model.

    The first of the pair depends on the same as is given, if anything is: every one of few
    variants, for that which does most alone may do what both do.
    """
    singles, scores = selection.odds(selection.reduce(rest))
    alike = np.array([dependence in (None, own) for own in selection.dependences])
    own = [t for t in chosen if t not in rest]
    best, pair = added_evidence(selection, rest, own[:2]), None
    asked = np.where(alike, singles, -np.inf)
    few = np.flatnonzero(np.isfinite(asked)).tolist()
    for i in few if len(few) <= prior.FEW_VARIANTS else _best_variants(selection, asked):
        # Alone it may seem tiny; with its partner it may have its usual size.
        first = SelectedTerm(i, max(float(scores.scale[i]), 1.0))
        seconds, found = selection.odds(selection.reduce([*rest, first]))
        j = int(np.argmax(seconds))
        if singles[i] + seconds[j] > best + prior.BETTER:
            best = float(singles[i] + seconds[j])
            pair = [first, SelectedTerm(j, float(found.scale[j]))]
    if pair is None:
        return chosen
    return _better_of(selection, chosen, extended(selection, [*rest, *pair]))


def _better_of(
    selection: SelectionProblem, chosen: list[SelectedTerm], other: list[SelectedTerm]
) -> list[SelectedTerm]:
    better = (
        added_evidence(selection, [], other) > added_evidence(selection, [], chosen) + prior.BETTER
    )
    return other if better else chosen


def _best_variants(selection: SelectionProblem, log_odds: Array) -> list[int]:
    """The best candidate of every cause; as the other of a pair each of its variants is tried."""
    best: dict[tuple[str, int | None], int] = {}
    for i in np.flatnonzero(np.isfinite(log_odds)).tolist():
        key = selection.candidates[i].key
        if log_odds[i] > log_odds[best.get(key, i)] or key not in best:
            best[key] = i
    return list(best.values())


def restricted(selection: SelectionProblem, allowed: NDArray[np.bool_]) -> SelectionProblem:
    """The same problem with fewer candidates."""
    return replace(selection, allowed=allowed)
