"""The search of one recording: gross errors out, and long recordings searched in part first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.tool_slip import ToolSlip
from plumbline.optim.core.progress import Progress
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import Pool, make_pool
from plumbline.optim.diagnosis.posterior.robust import (
    distrusted_by_fit,
    distrusted_given,
    distrusted_rows,
    lone_rows,
)
from plumbline.optim.diagnosis.posterior.search import (
    SelectedModel,
    fit,
    on_all_rows,
    ridge_of,
    search,
)
from plumbline.optim.diagnosis.prior import FEWEST_BETWEEN, LONG, ROUNDS
from plumbline.optim.measurement.correlated import trust
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.recording.recording import Recording

STEPS = (BaseBump, ToolSlip)
BRIEF = LevenbergMarquardt(max_iterations=4, tolerance=1e-6)


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be searched, and how."""

    recording: Recording  # the rows that may be used (N)
    folds: NDArray[np.intp]  # fold of every row (N,)
    noise: NoisePrior  # the prior of the noise
    fixed: tuple[Effect, ...]  # effects fitted in every model
    library: tuple[type[Effect], ...]  # effects to consider
    solver: Solver  # what fits

    @property
    def refitting(self) -> Solver:
        """What fits again from a fit nearby: few steps are enough, and many rows make them dear."""
        return BRIEF if len(self.recording) >= LONG else self.solver

    def part(self, step: int) -> Task:
        """The same task on every ``step``-th row, or every ``step``-th visit to each socket."""
        socket, count = self.recording.socket, len(self.recording)
        place = np.zeros(count, dtype=int) if socket is None else socket
        visits = [np.flatnonzero(place == k)[::step] for k in np.unique(place)]
        rows = np.sort(np.concatenate(visits))
        return replace(self, recording=self.recording.select(rows), folds=self.folds[rows])


def find_causes(
    task: Task, tell: Progress, known: NDArray[np.bool_] | None = None
) -> tuple[SelectedModel, NDArray[np.bool_]]:
    """What the search found, and which rows (N,) it distrusts; it starts from those ``known``.

    A long recording is searched in part first, and its gross rows are found by that fit: what a
    part of the rows shows need not be looked for in all of them.
    """
    if len(task.recording) < LONG:
        return _from_nothing(task, tell, ROUNDS, known)
    part = task.part(-(-len(task.recording) // LONG))
    nothing_yet = np.zeros(len(part.recording), dtype=bool)
    selected, _ = _from_nothing(part, tell, 2, nothing_yet, looks=0)
    tell("searching all rows", 0.4)
    _, resumed = on_all_rows(selected, task.recording, trust(task.recording))
    bad = distrusted_by_fit(resumed.mapped.residuals(resumed.x))
    brief = replace(task, solver=BRIEF)
    return _search(brief, bad, rounds=1, guess=selected), bad


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
        bad = distrusted_rows(pool) & ~lone_rows(task.recording)
    tell("searching for causes", 0.15)
    selected = _search(task, bad, rounds, pool)
    for _ in range(looks):
        again = distrusted_given(selected.best, task.noise.sigma, task.recording)
        again |= _rows_by_steps(task, selected, bad)
        again &= ~lone_rows(task.recording)
        if (again == bad).all():
            break
        bad = again
        selected = _search(task, bad, rounds, pool)
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
    steps = sorted((e for e in effects if isinstance(e, STEPS)), key=lambda e: e.moment)
    for gone in [*((e,) for e in steps), *pairwise(steps)]:
        kept = [e for e in effects if e not in gone]
        ridge = ridge_of(selected.selection, [effects[e] for e in kept], task.fixed)
        given = selected.best.by_name
        _, rest = fit(
            task.recording, [*task.fixed, *kept], selected.model.nuisance,
            trust(task.recording, bad), task.refitting, given, ridge,
        )  # fmt: skip
        missed = distrusted_given(rest, task.noise.sigma, task.recording)
        if missed.sum() < FEWEST_BETWEEN:
            found |= missed
    return found


def _about_nothing(task: Task) -> Pool:
    """The pool about the nominal fit to all rows."""
    weights, nuisance = trust(task.recording), nuisances_of(task.recording)
    ridge = [0.0] * len(task.fixed)
    model, nominal = fit(task.recording, task.fixed, nuisance, weights, task.solver, ridge=ridge)
    return make_pool(
        model, nominal.x, task.folds, task.noise, fixed=task.fixed, library=task.library
    )


def _search(
    task: Task,
    bad: NDArray[np.bool_],
    rounds: int,
    first: Pool | None = None,
    guess: SelectedModel | None = None,
) -> SelectedModel:
    return search(
        task.recording,
        task.folds,
        task.noise,
        weights=trust(task.recording, bad),
        first=None if bad.any() else first,  # gross rows fill the short lists of dense families
        guess=guess,
        fixed=task.fixed,
        library=task.library,
        solver=task.solver,
        rounds=rounds,
    )
