"""Rows as a log has them: back to back, by stamps that jitter; drives are told all the same."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from plumbline import build_motion, diagnose
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion import diagnose as module
from plumbline.optim.diagnosis.motion.constants import ROUNDED, SMOOTHER
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.recording.constants import SPEEDS_UP, USUAL
from plumbline.optim.recording.derivatives import elsewhere
from tests.motions import FINE, arm, multisine, servo

NOISE, DT = 2e-4, 0.02


def made(t, u, q, **given):
    q = q + np.random.default_rng(5).normal(0.0, NOISE, q.shape)
    return build_motion(robot=arm(), time=t, command=u, q=q, noise_std=NOISE, **given)


def driven(t, u, *effects):
    return np.column_stack([servo(t, u[:, j], **e) for j, e in enumerate(effects)])


def runs(*effects, apart=0.4, count=3, seconds=12.0):
    """Commands and places (N, 2) of logs that lie back to back, each elsewhere."""
    u, q = [], []
    for k in range(count):
        t, told = multisine(seconds, DT, seed=k)
        told = told - told[0] + (u[-1][-1] if k else 0.0) + apart
        u.append(told)
        q.append(driven(t, told, *effects))
    u, q = np.vstack(u), np.vstack(q)
    return DT * np.arange(len(u)), u, q


def found(answer):
    return [(c.effect, c.element) for c in answer.verdict.causes]


def test_logs_back_to_back_are_motions_of_their_own():
    """What is late in each was told as play of 12 mrad, and something unlisted."""
    r = made(*runs({"delay": 0.04}, {}))
    assert len(np.unique(r.group)) == 3
    assert any("rows 602, 1202 on: motions of their own" in note for note in r.notes)
    assert len(np.unique(signals_of(r).first)) == 3
    answer = diagnose(r)
    assert found(answer) == [("actuation_delay", 1)]
    assert answer.verdict.outside_probability < 0.05
    assert answer.verdict.gap.held_out_by == "groups"


@pytest.mark.parametrize(("share", "apart"), [(0.75, False), (1.5, True)])
def test_only_what_no_joint_moves_by_is_a_log_s_end(share, apart):
    t, u = multisine(24.0, DT)
    half = len(t) // 2
    jump = share * SPEEDS_UP * np.abs(np.diff(u, axis=0)).max(axis=0)
    u[half:] += u[half - 1] - u[half] + jump
    assert (made(t, u, u).group is not None) is apart
    assert made(t, u, np.cumsum(DT * u, axis=0), kind="velocity").group is None  # told, not there


@pytest.mark.parametrize(("leaps", "ends"), [(15, 15), (40, 0)])
def test_what_leaps_more_often_than_each_fifty_rows_is_no_motion(leaps, ends):
    step = np.full(1000, 1e-3)
    step[np.linspace(10, 990, leaps).astype(int)] = 1.0
    assert elsewhere(np.cumsum(step)[:, None]).sum() == ends


def test_steps_are_no_ends_of_a_log_and_nor_are_readings_that_leap():
    t = DT * np.arange(2000)
    u = np.repeat(np.array([0.0, 0.3, -0.2, 0.5, 0.1]), 400)[:, None] * [1.0, 0.7]
    assert made(t, u, driven(t, u, {"lag": 0.05}, {"delay": 0.04})).group is None
    t, u = multisine(24.0, DT)
    q = u.copy()
    q[700] += 1.0
    assert made(t, u, q).group is None
    assert USUAL == 0.99


def jittered(jitter, seed=0):
    t, u = multisine(30.0, DT)
    stamps = t + np.random.default_rng(seed).uniform(-jitter, jitter, len(t)) * DT
    return stamps, t, u


def test_stamps_that_jitter_about_an_even_clock_make_no_servo():
    """Read by their stamps, rows had a servo of second order (0.99) in a delay's place."""
    stamps, t, u = jittered(0.3)
    r = made(stamps, u, driven(t, u, {"delay": 0.04}, {}))
    assert any("stamps jitter by up to 6" in note for note in r.notes)
    assert np.ptp(np.diff(r.time)) == pytest.approx(0.0, abs=1e-9)
    answer = diagnose(r)
    assert found(answer) == [("actuation_delay", 1)]
    assert answer.verdict.causes[0].parameters["delay"].value == pytest.approx(0.04, abs=1e-4)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_stamps_are_told_from_an_even_clock_however_noisy_the_readings(jitter):
    """By their roughness alone noise of 15 times what a jitter does had hidden it."""
    stamps, t, u = jittered(0.2)
    there = np.column_stack([np.interp(t if jitter else stamps, t, x) for x in u.T])
    q = there + np.random.default_rng(2).normal(0.0, 4e-3, u.shape)
    r = build_motion(robot=arm(), time=stamps, command=there, q=q)
    assert (len(r.notes) == 1) is bool(jitter)
    assert np.array_equal(r.time, stamps) is not bool(jitter)


def test_rows_that_were_read_when_their_stamps_say_keep_them():
    stamps, t, u = jittered(0.3)
    there = np.column_stack([np.interp(stamps, t, x) for x in u.T])
    r = made(stamps, there, there)
    np.testing.assert_array_equal(r.time, stamps)
    assert made(t, u, u).notes == ()


@pytest.mark.parametrize(("share", "even"), [(0.7, False), (1.6, True)])
def test_stamps_that_are_rounded_are_left(share, even):
    """To a hundredth of a step, as four digits of a second are at 100 Hz."""
    stamps, t, u = jittered(share * ROUNDED)
    slow = 0.5 * np.sin(np.outer(0.2 * t, [1.0, 0.7]))  # which shows the least that a clock jitters
    r = build_motion(robot=arm(), time=stamps, command=np.zeros_like(u), q=slow, kind="torque")
    assert (len(r.notes) == 1) is even
    assert r.law is Law.TORQUE
    assert SMOOTHER == 5.0


def test_readings_in_coarse_steps_say_nothing_of_a_clock():
    """At rest they are off no line: by which clock is the same."""
    stamps, _, u = jittered(0.05)
    u = np.repeat(u[::100], 100, axis=0)  # steps that are held
    q = np.round(driven(DT * np.arange(len(u)), u, {"lag": 0.1}, {"lag": 0.1}) / 2e-2) * 2e-2
    r = build_motion(robot=arm(), time=stamps, command=u, q=q)
    np.testing.assert_array_equal(r.time, stamps)


def smooth(lag, delay, step=DT, seconds=30.0):
    """A log of commands that run smoothly between its rows; the first joint lags (exactly)."""
    h = step / 20
    t, u = multisine(seconds, h, size=0.4, fastest=1.5)
    x = np.interp(t - delay, t, u[:, 0])
    stays, rows = np.exp(-h / lag), slice(None, None, 20)
    late = (1 - stays) * lag / h
    q = lfilter([1 - late, late - stays], [1, -stays], x, zi=[late * x[0]])[0]
    return made(t[rows], u[rows], np.column_stack([q, u[:, 1]])[rows])


@cache
def lagging(delay):
    """The diagnosis of such a lag, and by what law between rows each joint was searched."""
    searched, own = [], module.search
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "search", lambda *a: searched.append(a[0].windows.law) or own(*a))
        return diagnose(smooth(0.05, delay, seconds=16.0)), searched


def test_what_commands_do_between_rows_is_chosen_before_the_search():
    answer, searched = lagging(0.0)
    assert searched == [Law.SMOOTH] * answer.recording.n


@pytest.mark.parametrize("delay", [0.0, 0.033])
def test_a_lag_under_commands_that_run_smoothly_between_rows_is_no_servo_of_second_order(delay):
    answer, _ = lagging(delay)
    assert set(found(answer)) == {("actuation_lag", 1)} | (
        {("actuation_delay", 1)} if delay else set()
    )
    values = {c.effect: next(iter(c.parameters.values())) for c in answer.causes}
    assert values["actuation_lag"].value == pytest.approx(0.05, abs=1e-4)
    assert any("smoothly between rows" in note for note in answer.verdict.notes)
    again = answer.model().rollout(answer.recording.time, answer.recording.command)
    assert np.sqrt(np.mean((again - answer.recording.q)[100:] ** 2)) < 1.1 * NOISE


def test_a_delay_by_a_part_of_a_row_is_exact_beside_a_lag_under_straight_commands():
    """Its corners lie within a step, of which the drive takes the mean."""
    t, u = multisine(18.0, DT, size=0.4, fastest=1.5)
    answer = diagnose(made(t, u, driven(t, u, {"delay": 0.032, "lag": 0.05}, {})))
    values = {c.effect: next(iter(c.parameters.values())).value for c in answer.causes}
    half = DT / FINE / 2  # by which small steps lead
    assert values["actuation_delay"] == pytest.approx(0.032 - half, abs=1e-4)
    assert values["actuation_lag"] == pytest.approx(0.05, abs=1e-4)
    assert not any("smoothly between rows" in note for note in answer.verdict.notes)


def test_what_a_joint_carries_is_worked_out_where_it_is_however_fast_it_swings():
    """Cubics over 0.3 s had taken 4 % of a swing of 2 Hz away, and its droop was something else."""
    t = np.arange(0.0, 12.0, DT)
    q = 0.5 * np.sin(2 * np.pi * np.array([2.0, 1.3]) * t[:, None])
    signals = signals_of(build_motion(robot=arm(), time=t, command=q, q=q))
    inner = slice(15, -15)
    assert np.abs(signals.posture - q)[inner].max() < 0.5 * 0.005
