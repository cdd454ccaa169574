r"""The candidate that a closed list lacks: an unknown, smooth dependence on something recorded.

Beside the verdict's own columns, families of smooth functions compete by the same evidence: of the
tip's place, of the posture, of one joint's angle acting on another joint, of time, temperature,
load and side of approach. Each is a Gaussian process in its weights' view (Rasmussen and Williams
2006, sec. 2.1): cosines of one input, random Fourier features of several (Rahimi and Recht 2007).
A family that wins says on what the unknown effect depends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import expit, logsumexp

from kinematics.effects.joint_offset import JointOffset
from kinematics.evaluate import over_rows
from optim.diagnosis.evidence import (
    LOG_SCALE_WEIGHTS,
    SCALES,
    NoisePrior,
    block_evidence,
)
from optim.diagnosis.linear import Beside, Linear
from optim.mapped import Mapped
from optim.observation import Model, build_model, scope_of
from optim.problem import Array
from optim.recording import Recording

PRIOR_ODDS = 0.1
USUAL = 3e-4
MOST_ROWS = 1500
COSINES, TURNS, FEATURES = 8, 6, 24
WIDE = 10.0
SURE = 5.0


@dataclass(frozen=True, eq=False)
class Family:
    """A family of smooth functions, as columns (k, N, m) in units of the usual size.

    Attributes:
        words: On what the error depends.
        stage: Where it would sit.
        element: Joint, from 1, or None.
        columns: Its columns.
        log_prior: Log of its share.
    """

    words: str
    stage: str
    element: int | None
    columns: Array
    log_prior: float = 0.0


@dataclass(frozen=True, eq=False)
class Outside:
    """What was found beyond the model's own effects.

    Attributes:
        log_odds: Log odds of any family against none.
        words: On what the best family depends.
        stage: Where it would sit.
        element: Its joint.
        gains: Log evidence of each chosen effect beside the best family, in the model's order.
    """

    log_odds: float
    words: str
    stage: str
    element: int | None
    gains: tuple[float, ...]

    @classmethod
    def slipped(cls, rows: Sequence[int]) -> Outside:
        """What rows (from 0) say that one shift of the tool displaced."""
        listed = ", ".join(str(k + 1) for k in rows)
        return cls(SURE, f"rows {listed}: one shift of the tool explains them", "tool", None, ())

    @property
    def probability(self) -> float:
        """Probability that something smooth and unknown is at work."""
        return float(expit(self.log_odds))


def look_outside(model: Model, x: Array, noise: NoisePrior, fixed: int, seed: int = 0) -> Outside:
    """Let the families compete beside a fitted model.

    Args:
        model: Nuisances, then ``fixed`` effects that count as nuisances, then the chosen ones.
        x: Its fit (P,).
        noise: The prior of the noise.
        fixed: How many of its effects are always fitted.
        seed: Of the random features.
    """
    rows = _spread(len(model.recording))
    keep = model.problem.weights[rows] > 0
    rows = rows[keep]
    base, target, ports, unit = _design(model, x, rows)
    recording = model.recording.select(rows)
    flat = model.terms[fixed].columns.start if len(model.terms) > fixed else model.problem.size
    found = list(_families(recording, ports, unit, seed))
    shares = np.log(PRIOR_ODDS / max(len(found), 1))
    floor = Base.of(base, target, flat, noise)
    scored = [floor.score(f.columns) for f in found]
    odds = np.array([s[0] for s in scored]) + shares
    best = int(np.argmax(odds))
    log_odds = float(logsumexp(odds))
    gains = [np.inf] * len(model.terms[fixed:])
    if log_odds > 0.0:
        gains = floor.gains(found[best].columns * scored[best][1], model, fixed)
    return Outside(
        log_odds, found[best].words, found[best].stage, found[best].element, tuple(gains)
    )


def _spread(count: int) -> NDArray[np.intp]:
    """At most :data:`MOST_ROWS` rows, evenly spread."""
    if count <= MOST_ROWS:
        return np.arange(count)
    return np.linspace(0, count - 1, MOST_ROWS).astype(np.intp)


def _design(model: Model, x: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array, Array]:
    """Base columns (P, N, m), target (N, m), joint ports (n, N, m) and unit shifts (m, N, m)."""
    n = model.recording.chain.n
    effects = [*(t.effect for t in model.terms), *(JointOffset(joint=j + 1) for j in range(n))]
    wide = build_model(model.recording, effects, nuisance=model.nuisance)
    problem = wide.problem.on(wide.problem.rows[rows])
    at = np.concatenate([x, np.zeros(n)])
    parts = list(Mapped(problem).jacobians(at))
    r = np.concatenate([p[1] for p in parts])
    J = np.moveaxis(np.concatenate([p[2] for p in parts]), 2, 0)
    base = J[: len(x)] * model.problem.scale[:, None, None]
    target = np.einsum("pnm,p->nm", base, x / model.problem.scale) - r
    unit = np.tile(np.eye(r.shape[1])[:, None, :], (1, len(rows), 1))
    if model.recording.observation == "pose":
        unit = unit[:3]
    return base, target, J[len(x) :], unit


def _families(recording: Recording, ports: Array, unit: Array, seed: int) -> Iterator[Family]:
    rng = np.random.default_rng(seed)
    q = recording.q
    if recording.observation != "joint_position":
        place = _normal(recording.chain.placement(q)[:, :3, 3])
        for reach, name in ((0.35, "the place of the tip, locally"), (1.0, "the place of the tip")):
            yield _of(name, "sensor", None, _random_features(place, reach, rng), unit)
        yield _of("the posture", "link", None, _random_features(_normal(q), 1.5, rng), unit)
    for j in range(len(ports)):
        for k in range(len(ports)):
            words = f"joint {j + 1}'s error depends on joint {k + 1}'s angle"
            yield _of(words, "joint", j + 1, _turns(q[:, k]), ports[j : j + 1])
    load = _loads(recording)
    for j in range(len(ports)):
        if np.ptp(load[:, j]) > 1e-9:
            words = f"joint {j + 1}'s error depends on its load, not in proportion"
            yield _of(words, "joint", j + 1, _cosines(load[:, j], 4), ports[j : j + 1])
    if recording.time is not None and np.ptp(recording.time) > 0:
        yield _of("time", "base", None, _cosines(recording.time, COSINES), unit)
    if recording.temperature is not None and np.ptp(recording.temperature) > 0:
        yield _of("temperature", "link", None, _cosines(recording.temperature, 4), unit)
    if recording.direction is not None and recording.direction.any():
        yield _of("the side of approach", "joint", None, recording.direction.T, unit)
    if len(q) > 1:
        step = np.sign(np.diff(q, axis=0, prepend=q[:1]))
        for j in range(len(ports)):
            words = f"joint {j + 1}'s error depends on the way it came"
            yield _of(words, "joint", j + 1, step.T, ports[j : j + 1])


def _of(words: str, stage: str, element: int | None, functions: Array, ports: Array) -> Family:
    """Every function (K, N) acting on every port (p, N, m)."""
    columns = USUAL * (functions[:, None, :, None] * ports[None])
    return Family(words, stage, element, columns.reshape(-1, *ports.shape[1:]))


def _normal(values: Array) -> Array:
    """Columns brought to zero mean and unit spread."""
    return np.asarray((values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-12))


def _random_features(inputs: Array, reach: float, rng: np.random.Generator) -> Array:
    """Random Fourier features (K, N) of a squared-exponential kernel of this reach."""
    frequencies = rng.normal(size=(FEATURES, inputs.shape[1])) / reach
    phases = rng.uniform(0, 2 * np.pi, FEATURES)
    return np.asarray(np.sqrt(2 / FEATURES) * np.cos(frequencies @ inputs.T + phases[:, None]))


def _cosines(values: Array, count: int) -> Array:
    """Cosines (K, N) over the range of the values, weaker as they get faster."""
    u = (values - values.min()) / max(float(np.ptp(values)), 1e-12)
    k = np.arange(1, count + 1)[:, None]
    return np.asarray(np.cos(np.pi * k * u) / (1 + (k / 3) ** 2))


def _turns(angle: Array) -> Array:
    """Sines and cosines (K, N) of the first orders of an angle."""
    k = np.arange(1, TURNS + 1)[:, None]
    return np.concatenate([np.sin(k * angle), np.cos(k * angle)])


def _loads(recording: Recording) -> Array:
    chain = scope_of(recording).chain
    payload = np.zeros(len(recording)) if recording.payload is None else recording.payload
    rows = np.column_stack([recording.q, payload])
    q, mass = cs.SX.sym("q", chain.n), cs.SX.sym("payload")
    torque = cs.Function("torque", [cs.vertcat(q, mass)], [chain.gravity_torque(q, mass)])
    return over_rows(torque, rows)[0][:, 0]


@dataclass(frozen=True, eq=False)
class Base:
    """The model's own columns (P, N m) and target (N m), against which families compete.

    Attributes:
        columns: Columns in units of their scales.
        linear: Their sufficient statistics.
        precision: Flat priors for the nuisances, wide ones for the effects (P,).
        noise: The prior of the noise.
    """

    columns: Array
    target: Array
    linear: Linear
    precision: Array
    noise: NoisePrior

    @classmethod
    def of(cls, base: Array, target: Array, flat: int, noise: NoisePrior) -> Base:
        """From columns (P, N, m); those from ``flat`` on are effects."""
        A, t = base.reshape(len(base), -1), target.ravel()
        linear = Linear(A @ A.T, A @ t, float(t @ t), float(t.size))
        floor = 1e-11 * max(float(np.diag(linear.G).max(initial=0.0)), 1e-300)
        precision = np.full(len(A), floor)
        left = linear.beside(np.arange(len(A)), precision)
        precision[flat:] = max(float(noise.variance(left.tt, left.n)) / WIDE**2, floor)
        return cls(A, t, linear, precision, noise)

    @cached_property
    def beside(self) -> Beside:
        """What the model's own columns leave."""
        return self.linear.beside(np.arange(len(self.columns)), self.precision)

    @cached_property
    def _factor(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.linear.G + np.diag(self.precision)))

    def score(self, family: Array) -> tuple[float, float]:
        """Log evidence of a family (k, N, m) beside the base, and its best scale."""
        C = family.reshape(len(family), -1)
        seen = solve_triangular(self._factor, self.columns @ C.T, lower=True)
        block = C @ C.T - seen.T @ seen
        b = C @ self.target - seen.T @ self.beside.hidden
        by_scale = block_evidence(block[None], b[None], self.beside.tt, self.beside.n, self.noise)
        weighted = by_scale[0] + LOG_SCALE_WEIGHTS
        return float(logsumexp(weighted)), float(SCALES[np.argmax(weighted)])

    def gains(self, family: Array, model: Model, fixed: int) -> list[float]:
        """Log evidence of each chosen effect beside all others and a family (k, N, m)."""
        X = np.concatenate([self.columns, family.reshape(len(family), -1)])
        linear = Linear(X @ X.T, X @ self.target, self.linear.tt, self.linear.n)
        variance = float(self.noise.variance(self.beside.tt, self.beside.n))
        precision = np.concatenate([self.precision, np.full(len(family), variance)])
        scale = 1 / np.sqrt(np.diag(linear.G) + precision)
        whole = (linear.G + np.diag(precision)) * np.outer(scale, scale)
        inverse = np.linalg.inv(whole) * np.outer(scale, scale)
        z = inverse @ linear.b
        tt = max(linear.tt - float(z @ linear.b), 0.0)
        used = float(np.sum(1 - np.diag(inverse) * precision))
        found = []
        for term in model.terms[fixed:]:
            mine = slice(term.columns.start, term.columns.stop)
            schur = np.linalg.inv(inverse[mine, mine])
            b = schur @ z[mine]
            block = schur - np.diag(precision[mine])
            more, left = float(z[mine] @ b), linear.n - used + len(b)
            by_scale = block_evidence(block[None], b[None], tt + more, left, self.noise)[0]
            found.append(float(logsumexp(by_scale + LOG_SCALE_WEIGHTS)))
        return found
