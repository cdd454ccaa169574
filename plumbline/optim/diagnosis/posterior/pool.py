"""The pool: every candidate that a recording could show, linearised once about the current fit."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import EFFECTS, Effect
from plumbline.kinematics.effects.confined import parts_of
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, flat_prior
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.posterior.shortlists import nearby, shortlists
from plumbline.optim.diagnosis.prior import IN_ONE, LOG_SCALE_WEIGHTS, MANY_ROWS, SCALES
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.measurement.refit import candidates_of, scope_for


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates with their linearisation, fold by fold."""

    model: MeasurementModel  # the model of all candidates at once
    x: Array  # where it is linearised: the current fit, absent effects at their null (P,)
    candidates: tuple[Candidate, ...]  # the candidates; nuisance columns come before theirs
    shared: Gram  # normal equations of what no row carries
    noise: NoisePrior  # the prior of the noise
    # which candidates a selection without fold f may choose (F + 1, C); the last row is for all
    # folds together
    shortlists: NDArray[np.bool_]
    always: int  # how many of its columns are always fitted
    fold_of_row: NDArray[np.intp]  # fold of every row (N,)

    def columns(self, terms: Sequence[SelectedTerm]) -> Columns:
        """Columns of what is always fitted, then those of some terms (k,)."""
        own = (self.candidates[term.index].columns for term in terms)
        return np.concatenate([np.arange(self.always), *own])

    def shared_at(self, x: Array) -> Gram:
        """Normal equations of what no row carries, in what is always fitted (p,)."""
        start = self.x.copy()
        start[: len(x)] = x
        r, J = Mapped(self.model.problem).shared(start)
        J = J[: len(x)]
        return Gram(J @ J.T, J @ r, float(r @ r), float(len(r)))

    def folded(self, folds: NDArray[np.intp]) -> Self:
        """The same with other folds (N,), each of which may choose what any of those before may."""
        listed = np.tile(self.shortlists.any(axis=0), (int(folds.max()) + 2, 1))
        listed[-1] = self.shortlists[-1]
        return replace(self, shortlists=listed, fold_of_row=folds)

    def _about(self, gram: Gram) -> Linear:
        return Linear.about(gram, self.x, self.model.problem.scale)

    @cached_property
    def grams(self) -> tuple[Gram, ...]:
        """Normal equations about x, fold by fold: of many candidates what takes most memory."""
        found = Mapped(self.model.problem).grams(self.x, self.fold_of_row)
        none = len(self.shortlists) - 1 - len(found)
        return (*found, *[Gram.empty(len(self.x))] * none)

    @cached_property
    def folds(self) -> list[Linear]:
        """The linear problem of each fold alone, without what no row carries."""
        return [self._about(gram) for gram in self.grams]

    @cached_property
    def whole(self) -> Linear:
        """The linear problem of all rows: of few its folds are left for when they are asked for."""
        if len(self.fold_of_row) > MANY_ROWS:  # going over them twice would take longer
            return self._about(sum(self.grams, start=self.shared))
        return self._about(Mapped(self.model.problem).gram(self.x, self.fold_of_row))

    @cached_property
    def others(self) -> list[Linear]:
        """The linear problem of all rows but those of each fold."""
        total = sum(self.grams, start=self.shared)
        return [self._about(total - gram) for gram in self.grams]

    @cached_property
    def selection(self) -> SelectionProblem:
        """The selection problem on all rows."""
        linear = eliminate_first(self.whole, self.always)
        return SelectionProblem(linear, self.candidates, self.noise, self.shortlists[-1])

    @cached_property
    def selections(self) -> list[SelectionProblem]:
        """The selection problem without each fold."""
        return [
            SelectionProblem(
                eliminate_first(linear, self.always), self.candidates, self.noise, allowed
            )
            for linear, allowed in zip(self.others, self.shortlists, strict=False)
        ]

    @cached_property
    def own_nuisances(self) -> list[Columns]:
        """Nuisances that only rows of each fold determine, such as a socket of its own."""
        seen = np.array([np.diag(g.matrix)[: self.always] for g in self.grams])
        rest = seen.sum(axis=0) - seen
        return [
            np.flatnonzero((rest[f] <= 1e-9 * seen[f].max(initial=0.0)) & (seen[f] > 0))
            for f in range(len(self.grams))
        ]


def settled(
    pool: Pool, chosen: Sequence[SelectedTerm], x: Array
) -> tuple[Pool, list[SelectedTerm]]:
    """The pool of the chosen effects alone, linearised about their final fit.

    Args:
        pool: The pool that they were chosen from.
        chosen: The terms.
        x: Their fit, nuisances first, then the terms in their order (P,).
    """
    fixed = [t.effect for t in pool.model.terms if t.columns.stop <= pool.always]
    effects = [pool.candidates[c.index].effect for c in chosen]
    weights = pool.model.problem.weights
    model = build_model(
        pool.model.recording, [*fixed, *effects], nuisance=pool.model.nuisance, weights=weights
    )
    shares = [pool.candidates[c.index].log_prior for c in chosen]
    candidates = tuple(
        Candidate(t.effect, np.arange(t.columns.start, t.columns.stop), share)
        for t, share in zip(model.terms[len(fixed) :], shares, strict=True)
    )
    own = Mapped(model.problem).shared_gram(x)
    allowed = np.ones((len(pool.shortlists), len(candidates)), dtype=bool)
    narrow = replace(pool, model=model, x=x, candidates=candidates, shared=own, shortlists=allowed)
    return narrow, [SelectedTerm(k, c.scale) for k, c in enumerate(chosen)]


def eliminate_first(linear: Linear, count: int) -> Linear:
    """The problem without its first columns, the nuisances, whose prior is flat."""
    if not count:
        return linear
    return linear.without(np.arange(count), flat_prior(linear, count))


def make_pool(
    fitted: MeasurementModel,
    x: Array,
    folds: NDArray[np.intp],
    noise: NoisePrior,
    *,
    fixed: Sequence[Effect] = (),
    library: Sequence[type[Effect]] = EFFECTS,
) -> Pool:
    """All candidates about a fit.

    Args:
        fitted: Nuisances, ``fixed`` effects and the effects chosen so far.
        x: Its fit (P,).
        folds: Fold of every row (N,).
        noise: The prior of the noise.
        fixed: Effects that are fitted in every model, the first terms of ``fitted``.
        library: The effects to consider.
    """
    variants = candidates_of(fitted.recording, library)
    plain = [v for v in variants if v.scanned is None]
    chosen = [t.effect for t in fitted.terms[len(fixed) :]]
    dense = [v for v in variants if v.scanned is not None]
    near = nearby(chosen, fitted.recording)
    finer = [v for e in near if not e.scanned for v in near[e]]
    finer += _deviations(fitted, x, chosen)
    listed = shortlists(fitted, x, folds, noise, dense, chosen, near)
    effects = list(dict.fromkeys([*fixed, *chosen, *plain, *finer, *listed]))
    model = build_model(
        fitted.recording, effects, nuisance=fitted.nuisance, weights=fitted.problem.weights
    )
    at = model.start.copy()
    at[: len(x)] = x
    always = model.fixed + sum(len(e.parameters) for e in fixed)
    candidates = _candidates(model, len(fixed), variants)
    own = Mapped(model.problem).shared_gram(at)
    everywhere = np.ones(int(folds.max()) + 2, dtype=bool)
    allowed = np.array([listed.get(c.effect, everywhere) for c in candidates], dtype=bool)
    allowed = allowed.reshape(len(candidates), len(everywhere)).T
    return Pool(model, at, candidates, own, noise, allowed, always, folds)


def _deviations(fitted: MeasurementModel, x: Array, chosen: Sequence[Effect]) -> Iterator[Effect]:
    """Forms that follow from the fits of the chosen effects, unless one is chosen already."""
    held = {(e.name, e.element) for e in chosen if e.plain}
    for term in fitted.terms:
        effect, scope = term.effect, scope_for(term.effect, fitted.recording)
        if effect in chosen and (effect.name, effect.element) not in held:
            values = [float(f"{value:.2g}") for value in x[term.columns]]
            yield from effect.deviations(scope, values)


def size_odds(effect: Effect) -> float:
    """Log odds of sizes that were found, against widths that follow from them; 0 if none do.

    A form that is made about a fit must not be paid for it: what its plain form's widths say of
    such a size is a part of its share.
    """
    if effect.plain is None:
        return 0.0
    declared = [p.scale for p in effect.plain.parameters]
    own = [p.scale for p in effect.parameters[: len(declared)]]
    ratio = np.array(own) / np.array(declared)
    widths = SCALES[:, None]
    density = -np.log(widths / ratio) - 0.5 * (ratio / widths) ** 2 + 0.5
    return float(np.logaddexp.reduce(LOG_SCALE_WEIGHTS + density.sum(axis=1)))


def _candidates(
    model: MeasurementModel, fixed: int, variants: Sequence[Effect]
) -> tuple[Candidate, ...]:
    """Columns and prior shares: alike for every kind, then every element, then every variant.

    A finer variant than those listed was found by the data: its share is that of its own part of
    the listed one's range, which it parts with its neighbours, as a sum over that range has it.
    Forms that follow from a fit part what their plain form has, and are no more together.
    A cause that may be at work in one of several recordings alone has :data:`IN_ONE` of the prior
    of what all share, spread among them; that of the shared is no less for it.
    """
    session, listed = model.recording.session, frozenset(variants)
    suspects = set() if session is None else {(e.name, parts_of(e)) for e in session.suspects}
    variants = [v for v in variants if (v.name, parts_of(v)) not in suspects]
    kinds = Counter(name for name, _ in {(v.name, v.element) for v in variants})
    per_element = Counter((v.name, v.element) for v in variants)
    forms = Counter(term.effect.plain for term in model.terms[fixed:])
    found = []
    for term in model.terms[fixed:]:
        key = (term.effect.name, term.effect.element)
        plain = term.effect.plain or term.effect
        cause = float(len(kinds) * max(kinds[key[0]], 1))
        share = cause * max(per_element[key], 1)
        if session is not None and (key[0], parts_of(term.effect)) in suspects:
            share *= len(session) / IN_ONE
        if plain not in listed:
            near = plain.neighbours(scope_for(plain, model.recording))
            share *= 1 + max(len(near), 1)
        share *= 1 + forms[plain]
        columns = np.arange(term.columns.start, term.columns.stop)
        log = size_odds(term.effect) - float(np.log(share))
        found.append(Candidate(term.effect, columns, log, -float(np.log(cause))))
    return tuple(found)
