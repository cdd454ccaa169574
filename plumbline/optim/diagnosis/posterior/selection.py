r"""Which effects: a path through the models that evidence leads, and what it is sure of.

The primitive is one slot: given all other effects of a model, the slot is empty or holds one
candidate c, with posterior odds against emptiness

.. math:: \frac{\pi}{1 - \pi}\, w_c\, B_c

where w_c is the candidate's share among all and B_c its evidence given the others. The path fills
slots until emptiness wins; every pair is tried, so that two effects that only work together are
found; then each slot is asked again in the light of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import (
    Batch,
    Candidate,
    NoisePrior,
    Scores,
    batches,
    scan,
)
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm, stack
from plumbline.optim.diagnosis.prior import (
    AMONG,
    AS_STRONG,
    AT_ONCE,
    BETTER,
    FIRST_SLOT_ODDS,
    LITTLE_OVERLAP,
    MANY_SLOTS,
    NEXT_SLOT_ODDS,
    NO_EVIDENCE,
    ROUNDS,
    SETTLED_VARIANCE,
    TAKES_SEVERAL,
    VARIANCE_ROUNDS,
)


@dataclass(frozen=True, eq=False)
class SelectionProblem:
    """The selection problem: a linear problem without nuisances, its candidates and its noise."""

    linear: Linear  # the problem with the nuisances eliminated
    candidates: tuple[Candidate, ...]  # all candidates
    noise: NoisePrior  # the prior of the noise
    allowed: NDArray[np.bool_]  # which candidates may be chosen (C,)

    @cached_property
    def gathered(self) -> list[Batch]:
        """The candidates, ready to be scanned."""
        return batches(self.linear, self.candidates)

    def keys(self, terms: Sequence[SelectedTerm]) -> frozenset[Key]:
        """What a verdict would call some terms, their variants aside."""
        return frozenset(self.candidates[c.index].key for c in terms)

    @cached_property
    def log_priors(self) -> Array:
        """Log of each candidate's share (C,), -inf for those that are not allowed."""
        shares = np.array([c.log_prior for c in self.candidates])
        return np.where(self.allowed, shares, -np.inf)

    @cached_property
    def _number_of_key(self) -> NDArray[np.intp]:
        """Which cause each candidate is a variant of (C,)."""
        numbers: dict[object, int] = {}
        return np.array([numbers.setdefault(c.key, len(numbers)) for c in self.candidates])

    def best(self, log_odds: Array, now: int | None = None) -> int:
        """The best variant of the cause that is the most probable, all its variants together.

        Args:
            log_odds: Of every candidate (C,).
            now: The candidate that stays where none is better.
        """
        numbers = self._number_of_key
        total = np.full(int(numbers.max()) + 1, -np.inf)
        np.logaddexp.at(total, numbers, log_odds)
        if now is not None:
            total[numbers[now]] += BETTER
            log_odds = np.where(np.arange(len(log_odds)) == now, log_odds + BETTER, log_odds)
        return int(np.argmax(np.where(numbers == np.argmax(total), log_odds, -np.inf)))

    def reduce(self, chosen: Sequence[SelectedTerm], like: Reduced | None = None) -> Reduced:
        """The problem that is left given these terms, at the noise that they leave.

        Args:
            chosen: The terms.
            like: A reduction whose noise is near enough, where one is at hand.
        """
        variance = float(self.noise.variance(like.tt, like.n)) if like else self._settled(chosen)[0]
        return Reduced.given(self.linear, self.gathered, self.candidates, chosen, variance)

    def variance(self, chosen: Sequence[SelectedTerm]) -> float:
        """Noise variance given these terms."""
        return self._settled(chosen)[1]

    def _settled(self, chosen: Sequence[SelectedTerm]) -> tuple[float, float]:
        """The noise variance that weighs the terms' priors, and the one that they then leave."""
        before = variance = float(self.noise.variance(self.linear.tt, self.linear.n))
        for _ in range(VARIANCE_ROUNDS if chosen else 0):
            left = self.linear.left(*stack(self.candidates, chosen, variance))
            before, variance = variance, float(self.noise.variance(*left))
            if variance > SETTLED_VARIANCE * before:
                break
        return before, variance

    def scan(self, reduced: Reduced) -> tuple[Array, Scores]:
        """Log odds (C,) of each candidate for one more slot, and its scores."""
        scores = scan(reduced, self.gathered, self.noise)
        odds = NEXT_SLOT_ODDS if reduced.chosen else FIRST_SLOT_ODDS
        log_odds = scores.log_bayes + self.log_priors + np.log(odds)
        log_odds[[term.index for term in reduced.chosen]] = -np.inf
        return log_odds, scores


def select(
    selection: SelectionProblem, *, thorough: bool = True, before: Sequence[SelectedTerm] = ()
) -> list[SelectedTerm]:
    """The model that evidence leads to.

    Args:
        selection: The selection problem.
        thorough: Whether every pair is tried as a start, and long models are asked again.
        before: What was chosen about an earlier fit: the path from nothing may miss it.
    """
    chosen = _extend(selection, [])
    if thorough and len(chosen) <= MANY_SLOTS:
        chosen = _better_start(selection, chosen)
    elif before and len(chosen) <= MANY_SLOTS:
        chosen = _better_of(selection, chosen, _extend(selection, before))
    if not thorough and len(chosen) > MANY_SLOTS:
        return chosen
    return reconsider(selection, chosen)


def _extend(selection: SelectionProblem, chosen: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """Fill slots until emptiness is more probable than all candidates together."""
    reduced = selection.reduce(chosen)
    while reduced.n > 1.0:  # as long as there are more equations than terms
        log_odds, scores = selection.scan(reduced)
        if not len(log_odds) or logsumexp(log_odds) <= 0.0:
            break
        variance = float(selection.noise.variance(reduced.tt, reduced.n))
        best = _strongest(selection, reduced, log_odds)
        reduced = reduced.plus([SelectedTerm(i, float(scores.scale[i])) for i in best], variance)
    return list(reduced.chosen)


def _strongest(selection: SelectionProblem, reduced: Reduced, log_odds: Array) -> list[int]:
    """The best candidate; in a long model also others as strong that do not overlap with it."""
    order = np.argsort(-log_odds)
    taken = [selection.best(log_odds)]
    if len(reduced.chosen) < TAKES_SEVERAL:
        return taken
    least = max(NO_EVIDENCE, AS_STRONG * float(log_odds[order[0]]))
    for i in order[:AMONG].tolist():
        if log_odds[i] < least or len(taken) >= AT_ONCE:
            break
        mine = selection.candidates[i].columns
        if all(
            reduced.overlap(mine, selection.candidates[j].columns) < LITTLE_OVERLAP for j in taken
        ):
            taken.append(i)
    return taken


def _better_start(selection: SelectionProblem, chosen: list[SelectedTerm]) -> list[SelectedTerm]:
    """Start again from the best pair, where that leads to a better model than the path did."""
    empty = selection.reduce([])
    singles, scores = selection.scan(empty)
    variance = float(selection.noise.variance(empty.tt, empty.n))
    best, pair = path_evidence(selection, chosen[:2]), None
    for i in _best_variants(selection, singles):
        # Alone it may seem tiny; with its partner it may have its usual size.
        first = SelectedTerm(i, max(float(scores.scale[i]), 1.0))
        seconds, found = selection.scan(empty.plus([first], variance))
        j = int(np.argmax(seconds))
        if singles[i] + seconds[j] > best + BETTER:
            best = float(singles[i] + seconds[j])
            pair = [first, SelectedTerm(j, float(found.scale[j]))]
    if pair is None:
        return chosen
    return _better_of(selection, chosen, _extend(selection, pair))


def _better_of(
    selection: SelectionProblem, chosen: list[SelectedTerm], other: list[SelectedTerm]
) -> list[SelectedTerm]:
    better = path_evidence(selection, other) > path_evidence(selection, chosen) + BETTER
    return other if better else chosen


def _best_variants(selection: SelectionProblem, log_odds: Array) -> list[int]:
    """The best candidate of every cause; as the other of a pair each of its variants is tried."""
    best: dict[tuple[str, int | None], int] = {}
    for i in np.flatnonzero(np.isfinite(log_odds)).tolist():
        key = selection.candidates[i].key
        if log_odds[i] > log_odds[best.get(key, i)] or key not in best:
            best[key] = i
    return list(best.values())


def path_evidence(selection: SelectionProblem, chosen: Sequence[SelectedTerm]) -> float:
    """Log odds of a model against none, slot by slot."""
    total, reduced = 0.0, selection.reduce([])
    for term in chosen:
        total += float(selection.scan(reduced)[0][term.index])
        variance = float(selection.noise.variance(reduced.tt, reduced.n))
        reduced = reduced.plus([term], variance)
    return total


def reconsider(selection: SelectionProblem, chosen: list[SelectedTerm]) -> list[SelectedTerm]:
    """Ask every slot again given the others: keep, swap or empty it, until nothing changes."""
    for _ in range(1 if len(chosen) > MANY_SLOTS else ROUNDS):
        before = {c.index for c in chosen}
        chosen = asked_again(selection, chosen)
        chosen = _extend(selection, chosen)
        if {c.index for c in chosen} == before:
            break
    return chosen


def asked_again(selection: SelectionProblem, chosen: list[SelectedTerm]) -> list[SelectedTerm]:
    """One pass over the slots: keep, swap or empty; none are added.

    What is left is worked out anew only after a change.
    """
    reduced = selection.reduce(chosen)
    for term in list(chosen):
        log_odds, scores = selection.scan(reduced.without(term))
        best = selection.best(log_odds, term.index)
        keep = [c for c in chosen if c.index != term.index]
        if logsumexp(log_odds) <= 0.0:
            chosen = keep
        elif best != term.index:
            chosen = [*keep, SelectedTerm(best, float(scores.scale[best]))]
        else:
            scale = float(scores.scale[term.index])
            chosen = [replace(c, scale=scale) if c.index == term.index else c for c in chosen]
            continue
        reduced = selection.reduce(chosen, reduced)
    return chosen


def restricted(selection: SelectionProblem, allowed: NDArray[np.bool_]) -> SelectionProblem:
    """The same problem with fewer candidates."""
    return replace(selection, allowed=allowed)
