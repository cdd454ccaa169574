r"""What a row should have read: the chain, its effects and the nuisances, as one symbolic row.

.. math:: y = T_{device,world}\, T_{world,base}\, T_{base,tip}(q)\, p_{tool}

Effects act in the order of the stages: joints, links, tool, then the chain is closed, then base,
then the device's frame, then what is measured and what measures it. The residual is predicted
minus measured [m], or [rad] for link-side encoders; efforts have a chain of their own
(:mod:`plumbline.optim.measurement.torque`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.dynamics import nominal_of
from plumbline.kinematics.effects import Effect, Scope, Stage, State
from plumbline.kinematics.effects.confined import parts_of
from plumbline.kinematics.frames import Transform, constant, quaternion_rotation, unskew
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.measurement.constants import ASSUMED, MASS_PER_METRE, ONE_MOTION
from plumbline.optim.measurement.correlated import follows_of
from plumbline.optim.measurement.nuisance import (
    Nuisance,
    nuisances_of,
    on_its_plane,
    spans_of_parts,
)
from plumbline.optim.measurement.pose_noise import residual_in_one_noise
from plumbline.optim.measurement.session import (
    equations_of_rows,
    hot_columns,
    merged_scope,
    session_residual,
)
from plumbline.optim.measurement.torque import torque_residual
from plumbline.optim.measurement.uneven import powers, wider
from plumbline.optim.recording.constants import LEVER, SAME_POSTURE
from plumbline.optim.recording.recording import Recording, one_hot_sockets
from plumbline.optim.recording.session import apart

BEFORE_CLOSING = (Stage.ACTUATION, Stage.JOINT, Stage.LINK, Stage.TOOL)
AFTER_DEVICE = (Stage.REGISTRATION, Stage.SENSOR)
LOADS, SCOPE = "loads", "scope"
COLUMNS = (
    "time", "temperature", "payload", "group", "direction", "velocity", "effort", "force",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ModelTerm:
    """One effect of a model and where its parameters stand among the unknowns."""

    effect: Effect
    columns: slice


@dataclass(frozen=True, eq=False)
class MeasurementModel:
    """A recording's problem with the effects that are in it."""

    recording: Recording  # the data
    problem: Problem  # the least-squares problem: the nuisances, then the effects' parameters
    nuisance: Nuisance  # what is always fitted
    terms: tuple[ModelTerm, ...]  # the effects, in order
    start: Array  # where to start: registered nuisances, effects at their null (P,)
    # what holds each effect near its null; see :func:`build_model`
    ridge: tuple[float, ...] | None = None

    @property
    def fixed(self) -> int:
        """Number of nuisance unknowns; the effects' come after them."""
        return self.nuisance.size

    def started(self, known: Mapping[str, float]) -> Array:
        """Where to start (P,), from values that are known by name where there are any."""
        pairs = zip(self.problem.names, self.start.tolist(), strict=True)
        return np.array([known.get(name, value) for name, value in pairs])


def build_model(
    recording: Recording,
    effects: Sequence[Effect] = (),
    *,
    nuisance: Nuisance | None = None,
    weights: Array | None = None,
    ridge: Sequence[float] | None = None,
) -> MeasurementModel:
    """State the problem of a recording of N rows with these effects.

    Nuisances are registered afresh if not given; weights are of the rows (N,). ``ridge`` says of
    each effect how strongly its parameters are held near their null: the noise over the width of
    their prior, in units of their scales; None: not at all.
    """
    nuisance = nuisance or nuisances_of(recording)
    row = _Row.of(recording, effects)
    symbols = [cs.SX.sym(f"theta{k}", len(e.parameters)) for k, e in enumerate(effects)]
    values = [cs.vertsplit(s) if s.numel() else [] for s in symbols]
    x = cs.vertcat(nuisance.x, *symbols)
    residual = _residual(recording, row, nuisance, list(zip(effects, values, strict=True)))
    parameters = [p for effect in effects for p in effect.parameters]
    problem = Problem(
        x=x,
        names=(*nuisance.names, *names_of(effects)),
        lower=np.concatenate([nuisance.lower, [p.lower for p in parameters]]),
        upper=np.concatenate([nuisance.upper, [p.upper for p in parameters]]),
        scale=np.concatenate([nuisance.scale, [p.scale for p in parameters]]),
        residual=residual,
        row=row.vector,
        rows=row.values,
        weights=np.ones(len(recording)) if weights is None else weights,
        follows=follows_of(recording, weights),
        shared=cs.vertcat(nuisance.shared, *_held_near_null(effects, symbols, ridge)),
        counts=equations_of_rows(recording) if recording.several else None,
    )
    start = np.concatenate([nuisance.start, [p.null for p in parameters]])
    terms, held = _terms(effects, nuisance.size), None if ridge is None else tuple(ridge)
    return MeasurementModel(recording, problem, nuisance, terms, start, held)


def _held_near_null(
    effects: Sequence[Effect], symbols: Sequence[cs.SX], ridge: Sequence[float] | None
) -> list[cs.SX]:
    if ridge is None:
        return []
    pulls = []
    for effect, theta, strength in zip(effects, symbols, ridge, strict=True):
        null = cs.DM([p.null for p in effect.parameters])
        pulls.append(strength * (theta - null) / cs.DM([p.scale for p in effect.parameters]))
    return pulls


def rows_of(recording: Recording, effects: Sequence[Effect] = ()) -> Array:
    """The data (N, k) of a recording's rows, as the problem of a model with these effects has it.

    What was measured enters the derivatives only through a pose's orientation.
    """
    return _Row.of(recording, effects).values


def scope_of(recording: Recording) -> Scope:
    """What a recording offers to the effects; asked for often, so it is worked out once."""
    if SCOPE not in recording.derived:
        recording.derived[SCOPE] = _scope_of(recording)
    found: Scope = recording.derived[SCOPE]
    return found


def _scope_of(recording: Recording) -> Scope:
    if recording.several:
        return merged_scope([scope_of(part) for part in apart(recording)[0].parts])
    scalars = {name: getattr(recording, name) for name in ("time", "temperature", "payload")}
    vectors = ["direction", "velocity", "effort", "force", "group"]
    vectors += ["acceleration"] if recording.kind.efforts else []
    present = {k for k in (*scalars, *vectors) if getattr(recording, k) is not None}
    span = {k: (float(v.min()), float(v.max())) for k, v in scalars.items() if v is not None}
    chain = loaded_chain(recording.chain)
    span |= spans_of_parts(recording) | _spans("q", recording.q)
    span |= _spans("effort", recording.effort)
    if recording.kind.efforts:
        span |= _spans("effort", recording.measured) | _spans("velocity", recording.velocity)
    elif not recording.stand_in:  # which has no bodies
        span |= _spans("load", _loads(recording, chain))
    if recording.kind.device:
        places = recording.measured[:, :3]
        fields = {"range": np.sum(places**2, axis=1), "depth": places[:, 2]}
        span |= {name: (float(v.min()), float(v.max())) for name, v in fields.items()}
    stated = {"scale_std": recording.scale_std, "distance": recording.socket_distance}
    span |= {name: (value, value) for name, value in stated.items() if value is not None}
    tool = zip("xyz", recording.tool_offset.tolist(), strict=True)
    span |= {f"tool_{c}": (value, value) for c, value in tool}
    return Scope(
        chain=chain,
        observation=recording.observation,
        columns=frozenset(present),
        span=span,
        rows=len(recording),
        moving=recording.kind.efforts or _is_one_motion(recording.path[0].q),
        times=() if recording.time is None else tuple(np.sort(recording.time).tolist()),
        groups=() if recording.group is None else tuple(np.unique(recording.group).tolist()),
        arm=not recording.stand_in,
        elements=len(recording.elements),
    )


def _spans(name: str, values: Array | None) -> dict[str, tuple[float, float]]:
    columns = () if values is None else values.T
    return {f"{name}{j}": (float(v.min()), float(v.max())) for j, v in enumerate(columns, 1)}


def _loads(recording: Recording, chain: Chain) -> Array:
    """Torques (N, n) that the drives hold against gravity [N m or N]."""
    if LOADS not in recording.derived:
        mass = np.zeros(len(recording)) if recording.payload is None else recording.payload
        mapped = chain.gravity_torque.map(len(recording))
        found = mapped(recording.q.T, mass[None]).full().T
        recording.derived[LOADS] = found
    return np.asarray(recording.derived[LOADS])


@lru_cache(maxsize=32)
def loaded_chain(chain: Chain) -> Chain:
    """The chain itself, or with assumed masses (15 kg per metre of link) where it has none."""
    if chain.has_masses:
        return chain
    ends = [joint.T_parent_joint[:3, 3] for joint in chain.joints[1:]] + [chain.T_last_tip[:3, 3]]
    joints = tuple(
        replace(joint, mass=MASS_PER_METRE * float(np.linalg.norm(end)), com=end / 2)
        for joint, end in zip(chain.joints, ends, strict=True)
    )
    return replace(chain, joints=joints, misstated=ASSUMED)


def _is_one_motion(q: Array) -> bool:
    """Whether steps between rows are small against the spread of the rows."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    moved = steps[steps > SAME_POSTURE]  # a posture that is read again is no motion
    step = float(np.median(moved)) if len(moved) else 0.0
    return bool(step < ONE_MOTION * np.linalg.norm(q.std(axis=0)))


def names_of(effects: Sequence[Effect]) -> list[str]:
    """Names of all parameters of some effects, no two alike."""
    return [f"{e.label} {p.name}{e.tag}" for e in effects for p in e.parameters]


def _terms(effects: Sequence[Effect], first: int) -> tuple[ModelTerm, ...]:
    edges = np.cumsum([first, *(len(effect.parameters) for effect in effects)]).tolist()
    return tuple(
        ModelTerm(e, slice(a, b)) for e, (a, b) in zip(effects, pairwise(edges), strict=True)
    )


@dataclass(frozen=True, eq=False)
class _Row:
    """Symbols of a row by column name, and the data that go with them."""

    symbols: Mapping[str, cs.SX]
    vector: cs.SX
    values: Array

    @classmethod
    def of(cls, recording: Recording, effects: Sequence[Effect]) -> Self:
        columns = _columns(recording)
        if recording.several:
            columns |= hot_columns(recording)
        elif recording.kind.sockets:
            columns["socket"] = one_hot_sockets(recording)
        for effect in effects:
            columns |= _derived(recording, effect)
        arm = nominal_of(loaded_chain(recording.chain), carrying="payload" in columns)
        shared = {"q": arm.q, "payload": arm.payload}
        symbols = {
            name: shared[name] if name in shared else cs.SX.sym(name, v.shape[1])
            for name, v in columns.items()
        }
        return cls(symbols, cs.vertcat(*symbols.values()), np.hstack(list(columns.values())))


def _columns(recording: Recording) -> dict[str, Array]:
    """What was recorded, as columns (N, k) by name."""
    columns: dict[str, Array] = {"q": recording.q, "measured": recording.measured}
    names = list(COLUMNS)
    if recording.kind.efforts:
        names += ["acceleration", "turning"]
    for name in (*names, "element", "noise_shape"):
        values = getattr(recording, name)
        if values is not None:
            columns[name] = values.reshape(len(recording), -1)
    if recording.uneven:
        white = powers(wider(recording, rotation_lever(recording)), -0.5)
        columns["white"] = white.reshape(len(recording), -1)
    return columns


def _derived(recording: Recording, effect: Effect) -> dict[str, Array]:
    """What an effect derives from the whole path, for these rows (N, 1)."""
    if not effect.remembers:
        return {}
    whole, place = recording.path
    if effect not in whole.derived:
        whole.derived[effect] = _along_paths(whole, effect)
    return {name: np.reshape(v[place], (-1, 1)) for name, v in whole.derived[effect].items()}


def _along_paths(whole: Recording, effect: Effect) -> dict[str, Array]:
    """What an effect derives, of several recordings each along its own path."""
    columns = _columns(whole)
    if not whole.several:
        return dict(effect.derive(columns))
    session, part = apart(whole)
    found: dict[str, Array] = {}
    for k in parts_of(effect) or range(len(session)):
        mine = part == k
        path = mine if mine.any() else slice(0, 1)  # what is derived is told by name at least
        for name, values in effect.derive({n: c[path] for n, c in columns.items()}).items():
            found.setdefault(name, np.zeros(len(whole)))[mine] = np.ravel(values)[: mine.sum()]
    return found


def _residual(
    recording: Recording,
    row: _Row,
    nuisance: Nuisance,
    effects: Sequence[tuple[Effect, list[cs.SX]]],
) -> cs.SX:
    """Predicted minus measured, in units of one noise where that is not one for all."""
    plain = _plain_residual(recording, row, nuisance, effects)
    if recording.noise_shape is not None:
        shape = row.symbols["noise_shape"]
        own = recording.kind.encoders and not recording.several
        plain = plain / (shape[list(recording.measured_joints)] if own else shape)
    if recording.pose_spread is not None:
        plain = residual_in_one_noise(recording.pose_spread, row.symbols["measured"], plain)
    if recording.uneven:
        plain = cs.reshape(row.symbols["white"], plain.numel(), plain.numel()) @ plain
    return plain


def _plain_residual(
    recording: Recording,
    row: _Row,
    nuisance: Nuisance,
    effects: Sequence[tuple[Effect, list[cs.SX]]],
) -> cs.SX:
    chain = loaded_chain(recording.chain)
    if recording.kind.efforts:
        state = State.ideal(chain, row.symbols, constant(recording.tool_offset))
        return torque_residual(recording, state, effects, apply_effects)
    if recording.several:
        ideal = State.ideal(chain, row.symbols, constant(recording.tool_offset))
        levers = [rotation_lever(part) for part in apart(recording)[0].parts]

        def close(tool: cs.SX, turn: cs.SX, frame: Transform) -> tuple[State, Transform]:
            state, tip = closed_chain(replace(ideal, tool=tool, R_tip_tool=turn), effects, frame)
            return apply_effects(state, effects, AFTER_DEVICE), tip

        return session_residual(recording, row.symbols, nuisance.own, levers, close)
    tool = constant(recording.tool_offset) + nuisance.tool
    state = replace(State.ideal(chain, row.symbols, tool), R_tip_tool=nuisance.R_tip_tool)
    if recording.kind.encoders:
        read = apply_effects(state, effects, BEFORE_CLOSING).q - row.symbols["measured"]
        return read[list(recording.measured_joints)]
    state, T_device_tip = closed_chain(state, effects, nuisance.T_device_world)
    if recording.kind.ranges:
        state = on_its_plane(state, T_device_tip.R, nuisance)
    state = apply_effects(state, effects, AFTER_DEVICE)
    if recording.kind.sockets:
        return state.reading - nuisance.sockets @ row.symbols["socket"]
    if recording.kind.oriented:
        return _pose_residual(recording, state, T_device_tip)
    return state.reading - row.symbols["measured"]


def closed_chain(
    state: State, effects: Sequence[tuple[Effect, list[cs.SX]]], T_device_world: Transform
) -> tuple[State, Transform]:
    """The state with the true tip in the device's frame as its reading, and ``T_device_tip``.

    Effects of registration and sensor, which change what is read and not where the tip is, are left
    out. T_device_world is the identity for places in the base frame.
    """
    state = apply_effects(state, effects, BEFORE_CLOSING)
    T_base_tip = state.chain.forward(state.q, state.placements)
    state = apply_effects(state, effects, (Stage.BASE,))
    T_device_tip = T_device_world @ state.T_world_base @ T_base_tip
    return replace(state, reading=T_device_tip.point(state.tool)), T_device_tip


def apply_effects(
    state: State, effects: Sequence[tuple[Effect, list[cs.SX]]], stages: Sequence[Stage]
) -> State:
    """The state after the effects of some stages, in the stages' order."""
    for stage in stages:
        for effect, values in effects:
            if effect.port == stage:
                state = effect.apply(state, *values)
    return state


def _pose_residual(recording: Recording, state: State, T_device_tip: Transform) -> cs.SX:
    """Position [m], then axis times sine of the angle, times the lever arm that makes it metres."""
    measured = state.row["measured"]
    turn = quaternion_rotation(measured[3:]).T @ T_device_tip.R @ state.R_tip_tool
    lever = rotation_lever(recording)
    return cs.vertcat(state.reading - measured[:3], lever * unskew(turn))


def rotation_lever(recording: Recording) -> float:
    """Lever arm [m] of a pose's orientation: the ratio of noises, stated or fitted, or LEVER."""
    if recording.noise_std and recording.noise_std_rotation:
        return recording.noise_std / recording.noise_std_rotation
    return recording.lever or LEVER
