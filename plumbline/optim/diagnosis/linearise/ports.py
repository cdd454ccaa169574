"""Where a chain may give way, and what one unit there moves: the ports of unknown effects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, Stage, State
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.frames import Transform
from plumbline.kinematics.parameters import Parameter
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.diagnosis.prior import DISPLACED
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.measurement.refit import in_noise, rows_of_gap
from plumbline.optim.recording.session import apart


@dataclass(frozen=True)
class _Twist(Effect):
    """A small motion of something, translation first."""

    reference = "Lynch and Park (2017), Modern Robotics, eq. 3.88"
    x = Parameter("m", -1.0, 1.0, scale=1.0)
    y = Parameter("m", -1.0, 1.0, scale=1.0)
    z = Parameter("m", -1.0, 1.0, scale=1.0)
    rx = Parameter("rad", -1.0, 1.0, scale=1.0)
    ry = Parameter("rad", -1.0, 1.0, scale=1.0)
    rz = Parameter("rad", -1.0, 1.0, scale=1.0)


@dataclass(frozen=True)
class _LinkTwist(_Twist):
    """Link ``link`` moved and turned at its joint, in that joint's frame."""

    link: int = 1

    name = "link_twist"
    stage = Stage.LINK
    words = "link {element} sits elsewhere"

    def apply(self, state: State, *values: cs.SX) -> State:
        """Move whatever the link carries."""
        moved = Transform.from_twist(cs.vertcat(*values[:3]), cs.vertcat(*values[3:]))
        return state.place_link(self.link, moved @ state.placements[self.link])


@dataclass(frozen=True)
class _BaseTwist(_Twist):
    """The base moved and turned."""

    name = "base_twist"
    stage = Stage.BASE
    words = "the base sits elsewhere"

    def apply(self, state: State, *values: cs.SX) -> State:
        """Move the base."""
        return state.move_base(cs.vertcat(*values[:3]), cs.vertcat(*values[3:]))


@dataclass(frozen=True, eq=False)
class Ports:
    """What one unit at each port moves, row by row, about a fit."""

    base: Array  # columns of the model's own unknowns (P, N, m), in units of their scales
    target: Array  # what they are to explain (N, m)
    joint: Array  # joints (n, N, m)
    link: Array  # links, six ways each (n, 6, N, m); none for encoders
    body: Array  # the base, six ways (6, N, m); none for encoders
    shift: Array  # the reading, one way a row's component (m', N, m)
    always: int  # how many of the model's unknowns are always fitted; they come first
    gross: Flags  # which rows are distrusted (N,)
    # which residuals the rows have (N, m): all, but of rows of several kinds
    live: Flags

    def at(self, stage: str, element: int | None) -> Array:
        """What a mechanism at a place can move (k, N, m): all, if the place has no port.

        A joint can turn across its axis too, as its bearing gives way; a tool moves as the last
        link does.
        """
        if stage in ("joint", "actuation") and element is not None:
            own = self.joint[[element - 1]]
            return np.concatenate([own, self.link[element - 1, 3:]]) if len(self.link) else own
        if stage == "link" and element is not None and len(self.link):
            return self.link[element - 1]
        if stage == "tool" and len(self.link):
            return self.link[-1]
        if stage == "base" and len(self.body):
            return self.body
        N, m = self.target.shape
        return np.tile(np.eye(m)[:, None, :], (1, N, 1))

    def own_shifts(self, parts: int = 1) -> Array:
        """Columns (R parts, m / parts, N, m) that shift the distrusted rows by what such are off.

        Of a pose the place may be wrong alone, or the turn: each is a part of its own.
        """
        rows = np.flatnonzero(self.gross)
        N, m = self.target.shape
        own = np.zeros((len(rows), m, N, m))
        own[np.arange(len(rows))[:, None], np.arange(m), rows[:, None], np.arange(m)] = DISPLACED
        return own.reshape(len(rows) * parts, m // parts, N, m)

    def divided(self, spread: Array) -> Self:
        """The model's columns and target, every component (m,) in units of its own noise."""
        return replace(self, base=self.base / spread, target=self.target / spread)

    @classmethod
    def about(
        cls, model: MeasurementModel, x: Array, rows: Indices, always: int | None = None
    ) -> Self:
        """At the fit x (P,) of a model, on some of its rows.

        Args:
            model: Any model.
            x: Its fit (P,).
            rows: Numbers of the rows.
            always: How many of its unknowns are always fitted; all of them if not given.
        """
        n = model.recording.chain.n
        torques = model.recording.kind.efforts
        encoders = torques or model.recording.kind.encoders
        r, J = _columns(model, x, rows)
        base = J * model.problem.scale[:, None, None]
        target = np.einsum("pnm,p->nm", base, x / model.problem.scale) - r
        if torques:  # a unit of each drive's torque is a unit of its own residual
            joint, body = np.tile(np.eye(n)[:, None, :], (1, len(rows), 1)), J[:0]
        else:
            added: list[Effect] = [JointOffset(joint=j + 1) for j in range(n)]
            if not encoders:
                added += [*(_LinkTwist(link=i + 1) for i in range(n)), _BaseTwist()]
            joint, body = np.split(_moved_by(added, model, x, rows), [n])
        link, body = np.split(body, [0 if encoders else 6 * n])
        shift = np.tile(np.eye(r.shape[1])[:, None, :], (1, len(rows), 1))
        noisy = model.recording.select(rows)
        live = np.ones(r.shape, dtype=bool)
        several, places = model.recording.several, False
        if several:
            session, part = apart(model.recording)
            live = np.stack([session.live(k) for k in range(len(session))])[part[rows]]
            places = session.has_positions
        if places:  # what a device reads is what places the tip
            shift = shift * rows_of_gap(model.recording)[rows, None]
        shift = in_noise(noisy, shift)
        joint = in_noise(noisy, joint) if torques else joint
        size = 3 if places or model.recording.kind.oriented else r.shape[1]
        link = link.reshape(-1, 6, *r.shape)
        always = len(x) if always is None else always
        gross = model.problem.weights[rows] == 0
        return cls(base, target, joint, link, body, shift[:size], always, gross, live)


def _columns(model: MeasurementModel, x: Array, rows: Indices) -> tuple[Array, Array]:
    """Residuals (n, m) and transposed Jacobian (P, n, m) of some of a model's rows."""
    problem = model.problem.on(model.problem.rows[rows])
    parts = list(Mapped(problem).jacobians(x))
    J = np.concatenate([p[2] for p in parts])
    return np.concatenate([p[1] for p in parts]), np.moveaxis(J, 2, 0)


def _moved_by(added: Sequence[Effect], model: MeasurementModel, x: Array, rows: Indices) -> Array:
    """What one unit of more effects moves (K, n, m); what is at its null changes none of it."""
    held = [t for t in model.terms if (x[t.columns] != model.start[t.columns]).any()]
    fitted = np.concatenate([x[: model.fixed], *(x[t.columns] for t in held)])
    narrow = build_model(
        model.recording, [*(t.effect for t in held), *added], nuisance=model.nuisance
    )
    start = narrow.start.copy()
    start[: len(fitted)] = fitted
    return _columns(narrow, start, rows)[1][len(fitted) :]
