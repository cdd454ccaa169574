"""Short lists of dense families: which of hundreds of orders or moments a selection may choose.

Every fold makes its own, from the rows that it may use: what all rows show must not tell it where
to look.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import Effect, Stage
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.scan import Family, Given, families
from plumbline.optim.measurement.observation import MeasurementModel
from plumbline.optim.measurement.refit import scope_for
from plumbline.optim.recording.recording import Recording

STEP_STAGES = (Stage.BASE, Stage.TOOL)  # where what is scanned is the moment of a step


def nearby(chosen: Sequence[Effect], recording: Recording) -> dict[Effect, list[Effect]]:
    """Finer variants of what was chosen; of a dense family's many, those of the first few.

    Of many causes none that stands for two: their chains fill one place after another, and
    exchange no two orders for one with its overtone.
    """
    dense = [e for e in chosen if e.scanned][: prior.MOST_REFINED]
    asked = [e for e in chosen if e in dense or not e.scanned]
    near = {e: list(e.neighbours(scope_for(e, recording))) for e in asked}
    if len({(e.name, e.element) for e in chosen}) > prior.MANY_CAUSES:
        for e in dense:
            near[e] = [v for v in near[e] if len(v.parameters) <= len(e.parameters)]
    return near


def shortlists(
    fitted: MeasurementModel,
    x: Array,
    folds: NDArray[np.intp],
    noise: NoisePrior,
    dense: Sequence[Effect],
    chosen: Sequence[Effect],
    near: Mapping[Effect, Sequence[Effect]],
) -> dict[Effect, NDArray[np.bool_]]:
    """Where each variant of a dense family may be chosen: without each fold, and on all (F + 1,).

    They are the best given what has been chosen. Given itself a chosen one has nothing left to
    explain: on all folds it stays. Without one of them the best in its place are listed as well;
    it is among them only where the others list it, for that fold must not tell. Finer variants are
    listed where the one is that they refine.

    Args:
        fitted: Nuisances and effects that have been chosen.
        x: Its fit (P,).
        folds: Fold of every row (N,).
        noise: The prior of the noise.
        dense: The scanned variants of the library.
        chosen: What has been chosen, other effects among them.
        near: Finer variants of what has been chosen.
    """
    chosen = [e for e in dict.fromkeys(chosen) if e.scanned]
    if not dense and not chosen:
        return {}
    found, base = families(fitted, x, folds, list(dict.fromkeys([*dense, *chosen])))
    count = len(base)
    held = [_own_columns(fitted, family, chosen) for family in found]
    # Inside a stretch left out all moments of a bump are alike: the chosen one, which is finer than
    # the others, would be told.
    barred = [e for e in chosen if e.port in STEP_STAGES and e not in dense]
    listed: dict[Effect, NDArray[np.bool_]] = {}
    for f in range(count + 1):
        kept = [k for k in range(count) if k != f]
        given = Given.of(_sum([base[k] for k in kept]))
        for family, own in zip(found, held, strict=True):
            best = _best(family, family.evidence(given, kept, noise), chosen)
            if own and f < count:
                columns = np.concatenate(list(own.values()))
                best += _best(family, family.evidence(given, kept, noise, columns), barred)
                best += _plain(own, given, noise)
            for effect in best:
                listed.setdefault(effect, np.zeros(count + 1, dtype=bool))[f] = True
    for effect in chosen:
        listed.setdefault(effect, np.zeros(count + 1, dtype=bool))[-1] = True
    return _with_finer(listed, {e: near.get(e, ()) for e in chosen})


def _with_finer(
    listed: dict[Effect, NDArray[np.bool_]], near: Mapping[Effect, Sequence[Effect]]
) -> dict[Effect, NDArray[np.bool_]]:
    """With finer variants where their chosen ones are listed; those of a bump on all rows alone."""
    found = dict(listed)
    for effect, finer in near.items():
        where = listed[effect].copy()
        if effect.port in STEP_STAGES:
            where[:-1] = False
        for variant in finer:
            found[variant] = found.get(variant, np.zeros_like(where)) | where
    return found


def _best(family: Family, score: Array, barred: Sequence[Effect]) -> list[Effect]:
    """The few best variants, and as many more as are worth a place; none of those barred."""
    most = max(prior.MOST_COLUMNS // len(family.effects[0].parameters), prior.LEAST_SHORTLIST)
    order = np.argsort(-score, kind="stable")[:most].tolist()
    return [
        family.effects[v]
        for rank, v in enumerate(order)
        if (rank < prior.LEAST_SHORTLIST or score[v] > prior.NO_EVIDENCE)
        and family.effects[v] not in barred
    ]


def _plain(own: Mapping[Effect, Columns], given: Given, noise: NoisePrior) -> list[Effect]:
    """Chosen variants that some folds plainly show given all else; never asked of a bump."""
    asked = (effect for effect in own if effect.port not in STEP_STAGES)
    return [effect for effect in asked if given.shows(own[effect], noise) > prior.NO_EVIDENCE]


def _own_columns(
    fitted: MeasurementModel, family: Family, chosen: Sequence[Effect]
) -> dict[Effect, NDArray[np.intp]]:
    """Columns of what has been chosen of a family's effect and element."""
    first = family.effects[0]
    mine = {e for e in chosen if (e.name, e.element) == (first.name, first.element)}
    terms = (t for t in fitted.terms if t.effect in mine)
    return {t.effect: np.arange(t.columns.start, t.columns.stop) for t in terms}


def _sum(parts: Sequence[Linear]) -> Linear:
    return Linear(
        sum((p.G for p in parts[1:]), start=parts[0].G),
        sum((p.b for p in parts[1:]), start=parts[0].b),
        sum(p.tt for p in parts),
        sum(p.n for p in parts),
    )
