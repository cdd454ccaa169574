r"""How far the gap shrinks, on rows that neither the fit nor the selection of effects has seen.

For every fold the whole selection is made anew without it, and departs from that of all rows where
the other rows say so; the nuisances are fitted without it, and its rows are predicted. The shrink
is :math:`1 - \mathrm{after}/\mathrm{before}`, its interval a paired bootstrap over blocks of rows
(Efron and Tibshirani 1993, ch. 8).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.judged import STILL, Judged, judged_by_gram
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, bounded, flat_prior
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.selection import (
    SelectionProblem,
    restricted,
    select,
)
from plumbline.optim.diagnosis.posterior.slots import added_evidence, asked_again
from plumbline.optim.diagnosis.prior import (
    BOOTSTRAP_DRAWS,
    FOLD_BELIEVED,
    FOLD_STEPS,
    FOLD_STILL,
    HALVINGS,
    LONG,
    MANY_SLOTS,
    NO_EVIDENCE,
    ROUNDS,
    SLOW,
)
from plumbline.optim.measurement.observation import Model, build_model

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
    found = []
    banned = np.array([c.key in without for c in pool.candidates], dtype=bool)
    if given is not None and variance is None:
        variance = pool.selection.variance(given)
    for f, selection in enumerate(pool.selections):
        chosen = given
        if chosen is None:
            chosen = _chosen_anew(restricted(selection, selection.allowed & ~banned), kept)
            chosen = [*chosen, *_shown_by_fold_alone(pool, kept, f)]
        found.append(_solved(pool, chosen, f, variance or selection.variance(chosen)))
    return found


def _chosen_anew(selection: SelectionProblem, kept: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """What a selection without a fold leads to, unless that tells nothing against what is kept.

    When a tool slipped between two rows, or where play begins, those rows alone may tell. A path to
    many terms ends in another model of much the same: their slots are asked again.
    """
    kept = [c for c in kept if selection.allowed[c.index]]
    if len(kept) > MANY_SLOTS:
        return asked_again(selection, kept)
    found = select(selection, thorough=False)
    gained = added_evidence(selection, [], found) - added_evidence(selection, [], kept)
    return found if gained > NO_EVIDENCE else kept


def _shown_by_fold_alone(
    pool: Pool, terms: Sequence[SelectedTerm], f: int
) -> Iterator[SelectedTerm]:
    """Terms all of whose columns are of markers that only fold f has touched."""
    for term in terms:
        candidate = pool.candidates[term.index]
        columns = candidate.columns
        if len(_of_own_marker([candidate.effect], columns, pool.others[f])) == len(columns):
            yield term


def whole_model(pool: Pool, chosen: Sequence[SelectedTerm], variance: float) -> FoldModel:
    """The terms fitted to all rows of the pool, under their priors."""
    return _fitted(pool, chosen, variance, pool.whole, None)


def _solved(pool: Pool, chosen: Sequence[SelectedTerm], f: int, variance: float) -> FoldModel:
    """The terms fitted without fold f, under their priors."""
    return _fitted(pool, chosen, variance, pool.others[f], f)


def _fitted(
    pool: Pool, chosen: Sequence[SelectedTerm], variance: float, linear: Linear, f: int | None
) -> FoldModel:
    """Values of the nuisances and the terms; what fold f alone determines is refitted to it."""
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
    pool: Pool, folds: NDArray[np.intp], models: Sequence[FoldModel], best: Solution
) -> tuple[Array, list[Judged]]:
    """Residuals (N, m) of every row under the model made without its fold, and how each fit ended.

    All that any fold chose is linearised once more, about the fit of all rows: near enough for one
    step to each fold's own values. The residuals themselves are the true ones, not linearised.

    Args:
        pool: The candidates.
        folds: Fold of every row (N,).
        models: What was chosen without each fold.
        best: The fit of all rows.
    """
    union = _union(pool, models, best)
    whole, at = Mapped(union.problem), union.started(best.by_name)
    columns = [_columns_of(pool, union, model) for model in models]
    for _ in range(ROUNDS):
        out, foretold, values, grams = _one_step(pool, union.problem, folds, models, columns, at)
        if abs(np.sum(out[best.problem.weights > 0] ** 2) - foretold) <= FOLD_BELIEVED * foretold:
            break
        # Too far for one step: all folds moved alike, so their mean is nearer to each.
        mean = values.mean(axis=0)
        if not whole.cost(mean) < whole.cost(at):
            break
        at = mean
    ended = []
    for f, model in enumerate(models):
        x, judged = _settled(pool, union, folds == f, model, at, values[f], grams)
        ended.append(replace(judged, fit=f"the fit without fold {f + 1}"))
        if x is not values[f]:
            rows = np.flatnonzero(folds == f)
            out[rows] = Mapped(union.problem.on(union.problem.rows[rows])).residuals(x)
    return out, ended


def _settled(
    pool: Pool,
    union: Model,
    left_out: NDArray[np.bool_],
    model: FoldModel,
    start: Array,
    x: Array,
    grams: Sequence[Gram],
) -> tuple[Array, Judged]:
    """One fold's own values (P,) once no step moves them any more, and how that ended.

    The curvature is that of all folds' last step (``grams``), which is near, as long as steps with
    it come nearer; the gradient is each point's own. A step, the one from the ``start`` (P,) to the
    first values ``x`` among them, that misses the rows by more than what it leaves is halved.
    """
    problem = union.problem
    both = [Mapped(problem.part(rows)) for rows in (~left_out, left_out)]
    bends = [sum((g for k, g in enumerate(grams) if k != model.fold), Gram.empty(problem.size))]
    bends += [g for k, g in enumerate(grams) if k == model.fold]
    together = _columns_of(pool, union, model)
    found: tuple[Array, Judged, float] | None = None
    first = np.where(np.isin(np.arange(len(x)), together), start, 0.0)
    x = _nearer(both[0], first, np.clip(x, problem.lower, problem.upper))
    for _ in range(FOLD_STEPS):
        most = (1.0 + FOLD_BELIEVED) * found[2] if found else np.inf
        near = [mapped.renewed(bend, x) for mapped, bend in zip(both, bends, strict=True)]
        ended, cost, step = _judged(pool, problem, model, together, near[0], x)
        if found and not ended.stationarity < SLOW * found[1].stationarity:
            near = bends = [mapped.grams(x)[0] for mapped in both]
            ended, cost, step = _judged(pool, problem, model, together, near[0], x)
        # Standard errors to go are few as well where a step has led far off.
        if found and not (ended.stationarity < found[1].stationarity and cost < most):
            break
        found = x, ended, cost
        if ended.converged:
            break
        linear, fold = (Linear.about(g, x, problem.scale) for g in near)
        own, z = _own(pool, model, linear, together), (x + step) / problem.scale
        if len(own):
            z[own] = _refitted(fold, together, z[together], own)
        x = _nearer(both[0], x, z * problem.scale)
    assert found is not None
    return found[:2]


def _nearer(rows: Mapped, start: Array, end: Array) -> Array:
    """The end (P,) of a step, or of half of it, a quarter, ..., that leaves no more than its start.

    So far off that no residual is a number it has to be halved, too.
    """
    most = (1.0 + FOLD_BELIEVED) * np.sum(rows.white_residuals(start) ** 2)
    for _ in range(HALVINGS):
        if np.sum(rows.white_residuals(end) ** 2) <= most:
            return end
        end = (start + end) / 2.0
    return start


def _judged(
    pool: Pool, problem: Problem, model: FoldModel, together: Columns, gram: Gram, x: Array
) -> tuple[Judged, float, Array]:
    """How a fold's fit stands at x (P,) by the others' normal equations, its cost and next step.

    What its gradient presses against a bound that it rests on stays there.
    """
    ridge = np.repeat(model.ridge, [len(e.parameters) for e in model.effects])
    pull = np.concatenate([np.zeros(pool.always), ridge]) / problem.scale[together]
    # What is the fold's own is where its own rows have it: the others have no say in it.
    own = _own(pool, model, Linear.about(gram, x, problem.scale), together)
    said = ~np.isin(together, own)
    gram = gram + pool.shared_at(x[: pool.always]).padded(problem.size)
    pulled = gram.part(together[said]).pulled(pull[said], x[together[said]])
    at = together[said]
    low, high = (bound[at] - x[at] for bound in (problem.lower, problem.upper))
    held = ((low >= 0.0) & (pulled.vector > 0.0)) | ((high <= 0.0) & (pulled.vector < 0.0))
    step = np.zeros(problem.size)
    step[at] = bounded(pulled, held, low, high, problem.scale[at])
    # All that counts of a fold is what it misses rows by, which many rows hardly change.
    limit = max(STILL, FOLD_STILL * float(np.sqrt(gram.count)))
    told = judged_by_gram(pulled.part(np.flatnonzero(~held)), limit=limit)
    return told, pulled.square, step


def _columns_of(pool: Pool, union: Model, model: FoldModel) -> Columns:
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


def _one_step(
    pool: Pool,
    problem: Problem,
    folds: NDArray[np.intp],
    models: Sequence[FoldModel],
    columns: Sequence[Columns],
    at: Array,
) -> tuple[Array, float, Array, list[Gram]]:
    """True residuals (N, m), their foretold square, every fold's values (F, P), and its Gram."""
    grams = Mapped(problem).grams(at, folds)
    total = sum(grams, start=pool.shared_at(at[: pool.always]).padded(problem.size))
    out, foretold = np.empty((len(folds), problem.equations)), 0.0
    values = np.zeros((len(models), problem.size))
    for f, (model, together) in enumerate(zip(models, columns, strict=True)):
        rest = Linear.about(total - grams[f], at, problem.scale)
        fold = Linear.about(grams[f], at, problem.scale)
        z = _step(pool, rest, fold, together, model)
        rows = np.flatnonzero(folds == f)
        out[rows] = Mapped(problem.on(problem.rows[rows])).residuals(z * problem.scale)
        foretold += fold.square_at(together, z[together])
        values[f] = z * problem.scale
    return out, foretold, values, grams


def _union(pool: Pool, models: Sequence[FoldModel], best: Solution) -> Model:
    """The model of all effects that any fold chose, on the rows that are trusted."""
    fixed = [t.effect for t in pool.model.terms if t.columns.stop <= pool.always]
    effects = dict.fromkeys([*fixed, *(e for model in models for e in model.effects)])
    recording, nuisance = pool.model.recording, pool.model.nuisance
    return build_model(recording, list(effects), nuisance=nuisance, weights=best.problem.weights)


def _precisions(linear: Linear, always: int, model: FoldModel) -> Array:
    """Prior precisions of the nuisances and of a fold's effects."""
    sizes = [len(effect.parameters) for effect in model.effects]
    return np.concatenate([flat_prior(linear, always), np.repeat(model.ridge, sizes) ** 2])


def nominal_residuals(pool: Pool, nominal: Solution, folds: NDArray[np.intp]) -> Array:
    """Residuals (N, m) of every row under the nuisances alone, fitted without its fold."""
    none = [FoldModel((), np.empty(0), np.empty(0), fold=f) for f in range(len(pool.grams))]
    always = [np.arange(pool.always)] * len(none)
    return _one_step(pool, nominal.problem, folds, none, always, nominal.x)[0]


def blocks_of_rows(folds: NDArray[np.intp], separate: bool) -> NDArray[np.intp]:
    """Blocks (N,) for the bootstrap: single rows, or stretches of successive rows of one fold."""
    count = len(folds)
    if separate:
        return np.arange(count) % LONG
    length = max(1, round(np.sqrt(count)))
    labels = folds.astype(np.intp) * count + np.arange(count) // length
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.intp)


def shrink_interval(
    before: Array, after: Array, blocks: NDArray[np.intp], seed: int
) -> tuple[float, float]:
    """95 % interval of the shrink from residuals (N, m) before and after, and their blocks (N,)."""
    blocks = np.unique(blocks, return_inverse=True)[1]  # a block without rows would shrink wholly
    count = int(blocks.max(initial=0)) + 1
    b = np.bincount(blocks, (before**2).sum(axis=1), count)
    a = np.bincount(blocks, (after**2).sum(axis=1), count)
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, count, size=(BOOTSTRAP_DRAWS, count))
    whole = b[draws].sum(axis=1)
    ratio = np.divide(a[draws].sum(axis=1), whole, out=np.ones(BOOTSTRAP_DRAWS), where=whole > 0.0)
    shrink = 1 - np.sqrt(ratio)
    low, high = np.quantile(shrink, [0.025, 0.975])
    return float(low), float(high)
