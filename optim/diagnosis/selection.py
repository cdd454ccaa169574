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

from optim.diagnosis.evidence import Batch, Candidate, NoisePrior, Scores, batches, scan
from optim.diagnosis.linear import Beside, Columns, Linear
from optim.problem import Array

FIRST_SLOT_ODDS = 1.0
NEXT_SLOT_ODDS = 0.25
NUISANCE_PRECISION = 1e-10
MOST_SLOTS = 400


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

    @cached_property
    def log_priors(self) -> Array:
        """Log of each candidate's share (C,), -inf for those that are not allowed."""
        shares = np.array([c.log_prior for c in self.candidates])
        return np.where(self.allowed, shares, -np.inf)

    def beside(self, chosen: Sequence[Choice]) -> Beside:
        """The problem that is left beside these choices."""
        found = Beside.nothing(self.linear)
        for _ in range(2 if chosen else 0):
            variance = self.noise.variance(found.tt, found.n)
            columns, precision = stack(self.candidates, chosen, float(variance))
            found = self.linear.beside(columns, precision)
        return found

    def variance(self, chosen: Sequence[Choice]) -> float:
        """Noise variance beside these choices."""
        beside = self.beside(chosen)
        return float(self.noise.variance(beside.tt, beside.n))

    def scan(self, chosen: Sequence[Choice]) -> tuple[Array, Scores]:
        """Log odds (C,) of each candidate for one more slot, and its scores."""
        scores = scan(self.beside(chosen), self.gathered, self.noise)
        odds = NEXT_SLOT_ODDS if chosen else FIRST_SLOT_ODDS
        log_odds = scores.log_bayes + self.log_priors + np.log(odds)
        log_odds[[choice.index for choice in chosen]] = -np.inf
        return log_odds, scores


@dataclass(frozen=True)
class Choice:
    """One candidate in a model, at the scale of its prior."""

    index: int
    scale: float


@dataclass(frozen=True, eq=False)
class Slot:
    """One filled slot and its rivals, given all others.

    Attributes:
        choice: What fills it.
        log_odds: Log odds (C,) against emptiness of every candidate for this slot.
        gain: How much the log evidence rises by filling it with the choice.
    """

    choice: Choice
    log_odds: Array

    @property
    def gain(self) -> float:
        """Log odds of the choice against leaving the slot empty."""
        return float(self.log_odds[self.choice.index])

    @property
    def probabilities(self) -> Array:
        """Probability of every candidate in this slot (C,); what is missing to 1 is emptiness."""
        return np.exp(self.log_odds - np.logaddexp(0.0, logsumexp(self.log_odds)))


def stack(
    candidates: Sequence[Candidate], chosen: Sequence[Choice], variance: float
) -> tuple[Columns, Array]:
    """Columns (K,) of the choices and their prior precisions (K,) in units of 1 / noise^2."""
    columns = [candidates[c.index].columns for c in chosen]
    precision = [np.full(len(candidates[c.index].columns), variance / c.scale**2) for c in chosen]
    if not columns:
        return np.empty(0, dtype=np.intp), np.empty(0)
    return np.concatenate(columns), np.concatenate(precision)


def select(question: Question, *, pairs: bool = True) -> list[Choice]:
    """The model that evidence leads to."""
    chosen = _extend(question, [])
    if pairs:
        chosen = _better_start(question, chosen)
    return _reconsider(question, chosen)


def _extend(question: Question, chosen: list[Choice]) -> list[Choice]:
    """Fill slots until emptiness is more probable than all candidates together."""
    while len(chosen) < MOST_SLOTS:
        log_odds, scores = question.scan(chosen)
        if not len(log_odds) or logsumexp(log_odds) <= 0.0:
            break
        best = int(np.argmax(log_odds))
        chosen = [*chosen, Choice(best, float(scores.scale[best]))]
    return chosen


def _better_start(question: Question, chosen: list[Choice]) -> list[Choice]:
    """Start again from the best pair, where a pair beats what the path has found."""
    singles, scores = question.scan([])
    best, start = path_evidence(question, chosen), chosen
    for i in np.argsort(-singles):
        if not np.isfinite(singles[i]):
            break
        first = Choice(int(i), float(scores.scale[i]))
        seconds, found = question.scan([first])
        j = int(np.argmax(seconds))
        if len(chosen) <= 2 and singles[i] + seconds[j] > best + 1e-9:
            best, start = singles[i] + seconds[j], [first, Choice(j, float(found.scale[j]))]
    return chosen if start is chosen else _extend(question, start)


def path_evidence(question: Question, chosen: Sequence[Choice]) -> float:
    """Log odds of a whole model against the empty one, slot by slot."""
    total = 0.0
    for k, choice in enumerate(chosen):
        total += float(question.scan(chosen[:k])[0][choice.index])
    return total


def _reconsider(question: Question, chosen: list[Choice], rounds: int = 3) -> list[Choice]:
    """Ask every slot again given the others: keep, swap or empty it, until nothing changes."""
    if len(chosen) > 40:
        rounds = 1
    for _ in range(rounds):
        before = list(chosen)
        for choice in before:
            others = [c for c in chosen if c.index != choice.index]
            log_odds, scores = question.scan(others)
            best = int(np.argmax(log_odds))
            if logsumexp(log_odds) <= 0.0:
                chosen = others
            elif best != choice.index and log_odds[best] > log_odds[choice.index] + 1e-9:
                chosen = [*others, Choice(best, float(scores.scale[best]))]
            else:
                kept = Choice(choice.index, float(scores.scale[choice.index]))
                chosen = [kept if c.index == choice.index else c for c in chosen]
        chosen = _extend(question, _merge(question, chosen))
        if {c.index for c in chosen} == {c.index for c in before}:
            break
    return chosen


def _merge(question: Question, chosen: list[Choice]) -> list[Choice]:
    """One variant in place of two of the same cause, where that is as good."""
    keys = Counter(question.candidates[c.index].key for c in chosen)
    for key in [k for k, count in keys.items() if count > 1]:
        twins = [c for c in chosen if question.candidates[c.index].key == key]
        if any(question.candidates[c.index].effect.scanned for c in twins):
            continue
        others = [c for c in chosen if c not in twins]
        log_odds, scores = question.scan(others)
        best = int(np.argmax(log_odds))
        merged = [*others, Choice(best, float(scores.scale[best]))]
        if path_evidence(question, merged) > path_evidence(question, [*others, *twins]):
            chosen = merged
    return chosen


def slots(question: Question, chosen: Sequence[Choice]) -> list[Slot]:
    """Every slot of a model with its rivals."""
    found = []
    for choice in chosen:
        others = [c for c in chosen if c.index != choice.index]
        log_odds, _ = question.scan(others)
        found.append(Slot(choice, log_odds))
    return found


def restricted(question: Question, allowed: NDArray[np.bool_]) -> Question:
    """The same question to fewer candidates."""
    return replace(question, allowed=allowed)
