r"""Slots: what fills one given all other terms of a model, and the climb that asks them in turn.

Given all other effects of a model, a slot is empty or holds one candidate c, with posterior odds
against emptiness

.. math:: \frac{\pi}{1 - \pi}\, w_c\, B_c

where w_c is the candidate's share among all and B_c its evidence given the others. Causes of one
robot are of few kinds: where one joint's zero is off, more are. So shares are those of an urn
(Blackwell and MacQueen 1973, Ann. Stat. 1(2)): given n causes, of which :math:`n_e` are of the
same effect, which has :math:`p_e` of all, :math:`w_c` is multiplied by

.. math:: \frac{1 + n_e / \alpha p_e}{1 + n / \alpha} .

A climb fills
slots until emptiness wins, and asks each again in the light of the others: it is kept, filled
otherwise or emptied (iterated conditional modes, Besag 1986, J. R. Stat. Soc. B 48(3)).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior import evidence
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm, stack
from plumbline.optim.diagnosis.prior import ALIKE, BETTER, LOG_SCALE_WEIGHTS


class TermProblem(ABC):
    """A linear problem without nuisances, the terms that it may have, and its noise."""

    linear: Linear  # the problem with the nuisances eliminated
    candidates: Sequence[evidence.Term]  # all terms that there may be (C)
    noise: evidence.NoisePrior  # the prior of the noise
    log_priors: Array  # log of each term's share (C,); -inf for those that fill no slot
    asked: NDArray[np.intp] | None  # numbers of the terms that are asked; all if none
    # number of the effect that each term is of (C,), -1 if of none; none if terms are not alike
    of_effect: NDArray[np.intp] | None
    effect_shares: Array  # share of all that each effect has (K,)

    @abstractmethod
    def log_slot(self, filled: int) -> float:
        """Log odds, before the data, that one slot more is filled given so many."""

    @property
    @abstractmethod
    def causes(self) -> NDArray[np.intp]:
        """Number of the cause that each term is a variant of (C,)."""

    @cached_property
    def gathered(self) -> evidence.Gathered:
        """The terms, ready to be scanned."""
        return evidence.batches(self.linear, self.candidates, self.asked)

    def variance(self, chosen: Sequence[SelectedTerm], near: Reduced | None = None) -> float:
        """Noise variance that these terms leave, whose priors are weighed by it."""
        return self._variance(chosen, near, self._only(chosen))

    def _only(self, chosen: Sequence[SelectedTerm]) -> Linear:
        """The linear problem of these terms alone."""
        return self.linear.only(stack(self.candidates, chosen, 1.0)[0])

    def _variance(self, chosen: Sequence[SelectedTerm], near: Reduced | None, own: Linear) -> float:
        start = near.variance if near else self.noise.variance(self.linear.tt, self.linear.n)

        def left(v: Array) -> tuple[float, float]:
            return own.factored(stack(self.candidates, chosen, float(v))[1])[2:]

        return float(self.noise.settled(left, start))

    def reduce(
        self,
        chosen: Sequence[SelectedTerm],
        asked: Sequence[int] | None = None,
        near: Reduced | None = None,
    ) -> Reduced:
        """The problem that is left given these terms, at the noise that they leave.

        Args:
            chosen: The terms.
            asked: Numbers of those that are asked next; all that may be if not given.
            near: What nearly the same terms leave, whose noise saves rounds; nothing is known of
                it if not given.
        """
        gathered = self.gathered
        if asked is not None:
            own = np.array(asked) if self.asked is None else np.intersect1d(asked, self.asked)
            gathered = evidence.batches(self.linear, self.candidates, own)
        mine = self._only(chosen)
        variance = self._variance(chosen, near, mine)
        return Reduced.given(self.linear, gathered, self.candidates, chosen, variance, mine)

    @cached_property
    def fills_slot(self) -> list[bool]:
        """Which terms fill a slot (C,)."""
        found: list[bool] = np.isfinite(self.log_priors).tolist()
        return found

    def slots(self, chosen: Sequence[SelectedTerm]) -> list[SelectedTerm]:
        """Those of some terms that fill a slot."""
        return [t for t in chosen if self.fills_slot[t.index]]

    def odds(self, reduced: Reduced) -> tuple[Array, evidence.Scores]:
        """Log odds (C,) of each term for one more slot, against none, and its scores."""
        scores = evidence.scan(reduced, reduced.gathered, self.noise, len(self.candidates))
        slot = self.log_slot(len(self.slots(reduced.chosen)))
        log_odds = scores.log_bayes + self.log_priors + slot + self.alike(reduced.chosen)
        log_odds[[term.index for term in reduced.chosen]] = -np.inf
        return log_odds, scores

    def best(self, log_odds: Array) -> int:
        """The best variant of the cause that is the most probable, all its variants together."""
        total = np.full(int(self.causes.max()) + 1, -np.inf)
        np.logaddexp.at(total, self.causes, log_odds)
        return int(np.argmax(np.where(self.causes == np.argmax(total), log_odds, -np.inf)))

    def alike(self, chosen: Sequence[SelectedTerm]) -> Array:
        """Log factor (C,) of every term's share given these: more of the same is less rare.

        A further form of a cause that is there is no cause more.
        """
        if self.of_effect is None:
            return np.zeros(len(self.candidates))
        held, effects = self.distinct([t.index for t in self.slots(chosen)])
        more = np.append(effects / (ALIKE * self.effect_shares), 0.0)[self.of_effect]
        factor = np.log1p(more) - np.log1p(len(held) / ALIKE)
        return np.where(np.isin(self.causes, held), 0.0, factor)

    def distinct(self, indices: Sequence[int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Causes that some terms are of, each once, and how many of them each effect has (K,)."""
        held, first = np.unique(self.causes[list(indices)], return_index=True)
        assert self.of_effect is not None
        of_effect = self.of_effect[np.asarray(indices, dtype=np.intp)[first]]
        return held, np.bincount(of_effect[of_effect >= 0], minlength=len(self.effect_shares))

    def own_evidence(self, reduced: Reduced, term: SelectedTerm) -> float:
        """Log odds of one of the terms given all others; what all of them bear alike left out."""
        others = [t for t in reduced.chosen if t.index != term.index]
        share = self.log_priors[term.index] + self.alike(others)[term.index]
        return self.worth(reduced, term) + float(share)

    def worth(self, reduced: Reduced, term: SelectedTerm) -> float:
        """Log evidence of one of the terms given all others."""
        block, b, tt, n = reduced.of(term)
        own = self.candidates[term.index]
        given = (self.noise, np.array([own.limits]), own.widths)
        by_scale = evidence.block_evidence(block[None], b[None], tt, n, *given)
        return float(np.logaddexp.reduce(by_scale[0] + LOG_SCALE_WEIGHTS))


def shares_of(log_odds: Array) -> Array:
    """Probability of every term in one place (C,); what is missing to 1 is emptiness."""
    top = max(float(log_odds.max(initial=0.0)), 0.0)
    weights = np.exp(log_odds - top)
    return np.asarray(weights / (weights.sum() + np.exp(-top)))


def numbers_of(names: Sequence[object]) -> NDArray[np.intp]:
    """Numbers (C,) in place of names, in the order in which they come."""
    numbers: dict[object, int] = {}
    return np.array([numbers.setdefault(name, len(numbers)) for name in names], dtype=np.intp)


def climbed(
    problem: TermProblem, chosen: Sequence[SelectedTerm], rounds: int
) -> list[SelectedTerm]:
    """The best model near by: slots are asked and what is lacked added, until nothing changes."""
    chosen = list(chosen)
    for _ in range(rounds):
        before = {term.index for term in chosen}
        chosen = extended(problem, asked_again(problem, chosen))
        if {term.index for term in chosen} == before:
            break
    return chosen


def extended(problem: TermProblem, chosen: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """With term after term, until none is more probable than all that there may be together."""
    reduced = problem.reduce(chosen)
    while reduced.n > 1.0:  # as long as there are more equations than terms
        log_odds, scores = problem.odds(reduced)
        if not len(log_odds) or np.logaddexp.reduce(log_odds) <= 0.0:
            break
        best = problem.best(log_odds)
        more = SelectedTerm(best, float(scores.scale[best]))
        reduced = problem.reduce([*reduced.chosen, more], near=reduced)
    return list(reduced.chosen)


def asked_again(problem: TermProblem, chosen: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """One pass over the slots, the weakest first: keep, swap or empty; none are added.

    What is left is worked out anew only after a change.
    """
    found, reduced = list(chosen), problem.reduce(chosen)
    own = {t.index: problem.own_evidence(reduced, t) for t in problem.slots(chosen)}
    for index in sorted(own, key=own.__getitem__):
        at = next(k for k, term in enumerate(found) if term.index == index)
        log_odds, scores = problem.odds(reduced.without(found[at]))
        best = problem.best(log_odds)
        if log_odds[best] <= log_odds[index] + BETTER:
            best = index
        filled = np.logaddexp.reduce(log_odds) > 0.0
        found[at : at + 1] = [SelectedTerm(best, float(scores.scale[best]))] if filled else []
        if best != index or not filled:
            reduced = problem.reduce(found, near=reduced)
    return found


def added_evidence(
    problem: TermProblem, chosen: Sequence[SelectedTerm], more: Sequence[SelectedTerm]
) -> float:
    """Log odds of a model with some terms more against the one without, term by term."""
    total, given = 0.0, list(chosen)
    for term in more:
        log_odds, _ = problem.odds(problem.reduce(given, [term.index]))
        total += float(log_odds[term.index])
        given.append(term)
    return total
