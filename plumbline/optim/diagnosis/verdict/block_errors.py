r"""Standard errors from blocks of rows: how far estimates move when a block is left out.

Where something is missing in the model, what it leaves is no noise: rows near each other err alike,
and however many they are, the estimates of another recording differ by more than the rows' number
tells. With the normal equations A and gradient g of each block b, one step of Gauss and Newton from
the fit of all rows gives the fit without it, and the jackknife (Efron and Tibshirani 1993, ch. 11;
by blocks, Kuensch 1989, Annals of Statistics 17(3))

.. math:: \delta_b = (A - A_b)^{-1} g_b, \qquad
          s^2 = \frac{B - 1}{B} \sum_b (\delta_b - \bar\delta)^2.

The same is taken of the fits without each fold, for which effects were chosen anew: what is chosen
beside an effect moves its estimate too. The larger counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import JITTER
from plumbline.optim.diagnosis.linearise.linear import solved
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.folds import blocks_of
from plumbline.optim.diagnosis.predict.shrink import FoldModel


def block_errors(selected: SelectedModel, models: Sequence[FoldModel] = ()) -> Array:
    """Standard errors (P,) of a fit's unknowns.

    Args:
        selected: The model, fitted to all rows.
        models: What was chosen and fitted without each fold: where others beside it are chosen, an
            effect's estimate moves further than without a block.
    """
    best, S = selected.best, selected.best.problem.scale
    blocks = blocks_of(selected.model.recording)
    A = best.gram.matrix * np.outer(S, S)
    ridge = JITTER * np.diag(np.diag(A))
    moved = np.array(
        [
            solved(A - gram.matrix * np.outer(S, S) + ridge, gram.vector * S) * S
            for gram in best.mapped.grams(best.x, blocks)
        ]
    )
    errors = np.sqrt((len(moved) - 1) * np.var(moved, axis=0))
    return np.maximum(errors, _chosen_anew(selected, models))


def _chosen_anew(selected: SelectedModel, models: Sequence[FoldModel]) -> Array:
    """Errors (P,) by the folds that chose an effect all the same; 0 where fewer than two did."""
    errors = np.zeros(selected.best.problem.size)
    values = [_values(model) for model in models]
    for term in selected.model.terms:
        found = np.array([known[term.effect] for known in values if term.effect in known])
        if len(found) > 1 and found.size:
            size = [p.scale for p in term.effect.parameters]
            errors[term.columns] = np.sqrt((len(models) - 1) * np.var(found, axis=0)) * size
    return errors


def _values(model: FoldModel) -> dict[Effect, Array]:
    """Each effect's values, in units of their scales."""
    ends = np.cumsum([len(effect.parameters) for effect in model.effects], dtype=int)
    pairs = zip(model.effects, ends, strict=True)
    return {effect: model.values[k - len(effect.parameters) : k] for effect, k in pairs}
