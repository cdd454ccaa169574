r"""Rows of several recordings in one statement: each with its own frame, tool, sockets and kind.

.. math:: y_n = \sum_k h_{nk}\, y^{(k)}_n, \qquad h_{nk} = 1 \text{ if row } n
          \text{ is of recording } k, \text{ else } 0

The chain and its effects are stated once. What is each recording's own is a sum over recordings in
which all but one are nought, so that the columns of one recording's nuisances are nought in the
rows of all others and the Gram matrices add.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Scope, State
from plumbline.kinematics.effects.confined import PART
from plumbline.kinematics.frames import Transform, constant, quaternion_rotation, unskew
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.recording.recording import Recording, Session, socket_labels
from plumbline.optim.recording.session import apart

HOT = "sockets of"  # columns that say which socket a row of one recording rests in


@dataclass(frozen=True, eq=False)
class Own:
    """What is always fitted to one recording, among the unknowns of all."""

    T_device_world: Transform  # the device's frame, in the session's unknowns
    tool: cs.SX  # the tool's tip in the session's tip frame (3,) [m]
    R_tip_tool: cs.SX  # the tool's orientation in that frame (3, 3)
    sockets: cs.SX  # places of its sockets in the base frame (3, s) [m]
    # which of the session's unknowns its own nuisances are, in their order (p,)
    columns: Indices


def hot_columns(recording: Recording) -> dict[str, Array]:
    """Which recording each row is of (N, K), and which of its sockets it rests in."""
    session, part = apart(recording)
    found = {PART: (part[:, None] == np.arange(len(session))).astype(float)}
    for k, one in enumerate(session.parts):
        if one.kind.sockets:
            hot = np.zeros((len(recording), len(socket_labels(one))))
            hot[part == k] = _hot_of(recording, k, part == k)
            found[f"{HOT} {k}"] = hot
    return found


def _hot_of(recording: Recording, k: int, mine: Flags) -> Array:
    """Sockets of the rows of recording k (n, s), in the order in which that one has them."""
    session, _ = apart(recording)
    assert recording.socket is not None
    labels = np.array(socket_labels(session.parts[k]))
    own = recording.socket[mine, None] - session.first_socket(k)
    return np.asarray((own == labels).astype(float))


def chosen(values: Sequence[cs.SX], hot: cs.SX) -> cs.SX:
    """The one of these values whose recording the row is of."""
    return sum((hot[k] * v for k, v in enumerate(values[1:], 1)), start=hot[0] * values[0])


def session_residual(
    recording: Recording,
    symbols: Mapping[str, cs.SX],
    own: Sequence[Own],
    levers: Sequence[float],
    close: Callable[[cs.SX, cs.SX, Transform], tuple[State, Transform]],
) -> cs.SX:
    """Predicted minus measured (m,) of one row, of whichever recording and kind it is.

    A rotation counts as its recording's lever [m]; ``close`` makes of ``(tool, R_tip_tool,
    T_device_world)`` the state and ``T_device_tip``: the chain with its effects, up to the reading.
    """
    session, hot = apart(recording)[0], symbols[PART]
    frame = Transform(
        chosen([o.T_device_world.R for o in own], hot),
        chosen([o.T_device_world.t for o in own], hot),
    )
    turn = chosen([o.R_tip_tool for o in own], hot)
    state, T_device_tip = close(chosen([o.tool for o in own], hot), turn, frame)
    parts = [cs.SX(session.residuals, 1)]
    measured, at = symbols["measured"], 0
    if session.has_positions:
        there = state.reading
        if session.has_device:
            there, at = there - measured[:3], 3
        for k, o in enumerate(own):
            if f"{HOT} {k}" in symbols:
                there = there - o.sockets @ symbols[f"{HOT} {k}"]
        parts.append(
            _padded(_of([p.kind.places for p in session.parts], hot) * there, session.residuals)
        )
    if session.has_poses:
        between = quaternion_rotation(measured[at : at + 4]).T @ T_device_tip.R @ state.R_tip_tool
        lever = chosen([cs.SX(v) for v in levers], hot)
        turned = _of([p.kind.oriented for p in session.parts], hot) * lever * unskew(between)
        parts.append(_padded(cs.vertcat(cs.SX(3, 1), turned), session.residuals))
        at += 4
    if session.encoders:
        joints = list(session.encoders)
        read = (state.q - measured[at:])[joints]
        seen = cs.diag(_seen(session, hot)[: len(joints)]) @ read
        parts.append(_padded(seen, session.residuals))
    return sum(parts[1:], start=parts[0])


def _padded(values: cs.SX, size: int) -> cs.SX:
    return cs.vertcat(values, cs.SX(size - values.numel(), 1))


def _of(parts: Sequence[bool], hot: cs.SX) -> cs.SX:
    """One in rows of these recordings, nought in others."""
    return constant([[float(part) for part in parts]]) @ hot


def _seen(session: Session, hot: cs.SX) -> cs.SX:
    """One for every second encoder (m,) that the row's recording has."""
    encoders = [p.kind.encoders for p in session.parts]
    rows = [session.live(k) & encoders[k] for k in range(len(session))]
    return constant(np.stack(rows).astype(float).T) @ hot


def merged_scope(scopes: Sequence[Scope]) -> Scope:
    """What several recordings offer to an effect that is at work in all of them."""
    first = scopes[0]
    span: dict[str, tuple[float, float]] = {}
    for key in dict.fromkeys(k for s in scopes for k in s.span):
        ends = [s.span[key] for s in scopes if key in s.span]
        span[key] = (min(low for low, _ in ends), max(high for _, high in ends))
    return replace(
        first,
        columns=frozenset.intersection(*(s.columns for s in scopes)),
        span=span,
        rows=sum(s.rows for s in scopes),
        moving=all(s.moving for s in scopes),
        times=tuple(sorted(t for s in scopes for t in s.times)),
    )


def equations_of_rows(recording: Recording) -> Array:
    """How many residuals each row has (N,)."""
    session, part = apart(recording)
    counts = np.array([session.live(k).sum() for k in range(len(session))], dtype=float)
    return np.asarray(counts[part])
