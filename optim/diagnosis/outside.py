r"""The candidate that a closed list lacks: an unknown, smooth dependence on something recorded.

Beside the verdict's own columns, families of smooth functions compete by the same evidence: of the
tip's place, of the posture, of one joint's angle acting on another joint, of time, temperature,
load and side of approach. Each is a Gaussian process in its weights' view (Rasmussen and Williams
2006, sec. 2.1): cosines of one input, random Fourier features of several (Rahimi and Recht 2007).
A family that wins says on what the unknown effect depends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from kinematics.effects.joint_offset import JointOffset
from optim.diagnosis.evidence import (
    LOG_SCALE_WEIGHTS,
    SCALES,
    NoisePrior,
    block_evidence,
)
from optim.diagnosis.linear import Linear
from optim.mapped import Mapped
from optim.observation import Model, build_model, scope_of
from optim.problem import Array
from optim.recording import Recording

PRIOR_ODDS = 0.1
USUAL = 3e-4
MOST_ROWS = 1500
COSINES, TURNS, FEATURES = 8, 6, 24


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
    scored = [_score(base, target, f.columns, flat, noise) for f in found]
    odds = np.array([s[0] for s in scored]) + shares
    best = int(np.argmax(odds))
    gains = _gains(model, fixed, base, target, found[best].columns * scored[best][1], flat, noise)
    return Outside(
        float(logsumexp(odds)), found[best].words, found[best].stage, found[best].element, gains
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
    J = np.concatenate([p[2] for p in parts], axis=1)
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
    return chain.gravity_torque.map(len(recording))(recording.q.T, payload[None]).full().T


def _score(
    base: Array, target: Array, columns: Array, flat: int, noise: NoisePrior
) -> tuple[float, float]:
    """Log evidence of a family beside the base, and its best scale."""
    k, P = len(columns), len(base)
    X = np.concatenate([base, columns]).reshape(P + k, -1)
    t = target.ravel()
    G = X @ X.T
    linear = Linear(G, X @ t, float(t @ t), float(t.size))
    beside = linear.beside(np.arange(P), _precision(G, P, flat, noise, linear))
    kept = np.arange(P, P + k)
    block = G[P:, P:] - beside.root[kept] @ beside.root[kept].T
    b = linear.b[P:] - beside.root[kept] @ beside.hidden
    by_scale = block_evidence(block[None], b[None], beside.tt, beside.n, noise)[0]
    weighted = by_scale + LOG_SCALE_WEIGHTS
    return float(logsumexp(weighted)), float(SCALES[np.argmax(weighted)])


def _precision(G: Array, P: int, flat: int, noise: NoisePrior, linear: Linear) -> Array:
    """Flat priors for the nuisances, unit ones for the effects, in units of the noise."""
    floor = 1e-11 * max(float(np.diag(G)[:P].max(initial=0.0)), 1e-300)
    precision = np.full(P, floor)
    sigma2 = noise.sigma**2 if noise.sigma else 1e-4 * linear.tt / linear.n
    precision[flat:] = max(sigma2 / 100.0, floor)
    return precision


def _gains(
    model: Model,
    fixed: int,
    base: Array,
    target: Array,
    family: Array,
    flat: int,
    noise: NoisePrior,
) -> tuple[float, ...]:
    """Log evidence of each chosen effect beside all others and a family at its best scale."""
    gains = []
    for term in model.terms[fixed:]:
        mine = np.arange(term.columns.start, term.columns.stop)
        others = np.setdiff1d(np.arange(len(base)), mine)
        rest = np.concatenate([base[others], family])
        gains.append(_score_beside(rest, target, base[mine], len(others), flat, noise))
    return tuple(gains)


def _score_beside(
    rest: Array, target: Array, mine: Array, count: int, flat: int, noise: NoisePrior
) -> float:
    k, P = len(mine), len(rest)
    X = np.concatenate([rest, mine]).reshape(P + k, -1)
    t = target.ravel()
    G = X @ X.T
    linear = Linear(G, X @ t, float(t @ t), float(t.size))
    precision = _precision(G, P, flat, noise, linear)
    sigma2 = noise.sigma**2 if noise.sigma else 1e-2 * linear.tt / linear.n
    precision[count:] = sigma2
    beside = linear.beside(np.arange(P), precision)
    kept = np.arange(P, P + k)
    block = G[P:, P:] - beside.root[kept] @ beside.root[kept].T
    b = linear.b[P:] - beside.root[kept] @ beside.hidden
    weighted = block_evidence(block[None], b[None], beside.tt, beside.n, noise) + LOG_SCALE_WEIGHTS
    return float(logsumexp(weighted))

