"""What the constants of the verdict decide: exclusion, lack of fit, doubt, confounding, figures."""

from types import SimpleNamespace

import numpy as np
import pytest

import tests.test_negligible_effects as negligible
from plumbline.optim.diagnosis.calibrate.recalibration import Recalibration
from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import restricted
from plumbline.optim.diagnosis.verdict import criticism
from plumbline.optim.diagnosis.verdict.confounding import rivals, unobservable
from plumbline.optim.diagnosis.verdict.exclusion import _against_the_unknown, borne_out
from plumbline.optim.diagnosis.verdict.judge import _gap
from plumbline.optim.diagnosis.verdict.lack_of_fit import lack_of_fit
from plumbline.optim.diagnosis.verdict.probabilities import doubted, probabilities_of
from plumbline.optim.diagnosis.verdict.where import _orders
from tests.benches import bench
from tests.designs import selection

N, SIGMA = 60, 0.1


# Negligible effects: how often the held-out RMS rises without a cause


@pytest.mark.parametrize(
    ("large", "count", "rise", "kept"),
    [
        (5.0, 30_000, 1.007, False),  # less than one per cent
        (5.0, 30_000, 1.014, True),
        (12.0, 30_000, 1.03, False),  # a two-thousandth of what all causes remove
        (12.0, 30_000, 1.045, True),
        (5.0, 2_000, 1.003, False),  # of few rows, what chance does not do
        (5.0, 2_000, 1.007, True),
    ],
)
def test_a_negligible_effect_is_spared(large, count, rise, kept, monkeypatch):
    monkeypatch.setattr(negligible, "LARGE", large)
    stays, _ = negligible.worthy([rise], monkeypatch, count=count)
    assert (1 in stays) == kept


def test_negligible_effects_together_may_cost_a_twentieth(monkeypatch):
    _, rms = negligible.worthy(1.004 + 1e-6 * np.arange(40), monkeypatch)
    assert 1.04 < rms < 1.06


# Causes that are excluded


@pytest.mark.parametrize(("left", "held"), [(0.55, True), (0.75, False)])
def test_causes_that_leave_a_lack_of_fit_must_remove_a_third(left, held):
    seen = SimpleNamespace(rms_before=1.0, rms_after=np.sqrt(left))
    assert borne_out(SimpleNamespace(chosen=[1]), seen, True, 0.0) == held


def against(probabilities):
    """How many causes stay that have these inclusion probabilities."""
    keys = [("some", k) for k in range(len(probabilities))]
    chosen = [SelectedTerm(k, 1.0) for k in range(len(keys))]
    problem = SimpleNamespace(
        candidates=[SimpleNamespace(key=key) for key in keys],
        keys=lambda terms: frozenset(keys[c.index] for c in terms),
    )
    beyond = Outside(0.0, "", "", None, dict(zip(keys, probabilities, strict=True)))
    selected = SimpleNamespace(selection=problem, chosen=chosen)
    return len(_against_the_unknown(selected, beyond, gently=False))


def test_a_cause_is_excluded_where_an_unknown_in_its_place_is_likelier():
    assert against([0.4, 0.6]) == 1


def test_of_many_causes_none_is_excluded_for_an_unknown():
    assert against([0.1] * 5) == 0
    assert against([0.1] * 8) == 8


def test_a_cause_that_was_excluded_keeps_about_half_of_its_probability():
    column = SIGMA * np.ones((N, 1))
    whole = selection(column, 30.0 * column[:, 0], SIGMA)
    none = restricted(whole, np.zeros(1, dtype=bool))
    [key] = (c.key for c in whole.candidates)
    selected = SimpleNamespace(
        selection=none, whole_selection=whole, chosen=[], excluded=frozenset({key})
    )
    found = probabilities_of(selected, Outside(-50.0, "", "", None))[key]
    assert 0.35 < found < 0.65


@pytest.mark.parametrize(("log_odds", "beaten"), [(2.0, False), (4.0, True)])
def test_evidence_is_strong_from_twenty_to_one(log_odds, beaten):
    assert criticism._beaten(Outside(log_odds, "", "", None)) == beaten


# Lack of fit and doubt


def lacking(ratio):
    recording = bench("ur5", "tip_position")
    model = SimpleNamespace(recording=recording)
    best = SimpleNamespace(gram=SimpleNamespace(count=1e8), problem=SimpleNamespace(size=0))
    return lack_of_fit(NoiseLevel(1e-5, "given", ratio), SimpleNamespace(best=best, model=model))


def test_a_residual_a_sixth_above_a_stated_noise_is_as_likely_lack_of_fit_as_not():
    assert lacking(1.15) < 0.5 < lacking(1.2)


def test_a_residual_a_quarter_above_a_stated_noise_is_lack_of_fit_nine_times_of_ten():
    assert 0.8 < lacking(1.245) < 0.93


def belief(count, left):
    keys = [("some", k) for k in range(count)]
    return doubted(dict.fromkeys(keys, 1.0), keys, 1.0, left)[keys[0]]


def test_with_an_unknown_a_lone_cause_is_believed_and_one_of_several_hardly():
    """As often as they were right: 95 % (87 to 98 with 95 % confidence) and 30 % (22 to 39 %)."""
    assert 0.87 < belief(1, 1.0) < 0.94
    assert 0.22 < belief(3, 1.0) < 0.39


def test_where_a_hundredth_of_the_gap_is_left_half_as_much_is_doubted():
    assert belief(3, 0.0125) == pytest.approx((1.0 + belief(3, 1.0)) / 2, abs=0.05)


@pytest.mark.parametrize(("after", "far"), [(1.5, False), (3.0, True)])
def test_rows_left_out_are_far_off_if_they_are_missed_by_twice_their_noise(after, far):
    assert Gap("m", 9.0, after, 1.0, 0.0, (0.0, 1.0)).is_far == far


@pytest.mark.parametrize(("before", "told"), [(1.03, False), (1.08, True)])
def test_a_share_of_what_can_be_removed_is_told_if_there_is_any(before, told):
    seen = SimpleNamespace(
        rms_before=before, rms_after=1.0, per_point=1.0, unit="m", interval=(0.0, 1.0), by="rows"
    )
    assert np.isfinite(_gap(seen, NoiseLevel(1.0, "given", 1.0)).removable) == told


# Confounded effects, and what cannot be seen


@pytest.mark.parametrize(("lost", "confounded"), [(2.0, True), (4.5, False)])
def test_an_effect_is_confounded_if_in_its_place_the_log_likelihood_hardly_changes(
    lost, confounded
):
    """A signal of ten sigma, and a column that leaves so much of it unexplained."""
    u, w, rest = np.linalg.qr(np.random.default_rng(0).normal(size=(N, 3)))[0].T
    cosine = np.sqrt(1.0 - 2.0 * lost / 100.0)
    X = 10.0 * SIGMA * np.column_stack([u, cosine * u + np.sqrt(1.0 - cosine**2) * w])
    asked = selection(X, X[:, 0] + np.sqrt(N) * SIGMA * rest, SIGMA)
    own = [SelectedTerm(0, 30.0)]
    assert bool(rivals(asked, own, own)) == confounded


@pytest.mark.parametrize(("square", "seen"), [(0.6, False), (1.6, True)])
def test_an_effect_whose_whole_signal_is_below_the_noise_cannot_be_seen(square, seen):
    X = np.sqrt(square) * SIGMA * np.ones((N, 1)) / np.sqrt(N)
    asked = selection(X, X[:, 0], SIGMA)
    pool = SimpleNamespace(
        whole=asked.linear,
        candidates=asked.candidates,
        model=SimpleNamespace(terms=[]),
        always=0,
    )
    assert bool(unobservable(pool, asked, None, SIGMA, ())) != seen


def test_of_few_elements_all_orders_are_taken_and_of_many_some():
    assert len({tuple(order) for order in _orders(5, 0).tolist()}) == 120
    assert 100 <= len(_orders(7, 0)) < 1000


# Recalibration


def test_ten_statements_that_were_too_sure_are_believed_part_of_the_way():
    """Nine in ten were stated and five in ten were right: between the two, nearer to the latter."""
    line = Recalibration.of([0.9] * 10, [True, False] * 5)
    assert line(0.9) == pytest.approx(0.60, abs=0.02)
    assert line.slope == pytest.approx(0.54, abs=0.05)
