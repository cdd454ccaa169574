"""Channels that are read late are taken back, ends of sensors left aside: neither is a cause."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.constants import AT_ITS_END, BELIED, ENDS_OFF, ENDS_WITHIN, LATEST
from plumbline.optim.recording.efforts import efforts_within_ends, nominal_efforts
from plumbline.optim.recording.late import around, basis_of, late_by, rows_asked
from plumbline.optim.recording.mixed_up import refuse_mixed_up
from plumbline.optim.recording.table import Origin
from tests.answer_contract import contradicts_nothing
from tests.random_trees import Tree

TIME = np.arange(0.0, 8.0, 0.02)
NOISE = 0.02


@pytest.fixture(scope="module")
def robot():
    return Robot.from_urdf(Tree(3, ("revolute",) * 4).urdf())


def motion(time=TIME):
    """Places, velocities and accelerations (N, 4): sums of sines, no two joints alike."""
    rng = np.random.default_rng(1)
    w, phase = 2 * np.pi * rng.uniform(0.1, 0.9, (3, 4)), rng.uniform(0, 6, (3, 4))
    angle = w * time[:, None, None] + phase
    waves = 0.4 * np.sin(angle), 0.4 * w * np.cos(angle), -0.4 * w**2 * np.sin(angle)
    return tuple(x.sum(axis=1) for x in waves)


def recorded(
    robot, *, efforts=0.0, velocities=0.0, changed=lambda tau: tau, noise=NOISE, stated=None, seed=0
):
    """A log whose channels are read so late [s]; ``changed`` makes what is read of torques."""
    q, v, a = motion()
    tau = tree_of(robot).dynamics.torques(q, v, a)
    late, slow = (CubicSpline(TIME, x)(TIME - by) for x, by in ((tau, efforts), (v, velocities)))
    read = changed(late + np.random.default_rng(seed).normal(0.0, noise, tau.shape))
    kept = slice(20, -20)  # what is late is known before the first row and after the last
    return build_recording(
        observation="joint_torque", robot=robot, time=TIME[kept], q=q[kept], velocity=slow[kept],
        measured=read[kept], noise_by_joint=np.full(4, stated or noise),
    )  # fmt: skip


def told(recording):
    return [note for note in recording.notes if "taken back" in note]


@pytest.mark.parametrize("late", [0.06, -0.03])
def test_efforts_that_are_read_late_are_taken_back_and_are_no_cause(robot, late):
    rec = recorded(robot, efforts=late)
    (note,) = told(rec)
    assert float(note.split()[3]) == pytest.approx(1e3 * late, abs=1.0)
    assert rec.measured - nominal_efforts(rec) == pytest.approx(0.0, abs=8 * NOISE)
    assert all(cause.probability < 0.95 for cause in diagnose(rec).causes)


def sines(time):
    """Columns (N, 4) of which lateness makes others."""
    return np.sin(np.outer(time, [0.6, 1.5, 2.6, 3.8]))


def in_noise(seed, *, rows=6000, late=0.0, noise=0.3, first=False):
    """How late four channels of a log of so many rows seem, 2 ms apart [s]."""
    rng, time = np.random.default_rng(seed), 0.002 * np.arange(rows)
    read = sines(time - late) @ rng.normal(0.0, 1.0, (4, 4))
    read = read + rng.normal(0.0, noise, read.shape)
    there = np.eye(rows, 1)[:, : int(first)]  # a column of the first row alone
    X = np.column_stack([basis_of(sines(time)), there])
    return late_by(time, read, lambda asked: [X[asked]] * 4)


def test_other_readings_with_other_noise_are_not_taken_for_lateness():
    """Of a log too long to be asked whole each place tried had other rows: 9 of 16 were late."""
    assert [in_noise(seed) for seed in range(5)] == [0.0] * 5


@pytest.mark.parametrize("rows", [2500, 6000])
def test_lateness_is_found_in_a_log_of_any_length(rows):
    assert in_noise(0, rows=rows, late=0.005, noise=0.02) == pytest.approx(0.005, abs=5e-4)


@pytest.mark.parametrize("moves", [(4.0, 20.0), (4.0, 16.0), (0.0, 16.0)])
def test_lateness_is_found_wherever_in_a_long_log_the_robot_moves(moves):
    """Of a log at 1 kHz its first seconds alone had been asked."""
    rng, time = np.random.default_rng(0), 0.001 * np.arange(20_000)

    def columns(t):
        return sines(np.clip(t, *moves))

    mix = rng.normal(0.0, 1.0, (4, 4))
    read = columns(time - 0.005) @ mix + rng.normal(0.0, 0.02, (len(time), 4))
    X = basis_of(columns(time))
    assert late_by(time, read, lambda asked: [X[asked]] * 4) == pytest.approx(0.005, abs=1e-3)


def test_blocks_are_long_beside_their_margins_and_stand_all_over_a_log():
    time = 0.005 * np.arange(30_000)
    most = round(LATEST / 0.005)
    rows = rows_asked(time, most)
    assert len(around(rows, most)) < 1.3 * len(rows)
    assert np.sum(np.diff(rows) > 1) >= 5


def test_a_column_that_hardly_any_row_asked_has_breaks_nothing():
    assert in_noise(0, rows=1500, late=0.005, noise=0.02, first=True) == pytest.approx(
        5e-3, abs=5e-4
    )


@pytest.mark.parametrize("late", [0.01])
def test_velocities_that_are_read_late_are_taken_back_and_are_no_cause(robot, late):
    rec = recorded(robot, velocities=late)
    assert f"velocities are read {1e3 * late:.3g} ms after positions" in told(rec)[0]
    assert rec.measured - nominal_efforts(rec) == pytest.approx(0.0, abs=8 * NOISE)
    assert all(cause.probability < 0.95 for cause in diagnose(rec).causes)


def test_channels_that_are_in_time_are_left_as_they_are_whatever_their_drives_do(robot):
    def rubbed(tau):
        v = motion()[1]
        way = np.zeros_like(v)  # dry friction that builds up over 20 mrad
        for k in range(1, len(v)):
            way[k] = np.clip(way[k - 1] + 0.02 * v[k], -0.02, 0.02)
        return tau + 20.0 * way + 0.2 * v

    for rec in (recorded(robot), recorded(robot, changed=rubbed)):
        assert told(rec) == []
        assert len(rec) == len(TIME) - 40


@pytest.mark.parametrize("late", [0.01, -0.01])
def test_corners_of_dry_friction_between_rows_are_found_where_they_are(robot, late):
    """Rows on both sides blur them: from one place alone lateness comes out 1.5 ms off."""
    dry = 0.3 * np.sign(motion(TIME - late)[1])
    (note,) = told(recorded(robot, efforts=late, changed=lambda tau: tau + dry))
    assert float(note.split()[3]) == pytest.approx(1e3 * late, abs=0.6)


@pytest.mark.parametrize(("places", "rates", "told_by"), [(1e-5, 0.03, True), (1e-3, 1e-3, False)])
def test_rates_are_told_by_whatever_tells_them_with_less_noise(robot, places, rates, told_by):
    """Efforts 10 ms late under dry friction, joints slow: by noisy rates none were late."""
    time, rng = np.arange(0.0, 40.0, 0.02), np.random.default_rng(7)

    def slow(t):
        return [x * s for x, s in zip(motion(t / 3), (1.0, 1 / 3, 1 / 9), strict=True)]

    q, v, _ = slow(time)
    before = slow(time - 0.01)
    tau = tree_of(robot).dynamics.torques(*before) + 0.3 * np.sign(before[1])
    q, v, tau = (
        x + rng.normal(0.0, s, x.shape) for x, s in ((q, places), (v, rates), (tau, NOISE))
    )
    rec = build_recording(
        observation="joint_torque", robot=robot, time=time, q=q, velocity=v, measured=tau,
        noise_by_joint=np.full(4, NOISE),
    )  # fmt: skip
    assert any("told by positions" in note for note in rec.notes) is told_by
    (note,) = told(rec)
    assert float(note.split()[3]) == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(("late", "seen"), [(0.75 * LATEST, True), (1.5 * LATEST, False)])
def test_no_channel_is_later_than_the_latest(robot, late, seen):
    notes = told(recorded(robot, efforts=late))
    assert (f"{1e3 * late:.3g}" in "".join(notes)) is seen


@pytest.mark.parametrize(("noise", "seen"), [(0.75, True), (1.5, False)])
def test_a_channel_is_late_where_that_is_surely_more_probable(robot, noise, seen):
    """At 0.45 N m of noise half a row is as much: a likelihood falls with the square of it."""
    assert bool(told(recorded(robot, efforts=0.01, noise=0.45 * noise))) is seen


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_a_few_short_stretches_that_as_many_columns_fit_say_nothing_of_lateness(seed):
    """Six of half a second: less what is trimmed for the latest, 36 rows for 40 columns."""
    robot, rng = Robot.from_urdf(Tree(3, ("revolute",) * 6).urdf()), np.random.default_rng(seed)
    time = (3.0 * np.arange(6)[:, None] + 0.02 * np.arange(26)).ravel()
    w, phase = 2 * np.pi * rng.uniform(0.05, 0.35, (3, 6)), rng.uniform(0, 6, (3, 6))
    angle = w * time[:, None, None] + phase
    waves = 0.4 * np.sin(angle), 0.4 * w * np.cos(angle), -0.4 * w**2 * np.sin(angle)
    q, v, a = (x.sum(axis=1) for x in waves)
    tau = tree_of(robot).dynamics.torques(q, v, a) + np.tanh(v / 0.05) + 0.5 * v
    read = tau + rng.normal(0.0, 0.3, tau.shape)
    rec = build_recording(
        observation="joint_torque", robot=robot, time=time, q=q, velocity=v, measured=read,
        noise_by_joint=np.full(6, 0.3),
    )  # fmt: skip
    assert told(rec) == []
    assert len(rec) == len(time)


def test_two_joints_that_carry_one_weight_are_told_apart_by_size():
    """Where their efforts run together by more than 0.99, directions alone say nothing."""
    own = np.sin(0.7 * TIME) + 0.3 * np.sin(2.3 * TIME + 1.0)
    tau = np.column_stack([own, 0.6 * own + 0.02 * np.sin(1.7 * TIME), np.cos(1.1 * TIME)])
    assert np.corrcoef(tau.T)[0, 1] > 0.99
    letters = ("the model's effort", "effort")
    refuse_mixed_up(tau, tau * [0.9, 1.1, 1.0], letters, Origin())
    with pytest.raises(PlumblineError, match="effort1 with the model's effort2"):
        refuse_mixed_up(tau, tau[:, [1, 0, 2]] * [0.95, 1.05, 1.0], letters, Origin())


def at_its_end(robot, rows, joint=2, off=0.0):
    """Efforts of a joint cut where so many rows are beyond."""
    return lambda tau: np.minimum(
        tau, np.where(np.arange(4) == joint - 1, np.sort(tau[20:-20], axis=0)[-rows] + off, np.inf)
    )


@pytest.mark.parametrize(("share", "left"), [(0.75, False), (1.5, True), (8.0, True)])
def test_rows_in_which_a_sensor_reads_its_end_are_left_aside(robot, share, left):
    rows = round(share * AT_ITS_END)
    rec = recorded(robot, changed=at_its_end(robot, rows))
    assert (len(rec) == len(TIME) - 40 - rows) is left
    assert any("a sensor's end" in note for note in rec.notes) is left
    if share > 2:
        assert all(cause.probability < 0.95 for cause in diagnose(rec).causes)


def test_what_reads_one_value_throughout_has_no_end(robot):
    rec = recorded(robot)
    read = rec.measured.copy()
    read[:, 1] = 3.0
    assert len(efforts_within_ends(replace(rec, measured=read))) == len(rec)


@pytest.mark.parametrize("step", [0.2, 1.0])
def test_a_coarse_sensor_has_no_end(robot, step):
    """A slow crest reads its last step more often than the next ones, not twice as often."""
    assert ENDS_WITHIN == 3.5
    rec = recorded(robot, changed=lambda tau: np.round(tau / step) * step)
    assert len(rec) == len(TIME) - 40


@pytest.mark.parametrize(("share", "left"), [(0.75, False), (1.5, True)])
def test_where_the_model_hardly_changes_a_load_is_held(robot, share, left):
    """A sensor that reads one value for long has an end only if the model goes beyond it."""
    rec = recorded(robot)
    model, end = nominal_efforts(rec)[:, 1], 40.0
    spread = share * ENDS_OFF * end
    middle = np.median(model)
    at = np.abs(model - middle) < spread / 2
    at[np.argmin(np.abs(model - middle - spread / 2))] = True
    read = rec.measured.copy()
    read[at, 1] = end
    found = efforts_within_ends(replace(rec, measured=read))
    assert (len(found) < len(rec)) is left


@pytest.mark.parametrize(
    ("kept", "seed"), [(np.arange(250), 2), (np.r_[0:120, 170:260, 320:360], 0)]
)
def test_logs_of_efforts_one_or_back_to_back_are_motions_that_lack_nothing(robot, kept, seed):
    """No joint accelerates from the end of one to the beginning of the next.

    Nor does smoothing take so much of any acceleration that another mass would explain it.
    """
    whole = recorded(robot, seed=seed)
    rec = build_recording(
        observation="joint_torque", robot=robot, time=0.02 * np.arange(len(kept)), q=whole.q[kept],
        measured=whole.measured[kept], noise_by_joint=np.full(4, NOISE),
    )  # fmt: skip
    seams = int((np.diff(kept) > 1).sum())
    assert any(f"elsewhere at once {seams} times" in note for note in rec.notes) is (seams > 0)
    assert np.abs(rec.acceleration).max() < 1.2 * np.abs(motion()[2]).max()
    verdict = diagnose(rec).verdict
    assert verdict.verdict == "no-gap"
    contradicts_nothing(verdict)
    assert not any("elsewhere" in note for note in whole.notes)


@pytest.mark.parametrize(("times", "seen"), [(2.0, False), (4.0, True)])
def test_efforts_that_scatter_by_far_more_than_is_stated_tell_their_noise(robot, times, seen):
    """Friction of a joint hides in what would else be told of every reading's noise."""
    dry = 0.3 * np.sign(motion()[1]) * (np.arange(4) == 3)
    rec = recorded(robot, stated=NOISE / times, changed=lambda tau: tau + dry)
    assert BELIED == 3.0
    assert any(note.startswith("efforts of joint 4 scatter by 0.02") for note in rec.notes) is seen
    assert bool(rec.noise_by_joint[3] == pytest.approx(NOISE, rel=0.15)) is seen
    if times > BELIED:
        found = [(c.effect, c.element) for c in diagnose(rec).verdict.causes]
        assert found == [("coulomb_friction", 4)]
