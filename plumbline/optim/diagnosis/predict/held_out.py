"""Figures on rows that the fit has not seen: by folds, or on rows that the recording keeps back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammainccinv

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.judged import Judged, Judgement, Solution, judged, the_worst
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.diagnosis.linearise.linear import Linear, flat_prior, solved
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.robust import far_off
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict import shrink
from plumbline.optim.diagnosis.prior import ALARM
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.refit import (
    as_measured,
    figure,
    gap_unit,
    refitted,
    rows_of_gap,
    smear,
)
from plumbline.optim.measurement.torque import own_units
from plumbline.optim.recording.recording import Recording

BY_COLUMN = "the column held_out"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Held-out residuals and what follows from them."""

    before: Array  # of the nuisances alone (N, m)
    after: Array  # of the model with the causes (N, m)
    rows: Flags  # rows that the figures are about, gross errors left out (N,)
    trusted: Flags  # rows that are no gross errors (N,)
    by: str  # what was left out together
    interval: tuple[float, float]  # 95 % interval of the shrink
    told: tuple[float, float]  # the same of what was measured, each joint's efforts in its own unit
    unit: str  # ``"m"`` or ``"rad"``
    per_row: bool  # whether the RMS is of rows' norms, or of single readings
    # how the fits behind the residuals ended; of those without each fold the worst
    fits: tuple[Judged, ...] = ()
    models: tuple[shrink.FoldModel, ...] = ()  # what was chosen and fitted without each fold
    smear: float = 1.0  # RMS of noise as measured, over that of one that is alike in all rows

    @property
    def per_point(self) -> float:
        """RMS of pure noise of one: a point in space has three axes, an encoder one."""
        return self.smear * (float(np.sqrt(3.0)) if self.per_row else 1.0)

    @property
    def rms_before(self) -> float:
        """RMS of the nuisances alone [unit]."""
        return figure(self.before[self.rows], self.per_row)

    @property
    def rms_after(self) -> float:
        """RMS with the causes [unit]."""
        return figure(self.after[self.rows], self.per_row)

    @property
    def misleads(self) -> bool:
        """Whether causes, chosen anew without each fold, foretell it worse than none at all do.

        Rows that a recording keeps back decide nothing: they only test.
        """
        return self.by != BY_COLUMN and self.rms_after > self.rms_before


def evaluate(
    recording: Recording,
    selected: SelectedModel,
    folds: Indices,
    trusted: Flags,
    by: str,
    seed: int,
) -> Evaluation:
    """Held-out residuals of every row, before and after.

    Args:
        recording: N rows.
        selected: The selected model on the rows that may be fitted, all unless some are kept back.
        folds: Folds of the training rows.
        trusted: Training rows that are no gross errors.
        by: What was left out together.
        seed: Of the bootstrap.
    """
    pool = selected.pool
    before = shrink.nominal_residuals(pool, selected.nominal, folds)
    after, fits, models = before, list[Judged](), list[shrink.FoldModel]()
    if selected.chosen:
        models = shrink.fold_models(pool, without=selected.barred, kept=selected.chosen)
        after, each = shrink.held_out_residuals(pool, folds, models, selected.best)
        fits = list(filter(None, [the_worst(each)]))
    separate = by in ("rows", "touches")
    blocks = shrink.blocks_of_rows(folds, separate=separate)
    rows, all_trusted = trusted & rows_of_gap(selected.pool.model.recording), trusted
    if recording.held_out is not None:
        kept = recording.held_out
        held = recording.select(kept)
        parts = []
        for train, solution in ((before, selected.nominal), (after, selected.best)):
            test, ended = predicted(held, solution, selected)
            parts.append((train, test))
            fits += filter(None, [ended])
        gross = far_off(parts[1][1])
        before, after = (_merged(kept, train, test) for train, test in parts)
        all_trusted = np.ones(len(recording), dtype=bool)
        all_trusted[~kept], all_trusted[kept] = trusted, ~gross
        rows = kept & all_trusted & rows_of_gap(recording)
        blocks = shrink.blocks_of_rows(np.zeros(len(recording), dtype=np.intp), separate=separate)
        by = BY_COLUMN
    before, after = (as_measured(recording, r) for r in (before, after))
    unit, per_row = gap_unit(recording)
    size = 3 if per_row else before.shape[1]
    own = own_units(recording)[:size]
    interval, told = (
        shrink.shrink_interval(before[rows, :size] * k, after[rows, :size] * k, blocks[rows], seed)
        for k in (np.ones_like(own), own)
    )
    found = Evaluation(before, after, rows, all_trusted, by, interval, told, unit, per_row)
    wide = smear(recording.select(rows), size)
    return replace(found, fits=tuple(fits), models=tuple(models), smear=wide)


def _merged(kept: Flags, train: Array, test: Array) -> Array:
    whole = np.empty((len(kept), train.shape[1]), dtype=train.dtype)
    whole[~kept], whole[kept] = train, test
    return whole


def square_with(
    pool: Pool,
    terms: Sequence[SelectedTerm],
    variance: float,
    rows: Sequence[Linear] | None = None,
) -> float:
    """Held-out square of a model whose effects are given, from the Gram matrices.

    Args:
        pool: The candidates.
        terms: The effects of the model.
        variance: Noise variance that weighs their priors.
        rows: What the square is of, if not of the folds as they are: see :func:`counted_rows`.
    """
    columns = pool.columns(terms)
    parts = pool.folds if rows is None else rows
    kept_back = len(parts) == 1
    models = (
        [shrink.fitted_without(pool, terms, None, variance)]
        if kept_back
        else shrink.fold_models(pool, terms, variance=variance)
    )
    values = [np.concatenate([m.nuisances, m.values]) for m in models]
    squares = [part.square_at(columns, z) for part, z in zip(parts, values, strict=True)]
    return max(sum(squares), 0.0)


def squares_without(
    pool: Pool,
    terms: Sequence[SelectedTerm],
    groups: Sequence[Sequence[SelectedTerm]],
    variance: float,
) -> list[float]:
    r"""Held-out squares of a model without each of some groups of its terms in turn.

    With :math:`V = (G_{-f} + \Lambda)^{-1}` and its values :math:`z = V b_{-f}` the values without
    the columns e are :math:`z - V_{\cdot e} V_{ee}^{-1} z_e`: one inverse a fold does for all.
    """
    if _has_own(pool, terms):  # what a fold alone determines is fitted to it, all else given
        kept = [[t for t in terms if t not in group] for group in groups]
        return [square_with(pool, rest, variance) for rest in kept]
    columns, precision = stack(pool.candidates, terms, variance)
    mine = [stack(pool.candidates, group, variance)[0] for group in groups]
    owners = [np.flatnonzero(np.isin(columns, own)) + pool.always for own in mine]
    total = np.zeros(len(groups))
    together = pool.columns(terms)
    for rest, part in zip(pool.others, pool.folds, strict=True):
        A = rest.G[np.ix_(together, together)]
        A = A + np.diag(np.concatenate([flat_prior(rest, pool.always), precision]))
        unit = 1.0 / np.sqrt(np.diag(A))
        V = solved(A * np.outer(unit, unit), np.diag(unit)) * unit[:, None]
        z = V @ rest.b[together]
        G = part.G[np.ix_(together, together)]
        slope, square = G @ z - part.b[together], part.square_at(together, z)
        for k, own in enumerate(owners):
            step = -V[:, own] @ solved(V[np.ix_(own, own)], z[own])
            total[k] += square + 2.0 * step @ slope + step @ G @ step
    return np.maximum(total, 0.0).tolist()


def _has_own(pool: Pool, terms: Sequence[SelectedTerm]) -> bool:
    """Whether rows of one fold alone determine any nuisance, or any marker's place."""
    markers = any(pool.candidates[t.index].effect.depends_on == shrink.BY_MARKER for t in terms)
    return markers or any(len(own) for own in pool.own_nuisances)


def by_chance(recording: Recording, selected: SelectedModel, evaluation: Evaluation) -> float:
    r"""Ratio of a held-out figure to its noise that chance exceeds once in a hundred.

    Of rows :math:`r = \varepsilon + J_f (\hat x_{-f} - x)` of a model that is right

    .. math:: E \sum r^2 = \sigma^2 \sum_f (n_f + \mathrm{tr} M_f), \qquad
              M_f = J_f^T J_f\, (J_{-f}^T J_{-f} + \Lambda)^{-1}

    with variance :math:`2 \sigma^4 \sum_f (n_f + 2 \mathrm{tr} M_f + \mathrm{tr} M_f^2)`, as a
    gamma distribution of these two moments has it (Satterthwaite 1946, Biometrics Bulletin 2(6)).
    """
    pool, chosen = selected.pool, selected.chosen
    parts = counted_rows(recording, pool, evaluation)
    kept_back = recording.held_out is not None
    columns, precision = stack(pool.candidates, chosen, selected.selection.variance(chosen))
    count = mean = spread = 0.0
    for f, part in enumerate(parts):
        rest = pool.whole if kept_back else pool.others[f]
        own = np.empty(0, np.intp) if kept_back else pool.own_nuisances[f]
        known = np.setdiff1d(np.arange(pool.always), own)
        together = np.concatenate([known, columns])
        prior = np.concatenate([flat_prior(rest, pool.always)[known], precision])
        A = rest.G[np.ix_(together, together)] + np.diag(prior)
        M = solved(A, part.G[np.ix_(together, together)])
        free, trace = part.n - len(own), float(np.trace(M))
        count, mean = count + part.n, mean + free + trace
        spread += 2.0 * (free + 2.0 * trace + float(np.sum(M * M.T)))
    if not count > 0.0 or not mean > 0.0:
        return 1.0
    square = spread / mean * gammainccinv(mean**2 / spread, ALARM)
    return float(np.sqrt(square / count))


def counted_rows(recording: Recording, pool: Pool, evaluation: Evaluation) -> list[Linear]:
    """The rows that the gap is of, as linear problems in the pool's columns.

    Fold by fold, or all rows that the recording keeps back as one; of a pose its position alone.
    """
    problem = pool.model.problem
    if recording.held_out is not None:
        gram = _kept_back(recording, pool, evaluation)
        return [Linear.about(gram, pool.x, problem.scale)]
    counted = rows_of_gap(pool.model.recording)
    shape = recording.noise_shape if recording.several else None
    if not evaluation.per_row or (problem.equations == 3 and counted.all() and shape is None):
        return pool.folds
    if recording.pose_spread is not None:  # of which the place alone is none of the residuals
        effects = [t.effect for t in pool.model.terms]
        rows = replace(pool.model.recording, pose_spread=None)
        read = build_model(rows, effects, nuisance=pool.model.nuisance).problem
        problem = replace(problem, x=read.x, row=read.row, residual=read.residual)
    counts = None if problem.counts is None else np.minimum(problem.counts, 3.0)
    weights = np.where(counted, problem.weights, 0.0)
    if shape is not None:
        weights = weights * np.mean(shape[:, :3] ** 2, axis=1)
    problem = replace(problem, residual=problem.residual[:3], counts=counts, weights=weights)
    grams = Mapped(problem).grams(pool.x, pool.fold_of_row)
    return [Linear.about(gram, pool.x, problem.scale) for gram in grams]


def _kept_back(recording: Recording, pool: Pool, evaluation: Evaluation) -> Gram:
    """Normal equations of the rows kept back; a socket that no other row rests in is refitted."""
    kept, own, placed = _in_known_sockets(recording, evaluation.rows)
    effects = [t.effect for t in pool.model.terms]
    rows = replace(placed.select(kept), pose_spread=None)
    model = build_model(rows, effects, nuisance=pool.model.nuisance)
    size = 3 if evaluation.per_row else model.problem.equations
    parts = [(r[:, :size], J[:, :size]) for _, r, J in Mapped(model.problem).jacobians(pool.x)]
    r, J = (np.concatenate(each) for each in zip(*parts, strict=True))
    for k in range(int(own.max(initial=-1)) + 1):
        mine = own[kept] == k  # where a socket is, its rows' mean tells
        r[mine], J[mine] = r[mine] - r[mine].mean(axis=0), J[mine] - J[mine].mean(axis=0)
    counted = evaluation.rows[kept]
    r, J = r[counted].ravel(), J[counted].reshape(r[counted].size, model.problem.size)
    return Gram(J.T @ J, J.T @ r, float(r @ r), float(len(r)))


def _in_known_sockets(recording: Recording, counted: Flags) -> tuple[Flags, Indices, Recording]:
    """Rows (N,) for a model of the training's sockets, and the rows in a socket of their own (N,).

    These, numbered from 0 where the others are -1, are put into one that is known.
    """
    own = np.full(len(recording), -1)
    if recording.socket is None or recording.held_out is None:
        return counted, own, recording
    training = np.flatnonzero(~recording.held_out)
    known, first = np.unique(recording.socket[training], return_index=True)
    strange = counted & ~np.isin(recording.socket, known)
    own[strange] = np.unique(recording.socket[strange], return_inverse=True)[1]
    kept = counted.copy()
    kept[training[first]] = True  # one of each, uncounted, so that sockets keep their order
    return kept, own, replace(recording, socket=np.where(strange, known[0], recording.socket))


def predicted(
    held: Recording, solution: Solution, selected: SelectedModel
) -> tuple[Array, Judged | None]:
    """Residuals of rows that were kept back; a socket that no other row rests in is refitted."""
    effects = _effects_of(solution, selected)
    if not held.kind.sockets:
        model = build_model(held, effects, nuisance=selected.model.nuisance)
        return Mapped(model.problem).residuals(solution.x), None
    nuisances = dict(zip(selected.model.nuisance.names, solution.x.tolist(), strict=False))
    return refitted(held, effects, solution.x[selected.model.fixed :], nuisances)


def _effects_of(solution: Solution, selected: SelectedModel) -> tuple[Effect, ...]:
    if solution is selected.nominal:
        return selected.fixed
    return tuple(t.effect for t in selected.model.terms)


def judgement_of(selected: SelectedModel, evaluation: Evaluation) -> Judgement:
    """How every fit behind a verdict ended: the two of all rows, and those that left rows out."""
    ends = [judged(selected.nominal, "the fit without causes")]
    if selected.effects:
        ends.append(judged(selected.best, "the fit with the causes"))
    return Judgement.of([*ends, *evaluation.fits])
