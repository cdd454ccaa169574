"""The causes of a verdict: their estimates, held-out figures and confounded effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.friction import Friction
from plumbline.optim.core.constants import NEAR
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import standard_errors
from plumbline.optim.diagnosis.findings import (
    Blame,
    Cause,
    Estimate,
    Key,
    NoiseLevel,
)
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.verdict.confounding import rivals, worth_more_than_nothing
from plumbline.optim.diagnosis.verdict.curves import curve_of
from plumbline.optim.diagnosis.verdict.explanation import Explanation
from plumbline.optim.diagnosis.verdict.staircase import Stairs
from plumbline.optim.diagnosis.verdict.where import explained_by
from plumbline.optim.diagnosis.verdict.words import parameter_name, variants_words


def causes_of(
    selected: SelectedModel,
    keys: Sequence[Key],
    told: Explanation,
    stairs: Stairs,
    noise: NoiseLevel,
    least: Array | float = 0.0,
) -> tuple[Cause, ...]:
    """Causes of the verdict: their estimates, their held-out figures, and what could be them.

    Args:
        selected: The model.
        keys: Which of its causes.
        told: What the joint posterior says.
        stairs: Held-out figures of some of the causes.
        noise: Of one axis.
        least: Standard errors (P,) below which none is told.
    """
    whole = selected.pool.selection
    asked = replace(whole, linear=whole.linear.share(told.worth))  # as the posterior was
    kept = worth_more_than_nothing(asked, selected.chosen, told.named)
    return tuple(_cause(selected, asked, key, told, stairs, noise, least, kept) for key in keys)


def _cause(
    selected: SelectedModel,
    asked: SelectionProblem,
    key: Key,
    told: Explanation,
    stairs: Stairs,
    noise: NoiseLevel,
    least: Array | float,
    kept: Reduced,
) -> Cause:
    mine = _of(selected, [key])
    effects = [selected.selection.candidates[c.index].effect for c in mine]
    variants = [e.variant for e in effects]
    effect = effects[0]
    alike = [*rivals(asked, kept, mine), *_unasked(selected, effects)]
    # What is fitted unnamed in case it is there instead would hide what this one does.
    instead = {(b.effect, b.element) for b in alike} - asked.keys(kept.chosen)
    return Cause(
        effect=key[0],
        stage=str(effect.stage),
        element=key[1],
        probability=told.probabilities.get(key, 0.0),
        parameters=_parameters(selected, key, noise, told, least),
        before=stairs.figure([k for k in stairs.keys if k != key and k not in instead]),
        after=stairs.figure(stairs.keys),
        confounded_with=tuple(alike),
        words="; ".join(dict.fromkeys(e.sentence for e in effects)),
        variant=variants_words(variants),
        curve=curve_of(selected, key, noise),
        sensitivity=told.sensitive.get(key),
    )


def _unasked(selected: SelectedModel, effects: Sequence[Effect]) -> list[Blame]:
    """Dry friction beside play on the velocity's side, of which rows too far apart ask nothing.

    It winds a drive up against its motion: both are one and the same but for how it goes by speed.
    """
    if any(c.effect.name == Friction.name for c in selected.selection.candidates):
        return []
    why = "dry friction does the same; closer rows along one motion show how it goes by speed"
    sided = (e for e in effects if isinstance(e, Backlash) and e.by == "velocity")
    return [Blame(Friction.name, str(e.stage), e.element, why) for e in sided]


def by_importance(selected: SelectedModel, seed: int) -> dict[Key, float]:
    """Causes with the square that they explain, the largest first."""
    if not selected.chosen:
        return {}
    keys = [selected.selection.candidates[c.index].key for c in selected.chosen]
    drops = explained_by(selected.selection, selected.chosen, [str(k) for k in keys], seed)
    return {k: drops[str(k)] for k in sorted(set(keys), key=lambda k: -drops[str(k)])}


def _of(selected: SelectedModel, keys: Sequence[Key]) -> list[SelectedTerm]:
    return [c for c in selected.chosen if selected.selection.candidates[c.index].key in keys]


def _parameters(
    selected: SelectedModel, key: Key, noise: NoiseLevel, told: Explanation, least: Array | float
) -> dict[str, Estimate]:
    """Estimates by name; variants of one cause are told apart by what sets them apart."""
    sigma = noise.sigma * max(noise.ratio, 1.0)
    std, free = selected.best.std(sigma), _std_by_rows(selected, sigma)
    std = np.hypot(np.maximum(std, least), _between(selected, told))
    stuck = set(selected.best.at_bound())
    terms = [t for t in selected.model.terms if (t.effect.name, t.effect.element) == key]
    width = {selected.selection.candidates[c.index].effect: c.scale for c in selected.chosen}
    out: dict[str, Estimate] = {}
    seen = Counter[str]()
    alike = len({term.effect.sentence for term in terms}) < 2
    for term in terms:
        variant = term.effect.variant if len(terms) > 1 or term.effect.scanned else ""
        variant = variant if alike else ", ".join(filter(None, [_driver(term.effect), variant]))
        seen[variant] += 1
        if seen[variant] > 1:  # apart by less than is shown
            variant += f" ({seen[variant]})"
        for column, p in zip(
            range(term.columns.start, term.columns.stop), term.effect.parameters, strict=True
        ):
            name = selected.best.problem.names[column]
            determined = free[column] < width.get(term.effect, np.inf) * p.scale
            value, error = float(selected.best.x[column]), float(std[column])
            unit = term.effect.unit_of(p, selected.model.recording.chain)
            # At its null it is no part of the cause, and nothing holds the others back.
            rests = name in stuck and abs(value - p.null) > NEAR * p.scale
            said = parameter_name(p.name, variant)
            said += " (2)" * (said in out)  # an overtone, and that order once more
            out[said] = Estimate(value, error, unit, rests, p.doc, bool(determined))
    return out


def _between(selected: SelectedModel, told: Explanation) -> Array:
    """How far the fit's unknowns move from state to state (P,) [their units]."""
    chosen = {selected.selection.candidates[c.index].effect: c.index for c in selected.chosen}
    moved = np.zeros(selected.best.problem.size)
    for term in selected.model.terms:
        own = told.spread.get(chosen.get(term.effect, -1))
        if own is not None:
            moved[term.columns] = own * [p.scale for p in term.effect.parameters]
    return moved


def _driver(effect: Effect) -> str:
    """What of an effect's own its sentence tells, as ``by 4``: of a joint that two others drag."""
    own = [f.name for f in fields(effect) if f"{{{f.name}}}" in effect.words]
    return ", ".join(f"{name} {getattr(effect, name)}" for name in own)


def _std_by_rows(selected: SelectedModel, sigma: float) -> Array:
    """Standard errors (P,) that the rows alone would give, without the effects' priors."""
    _, J = selected.best.mapped.shared(selected.best.x)
    pulls = J[:, selected.model.nuisance.shared.numel() :]
    return standard_errors(selected.best.gram.matrix - pulls @ pulls.T, sigma)
