"""The causes of a verdict: their estimates, held-out figures and confounded effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import standard_errors
from plumbline.optim.diagnosis.findings import (
    Cause,
    Estimate,
    Key,
    Noise,
)
from plumbline.optim.diagnosis.posterior.reduction import Choice
from plumbline.optim.diagnosis.posterior.search import Found
from plumbline.optim.diagnosis.verdict.confounding import rivals
from plumbline.optim.diagnosis.verdict.staircase import Stairs
from plumbline.optim.diagnosis.verdict.where import explained_by
from plumbline.optim.diagnosis.verdict.words import parameter_name


def cause_of(
    found: Found, key: Key, probabilities: dict[Key, float], stairs: Stairs, noise: Noise
) -> Cause:
    """One cause of the verdict: its estimates, its held-out figures, and what could be it."""
    mine = _of(found, [key])
    variants = [found.question.candidates[c.index].effect.variant for c in mine]
    effect = found.question.candidates[mine[0].index].effect
    return Cause(
        effect=key[0],
        stage=str(effect.stage),
        element=key[1],
        probability=probabilities.get(key, 0.0),
        parameters=_parameters(found, key, noise),
        before=stairs.figure([k for k in stairs.keys if k != key]),
        after=stairs.figure(stairs.keys),
        confounded_with=tuple(rivals(found.question, found.chosen, mine)),
        words=effect.sentence,
        variant="; ".join(dict.fromkeys(filter(None, variants))),
    )


def by_importance(found: Found, seed: int) -> list[Key]:
    """Causes by the square that they explain."""
    if not found.chosen:
        return []
    keys = [found.question.candidates[c.index].key for c in found.chosen]
    drops = explained_by(found.question, found.chosen, [str(k) for k in keys], seed)
    return sorted(set(keys), key=lambda k: -drops[str(k)])


def _of(found: Found, keys: Sequence[Key]) -> list[Choice]:
    return [c for c in found.chosen if found.question.candidates[c.index].key in keys]


def _parameters(found: Found, key: Key, noise: Noise) -> dict[str, Estimate]:
    """Estimates by name; variants of one cause are told apart by what sets them apart."""
    sigma = noise.sigma * max(noise.ratio, 1.0)
    std, free = found.best.std(sigma), _std_by_rows(found, sigma)
    stuck = set(found.best.at_bound())
    terms = [t for t in found.model.terms if (t.effect.name, t.effect.element) == key]
    width = {found.question.candidates[c.index].effect: c.scale for c in found.chosen}
    out: dict[str, Estimate] = {}
    variants = Counter(t.effect.variant for t in terms)
    for term in terms:
        variant = term.effect.variant if len(terms) > 1 or term.effect.scanned else ""
        if variants[term.effect.variant] > 1:
            variant += term.effect.tag
        for column, p in zip(
            range(term.columns.start, term.columns.stop), term.effect.parameters, strict=True
        ):
            name = found.best.problem.names[column]
            told = free[column] < width.get(term.effect, np.inf) * p.scale
            value, error = float(found.best.x[column]), float(std[column])
            unit = term.effect.unit_of(p, found.model.recording.chain)
            out[parameter_name(p.name, variant)] = Estimate(
                value, error, unit, name in stuck, p.doc, bool(told)
            )
    return out


def _std_by_rows(found: Found, sigma: float) -> Array:
    """Standard errors (P,) that the rows alone would give, without the effects' priors."""
    _, J = found.best.mapped.shared(found.best.x)
    pulls = J[:, found.model.nuisance.shared.numel() :]
    return standard_errors(found.best.gram.matrix - pulls @ pulls.T, sigma)
