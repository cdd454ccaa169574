"""Which effects a recording could show; of several recordings, in which of them each may be."""

from collections.abc import Iterator, Sequence

from plumbline.kinematics.effects import Effect, Scope
from plumbline.kinematics.effects.confined import confined, parts_of
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.measurement.session import merged_scope
from plumbline.optim.recording.recording import Recording, Session
from plumbline.optim.recording.session import apart

ONCE = {"time", "group"}  # columns that only one recording's own clock and sessions give a meaning


def candidates_of(recording: Recording, library: Sequence[type[Effect]]) -> list[Effect]:
    """The variants of a library that a recording could show, or several together.

    What is always fitted is none. A cause is one for all recordings that could show it, and
    confined to those. What follows a clock or a group is each one's own. What one recording alone
    made suspect may be there only.
    """
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
