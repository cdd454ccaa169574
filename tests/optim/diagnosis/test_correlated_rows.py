"""Laws of rows that know of each other: noise that wanders, readings of one posture, and copies."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.experiments.benches.ar1 import NOISES, clean
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion
from plumbline.optim.diagnosis.diagnose import _worth_the_same, diagnose, usable
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.correlation import (
    RowNoise,
    correlation_of,
    left_by_nothing,
)
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.fewer_terms import most_probable, taken_back
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem
from plumbline.optim.diagnosis.posterior.pool import make_pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.robust import _deletion_statistics
from plumbline.optim.diagnosis.predict.folds import fold_of_rows
from plumbline.optim.diagnosis.prior import CORRELATIONS, SCALES
from plumbline.optim.diagnosis.verdict.explanation import _correlation
from plumbline.optim.diagnosis.verdict.judge import _correlated
from plumbline.optim.measurement.correlated import Whitening, copied, follows_of, postures, trust
from plumbline.optim.measurement.observation import build_model, scope_of
from tests.benches import bench
from tests.designs import statistics, wandering

RHO = 0.7
OFFSET = REGISTRY["joint_offset"](joint=2)


@pytest.fixture(scope="module")
def rows():
    return replace(bench("ur5", "tip_position"), group=None)


def five_each(recording):
    """Each of the first rows five times, under a path of its own."""
    again = np.repeat(np.arange(len(recording) // 5), 5)
    return replace(recording.select(again), whole=None, place=None)


# Normal equations


def test_of_noise_that_wanders_normal_equations_are_those_of_generalised_least_squares(rows):
    model = build_model(replace(rows, wander=RHO), [OFFSET])
    mapped = Mapped(model.problem)
    ((_, r, J),) = list(Mapped(build_model(rows, [OFFSET]).problem).jacobians(model.start))
    apart = np.abs(np.subtract.outer(np.arange(len(rows)), np.arange(len(rows))))
    inverse = np.linalg.inv(RHO**apart)
    gram = mapped.grams(model.start)[0]
    np.testing.assert_allclose(
        gram.matrix, np.einsum("nmp,nk,kmq->pq", J, inverse, J), rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(gram.vector, np.einsum("nmp,nk,km->p", J, inverse, r), atol=1e-9)
    assert mapped.cost(model.start) == pytest.approx(0.5 * gram.square)


@pytest.mark.parametrize("rho", [0.0, RHO])
def test_a_gradient_swept_back_is_that_of_the_normal_equations(rows, rho):
    weights = np.linspace(0.2, 1.0, len(rows))
    model = build_model(replace(rows, wander=rho), [OFFSET], weights=weights)
    mapped, x = Mapped(model.problem), model.start + 1e-3
    found = mapped._back(x, mapped.white_residuals(x))
    np.testing.assert_allclose(found, mapped.grams(x)[0].vector, rtol=1e-9, atol=1e-12)


def test_rows_are_told_apart_across_chunks_as_within_one(rows, monkeypatch):
    problem = build_model(replace(rows, wander=RHO), [OFFSET]).problem
    whole = Mapped(problem).grams(np.zeros(problem.size))[0]
    monkeypatch.setattr("plumbline.optim.core.mapped.CHUNK_NUMBERS", 1)
    parts = Mapped(problem).grams(np.zeros(problem.size))[0]
    np.testing.assert_allclose(parts.matrix, whole.matrix, rtol=1e-9, atol=1e-12)


def test_a_row_whose_predecessor_is_left_out_follows_none(rows):
    problem = build_model(replace(rows, wander=RHO), [OFFSET]).problem
    kept = np.arange(len(rows)) % 3 > 0
    follows = problem.part(kept).follows
    assert follows.tolist() == [0.0, RHO] * (kept.sum() // 2)
    groups = (np.arange(len(rows)) >= 20).astype(np.intp)
    first, own = Mapped(problem).grams(np.zeros(problem.size), groups)
    both = Mapped(problem).gram(np.zeros(problem.size), groups)
    np.testing.assert_allclose(both.matrix, first.matrix + own.matrix, rtol=1e-9, atol=1e-12)
    alone = Mapped(problem.part(groups == 1)).grams(np.zeros(problem.size))[0]
    np.testing.assert_allclose(own.matrix, alone.matrix, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("solver", [LevenbergMarquardt(), TrustRegion()])
def test_solvers_of_rows_agree_that_rows_know_of_each_other(rows, solver):
    noise = 1e-4 * wandering((len(rows), 3), RHO, np.random.default_rng(0))
    recording = replace(rows, wander=RHO, measured=rows.measured + noise)
    model = build_model(recording, [OFFSET])
    solution = solver.solve(model.problem, model.start)
    assert solution.stationarity() < 1e-8


def test_a_design_is_told_apart_as_the_problem_is(rows):
    recording = replace(rows, wander=RHO)
    problem = build_model(recording, [OFFSET]).problem
    x = np.zeros(problem.size)
    ((_, _, J),) = list(Mapped(problem).jacobians(x))
    white = Whitening.of(recording, np.zeros(len(rows), dtype=bool))
    A = white(np.moveaxis(J, 2, 0)).reshape(problem.size, -1)
    np.testing.assert_allclose(A @ A.T, Mapped(problem).grams(x)[0].matrix, rtol=1e-9, atol=1e-12)
    assert white.count(np.ones((len(rows), 3), dtype=bool)) == 3 * len(rows)


def test_correlation_falls_with_the_rows_between_and_ends_with_a_group(rows):
    recording = replace(rows, wander=0.5, group=(np.arange(len(rows)) >= 30).astype(int))
    follows = follows_of(recording.select(np.array([0, 1, 3, 29, 30, 31])))
    np.testing.assert_allclose(follows, [0.0, 0.5, 0.25, 0.5**26, 0.0, 0.5])
    weights = np.where(np.arange(len(rows)) == 4, 0.0, 1.0)
    assert follows_of(recording, weights)[5] == 0.0
    assert follows_of(rows).size == 0


# Readings of one posture


def test_copies_count_as_one_reading(rows):
    once = rows.select(np.arange(len(rows) // 5))
    copies = replace(five_each(rows), alike=1.0)
    assert trust(copies) == pytest.approx(0.2)
    one, five = (Mapped(build_model(r, [OFFSET], weights=trust(r)).problem) for r in (once, copies))
    a, b = (m.grams(np.zeros(m.problem.size))[0] for m in (one, five))
    np.testing.assert_allclose(a.matrix, b.matrix, rtol=1e-9, atol=1e-12)
    assert a.count == pytest.approx(b.count)
    assert a.square == pytest.approx(b.square)


@pytest.mark.parametrize(("apart", "are_copies"), [(0.0, True), (9e-9, True), (2e-8, False)])
def test_copies_are_known_before_anything_is_searched(rows, apart, are_copies):
    """No device reads as little as 10 nm: what is as near was written anew in other digits."""
    copies = five_each(rows)
    measured = copies.measured + apart * (np.arange(copies.measured.size) == 21).reshape(-1, 3)
    again = replace(copies, measured=measured)
    assert copied(again) == are_copies
    assert usable(again, force=True).alike == float(are_copies)
    assert not copied(rows)
    assert usable(rows, force=True).alike == 0.0


def test_a_gross_reading_does_not_make_the_others_count_for_less(rows):
    copies = replace(five_each(rows), alike=1.0)
    weights = trust(copies, np.arange(len(copies)) == 0)
    assert weights[0] == 0.0
    assert weights[1:5] == pytest.approx(0.25)
    assert trust(rows) == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [[], [3], [3, 20]])
def test_a_reading_is_as_gross_however_often_it_is_copied(rows, bad):
    """What is gone from the rows is as much as was there: a third of each of three copies."""
    rng, few = np.random.default_rng(0), rows.select(np.arange(40))
    measured = few.measured + 1e-4 * rng.normal(size=few.measured.shape)
    single = replace(few, measured=measured, whole=None, place=None)
    again = rng.permutation(np.arange(40).repeat(3))
    copies = replace(single.select(again), whole=None, place=None, alike=1.0)

    def told(recording, gross):
        model = build_model(recording, [], weights=trust(recording))
        folds = np.arange(len(recording)) % 2
        pool = make_pool(model, model.start, folds, NoisePrior.of(1e-4), library=[type(OFFSET)])
        return _deletion_statistics(pool, gross, 1e-8)

    gross = np.isin(np.arange(40), bad)
    np.testing.assert_allclose(told(copies, gross[again]), told(single, gross)[again], rtol=1e-6)


def test_readings_that_know_of_each_other_are_left_out_together(rows):
    copies = five_each(rows)
    folds = fold_of_rows(replace(copies, alike=0.9), "rows")
    assert all(len(set(part)) == 1 for part in folds.reshape(-1, 5).tolist())
    assert len(set(folds.tolist())) == len(set(fold_of_rows(copies, "rows").tolist()))
    assert postures(copies).tolist() == np.repeat(np.arange(len(copies) // 5), 5).tolist()


@pytest.mark.parametrize("kind", ["rows", "time"])
def test_readings_that_come_round_again_are_folded_as_those_of_the_first_round(rows, kind):
    """By the row of its first reading alone each had been in the first half, which is one fold."""
    whole = np.arange(len(rows))
    again = replace(rows.select(np.concatenate([whole, whole])), alike=0.9)
    folds = fold_of_rows(again, kind).reshape(2, -1)
    np.testing.assert_array_equal(folds[0], folds[1])
    assert np.ptp(np.bincount(folds[0])) <= 1
    assert len(set(folds[0].tolist())) == len(set(fold_of_rows(again.select(whole), kind).tolist()))


@pytest.mark.parametrize("kind", ["rows", "time"])
def test_of_fewer_readings_than_folds_each_is_one_fold(rows, kind):
    again = replace(rows.select(np.tile(np.arange(3), 10)), alike=0.9)
    folds = fold_of_rows(again, kind)
    np.testing.assert_array_equal(np.sort(folds[:3]), np.arange(3))
    np.testing.assert_array_equal(folds, np.tile(folds[:3], 10))


def test_rows_of_a_single_posture_are_left_out_in_turn(rows):
    """As one reading they were one fold, beside which no row is left, and a traceback."""
    one = replace(rows.select(np.zeros(30, int)), alike=0.9)
    assert len(set(fold_of_rows(one, "time").tolist())) == 5


def test_postures_that_are_read_again_are_no_motion(rows):
    assert not scope_of(five_each(rows)).moving
    assert scope_of(bench("sweeping", "tip_position")).moving


# Whether there is any


@pytest.mark.parametrize("seed", range(3))
def test_the_correlation_that_was_drawn_is_found(rows, seed):
    rng = np.random.default_rng(seed)
    prior = NoisePrior.of(1.0)
    left = wandering((len(rows), 3), 0.8, rng)
    (wander, alike, *_), odds = correlation_of(left, rows, prior)
    assert wander == pytest.approx(0.8, abs=0.11)
    assert alike == 0.0
    assert odds > 5.0
    repeated = five_each(rows)
    common = np.repeat(rng.normal(size=(len(repeated) // 5, 3)), 5, axis=0)
    left = np.sqrt(0.8) * common + np.sqrt(0.2) * rng.normal(size=common.shape)
    (wander, alike, *_), odds = correlation_of(left, repeated, prior)
    assert alike == pytest.approx(0.8, abs=0.16)
    assert wander == 0.0
    assert odds > 5.0


def test_a_correlation_has_settled_where_rows_count_for_as_much():
    """Near one, a step of a tenth halves what the rows know; near none it hardly matters."""
    assert all(_worth_the_same(*pair) for pair in ((0.0, 0.1), (0.3, 0.2), (0.5, 0.6)))
    assert not any(_worth_the_same(*pair) for pair in ((0.7, 0.8), (0.9, 0.8), (0.9, 0.95)))


def test_white_noise_is_asked_for_nothing(rows):
    drawn = [np.random.default_rng(seed).normal(size=(len(rows), 3)) for seed in range(40)]
    asked = [correlation_of(left, rows, NoisePrior())[0] != RowNoise() for left in drawn]
    assert sum(asked) <= 1
    assert np.diff(CORRELATIONS).max() < 0.11


@pytest.mark.parametrize("size", [1e-16, 1e-6, 0.1])
def test_less_than_the_stated_noise_is_no_sign_that_rows_know_of_each_other(rows, size):
    repeated = five_each(rows)
    for seed in range(5):
        left = size * np.random.default_rng(seed).normal(size=(len(repeated), 3))
        for noise in (NoisePrior.of(1.0), NoisePrior.of(0.3 * size)):
            assert correlation_of(left, repeated, noise)[0] == RowNoise()


# Terms that suit what readings share


def of_postures(rows, own, shared, seed=0):
    """Functions of the posture, of 12 columns each, and rows that hold the first of them, or none.

    Args:
        rows: Each posture's readings (N).
        own: How far the first function moves them [noise].
        shared: Share of the noise's variance that readings of a posture have in common.
    """
    rng = np.random.default_rng(seed)
    posture = postures(rows)
    X = rng.normal(size=(posture.max() + 1, 3, 36))[posture].reshape(-1, 36)
    common = rng.normal(size=(posture.max() + 1, 3))[posture]
    noise = np.sqrt(shared) * common + np.sqrt(1.0 - shared) * rng.normal(size=common.shape)
    t = own * X[:, :12] @ rng.normal(size=12) + noise.ravel()
    free = np.tile([-np.inf, np.inf], (12, 1))
    terms = tuple(
        SimpleNamespace(columns=np.arange(12 * k, 12 * k + 12), limits=free, widths=SCALES)
        for k in range(3)
    )
    labels = np.tile(np.arange(3), (2, 1))
    asked = JointProblem(
        statistics(X, t), terms, NoisePrior(),
        np.full(3, -np.log(3.0)), np.zeros(3, dtype=bool), labels,
    )  # fmt: skip

    def left(state):
        columns, precision = stack(terms, state, asked.variance(state))
        own = X[:, columns]
        z = np.linalg.solve(own.T @ own + np.diag(precision), own.T @ t)
        return correlation_of((t - own @ z).reshape(-1, 3), rows, NoisePrior())

    return asked, left


@pytest.mark.parametrize(
    ("own", "shared", "alike"), [(0.0, 0.9, 0.9), (1.0, 0.9, 0.9), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
)
def test_what_readings_share_is_no_model_s_though_it_has_terms_enough(rows, own, shared, alike):
    """Three functions hold all that twelve postures share; with fewer terms it is theirs."""
    asked, left = of_postures(five_each(rows.select(np.arange(60))), own, shared)
    every = [SelectedTerm(k, 1.0) for k in range(3)]
    assert left(every)[0][1] <= 0.3
    for state in (every, every[1:], every[:1], []):
        back = list(taken_back(asked, state))
        assert most_probable(asked, back, left)[1] == pytest.approx(alike, abs=0.06)


def test_of_a_long_state_the_terms_that_are_no_model_s_go_one_by_one(rows):
    asked, left = of_postures(five_each(rows.select(np.arange(60))), 1.0, 0.9)
    every = [SelectedTerm(k, 1.0) for k in range(3)]
    back = list(taken_back(asked, every))
    assert most_probable(asked, back, left, 0)[1] == pytest.approx(0.9, abs=0.06)
    assert most_probable(asked, [every], left, 0)[1] <= 0.3


@pytest.mark.parametrize(("moved", "wander"), [(0.0, 0.9), (9.0, 0.0)])
def test_a_drift_stands_against_noise_that_wanders(rows, moved, wander):
    """What a drift leaves is white, and without it wanders: the more probable of the two counts."""
    rng, n = np.random.default_rng(0), len(rows)
    X = rng.normal(size=(3 * n, 6))
    t = moved * X @ np.ones(6) + rng.normal(size=3 * n)
    drift = Candidate(REGISTRY["base_drift"](), np.arange(6), 0.0)
    asked = JointProblem(
        statistics(X, t), (drift,), NoisePrior(),
        np.zeros(1), np.zeros(1, dtype=bool), np.zeros((2, 1), dtype=int),
    )  # fmt: skip
    white, alone = rng.normal(size=(n, 3)), wandering((n, 3), 0.9, rng)
    model = SimpleNamespace(recording=rows, problem=SimpleNamespace(weights=np.ones(n)))
    selected = SimpleNamespace(pool=SimpleNamespace(model=model, noise=NoisePrior()))

    def left(terms, variance):
        return left_by_nothing(white if terms else alone)

    alt = SimpleNamespace(
        problem=asked,
        rows=np.arange(n),
        term=[drift].__getitem__,
        left=left,
        spread=np.ones((n, 3)),
    )
    found = _correlation(selected, alt, [SelectedTerm(0, 1.0)], many=True)
    assert found.wander == pytest.approx(wander, abs=0.11)


def test_of_fewer_terms_the_least_probable_goes_first_and_gross_rows_stay(rows):
    asked, _ = of_postures(five_each(rows.select(np.arange(60))), 1.0, 0.0)
    asked = replace(asked, log_priors=np.array([*asked.log_priors[:2], -np.inf]))  # a gross row
    every = [SelectedTerm(k, 1.0) for k in range(3)]
    assert [[t.index for t in some] for some in taken_back(asked, every)] == [
        [0, 1, 2],
        [0, 2],
        [2],
    ]


# Whole verdicts


@pytest.mark.parametrize(
    ("time", "wander", "asked"), [(None, 0.9, 1), (None, 0.0, 0), (1.0, 0.9, 0)]
)
def test_rows_that_err_alike_are_asked_for_a_clock_where_they_have_none(rows, time, wander, asked):
    stamps = None if time is None else time * np.arange(len(rows))
    said = list(_correlated(replace(rows, time=stamps, wander=wander), 1e-4))
    assert sum("column time" in note for note in said) == asked


@pytest.mark.parametrize("noise", ["drift", "copies"])
def test_of_a_robot_with_nothing_wrong_correlated_rows_tell_nothing(noise):
    recording = NOISES[noise](
        clean(1, 0, rows=(14, 15) if noise == "copies" else (60, 61)),
        np.random.default_rng([0, 1, 29]),
    )
    found = diagnose(recording, DiagnosisOptions(force=True))
    assert found.verdict.verdict == Outcome.NO_GAP
    assert any("correlate" in note for note in found.verdict.notes)
    assert found.recording.wander == (pytest.approx(0.9, abs=0.11) if noise == "drift" else 0.0)
