r"""Dense families: hundreds of orders or frequencies tried at once, before the short list.

An order N of a ripple moves a joint by :math:`f_N(q_j)`, so its columns are those of the joint's
own offset times :math:`\partial f_N / \partial \theta`; those of a bump are the base's own motion
times the share of it that has come about. Given the nuisances' columns the evidence of
each order needs only its own small block: cost is linear in rows and in orders.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import zip_longest

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect, Stage, State
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.confined import parts_of, plain
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.tool_offset import ToolOffset
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.constants import CHUNK_NUMBERS
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis.constants import TWIST
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, block_evidence
from plumbline.optim.diagnosis.prior import LOG_SCALE_WEIGHTS
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.measurement.refit import in_noise
from plumbline.optim.recording.recording import Recording

PORTS = (Stage.JOINT, Stage.BASE, Stage.TOOL)  # that a model has columns of


@dataclass(frozen=True, eq=False)
class Family:
    """All variants of one scanned effect on one element, of as many unknowns, fold by fold.

    Attributes:
        effects: The variants (V).
        blocks: Gram blocks (F, V, k, k).
        cross: Products with the base columns (F, V, k, P).
        target: Products with the target (F, V, k).
    """

    effects: tuple[Effect, ...]
    blocks: Array
    cross: Array
    target: Array

    def evidence(
        self,
        base: Given,
        folds: Sequence[int],
        noise: NoisePrior,
        without: Columns | None = None,
    ) -> Array:
        """Log Bayes factor (V,) of every variant given the base columns, on some folds.

        Args:
            base: The base columns on these folds.
            folds: Which.
            noise: The prior of the noise.
            without: Base columns to be left out: what a variant would replace.
        """
        chosen = list(folds)
        blocks, cross = self.blocks[chosen].sum(axis=0), self.cross[chosen].sum(axis=0)
        target = self.target[chosen].sum(axis=0)
        base = base if without is None else base.without(without)
        blocks = blocks - (cross @ base.inverse) @ cross.transpose(0, 2, 1)
        by_scale = block_evidence(blocks, target - cross @ base.values, base.tt, base.n, noise)
        return np.asarray(np.logaddexp.reduce(by_scale + LOG_SCALE_WEIGHTS, axis=1))


@dataclass(frozen=True, eq=False)
class Given:
    """Base columns that are eliminated.

    Attributes:
        inverse: Inverse of their Gram matrix (P, P); of columns left out nought.
        values: Their values (P,).
        tt: Square of the target that is left.
        n: Equations left.
    """

    inverse: Array
    values: Array
    tt: float
    n: float

    @classmethod
    def of(cls, base: Linear) -> Given:
        """All columns of a linear problem."""
        values, vectors = np.linalg.eigh(base.G)
        good = values > 1e-12 * values.max(initial=0.0)
        root = vectors[:, good] / np.sqrt(values[good])
        hidden = root.T @ base.b
        tt = max(base.tt - float(hidden @ hidden), 0.0)
        return cls(root @ root.T, root @ hidden, tt, base.n - float(good.sum()))

    def shows(self, columns: Columns, noise: NoisePrior) -> float:
        """Log Bayes factor of some columns (k,) given all others (as :meth:`Reduced.of`)."""
        block = np.asarray(np.linalg.pinv(self.inverse[np.ix_(columns, columns)], hermitian=True))
        z = self.values[columns]
        b, n = block @ z, self.n + len(columns)
        by_scale = block_evidence(block[None], b[None], self.tt + float(z @ b), n, noise)
        return float(np.logaddexp.reduce(by_scale[0] + LOG_SCALE_WEIGHTS))

    def without(self, columns: Columns) -> Given:
        """All but some columns (k,), by what these alone take (as :meth:`Reduced.without`)."""
        own = np.linalg.pinv(self.inverse[np.ix_(columns, columns)], hermitian=True)
        moved, z = self.inverse[:, columns] @ own, self.values[columns]
        inverse = self.inverse - moved @ self.inverse[columns]
        values = self.values - moved @ z
        inverse[columns], inverse[:, columns], values[columns] = 0.0, 0.0, 0.0
        return Given(inverse, values, self.tt + float(z @ own @ z), self.n + len(columns))


def families(
    model: MeasurementModel,
    x: Array,
    folds: NDArray[np.intp],
    variants: Sequence[Effect],
) -> tuple[list[Family], list[Linear]]:
    """Blocks of all variants about a fitted model, and the model's own columns, fold by fold.

    Args:
        model: Nuisances and effects already chosen; their columns are eliminated.
        x: Its fit (P,).
        folds: Fold of every row (N,).
        variants: Scanned effects, any number.
    """
    n = model.recording.chain.n
    offsets = [JointOffset(joint=j + 1) for j in range(n)]
    of_base = [BaseBump(moment=-np.inf)] if any(v.port == Stage.BASE for v in variants) else []
    of_tool = [ToolOffset()] if any(v.port == Stage.TOOL for v in variants) else []
    effects = [*(t.effect for t in model.terms), *offsets, *of_tool, *of_base]
    wide = build_model(
        model.recording, effects, nuisance=model.nuisance, weights=model.problem.weights
    )
    P = model.problem.size
    at = np.concatenate([x, np.zeros(wide.problem.size - P)])
    grouped: dict[tuple[object, ...], list[Effect]] = defaultdict(list)
    for effect in variants:
        alike = (effect.name, effect.element, len(effect.parameters), parts_of(effect))
        grouped[alike].append(effect)
    groups = [tuple(group) for group in grouped.values()]
    halves = side_by_side(
        lambda some: _scanned(model, wide, x, at, folds, some), (groups[::2], groups[1::2])
    )
    (even, linears), (odd, _) = halves
    found = [pair for pairs in zip_longest(even, odd) for pair in pairs]
    return found[: len(groups)], linears


def _scanned(
    model: MeasurementModel,
    wide: MeasurementModel,
    x: Array,
    at: Array,
    folds: NDArray[np.intp],
    groups: Sequence[tuple[Effect, ...]],
) -> tuple[list[Family], list[Linear]]:
    """The same of some groups of variants, about a point ``at`` of a model with all ports."""
    P, chain, count = len(x), model.recording.chain, int(folds.max(initial=0)) + 1
    sums = [_Sums.empty(chain, count, group, P) for group in groups]
    base = [np.zeros((count, P, P)), np.zeros((count, P)), np.zeros(count), np.zeros(count)]
    root, recording = np.sqrt(model.problem.weights), model.recording
    freedom = np.broadcast_to(model.problem.freedom, len(root))
    label = model.recording.part
    scale = model.problem.scale
    for part, r, J in Mapped(wide.problem).jacobians(at):
        w = root[part][:, None]
        A = np.moveaxis(J[..., :P] * scale * w[:, None], 2, 0)
        t = np.einsum("pnm,p->nm", A, x / scale) - r * w
        ports = np.moveaxis(J[..., P:], 2, 0) * w
        rows = wide.problem.rows[part]
        own = recording.select(np.arange(part.start, part.stop))
        here = [None if label is None else total.here(label[part]) for total in sums]
        for f in np.unique(folds[part]):
            mine = np.flatnonzero(folds[part] == f)
            Af, tf = A[:, mine].reshape(P, t[mine].size), t[mine].ravel()
            base[0][f] += Af @ Af.T
            base[1][f] += Af @ tf
            base[2][f] += tf @ tf
            base[3][f] += root[part][mine] ** 2 @ freedom[part][mine]
            given = (wide, own.select(mine), rows[mine], ports[:, mine], Af, t[mine], w[mine])
            for total, all_here in zip(sums, here, strict=True):
                total.add(f, *given, None if all_here is None else all_here[mine])
    linears = [Linear(base[0][f], base[1][f], base[2][f], base[3][f]) for f in range(count)]
    return [s.family() for s in sums], linears


@dataclass(frozen=True, eq=False)
class _Sums:
    """Running sums of one family."""

    effects: tuple[Effect, ...]
    move: cs.Function
    blocks: Array
    cross: Array
    target: Array

    @classmethod
    def empty(cls, chain: Chain, folds: int, effects: tuple[Effect, ...], P: int) -> _Sums:
        V, k = len(effects), len(effects[0].parameters)
        move = _displacement(chain, tuple(map(plain, effects)))
        shapes = (folds, V, k, k), (folds, V, k, P), (folds, V, k)
        return cls(effects, move, *map(np.zeros, shapes))

    def add(
        self,
        f: int,
        model: MeasurementModel,
        recording: Recording,
        rows: Array,
        ports: Array,
        A: Array,
        t: Array,
        w: Array,
        here: NDArray[np.bool_] | None,
    ) -> None:
        """Add a fold's rows (n), in pieces that keep memory bounded; elsewhere it does nothing.

        Args:
            f: The fold.
            model: Base columns and ports.
            recording: The rows (n).
            rows: Data of the rows (n, k).
            ports: Columns of the ports (p, n, m).
            A: Base columns (P, n m).
            t: The target (n, m).
            w: Roots of the rows' weights (n, 1).
            here: Rows that the family is about (n,), if not all.
        """
        first, V = self.effects[0], len(self.effects)
        k, m = len(first.parameters), t.shape[1]
        n = model.recording.chain.n
        time = rows[:, _time_column(model)] if model.recording.time is not None else rows[:, 0]
        unit = np.array([p.scale for p in first.parameters])
        step = max(1, CHUNK_NUMBERS // (V * k * m))
        for piece in (slice(start, start + step) for start in range(0, len(rows), step)):
            found = over_rows(self.move, np.column_stack([rows[piece, :n], time[piece]]))[0]
            D = found.reshape(len(found), V, k, -1).transpose(1, 2, 0, 3)
            if here is not None:
                D = D * here[piece, None]
            C = self._columns(D * unit[:, None, None], ports[:, piece], n)
            if self.effects[0].port not in PORTS:  # of which the readings are not the residuals
                C = in_noise(recording.select(np.arange(len(rows))[piece]), C) * w[piece]
            C = C.reshape(V, k, -1)
            self.blocks[f] += C @ C.transpose(0, 2, 1)
            base = A[:, piece.start * m : piece.stop * m]
            self.cross[f] += (C.reshape(V * k, -1) @ base.T).reshape(V, k, -1)
            self.target[f] += C @ t[piece].ravel()

    def here(self, label: NDArray[np.int64]) -> NDArray[np.bool_] | None:
        """Rows (N,) of the recordings that the family is confined to; None if it is not."""
        parts = parts_of(self.effects[0])
        return None if parts is None else np.isin(label, parts)

    def _columns(self, D: Array, ports: Array, joints: int) -> Array:
        """Columns (V, k, n, m) of what the variants displace (V, k, n, d), in units of scale."""
        first, (V, k, n, d) = self.effects[0], D.shape
        if first.port == Stage.JOINT:
            return np.asarray(D * ports[int(first.element or 1) - 1])
        if first.port == Stage.BASE:
            return np.asarray(D * ports[-TWIST:][:k])
        if first.port == Stage.TOOL:
            return np.asarray(D * ports[joints:][:k])
        columns = np.zeros((V, k, n, ports.shape[-1]))
        columns[..., :d] = D
        return columns

    def family(self) -> Family:
        return Family(self.effects, self.blocks, self.cross, self.target)


def _time_column(model: MeasurementModel) -> int:
    """Time stands behind the joints and what was measured: see the order of a model's row."""
    return model.recording.q.shape[1] + model.recording.measured.shape[1]


def _place(state: State, effect: Effect) -> cs.SX:
    """What an effect displaces: a joint, all of the base's twist or of the tool, or the reading."""
    if effect.port == Stage.JOINT:
        return state.q[int(effect.element or 1) - 1]
    whole = {Stage.BASE: state.base_twist, Stage.TOOL: state.tool}
    return cs.sum1(whole[effect.port]) if effect.port in whole else state.reading


@lru_cache(maxsize=64)
def _displacement(chain: Chain, effects: tuple[Effect, ...]) -> cs.Function:
    """``(q, time) -> d(displacement)/d(theta)`` of every variant, stacked: (V k 1) or (V k 3)."""
    effect = effects[0]
    symbols = {"q": cs.SX.sym("q", chain.n), "time": cs.SX.sym("time")}
    hyper = cs.SX.sym("hyper")
    theta = cs.SX.sym("theta", len(effect.parameters))
    state = State.ideal(chain, symbols, cs.SX(3, 1))
    variant = replace(effect, **{str(effect.scanned): hyper})
    moved = variant.apply(state, *cs.vertsplit(theta))
    place = _place(moved, effect)
    inputs = [symbols["q"], symbols["time"]]
    jacobian = cs.densify(cs.jacobian(place, theta))  # displacement is linear in theta
    one = cs.Function("one", [*inputs, hyper], [cs.vec(jacobian)])
    values = cs.DM([[getattr(e, str(e.scanned)) for e in effects]])
    moves = one.map(len(effects))(*(cs.repmat(i, 1, len(effects)) for i in inputs), values)
    return cs.Function("move", [cs.vertcat(*inputs)], [cs.vec(moves)])
