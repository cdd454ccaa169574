"""Columns of another joint, or against their own, are refused by name; gaps of drives never are."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.optim.diagnosis.motion.recording import build_motion
from plumbline.optim.recording.mixed_up import refuse_mixed_up
from plumbline.optim.recording.table import Origin

LETTERS = ("u", "q")
ROWS = 400


def motions(joints=3, seed=0):
    """Sums of sines, each joint its own (ROWS, joints)."""
    rng = np.random.default_rng(seed)
    t = np.arange(ROWS) / 50
    sines = np.sin(2 * np.pi * t[:, None] * rng.uniform(0.1, 0.8, 3) + rng.uniform(0, 6, 3))
    return sines @ rng.normal(size=(3, joints))


def refuse(told, read, latest=50):
    refuse_mixed_up(told, read, LETTERS, Origin(), latest)


@pytest.mark.parametrize("joint", [1, 3])
def test_a_column_against_its_joint_is_refused_by_name(joint):
    told = motions()
    read = told * np.where(np.arange(3) + 1 == joint, -0.7, 1.0)
    with pytest.raises(PlumblineError, match=rf"q{joint} against u{joint} .*turn the sign"):
        refuse(told, read)


def test_two_exchanged_columns_are_refused_by_name():
    told = motions()
    with pytest.raises(PlumblineError, match=r"q1 with u3, and q3 with u1.*exchange these columns"):
        refuse(told, told[:, [2, 1, 0]])


@pytest.mark.parametrize("seed", range(20))
def test_late_weak_coupled_and_noisy_joints_are_not_refused(seed):
    rng = np.random.default_rng(seed)
    told = motions(seed=seed)
    read = np.roll(told, rng.integers(0, 20), axis=0) * rng.uniform(0.1, 2.0, 3)
    read += 0.4 * read[:, [1, 2, 0]] + rng.normal(0, read.std(), read.shape)
    refuse(told, read)


def test_joints_that_do_the_same_are_not_exchanged():
    told = motions()[:, [0, 0, 1]]
    refuse(told, told + np.random.default_rng(1).normal(0, 0.05, told.shape))
    ramps = np.arange(ROWS)[:, None] * np.array([1.0, 0.3, 0.7])  # but for rounding
    refuse(ramps, ramps * np.array([0.1, 3.0, 1.1]))


def test_what_obeys_fast_motions_late_is_held_against_its_commands_as_late_as_it_is():
    """120 ms late it ran with and against them by 0.5, and neither sign nor names were told."""
    rng = np.random.default_rng(0)
    t = np.arange(600) / 50
    sines = np.sin(
        2 * np.pi * t[:, None, None] * rng.uniform(0.2, 2.0, (4, 3)) + rng.uniform(0, 6, (4, 3))
    )
    told = sines.sum(axis=1)
    read = np.roll(told, 6, axis=0) + rng.normal(0.0, 0.05, told.shape)
    refuse(told, read)
    assert abs(np.corrcoef(told[:, 1], read[:, 1])[0, 1]) < 0.6
    with pytest.raises(PlumblineError, match=r"q2 against u2 .*turn the sign"):
        refuse(told * [1.0, -1.0, 1.0], read)
    with pytest.raises(PlumblineError, match=r"q1 with u2, and q2 with u1.*exchange these columns"):
        refuse(told[:, [1, 0, 2]], read)


def test_the_few_rows_of_a_ramp_that_meet_late_tell_no_sign():
    """Its first third is below its mean and its last above, and more so the fewer rows meet."""
    ramp = np.linspace(-1.0, 1.0, 72)[:, None] * [1.0, 0.9]
    read = ramp + 0.2 * np.sin(np.arange(72) / 8.0)[:, None]
    refuse(ramp - ramp.mean(axis=0), read - read.mean(axis=0))


def test_a_sine_late_by_half_its_period_is_not_taken_for_a_turned_sign():
    t = np.arange(ROWS) / 50
    told = np.sin(2 * np.pi * t)[:, None]
    refuse(told, -told, latest=25)
    with pytest.raises(PlumblineError, match="turn the sign"):
        refuse(told, -told, latest=10)  # no drive is so late


@pytest.mark.parametrize(("cosine", "refused"), [(-0.78, False), (-0.82, True)])
def test_a_third_of_the_distance_is_the_limit(cosine, refused):
    rng = np.random.default_rng(3)
    a, b = np.linalg.qr(rng.normal(size=(ROWS, 2)))[0].T
    read = (cosine * a + np.sqrt(1 - cosine**2) * b)[:, None]
    if refused:
        with pytest.raises(PlumblineError, match=f"cosine {cosine:.2f}"):
            refuse(a[:, None], read, latest=0)
    else:
        refuse(a[:, None], read, latest=0)


def test_a_joint_that_stands_still_is_not_refused():
    told = motions()
    refuse(told * [1.0, 0.0, 1.0], told * [1.0, 1.0, 0.0])


@pytest.mark.parametrize("kind", ["position", "velocity", "rate"])
def test_a_motion_is_refused_whose_commands_are_mixed_up_and_only_then(kind):
    time = np.arange(ROWS) / 50
    places = 0.3 * motions(6)
    told = places if kind == "position" else np.gradient(places, time, axis=0)
    given = {"robot": "ur3", "time": time, "kind": kind}
    build_motion(command=told, q=places, **given)
    with pytest.raises(PlumblineError, match=r"q2 with u5.*exchange these columns"):
        build_motion(command=told[:, [0, 4, 2, 3, 1, 5]], q=places, **given)
    with pytest.raises(PlumblineError, match=r"q4 against u4"):
        build_motion(command=told * [1, 1, 1, -1, 1, 1], q=places, **given)


@pytest.mark.parametrize(("half_period", "refused"), [(0.9, False), (1.2, True)])
def test_a_second_is_the_latest_that_a_drive_obeys(half_period, refused):
    time = np.arange(ROWS) / 50
    told = 0.3 * np.sin(np.pi / half_period * time)[:, None] * np.ones(6)
    given = {"robot": "ur3", "time": time, "command": told, "q": -told}
    if refused:
        with pytest.raises(PlumblineError, match="turn the sign"):
            build_motion(**given)
    else:
        build_motion(**given)
