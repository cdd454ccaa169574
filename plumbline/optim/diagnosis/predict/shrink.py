r"""How far the gap shrinks, on rows that neither the fit nor the selection of effects has seen.

For every fold the whole selection is made anew without it, and departs from that of all rows where
the other rows say so; the nuisances are fitted without it, and its rows are predicted. The shrink
is :math:`1 - \mathrm{after}/\mathrm{before}`, its interval a paired bootstrap over blocks of rows
(Efron and Tibshirani 1993, ch. 8).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.constants import STILL
from plumbline.optim.core.judged import Judged, Solution, judged_by_gram
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Flags, Indices, Problem
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.core.solvers.levenberg_marquardt import LevenbergMarquardt
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, flat_prior
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.selection import (
    SelectionProblem,
    restricted,
    select,
)
from plumbline.optim.diagnosis.posterior.slots import added_evidence, asked_again
from plumbline.optim.measurement.observation import MeasurementModel, build_model

# It ends at a hundredth of what a fold's square may still change by.
FOLD_SOLVER = LevenbergMarquardt(tolerance=0.01 * prior.FOLD_STILL**2)
BY_MARKER = "marker"  # what the error of one marker's place depends on


@dataclass(frozen=True, eq=False)
class FoldModel:
    """What was chosen and fitted without one fold.

    Attributes:
        effects: The chosen effects.
        values: Their values, in units of their scales, stacked.
        nuisances: The nuisances' values, in units of their scales.
        ridge: The noise over the width of each effect's prior.
        fold: The fold, from 0; None if none was left out.
    """

    effects: tuple[Effect, ...]
    values: Array
    nuisances: Array
    ridge: tuple[float, ...] = ()
    fold: int | None = None


def fold_models(
    pool: Pool,
    given: Sequence[SelectedTerm] | None = None,
    *,
    variance: float | None = None,
    without: frozenset[tuple[str, int | None]] = frozenset(),
    kept: Sequence[SelectedTerm] = (),
) -> list[FoldModel]:
    """The model without each fold in turn.

    Args:
        pool: The candidates.
        given: The terms, if only their values are to be found; else they are chosen anew.
        variance: Noise variance that weighs their priors; worked out if not given.
        without: Causes that may not be chosen.
        kept: The terms of all rows. A fold keeps those that it alone could show, such as a shift
            of a marker that no other fold has touched.
    """
    banned = np.array([c.key in without for c in pool.candidates], dtype=bool)
    folds = range(len(pool.selections))
    if given is not None:
        variance = pool.selection.variance(given) if variance is None else variance
        return [fitted_without(pool, given, f, variance) for f in folds]

    def chosen_without(f: int) -> FoldModel:
        selection = pool.selections[f]
        chosen = _chosen_anew(restricted(selection, selection.allowed & ~banned), kept)
        chosen = [*chosen, *_shown_by_fold_alone(pool, kept, f)]
        return fitted_without(pool, chosen, f, variance or selection.variance(chosen))

    return side_by_side(chosen_without, folds)


def _chosen_anew(selection: SelectionProblem, kept: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """What a selection without a fold leads to, unless that tells nothing against what is kept.

    When a tool slipped between two rows, or where play begins, those rows alone may tell. A path to
    many terms ends in another model of much the same: their slots are asked again.
    """
    kept = [c for c in kept if selection.allowed[c.index]]
    if len(kept) > prior.MANY_SLOTS:
        return asked_again(selection, kept)
    found = select(selection, thorough=False)
    gained = added_evidence(selection, [], found) - added_evidence(selection, [], kept)
    return found if gained > prior.NO_EVIDENCE else kept


def _shown_by_fold_alone(
    pool: Pool, terms: Sequence[SelectedTerm], f: int
) -> Iterator[SelectedTerm]:
    """Terms all of whose columns are of markers that only fold f has touched."""
    for term in terms:
        candidate = pool.candidates[term.index]
        columns = candidate.columns
        if len(_of_own_marker([candidate.effect], columns, pool.others[f])) == len(columns):
            yield term


def fitted_without(
    pool: Pool, chosen: Sequence[SelectedTerm], f: int | None, variance: float
) -> FoldModel:
    """The terms fitted without fold f, or to all rows, under their priors.

    What the fold alone determines is refitted to it.
    """
    linear = pool.whole if f is None else pool.others[f]
    columns, precision = stack(pool.candidates, chosen, variance)
    together = pool.columns(chosen)
    z = linear.solve(together, np.concatenate([flat_prior(linear, pool.always), precision]))
    effects = tuple(pool.candidates[c.index].effect for c in chosen)
    if f is not None:
        own = np.concatenate([pool.own_nuisances[f], _of_own_marker(effects, columns, linear)])
        if len(own):
            z[np.isin(together, own)] = _refitted(pool.folds[f], together, z, own)
    ridge = tuple(float(np.sqrt(variance)) / c.scale for c in chosen)
    return FoldModel(effects, z[pool.always :], z[: pool.always], ridge, f)


def _of_own_marker(effects: Sequence[Effect], columns: Columns, rest: Linear) -> Columns:
    """Columns of effects that tell where a marker is, of markers that no other fold has touched.

    Args:
        effects: Effects, in the order of their columns.
        columns: Their columns (K,).
        rest: The problem without the fold.
    """
    of_markers = np.repeat(
        [e.depends_on == BY_MARKER for e in effects], [len(e.parameters) for e in effects]
    )
    seen = np.diag(rest.G)[columns]
    return columns[of_markers.astype(bool) & (seen <= 1e-9 * seen.max(initial=1.0))]


def _refitted(fold: Linear, together: Columns, z: Array, own: Columns) -> Array:
    """Nuisances that no other fold knows, from the fold's own rows, all else as fitted without."""
    full = np.zeros(len(fold.b))
    full[together] = z
    full[own] = 0.0
    block = fold.G[np.ix_(own, own)]
    return np.asarray(np.linalg.lstsq(block, (fold.b - fold.G @ full)[own], rcond=1e-10)[0])


def held_out_residuals(
    pool: Pool, folds: Indices, models: Sequence[FoldModel], best: Solution
) -> tuple[Array, list[Judged]]:
    """Residuals (N, m) of every row under the model made without its fold, and how each fit ended.

    All that any fold chose is linearised once more, about the fit of all rows: near enough for one
    step to where each fold's own fit begins. The residuals are the true ones, not linearised.

    Args:
        pool: The candidates.
        folds: Fold of every row (N,).
        models: What was chosen without each fold.
        best: The fit of all rows.
    """
    union = _union(pool, models, best)
    at, problem = union.started(best.by_name), union.problem
    grams = Mapped(problem).grams(at, folds)
    total = sum(grams, start=pool.shared_at(at[: pool.always]).padded(problem.size))

    def foretold(f: int) -> tuple[Array, Judged]:
        model, both = models[f], (total - grams[f], grams[f])
        rest, fold = (Linear.about(gram, at, problem.scale) for gram in both)
        first = _step(pool, rest, fold, _columns_of(pool, union, model), model) * problem.scale
        x, judged = _settled(pool, union, folds == f, model, at, first, grams)
        residuals = Mapped(problem.on(problem.rows[folds == f])).residuals(x)
        return residuals, replace(judged, fit=f"the fit without fold {f + 1}")

    found = side_by_side(foretold, range(len(grams)))
    out = np.empty((len(folds), problem.equations))
    for f, (residuals, _) in enumerate(found):
        out[folds == f] = residuals
    return out, [judged for _, judged in found]


def _settled(
    pool: Pool,
    union: MeasurementModel,
    left_out: Flags,
    model: FoldModel,
    start: Array,
    x: Array,
    grams: Sequence[Gram],
) -> tuple[Array, Judged]:
    """One fold's own values (P,) once no step moves them any more, and how that ended.

    From its first values ``x``, or where these are no nearer from the ``start`` of all folds. What
    the fold alone determines (by all folds' ``grams``) follows from its own rows, of which others
    know nothing.
    """
    bend = sum((g for k, g in enumerate(grams) if k != model.fold), Gram.empty(union.problem.size))
    rest = Linear.about(bend, start, union.problem.scale)
    together = _columns_of(pool, union, model)
    own = _own(pool, model, rest, together)
    problem = _without_fold(pool, union, model, np.setdiff1d(together, own), ~left_out, x)
    whole, moved = Mapped(problem), np.isin(np.arange(len(x)), together)
    first = np.clip(x, problem.lower, problem.upper)
    if not whole.cost(first) <= whole.cost(np.where(moved, start, 0.0)):
        first = np.where(moved, start, 0.0)
    solution = replace(FOLD_SOLVER, still=0.5 * _still(bend.count)).on(whole, first)
    x, ended = solution.x, _judged(solution)
    if len(own):
        gram = Mapped(union.problem.part(left_out)).grams(x)[0]
        z = x / problem.scale
        z[own] = _refitted(Linear.about(gram, x, problem.scale), together, z[together], own)
        x = z * problem.scale
    return x, ended


def _without_fold(
    pool: Pool, union: MeasurementModel, model: FoldModel, free: Columns, others: Flags, x: Array
) -> Problem:
    """A fold's fit to all other rows (N,) in some unknowns, under its priors; the others stay."""
    problem, held = union.problem, np.ones(len(x), dtype=bool)
    held[free] = False
    pulls = np.zeros(len(x))
    sizes = [len(e.parameters) for e in model.effects]
    pulls[_columns_of(pool, union, model)[pool.always :]] = np.repeat(model.ridge, sizes)
    pulled = np.flatnonzero(pulls * ~held)
    near_null = (pulls / problem.scale)[pulled] * problem.x[pulled.tolist(), 0]
    return replace(
        problem.part(others),
        lower=np.where(held, x, problem.lower),
        upper=np.where(held, x, problem.upper),
        shared=cs.vertcat(problem.shared, near_null),
    )


def _still(count: float) -> float:
    """By how many standard errors a fold's fit to so many readings may still move.

    All that counts of it is what it misses rows by, which many rows hardly change.
    """
    return max(STILL, prior.FOLD_STILL * float(np.sqrt(count)))


def _judged(solution: Solution) -> Judged:
    """How a fold's fit ended; what is pressed against a bound stays there."""
    problem, x, gram = solution.problem, solution.x, solution.gram
    low, high = x <= problem.lower, x >= problem.upper
    held = (low & high) | (low & (gram.vector > 0.0)) | (high & (gram.vector < 0.0))
    return judged_by_gram(gram.part(np.flatnonzero(~held)), limit=_still(gram.count))


def _columns_of(pool: Pool, union: MeasurementModel, model: FoldModel) -> Columns:
    """Columns of what is always fitted and of a fold's effects, in the union of all folds'."""
    owners = {t.effect: t.columns for t in union.terms}
    columns = [np.arange(owners[e].start, owners[e].stop) for e in model.effects]
    return np.concatenate([np.arange(pool.always), *columns])


def _step(pool: Pool, rest: Linear, fold: Linear, together: Columns, model: FoldModel) -> Array:
    """Values (P,) in units of scale without a fold; what it alone determines from its own rows."""
    z = np.zeros(len(rest.b))
    z[together] = rest.solve(together, _precisions(rest, pool.always, model))
    own = _own(pool, model, rest, together)
    if len(own):
        z[own] = _refitted(fold, together, z[together], own)
    return z


def _own(pool: Pool, model: FoldModel, rest: Linear, together: Columns) -> Columns:
    """Nuisances, and markers' places, that only rows of the model's fold determine."""
    if model.fold is None:
        return np.empty(0, np.intp)
    markers = _of_own_marker(model.effects, together[pool.always :], rest)
    return np.concatenate([pool.own_nuisances[model.fold], markers])


def _union(pool: Pool, models: Sequence[FoldModel], best: Solution) -> MeasurementModel:
    """The model of all effects that any fold chose, on the rows that are trusted."""
    fixed = [t.effect for t in pool.model.terms if t.columns.stop <= pool.always]
    effects = dict.fromkeys([*fixed, *(e for model in models for e in model.effects)])
    recording, nuisance = pool.model.recording, pool.model.nuisance
    return build_model(recording, list(effects), nuisance=nuisance, weights=best.problem.weights)


def _precisions(linear: Linear, always: int, model: FoldModel) -> Array:
    """Prior precisions of the nuisances and of a fold's effects."""
    sizes = [len(effect.parameters) for effect in model.effects]
    return np.concatenate([flat_prior(linear, always), np.repeat(model.ridge, sizes) ** 2])


def nominal_residuals(pool: Pool, nominal: Solution, folds: Indices) -> Array:
    """Residuals (N, m) of every row under the nuisances alone, fitted without its fold."""
    none = [FoldModel((), np.empty(0), np.empty(0), fold=f) for f in range(len(pool.grams))]
    return held_out_residuals(pool, folds, none, nominal)[0]


def blocks_of_rows(folds: Indices, separate: bool) -> Indices:
    """Blocks (N,) for the bootstrap: single rows, or stretches of successive rows of one fold."""
    count = len(folds)
    if separate:
        return np.arange(count) % prior.MANY_ROWS
    length = max(1, round(np.sqrt(count)))
    labels = folds.astype(np.intp) * count + np.arange(count) // length
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.intp)


def shrink_interval(before: Array, after: Array, blocks: Indices, seed: int) -> tuple[float, float]:
    """95 % interval of the shrink from residuals (N, m) before and after, and their blocks (N,)."""
    blocks = np.unique(blocks, return_inverse=True)[1]  # a block without rows would shrink wholly
    count = int(blocks.max(initial=0)) + 1
    b = np.bincount(blocks, (before**2).sum(axis=1), count)
    a = np.bincount(blocks, (after**2).sum(axis=1), count)
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, count, size=(prior.BOOTSTRAP_DRAWS, count))
    whole = b[draws].sum(axis=1)
    ratio = np.divide(
        a[draws].sum(axis=1), whole, out=np.ones(prior.BOOTSTRAP_DRAWS), where=whole > 0.0
    )
    shrink = 1 - np.sqrt(ratio)
    low, high = np.quantile(shrink, [0.025, 0.975])
    return float(low), float(high)


def gap_between(
    unit: str,
    sides: tuple[float, float],
    noise: NoiseLevel,
    floor: float,
    interval: tuple[float, float],
    by: str,
) -> Gap:
    """The gap before and after, and how much of what the noise's floor leaves is gone [unit]."""
    before, after = sides
    room = before - floor
    known = noise.source != "fit" and before > prior.EARNED * floor
    shrink = 1.0 - after / before if before > 0.0 else 0.0
    removable = (before - after) / room if known else math.nan
    return Gap(
        unit, before, after, float(floor), float(shrink), interval,
        held_out_by=by, removable=float(removable),
    )  # fmt: skip
