"""Laws of jumps: planted moments are found, gross rows are rows, noise has none."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from plumbline.experiments.reality.joint_effects import JointOffset
from plumbline.experiments.reality.outside_effects import StickSlip
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.jumps import find_jumps, log_share
from plumbline.optim.diagnosis.findings import Kind
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from tests.simulated_cases import causes, faultless, recorded, with_fault

ROWS, SIGMA = 60, 0.2
AFTER = np.where(np.arange(ROWS) > np.arange(ROWS - 1)[:, None], 0.5, -0.5)


def problem(seed, moments=(), gross=(), doubted=(), *, alike=False):
    """Readings of one joint in three directions: what is asked, and with what columns."""
    rng = np.random.default_rng(seed)
    port = rng.normal(size=(ROWS, 3))
    angle = rng.normal(size=ROWS)
    error = 0.7 * angle
    sizes = np.full(len(moments), 2.0) if alike else rng.choice([-2.0, 2.0], len(moments))
    for size, k in zip(sizes, moments, strict=True):
        error = error + size * AFTER[k]
    reading = error[:, None] * port + rng.normal(0.0, SIGMA, (ROWS, 3))
    reading[list(gross)] += rng.choice([-4.0, 4.0], (len(gross), 3))
    rows = np.zeros((len(doubted), 3, ROWS, 3))
    for i, row in enumerate(doubted):
        rows[i, :, row] = np.eye(3)
    frame = np.tile(np.eye(3)[:, None, :], (1, ROWS, 1)).reshape(3, -1)
    return (
        (angle[:, None] * port).reshape(1, -1),
        (AFTER[:, :, None] * port).reshape(ROWS - 1, -1),
        rows.reshape(len(doubted), 3, 3 * ROWS),
        reading.ravel(),
        frame,
        NoisePrior.of(SIGMA),
    )


@pytest.mark.parametrize("moments", [(20,), (11, 30, 44), (5, 6, 25, 40, 41)])
def test_planted_jumps_are_found_first_and_few_others(moments):
    found = find_jumps(*problem(1, moments)).steps
    assert sorted(found[: len(moments)]) == list(moments)
    assert len(found) <= len(moments) + 2


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_jumps_nowhere(seed):
    found = find_jumps(*problem(seed, doubted=(7, 30)))
    assert found.steps == []
    assert found.rows == []


def test_what_no_row_shows_changes_nothing():
    always, steps, rows, target, frame, noise = problem(1, moments=(20,))
    wider = np.vstack([frame, np.zeros_like(frame[:2]), frame[:1]])
    plain = find_jumps(always, steps, rows, target, frame, noise)
    assert find_jumps(always, steps, rows, target, wider, noise).steps == plain.steps == [20]


def test_a_gross_row_is_a_row_and_not_two_jumps():
    found = find_jumps(*problem(2, moments=(30,), gross=(15,), doubted=(10, 15)))
    assert found.steps == [30]
    assert found.rows == [1]


def test_a_doubted_row_that_the_jumps_explain_is_not_gross():
    found = find_jumps(*problem(3, moments=(20, 23), doubted=(21, 22, 23)))
    assert {20, 23} <= set(found.steps)
    assert found.rows == []


@pytest.mark.parametrize("moments", [(), (20,)])
def test_what_is_always_fitted_neither_jumps_nor_hides_a_jump(moments):
    always, steps, rows, target, beside, noise = problem(4, moments)
    drift = 50.0 * np.tile([1.0, 0.0, 0.0], ROWS)
    found = find_jumps(always, steps, rows, target + drift, beside, noise)
    assert found.steps == list(moments)


def test_a_step_between_two_that_make_it_up_goes_again():
    """Of two like steps the pursuit first takes one half way, which then is dispensable."""
    found = find_jumps(*problem(5, moments=(22, 38), alike=True))
    assert sorted(found.steps) == [22, 38]


def test_shares_of_all_sets_of_jumps_sum_to_one():
    moments = 7
    sets = [s for k in range(1, moments + 1) for s in combinations(range(moments), k)]
    assert sum(np.exp(log_share(len(s), moments)) for s in sets) == pytest.approx(1.0)


def test_a_joint_that_sticks_and_slips_is_no_cause_of_the_library(tmp_path):
    case = with_fault(faultless(rows=90, seed=22), StickSlip(0.0, 4, 22), gap=2.5)
    verdict = diagnose(recorded(case, tmp_path)[0]).verdict
    assert verdict.verdict in (Kind.OUTSIDE, Kind.PARTLY)
    assert verdict.outside_depends_on == "joint 4's error depends on what went before"
    assert not [c for c in verdict.causes if c.probability > 0.95]


def test_an_offset_with_a_gross_first_reading_is_an_offset_and_no_jump(tmp_path):
    """One jump after the first row would make the same of all others."""
    case = with_fault(faultless(rows=90, seed=43), JointOffset(0.0, 4), gap=3.0)
    recording, _ = recorded(case, tmp_path)
    measured = recording.measured.copy()
    measured[0] += 20.0 * recording.noise_std
    assert causes(diagnose(replace(recording, measured=measured))) == [("joint_offset", 4)]
