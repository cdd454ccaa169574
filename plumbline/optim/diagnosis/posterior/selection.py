r"""Which effects: a path through the models that evidence leads, and what it is sure of.

The primitive is one slot: given all other effects of a model, the slot is empty or holds one
candidate c, with posterior odds against emptiness

.. math:: \frac{\pi}{1 - \pi}\, w_c\, B_c

where w_c is the candidate's share among all and B_c its evidence beside the others. The path fills
slots until emptiness wins; every pair is tried, so that two effects that only work together are
found; then each slot is asked again in the light of the others.
"""

from __future__ import annotations

from collections import Counter
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
from plumbline.optim.diagnosis.posterior.reduction import Choice, Reduced

FIRST_SLOT_ODDS = 0.7
NEXT_SLOT_ODDS = 0.1
MOST_SLOTS = 400
MANY_SLOTS = 40
BETTER = 1e-6
FRESH = 30
AT_ONCE, STRONG, LITTLE_OVERLAP = 8, 10.0, 0.02


@dataclass(frozen=True, eq=False)
class Question:
    """What selection is asked: a linear problem without nuisances, its candidates and its noise.

    Attributes:
        linear: The problem with the nuisances eliminated.
        candidates: All candidates.
        noise: The prior of the noise.
        allowed: Which candidates may be chosen (C,).
    """

    linear: Linear
    candidates: tuple[Candidate, ...]
    noise: NoisePrior
    allowed: NDArray[np.bool_]

    @cached_property
    def gathered(self) -> list[Batch]:
        """The candidates, ready to be scanned."""
        return batches(self.linear, self.candidates)

    def keys(self, choices: Sequence[Choice]) -> frozenset[Key]:
        """What a verdict would call some choices, their variants aside."""
        return frozenset(self.candidates[c.index].key for c in choices)

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

    def reduce(self, chosen: Sequence[Choice], like: Reduced | None = None) -> Reduced:
        """The problem that is left beside these choices, at the noise that they leave.

        Args:
            chosen: The choices.
            like: A reduction whose noise is near enough, where one is at hand.
        """
        found = like or Reduced.nothing(self.linear, self.gathered)
        for _ in range(0 if not chosen else 1 if like else 2):
            variance = float(self.noise.variance(found.tt, found.n))
            found = Reduced.beside(self.linear, self.gathered, self.candidates, chosen, variance)
        return found if chosen else Reduced.nothing(self.linear, self.gathered)

    def variance(self, chosen: Sequence[Choice]) -> float:
        """Noise variance beside these choices."""
        reduced = self.reduce(chosen)
        return float(self.noise.variance(reduced.tt, reduced.n))

    def scan(self, reduced: Reduced) -> tuple[Array, Scores]:
        """Log odds (C,) of each candidate for one more slot, and its scores."""
        scores = scan(reduced, self.gathered, self.noise)
        odds = NEXT_SLOT_ODDS if reduced.chosen else FIRST_SLOT_ODDS
        log_odds = scores.log_bayes + self.log_priors + np.log(odds)
        log_odds[[choice.index for choice in reduced.chosen]] = -np.inf
        return log_odds, scores


@dataclass(frozen=True, eq=False)
class Slot:
    """One filled slot and its rivals, given all others.

    Attributes:
        choice: What fills it.
        log_odds: Log odds (C,) against emptiness of every candidate for this slot.
    """

    choice: Choice
    log_odds: Array

    @property
    def gain(self) -> float:
        """Log odds of the choice against leaving the slot empty."""
        return float(self.log_odds[self.choice.index])

    def raised(self, by: float) -> Slot:
        """The same slot, its choice so much more probable [log odds]."""
        log_odds = self.log_odds.copy()
        log_odds[self.choice.index] += by
        return Slot(self.choice, log_odds)

    @property
    def probabilities(self) -> Array:
        """Probability of every candidate in this slot (C,); what is missing to 1 is emptiness."""
        return np.asarray(np.exp(self.log_odds - np.logaddexp(0.0, logsumexp(self.log_odds))))


def select(question: Question, *, thorough: bool = True) -> list[Choice]:
    """The model that evidence leads to.

    Args:
        question: What is asked.
        thorough: Whether every pair is tried as a start, and long models are asked again.
    """
    chosen = _extend(question, [])
    if thorough and len(chosen) <= MANY_SLOTS:
        chosen = _better_start(question, chosen)
    if not thorough and len(chosen) > MANY_SLOTS:
        return chosen
    return reconsider(question, chosen)


def _extend(question: Question, chosen: Sequence[Choice]) -> list[Choice]:
    """Fill slots until emptiness is more probable than all candidates together."""
    reduced = question.reduce(chosen)
    while len(reduced.chosen) < MOST_SLOTS:
        log_odds, scores = question.scan(reduced)
        if not len(log_odds) or logsumexp(log_odds) <= 0.0:
            break
        variance = float(question.noise.variance(reduced.tt, reduced.n))
        before = len(reduced.chosen) // FRESH
        for i in _strongest(question, reduced, log_odds):
            choice = Choice(i, float(scores.scale[i]))
            reduced = reduced.plus(choice, question.candidates, variance)
        if len(reduced.chosen) // FRESH > before:
            reduced = question.reduce(reduced.chosen, reduced)
    return list(reduced.chosen)


def _strongest(question: Question, reduced: Reduced, log_odds: Array) -> list[int]:
    """The best candidate; in a long model also others as strong that do not overlap with it."""
    order = np.argsort(-log_odds)
    taken = [question.best(log_odds)]
    if len(reduced.chosen) < MANY_SLOTS // 4:
        return taken
    least = max(STRONG, 0.3 * float(log_odds[order[0]]))
    for i in order[:MANY_SLOTS].tolist():
        if log_odds[i] < least or len(taken) >= AT_ONCE:
            break
        mine = question.candidates[i].columns
        if all(
            reduced.overlap(mine, question.candidates[j].columns) < LITTLE_OVERLAP for j in taken
        ):
            taken.append(i)
    return taken


def _better_start(question: Question, chosen: list[Choice]) -> list[Choice]:
    """Start again from the best pair, where that leads to a better model than the path did."""
    empty = question.reduce([])
    singles, scores = question.scan(empty)
    variance = float(question.noise.variance(empty.tt, empty.n))
    best, pair = path_evidence(question, chosen[:2]), None
    for i in _best_variants(question, singles):
        # Alone it may seem tiny; beside its partner it may have its usual size.
        first = Choice(i, max(float(scores.scale[i]), 1.0))
        seconds, found = question.scan(empty.plus(first, question.candidates, variance))
        j = int(np.argmax(seconds))
        if singles[i] + seconds[j] > best + BETTER:
            best = float(singles[i] + seconds[j])
            pair = [first, Choice(j, float(found.scale[j]))]
    if pair is None:
        return chosen
    other = _extend(question, pair)
    better = path_evidence(question, other) > path_evidence(question, chosen) + BETTER
    return other if better else chosen


def _best_variants(question: Question, log_odds: Array) -> list[int]:
    """The best candidate of every cause; as the other of a pair each of its variants is tried."""
    best: dict[tuple[str, int | None], int] = {}
    for i in np.flatnonzero(np.isfinite(log_odds)).tolist():
        key = question.candidates[i].key
        if log_odds[i] > log_odds[best.get(key, i)] or key not in best:
            best[key] = i
    return list(best.values())


def path_evidence(
    question: Question, chosen: Sequence[Choice], given: Sequence[Choice] = ()
) -> float:
    """Log odds of a model against the one that is given, slot by slot."""
    total = 0.0
    reduced = question.reduce(given)
    for choice in chosen:
        total += float(question.scan(reduced)[0][choice.index])
        variance = float(question.noise.variance(reduced.tt, reduced.n))
        reduced = reduced.plus(choice, question.candidates, variance)
    return total


def reconsider(question: Question, chosen: list[Choice], rounds: int = 3) -> list[Choice]:
    """Ask every slot again given the others: keep, swap or empty it, until nothing changes."""
    for _ in range(1 if len(chosen) > MANY_SLOTS else rounds):
        before = {c.index for c in chosen}
        chosen = asked_again(question, chosen)
        chosen = _extend(question, _merge(question, chosen))
        if {c.index for c in chosen} == before:
            break
    return chosen


def asked_again(question: Question, chosen: list[Choice]) -> list[Choice]:
    """One pass over the slots: keep, swap or empty; none are added.

    What is left is worked out anew only after a change.
    """
    reduced = question.reduce(chosen)
    for choice in list(chosen):
        log_odds, scores = question.scan(reduced.without(choice))
        best = question.best(log_odds, choice.index)
        keep = [c for c in chosen if c.index != choice.index]
        if logsumexp(log_odds) <= 0.0:
            chosen = keep
        elif best != choice.index:
            chosen = [*keep, Choice(best, float(scores.scale[best]))]
        else:
            scale = float(scores.scale[choice.index])
            chosen = [replace(c, scale=scale) if c.index == choice.index else c for c in chosen]
            continue
        reduced = question.reduce(chosen, reduced)
    return chosen


def _merge(question: Question, chosen: list[Choice]) -> list[Choice]:
    """One candidate in place of two variants of the same cause, where that is better."""
    keys = Counter(question.candidates[c.index].key for c in chosen)
    for key in [k for k, count in keys.items() if count > 1]:
        twins = [c for c in chosen if question.candidates[c.index].key == key]
        if any(question.candidates[c.index].effect.scanned for c in twins):
            continue
        others = [c for c in chosen if c not in twins]
        log_odds, scores = question.scan(question.reduce(others))
        best = int(np.argmax(log_odds))
        if log_odds[best] > path_evidence(question, twins, others):
            chosen = [*others, Choice(best, float(scores.scale[best]))]
    return chosen


def slots(question: Question, chosen: Sequence[Choice]) -> list[Slot]:
    """Every slot of a model with its rivals."""
    reduced = question.reduce(chosen)
    return [Slot(c, question.scan(reduced.without(c))[0]) for c in chosen]


def restricted(question: Question, allowed: NDArray[np.bool_]) -> Question:
    """The same question to fewer candidates."""
    return replace(question, allowed=allowed)
