"""The search: fit, linearise, select, refit, until the chosen effects no longer change.

Gross errors are left out, and long recordings are searched in part first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import EFFECTS, Effect
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.tool_slip import ToolSlip
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.diagnosis.constants import LISTED
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior import robust
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import Pool, make_pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem, select
from plumbline.optim.diagnosis.prior import FEWEST_BETWEEN, MANY_ROWS, ROUNDS, WIDE_PRIOR
from plumbline.optim.measurement.correlated import trust
from plumbline.optim.measurement.nuisance import Nuisance, nuisances_of
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.recording.recording import Recording

SOLVER = LevenbergMarquardt(max_iterations=20, tolerance=1e-8)
STEP_EFFECTS = (BaseBump, ToolSlip)  # effects that move all later rows at once
BRIEF = LevenbergMarquardt(max_iterations=8, tolerance=1e-6)


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be searched, and how."""

    recording: Recording  # the rows that may be used (N)
    folds: NDArray[np.intp]  # fold of every row (N,)
    noise: NoisePrior  # the prior of the noise
    fixed: tuple[Effect, ...] = ()  # effects fitted in every model
    library: tuple[type[Effect], ...] = EFFECTS  # effects to consider
    solver: Solver = SOLVER  # what fits

    @property
    def long(self) -> bool:
        """Whether it is searched in part first, and linearised once: many rows make both dear."""
        return len(self.recording) >= MANY_ROWS

    @property
    def refitting(self) -> Solver:
        """What fits again from a fit nearby: of a long recording few steps are enough."""
        return BRIEF if self.long else self.solver

    def part(self, step: int) -> Self:
        """The same task on every ``step``-th row, or every ``step``-th visit to each socket."""
        socket, count = self.recording.socket, len(self.recording)
        place = np.zeros(count, dtype=int) if socket is None else socket
        visits = [np.flatnonzero(place == k)[::step] for k in np.unique(place)]
        rows = np.sort(np.concatenate(visits))
        return replace(self, recording=self.recording.select(rows), folds=self.folds[rows])

    def pool(self, model: MeasurementModel, fitted: Solution) -> Pool:
        """The candidates, linearised about a fit."""
        return make_pool(
            model, fitted.x, self.folds, self.noise, fixed=self.fixed, library=self.library
        )


@dataclass(frozen=True, eq=False)
class SelectedModel:
    """Where the search ended."""

    nominal: Solution  # the fit of the nuisances alone
    best: Solution  # the fit with the chosen effects
    model: MeasurementModel  # the model of that fit
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
        named = ", ".join(labels[:LISTED]) + (", ..." if len(labels) > LISTED else "")
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


def find_causes(
    task: Task, tell: Progress, known: NDArray[np.bool_] | None = None
) -> tuple[SelectedModel, NDArray[np.bool_]]:
    """What the search found, and which rows (N,) it distrusts; it starts from those ``known``.

    A long recording is searched in part first, and its gross rows are found by that fit: what a
    part of the rows shows need not be looked for in all of them.
    """
    if not task.long:
        return _from_nothing(task, tell, ROUNDS, known)
    part = task.part(-(-len(task.recording) // MANY_ROWS))
    nothing_yet = np.zeros(len(part.recording), dtype=bool)
    selected, _ = _from_nothing(part, tell, 2, nothing_yet, looks=0)
    tell("searching all rows", 0.4)
    _, resumed = on_all_rows(selected, task.recording, trust(task.recording))
    bad = robust.distrusted_by_fit(resumed.mapped.residuals(resumed.x))
    brief = replace(task, solver=BRIEF)
    return search(brief, bad, rounds=1, guess=selected), bad


def _from_nothing(
    task: Task,
    tell: Progress,
    rounds: int,
    known: NDArray[np.bool_] | None,
    looks: int = ROUNDS,
) -> tuple[SelectedModel, NDArray[np.bool_]]:
    tell("looking for gross errors", 0.0)
    pool, bad = None, known
    if bad is None:
        pool = _about_nothing(task)
        bad = robust.distrusted_rows(pool) & ~robust.lone_rows(task.recording)
    tell("searching for causes", 0.15)
    selected = search(task, bad, rounds, pool)
    for _ in range(looks):
        again = robust.distrusted_given(selected.best, task.noise.sigma, task.recording)
        again |= _rows_by_steps(task, selected, bad)
        again &= ~robust.lone_rows(task.recording)
        if (again == bad).all():
            break
        bad = again
        selected = search(task, bad, rounds, pool)
    return selected, bad


def _rows_by_steps(
    task: Task, selected: SelectedModel, bad: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Rows (N,) that bumps or slips explain where few rows alone are missed by far without.

    A step of the base or the tool beside a few rows, and two on both sides of them, are gross
    errors by another name: such rows are judged by the fit without one, and without two together.
    """
    found = np.zeros(len(task.recording), dtype=bool)
    effects = dict(zip(selected.effects, selected.chosen, strict=True))
    steps = sorted((e for e in effects if isinstance(e, STEP_EFFECTS)), key=lambda e: e.moment)
    for gone in [*((e,) for e in steps), *pairwise(steps)]:
        kept = [e for e in effects if e not in gone]
        ridge = ridge_of(selected.selection, [effects[e] for e in kept], task.fixed)
        given = selected.best.by_name
        _, rest = fit(
            task.recording, [*task.fixed, *kept], selected.model.nuisance,
            trust(task.recording, bad), task.refitting, given, ridge,
        )  # fmt: skip
        missed = robust.distrusted_given(rest, task.noise.sigma, task.recording)
        if missed.sum() < FEWEST_BETWEEN:
            found |= missed
    return found


def _about_nothing(task: Task) -> Pool:
    """The pool about the nominal fit to all rows."""
    weights, nuisance = trust(task.recording), nuisances_of(task.recording)
    ridge = [0.0] * len(task.fixed)
    model, nominal = fit(task.recording, task.fixed, nuisance, weights, task.solver, ridge=ridge)
    return task.pool(model, nominal)


def search(
    task: Task,
    bad: NDArray[np.bool_],
    rounds: int = ROUNDS,
    first: Pool | None = None,
    guess: SelectedModel | None = None,
) -> SelectedModel:
    """Find the effects of a recording.

    Args:
        task: What is to be searched.
        bad: Rows (N,) that are distrusted.
        rounds: How often to linearise at the most.
        first: The pool about the nominal fit to all rows, where it has been made already.
        guess: What was found on a part of the rows, to start from.
    """
    recording, fixed, solver = task.recording, task.fixed, task.solver
    weights = trust(recording, bad)
    resumed = on_all_rows(guess, recording, weights) if guess else None
    nuisance = resumed[0].nuisance if resumed else nuisances_of(recording)
    model, nominal = fit(recording, fixed, nuisance, weights, solver, ridge=[0.0] * len(fixed))
    best = nominal
    if resumed:
        model, best = resumed
    known: list[set[Effect]] = []
    scales: dict[Effect, float] = {}
    for turn in range(1, rounds + 1):
        # Gross rows fill the short lists of dense families.
        known_pool = first if turn == 1 and not bad.any() else None
        pool = known_pool or task.pool(model, best)
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
    return SelectedModel(nominal, best, model, pool, selection, tuple(chosen), turn, fixed)


def on_all_rows(
    guess: SelectedModel, recording: Recording, weights: Array
) -> tuple[MeasurementModel, Solution]:
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
    scale = pool.model.problem.scale
    none, z = Linear.about(pool.shared, pool.x, scale), x / scale[columns]
    foretold = pool.whole.square_at(columns, z) - none.square_at(columns, z)
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
    model: MeasurementModel, selection: SelectionProblem, chosen: Sequence[SelectedTerm]
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
) -> tuple[MeasurementModel, Solution]:
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
