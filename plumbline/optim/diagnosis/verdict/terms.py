"""The terms of the library that are fitted of what a posterior says: of few causes, and of many.

What is named is in them. Where all rows prefer what chains came to, that is told too.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumbline.optim.core.problem import Flags
from plumbline.optim.diagnosis.discrepancy.alternatives import Alternatives, Unlisted
from plumbline.optim.diagnosis.discrepancy.spectra import Spectrum
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.joint import Sampled
from plumbline.optim.diagnosis.posterior.joint_problem import stated
from plumbline.optim.diagnosis.posterior.one_by_one import best_near
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel, Task, fit, ridge_of
from plumbline.optim.diagnosis.posterior.selection import restricted
from plumbline.optim.diagnosis.prior import MOST_COMPARED_ROWS
from plumbline.optim.diagnosis.verdict.tree import Place
from plumbline.optim.measurement.correlated import trust


def begins_of(selected: SelectedModel, alt: Alternatives) -> list[list[SelectedTerm]]:
    """Where a posterior is looked for: the search's terms, whole spectra, and a whole calibration.

    Whole spectra stand in place of the orders of gears, which a climb that exchanges one term at a
    time keeps. A whole calibration is every effect that the search has found somewhere, at all
    places. What one error of many does another place or a function may do as well, so that a search
    that adds one after the other does not come by. All rows of a long recording have told the
    search's terms.
    """
    begins = [[*selected.chosen]]
    if (spectra := alt.with_spectra(selected.chosen)) != begins[0]:
        begins.append(spectra)
    if len(selected.pool.model.recording) > MOST_COMPARED_ROWS:
        return begins
    every = selected.selection.candidates
    mine = {every[t.index].key for t in selected.chosen}
    names = {e.name for e in selected.effects if not e.scanned}
    first = {c.key: k for k, c in reversed(list(enumerate(every))) if c.effect.name in names}
    more = sorted(k for key, k in first.items() if key not in mine)
    return [*begins, [*selected.chosen, *(SelectedTerm(k, 1.0) for k in more)]]


def of_many(
    selected: SelectedModel,
    alt: Alternatives,
    state: Sequence[SelectedTerm],
    agreed: Sequence[SelectedTerm],
    named: frozenset[Key],
) -> tuple[SelectedTerm, ...]:
    """Terms of a state of many causes.

    Of a long recording only some rows are compared, so what these do not show stays as all rows
    have it. What is named with it is of the state that blocks of rows agree on.
    """
    long = len(selected.pool.model.recording) > MOST_COMPARED_ROWS
    terms = selected.chosen if long else _fitted(selected, alt, state)
    untold = named - selected.selection.keys(terms)
    keys = [c.key for c in selected.selection.candidates]
    more = [t for t in alt.listed(agreed) if keys[t.index] in untold]
    return _joined(alt, terms, more, long=long)


def better_by_all_rows(
    selected: SelectedModel,
    alt: Alternatives,
    terms: Sequence[SelectedTerm],
    found: Sampled,
    named: frozenset[Key],
) -> tuple[tuple[SelectedTerm, ...], float]:
    """Terms near the chains' best state, and by how much all rows prefer these to others [nats].

    Chains pass what a search from nothing does not, as of a gently moved arm its rotors. What the
    library lacks foretells nothing, so it is left out on both sides. Of a long recording only some
    rows are asked.
    """
    if len(selected.pool.model.recording) > MOST_COMPARED_ROWS:
        return (), 0.0
    agreed = found.states[0][1]
    near = best_near(alt.problem, agreed)
    theirs = of_many(selected, alt, near, agreed, named)
    gross = [t for t in near if alt.problem.gross[t.index]]
    ours, other = (stated(alt.problem, [*some, *gross]) for some in (terms, theirs))
    return theirs, other - ours


def _fitted(
    selected: SelectedModel, alt: Alternatives, state: Sequence[SelectedTerm]
) -> tuple[SelectedTerm, ...]:
    """Listed terms of a state, and confounded ones, which are fitted, not named.

    Where something that the library lacks is more probable at a place, the effect that the search
    took for it still foretells better than nothing does. So does that beside whose orders a gear's
    spectrum does without it: these are fewer.
    """
    mine = alt.listed(state)
    key = [c.key for c in selected.selection.candidates]
    held = {key[t.index] for t in mine}
    lacked = {place_of(alt, t.index) for t in state if isinstance(alt.term(t.index), Unlisted)}
    whole = {_dependence(alt, t.index) for t in state if isinstance(alt.term(t.index), Spectrum)}

    def confounded(term: SelectedTerm) -> bool:
        return place_of(alt, term.index) in lacked or _dependence(alt, term.index) in whole

    return (*mine, *(t for t in selected.chosen if confounded(t) and key[t.index] not in held))


def _joined(
    alt: Alternatives, terms: Sequence[SelectedTerm], more: Sequence[SelectedTerm], *, long: bool
) -> tuple[SelectedTerm, ...]:
    """Terms, and more that blocks of rows agree on, in place of what the search took for these.

    Of a long recording besides: all rows have told the terms, and what is more but some of them.
    """
    held = {_dependence(alt, t.index) for t in more}
    return (*(t for t in terms if long or _dependence(alt, t.index) not in held), *more)


def place_of(alt: Alternatives, index: int) -> Place:
    """The place of a term, by its number."""
    return alt.places[int(alt.problem.labels[1][index])]


def _dependence(alt: Alternatives, index: int) -> tuple[str, int | None, str]:
    return alt.mechanisms[int(alt.problem.labels[0][index])][:3]


def terms_of(
    selected: SelectedModel, alt: Alternatives, found: Sampled, named: frozenset[Key]
) -> tuple[SelectedTerm, ...]:
    """Terms of the best state that holds all that is named."""
    candidates = selected.selection.candidates
    for _, state in (*found.states, (0.0, selected.chosen)):
        if named <= {candidates[t.index].key for t in alt.listed(state)}:
            return _fitted(selected, alt, state)
    mine = [t for t in selected.chosen if candidates[t.index].key in named]
    missing = named - {candidates[t.index].key for t in mine}
    first = {c.key: i for i, c in reversed(list(enumerate(candidates)))}
    return (*mine, *(SelectedTerm(first[key], 1.0) for key in sorted(missing, key=str)))


def with_terms(
    selected: SelectedModel,
    terms: Sequence[SelectedTerm],
    task: Task,
    bad: Flags,
    tried: Sequence[SelectedTerm] = (),
) -> SelectedModel:
    """The model of these terms, fitted; causes that it lacks of those tried are excluded from it.

    Args:
        selected: Where a search ended; what it chose has been tried.
        terms: The terms.
        task: What was searched: its rows (N) are fitted again.
        bad: Which of them are taken for gross errors (N,).
        tried: Terms that have been tried with them.
    """
    candidates = selected.selection.candidates
    named = {candidates[t.index].key for t in terms}
    gone = {candidates[t.index].key for t in (*selected.chosen, *tried)} - named
    excluded = (selected.excluded | gone) - named
    banned: Flags = np.array([c.key in excluded for c in candidates], dtype=bool)
    selection = restricted(selected.pool.selection, selected.pool.selection.allowed & ~banned)
    if {t.index for t in terms} == {t.index for t in selected.chosen}:
        return replace(selected, selection=selection, excluded=frozenset(excluded))
    effects = [*selected.fixed, *(candidates[t.index].effect for t in terms)]
    ridge = ridge_of(selection, terms, selected.fixed)
    model, best = fit(
        task.recording, effects, selected.model.nuisance, trust(task.recording, bad),
        task.refitting, selected.best.by_name, ridge,
    )  # fmt: skip
    return replace(
        selected,
        model=model,
        best=best,
        selection=selection,
        chosen=tuple(terms),
        excluded=frozenset(excluded),
    )
