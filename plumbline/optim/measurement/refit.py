"""Known effects on other rows: what always is fitted is fitted again, the effects are held.

Which effects a recording could show; of several recordings, in which of them each may be.

What moves the readings in units of one noise, and back: see :class:`.recording.Recording`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects import REGISTRY, Effect, Scope
from plumbline.kinematics.effects.confined import confined, parts_of
from plumbline.optim.core.judged import Judged, Solution, judged
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.measurement.observation import build_model, rotation_lever, scope_of
from plumbline.optim.measurement.pose_noise import as_read
from plumbline.optim.measurement.session import merged_scope
from plumbline.optim.measurement.uneven import in_shape, rates, swings, whitened, widened, wider
from plumbline.optim.recording.recording import Recording, Session
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
    turning = recording.chain.turning[list(recording.measured_joints)].any()
    return ("rad" if turning else "m"), False


def rows_of_gap(recording: Recording) -> Flags:
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

    Values are stacked in the effects' order, as two variants may share a name; ``nuisances`` are
    those that are held as well.
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


CANDIDATES = "candidates"
ONCE = {"time", "group"}  # columns that only one recording's own clock and sessions give a meaning


def candidates_of(recording: Recording, library: Sequence[type[Effect]]) -> list[Effect]:
    """The variants of a library that a recording could show, or several together.

    What is always fitted is none. A cause is one for all recordings that could show it, and
    confined to those. What follows a clock or a group is each one's own. What one recording alone
    made suspect may be there only.
    """
    key = CANDIDATES, tuple(library)
    if key not in recording.derived:
        recording.derived[key] = _candidates(recording, library)
    return list(recording.derived[key])


def _candidates(recording: Recording, library: Sequence[type[Effect]]) -> list[Effect]:
    """The same, worked out."""
    if not recording.several:
        scope = scope_of(recording)
        free = [cls for cls in library if not _is_always(recording, cls)]
        return [v for cls in free for v in cls.candidates(scope)]
    session = apart(recording)[0]
    scopes = [scope_of(part) for part in session.parts]
    found = [v for cls in library for v in _of_class(session, scopes, cls)]
    names = {cls.name for cls in library}
    return [*found, *(e for e in session.suspects if e.name in names)]


def _of_class(session: Session, scopes: Sequence[Scope], cls: type[Effect]) -> Iterator[Effect]:
    free = [k for k, part in enumerate(session.parts) if not _is_always(part, cls)]
    each = {k: list(cls.candidates(scopes[k])) for k in free}
    able = tuple(k for k in free if each[k])
    if not able:
        return
    for v in cls.candidates(merged_scope([scopes[k] for k in able])):
        if not runs_once(v):
            yield v if len(able) == len(session) else confined(v, able)
    for k in able:
        said = f"in {session.parts[k].name}"
        yield from (confined(v, (k,), said) for v in each[k] if runs_once(v))


def _is_always(part: Recording, cls: type[Effect]) -> bool:
    """Whether a recording fits it always, so that it is no cause there."""
    of_tool = cls.name == "tool_offset" and "tool" in part.always
    return cls.name in part.always or of_tool


def runs_once(effect: Effect) -> bool:
    """Whether it belongs to one recording: it tells moments of a clock, or groups."""
    return bool(ONCE & {*(effect.needs or effect.needs_one_of)})


def scope_for(effect: Effect, recording: Recording) -> Scope:
    """What the recordings offer that an effect is confined to."""
    parts = parts_of(effect)
    if parts is None or not recording.several:
        return scope_of(recording)
    return merged_scope([scope_of(apart(recording)[0].parts[k]) for k in parts])


def in_noise(recording: Recording, values: Array) -> Array:
    """What moves the readings (..., N, m), in units of one noise."""
    values = in_shape(recording, values)
    return whitened(values, _wider(recording)) if recording.uneven else values


def before_whitening(recording: Recording, residuals: Array) -> Array:
    """Residuals (N, m) in units of a noise that is no wider along any way, but as it is shaped."""
    return widened(residuals, _wider(recording)) if recording.uneven else residuals


def _wider(recording: Recording) -> Array:
    return wider(recording, rotation_lever(recording))


def as_measured(recording: Recording, residuals: Array) -> Array:
    """Residuals (N, m) as they were measured, not in units of one noise."""
    residuals = before_whitening(recording, residuals)
    if recording.pose_spread is not None:
        residuals = as_read(recording, residuals)
    shape = recording.noise_shape if recording.several else None
    return residuals if shape is None else np.asarray(residuals * shape)


def smear(recording: Recording, components: int) -> float:
    """RMS of the noise of some first components of a row as measured, over that of one.

    What joints scatter by is no noise of the device.
    """
    if not recording.jitter:
        return 1.0
    moved = recording.jitter * rates(recording, rotation_lever(recording))[:, :components]
    return float(np.sqrt(1.0 + np.mean(moved**2)))


def scattered(recording: Recording) -> float:
    """RMS of noise and what joints scatter by, over that of the noise."""
    if recording.scatter is None:
        return 1.0
    moved = swings(recording, rotation_lever(recording))
    return float(np.sqrt(1.0 + recording.scatter**2 @ np.mean(moved**2, axis=(1, 2))))
