r"""What the joint posterior says: causes, the unlisted, gross rows, and the tree of places.

How far estimates move from state to state, which is a part of what is not known of them.

In a state S of probability :math:`p_S` a term's values are :math:`z_S`, known to :math:`v_S`. Over
all states that hold the term their variance is, by the law of total variance,

.. math:: \sum_S p_S v_S + \sum_S p_S (z_S - \bar z)^2 .
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, Self

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis.discrepancy.alternatives import (
    Alternatives,
    Unlisted,
    alternatives,
    key_of,
)
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.correlation import (
    RowNoise,
    correlation_of,
    left_by_nothing,
)
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.fewer_terms import most_probable, taken_back
from plumbline.optim.diagnosis.posterior.joint import LEAST_HEARD, Sampled, sample
from plumbline.optim.diagnosis.posterior.joint_problem import moved_by, stated
from plumbline.optim.diagnosis.posterior.one_by_one import best_near, coarsened
from plumbline.optim.diagnosis.posterior.parts import Mechanism
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.slots import TermProblem, added_evidence
from plumbline.optim.diagnosis.predict.folds import blocks_of_each
from plumbline.optim.diagnosis.prior import (
    DEVIATIONS,
    EARNED,
    LEAST_NAMED,
    MANY_CAUSES,
    MOST_COMPARED_ROWS,
    PART_OF_UNLISTED,
    SCALES,
    SETTLED,
    UNLISTED,
)
from plumbline.optim.diagnosis.verdict.terms import (
    begins_of,
    better_by_all_rows,
    of_many,
    place_of,
    terms_of,
)
from plumbline.optim.diagnosis.verdict.tree import Place, tree_of
from plumbline.optim.measurement.correlated import postures
from plumbline.optim.measurement.observation import rotation_lever, scope_of
from plumbline.optim.measurement.refit import before_whitening
from plumbline.optim.measurement.torque import stated_noise
from plumbline.optim.measurement.uneven import may_jitter, may_scatter, rates, swings


@dataclass(frozen=True, eq=False)
class Explanation:
    """What is at work, with what probability."""

    probabilities: Mapping[Key, float]  # of each cause of the library
    # the same with prior odds of every term a third, and three times as high
    sensitive: Mapping[Key, tuple[float, float]]
    # of each mechanism, those that the library lacks among them
    mechanisms: Mapping[Mechanism, float]
    places: Mapping[Place, float]  # of each place, any mechanism there
    unlisted: float  # that something is at work which the library lacks
    named: frozenset[Key] = frozenset()  # causes in the verdict
    words: str = ""  # on what the most probable of that depends, if it is more probable than not
    # shares by place of what unlisted mechanisms move together, in the best state that has one
    lacked_at: Mapping[Place, float] = field(default_factory=dict)
    # square that what is at work at each place moves, in the best state [of any unit]
    moved_at: Mapping[Place, float] = field(default_factory=dict)
    # the most probable terms of the library that hold what is named
    terms: tuple[SelectedTerm, ...] = ()
    # those of the most probable state, with something unlisted beside them or without
    likeliest: tuple[SelectedTerm, ...] = ()
    # those that chains came to, and by how much all rows make them more probable than these [nats]
    theirs: tuple[SelectedTerm, ...] = ()
    better: float = 0.0
    # sets of terms of the library, with the log of their weight, best first
    states: tuple[tuple[float, tuple[SelectedTerm, ...]], ...] = ()
    # such sets as many causes were in from sweep to sweep, all of one weight
    swept: tuple[tuple[float, tuple[SelectedTerm, ...]], ...] = ()
    apart: float = 0.0  # the most by which two chains disagree about a probability
    prior: float = UNLISTED  # prior probability that a term is of no effect of the library
    conditional: float = 0.0  # the same, conditional on all that is named being at work
    # how the noise of successive rows, or of readings of one posture, goes along, or is wider
    correlation: RowNoise = field(default_factory=RowNoise)
    # of terms by their numbers, how far their values move from state to state [scale]
    spread: Mapping[int, Array] = field(default_factory=dict)
    worth: float = 1.0  # share of their number that all rows are worth in this
    one_by_one: bool = False  # whether causes are so many that they were asked one by one
    compared: int = 0  # how many rows all of this is from, of a recording too long for all of them

    @property
    def is_open(self) -> bool:
        """Whether something may be missing in the model, so that rows near each other err alike."""
        return self.one_by_one or self.unlisted >= UNLISTED

    def doubted(self, lacking: float, missing: float, moved: Mapping[Key, float]) -> Self:
        """The same where what is named leaves more than noise, and no term says what that is.

        It is unlisted, at a place that nobody knows, and what is named may be a part of it: what
        moves no more than some times as much as is left. What is then not more probable than not
        is no name any more, nor is one of equals where it is not settled that one is at work.

        Args:
            lacking: Probability that more than noise is left.
            missing: Square of what is.
            moved: Squares that the causes move.
        """
        part = PART_OF_UNLISTED * lacking * (1.0 - self.conditional)
        parts = {k for k, square in moved.items() if DEVIATIONS[0] ** 2 * square <= missing}
        less: dict[Key | None, float] = dict.fromkeys(self.probabilities, 1.0)
        less |= dict.fromkeys(parts, 1.0 - part)
        left = {k: p * less[k] for k, p in self.probabilities.items()}
        mechanisms = {m: p * less.get(key_of(m), 1.0) for m, p in self.mechanisms.items()}
        # What may be a part of what is missing has its place from that.
        lost = defaultdict[Place, float](float)
        for m, p in self.mechanisms.items():
            lost[m[:2]] += p - mechanisms[m]
        return replace(
            self,
            probabilities=left,
            places={at: p - min(lost[at], part * p) for at, p in self.places.items()},
            named=frozenset(k for k in self.named if left[k] >= LEAST_NAMED or less[k] >= SETTLED),
            sensitive={k: (a * less[k], b * less[k]) for k, (a, b) in self.sensitive.items()},
            mechanisms=mechanisms,
        )

    @cached_property
    def tree(self) -> tuple[dict[str, Any], ...]:
        """Place, dependence, mechanism, as a verdict has them."""
        return tree_of(self.places, self.mechanisms, self.moved_at)


def explain(selected: SelectedModel, seed: int, unlisted: float = UNLISTED) -> Explanation:
    """The joint posterior about where a search ended.

    Args:
        selected: Where the search ended.
        seed: Of the chains.
        unlisted: Prior probability that a term is of no effect of the library.
    """
    alt = alternatives(selected.pool, selected.chosen, unlisted)
    many = len(selected.selection.keys(selected.chosen)) > MANY_CAUSES
    state, told = (_one_by_one if many else _by_chains)(selected, alt, seed)
    rows, recording = len(alt.rows), selected.pool.model.recording
    return replace(
        told,
        prior=unlisted,
        correlation=_correlation(selected, alt, state, many=many),
        worth=told.worth * rows / len(recording),
        one_by_one=many,
        compared=rows if len(recording) > MOST_COMPARED_ROWS else 0,
    )


Ended = tuple[Sequence[SelectedTerm], Explanation]  # the state that counts, words


def _by_chains(selected: SelectedModel, alt: Alternatives, seed: int) -> Ended:
    """Chains over all states, from the search's, from none and from a whole calibration."""
    gross = frozenset(chain.from_iterable(alt.gross_rows.values()))
    wide = (best_near(alt.problem, begin) for begin in begins_of(selected, alt)[1:])
    starts = [frozenset(c.index for c in selected.chosen) | gross, gross]
    starts += [frozenset[int]()] if gross else []
    starts += [frozenset(t.index for t in end) for end in wide]
    found = sample(alt.problem, starts, seed)
    told, best = _told(alt, found), found.states[0]
    logs = ((log - best[0], terms) for log, terms in found.states)
    drawn = [(log, terms) for log, terms in logs if log > LEAST_HEARD]
    # States without an unlisted mechanism, single gross rows aside.
    states = tuple((log, alt.listed(s)) for log, s in found.states if not _unlisted(alt, s))
    terms, moved = terms_of(selected, alt, found, told.named), spread(alt.problem, drawn)
    likeliest = alt.listed(best[1])
    return best[1], replace(told, terms=terms, likeliest=likeliest, states=states, spread=moved)


def _one_by_one(selected: SelectedModel, alt: Alternatives, seed: int) -> Ended:
    """Of many causes: about the best state near the search's, or near a whole calibration."""
    # At their widest: what they are off by is nobody's, and must not be taken for noise.
    gross = chain.from_iterable(alt.gross_rows.values())
    rows = [SelectedTerm(i, float(SCALES[-1])) for i in sorted(gross)]
    begins = [[*begin, *rows] for begin in begins_of(selected, alt)]
    ends = side_by_side(partial(best_near, alt.problem), begins)
    state = max(ends, key=lambda end: stated(alt.problem, end))
    # The share of what rows say about the state that their blocks agree on.
    blocks = blocks_of_each(selected.pool.model.recording)[alt.rows]
    worth = alt.agreement(blocks, state, alt.problem.variance(state))
    found = coarsened(alt.problem, state, worth, seed)
    told, swept = _told(alt, found), [terms for _, terms in found.states]
    terms = of_many(selected, alt, state, swept[0], told.named)
    theirs, better = better_by_all_rows(selected, alt, terms, found, told.named)
    listed = (alt.listed(some) for some in swept)
    told = replace(
        told,
        terms=terms,
        theirs=theirs,
        better=better,
        swept=tuple((0.0, some) for some in listed if some),
        spread=spread(alt.problem, [(0.0, some) for some in swept]),
        worth=worth,
    )
    return state, told


def _unlisted(alt: Alternatives, state: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    return [t for t in state if isinstance(alt.term(t.index), Unlisted)]


def _correlation(
    selected: SelectedModel,
    alt: Alternatives,
    state: Sequence[SelectedTerm],
    *,
    many: bool,
) -> RowNoise:
    """How far rows know of each other, by what a state leaves, or leaves without what may be noise.

    That is its unlisted, and what is listed and follows the clock.

    Its own: beside the causes of one state the unlisted of another does what none of both does.
    Where postures were read again, by what one of fewer terms leaves too.
    What many causes leave is of more still, and looks like noise of whatever moves.
    """
    pool, problem = selected.pool, alt.problem
    recording = pool.model.recording
    moving = scope_of(recording).moving
    told = recording.kind.efforts and stated_noise(recording)
    # Along one motion all that is missing wanders; several recordings are not in one order;
    # what touches of one marker share is as stated of its CT, or its place, a cause.
    in_order = not (recording.session or (moving and not told) or recording.kind.fiducials)
    late, loose = may_jitter(recording), not many and may_scatter(recording)
    if not (in_order or late or loose):
        return RowNoise(alike=recording.alike)
    trusted = pool.model.problem.weights[alt.rows] > 0.0
    recording = recording.select(alt.rows[trusted])
    again = len(np.unique(postures(recording))) < len(recording)
    lever, ones = rotation_lever(recording), np.ones_like(alt.spread)
    v = rates(recording, lever) if late else None
    moved = swings(recording, lever) if loose and not again else None

    def asked(terms: Sequence[SelectedTerm]) -> tuple[RowNoise, float] | None:
        own = alt.left(terms, problem.variance(terms)).of(trusted)
        left, spread = own.rows, alt.spread
        if late or recording.uneven:
            left, spread = before_whitening(recording, left * spread), ones
        if late or recording.uneven or many:  # an open model's rows err alike, by blocks: no noise
            own = left_by_nothing(left)
        if not late and moving and np.mean(left**2) > (EARNED * pool.noise.sigma) ** 2:
            return None  # what is missing adds to a stated noise, where noise that wanders is in it
        return correlation_of(
            left, recording, pool.noise, v, moved, in_order=in_order, spread=spread, fitted=own
        )

    if again:
        return most_probable(problem, list(taken_back(problem, state)), asked)
    # Listed causes that follow the clock, as noise that wanders may.
    lacked, terms = _unlisted(alt, state), {t: alt.term(t.index) for t in state}
    timed = [t for t, c in terms.items() if isinstance(c, Candidate) and c.effect.runs_with_time()]
    rest = [t for t in state if t not in (*lacked, *timed)]
    tried = (
        (asked([*rest, *some]), added_evidence(problem, rest, some))
        for some in ([*timed, *lacked], timed, [])
    )
    known = [(told[1] + log_odds, told[0]) for told, log_odds in tried if told]
    return max(known, default=(0.0, RowNoise()))[1]


def _told(alt: Alternatives, found: Sampled) -> Explanation:
    """Marginals by name."""
    by_label = dict(zip(alt.mechanisms, found.marginals[0].tolist(), strict=True))
    places = dict(zip(alt.places, found.marginals[1].tolist(), strict=True))
    every = np.stack([found.marginals[0], *found.sensitive])
    low, high = every.min(axis=0), every.max(axis=0)
    keyed = {key_of(m): k for k, m in enumerate(alt.mechanisms)}
    keys = {key: k for key, k in keyed.items() if key is not None}
    none = found.marginals[3]
    p = float(none[1]) if len(none) > 1 else 0.0
    said = found.marginals[2].copy()
    said[alt.words.index("")] = 0.0
    best = int(np.argmax(said))
    words = alt.words[best] if p > 0.5 else ""
    named = found.named(alt.problem, alt.kinds)
    # Where all that is named is at work: that one may be at work instead of the other is a doubt
    # about a name, not a gap that is left.
    given = found.given(alt.problem, named)
    among = none if given is None else given[3]
    # Shares by place of the square that unlisted mechanisms move, in the best state with one
    lacked = ((state, _unlisted(alt, state)) for _, state in found.states)
    state, own = next((pair for pair in lacked if pair[1]), ((), []))
    squares = _moved_at(alt, state, own)
    total = sum(squares.values())
    return Explanation(
        {key: float(found.marginals[0][k]) for key, k in keys.items()},
        {key: (float(low[k]), float(high[k])) for key, k in keys.items()},
        by_label,
        places,
        p,
        frozenset(key for key, k in keys.items() if k in named),
        words,
        {place: square / total for place, square in squares.items() if square > 0.0},
        _moved_at(alt, found.states[0][1] if found.states else ()),
        apart=found.apart,
        conditional=float(among[1]) if len(among) > 1 else 0.0,
    )


def _moved_at(
    alt: Alternatives, state: Sequence[SelectedTerm], own: Sequence[SelectedTerm] | None = None
) -> dict[Place, float]:
    """Squares by place that terms of a state, or some of them, move at their fit together."""
    indices = [t.index for t in state if not alt.problem.gross[t.index]]
    at: dict[Place, list[int]] = {}
    for i in indices if own is None else [t.index for t in own]:
        at.setdefault(place_of(alt, i), []).append(i)
    moved = moved_by(alt.problem, indices) if at else None
    return {place: moved(some) for place, some in at.items()} if moved else {}


def spread(
    problem: TermProblem, states: Sequence[tuple[float, Sequence[SelectedTerm]]]
) -> dict[int, Array]:
    """Root of the second sum for every term (k,), in units of its parameters' scales.

    Args:
        problem: The terms.
        states: Sets of them, with the log of their weight.
    """
    found: dict[int, list[tuple[float, Array]]] = defaultdict(list)
    for log, state in states:
        columns, precision = stack(problem.candidates, state, problem.variance(state))
        z, at = problem.linear.solve(columns, precision), 0
        for term in state:
            size = len(problem.candidates[term.index].columns)
            found[term.index].append((float(np.exp(log)), z[at : at + size]))
            at += size
    return {index: _deviation(*zip(*values, strict=True)) for index, values in found.items()}


def _deviation(shares: Sequence[float], values: Sequence[Array]) -> Array:
    mean = np.average(values, axis=0, weights=shares)
    return np.asarray(np.sqrt(np.average((np.array(values) - mean) ** 2, axis=0, weights=shares)))
