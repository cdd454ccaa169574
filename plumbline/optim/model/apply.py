r"""A model on another recording of the same robot: does it foretell it, does it still hold?

What is always fitted (frame, tool, sockets, encoder zeros) is fitted again, the causes are held.
Whether one of them has changed is asked of each in turn, about that fit:

.. math:: z^2 = \delta^T (\sigma^2 S^{-1} + C)^{-1} \delta, \qquad \delta = -S^{-1} g

with the curvature S and the slope g of the cost in its parameters, all that is fitted again
eliminated, the noise :math:`\sigma` of the rows and the covariance C that the model states. Where
that leaves more than the model did on its own recording, what the library has besides is asked so.
Rows that are missed by far more than all others are gross errors: they are left out, and told.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from plumbline.errors import fault, listed
from plumbline.kinematics.effects import EFFECTS, REGISTRY, Effect
from plumbline.optim.core.judged import Judgement, Solution, judged
from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.core.quantities import counted, percent, quantity
from plumbline.optim.diagnosis.posterior.robust import far_off
from plumbline.optim.diagnosis.prior import ROUNDS
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.measurement.refit import always_fitted, candidates_of, figure, gap_unit, refit
from plumbline.optim.measurement.torque import own_units, stated_noise
from plumbline.optim.model.constants import (
    CHANGED,
    MARGIN,
    NAMED,
    STILL_HOLDS,
    UNSHOWN_CHANGE,
    WORTH,
)
from plumbline.optim.model.fitted import Fitted, by_effect
from plumbline.optim.model.rows import columns_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import placed_alike
from plumbline.optim.recording.set_up import refuse_wrong_set_up
from plumbline.optim.recording.table import row_numbers

NUISANCES = (
    "frame ",
    "tool ",
    "socket ",
    "beam ",
    "plane ",
)  # how names begin


@dataclass(frozen=True)
class Change:
    """A cause that another recording would rather have otherwise."""

    label: str  # the effect and its element
    z: float  # how many standard errors it is off, those of both recordings
    saves: float  # share of the gap left that fitting it again would save
    new: bool = False  # whether the model has nothing of it


@dataclass(frozen=True)
class Applied:
    """How a model does on another recording."""

    recording: str  # its name
    rows: int  # number of its rows
    unit: str  # of the gaps, ``"m"`` or ``"rad"``
    before: float  # RMS without the causes, what is always fitted fitted again [unit]
    after: float  # RMS with them held [unit]
    # what the model left on its own recording's rows left out, or the noise that is stated here
    # where that is more [unit]
    promised: float
    refitted: tuple[str, ...]  # what was fitted again
    # causes that were not carried over: of one session, or what they read is missing
    left_out: tuple[str, ...]
    outside: tuple[int, ...]  # rows outside of the range that was fitted, from 1
    outside_columns: dict[str, float]  # columns that leave it, and the share of rows that do
    changes: tuple[Change, ...]  # causes that seem to have changed, the most telling first
    judged: Judgement = field(default_factory=Judgement)  # whether both fits converged
    gross: tuple[int, ...] = ()  # rows that were left out as gross errors, the header being row 1

    @property
    def outside_share(self) -> float:
        """Share of rows outside of the range that was fitted."""
        return len(self.outside) / self.rows if self.rows else 0.0

    @property
    def holds(self) -> bool:
        """Whether the model still does what it did, and no cause seems to have changed."""
        return not self.changes and self.after <= STILL_HOLDS * self.promised

    @property
    def words(self) -> str:
        """The finding in a few sentences."""
        before, after = (quantity(v, self.unit) for v in (self.before, self.after))
        again = " and ".join(self.refitted) or "nothing"
        said = [f"On {self.recording}, with {again} fitted again: {before} -> {after}."]
        most = sorted(self.outside_columns, key=lambda name: -self.outside_columns[name])
        by = f", by {listed(most, NAMED)}" if most else ""
        said += [f"{percent(self.outside_share)} of the rows lie outside of what was fitted{by}."]
        if self.gross:
            said += [f"Left out as gross errors: {counted(len(self.gross), 'row')}."]
        if self.holds:
            return " ".join([*said, "The model holds."])
        if self.changes:
            each = (
                f"{c.label} ({'new, ' * c.new}{percent(c.saves)} of what is left)"
                for c in self.changes
            )
            stays = self.after * (1.0 - max(c.saves for c in self.changes))
            then, was = (quantity(v, self.unit) for v in (stays, self.promised))
            one = "the first of them" if len(self.changes) > 1 else "it"
            named = f"Changed since, or not what it seemed: {listed(each, NAMED)}"
            said += [f"{named}; with {one} fitted again"]
            return " ".join([*said, f"{then} stays, where it left {was} before."])
        more = f"{self.after / self.promised:.1f} times what it left where it was fitted"
        return " ".join([*said, f"It leaves {more}, and no single cause explains that."])

    def __repr__(self) -> str:
        before, after = (quantity(v, self.unit) for v in (self.before, self.after))
        state = "holds" if self.holds else "does not hold"
        return f"<Applied to {self.recording[:40]}: {before} -> {after}; {state}>"

    def to_dict(self) -> dict[str, object]:
        """The figures as plain data in SI units."""
        return {
            "recording": self.recording,
            "rows": self.rows,
            "unit": self.unit,
            "before": self.before,
            "after": self.after,
            "promised": self.promised if np.isfinite(self.promised) else None,
            "refitted": list(self.refitted),
            "left_out": list(self.left_out),
            "outside_range": {"share": self.outside_share, "columns": self.outside_columns},
            "holds": self.holds,
            "changes": [
                {"cause": c.label, "z": c.z, "saves": c.saves, "new": c.new} for c in self.changes
            ],
            "gross_rows": list(self.gross),
            "notes": list(self.judged.failures),
        }


def apply(model: Fitted, other: Recording, *, force: bool = False) -> Applied:
    """Try a model on another recording of the robot; with force on one set up otherwise, too.

    Raises:
        PlumblineError: It is of another robot, or measures something else, or another simple set-up
            explains its rows far better: what a cause would be found to have changed is that.
    """
    refuse_another_robot(model, other)
    if not force:
        refuse_wrong_set_up(other)
    always = always_fitted(other)
    carried, left_out = _carried(model, other)
    free = [e for e in carried.effects if e.name in (*model.always, *other.always)]
    more = [e for e in always if e not in carried.effects]
    effects = [*carried.effects, *more]
    values = np.concatenate([carried.values, _nulls(more)])
    solution, bad = _robust(other, effects, values, [*free, *more])
    nominal = refit(other, always, _nulls(always), free=always, weights=(~bad).astype(float))
    unit, per_row = gap_unit(other)
    own = own_units(other)
    before, after = (
        figure(s.mapped.residuals(s.x)[~bad] * own, per_row) for s in (nominal, solution)
    )
    promised = _promised(model, other, per_row=per_row)
    changes = _changes(carried, solution, free, other)
    if after * (1.0 - max((c.saves for c in changes), default=0.0)) > STILL_HOLDS * promised:
        changes = _with_new(changes, other, effects, solution, (~bad).astype(float))
    outside, columns = outside_range(carried, other)
    ends = [judged(nominal, "the fit without causes"), judged(solution, "the fit to other rows")]
    again, beyond = _named(other, [*free, *more]), tuple((np.flatnonzero(outside) + 1).tolist())
    return Applied(
        other.name, len(other), unit, before, after, promised, again, left_out, beyond, columns,
        changes, Judgement.of(ends), row_numbers(bad),
    )  # fmt: skip


def _robust(
    other: Recording, effects: Sequence[Effect], values: Array, free: Sequence[Effect]
) -> tuple[Solution, Flags]:
    """The fit without gross rows, and which these are (N,)."""
    bad = np.zeros(len(other), dtype=bool)
    solution = refit(other, effects, values, free=free)
    for _ in range(ROUNDS):
        before, bad = bad, far_off(solution.mapped.residuals(solution.x))
        if (bad == before).all():
            break
        solution = refit(other, effects, values, free=free, weights=(~bad).astype(float))
    return solution, bad


def _with_new(
    known: tuple[Change, ...],
    other: Recording,
    effects: Sequence[Effect],
    solution: Solution,
    weights: Array,
) -> tuple[Change, ...]:
    """The changes, in front what the library has besides where it explains more than any of them.

    Of families that are scanned over a number, such as ripples of all orders, none is asked.
    """
    labels = {e.label for e in effects}
    others = [e for e in candidates_of(other, EFFECTS) if e.label not in labels and not e.scanned]
    model = build_model(other, [*effects, *others], weights=weights)
    x = np.concatenate([solution.x, model.start[len(solution.x) :]])
    gram, none = Solution(model.problem, x).gram, np.zeros((len(x), len(x)))
    fitted = np.flatnonzero(solution.problem.lower < solution.problem.upper)
    asked = [
        _change(t.effect.label, np.arange(len(x))[t.columns], fitted, gram, none, other)
        for t in model.terms[len(effects) :]
    ]
    told = [c for c in asked if c.z > CHANGED and c.saves > max([WORTH, *(k.saves for k in known)])]
    return (*(replace(c, new=True) for c in sorted(told, key=lambda c: -c.saves)[:1]), *known)


def refuse_another_robot(model: Fitted, other: Recording) -> None:
    """Refuse a recording of other joints, or of something else than the model predicts."""
    mend = "give a recording of the same robot"
    joints = ("joints", str(model.chain.n), str(other.chain.n))
    kinds = ("observation", model.observation, other.observation)
    for what, one, two in (joints, kinds):
        if one != two:
            raise fault(f"{other.name}, {what}", two, f"{one} as in {model.recording}", mend)
    if not placed_alike(model.chain, other.chain):
        found = f"{other.robot.name} with joints placed or turning otherwise"
        raise fault(f"{other.name}, robot", found, model.robot.name, mend)


def outside_range(model: Fitted, other: Recording) -> tuple[Flags, dict[str, float]]:
    """Rows (N,) outside of the range that was fitted, and the share of them by column.

    Joints count always; what else was recorded only where one of the effects reads it.
    """
    read = {name for e in model.effects for name in (*e.needs, *e.needs_one_of)} - {"time"}
    outside, shares = np.zeros(len(other), dtype=bool), {}
    for name, values in columns_of(other).items():
        if name not in model.ranges or (name != "q" and name not in read):
            continue
        low, high = model.ranges[name]
        room = MARGIN * (high - low)
        out = (values < low - room) | (values > high + room)
        for k, some in enumerate(out.T):
            if some.any():
                shares[name if out.shape[1] == 1 else f"{name}{k + 1}"] = float(some.mean())
        outside |= out.any(axis=1)
    return outside, shares


def _carried(model: Fitted, other: Recording) -> tuple[Fitted, tuple[str, ...]]:
    """The model with what can be expected and read in the other recording, and what is left out."""
    lasting = model.lasting()
    kept = [k for k, e in enumerate(lasting.effects) if _can_be_read(e, other)]
    carried = lasting.of(kept)
    return carried, tuple(label for label in model.labels if label not in carried.labels)


def _can_be_read(effect: Effect, recording: Recording) -> bool:
    """Whether the recording has what this variant reads; another one may make do with less."""
    if effect.name in REGISTRY and not REGISTRY[effect.name].candidates(scope_of(recording)):
        return False
    try:
        build_model(recording, [effect])
    except KeyError:
        return False
    return True


def _nulls(effects: Sequence[Effect]) -> Array:
    return np.array([p.null for e in effects for p in e.parameters], dtype=float)


def _named(other: Recording, free: Collection[Effect]) -> tuple[str, ...]:
    kind = other.kind
    if kind.ranges:
        nuisances = ["beam", "planes"]
    else:
        nuisances = [word for word in ("frame", "tool") if word in other.always and not kind.joints]
    if kind.sockets:
        nuisances = ["sockets", *(word for word in nuisances if word != "frame")]
    return (*nuisances, *dict.fromkeys(e.name for e in free))


def _promised(model: Fitted, other: Recording, *, per_row: bool) -> float:
    if other.kind.efforts:
        return model.held.after
    noise = (other.noise_std or 0.0) * (np.sqrt(3.0) if per_row else 1.0)
    return float(np.nanmax([model.held.after, noise]))


def _changes(
    carried: Fitted, solution: Solution, free: Collection[Effect], other: Recording
) -> tuple[Change, ...]:
    """Causes whose values these rows would rather have otherwise."""
    gram, E = solution.gram, len(carried.values)
    covariance = np.zeros_like(gram.matrix)
    # Unknowns: nuisances, the carried effects', then what is fitted besides.
    at = sum(name.startswith(NUISANCES) for name in solution.problem.names)
    covariance[at : at + E, at : at + E] = carried.covariance[-E:, -E:] if E else 0.0
    groups: dict[str, list[int]] = {}
    for effect, columns in by_effect(carried.effects, range(at, at + E)):
        if effect not in free:
            groups.setdefault(effect.label, []).extend(columns)
    held = {k for columns in groups.values() for k in columns}
    fitted = np.array([k for k in range(len(solution.x)) if k not in held], dtype=int)
    found = [
        _change(label, np.array(columns), fitted, gram, covariance, other)
        for label, columns in groups.items()
    ]
    told = [c for c in found if c.z > CHANGED and c.saves > WORTH]
    return tuple(sorted(told, key=lambda c: -c.saves))


def _change(
    label: str, own: Indices, fitted: Indices, gram: Gram, covariance: Array, other: Recording
) -> Change:
    """What fitting some columns again would save, given a covariance (P, P) of all unknowns."""
    A, g = gram.matrix, gram.vector
    back = np.linalg.pinv(A[np.ix_(fitted, fitted)], hermitian=True)
    pull = A[np.ix_(own, fitted)] @ back
    S = A[np.ix_(own, own)] - pull @ A[np.ix_(fitted, own)]
    slope = g[own] - pull @ g[fitted]
    inverse = np.linalg.pinv(S, rcond=UNSHOWN_CHANGE, hermitian=True)
    delta = -inverse @ slope
    saved = float(-slope @ delta)
    freedom = max(gram.count - len(fitted) - len(own), 1.0)
    variance = max((gram.square - saved) / freedom, (stated_noise(other) or 0.0) ** 2)
    C = covariance[np.ix_(own, own)]
    z2 = float(delta @ np.linalg.pinv(variance * inverse + C, hermitian=True) @ delta)
    saves = 1 - float(np.sqrt(max(1 - saved / max(gram.square, 1e-300), 0.0)))
    return Change(label, float(np.sqrt(max(z2, 0.0))), saves)
