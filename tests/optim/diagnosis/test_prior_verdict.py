"""What the constants of the verdict decide: what is spared, lack of fit, confounding, figures."""

from types import SimpleNamespace

import numpy as np
import pytest

import tests.optim.diagnosis.test_negligible_effects as negligible
from plumbline.optim.diagnosis.calibrate.check import Recalibration
from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.verdict.confounding import rivals, unobservable
from plumbline.optim.diagnosis.verdict.judge import gap_of
from plumbline.optim.diagnosis.verdict.lack_of_fit import is_noisier, lack_of_fit
from plumbline.optim.diagnosis.verdict.where import _orders
from tests.benches import bench
from tests.designs import selection

N, SIGMA = 60, 0.1


# Negligible effects: how often the held-out RMS rises without a cause


@pytest.mark.parametrize(
    ("count", "rise", "kept"),
    [
        (30_000, 1.007, False),  # less than one per cent
        (30_000, 1.014, True),
        (2_000, 1.003, False),  # of few rows, what chance does not do
        (2_000, 1.007, True),
        (900, 0.98, True),  # of still fewer, no difference at all
    ],
)
def test_a_negligible_effect_is_spared(count, rise, kept, monkeypatch):
    stays, _ = negligible.worthy([rise], monkeypatch, count=count)
    assert (1 in stays) == kept


# Causes that are excluded


# Lack of fit


def left(ratio, source="given", **known):
    """A noise of 10 um, and what a fit to very many rows leaves of it."""
    recording = bench("ur5", "tip_position")
    model = SimpleNamespace(recording=recording)
    best = SimpleNamespace(gram=SimpleNamespace(count=1e8), problem=SimpleNamespace(size=0))
    return NoiseLevel(1e-5, source, ratio, **known), SimpleNamespace(best=best, model=model)


def test_up_to_twice_the_stated_noise_is_noise_and_more_is_something_that_follows_nothing():
    assert lack_of_fit(*left(1.5)) < 0.02
    assert lack_of_fit(*left(2.13)) == pytest.approx(0.5, abs=0.08)
    assert lack_of_fit(*left(3.0)) > 0.95


@pytest.mark.parametrize(("repeats", "lacking"), [(12, False), (200, True)])
def test_the_more_repeats_tell_the_noise_the_less_of_what_is_left_is_noise(repeats, lacking):
    assert (lack_of_fit(*left(1.4, "repeats", repeats=repeats)) > 0.5) == lacking


@pytest.mark.parametrize(
    ("ratio", "noisier"), [(0.9, False), (1.14, False), (1.16, True), (3.0, False)]
)
def test_a_noise_is_larger_than_stated_if_chance_is_not_and_nothing_else_is_as_probable(
    ratio, noisier
):
    assert is_noisier(*left(ratio)) == noisier
    assert not is_noisier(*left(ratio, "repeats", repeats=20))


@pytest.mark.parametrize(("after", "far"), [(1.5, False), (3.0, True)])
def test_rows_left_out_are_far_off_if_they_are_missed_by_twice_their_noise(after, far):
    assert Gap("m", 9.0, after, 1.0, 0.0, (0.0, 1.0)).is_far == far


@pytest.mark.parametrize(("before", "told"), [(1.1, False), (1.22, True)])
def test_a_share_of_what_can_be_removed_is_told_if_there_is_any(before, told):
    seen = SimpleNamespace(
        rms_before=before, rms_after=1.0, per_point=1.0, unit="m", interval=(0.0, 1.0), by="rows"
    )
    removable = gap_of(seen, NoiseLevel(1.0, "given", 1.0)).removable
    assert np.isfinite(removable) == told
    assert not told or removable == pytest.approx(1.0)  # down to its noise all is gone


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
    assert bool(rivals(asked, asked.reduce(own), own)) == confounded


def test_what_the_rows_say_nothing_of_is_confounded_with_no_cause():
    """Forty columns of which none does anything; the first is in the model nevertheless."""
    X = SIGMA * np.linalg.qr(np.random.default_rng(0).normal(size=(N, 40)))[0]
    asked = selection(X, np.random.default_rng(1).normal(0.0, SIGMA, N), SIGMA)
    own = [SelectedTerm(0, 1.0)]
    assert not rivals(asked, asked.reduce(own), own)


@pytest.mark.parametrize("alike", [True, False])
def test_what_is_there_beside_a_cause_is_no_rival_however_likely(alike):
    """Two columns, both in the readings or one for the other; none but the first is named."""
    X = SIGMA * 20.0 * np.linalg.qr(np.random.default_rng(0).normal(size=(N, 2)))[0]
    X[:, 1] = X[:, 0] if alike else X[:, 1]
    asked = selection(X, X @ [0.5, 1.0] + np.random.default_rng(1).normal(0.0, SIGMA, N), SIGMA)
    own = [SelectedTerm(0, 1.0)]
    assert bool(rivals(asked, asked.reduce(own), own)) == alike


def test_what_the_rows_ask_for_whether_a_cause_is_there_or_not_is_no_rival_of_a_faint_one():
    """Two columns that have nothing to do with each other; the first is hardly more than noise."""
    X = SIGMA * 20.0 * np.linalg.qr(np.random.default_rng(0).normal(size=(N, 2)))[0]
    asked = selection(X, X @ [0.05, 1.0], SIGMA)
    own = [SelectedTerm(0, 1.0)]
    assert not rivals(asked, asked.reduce(own), own)


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
    assert bool(unobservable(pool, asked, [], None, SIGMA, ())) != seen


@pytest.mark.parametrize(("left", "seen"), [(0.6, False), (1.6, True)])
def test_an_effect_that_a_named_cause_absorbs_but_for_less_than_the_noise_cannot_be_seen(
    left, seen
):
    """A signal of ten sigma, of which what is named leaves so much [sigma]."""
    u, w = np.linalg.qr(np.random.default_rng(0).normal(size=(N, 2)))[0].T
    sine = left / 10.0
    X = 10.0 * SIGMA * np.column_stack([u, np.sqrt(1.0 - sine**2) * u + sine * w])
    asked = selection(X, X[:, 0], SIGMA)
    pool = SimpleNamespace(
        whole=asked.linear, candidates=asked.candidates, model=SimpleNamespace(terms=[]), always=0
    )
    assert not unobservable(pool, asked, [], None, SIGMA, ())
    told = unobservable(pool, asked, [SelectedTerm(0, 30.0)], None, SIGMA, ())
    assert [(b.effect, b.element) for b in told] == ([] if seen else [("joint_offset", 2)])


def test_of_few_elements_all_orders_are_taken_and_of_many_some():
    assert len({tuple(order) for order in _orders(5, 0).tolist()}) == 120
    assert 100 <= len(_orders(7, 0)) < 1000


# Recalibration


def test_ten_statements_that_were_too_sure_are_believed_part_of_the_way():
    """Nine in ten were stated and five in ten were right: between the two, nearer to the latter."""
    line = Recalibration.of([0.9] * 10, [True, False] * 5)
    assert line(0.9) == pytest.approx(0.60, abs=0.02)
    assert line.slope == pytest.approx(0.54, abs=0.05)
