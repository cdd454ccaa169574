"""What the constants of the search decide: evidence, selection, gross rows, noise, unknowns, folds.

Each law is a decision on a made-up case whose answer is known, so close on either side of the limit
that a constant which is halved or doubled decides otherwise.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import chi2, norm

from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.diagnose import task_of
from plumbline.optim.diagnosis.discrepancy import alternatives
from plumbline.optim.diagnosis.findings import NoiseLevel
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.joint_problem import LOG_GROSS_ODDS
from plumbline.optim.diagnosis.posterior.noise import _chance, repeat_noise
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.robust import (
    distrusted_by_fit,
    far_off,
    follows_something,
)
from plumbline.optim.diagnosis.posterior.search import find_causes
from plumbline.optim.diagnosis.posterior.selection import select
from plumbline.optim.diagnosis.posterior.shortlists import _best
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.verdict.lack_of_fit import noisier_encoder, noisiest_joint
from plumbline.optim.recording.kinds import KINDS
from tests.benches import bench
from tests.designs import selection

N, SIGMA = 60, 0.1


def limit_of(holds, low, high, steps=24):
    """The least value, between two, at which something holds."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


# Evidence and selection


def probability(log_odds):
    return float(expit(log_odds))


def column(size=1.0):
    return size * np.ones((N, 1)) / np.sqrt(N)


def test_before_the_data_a_cause_is_about_as_probable_as_none():
    asked = selection(np.zeros((N, 1)), np.zeros(N), SIGMA)
    log_odds, _ = asked.odds(asked.reduce([]))
    assert 0.3 < probability(log_odds[0]) < 0.5


def test_before_the_data_one_cause_more_is_rare():
    asked = selection(np.hstack([column(), 0.0 * column()]), np.zeros(N), SIGMA)
    log_odds, _ = asked.odds(asked.reduce([SelectedTerm(0, 1.0)]))
    spare = log_odds[1] - asked.log_priors[1]
    assert 0.06 < probability(spare) < 0.14


def test_one_of_two_candidates_is_named_from_two_and_a_half_sigma_the_other_from_one_more():
    """Of a usual size of ten sigma, which is what the evidence makes it pay for."""
    *u, rest = np.linalg.qr(np.random.default_rng(0).normal(size=(N, 3)))[0].T
    X = 10.0 * SIGMA * np.column_stack(u)

    def named(z, others):
        t = X @ ([z / 10.0, others]) + np.sqrt(N) * SIGMA * rest
        return 0 in {c.index for c in select(selection(X, t, SIGMA), thorough=False)}

    assert limit_of(lambda z: named(z, 0.0), 1.0, 6.0) == pytest.approx(2.62, abs=0.1)
    assert limit_of(lambda z: named(z, 5.0), 1.0, 6.0) == pytest.approx(3.43, abs=0.1)


def test_a_stated_noise_is_worth_as_many_readings_as_its_seven_per_cent_say():
    believed = float(np.sqrt(NoisePrior.of(1.0).variance(50 * 4.0, 50)))
    assert believed == pytest.approx(2.0**0.5, abs=0.03)  # 100 readings of 1, and 50 of 2


@pytest.mark.parametrize("size", [1 / 3, 1.0, 3.0, 25.0])
def test_a_size_is_told_up_to_thirty_times_the_usual_one(size):
    asked = selection(300.0 * SIGMA * column(), 300.0 * SIGMA * size * column()[:, 0], SIGMA)
    _, scores = asked.odds(asked.reduce([]))
    assert abs(np.log10(scores.scale[0] / size)) < 0.3


def test_a_size_ten_times_the_usual_one_is_a_little_less_probable():
    weights = dict(zip(np.round(np.log10(prior.SCALES), 6), prior.LOG_SCALE_WEIGHTS, strict=True))
    assert -1.2 < weights[1.0] - weights[0.0] < -0.6
    assert np.exp(prior.LOG_SCALE_WEIGHTS).sum() == pytest.approx(1.0)


def listed(score, parameters=1):
    """How many variants of a dense family a short list takes, all of one evidence."""
    effect = SimpleNamespace(parameters=(None,) * parameters)
    family = SimpleNamespace(effects=[effect] * 400)
    return len(_best(family, np.full(400, score), []))


def test_a_short_list_takes_few_without_evidence_and_no_more_columns_than_it_may():
    assert 5 <= listed(-10.0) <= 8
    assert listed(2.0) == listed(-10.0)
    assert listed(4.0) > listed(2.0)
    assert 60 < listed(10.0) < 120
    assert listed(10.0, parameters=2) == listed(10.0) / 2


# Gross rows


def spread(rows, m=3):
    """Residuals (rows, m) whose squares are those of noise of one, without chance."""
    radius = np.sqrt(chi2.ppf((np.arange(rows) + 0.5) / rows, m))
    return radius[:, None] * np.eye(m)[np.arange(rows) % m]


def test_one_row_in_two_hundred_is_gross_from_six_sigma():
    rows = spread(200)

    def gross(size):
        rows[100] = [size, 0.0, 0.0]
        return distrusted_by_fit(rows)[100]

    assert limit_of(gross, 2.0, 20.0) == pytest.approx(6.2, abs=0.08)


@pytest.mark.parametrize(("share", "some"), [(0.15, True), (0.25, False)])
def test_no_more_than_a_fifth_of_the_rows_are_gross(share, some):
    rows = spread(200)
    rows[: int(200 * share)] = [50.0, 0.0, 0.0]
    assert distrusted_by_fit(rows).any() == some


@pytest.mark.parametrize(("count", "some"), [(7, False), (8, True)])
def test_rows_that_a_payload_picks_out_are_no_gross_errors(count, some):
    """All of eight in one third of the rows: by chance once in 20,000, in any range in 100."""
    recording = bench("ur5", "tip_position", columns=[])
    recording = replace(recording, payload=np.arange(60.0) % 3)
    found = np.zeros(60, dtype=bool)
    found[1 : 3 * count : 3] = True
    follows = follows_something(found, recording)
    np.testing.assert_array_equal(follows, found & some)


@pytest.mark.parametrize("count", [4, 8])
def test_rows_that_are_gross_anywhere_follow_nothing(count):
    recording, rng = bench("ur5", "tip_position"), np.random.default_rng(6)
    for _ in range(20):
        found = np.zeros(60, dtype=bool)
        found[rng.choice(60, count, replace=False)] = True
        assert not follows_something(found, recording).any()


@pytest.mark.parametrize(("first", "count", "gross"), [(0, 3, True), (30, 3, True), (0, 4, False)])
def test_three_rows_that_steps_explain_are_gross_and_four_are_not(first, count, gross):
    """Of a bump soon after the first row, or of two on both sides of rows, one never sees more."""
    recording = bench("ur5", "tip_position")
    sigma, rng = 1e-5, np.random.default_rng(5)
    measured = recording.measured + rng.normal(0.0, sigma, (len(recording), 3))
    measured[first : first + count] += [5e-4, -3e-4, 4e-4]
    options = DiagnosisOptions(library=(BaseBump,))
    task = task_of(replace(recording, measured=measured, noise_std=sigma), options)
    selected, bad = find_causes(task, lambda *_: None, np.zeros(len(recording), dtype=bool))
    assert bad.sum() == (count if gross else 0)
    assert bool(selected.effects) != gross


def repeats(postures, gap=0.0):
    """The noise that so many pairs of repeated postures tell, apart by a gap."""
    q = np.repeat(np.arange(float(postures)), 2)[:, None]
    q[1::2] += gap

    class Repeated:
        kind, alike = KINDS["tip_position"], 0.0
        direction = payload = part = None

        def __init__(self):
            self.q = q

        def __len__(self):
            return len(q)

    mapped = SimpleNamespace(residuals=lambda _: np.tile([[1.0] * 3, [-1.0] * 3], (postures, 1)))
    problem = SimpleNamespace(weights=np.ones(2 * postures))
    return repeat_noise(Repeated(), SimpleNamespace(problem=problem, mapped=mapped, x=None))


def test_repeats_tell_the_noise_from_a_handful_of_them_on():
    assert repeats(4) is None
    assert repeats(9).sigma == pytest.approx(np.sqrt(2.0))


def test_postures_that_differ_by_less_than_an_encoder_s_step_are_repeated():
    assert repeats(20, gap=0.3e-6) is not None
    assert repeats(20, gap=0.8e-6) is None


def test_repeats_may_say_more_than_the_fit_leaves_as_far_as_chance_in_a_hundred_goes():
    readings = 3 * 12
    chance = norm.sf(_chance(NoiseLevel(1.0, "repeats", 1.0, repeats=12)) * np.sqrt(2 * readings))
    assert chance == pytest.approx(0.01)


# Unknown dependences


def test_a_row_is_gross_one_time_in_a_hundred():
    assert 0.006 < probability(LOG_GROSS_ODDS) < 0.016


def looked_at(monkeypatch, sizes):
    """Rows that the families see, of a hundred, some of them distrusted and that large."""
    missed = np.ones((100, 1))
    missed[: len(sizes), 0] = sizes
    weights = np.ones(100)
    weights[: len(sizes)] = 0.0
    mapped = SimpleNamespace(residuals=lambda _: missed)
    monkeypatch.setattr(alternatives, "Mapped", lambda _: mapped)
    model = SimpleNamespace(recording=range(100), problem=SimpleNamespace(weights=weights))
    return len(alternatives.rows_compared(SimpleNamespace(model=model, x=None)))


def test_a_distrusted_row_may_be_an_unknown_s_unless_it_is_a_hundred_times_off(monkeypatch):
    assert looked_at(monkeypatch, [70.0]) == 100
    assert looked_at(monkeypatch, [150.0]) == 99


def test_of_many_distrusted_rows_none_is_an_unknown_s(monkeypatch):
    assert looked_at(monkeypatch, [20.0] * 15) == 100
    assert looked_at(monkeypatch, [20.0] * 30) == 70


@pytest.mark.parametrize(("ratio", "joint"), [(1.2, None), (1.6, 3)])
def test_a_joint_that_is_half_as_noisy_again_is_named(ratio, joint):
    """So much noisier than all joints together."""
    spread = np.sqrt([(3.0 - ratio**2) / 2.0] * 2 + [ratio**2])
    rows = np.ones((N, 1)) * spread
    best = SimpleNamespace(
        x=None, mapped=SimpleNamespace(residuals=lambda _: rows),
        problem=SimpleNamespace(weights=np.ones(N)),
    )  # fmt: skip
    recording = SimpleNamespace(kind=KINDS["joint_position"], measured_joints=(0, 1, 2))
    selected = SimpleNamespace(best=best)
    said = noisiest_joint(recording, selected)
    assert said.startswith(f"joint {joint}'s error changes") if joint else said == ""
    said = list(noisier_encoder(recording, selected))
    assert [words[:7] for words in said] == ([f"joint {joint}"] if joint else [])
    few = SimpleNamespace(weights=(np.arange(N) < 5).astype(float))  # of five it may be chance
    assert not list(
        noisier_encoder(
            recording, SimpleNamespace(best=SimpleNamespace(**{**vars(best), "problem": few}))
        )
    )


# Folds


def with_groups(*counts):
    recording = bench("ur5", "tip_position")
    assert sum(counts) == len(recording)
    return replace(recording, group=np.repeat(np.arange(len(counts)), counts))


def test_many_rows_make_a_handful_of_folds_and_few_rows_fewer():
    recording = bench("ur5", "tip_position")
    assert 4 <= len(np.unique(fold_of_rows(recording, "rows"))) <= 7
    assert len(np.unique(fold_of_rows(recording.select(np.arange(12)), "rows"))) == 3


def test_a_group_may_hold_seven_tenths_of_the_rows_and_not_four_fifths():
    assert kind_of_folds(with_groups(42, 18), "auto") == "groups"
    assert kind_of_folds(with_groups(48, 12), "auto") != "groups"


@pytest.mark.parametrize(("times", "gross"), [(7.0, False), (15.0, True)])
def test_a_row_kept_back_is_gross_if_it_is_missed_ten_times_as_far(times, gross):
    rows = spread(200)
    rows[100] = [times * np.median(np.linalg.norm(rows, axis=1)), 0.0, 0.0]
    assert far_off(rows)[100] == gross
