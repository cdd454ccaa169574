r"""Which causes are in each recording what they are in the others, and what each leaves.

About the joint fit every recording has a Gram matrix of its own. With the unknowns of one cause a
and all others b, eliminated under their priors, recording k alone and all others together say

.. math:: z^2 = (\hat a_k - \hat a_o)^T (P_k^{-1} + P_o^{-1})^{-1} (\hat a_k - \hat a_o)

with the precisions :math:`P = \zeta (G_{aa} - G_{ab} (G_{bb} + \Lambda)^{-1} G_{ba}) / s^2`, the
noise s that each leaves and the share :math:`\zeta` that rows are worth of their number, by how far
their blocks agree (:mod:`plumbline.optim.diagnosis.posterior.agreement`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plumbline.kinematics.effects.confined import parts_of
from plumbline.optim.core.judged import standard_errors
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Indices, Integers
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.constants import FLATTEST_TOLD
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.linear import Linear, flat_prior, solved
from plumbline.optim.diagnosis.motion.carrying import drives_of_all
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED
from plumbline.optim.diagnosis.motion.masses import MassFit, Telling, fitted_mass
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals, spread
from plumbline.optim.diagnosis.of_recordings import AgainstOthers, Carries, OfRecording, Transfer
from plumbline.optim.diagnosis.posterior.agreement import share_of
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.folds import blocks_of_each
from plumbline.optim.diagnosis.verdict.words import parameter_name
from plumbline.optim.measurement.observation import ModelTerm
from plumbline.optim.measurement.refit import figure, gap_unit
from plumbline.optim.measurement.torque import own_units
from plumbline.optim.model.constants import CHANGED
from plumbline.optim.recording.recording import Session
from plumbline.optim.recording.session import apart
from plumbline.optim.recording.table import Flags, row_numbers


@dataclass(frozen=True, eq=False)
class Each:
    """The joint fit, recording by recording."""

    selected: SelectedModel  # the joint fit
    session: Session  # the recordings
    part: Integers  # which of them each row of the fit is of (N,)

    @property
    def always(self) -> int:
        """How many unknowns are always fitted."""
        model = self.selected.model
        return model.fixed + sum(len(e.parameters) for e in self.selected.fixed)

    @property
    def causes(self) -> tuple[ModelTerm, ...]:
        """Terms of the causes."""
        return self.selected.model.terms[len(self.selected.fixed) :]

    @cached_property
    def blocks(self) -> list[list[Gram]]:
        """Normal equations of each recording's blocks of rows that may err alike."""
        best, label = self.selected.best, blocks_of_each(self.selected.model.recording)
        found = best.mapped.grams(best.x, label)
        own = [np.unique(label[self.part == k]) for k in range(len(self.session))]
        return [[found[b] for b in blocks] for blocks in own]

    @cached_property
    def grams(self) -> list[Gram]:
        """Normal equations of each recording's rows."""
        empty = Gram.empty(self.selected.best.problem.size)
        return [sum(own, start=empty) for own in self.blocks]

    @cached_property
    def shares(self) -> list[tuple[float, float]]:
        """What share of their number the rows of each recording are worth, and those of the rest.

        By how far their blocks agree, each side at the fit of its own rows.
        """
        every = range(len(self.session))
        return [
            (
                self._share(self.alone[k], self.blocks[k]),
                self._share(self.others[k], [b for m in every if m != k for b in self.blocks[m]]),
            )
            for k in every
        ]

    def _share(self, whole: Linear, blocks: Sequence[Gram]) -> float:
        parts = [self._linear(gram) for gram in blocks if gram.count]
        prior = self.precision(whole)
        z = solved(whole.G + np.diag(prior), whole.b)
        left = max(whole.square_at(np.arange(len(z)), z), 0.0)
        sigma2 = left / max(whole.n - np.count_nonzero(np.diag(whole.G)), 1.0)
        slopes = [part.b - part.G @ z for part in parts]
        return share_of([part.G for part in parts], slopes, sigma2, whole.n) if parts else 1.0

    def _linear(self, gram: Gram) -> Linear:
        return Linear.about(gram, self.selected.best.x, self.selected.best.problem.scale)

    @cached_property
    def alone(self) -> list[Linear]:
        """The linear problem of each recording's rows."""
        return [self._linear(gram) for gram in self.grams]

    @cached_property
    def others(self) -> list[Linear]:
        """The linear problem of all rows but those of each recording."""
        total = sum(self.grams, start=Gram.empty(self.selected.best.problem.size))
        return [self._linear(total - gram) for gram in self.grams]

    def precision(self, linear: Linear) -> Array:
        """Prior precisions (P,) of all unknowns, as the fit has them."""
        ridge = self.selected.model.ridge or (0.0,) * len(self.selected.model.terms)
        sizes = [len(t.effect.parameters) for t in self.selected.model.terms]
        flat = flat_prior(linear, self.always)
        effects = np.repeat(ridge, sizes)[self.always - self.selected.model.fixed :] ** 2
        return np.concatenate([flat, effects])

    def says(
        self, linear: Linear, own: Indices, absent: Indices | None = None,
        share: float = 1.0,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Precision (p, p) of a cause's unknowns, and that times their estimate (p,).

        Args:
            linear: The rows that are asked.
            own: The unknowns.
            absent: Others that are nought.
            share: What share of their number the rows are worth.
        """
        kept = own if absent is None else np.concatenate([own, absent])
        rest = np.setdiff1d(np.arange(len(linear.b)), kept)
        left = linear.without(rest, self.precision(linear)[rest])
        scatter = max(self._scatter(linear), 1e-300) / share
        return left.G[np.ix_(own, own)] / scatter, left.b[own] / scatter

    def _scatter(self, linear: Linear) -> float:
        """Variance that these rows leave under the joint fit."""
        best = self.selected.best
        z = best.x / best.problem.scale
        return linear.square_at(np.arange(len(z)), z) / max(linear.n - self.always, 1.0)


def transfers(each: Each) -> tuple[Transfer, ...]:
    """The table: every cause, every recording."""
    found: dict[tuple[Key, int], list[ModelTerm]] = {}
    for term in each.causes:
        for k in range(len(each.session)):
            found.setdefault(((term.effect.name, term.effect.element), k), []).append(term)
    return tuple(t for (key, k), terms in found.items() for t in _of_cause(each, key, k, terms))


def _of_cause(each: Each, key: Key, k: int, terms: list[ModelTerm]) -> list[Transfer]:
    """What a recording says of a cause; nothing where the cause is confined to others.

    What is in all, and more or less of it in this one, differs: then the whole of it is compared.
    """
    name = each.session.parts[k].name
    mine = [t for t in terms if parts_of(t.effect) == (k,)]
    both = [t for t in terms if k in (parts_of(t.effect) or (k,)) and t not in mine]
    found = [_against_others(each, key, k, both, mine)] if both else []
    if mine and not (found and found[0].carries == Carries.NO):
        one = each.says(each.alone[k], _columns(mine), share=each.shares[k][0])
        none = np.zeros_like(one[0]), np.zeros_like(one[1])
        values = _compared(each, mine, one, none)
        found.append(Transfer(*key, name, Carries.ONLY, parameters=values))
    return found


def _against_others(
    each: Each, key: Key, k: int, terms: list[ModelTerm], more: list[ModelTerm]
) -> Transfer:
    """A cause that several share, as recording k has it without what is confined to it."""
    own, absent = _columns(terms), _columns(more)
    mine, theirs = each.shares[k]
    one = each.says(each.alone[k], own, absent, mine)
    other = each.says(each.others[k], own, absent, theirs)
    z = _apart(one, other)
    told = all(_is_told(each, terms, P) for P, _ in (one, other))
    carries = Carries.NO if z > CHANGED else Carries.YES if told else Carries.UNTOLD
    values = _compared(each, terms, one, other)
    return Transfer(*key, each.session.parts[k].name, carries, z, values)


def _columns(terms: Sequence[ModelTerm]) -> Indices:
    """Unknowns of some terms."""
    parts = [np.arange(t.columns.start, t.columns.stop) for t in terms]
    return np.concatenate([np.empty(0, dtype=np.intp), *parts])


def _apart(one: tuple[Array, Array], other: tuple[Array, Array]) -> float:
    """How many standard errors two estimates are apart, each (precision, precision x estimate).

    The parallel sum P_k (P_k + P_o)^-1 P_o needs no inverse of what one of them does not tell.
    """
    (P, b), (Q, c) = one, other
    total = P + Q
    floor = max(FLATTEST_TOLD * float(np.diag(total).max(initial=0.0)), 1e-300)
    inverse = np.linalg.inv(total + floor * np.eye(len(total)))
    # With the estimates of both together a = (P + Q)^-1 (b + c), each misses it by its own slope.
    slope = b - P @ inverse @ (b + c)
    back = np.linalg.pinv(P @ inverse @ Q, rcond=FLATTEST_TOLD, hermitian=False)
    return float(np.sqrt(max(float(slope @ back @ slope), 0.0)))


def _is_told(each: Each, terms: list[ModelTerm], P: Array) -> bool:
    """Whether rows tell every parameter of a cause better than its prior does."""
    ridge = dict(zip(each.selected.model.terms, each.selected.model.ridge or (), strict=False))
    variance = each.selected.selection.variance(each.selected.chosen)
    prior = np.concatenate(
        [np.full(len(t.effect.parameters), ridge.get(t, 0.0) ** 2 / variance) for t in terms]
    )
    return bool((standard_errors(P, 1.0, FLATTEST_TOLD) ** -2.0 > prior).all())


def _compared(
    each: Each,
    terms: list[ModelTerm],
    here: tuple[Array, Array],
    there: tuple[Array, Array],
) -> dict[str, AgainstOthers]:
    scale = each.selected.best.problem.scale[_columns(terms)]
    sides = []
    for P, right in (here, there):
        value = np.linalg.pinv(P, rcond=FLATTEST_TOLD, hermitian=True) @ right
        sides.append((scale * value, scale * standard_errors(P, 1.0, FLATTEST_TOLD)))
    chain = each.selected.model.recording.chain
    pairs = [(t.effect, p) for t in terms for p in t.effect.parameters]
    (value, std), (others, others_std) = sides
    out = {}
    for i, (effect, p) in enumerate(pairs):
        name = parameter_name(p.name, effect.variant if effect.scanned else "")
        one, two = (float(value[i]), float(std[i])), (float(others[i]), float(others_std[i]))
        out[name] = AgainstOthers(*one, *two, effect.unit_of(p, chain))
    return out


def figures(
    each: Each,
    found: Diagnosis,
    noises: list[tuple[float, str]],
) -> tuple[OfRecording, ...]:
    """Each recording's held-out figures in its own unit."""
    recording, before, after = found.recording, found.residual_before, found.residual_after
    listed = []
    for k, part in enumerate(each.session.parts):
        mine = apart(recording)[1] == k
        rows = mine & found.trusted
        if part.held_out is not None and recording.held_out is not None:
            rows &= recording.held_out
        unit, per_row = gap_unit(part)
        live = each.session.live(k)
        sides = [figure(r[rows][:, live], per_row) for r in (before, after)]
        listed.append(
            OfRecording(
                name=part.name,
                observation=part.observation,
                rows=len(part),
                unit=unit,
                before=sides[0],
                after=sides[1],
                without_it=without(each, k),
                noise=noises[k][0],
                noise_source=noises[k][1],
                gross=row_numbers(~found.trusted[mine]),
            )
        )
    return tuple(listed)


def without(each: Each, k: int) -> float:
    """RMS of a recording's rows with causes fitted to the others alone [m or rad].

    Its nuisances are fitted to it. Causes that the others do not show are at their null.
    """
    best, linear, here = each.selected.best, each.others[k], each.alone[k]
    scale = best.problem.scale
    z = solved(linear.G + np.diag(each.precision(linear)), linear.b)
    mine = np.flatnonzero(np.diag(here.G)[: each.always] > 0)
    z[: each.always] = (best.x / scale)[: each.always]
    fixed = np.setdiff1d(np.arange(len(z)), mine)
    right = here.b[mine] - here.G[np.ix_(mine, fixed)] @ z[fixed]
    z[mine] = solved(here.G[np.ix_(mine, mine)] + np.diag(flat_prior(here, len(mine))), right)
    rows = np.flatnonzero((each.part == k) & (best.problem.weights > 0))
    problem = best.problem.on(best.problem.rows[rows])
    x = np.clip(z * scale, problem.lower, problem.upper)
    r = Mapped(problem).residuals(x)
    shape = each.selected.model.recording.noise_shape
    r = (r if shape is None else r * shape[rows]) * own_units(each.selected.model.recording)
    return figure(r[:, each.session.live(k)], gap_unit(each.session.parts[k])[1])


def masses_carry(
    signals: Signals, joints: Sequence[JointFindings], mine: Flags, name: str
) -> Iterator[Transfer]:
    r"""Every such body as one motion alone says it, and what all others say.

    .. math:: z = \sqrt{d^T (C_k + C_o)^{-1} d / P}

    of differences d of its P values.

    Args:
        signals: States of all motions.
        joints: What was found of drives.
        mine: Which windows (W,) are of the one motion.
        name: What it is called.
    """
    carried = signals.recording.carried
    if not carried.bodies:
        return
    drives = drives_of_all(joints, signals.recording.n)
    tellings = [
        Telling(signals, drives, spread(signals.starts[chosen], MOST_JUDGED))
        for chosen in (mine, ~mine)
    ]
    one, others = (fitted_mass(telling, carried, clock=False) for telling in tellings)
    widths, first = tellings[0].scales(carried), 0
    for body in carried.bodies:
        own = slice(first, first := first + len(body.values))
        off = np.subtract(one.carried.values, others.carried.values)[own]
        both = (one.covariance + others.covariance)[own, own]
        z = float(np.sqrt(off @ np.linalg.solve(both, off) / len(off)))
        told = both[0, 0] < 2 * widths[own][0] ** 2
        carries = Carries.NO if z > CHANGED else Carries.YES if told else Carries.UNTOLD
        sides = zip(body.declared, *(_values(fit, own) for fit in (one, others)), strict=True)
        values = {
            p.name: AgainstOthers(value, std, other, others_std, p.unit)
            for p, (value, std), (other, others_std) in sides
        }
        yield Transfer(body.effect.name, body.link or None, name, carries, z, values)


def _values(fit: MassFit, own: slice) -> list[tuple[float, float]]:
    """Values with their standard errors."""
    std = np.sqrt(np.diag(fit.covariance))[own].tolist()
    return list(zip(fit.carried.values[own], std, strict=True))
