"""Known effects on other rows: what always is fitted is fitted again, the effects are held."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import REGISTRY, Effect
from plumbline.kinematics.effects.confined import confined
from plumbline.optim.core.judged import Judged, judged
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import apart


def figure(residuals: Array, per_row: bool) -> float:
    """Root mean square of rows' norms (positions) or of single readings (encoders)."""
    squares = (residuals[:, :3] ** 2).sum(axis=1) if per_row else residuals**2
    return float(np.sqrt(np.mean(squares))) if squares.size else float("nan")


def gap_unit(recording: Recording) -> tuple[str, bool]:
    """Unit of the gap, and whether its RMS is of rows' norms; of slides alone it is in metres."""
    kind = recording.kind
    if not kind.encoders:
        return kind.unit, not (kind.efforts or kind.ranges)
    turning = any(recording.chain.kinds[j] == "revolute" for j in recording.measured_joints)
    return ("rad" if turning else "m"), False


def rows_of_gap(recording: Recording) -> NDArray[np.bool_]:
    """Rows (N,) that the gap is of: all, or of several kinds those that say where the tip is."""
    every = np.ones(len(recording), dtype=bool)
    if not recording.several:
        return every
    session, part = apart(recording)
    if not session.has_positions:
        return every
    return np.array([p.kind.places for p in session.parts])[part]


def always_fitted(recording: Recording) -> tuple[Effect, ...]:
    """Effects that the recording wants in every model, all elements of each."""
    if recording.several:
        parts = enumerate(apart(recording)[0].parts)
        return tuple(confined(e, (k,), f"in {p.name}") for k, p in parts for e in always_fitted(p))
    scope = scope_of(recording)
    names = [name for name in recording.always if name in REGISTRY]
    found = [v for name in names for v in REGISTRY[name].candidates(scope)]
    if not recording.kind.joints:
        return tuple(found)
    seen = {j + 1 for j in recording.measured_joints}
    return tuple(v for v in found if v.element is None or v.element in seen)


def refitted(
    other: Recording,
    effects: Sequence[Effect],
    values: Array,
    nuisances: Mapping[str, float] | None = None,
) -> tuple[Array, Judged]:
    """Residuals on another recording, effects held, other nuisances refitted; and how that ended.

    Args:
        other: N rows.
        effects: Its effects.
        values: Their values, stacked in their order: two variants may share a name.
        nuisances: Nuisances that are held as well, by name.
    """
    solution = refit(other, effects, values, nuisances)
    return solution.mapped.residuals(solution.x), judged(solution, "the fit to other rows")


def refit(
    other: Recording,
    effects: Sequence[Effect],
    values: Array,
    nuisances: Mapping[str, float] | None = None,
    *,
    free: Collection[Effect] = (),
    weights: Array | None = None,
) -> Solution:
    """The fit behind :func:`refitted`, whose unknowns are the nuisances, then the effects'.

    Those of the effects that are ``free`` are fitted again, from their values; rows count by their
    ``weights`` (N,).
    """
    model = build_model(other, effects, weights=weights)
    p = model.problem
    start, lower, upper = model.start.copy(), p.lower.copy(), p.upper.copy()
    for i, name in enumerate(model.nuisance.names):
        if nuisances and name in nuisances:
            start[i] = lower[i] = upper[i] = nuisances[name]
    start[model.fixed :] = values
    for term in model.terms:
        if term.effect not in free:
            lower[term.columns] = upper[term.columns] = start[term.columns]
    pinned = replace(p, lower=lower, upper=upper)
    return LevenbergMarquardt().solve(pinned, start)
