"""The search: fit, linearise, select, refit, until the chosen effects no longer change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import EFFECTS, Effect
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import Pool, make_pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem, select
from plumbline.optim.diagnosis.prior import ROUNDS, WIDE_PRIOR
from plumbline.optim.measurement.nuisance import Nuisance, nuisances_of
from plumbline.optim.measurement.observation import Model, build_model
from plumbline.optim.recording.recording import Recording

SOLVER = LevenbergMarquardt(max_iterations=20, tolerance=1e-8)
NAMED = 4  # causes that a line names


@dataclass(frozen=True, eq=False)
class SelectedModel:
    """Where the search ended."""

    nominal: Solution  # the fit of the nuisances alone
    best: Solution  # the fit with the chosen effects
    model: Model  # the model of that fit
    pool: Pool  # all candidates, linearised about the last fit but one
    selection: SelectionProblem  # the last selection problem
    chosen: tuple[SelectedTerm, ...]  # the terms that were selected
    rounds: int  # how many rounds it took
    fixed: tuple[Effect, ...] = ()  # effects fitted in every model
    # causes that the search named and that were excluded since
    excluded: frozenset[tuple[str, int | None]] = frozenset()
    # sets of terms of the library that the joint posterior weighed, with the log of their weight,
    # best first; none of many causes
    states: tuple[tuple[float, tuple[SelectedTerm, ...]], ...] = ()
    barred: frozenset[tuple[str, int | None]] = frozenset()  # those of them that no fold may choose

    def __repr__(self) -> str:
        """How many effects of how many candidates, and the first of them."""
        labels = list(dict.fromkeys(effect.label for effect in self.effects))
        named = ", ".join(labels[:NAMED]) + (", ..." if len(labels) > NAMED else "")
        of = len(self.pool.candidates)
        return f"<SelectedModel: {len(labels)} causes among {of} candidates: {named or 'none'}>"

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The chosen effects, as the last selection has them."""
        return tuple(self.selection.candidates[c.index].effect for c in self.chosen)

    @property
    def effects_of_fit(self) -> tuple[Effect, ...]:
        """The effects of the last fit, those that are always fitted first."""
        return tuple(t.effect for t in self.model.terms)


def search(
    recording: Recording,
    folds: NDArray[np.intp],
    noise: NoisePrior,
    *,
    weights: Array,
    first: Pool | None = None,
    guess: SelectedModel | None = None,
    fixed: Sequence[Effect] = (),
    library: Sequence[type[Effect]] = EFFECTS,
    solver: Solver | None = None,
    rounds: int = ROUNDS,
) -> SelectedModel:
    """Find the effects of a recording.

    Args:
        recording: N rows, all of which may be used.
        folds: Fold of every row (N,).
        noise: The prior of the noise.
        weights: Weights of the rows (N,), 0 for rows that are distrusted.
        first: The pool about the nominal fit, where it has been made already.
        guess: What was found on a part of the rows, to start from.
        fixed: Effects fitted in every model.
        library: Effects to consider.
        solver: What fits; see :data:`SOLVER` for the default.
        rounds: How often to linearise at the most.
    """
    solver = solver or SOLVER
    resumed = on_all_rows(guess, recording, weights) if guess else None
    nuisance = resumed[0].nuisance if resumed else nuisances_of(recording)
    model, nominal = fit(recording, fixed, nuisance, weights, solver, ridge=[0.0] * len(fixed))
    best = nominal
    if resumed:
        model, best = resumed
    known: list[set[Effect]] = []
    scales: dict[Effect, float] = {}
    for turn in range(1, rounds + 1):
        pool = (
            first
            if turn == 1 and first
            else make_pool(model, best.x, folds, noise, fixed=fixed, library=library)
        )
        selection = pool.selection
        place = {c.effect: k for k, c in enumerate(pool.candidates)}
        before = [SelectedTerm(place[e], scale) for e, scale in scales.items()]
        chosen = select(selection, thorough=turn == 1, before=before)
        effects = [selection.candidates[c.index].effect for c in chosen]
        if known and set(effects) == known[-1]:
            chosen = _in_order_of(model, selection, chosen)
            break
        scales = {e: c.scale for e, c in zip(effects, chosen, strict=True)}
        going_round = set(effects) in known
        known.append(set(effects))
        start = best.by_name
        ridge = ridge_of(selection, chosen, fixed)
        model, best = fit(recording, [*fixed, *effects], nuisance, weights, solver, start, ridge)
        if not effects or going_round:
            break
    return SelectedModel(nominal, best, model, pool, selection, tuple(chosen), turn, tuple(fixed))


def on_all_rows(
    guess: SelectedModel, recording: Recording, weights: Array
) -> tuple[Model, Solution]:
    """The model that was found on a part of the rows, where it ended, of all of them.

    A frame's numbers are told from where it was registered; sockets are numbered by those that are
    visited, and how much their known distances count depends on all visits.
    """
    sockets = recording.kind.sockets
    nuisance = nuisances_of(recording) if sockets else guess.model.nuisance
    model = build_model(recording, guess.effects_of_fit, nuisance=nuisance, weights=weights)
    return model, Solution(model.problem, model.started(guess.best.by_name))


def foretold_wrongly(selected: SelectedModel) -> float:
    """By how much the linear problem errs about what the fit leaves of the rows [nats]."""
    pool, best, model = selected.pool, selected.best, selected.model
    mine = {term.effect: term.columns for term in model.terms}
    own = [(selected.selection.candidates[c.index].columns, mine[e])
           for c, e in zip(selected.chosen, selected.effects, strict=True)]  # fmt: skip
    always = np.arange(pool.always)
    columns = np.concatenate([always, *(there for there, _ in own)])
    x = np.concatenate([best.x[always], *(best.x[here] for _, here in own)])
    rows = Linear.about(sum(pool.grams[1:], start=pool.grams[0]), pool.x, pool.model.problem.scale)
    foretold = rows.square_at(columns, x / pool.model.problem.scale[columns])
    left = (best.gram - best.mapped.shared_gram(best.x)).square
    return abs(foretold - left) / (2.0 * selected.selection.variance(selected.chosen))


def about_its_fit(
    selected: SelectedModel, library: Sequence[type[Effect]] = EFFECTS
) -> SelectedModel:
    """The same model, with all candidates linearised anew about its fit."""
    before, best = selected.pool, selected.best
    pool = make_pool(
        selected.model, best.x, before.fold_of_row, before.noise,
        fixed=selected.fixed, library=library,
    )  # fmt: skip
    place = {c.effect: k for k, c in enumerate(pool.candidates)}
    chosen = tuple(
        SelectedTerm(place[effect], term.scale)
        for effect, term in zip(selected.effects, selected.chosen, strict=True)
    )
    return replace(selected, pool=pool, selection=pool.selection, chosen=chosen)


def _in_order_of(
    model: Model, selection: SelectionProblem, chosen: Sequence[SelectedTerm]
) -> list[SelectedTerm]:
    """The same terms in the order of the model's."""
    place = {term.effect: k for k, term in enumerate(model.terms)}
    return sorted(chosen, key=lambda c: place[selection.candidates[c.index].effect])


def fit(
    recording: Recording,
    effects: Sequence[Effect],
    nuisance: Nuisance,
    weights: Array,
    solver: Solver,
    start: Mapping[str, float] | None = None,
    ridge: Sequence[float] | None = None,
) -> tuple[Model, Solution]:
    """Fit the nuisances and some effects, from named start values where there are any.

    With a ridge the fit is the most probable one under the priors that the evidence assumed, so
    that what the data do not determine stays at its null.
    """
    model = build_model(recording, effects, nuisance=nuisance, weights=weights, ridge=ridge)
    return model, solver.solve(model.problem, model.started(start or {}))


def ridge_of(
    selection: SelectionProblem, chosen: Sequence[SelectedTerm], fixed: Sequence[Effect]
) -> list[float]:
    """The ridge of every effect: the noise over the width of its prior."""
    sigma = float(np.sqrt(selection.variance(chosen)))
    return [sigma / WIDE_PRIOR] * len(fixed) + [sigma / c.scale for c in chosen]
