r"""What an unknown effect may depend on, as families of smooth functions at the ports of the chain.

A port is a place where something may give way: a joint, a link's frame, the base, the reading. At
port columns :math:`P` (what one unit there moves) and functions :math:`f_k` of what was recorded,
a dependence spans

.. math:: \delta y_n = \sum_{k,p} w_{kp}\, f_k(\text{row } n)\, P_p(\text{row } n), \qquad
          w_{kp} \sim N(0, s^2)

a Gaussian process in its weights' view (Rasmussen and Williams 2006, sec. 2.1): harmonics of an
angle, cosines and steps of time, polynomials and random Fourier features of several inputs (Rahimi
and Recht 2007), play operators of a path (Brokate and Sprekels 1996, eq. 2.1.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from kinematics.effects import Effect, Stage, State
from kinematics.effects.hysteresis import Hysteresis
from kinematics.effects.joint_offset import JointOffset
from kinematics.evaluate import over_rows
from kinematics.frames import Transform
from kinematics.parameters import Parameter
from optim.mapped import Mapped
from optim.observation import Model, build_model, scope_of
from optim.problem import Array
from optim.recording import Recording

USUAL = 3e-4  # usual size of an unknown shift or turn [m] or [rad]
COSINES, STEPS, JUMPS, TURNS, MESHES, FEATURES = 8, 7, 19, 6, 3, 24
STILL = 1e-9
Key = tuple[str, int | None]
PLAYS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # widths, as shares of a joint's travel


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

    @property
    def element(self) -> int | None:
        """The link's number."""
        return self.link

    def apply(self, state: State, *values: cs.SX) -> State:
        """Move whatever the link carries."""
        moved = Transform.from_twist(cs.vertcat(*values[:3]), cs.vertcat(*values[3:]))
        placements = list(state.placements)
        placements[self.link] = moved @ placements[self.link]
        return replace(state, placements=tuple(placements))


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
class Dependence:
    """A family of smooth functions, as columns (k, N, m) in units of the usual size.

    Attributes:
        words: On what the error depends.
        stage: Where it would sit.
        element: Joint or link, from 1, or None.
        columns: Its columns.
        extends: Effects of the library that it holds in a richer form: evidence for it is none
            against them.
    """

    words: str
    stage: str
    element: int | None
    columns: Array
    extends: frozenset[Key] = frozenset()


@dataclass(frozen=True, eq=False)
class Ports:
    """What one unit at each port moves, row by row, about a fit.

    Attributes:
        base: Columns of the model's own unknowns (P, N, m), in units of their scales.
        target: What they are to explain (N, m).
        joint: Joints (n, N, m).
        link: Links, six ways each (n, 6, N, m); none for encoders.
        body: The base, six ways (6, N, m); none for encoders.
        shift: The reading, one way a row's component (m', N, m).
    """

    base: Array
    target: Array
    joint: Array
    link: Array
    body: Array
    shift: Array

    def divided(self, spread: Array) -> Ports:
        """The model's columns and target, every component (m,) in units of its own noise."""
        return replace(self, base=self.base / spread, target=self.target / spread)

    @classmethod
    def about(cls, model: Model, x: Array, rows: NDArray[np.intp]) -> Ports:
        """At the fit x (P,) of a model, on some of its rows."""
        n = model.recording.chain.n
        effects: list[Effect] = [t.effect for t in model.terms]
        effects += [JointOffset(joint=j + 1) for j in range(n)]
        encoders = model.recording.observation == "joint_position"
        if not encoders:
            effects += [*(_LinkTwist(link=i + 1) for i in range(n)), _BaseTwist()]
        wide = build_model(model.recording, effects, nuisance=model.nuisance)
        problem = wide.problem.on(wide.problem.rows[rows])
        more = problem.size - len(x)
        parts = list(Mapped(problem).jacobians(np.concatenate([x, np.zeros(more)])))
        r = np.concatenate([p[1] for p in parts])
        J = np.moveaxis(np.concatenate([p[2] for p in parts]), 2, 0)
        base = J[: len(x)] * model.problem.scale[:, None, None]
        target = np.einsum("pnm,p->nm", base, x / model.problem.scale) - r
        joint, body = np.split(J[len(x) :], [n])
        link, body = np.split(body, [0 if encoders else 6 * n])
        shift = np.tile(np.eye(r.shape[1])[:, None, :], (1, len(rows), 1))
        size = 3 if model.recording.observation == "pose" else r.shape[1]
        return cls(base, target, joint, link.reshape(-1, 6, *r.shape), body, shift[:size])


def dependences(recording: Recording, ports: Ports, seed: int) -> Iterator[Dependence]:
    """All that an unknown effect may depend on, given what the recording holds.

    Args:
        recording: N rows.
        ports: Its ports on these rows.
        seed: Of the random features.
    """
    rng = np.random.default_rng(seed)
    if recording.observation != "joint_position":
        yield from _of_place(recording, ports, rng)
        yield from _of_links(recording, ports)
        yield from _of_time(recording, ports)
    yield from _of_angles(recording, ports)
    yield from _of_load(recording, ports)
    yield from _of_motion(recording, ports)


def _of_place(recording: Recording, ports: Ports, rng: np.random.Generator) -> Iterator[Dependence]:
    place = _normal(recording.chain.placement(recording.q)[:, :3, 3])
    local = _random_features(place, 0.35, rng)
    yield _at("the place of the tip, locally", "sensor", None, local, ports.shift)
    yield _at("the place of the tip", "sensor", None, _polynomials(place, 3), ports.shift)
    posture = _random_features(_normal(recording.q), 1.5, rng)
    yield _at("the posture", "link", None, posture, ports.shift)


def _of_links(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every link's place in its joint, as it is and as it gives way to gravity."""
    weight = _weight_directions(recording)
    for i, port in enumerate(ports.link):
        functions = np.concatenate([np.ones((1, len(recording))), weight[i]])
        words = f"the shape of link {i + 1}, or its weight"
        last = i + 1 == len(ports.link)
        same: set[Key] = {("link_geometry", i + 1), ("link_flex", i + 1)}
        if last:
            same.add(("needle_sag", None))
        yield _at(words, "link", i + 1, functions, port, same)


def _of_time(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    time, temperature = recording.time, recording.temperature
    if time is not None and np.ptp(time) > 0:
        functions = np.concatenate([_cosines(time, COSINES), _steps(time, STEPS)])
        yield _at("time", "base", None, functions, ports.body)
    if temperature is not None and np.ptp(temperature) > 0:
        place = _normal(recording.chain.placement(recording.q)[:, :3, 3])
        spread = np.concatenate([np.ones((1, len(place))), place.T])
        warmth = _cosines(temperature, 3)
        functions = (warmth[:, None] * spread).reshape(-1, len(place))
        yield _at("temperature", "link", None, functions, ports.shift)


def _of_angles(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    q = recording.q
    for j, port in enumerate(ports.joint):
        for k in range(len(ports.joint)):
            words = f"joint {j + 1}'s error depends on joint {k + 1}'s angle"
            same = {("transmission_ripple", j + 1)} if j == k else set()
            yield _at(words, "joint", j + 1, _turns(q[:, k]), port[None], same)
    for j, port in enumerate(ports.joint):
        for k in range(len(ports.joint)):
            if k != j:
                words = f"joint {j + 1}'s error depends on its own and joint {k + 1}'s angle"
                waves = _waves(q[:, [j, k]])
                yield _at(words, "joint", j + 1, waves, port[None])


def _of_load(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    load = _loads(recording)
    for j, port in enumerate(ports.joint):
        if np.ptp(load[:, j]) > STILL:
            words = f"joint {j + 1}'s error depends on its load, not in proportion"
            same = ("joint_compliance", j + 1)
            yield _at(words, "joint", j + 1, _cosines(load[:, j], 4), port[None], {same})


def _of_motion(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Sides of approach, speeds and the path so far, joint by joint and of all joints."""
    q = recording.q
    step = np.sign(np.diff(q, axis=0, prepend=q[:1])).T
    for j, port in enumerate(ports.joint):
        functions = np.concatenate([step, _plays(q[:, j])])
        words = f"joint {j + 1}'s error depends on the way it came"
        same = {("backlash", j + 1), ("hysteresis", j + 1)}
        yield _at(words, "joint", j + 1, functions, port[None], same)
    order = np.arange(len(q), dtype=float)
    # Along one motion whatever is smooth in time looks like a memory.
    for j, port in enumerate([] if scope_of(recording).moving else ports.joint):
        functions = np.concatenate([_normal(q[:, [j]]).T, _steps(order, JUMPS)])
        words = f"joint {j + 1}'s error depends on what went before"
        yield _at(words, "joint", j + 1, functions, port[None])
    if recording.direction is not None and recording.direction.any():
        same = {("backlash", j + 1) for j in range(len(ports.joint))}
        yield _each("the side of approach", recording.direction, ports.joint, same)
    if recording.velocity is not None and recording.velocity.any():
        speed = recording.velocity / np.abs(recording.velocity).max()
        yield _each("the speed of the joints", speed, ports.joint)
        for j, port in enumerate(ports.joint):
            v = speed[:, j]
            functions = np.stack([v, np.abs(v), np.sign(v), v * np.abs(v)])
            words = f"joint {j + 1}'s error depends on its speed"
            yield _at(words, "joint", j + 1, functions, port[None])


def _at(
    words: str,
    stage: str,
    element: int | None,
    functions: Array,
    ports: Array,
    extends: Iterable[Key] = (),
) -> Dependence:
    """Every function (K, N) acting on every port (p, N, m)."""
    columns = USUAL * (functions[:, None, :, None] * ports[None])
    flat = columns.reshape(-1, *ports.shape[1:])
    return Dependence(words, stage, element, flat, frozenset(extends))


def _each(words: str, values: Array, ports: Array, extends: Iterable[Key] = ()) -> Dependence:
    """Every joint's own value (N, n) acting on its own port (n, N, m)."""
    columns = USUAL * values.T[:, :, None] * ports
    return Dependence(words, "joint", None, columns, frozenset(extends))


def _normal(values: Array) -> Array:
    """Columns brought to zero mean and unit spread."""
    return np.asarray((values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-12))


def _random_features(inputs: Array, reach: float, rng: np.random.Generator) -> Array:
    """Random Fourier features (K, N) of a squared-exponential kernel of this reach."""
    frequencies = rng.normal(size=(FEATURES, inputs.shape[1])) / reach
    phases = rng.uniform(0, 2 * np.pi, FEATURES)
    return np.asarray(np.sqrt(2 / FEATURES) * np.cos(frequencies @ inputs.T + phases[:, None]))


def _waves(angles: Array) -> Array:
    """Sines and cosines (2 K, N) of whole numbers of turns of two angles (N, 2)."""
    own, other = range(1, TURNS + 1), range(-MESHES, MESHES + 1)
    orders = np.array([(a, b) for a in own for b in other if b])
    phase = orders @ angles.T
    return np.concatenate([np.sin(phase), np.cos(phase)])


def _steps(values: Array, count: int) -> Array:
    """Steps (K, N) at evenly spread quantiles of the values."""
    moments = np.quantile(values, np.linspace(0, 1, count + 2)[1:-1])
    return np.where(values > moments[:, None], 0.5, -0.5)


def _polynomials(inputs: Array, degree: int) -> Array:
    """Products (K, N) of up to ``degree`` inputs (N, d)."""
    picks = [
        p
        for size in range(1, degree + 1)
        for p in combinations_with_replacement(range(inputs.shape[1]), size)
    ]
    return np.stack([inputs[:, list(p)].prod(axis=1) for p in picks])


def _cosines(values: Array, count: int) -> Array:
    """Cosines (K, N) over the range of the values, weaker as they get faster."""
    u = (values - values.min()) / max(float(np.ptp(values)), 1e-12)
    k = np.arange(1, count + 1)[:, None]
    return np.asarray(np.cos(np.pi * k * u) / (1 + (k / 3) ** 2))


def _turns(angle: Array) -> Array:
    """A constant, and sines and cosines (K, N) of the first orders of an angle."""
    k = np.arange(1, TURNS + 1)[:, None]
    return np.concatenate([np.ones((1, len(angle))), np.sin(k * angle), np.cos(k * angle)])


def _plays(angle: Array) -> Array:
    """Lags (K, N) of play operators of several widths, between -1/2 and 1/2."""
    travel = float(np.ptp(angle))
    if travel < STILL:
        return np.empty((0, len(angle)))
    found = [Hysteresis(joint=1, width=share * travel) for share in PLAYS]
    rows = {"q": angle[:, None]}
    return np.stack([next(iter(play.derive(rows).values())) for play in found])


def _loads(recording: Recording) -> Array:
    """Gravity torques (N, n) [N m]."""
    chain = scope_of(recording).chain
    payload = np.zeros(len(recording)) if recording.payload is None else recording.payload
    rows = np.column_stack([recording.q, payload])
    q, mass = cs.SX.sym("q", chain.n), cs.SX.sym("payload")
    torque = cs.Function("torque", [cs.vertcat(q, mass)], [chain.gravity_torque(q, mass)])
    return over_rows(torque, rows)[0][:, 0]


def _weight_directions(recording: Recording) -> Sequence[Array]:
    """Direction of gravity (3, N) in the frame of every joint."""
    chain = recording.chain
    size = max(float(np.linalg.norm(chain.gravity)), 1e-12)
    q = cs.SX.sym("q", chain.n)
    down = [T.R.T @ cs.DM(chain.gravity / size) for T in chain.joint_frames(q)[: chain.n]]
    function = cs.Function("down", [q], [cs.horzcat(*down)])
    found = over_rows(function, recording.q)[0]
    return [np.asarray(found[:, i].T) for i in range(chain.n)]
