r"""How far the gap shrinks, on rows that neither the fit nor the choice of effects has seen.

For every fold the whole selection is made anew without it, the nuisances are fitted without it, and
its rows are predicted. The shrink is :math:`1 - \mathrm{after}/\mathrm{before}`, its interval a
paired bootstrap over blocks of rows (Efron and Tibshirani 1993, ch. 8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.effects import Effect
from optim.diagnosis.linear import Columns, Linear, flat_prior
from optim.diagnosis.pool import Pool
from optim.diagnosis.reduction import Choice, stack
from optim.diagnosis.selection import restricted, select
from optim.mapped import Mapped
from optim.observation import build_model
from optim.problem import Array

DRAWS = 1000


@dataclass(frozen=True, eq=False)
class FoldModel:
    """What was chosen and fitted without one fold.

    Attributes:
        effects: The chosen effects.
        values: Their values, in units of their scales, stacked.
        nuisances: The nuisances' values, in units of their scales.
    """

    effects: tuple[Effect, ...]
    values: Array
    nuisances: Array


def fold_models(
    pool: Pool,
    given: Sequence[Choice] | None = None,
    *,
    variance: float | None = None,
    without: frozenset[tuple[str, int | None]] = frozenset(),
) -> list[FoldModel]:
    """The model without each fold in turn.

    Args:
        pool: The candidates.
        given: The choices, if only their values are to be found; else they are chosen anew.
        variance: Noise variance that weighs their priors; worked out if not given.
        without: Causes that may not be chosen.
    """
    found = []
    banned = np.array([c.key in without for c in pool.candidates], dtype=bool)
    if given is not None and variance is None:
        variance = pool.question.variance(given)
    for f, question in enumerate(pool.questions):
        chosen = given
        if chosen is None:
            chosen = select(restricted(question, question.allowed & ~banned), thorough=False)
        found.append(_solved(pool, chosen, f, variance or question.variance(chosen)))
    return found


def _solved(pool: Pool, chosen: Sequence[Choice], f: int, variance: float) -> FoldModel:
    """Values of the nuisances and the choices without fold f, under the choices' priors."""
    linear = pool.others[f]
    columns, precision = stack(pool.candidates, chosen, variance)
    together = np.concatenate([np.arange(pool.always), columns])
    z = linear.solve(together, np.concatenate([flat_prior(linear, pool.always), precision]))
    own = pool.own_nuisances[f]
    if len(own):
        z[own] = _refitted(pool.folds[f], together, z, own)
    effects = tuple(pool.candidates[c.index].effect for c in chosen)
    return FoldModel(effects, z[pool.always :], z[: pool.always])


def _refitted(fold: Linear, together: Columns, z: Array, own: Columns) -> Array:
    """Nuisances that no other fold knows, from the fold's own rows, all else as fitted without."""
    full = np.zeros(len(fold.b))
    full[together] = z
    full[own] = 0.0
    block = fold.G[np.ix_(own, own)]
    return np.asarray(np.linalg.lstsq(block, (fold.b - fold.G @ full)[own], rcond=1e-10)[0])


def held_out_residuals(pool: Pool, folds: NDArray[np.intp], models: Sequence[FoldModel]) -> Array:
    """Residuals (N, m) of every row under the model that was made without its fold."""
    effects = list(dict.fromkeys(e for m in models for e in m.effects))
    terms = {t.effect: t.columns for t in pool.model.terms}
    fixed = [t.effect for t in pool.model.terms if t.columns.stop <= pool.always]
    narrow = build_model(pool.model.recording, [*fixed, *effects], nuisance=pool.model.nuisance)
    columns = [np.arange(pool.always)] + [np.arange(terms[e].start, terms[e].stop) for e in effects]
    x = pool.x[np.concatenate(columns)]
    where = {t.effect: t.columns for t in narrow.terms}
    scale = narrow.problem.scale
    shifts = np.tile(-x / scale, (len(models), 1))
    for f, model in enumerate(models):
        shifts[f, : pool.always] += model.nuisances
        first = 0
        for effect in model.effects:
            part = where[effect]
            shifts[f, part] += model.values[first : first + part.stop - part.start]
            first += part.stop - part.start
    out = np.empty((len(folds), narrow.problem.equations))
    steps = shifts * scale
    for part, r, J in Mapped(narrow.problem).jacobians(x):
        out[part] = r + np.einsum("nmp,np->nm", J, steps[folds[part]])
    return out


def blocks_of_rows(folds: NDArray[np.intp], separate: bool) -> NDArray[np.intp]:
    """Blocks (N,) for the bootstrap: single rows, or stretches of successive rows of one fold."""
    count = len(folds)
    if separate:
        return np.arange(count)
    length = max(1, round(np.sqrt(count)))
    labels = folds.astype(np.intp) * count + np.arange(count) // length
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.intp)


def shrink_interval(
    before: Array, after: Array, blocks: NDArray[np.intp], seed: int
) -> tuple[float, float]:
    """95 % interval of the shrink from residuals (N, m) before and after."""
    count = int(blocks.max(initial=0)) + 1
    b = np.bincount(blocks, (before**2).sum(axis=1), count)
    a = np.bincount(blocks, (after**2).sum(axis=1), count)
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, count, size=(DRAWS, min(count, 2000)))
    shrink = 1 - np.sqrt(a[draws].sum(axis=1) / np.maximum(b[draws].sum(axis=1), 1e-300))
    low, high = np.quantile(shrink, [0.025, 0.975])
    return float(low), float(high)
