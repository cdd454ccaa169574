r"""What a recording cannot tell apart, and what it cannot see at all.

A rival is confounded with a cause if in the cause's place, all others kept, its posterior odds are
less by a log Bayes factor below three, which is no evidence (Jeffreys 1961, app. B), than the
cause's and than nothing's, and the one's presence takes evidence from the other, such that the
cause's own is none: so each is confounded with the other, and neither is sure. What is fitted
without a name and is worth no more conditional on all that is there, it may be instead: it goes.
An effect is unobservable if the nuisances swallow it, or if at its usual size it moves the readings
by less than the noise: alone, or together with what is named, whose values then hold what both do.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logit

from plumbline.kinematics.effects import Effect, Scope
from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import FIDUCIALS, OF_AN_ARM, RANGES, TIP_OBSERVATIONS
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import MOST_TOLD
from plumbline.optim.diagnosis.findings import Blame, Key
from plumbline.optim.diagnosis.posterior.joint_problem import log_slot
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.prior import NO_EVIDENCE, SWALLOWED


def rivals(
    selection: SelectionProblem, whole: Reduced, mine: Sequence[SelectedTerm]
) -> list[Blame]:
    """Effects that may be there in place of the terms ``mine``, given all others; likely first.

    Args:
        selection: What was asked.
        whole: What is left given all that is there, ``mine`` among it.
        mine: The terms of one cause.
    """
    conditional, others, added = selection.odds(whole)[0], whole, 0.0
    in_place = conditional
    for term in mine:
        others = others.without(term)
        in_place = selection.odds(others)[0]
        added += float(in_place[term.index])
    own = np.unique(selection.causes[[c.index for c in mine]])
    in_place, conditional = _by_cause(selection, in_place), _by_cause(selection, conditional)
    least = max(added, in_place[own].max(), 0.0) - NO_EVIDENCE
    # What is as likely conditional on the cause leaves it beyond doubt, and is no rival.
    taken = in_place - np.maximum(conditional, -np.finfo(float).max)
    may_be = (in_place > least) & (taken > max(added - NO_EVIDENCE, NO_EVIDENCE))
    may_be[own] = False
    effects = {k: c.effect for k, c in zip(selection.causes, selection.candidates, strict=True)}
    ranked, found = np.argsort(-in_place, kind="stable"), []
    for k in ranked[may_be[ranked]].tolist():
        share = f"{np.exp(min(in_place[k] - least - NO_EVIDENCE, MOST_TOLD)):.2g}"
        e, why = effects[k], f"in its place {share} times as probable"
        found.append(Blame(e.name, str(e.stage), e.element, why))
    return found


def _by_cause(selection: SelectionProblem, log_odds: Array) -> Array:
    """Log odds of every cause, by those of all its variants (C,)."""
    total = np.full(int(selection.causes.max()) + 1, -np.inf)
    np.logaddexp.at(total, selection.causes, log_odds)
    return total


def worth_more_than_nothing(
    selection: SelectionProblem, chosen: Sequence[SelectedTerm], named: frozenset[Key]
) -> Reduced:
    """What is left given terms that are named, and of the others those that the rows ask for."""
    whole = selection.reduce(chosen)

    def kept(term: SelectedTerm) -> bool:
        worth = selection.worth(whole, term)
        return selection.candidates[term.index].key in named or worth >= NO_EVIDENCE

    return selection.reduce([t for t in chosen if kept(t)])


def odds_moved(
    selection: SelectionProblem,
    chosen: Sequence[SelectedTerm],
    probabilities: Mapping[Key, float],
    unlisted: float,
) -> dict[Key, str]:
    """By how much the rows move the odds that a cause is at work, in words.

    An improbable cause may have been so beforehand: only rows that lower its odds by far speak
    against it.

    Args:
        selection: What was asked.
        chosen: Terms to which a cause would be one more.
        probabilities: Of every cause.
        unlisted: Prior probability that a term is of no effect of the library.
    """
    beforehand = selection.log_priors + selection.alike(chosen) + np.log1p(-unlisted)
    before = _by_cause(selection, beforehand + log_slot(len(selection.keys(chosen))))
    found = {}
    for k, candidate in zip(selection.causes, selection.candidates, strict=True):
        p = probabilities.get(candidate.key, 0.0)
        if 0.0 < p < 1.0 and np.isfinite(before[k]):
            moved = float(logit(p) - before[k])
            times = f"{np.exp(min(abs(moved), MOST_TOLD)):.2g}"
            way = "raise" if moved > 0.0 else "lower"
            found[candidate.key] = f"the rows {way} its odds {times} times"
    return found


def unobservable(
    pool: Pool,
    selection: SelectionProblem,
    named: Sequence[SelectedTerm],
    scope: Scope,
    sigma: float,
    library: Sequence[type[Effect]],
) -> list[Blame]:
    """Effects that this recording cannot see, alone or given the ``named`` terms, and why."""
    alone, found = _strengths(pool, selection, [], sigma), []
    conditional = _strengths(pool, selection, named, sigma)
    for key, (strength, share, effect) in alone.items():
        if strength < 1e-12 or share < SWALLOWED:
            why = "what is always fitted absorbs it" if strength else "no row excites it"
        elif strength < 1.0:
            size = f"{np.sqrt(strength):.1g}"
            why = f"at its usual size its whole signal is {size} times the noise"
        elif conditional[key][0] < 1.0 and key not in selection.keys(named):
            why = f"the {_absorbing(pool, selection, named, key)} that is named absorbs it"
        else:
            continue
        found.append(Blame(effect.name, str(effect.stage), effect.element, why))
    return [*found, *_missing(pool, scope, library)]


def _strengths(
    pool: Pool, selection: SelectionProblem, given: Sequence[SelectedTerm], sigma: float
) -> dict[Key, tuple[float, float, Effect]]:
    """By effect: its usual signal's square given these terms [noise's], and share of the whole."""
    raw, reduced = np.diag(pool.whole.G), selection.reduce(given)
    seen: dict[Key, tuple[float, float, Effect]] = {}
    for candidate in pool.candidates:
        left = np.diag(reduced.block(candidate.columns, candidate.columns))
        strength = float(np.max(left)) / max(sigma**2, 1e-300)
        share = float(np.max(left / np.maximum(raw[candidate.columns], 1e-300)))
        old = seen.get(candidate.key, (0.0, 0.0, candidate.effect))
        seen[candidate.key] = (max(strength, old[0]), max(share, old[1]), candidate.effect)
    return seen


def _absorbing(
    pool: Pool, selection: SelectionProblem, named: Sequence[SelectedTerm], key: Key
) -> str:
    """Name of the effect among the named ones that leaves least of another."""
    own = [c for c in pool.candidates if c.key == key]
    mine = {c: selection.candidates[c.index].key for c in named}

    def leaves(other: Key) -> float:
        given = selection.reduce([c for c in named if mine[c] == other])
        return max(float(np.max(np.diag(given.block(c.columns, c.columns)))) for c in own)

    return min(dict.fromkeys(mine.values()), key=leaves)[0]


def _missing(pool: Pool, scope: Scope, library: Sequence[type[Effect]]) -> list[Blame]:
    """Effects without any candidate: what the recording would need."""
    present = {name for name, _ in (c.key for c in pool.candidates)}
    fixed = {t.effect.name for t in pool.model.terms if t.columns.stop <= pool.always}
    found = []
    for cls in library:
        if cls.name in (*present, "tool_offset") or _of_another_world(cls, scope):
            continue
        lacking = cls.lacks(scope)
        if cls.name in fixed:
            why = "is always fitted, so never blamed"
        elif scope.observation not in cls.observations:
            why = f"a recording of {scope.observation} cannot show it"
        elif lacking:
            why = f"needs the column {lacking}"
        elif cls.in_motion and not scope.moving:
            why = (
                "needs readings along one motion, no farther from one to the next than a twentieth "
                "of what the joints do in all"
            )
        else:
            why = cls.out_of_reach(scope) or "nothing in the recording excites it"
        found.append(Blame(cls.name, str(cls.stage), None, why))
    return found


def _of_another_world(cls: type[Effect], scope: Scope) -> bool:
    """Whether it shows in efforts alone while places were measured, or the other way about."""
    turns_alone = cls.of_slides and len(scope.turning) == len(scope.joints)
    if turns_alone or (not scope.arm and _is_of_an_arm(cls)):
        return True
    if scope.observation in cls.observations:
        return False
    alone, own = (FIDUCIALS, RANGES), set(cls.observations)
    apart = cls.observations in alone or (scope.observation,) in alone
    return apart or own <= set(TORQUES) or scope.observation in TORQUES


def _is_of_an_arm(cls: type[Effect]) -> bool:
    """Whether an arm alone has it: what also shows in fiducials needs none."""
    seen = set(cls.observations)
    of_arms = set(TIP_OBSERVATIONS) <= seen and not set(FIDUCIALS) & seen
    return cls.stage in OF_AN_ARM or of_arms
