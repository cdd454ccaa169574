"""Laws of what is held out: folds, predictions of rows not seen, and the interval of the shrink."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from plumbline.experiments.reality.joint_effects import JointOffset as RealOffset
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.tool_slip import ToolByGroup
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.diagnose import Explained, _in_between, diagnose, task_of
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import Pool, make_pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import fit
from plumbline.optim.diagnosis.predict import shrink
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.predict.held_out import square_with, squares_without
from plumbline.optim.diagnosis.predict.shrink import (
    blocks_of_rows,
    fold_models,
    held_out_residuals,
    nominal_residuals,
    shrink_interval,
)
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model
from tests.benches import bench
from tests.designs import selection
from tests.simulated_cases import faultless, recorded, with_fault

SMALL = (JointOffset, JointScale)
SOLVER = LevenbergMarquardt(max_iterations=100, tolerance=1e-13)


# Folds


def test_groups_are_never_split():
    groups = np.random.default_rng(0).permutation(np.repeat(np.arange(7), [3, 9, 9, 9, 10, 10, 10]))
    recording = bench("ur5", "tip_position", group=groups)
    assert kind_of_folds(recording, "auto") == "groups"
    folds = fold_of_rows(recording)
    for group in range(7):
        assert len(set(folds[groups == group])) == 1
    assert len(set(folds)) == 5


@pytest.mark.parametrize("kind", ["auto", "time", "workspace", "rows"])
def test_every_fold_has_rows_and_they_are_counted_from_nought(kind):
    recording = bench("ur5", "tip_position", group=None)
    folds = fold_of_rows(recording, kind)
    assert folds.shape == (len(recording),)
    assert set(folds) == set(range(5))
    assert np.ptp(np.bincount(folds)) == 0


@pytest.mark.parametrize("rows", [24, 37, 58])
def test_blocks_of_the_workspace_are_equal_and_apart(rows):
    recording = bench("ur5", "tip_position", group=None).select(np.arange(rows))
    folds = fold_of_rows(recording, "workspace")
    assert np.ptp(np.bincount(folds)) <= 1
    places = recording.chain.placement(recording.q)[:, :3, 3]
    inner = sum(places[folds == f].var(axis=0).sum() for f in range(5)) / 5
    random = fold_of_rows(recording, "rows")
    mixed = sum(places[random == f].var(axis=0).sum() for f in range(5)) / 5
    assert inner < 0.7 * mixed


def test_stretches_of_time_are_unbroken():
    folds = fold_of_rows(bench("ur5", "tip_position", group=None), "time")
    assert (np.diff(folds) >= 0).all()


def test_single_rows_are_drawn_by_the_seed():
    recording = bench("ur5", "tip_position", group=None)
    first = fold_of_rows(recording, "rows", 1)
    np.testing.assert_array_equal(first, fold_of_rows(recording, "rows", 1))
    assert (first != fold_of_rows(recording, "rows", 2)).any()


def test_what_cannot_be_held_out_is_refused():
    recording = bench("ur5", "tip_position", group=None)
    with pytest.raises(ValueError, match="'days' not recognised; choose from auto, groups"):
        fold_of_rows(recording, "days")
    with pytest.raises(ValueError, match="no column 'group'"):
        fold_of_rows(recording, "groups")


# Held-out residuals


@pytest.fixture(scope="module")
def offset_recording(tmp_path_factory):
    """An offset of joint 3, four sigma beyond what frame and tool can swallow."""
    case = with_fault(faultless(rows=40), RealOffset(0.0, 3))
    return replace(recorded(case, tmp_path_factory.mktemp("offset"))[0], group=None)


def pool_of(recording, x=None, nuisance=None):
    """A pool about the fit with an offset of joint 3, its folds, the choice of it, and the fit."""
    nuisance = nuisance or nuisances_of(recording)
    weights = np.ones(len(recording))
    model, best = fit(recording, [JointOffset(joint=3)], nuisance, weights, SOLVER, ridge=[0.0])
    folds = fold_of_rows(recording)
    x = best.x if x is None else x
    pool = make_pool(model, x, folds, NoisePrior.of(recording.noise_std), library=SMALL)
    index = next(i for i, c in enumerate(pool.candidates) if c.effect == JointOffset(joint=3))
    return pool, folds, [SelectedTerm(index, 1.0)], best


def test_held_out_residuals_are_those_of_refitting_without_the_fold(offset_recording):
    """Linear about the fit on all rows: what that neglects is of second order."""
    recording = offset_recording
    pool, folds, choice, best = pool_of(recording)
    variance = recording.noise_std**2
    models = fold_models(pool, choice, variance=variance)
    found, ended = held_out_residuals(pool, folds, models, best)
    assert len(ended) == 5
    assert all(one.converged for one in ended)
    effects, nuisance = [JointOffset(joint=3)], pool.model.nuisance
    for f in range(5):
        rest = recording.select(folds != f)
        ridge = [recording.noise_std]
        _, own = fit(rest, effects, nuisance, np.ones(len(rest)), SOLVER, ridge=ridge)
        held = build_model(recording.select(folds == f), effects, nuisance=nuisance)
        left = Mapped(held.problem).residuals(own.x)
        np.testing.assert_allclose(found[folds == f], left, atol=1e-3 * recording.noise_std)


def test_squares_without_each_of_some_terms_are_those_of_fitting_the_others(offset_recording):
    pool, *_ = pool_of(offset_recording)
    terms = [SelectedTerm(k, 1.0) for k in range(len(pool.candidates))][::3]
    groups, variance = [terms[:1], terms[1:3], terms], offset_recording.noise_std**2
    found = squares_without(pool, terms, groups, variance)
    for square, group in zip(found, groups, strict=True):
        rest = [t for t in terms if t not in group]
        assert square == pytest.approx(square_with(pool, rest, variance), rel=1e-6)
    assert max(found) > 2.0 * min(found)


def first_fold(recording):
    """The pool, the folds, the fit of all rows, and what is chosen without the first fold."""
    pool, folds, choice, best = pool_of(recording)
    model = fold_models(pool, choice, variance=1e-8)[0]
    return pool, folds, best, model, shrink._union(pool, [model], best)


@pytest.mark.parametrize("share", [1.0, 0.01, 100.0])
def test_a_fold_s_fit_ends_in_one_place_whatever_curvature_it_begins_with(offset_recording, share):
    pool, folds, best, model, union = first_fold(offset_recording)
    start = union.started(best.by_name)
    grams = Mapped(union.problem).grams(start, folds)
    given = [replace(g, matrix=share * g.matrix) for g in grams]
    x = start + 10.0 * union.problem.scale
    found, ended = shrink._settled(pool, union, folds == 0, model, start, x, given)
    usual, _ = shrink._settled(pool, union, folds == 0, model, start, start, grams)
    assert ended.converged
    np.testing.assert_allclose(found, usual, atol=1e-4 * union.problem.scale.max())


def test_a_fold_s_fit_stays_within_the_bounds_and_is_judged_there(offset_recording):
    pool, folds, best, model, union = first_fold(offset_recording)
    start = union.started(best.by_name)
    grams = Mapped(union.problem).grams(start, folds)
    offset, half = best.x[-1], best.x.copy()
    half[-1] = 0.5 * offset
    bound = np.sort([np.full(len(half), -np.inf), np.where(np.arange(len(half)) < 9, np.inf, 0)], 0)
    bound[:, -1] = np.sort([0.0, 0.5 * offset])
    problem = replace(union.problem, lower=bound[0], upper=bound[1])
    held = replace(union, problem=problem)
    found, ended = shrink._settled(pool, held, folds == 0, model, half, start, grams)
    assert found[-1] == 0.5 * offset
    assert ended.converged


def test_the_one_unknown_of_a_fold_that_has_no_cause_of_its_own_is_held_and_not_pulled(tmp_path):
    """As where second encoders miss by one value of one joint alone."""
    case = with_fault(faultless(rows=40, observation="joint_position"), RealOffset(0.0, 3))
    recording = replace(recorded(case, tmp_path)[0], group=None)
    pool, folds, best, model, union = first_fold(recording)
    x, none = union.started(best.by_name), np.empty(0, dtype=np.intp)
    assert len(x) == 1
    found = shrink._without_fold(pool, union, model, none, folds != 0, x)
    assert found.shared.shape == union.problem.shared.shape
    assert found.lower == found.upper == x


def test_a_fold_s_first_step_that_leaves_more_than_its_start_is_halved(offset_recording):
    pool, folds, best, model, union = first_fold(offset_recording)
    start = union.started(best.by_name)
    grams = Mapped(union.problem).grams(start, folds)
    far = start.copy()
    far[: pool.always] += 300.0 * union.problem.scale[: pool.always]
    found, ended = shrink._settled(pool, union, folds == 0, model, start, far, grams)
    assert ended.converged
    np.testing.assert_allclose(found, start, atol=3.0 * union.problem.scale.max())


@pytest.mark.parametrize(("count", "limit"), [(90.0, 0.1), (1e4, 1.0), (1e6, 10.0)])
def test_a_fold_s_fit_is_at_rest_where_its_square_changes_by_a_ten_thousandth(
    offset_recording, count, limit
):
    """So many standard errors change it by their square, of as many as there are readings."""
    _, _, best, _, union = first_fold(offset_recording)
    x = union.started(best.by_name)
    gram = replace(Mapped(union.problem).grams(x)[0], count=count)
    ended = shrink._judged(Solution(union.problem, x).judged_by(gram))
    assert ended.limit == pytest.approx(limit)
    assert ended.converged == (ended.stationarity <= limit)


def test_nominal_residuals_are_those_of_refitting_without_the_fold(offset_recording):
    recording = offset_recording
    folds, nuisance = fold_of_rows(recording), nuisances_of(recording)
    model, nominal = fit(recording, (), nuisance, np.ones(len(recording)), SOLVER)
    pool = make_pool(model, nominal.x, folds, NoisePrior(), library=SMALL)
    found = nominal_residuals(pool, nominal, folds)
    for f in range(5):
        rest = recording.select(folds != f)
        best = fit(rest, (), nuisance, np.ones(len(rest)), SOLVER)[1]
        held = build_model(recording.select(folds == f), nuisance=nuisance)
        left = Mapped(held.problem).residuals(best.x)
        np.testing.assert_allclose(found[folds == f], left, atol=1e-2 * recording.noise_std)


def test_a_row_that_is_held_out_does_not_influence_its_prediction(offset_recording):
    recording = offset_recording
    pool, folds, choice, best = pool_of(recording)
    spoilt = recording.measured.copy()
    spoilt[11] += [0.01, -0.02, 0.005]
    other, *_ = pool_of(replace(recording, measured=spoilt), pool.x[:10], pool.model.nuisance)

    def predictions(pool, measured):
        models = fold_models(pool, choice, variance=1e-8)
        return held_out_residuals(pool, folds, models, best)[0] + measured

    before, after = predictions(pool, recording.measured), predictions(other, spoilt)
    same = folds == folds[11]
    np.testing.assert_allclose(after[same], before[same], atol=1e-11)
    assert (np.abs(after - before)[~same].max(axis=1) > 1e-6).all()  # the others do move


def test_rows_kept_back_do_not_touch_the_fit(offset_recording):
    kept = np.arange(40) % 4 == 1
    spoilt = offset_recording.measured.copy()
    spoilt[kept] += 3e-3 * np.random.default_rng(2).normal(size=(10, 3))
    first, second = (
        diagnose(
            replace(offset_recording, held_out=kept, measured=m), DiagnosisOptions(library=SMALL)
        )
        for m in (offset_recording.measured, spoilt)
    )
    np.testing.assert_array_equal(first.solution.x, second.solution.x)
    assert [c.effect for c in first.verdict.causes] == [c.effect for c in second.verdict.causes]
    assert first.verdict.gap.held_out_by == "the column held_out"
    # And every figure of the gap is of those rows.
    for diagnosis in (first, second):
        gap = diagnosis.verdict.gap
        norms = np.linalg.norm(diagnosis.residual_after[kept], axis=1)
        assert gap.after == pytest.approx(np.sqrt(np.mean(norms**2)))
    assert second.verdict.gap.after > 5 * first.verdict.gap.after


@pytest.mark.parametrize(
    ("off", "verdict"), [(0.0, "no-gap"), (4.0, "no-gap"), (8.0, "outside-library")]
)
def test_rows_kept_back_that_are_missed_by_more_than_chance_are_a_gap(
    offset_recording, off, verdict
):
    """Four readings tell next to nothing of a joint's zero; the others show that it is off.

    Chance alone may miss them by three times their noise.
    """
    kept = np.ones(40, dtype=bool)
    kept[[3, 14, 25, 36]] = False
    place = offset_recording.chain.placement(offset_recording.q)[:, :3, 3]
    noise = 1e-4 * np.random.default_rng(0).normal(size=place.shape)
    away = off * 1e-4 * np.sin(3.0 * offset_recording.q[:, [1]]) * kept[:, None]
    told = replace(offset_recording, held_out=kept, measured=place + noise + away, noise_std=1e-4)
    found = diagnose(told, DiagnosisOptions(library=SMALL)).verdict
    assert found.verdict == verdict
    assert not found.causes


# The interval


def test_an_interval_follows_from_its_seed():
    rng = np.random.default_rng(3)
    before, after = rng.normal(size=(50, 3)), 0.4 * rng.normal(size=(50, 3))
    one, again, other = (shrink_interval(before, after, np.arange(50), seed) for seed in (1, 1, 2))
    assert one == again != other
    assert one[0] < 1 - np.linalg.norm(after) / np.linalg.norm(before) < one[1]


def test_an_interval_covers_the_true_shrink():
    """Nineteen times in twenty; of 200 draws, 182 or fewer is beyond two and a half deviations."""
    hits = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, 4])
        after = rng.normal(size=(60, 3))
        before = after + np.sqrt(3.0) * rng.normal(size=(60, 3))  # twice as large
        low, high = shrink_interval(before, after, np.arange(60), seed)
        hits += low < 0.5 < high
    assert 182 < hits < 200


def test_rows_that_resemble_each_other_widen_the_interval():
    rng = np.random.default_rng(5)
    alike = np.repeat(rng.normal(size=(12, 3)), 10, axis=0)
    size = np.repeat(rng.uniform(0.2, 0.8, 12), 10)[:, None]
    folds = np.arange(120) // 24
    blocks = blocks_of_rows(folds, separate=False)
    for block in np.unique(blocks):
        rows = np.flatnonzero(blocks == block)
        assert len(set(folds[rows])) == 1
        assert np.ptp(rows) == len(rows) - 1
    single = shrink_interval(alike, size * alike, blocks_of_rows(folds, separate=True), 0)
    together = shrink_interval(alike, size * alike, blocks, 0)
    assert np.ptp(together) > 1.5 * np.ptp(single)


# Rows in between


@dataclass(frozen=True)
class Selected:
    """What a search has found, as far as folds hang on it."""

    effects: tuple[Effect, ...]
    pool: Pool


@pytest.fixture(scope="module")
def grouped(tmp_path_factory):
    """A task of three groups, and the pool of a few effects."""
    recording, _ = recorded(faultless(rows=24), tmp_path_factory.mktemp("grouped"))
    recording = replace(recording, group=np.arange(24) // 8)
    task = task_of(recording, DiagnosisOptions(library=SMALL))
    model = build_model(recording, [], nuisance=nuisances_of(recording))
    return task, make_pool(model, model.start, task.folds, NoisePrior(), library=SMALL)


def _explained_by(effect, task, pool, options):
    """A diagnosis that has named one effect, as far as folds hang on it."""
    right = np.zeros(len(task.recording), dtype=bool)
    return Explained(options, task, Selected((effect,), pool), right, None)


@pytest.mark.parametrize(
    ("effect", "by"),
    [(BaseBump(moment=9.0), "rows"), (ToolByGroup(groups=(1, 2)), "rows"),
     (JointScale(joint=2), "groups")],
)  # fmt: skip
def test_of_what_belongs_to_one_stretch_rows_in_between_are_left_out(grouped, effect, by):
    """No other group foretells how far a base was bumped in this one."""
    task, pool = grouped
    found = _in_between(_explained_by(effect, task, pool, DiagnosisOptions()))
    assert found.by == by
    whole = [sum(len(np.unique(f.folds[task.recording.group == g])) for g in range(3))
             for f in (task, found.task)]  # fmt: skip
    assert (whole[1] > whole[0]) == (by == "rows")
    np.testing.assert_allclose(found.selected.pool.whole.G, pool.whole.G, atol=1e-12)
    assert len(found.selected.pool.folds) == found.task.folds.max() + 1


def test_what_is_left_out_stays_as_it_was_asked_for(grouped):
    task, pool = grouped
    asked = DiagnosisOptions(held_out="groups")
    assert _in_between(_explained_by(BaseBump(moment=9.0), task, pool, asked)).by == "groups"


@pytest.mark.parametrize(
    ("most", "kept", "expected"),
    [(40, [0], {0, 1}), (0, [0], {0}), (0, [0, 2], {0, 1}), (0, [0, 1, 3], {0, 1})],
)
def test_a_fold_asks_the_slots_of_many_terms_again(most, kept, expected, monkeypatch):
    """Of few terms it goes from nothing; of many none is added, but what it does not show goes."""
    monkeypatch.setattr(shrink.prior, "MANY_SLOTS", most)
    X = np.random.default_rng(0).normal(size=(60, 4))
    t = X[:, :2] @ [3.0, 2.0] + 0.01 * np.random.default_rng(1).normal(size=60)
    problem = selection(X, t, 0.01, allowed=[True, True, True, False])
    found = shrink._chosen_anew(problem, [SelectedTerm(k, 1.0) for k in kept])
    assert {c.index for c in found} == expected


@pytest.mark.parametrize(("turned", "expected"), [(0, {1}), (1, {1}), (4, {0})])
def test_a_fold_departs_from_the_selection_of_all_rows_only_if_its_rows_say_so(turned, expected):
    """Two columns are alike in all rows but those that tell them apart: none, one, or four."""
    rng = np.random.default_rng(2)
    X = np.repeat(rng.normal(size=(40, 1)), 2, axis=1)
    t = 3.0 * X[:, 0] + 0.01 * rng.normal(size=40)
    X[:turned, 1] += 0.006
    found = shrink._chosen_anew(selection(X, t, 0.01), [SelectedTerm(1, 3.0)])
    assert {c.index for c in found} == expected
