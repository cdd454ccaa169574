r"""The causes of a verdict: their estimates, held-out figures and confounded effects.

A ripple as one curve with its band, whatever orders it was fitted by.

.. math:: e(q) = B(q)\, \theta, \qquad \mathrm{std}\, e(q) = \sigma \sqrt{B(q)\, G^{-1} B(q)^T}

with the sines and cosines B of all orders of one joint, their estimates and the normal matrix G of
the whole fit: what orders share, as neighbouring ones do, is in the band.

The held-out gap as the causes go into the model one by one: the staircase of a verdict.
"""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.confined import plain
from plumbline.kinematics.effects.friction import Friction
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.core.constants import NEAR
from plumbline.optim.core.judged import standard_errors
from plumbline.optim.core.problem import Array
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis.constants import A_PERIOD, POINTS
from plumbline.optim.diagnosis.findings import Blame, Cause, Curve, Estimate, Key, NoiseLevel, Step
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.pool import Pool, settled
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.predict.held_out import Evaluation, counted_rows, square_with
from plumbline.optim.diagnosis.verdict.confounding import rivals, worth_more_than_nothing
from plumbline.optim.diagnosis.verdict.explanation import Explanation
from plumbline.optim.diagnosis.verdict.where import explained_by
from plumbline.optim.diagnosis.verdict.words import blame_of, parameter_name, variants_words
from plumbline.optim.measurement.observation import loaded_chain
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Stairs:
    """Held-out figures of some of the causes, by the linear problem about the final fit.

    That of all causes is the gap's own, of true residuals; what the linear problem says of fewer is
    told by its ratio to what it says of all.
    """

    pool: Pool  # the chosen effects alone
    terms: list[SelectedTerm]  # the terms in it
    variance: float  # noise variance that weighs their priors
    # the rows that the figures are of, fold by fold; only what the gap is counted in
    rows: list[Linear]
    after: float  # held-out RMS with all causes, the gap's

    @classmethod
    def of(cls, recording: Recording, selected: SelectedModel, evaluation: Evaluation) -> Self:
        """Linearised about the final fit, once."""
        pool, terms = settled(selected.pool, selected.chosen, selected.best.x)
        rows = counted_rows(recording, pool, evaluation)
        variance = selected.selection.variance(selected.chosen)
        return cls(pool, terms, variance, rows, evaluation.rms_after)

    def figure(self, keys: Sequence[Key]) -> float:
        """Held-out RMS with these causes and no others."""
        some = [c for c in self.terms if self.pool.candidates[c.index].key in keys]
        square, least = (
            square_with(self.pool, t, self.variance, self.rows) for t in (some, self.terms)
        )
        return self.after * float(np.sqrt(square / least)) if least > 0.0 else self.after

    @property
    def keys(self) -> list[Key]:
        """All causes."""
        return list(dict.fromkeys(c.key for c in self.pool.candidates))


def staircase(
    stairs: Stairs, keys: Sequence[Key], evaluation: Evaluation, first: str
) -> tuple[Step, ...]:
    """The held-out gap before any cause, then with each cause added to those before it."""
    steps = [Step(first, evaluation.rms_before)]
    for k, key in enumerate(keys, start=1):
        label = blame_of(key, stairs.pool.candidates).label
        steps.append(Step(label, stairs.figure(keys[:k])))
    return tuple(steps)


def always_words(recording: Recording) -> str:
    """What is fitted before any cause, as the first bar of the staircase says it."""
    if recording.kind.efforts:
        return "before"
    if recording.element is not None and not set(recording.always) - {"frame", "tool"}:
        ranges = recording.kind.ranges
        return "beam and planes alone" if ranges else "rigid transform alone"
    effects = set(recording.always) - {"frame", "tool"}
    if recording.kind.encoders:
        return "zeros of the encoders alone" if effects == {"joint_offset"} else "before"
    sockets = recording.kind.sockets  # which no frame is needed for
    fitted = {"tool"} if sockets else {"frame", "tool"}
    if effects or not fitted <= set(recording.always):
        return "before"
    return "sockets and tool alone" if sockets else "frame and tool alone"


def curve_of(selected: SelectedModel, key: Key, noise: NoiseLevel) -> Curve | None:
    """The curve of a cause's ripples over the joint's recorded range; none of other causes.

    Of a ripple too fast for so many points, the middle of that range is shown.
    """
    terms = [t for t in selected.model.terms if (t.effect.name, t.effect.element) == key]
    ripples = [t for t in terms if isinstance(t.effect, TransmissionRipple)]
    if not ripples or len(ripples) < len(terms):
        return None
    readings = selected.model.recording.q[:, int(key[1] or 1) - 1]
    fastest = max(_fastest(t.effect) for t in ripples)
    angle = _angles(float(readings.min()), float(readings.max()), fastest)
    q = np.zeros((len(angle), selected.model.recording.chain.n))
    q[:, int(key[1] or 1) - 1] = angle
    basis = np.hstack([_basis(selected, t.effect, q) for t in ripples])
    columns = np.concatenate([np.arange(t.columns.start, t.columns.stop) for t in ripples])
    value = basis @ selected.best.x[columns]
    matrix, sigma = selected.best.gram.matrix, noise.sigma * max(noise.ratio, 1.0)
    covariance = np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)[np.ix_(columns, columns)]
    std = sigma * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", basis, covariance, basis), 0.0))
    return Curve(tuple(angle.tolist()), tuple(value.tolist()), tuple(std.tolist()))


def _fastest(effect: Effect) -> float:
    assert isinstance(effect, TransmissionRipple)
    return float(effect.order) * (len(effect.parameters) // 2)


def _angles(low: float, high: float, fastest: float) -> Array:
    """Angles (K,) [rad] that show a sine of that order, evenly over the range or its middle."""
    wanted = int(np.ceil((high - low) * fastest / (2 * np.pi) * A_PERIOD)) + 1
    if wanted <= POINTS:
        return np.linspace(low, high, max(wanted, POINTS // 6))
    half = 0.5 * (high - low) * POINTS / wanted
    return np.linspace(-half, half, POINTS) + (low + high) / 2


def _basis(selected: SelectedModel, effect: Effect, q: Array) -> Array:
    """What each parameter of a ripple, at one, adds to the joint's angle (K, p)."""
    chain = loaded_chain(selected.model.recording.chain)
    reading, theta = cs.SX.sym("q", chain.n), cs.SX.sym("theta", len(effect.parameters))
    moved = plain(effect).apply(
        State.ideal(chain, {"q": reading}, cs.SX(3, 1)), *cs.vertsplit(theta)
    )
    slope = cs.densify(cs.jacobian(moved.q[int(effect.element or 1) - 1], theta))
    function = cs.Function("basis", [reading], [slope.T]).map(len(q))
    return np.asarray(function(q.T).full().T)


def causes_of(
    selected: SelectedModel,
    keys: Sequence[Key],
    told: Explanation,
    stairs: Stairs,
    noise: NoiseLevel,
    least: Array | float = 0.0,
) -> tuple[Cause, ...]:
    """Causes of the verdict: their estimates, their held-out figures, and what could be them.

    Args:
        selected: The model.
        keys: Which of its causes.
        told: What the joint posterior says.
        stairs: Held-out figures of some of the causes.
        noise: Of one axis.
        least: Standard errors (P,) below which none is told.
    """
    whole = selected.pool.selection
    asked = replace(whole, linear=whole.linear.share(told.worth))  # as the posterior was
    kept = worth_more_than_nothing(asked, selected.chosen, told.named)

    def cause(key: Key) -> Cause:
        return _cause(selected, asked, key, told, stairs, noise, least, kept)

    return tuple(side_by_side(cause, keys))


def _cause(
    selected: SelectedModel,
    asked: SelectionProblem,
    key: Key,
    told: Explanation,
    stairs: Stairs,
    noise: NoiseLevel,
    least: Array | float,
    kept: Reduced,
) -> Cause:
    mine = _of(selected, [key])
    effects = [selected.selection.candidates[c.index].effect for c in mine]
    variants = [e.variant for e in effects]
    effect = effects[0]
    alike = [*rivals(asked, kept, mine), *_unasked(selected, effects)]
    # What is fitted unnamed in case it is there instead would hide what this one does.
    instead = {(b.effect, b.element) for b in alike} - asked.keys(kept.chosen)
    return Cause(
        effect=key[0],
        stage=str(effect.stage),
        element=key[1],
        probability=told.probabilities.get(key, 0.0),
        parameters=_parameters(selected, key, instead, noise, told, least),
        before=stairs.figure([k for k in stairs.keys if k != key and k not in instead]),
        after=stairs.figure(stairs.keys),
        confounded_with=tuple(alike),
        words="; ".join(dict.fromkeys(e.sentence for e in effects)),
        variant=variants_words(variants),
        curve=curve_of(selected, key, noise),
        sensitivity=told.sensitive.get(key),
    )


def _unasked(selected: SelectedModel, effects: Sequence[Effect]) -> list[Blame]:
    """Dry friction with play on the velocity's side, of which rows too far apart ask nothing.

    It winds a drive up against its motion: both are one and the same but for how it goes by speed.
    """
    if any(c.effect.name == Friction.name for c in selected.selection.candidates):
        return []
    why = "dry friction does the same; closer rows along one motion show how it goes by speed"
    sided = (e for e in effects if isinstance(e, Backlash) and e.by == "velocity")
    return [Blame(Friction.name, str(e.stage), e.element, why) for e in sided]


def by_importance(selected: SelectedModel, seed: int) -> dict[Key, float]:
    """Causes with the square that they explain, the largest first."""
    if not selected.chosen:
        return {}
    keys = [selected.selection.candidates[c.index].key for c in selected.chosen]
    drops = explained_by(selected.selection, selected.chosen, [str(k) for k in keys], seed)
    return {k: drops[str(k)] for k in sorted(set(keys), key=lambda k: -drops[str(k)])}


def _of(selected: SelectedModel, keys: Sequence[Key]) -> list[SelectedTerm]:
    return [c for c in selected.chosen if selected.selection.candidates[c.index].key in keys]


def _parameters(
    selected: SelectedModel,
    key: Key,
    instead: Collection[Key],
    noise: NoiseLevel,
    told: Explanation,
    least: Array | float,
) -> dict[str, Estimate]:
    """Estimates by name; variants of one cause are told apart by what sets them apart."""
    sigma = noise.sigma * max(noise.ratio, 1.0)
    free = _std_by_rows(selected, sigma)
    x, std = _without(selected, instead, sigma)
    std = np.hypot(np.maximum(std, least), _between(selected, told))
    stuck = set(selected.best.at_bound())
    terms = [t for t in selected.model.terms if (t.effect.name, t.effect.element) == key]
    width = {selected.selection.candidates[c.index].effect: c.scale for c in selected.chosen}
    out: dict[str, Estimate] = {}
    seen = Counter[str]()
    alike = len({term.effect.sentence for term in terms}) < 2
    for term in terms:
        variant = term.effect.variant if len(terms) > 1 or term.effect.scanned else ""
        variant = variant if alike else ", ".join(filter(None, [_driver(term.effect), variant]))
        seen[variant] += 1
        if seen[variant] > 1:  # apart by less than is shown
            variant += f" ({seen[variant]})"
        for column, p in zip(
            range(term.columns.start, term.columns.stop), term.effect.parameters, strict=True
        ):
            name = selected.best.problem.names[column]
            determined = free[column] < width.get(term.effect, np.inf) * p.scale
            value, error = float(x[column]), float(std[column])
            unit = term.effect.unit_of(p, selected.model.recording.chain)
            # At its null it is no part of the cause, and nothing holds the others back.
            rests = name in stuck and abs(value - p.null) > NEAR * p.scale
            said = parameter_name(p.name, variant)
            said += " (2)" * (said in out)  # an overtone, and that order once more
            out[said] = Estimate(value, error, unit, rests, p.doc, bool(determined))
    return out


def _without(selected: SelectedModel, keys: Collection[Key], sigma: float) -> tuple[Array, Array]:
    """Values and standard errors (P,) with these causes at nothing, by the last normal equations.

    What is fitted unnamed, in case it is there instead of a cause, would share that cause's values.
    """
    best, matrix = selected.best, selected.best.gram.matrix
    x, std = best.x.copy(), best.std(sigma)
    for term in selected.model.terms:
        if (term.effect.name, term.effect.element) in keys:
            x[term.columns] = [p.null for p in term.effect.parameters]
    gone = x != best.x
    held = set(best.at_bound())
    free = ~gone & [name not in held for name in best.problem.names]
    rest = np.ix_(free, free)
    S = 1 / np.sqrt(np.diag(matrix)[free])
    pull = matrix[np.ix_(free, gone)] @ (best.x - x)[gone]
    x[free] += S * np.linalg.lstsq(matrix[rest] * np.outer(S, S), S * pull, rcond=1e-13)[0]
    std[free] = standard_errors(matrix[np.ix_(~gone, ~gone)], sigma)[free[~gone]]
    return np.clip(x, best.problem.lower, best.problem.upper), std


def _between(selected: SelectedModel, told: Explanation) -> Array:
    """How far the fit's unknowns move from state to state (P,) [their units]."""
    chosen = {selected.selection.candidates[c.index].effect: c.index for c in selected.chosen}
    moved = np.zeros(selected.best.problem.size)
    for term in selected.model.terms:
        own = told.spread.get(chosen.get(term.effect, -1))
        if own is not None:
            moved[term.columns] = own * [p.scale for p in term.effect.parameters]
    return moved


def _driver(effect: Effect) -> str:
    """What of an effect's own its sentence tells, as ``by 4``: of a joint that two others drag."""
    own = [f.name for f in fields(effect) if f"{{{f.name}}}" in effect.words]
    return ", ".join(f"{name} {getattr(effect, name)}" for name in own)


def _std_by_rows(selected: SelectedModel, sigma: float) -> Array:
    """Standard errors (P,) that the rows alone would give, without the effects' priors."""
    _, J = selected.best.mapped.shared(selected.best.x)
    pulls = J[:, selected.model.nuisance.shared.numel() :]
    return standard_errors(selected.best.gram.matrix - pulls @ pulls.T, sigma)
