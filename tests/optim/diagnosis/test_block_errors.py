"""Laws of blocks of rows: how far estimates differ between them, and what rows are worth there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.posterior.agreement import agreement
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.predict.folds import blocks_of, blocks_of_each
from plumbline.optim.diagnosis.predict.shrink import FoldModel
from plumbline.optim.diagnosis.prior import MOST_FOLDS
from plumbline.optim.diagnosis.verdict.explanation import spread
from plumbline.optim.diagnosis.verdict.lack_of_fit import _values, block_errors
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.session import build_session, joined
from tests.benches import bench
from tests.designs import selection
from tests.several import recorded

SEEDS = range(8)
BLOCKS = np.repeat(np.arange(6), 20)


def shared(seed, wrong=0.0, count=5):
    """How far blocks agree about columns, with a misfit that grows within each block by its own."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(count, len(BLOCKS), 3))
    slopes = wrong * rng.normal(size=(6, count))
    left = rng.normal(size=(len(BLOCKS), 3))
    left += np.einsum("nk,knm->nm", slopes[BLOCKS], columns)
    flat = columns.reshape(count, -1)
    left -= (flat.T @ np.linalg.lstsq(flat.T, left.ravel(), rcond=None)[0]).reshape(left.shape)
    return agreement(columns, left, BLOCKS)


def test_blocks_of_independent_rows_agree():
    found = [shared(seed) for seed in range(60)]
    assert np.mean(found) > 0.935  # at face value 0.928, and 0.113 apart: all of that is chance
    assert np.std(found) < 0.08
    assert max(found) <= 1.0


def test_the_more_blocks_differ_the_less_their_rows_are_worth():
    found = [np.mean([shared(seed, wrong) for seed in SEEDS]) for wrong in (0.0, 0.2, 0.5, 1.0)]
    assert (np.diff(found) < 0.0).all()
    assert found[-1] < 0.2


@pytest.mark.parametrize("times", [4, 9])
def test_rows_that_say_the_same_several_times_are_worth_their_number(times):
    def worth(seed):
        rng = np.random.default_rng(seed)
        columns, left = rng.normal(size=(3, 60, 3)), rng.normal(size=(60, 3))
        again = np.repeat(columns, times, axis=1), np.repeat(left, times, axis=0)
        return agreement(*again, np.arange(60 * times) // times)

    assert np.mean([worth(seed) for seed in SEEDS]) == pytest.approx(1.0 / times, rel=0.2)


@pytest.mark.parametrize("rows", [2, 6, 12])
def test_a_block_is_worth_at_least_one_of_its_readings_however_many_columns(rows):
    """With as many columns as readings nothing is left, and rounding has no say."""
    rng = np.random.default_rng(0)
    columns, left = rng.normal(size=(40, rows, 3)), 1e-14 * rng.normal(size=(rows, 3))
    found = agreement(columns, left, np.arange(rows) // 2)
    assert 1.0 / 6.0 <= found <= 1.0


@pytest.mark.parametrize("held", [1.0, 30.0, 300.0])
def test_what_a_prior_holds_back_is_no_disagreement(held):
    """What a gross row's own column leaves at its prior's width differs between no blocks."""
    rng = np.random.default_rng(3)
    columns, left = np.zeros((4, 120, 3)), rng.normal(size=(120, 3))
    columns[:3] = rng.normal(size=(3, 120, 3))
    columns[3, 17, 0] = 1.0
    flat = columns.reshape(4, -1)
    left -= (flat.T @ np.linalg.lstsq(flat.T, left.ravel())[0]).reshape(left.shape)
    alone = agreement(columns[:3], left, BLOCKS)
    left[17, 0] = held
    assert agreement(columns, left, BLOCKS) == pytest.approx(alone, abs=0.02)


def test_where_no_direction_is_seen_by_two_blocks_none_disagrees():
    columns = np.zeros((2, 8, 3))
    columns[0, :4, 0] = columns[1, 4:, 0] = 1.0
    left = np.random.default_rng(0).normal(size=(8, 3))
    assert agreement(columns, left, np.arange(8) // 4) == 1.0


def fitted(rows=None):
    recording = replace(bench("ur5", "tip_position"), group=None)
    rng = np.random.default_rng(0)
    recording = replace(recording, measured=recording.measured + 1e-4 * rng.normal(size=(60, 3)))
    nuisance = nuisances_of(recording)
    recording = recording if rows is None else recording.select(rows)
    model = build_model(recording, [REGISTRY["joint_offset"](joint=2)], nuisance=nuisance)
    return SimpleNamespace(model=model, best=LevenbergMarquardt().solve(model.problem, model.start))


def test_errors_from_blocks_are_those_of_fits_without_each():
    selected = fitted()
    blocks = blocks_of(selected.model.recording)
    found = np.array([fitted(blocks != b).best.x for b in range(MOST_FOLDS)])
    expected = np.sqrt((MOST_FOLDS - 1) * np.var(found, axis=0))
    np.testing.assert_allclose(block_errors(selected), expected, rtol=0.02)


def test_rows_with_a_clock_are_cut_in_stretches_others_in_blocks_of_the_workspace():
    recording = replace(bench("ur5", "tip_position"), group=None)
    assert blocks_of(recording).tolist() == np.repeat(np.arange(5), 12).tolist()
    still = replace(recording, time=None)
    places = still.chain.placement(still.q)[:, :3, 3]
    labels = blocks_of(still)
    assert sorted(np.bincount(labels)) == [12] * 5
    spread = [np.ptp(places[labels == b], axis=0).prod() for b in range(5)]
    assert np.mean(spread) < 0.5 * np.ptp(places, axis=0).prod()


def test_errors_tell_how_far_an_estimate_moves_with_what_is_chosen_beside_it():
    selected = fitted()
    effect, other = selected.model.terms[-1].effect, REGISTRY["joint_offset"](joint=3)
    column, scale = selected.model.terms[-1].columns.start, effect.parameters[0].scale
    models = [FoldModel((other, effect), np.array([9.0, v]), np.zeros(0)) for v in (1.0, 2.0, 3.0)]
    models.append(FoldModel((other,), np.array([9.0]), np.zeros(0)))
    errors = block_errors(selected, models)
    assert errors[column] == pytest.approx(scale * np.sqrt(3 * 2 / 3))
    assert np.delete(errors, column) == pytest.approx(np.delete(block_errors(selected), column))
    assert block_errors(selected, models[2:])[column] == block_errors(selected)[column]


def test_no_block_is_of_two_recordings():
    parts = [recorded("tip_position", k, rows=40, name=f"{k}") for k in range(3)]
    blocks = blocks_of_each(joined(build_session(parts)))
    assert [len(np.unique(own)) for own in np.split(blocks, 3)] == [blocks[:40].max() + 1] * 3
    assert len(np.unique(blocks)) == 3 * (blocks[:40].max() + 1)


def test_a_fold_that_chose_nothing_has_no_values():
    assert _values(FoldModel((), np.empty(0), np.zeros(9), (), 0)) == {}


def test_a_value_spreads_as_far_as_it_moves_between_the_states_that_hold_its_term():
    """Beside a second term it is 1, alone it takes up that one's part, too."""
    X = np.column_stack([np.eye(60)[0], 0.6 * np.eye(60)[0] + 0.8 * np.eye(60)[1]])
    asked = selection(1e3 * X, 1e3 * X @ [1.0, 2.0], 1.0)
    one, other = SelectedTerm(0, 30.0), SelectedTerm(1, 30.0)
    rare, often = np.log([0.2, 0.8])
    moved = spread(asked, [(rare, [one]), (often, [one, other]), (2.0, [other])])
    assert moved[0] == pytest.approx([0.4 * 1.2], rel=1e-3)
    assert spread(asked, [(0.0, [one]), (-20.0, [one, other])])[0] == pytest.approx([0.0], abs=1e-3)
