"""What no drive makes of its commands is refused by name: other units, other commands, turns."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline import diagnose
from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion.recording import build_motion, load_motion
from plumbline.optim.diagnosis.motion.tracking import build_tracking
from plumbline.optim.recording.constants import TURNS
from tests.motions import recorded

TIME = np.arange(0.0, 20.0, 0.02)
WAVES = (0.5, 0.9, 1.4, 2.3)  # [rad/s]: no one sine, of which a delay makes anything


def way(joint):
    """Places of a joint (N,) [rad]."""
    return np.sum([0.2 * np.sin(w * TIME + 2 * k + joint) for k, w in enumerate(WAVES)], axis=0)


def speed(joint):
    return np.sum([0.2 * w * np.cos(w * TIME + 2 * k + joint) for k, w in enumerate(WAVES)], axis=0)


Q, V = (np.stack([of(j) for j in range(2)], axis=1) for of in (way, speed))


def motion(command, q=Q, **given):
    robot = Robot.from_dh([{"a": 0.3, "mass": 1.0}, {"a": 0.2, "mass": 0.5}])
    return build_motion(robot=robot, time=TIME, command=command, q=q, noise_std=1e-4, **given)


def late(rows):
    """Places that are so many rows late."""
    return np.concatenate([np.repeat(Q[:1], rows, axis=0), Q[:-rows]])


@pytest.mark.parametrize(
    ("command", "kind", "words"),
    [
        (Q, "velocity", 'move q as position does .*write command = "position"'),
        (Q, "rate", 'move q as position does .*write command = "position"'),
        (V, "position", 'move q as velocity does .*write command = "velocity"'),
    ],
)
def test_commands_of_another_kind_than_stated_are_refused_by_name(command, kind, words):
    with pytest.raises(PlumblineError, match=words):
        motion(command, kind=kind)
    with pytest.raises(PlumblineError, match=words):
        motion(command, late(10), kind=kind)


@pytest.mark.parametrize("period", [None, 15.0])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_velocities_in_the_place_of_positions_are_refused_by_name(period, noise):
    """One slow sine, too: no drive leads its commands by a quarter of it."""
    turn = 2 * np.pi / (period or 1.0)
    told, rates = (
        (Q, V)
        if period is None
        else (
            np.sin(turn * TIME)[:, None] * [0.4, 0.3],
            turn * np.cos(turn * TIME)[:, None] * [0.4, 0.3],
        )
    )
    q = rates + noise * np.random.default_rng(0).normal(size=rates.shape)
    with pytest.raises(PlumblineError, match=r"q that moves as its velocity does.*write places"):
        motion(told, q)
    with pytest.raises(PlumblineError, match="or places into q if it holds velocities"):
        motion(V, V, kind="velocity")


def test_commands_of_another_kind_are_refused_where_the_settings_say_their_kind(tmp_path):
    toml = '[motion]\ncommand = "velocity"\n[[robot.dh]]\na = 0.3\n[[robot.dh]]\na = 0.2\n'
    (tmp_path / "dataset.toml").write_text('observation = "motion"\n' + toml)
    rows = np.column_stack([TIME, Q, Q])
    np.savetxt(tmp_path / "samples.csv", rows, "%.9g", ",", header="time,u1,u2,q1,q2", comments="")
    with pytest.raises(PlumblineError, match=r"^dataset.toml, row 3, \[motion\] command: "):
        load_motion(tmp_path)


@pytest.mark.parametrize(("rows", "scale"), [(1, 1.0), (20, 1.0), (45, 1.0), (10, 0.4), (10, 2.8)])
def test_late_and_scaled_drives_are_taken_as_they_are(rows, scale):
    motion(Q, scale * late(rows))
    motion(
        V + 0.1, scale * (late(rows) + 0.1 * TIME[:, None]), kind="velocity"
    )  # it drifts as well


def test_a_sine_late_by_a_quarter_is_no_velocity():
    one = 0.4 * np.sin(2 * np.pi * TIME)[:, None]
    robot = Robot.from_dh([{"a": 0.3}])
    for late_by in (0.25, 0.5, 0.75):
        q = 0.4 * np.sin(2 * np.pi * (TIME - late_by))[:, None]
        build_motion(robot=robot, time=TIME, command=one, q=q)


@pytest.mark.parametrize(("times", "refused"), [(640.0, False), (690.0, True), (1460.0, True)])
def test_tips_and_rates_in_two_units_are_refused(times, refused):
    small = {"rate": 1e-3 * V, "x": 1e-3 * Q}
    for name, column in (("rate", "u1"), ("x", "x1")):
        scaled = {"time": TIME} | small | {name: times * small[name]}
        if not refused:
            build_tracking(**scaled)
            continue
        with pytest.raises(PlumblineError, match=f"column '{column}'.*divide by 1000 if in mm"):
            build_tracking(**scaled)


@pytest.mark.parametrize(
    ("times", "unit"), [(57.3, "57.3 if in degrees"), (1e3, "1000: time in ms")]
)
def test_rates_of_joints_in_degrees_or_by_a_clock_in_ms_are_refused(times, unit):
    with pytest.raises(PlumblineError, match=f"column 'u1'.*divide by {unit}"):
        motion(times * V, kind="velocity")


@pytest.mark.parametrize(("times", "said"), [(0.95, False), (1.05, True)])
def test_places_of_many_turns_that_limits_allow_are_doubted_in_a_note(times, said):
    """A file in degrees has limits in degrees: commands and places then agree with all three."""
    link = '<link name="{}"><inertial><mass value="1"/></inertial></link>'
    joint = (
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
        '<limit lower="-360" upper="360" effort="1" velocity="180"/></joint>'
    )
    urdf = f'<robot name="one">{link.format("a")}{link.format("b")}{joint}</robot>'
    q = times * TURNS / np.abs(Q[:, :1]).max() * Q[:, :1]
    notes = build_motion(robot=Robot.from_urdf(urdf), time=TIME, command=q, q=q).notes
    assert any("q1 is read up to 13.19 rad, 2.1 turns" in note for note in notes) is said


def test_readings_that_leap_by_a_turn_are_told_at_their_row():
    q = (Q + 3.0 + np.pi) % (2 * np.pi) - np.pi
    row, joint = np.argwhere(np.abs(np.diff(q, axis=0)) > np.pi)[0] + 1
    with pytest.raises(PlumblineError, match=rf"row {row} .*column 'q{joint}'.*numpy.unwrap"):
        motion(Q + 3.0, q)
    motion(np.unwrap(q, axis=0), np.unwrap(q, axis=0))


@pytest.mark.parametrize(("off", "refused"), [(0.45, False), (-0.55, True), (2 * np.pi, True)])
def test_zeros_farther_apart_than_an_offset_may_be_are_refused(off, refused):
    q = Q + np.array([0.0, off])
    if not refused:
        motion(Q, q)
        return
    with pytest.raises(PlumblineError, match=r"column 'q2'.* rad off u2.*take it off"):
        motion(Q, q)


def test_where_nothing_moves_there_is_no_motion():
    with pytest.raises(PlumblineError, match=r"'u1': found the same .* in every row.*record one"):
        motion(0.0 * Q, 0.0 * Q)


def test_runs_of_rates_that_begin_anywhere_are_one_recording():
    run = np.arange(len(TIME)) // 250
    motion(V, Q + 0.7 * run[:, None], kind="velocity", group=run)


def test_a_delay_of_less_than_a_row_may_be_a_controller_that_holds_its_commands():
    answer = diagnose(recorded([{"delay": 0.0185}, {"delay": 0.0215}], seconds=20.0, dt=0.02))
    told = [note for note in answer.verdict.notes if "controller holds" in note]
    assert len(told) == 1
    assert told[0].startswith("drive 1 is late by less than a row's 20 ms")
    assert told[0].endswith("late by 10 ms")


def test_joints_that_lead_their_commands_have_a_log_that_states_those_late():
    """Were the delay never less than none, what is left would be something unlisted."""
    r = recorded([{}, {"lag": 0.05}], seconds=20.0, dt=0.01)
    answer = diagnose(replace(r, command=np.concatenate([r.command[:1], r.command[:-1]])))
    delays = {c.element: c.parameters["delay"] for c in answer.causes if "delay" in c.parameters}
    assert {j: d.value for j, d in delays.items()} == pytest.approx({1: -0.01, 2: -0.01}, abs=1e-3)
    assert answer.outside_probability < 0.5
    told = [note for note in answer.verdict.notes if "logged late" in note]
    assert [note[:7] for note in told] == ["drive 1", "drive 2"]
    assert all("half a row, 5 ms" in note for note in told)


@pytest.mark.parametrize(("kind", "told"), [("velocity", 'write command = "rate"'), ("rate", "")])
def test_rates_that_are_held_are_called_so(kind, told):
    step = TIME[1] - TIME[0]
    q = np.concatenate([np.zeros((1, 2)), np.cumsum(step * V[:-1], axis=0)])
    q += np.random.default_rng(0).normal(0.0, 1e-4, q.shape)
    answer = diagnose(motion(V, q, kind=kind))
    notes = [note for note in answer.verdict.notes if "controller holds" in note]
    assert len(notes) == (2 if told else 0)
    assert all(note.endswith(told) for note in notes)


@pytest.mark.parametrize(("far", "refused"), [(1.1, True), (0.9, False)])
def test_a_joint_that_stands_where_it_is_told_beyond_any_dead_band_has_no_drive(far, refused):
    """A band is .2 rad wide at most, and moves a joint by the whole error from twice that on."""
    rng, command, q = np.random.default_rng(0), Q.copy(), Q.copy()
    command[:, 1] *= far * 0.4 / np.abs(command[:, 1]).max()
    q[:, 1] = rng.normal(0.0, 1e-4, len(q))
    if not refused:
        assert motion(command, q)
    else:
        with pytest.raises(PlumblineError, match=r"'q2': found .* rad in every row while u2 moves"):
            motion(command, q)


def test_a_joint_that_is_told_to_rest_and_trembles_is_taken_without_a_warning():
    rng = np.random.default_rng(0)
    command = Q * [1.0, 0.0]
    read = motion(command, command + rng.normal(0.0, 1e-4, Q.shape))
    assert read.n == 2
