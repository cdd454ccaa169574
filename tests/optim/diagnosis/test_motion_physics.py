"""Drives against MuJoCo, which shares no code with them, and against closed forms."""

from dataclasses import replace
from functools import cache

import casadi as cs
import mujoco
import numpy as np
import pytest
from mujoco.rollout import rollout as rollout_of_mujoco
from scipy.signal import lsim, lti

from plumbline import build_motion, diagnose, load
from plumbline.errors import PlumblineError
from plumbline.kinematics import drive
from plumbline.kinematics.drive import Drive, Memory
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.velocity_limit import VelocityLimit
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion import rollout
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.windows import Windows

KP, KD, STEP, EVERY = 60.0, 3.0, 1e-3, 10
FINER = 10  # times in which a rotor of the integrator's own making goes under
NAMES = {e.name: e for e in MOTION_EFFECTS}
URDF = """<robot name="two"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>
<link name="l1"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
<inertia ixx="0.004" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="b" type="revolute"><origin xyz="0.3 0 0"/><parent link="l1"/><child link="l2"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="10"/></joint>
<link name="l2"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.002" iyy="0.008" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""
MJCF = """<mujoco><option timestep="{step}" integrator="implicitfast"/><worldbody><body name="l1">
<joint name="a" axis="0 1 0"/><inertial pos="0.15 0 0" mass="2" diaginertia="0.004 0.02 0.02"/>
<body name="l2" pos="0.3 0 0"><joint name="b" axis="0 1 0"/>
<inertial pos="0.1 0 0" mass="1" diaginertia="0.002 0.008 0.008"/></body></body></worldbody>
<actuator><position joint="a" kp="{kp}" kv="{kd}" {limit}/><position joint="b" kp="{kp}" kv="{kd}"/>
</actuator></mujoco>"""


def waves(seconds=10.0, step=STEP):
    """Fine times (N,) [s] and commands (N, 2) [rad]."""
    t = np.arange(0.0, seconds, step)
    a = 0.4 * np.sin(2.0 * t) + 0.2 * np.sin(7.0 * t + 1.0)
    b = 0.3 * np.sin(3.1 * t + 0.5) + 0.2 * np.sin(9.0 * t)
    return t, np.column_stack([a, b])


@cache
def driven(delay=0.0, strongest=None, kp=KP, rotor=0.0, held=False):
    """Fine times (N,), commands and positions (N, 2) of MuJoCo's arm under the servo's law.

    Its commands may be held from row to row. Its steps are implicit in the damping, which adds
    half of it times a step to the inertia.
    """
    t, u = waves(step=STEP / FINER)
    limit = "" if strongest is None else f'forcerange="-{strongest} {strongest}"'
    model = mujoco.MjModel.from_xml_string(MJCF.format(step=t[1], kp=kp, kd=KD, limit=limit))
    model.dof_armature[0] = rotor
    late = np.column_stack([np.interp(t - delay, t, u[:, 0]), u[:, 1]])
    late = late[np.arange(len(t)) // (EVERY * FINER) * (EVERY * FINER)] if held else late
    begin = np.array([0.0, *u[0], 0.0, 0.0])  # time, places, speeds
    after, _ = rollout_of_mujoco(model, mujoco.MjData(model), begin, late)
    return t, u, np.concatenate([u[:1], after[0, :-1, 1:3]])


def moved(*, noise=1e-4, **wrong):
    """A recording of it at 100 Hz."""
    t, u, q = driven(**wrong)
    q = q + np.random.default_rng(0).normal(0.0, noise, q.shape)
    rows = slice(None, None, EVERY * FINER)
    return build_motion(
        robot=Robot.from_urdf(URDF), time=t[rows], command=u[rows], q=q[rows], kp=KP, kd=KD,
        noise_std=noise,
    )  # fmt: skip


@pytest.mark.parametrize("held", [True, False])
def test_commands_that_a_servo_holds_from_row_to_row_are_no_delay(held):
    """Half a row that every joint is late by is the hold: beside it what is late is told as it is.

    One joint that is late by as much beside another that is not is late by itself.
    """
    answer = diagnose(moved(noise=1e-3, held=held))
    assert answer.verdict.causes == ()
    assert answer.verdict.gap.before < 1.1 * 1e-3
    assert any("commands are taken to stand" in note for note in answer.verdict.notes) is held
    found = diagnose(moved(noise=1e-3, held=held, delay=0.03)).verdict.causes
    assert [(c.effect, c.element) for c in found] == [("actuation_delay", 1)]
    assert found[0].parameters["delay"].value == pytest.approx(0.03, abs=2e-4)


def test_a_delay_by_a_part_of_a_row_is_no_rotor():
    """Late commands turn corners within a step: a line past them had been a lag and a rotor."""
    found = diagnose(moved(noise=1e-3, delay=0.005)).verdict.causes
    assert [(c.effect, c.element) for c in found] == [("actuation_delay", 1)]
    assert found[0].parameters["delay"].value == pytest.approx(0.005, abs=1e-4)


def test_drives_whose_commands_are_held_foretell_motions_by_the_same_gains(tmp_path):
    found = diagnose(moved(noise=1e-3, held=True, rotor=0.05))
    assert [(c.effect, c.element) for c in found.verdict.causes] == [("rotor_inertia", 1)]
    found.model().save(tmp_path / "drives.toml")
    before, after = load(tmp_path / "drives.toml").gaps(moved(noise=1e-3, held=True, rotor=0.05))
    assert before[0] > 5 * after[0]
    assert after == pytest.approx(1e-3, rel=0.05)
    with pytest.raises(PlumblineError, match="expected 2 by held_servo"):
        found.model().gaps(replace(found.recording, law=Law.POSITION))


@pytest.mark.parametrize(
    ("wrong", "name", "value"),
    [
        ({"strongest": 9.0}, "torque_limit", 9.0),
        ({"kp": 40.0}, "servo_stiffness", 1 / 40.0 - 1 / KP),
        ({"rotor": 0.05}, "rotor_inertia", 0.05),
    ],
)
def test_what_is_wrong_with_a_servo_of_mujoco_is_named(wrong, name, value):
    answer = diagnose(moved(**wrong, noise=2e-3))
    first = [c for c in answer.verdict.causes if c.element == 1]
    assert [c.effect for c in first][:1] == [name]
    (estimate,) = first[0].parameters.values()
    assert estimate.value == pytest.approx(value, rel=0.1)


def test_a_dead_band_beyond_which_the_rest_acts_alone_is_a_play_inside_of_the_loop():
    """So a servo on position has both, and neither is ever sure without the other."""
    names = ("actuation_deadband", "actuation_play")
    forms = [e for n in names for e in NAMES[n].candidates(Law.POSITION, masses=True) if e.variant]
    u, zeros, ones = 0.2 * np.sin(0.03 * np.arange(400)), np.zeros(400), np.ones(400)
    start, first = np.array([10]), np.zeros(400, np.int64)
    windows = Windows(
        Law.POSITION, 0.01, 0.0, 0.0, u, first, *[zeros] * 4, ones, start, 300, 1
    )  # fmt: skip
    lag = NAMES["actuation_lag"]()
    band, play = (roll_out(windows, (e, lag), np.array([0.02, 0.05]))[0] for e in forms)
    np.testing.assert_allclose(band, play, atol=1e-14)
    assert np.abs(band - roll_out(windows, (lag,), np.array([0.05]))[0]).max() > 0.01


def pushed_back(u, load, dt=0.01, length=300):
    """A window (1, length) of commands and loads (N,), from rest at zero."""
    zeros, start = np.zeros(len(u)), np.array([10])
    return Windows(
        Law.POSITION, dt, 0.0, 0.0, u, zeros.astype(np.int64), zeros, zeros, zeros, load,
        zeros + 1, start, length, 1,
    )  # fmt: skip


def test_a_position_loop_is_as_late_with_its_load_as_with_its_command():
    r"""By steps: :math:`s^2 \ddot q + 2 s \dot q + q = c - k h`, which inertia and gains make."""
    t, k, period = np.arange(400) * 0.01, 0.03, 0.5
    u, load = np.zeros(400), 2.0 * np.sin(5.0 * np.maximum(t - 0.5, 0.0))
    q, v, s, fine = 0.0, 0.0, period / (2 * np.pi), 50
    way = []
    for h in np.interp(np.arange(400 * fine) * 0.01 / fine, t, load):
        v += 0.01 / fine * (-k * h - q - 2 * s * v) / s**2
        q += 0.01 / fine * v
        way.append(q)
    effects = (NAMES["servo_stiffness"](inside=True), NAMES["servo_bandwidth"]())
    windows = pushed_back(u, load)
    there = roll_out(windows, effects, np.array([k, period]))[0]
    expected = np.array(way)[fine - 1 :: fine][windows.samples - 1]
    np.testing.assert_allclose(there, expected, atol=2e-4)
    at_once = -k * load[windows.samples]
    assert np.abs(there - at_once).max() > 0.02


def test_a_joint_that_sticks_does_not_yield_inside_of_its_loop():
    u, load = np.zeros(400), np.linspace(0.0, 1.0, 400)
    lags = NAMES["actuation_lag"]()
    sticks = NAMES["actuation_play"](inside=True)
    stays, yields = (
        roll_out(pushed_back(u, load), (sticks, lags, e), np.array([0.05, 0.03, 0.04]))[0]
        for e in (NAMES["servo_stiffness"](inside=True), NAMES["servo_stiffness"]())
    )
    assert np.ptp(stays[0, 50:]) < 1e-12  # where it came to rest
    assert np.ptp(yields[0, 50:]) > 0.02


@pytest.mark.parametrize("less", [False, True])
def test_a_dead_band_without_a_lag_is_a_play_under_a_load_too(less):
    rng = np.random.default_rng(0)
    u, load = 0.2 * np.sin(0.03 * np.arange(400)), rng.normal(size=400).cumsum() / 10
    zeros, start, first = np.zeros(400), np.array([10]), np.zeros(400, np.int64)
    windows = Windows(
        Law.POSITION, 0.01, 0.0, 0.0, u, first, zeros, zeros, zeros, load, zeros + 1, start, 300, 1
    )  # fmt: skip
    yields, values = NAMES["servo_stiffness"](), np.array([0.02, 0.03])
    band, play = (
        roll_out(windows, (one, yields), values)[0]
        for one in (NAMES["actuation_deadband"](less=less), NAMES["actuation_play"]())
    )
    np.testing.assert_allclose(band, play, atol=1e-14)


def test_a_servo_that_yields_and_heeds_no_small_error_stays_where_it_was_measured():
    u, load, zeros = np.full(400, 0.3), np.linspace(2.0, 2.1, 400), np.zeros(400)
    q = u - 0.05 * load + 0.01  # yields by so much, and is half a band off besides
    windows = Windows(
        Law.POSITION, 0.01, 0.0, 0.0, u, zeros.astype(np.int64), q, q, zeros, load, zeros + 1,
        np.array([20]), 300, 1,
    )  # fmt: skip
    effects = tuple(
        NAMES[name]() for name in ("actuation_deadband", "servo_bandwidth", "servo_stiffness")
    )
    there, J = roll_out(windows, effects, np.array([0.02, 0.2, 0.05]))
    np.testing.assert_allclose(there, q[windows.samples], atol=1e-12)
    begun = load[windows.passes[0][0]]
    np.testing.assert_allclose(J[0, :, 2], begun - load[windows.samples[0]], atol=1e-12)


def forget():
    """Compile every drive anew."""
    for cached in (rollout._rolling, rollout._piece, rollout._step, rollout._plan, rollout._apart):
        cached.cache_clear()


def step_response(law, name, value, u, dt=0.01, length=100):
    """What one effect makes of commands (N,), from rest at zero."""
    n = len(u)
    zeros, ones = np.zeros(n), np.ones(n)
    start, first = np.array([n - length - 1]), np.zeros(n, np.int64)
    windows = Windows(law, dt, 0.0, 0.0, u, first, *[zeros] * 4, ones, start, length, 1)
    return roll_out(windows, (NAMES[name](),), np.array([value]))[0][0]


def test_a_lag_answers_a_ramp_late_by_its_time_constant():
    t = np.arange(301) * 0.01 - 2.0
    u = np.maximum(t, 0.0)
    q = step_response(Law.POSITION, "actuation_lag", 0.1, u, length=290)
    assert q[-1] == pytest.approx(u[-1] - 0.1, abs=1e-4)


def swung(u, dt, **values):
    """What effects make of commands (N,), a lag and a bandwidth among them, from rest at zero."""
    effects = tuple(NAMES[name](**({"inside": True} if "play" in name else {})) for name in values)
    return swung_by(u, dt, effects, np.array([*values.values()]))


def swung_by(u, dt, effects, values):
    """The same of effects in forms of their own."""
    start, zeros = np.array([50]), np.zeros(len(u))
    windows = Windows(
        Law.POSITION, dt, 0.0, 0.0, u, zeros.astype(int), *[zeros] * 4, zeros + 1.0, start,
        len(u) - 51, 0,
    )  # fmt: skip
    return roll_out(windows, effects, values)


@pytest.mark.parametrize("same", [False, True])
@pytest.mark.parametrize("lag", [0.0, 0.0002, -0.02, 0.03, 0.2])
@pytest.mark.parametrize("period", [0.0, 0.02, 0.4, 2.0])
def test_a_servo_of_second_order_is_its_differential_equations_solution(period, lag, same):
    """Behind a lag, which may fade nearly as it does."""
    dt, s = 0.01, period / (2.0 * np.pi)
    lag = max(lag + same * s, 0.0)
    t = np.arange(301) * dt
    u = np.where(t < 2.1, 0.0, 1.0) + 0.2 * np.sin(5.0 * np.maximum(t - 0.6, 0.0))
    values = {"servo_bandwidth": period, "actuation_lag": lag}
    q, slopes = swung(u, dt, **values)
    law = np.trim_zeros(np.polymul([lag, 1.0], [s**2, 2.0 * s, 1.0]), "f")
    exact = lsim(lti([1.0], law), u, t)[1] if len(law) > 1 else u
    np.testing.assert_allclose(q[0], exact[51:], atol=1e-6)
    for k, name in enumerate(values):
        more = swung(u, dt, **values | {name: values[name] + 1e-6})[0][0]
        np.testing.assert_allclose((more - q[0]) / 1e-6, slopes[0, :, k], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["actuation_play", "actuation_deadband"])
def test_friction_and_a_dead_band_of_a_servo_of_second_order_are_mujocos(name):
    """A damped spring to the filtered command, which is as slow; its command has the band."""
    inertia, s, lag, size, dt = 0.05, 0.05, 0.02, 0.05, 0.01
    kp = inertia / s**2
    rubs = kp * size if name == "actuation_play" else 0.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="1e-4" gravity="0 0 0"/><worldbody><body><joint name="a"
        frictionloss="{rubs}" solreffriction="0.001 1"/><inertial pos="0 0 0" mass="1"
        diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody><actuator><position
        joint="a" kp="{kp}" kv="{kp * 2.0 * s}"/><general joint="a" gainprm="0"
        dyntype="filterexact" dynprm="{lag}"/></actuator></mujoco>"""
    )
    data, t = mujoco.MjData(model), dt * np.arange(601)
    u = np.where(t < 0.5, 0.0, 0.3 * np.sin(2.0 * (t - 0.5)) + 0.1 * np.sin(7.0 * (t - 0.5)))
    q = np.empty_like(t)
    for k in range(len(t)):
        q[k] = data.qpos[0]
        for part in range(100):
            data.ctrl[1], asked = np.interp(t[k] + part * 1e-4, t, u), data.act[0]
            error = asked - data.qpos[0]
            held = min(max(2.0 * (abs(error) - size), 0.0), abs(error))
            data.ctrl[0] = asked if rubs else data.qpos[0] + np.sign(error) * held
            mujoco.mj_step(model, data)
    values = {"servo_bandwidth": 2.0 * np.pi * s, "actuation_lag": lag}
    missed = np.abs(swung(u, dt, **values | {name: size})[0][0] - q[51:]).max()
    assert missed < 0.05 * np.abs(swung(u, dt, **values)[0][0] - q[51:]).max()


def test_a_servo_of_second_order_goes_no_faster_than_it_can():
    """Beside small steps of its law, of a step of a radian whose speed is cut at 2 rad/s."""
    dt, parts, s, fastest = 0.01, 1000, 0.05, 2.0
    u = np.where(np.arange(251) < 80, 0.0, 1.0)
    place, speed, exact = 0.0, 0.0, []
    for k, c in enumerate(np.interp(np.arange(50 * parts, 250 * parts) / parts, np.arange(251), u)):
        speed += dt / parts * (c - place - 2.0 * s * speed) / s**2
        speed = np.clip(speed, -fastest, fastest)
        place += dt / parts * speed
        exact += [place] * (k % parts == parts - 1)
    values = {"servo_bandwidth": 2.0 * np.pi * s, "velocity_limit": fastest}
    np.testing.assert_allclose(swung(u, dt, **values)[0][0], exact, atol=1e-3)


@pytest.mark.parametrize("lag", [0.0, 0.003, 0.1])
def test_what_goes_no_faster_than_it_can_turns_between_samples(lag):
    """Beside small steps of its law, where commands come towards the joint and pass it."""
    dt, parts, fastest, place, exact = 0.02, 500, 0.5, 0.0, []
    u = 0.5 * np.sin(4.0 * np.maximum(np.arange(300) * dt - 1.2, 0.0))
    share = 1.0 - np.exp(-dt / parts / lag) if lag else 1.0
    middles = (np.arange(50 * parts, 299 * parts) + 0.5) / parts
    for k, c in enumerate(np.interp(middles, np.arange(300), u)):
        place += np.clip(share * (c - place), -fastest * dt / parts, fastest * dt / parts)
        exact += [place] * (k % parts == parts - 1)
    values = {"velocity_limit": fastest} | ({"actuation_lag": lag} if lag else {})
    q, slopes = swung(u, dt, **values)
    np.testing.assert_allclose(q[0], exact, atol=2e-5)
    for k, name in enumerate(values):
        more = swung(u, dt, **values | {name: values[name] + 1e-7})[0][0]
        np.testing.assert_allclose((more - q[0]) / 1e-7, slopes[0, :, k], atol=1e-4)


def test_what_is_told_no_faster_lags_behind_that():
    """Beside small steps: a rate limit, then a lag."""
    dt, parts, fastest, lag = 0.02, 500, 0.5, 0.1
    u = 0.5 * np.sin(4.0 * np.maximum(np.arange(300) * dt - 1.2, 0.0))
    h, told, joint, exact = dt / parts, 0.0, 0.0, []
    share = 1.0 - np.exp(-h / lag)
    for k, c in enumerate(np.interp(np.arange(50 * parts, 299 * parts) / parts, np.arange(300), u)):
        told += np.clip(c - told, -fastest * h, fastest * h)
        joint += share * (told - joint)
        exact += [joint] * (k % parts == parts - 1)
    effects = ActuationLag(), VelocityLimit(told=True)
    values = np.array([lag, fastest])
    q, slopes = swung_by(u, dt, effects, values)
    np.testing.assert_allclose(q[0], exact, atol=5e-4)  # a step in which they meet is a line
    assert (
        np.abs(swung_by(u, dt, (ActuationLag(), VelocityLimit()), values)[0][0] - exact).max()
        > 0.02
    )
    for k in range(2):
        more = swung_by(u, dt, effects, values + 1e-7 * (np.arange(2) == k))[0][0]
        np.testing.assert_allclose((more - q[0]) / 1e-7, slopes[0, :, k], atol=1e-4)


@pytest.mark.parametrize("lag", [0.004, 0.02, 0.1])
def test_a_dead_band_of_what_lags_is_its_law_s_between_samples(lag):
    """Beside small steps of its law, lags down to a fifth of a sample."""
    dt, parts, band, place, exact = 0.02, 500, 0.02, 0.0, []
    at = np.maximum(np.arange(300) * dt - 1.2, 0.0)
    u = 0.1 * np.sin(2.0 * at) + 0.1 * np.sin(5.1 * at)
    share = 1.0 - np.exp(-dt / parts / lag)
    middles = (np.arange(50 * parts, 299 * parts) + 0.5) / parts
    for k, c in enumerate(np.interp(middles, np.arange(300), u)):
        size = abs(c - place)
        place += share * np.sign(c - place) * min(max(2.0 * (size - band), 0.0), size)
        exact += [place] * (k % parts == parts - 1)
    q, _ = swung(u, dt, actuation_deadband=band, actuation_lag=lag)
    assert np.std(q[0] - exact) < 0.01 * np.std(u[51:] - exact)


def test_a_planned_way_runs_neither_ahead_nor_behind_its_law():
    """Beside small steps of it: a quarter of a millisecond where samples are 20."""
    dt, parts, most, place, speed, exact = 0.02, 500, 3.0, 0.0, 0.0, []
    at = np.maximum(np.arange(300) * dt - 1.2, 0.0)
    u, h = 0.2 * np.sin(2.0 * at) + 0.1 * np.sin(5.1 * at), dt / parts
    for k, c in enumerate(np.interp(np.arange(1, 299 * parts) / parts, np.arange(300), u)):
        beyond = c - place - speed * abs(speed) / (2.0 * most)
        after = speed + h * most * np.clip(beyond / (h**2 * most), -1.0, 1.0)
        place, speed = place + h * (speed + after) / 2.0, after
        exact += [place] * ((k + 1) % parts == 0 and k >= 50 * parts)
    q, pace = swung(u, dt, acceleration_limit=most)[0][0], np.gradient(exact, dt)
    off = q[: len(exact)] - exact
    assert abs(pace @ off) < 2.5e-4 * (pace @ pace)
    assert np.std(off) < 0.003 * np.std(u[51 : 51 + len(exact)] - exact)


def test_a_delay_is_exact_between_samples():
    t = np.arange(301) * 0.01
    q = step_response(Law.POSITION, "actuation_delay", 0.0173, t)
    np.testing.assert_allclose(q, t[-99:] - 0.0173, atol=1e-12)


@pytest.mark.parametrize("name", ["actuation_play", "velocity_limit"])
def test_play_and_a_largest_speed_are_their_closed_forms(name):
    t = np.arange(301) * 0.01
    u = np.where(t < 2.5, 0.0, 1.0)
    if name == "actuation_play":
        assert step_response(Law.POSITION, name, 0.2, u)[-1] == pytest.approx(0.8)
    else:
        q = step_response(Law.POSITION, name, 0.5, u)
        assert np.diff(q).max() == pytest.approx(0.005)


def test_a_planned_way_takes_the_time_of_its_two_ramps_and_trails_what_moves():
    t = np.arange(301) * 0.01
    q = step_response(Law.POSITION, "acceleration_limit", 5.0, np.where(t < 2.2, 0.0, 0.5))
    late = t[-99:] - 2.2
    assert q[late < 0.6].max() < 0.5  # two ramps of sqrt(0.5 / 5) = 0.316 s each
    assert q[late > 0.68] == pytest.approx(0.5, abs=2e-3)
    halfway = np.interp(0.25, q, late)
    assert halfway == pytest.approx(np.sqrt(0.5 / 5.0), abs=0.015)
    q = step_response(Law.POSITION, "acceleration_limit", 5.0, np.maximum(t - 2.1, 0.0))
    assert q[-1] == pytest.approx(0.9 - 1 / (2 * 5.0), abs=5e-3)  # v^2 / 2 a behind


def test_what_acts_behind_a_planned_way_has_exact_slopes():
    """Differences over a wide step, as the way's own numbers have them, are a hundredth off."""
    u = 0.5 * np.sin(3.0 * 0.02 * np.arange(400))
    values = {"acceleration_limit": 3.0, "actuation_lag": 0.05, "actuation_play": 0.02}
    _, J = swung(u, 0.02, **values)
    for k, name in ((1, "actuation_lag"), (2, "actuation_play")):
        ahead, behind = (
            swung(u, 0.02, **values | {name: values[name] + step})[0] for step in (1e-6, -1e-6)
        )
        near = np.abs(J[..., k] - (ahead - behind) / 2e-6)
        assert np.quantile(near, 0.98) < 1e-5  # but as play is taken up
        assert np.abs(J[..., k]).max() > 0.3


@pytest.mark.parametrize(
    ("constant", "by"), [("STIFFNESS", 1.0), ("STIFFNESS", 2.0), ("SLOWS", 2.0)]
)
def test_soft_friction_is_mujocos_frictionloss(constant, by, monkeypatch):
    monkeypatch.setattr(drive, constant, by * getattr(drive, constant))
    t = np.arange(0.0, 3.0, 0.01)
    u, rubs = 0.8 * np.sin(3.0 * t) + 0.3 * np.sin(11.0 * t), 0.31  # N m, some of them held
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="1e-4" gravity="0 0 0"/><worldbody><body><joint name="a"
        frictionloss="{rubs}"/><inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.05"/></body>
        </worldbody><actuator><motor joint="a"/></actuator></mujoco>"""
    )
    data, q = mujoco.MjData(model), np.empty_like(t)
    for k in range(len(t)):
        q[k] = data.qpos[0]
        data.ctrl[0] = u[k]
        for _ in range(100):
            mujoco.mj_step(model, data)
    zeros, inertia = np.zeros_like(t), np.full_like(t, 0.05)
    windows = Windows(
        Law.TORQUE, 0.01, 0.0, 0.0, u, zeros.astype(np.int64), *[zeros] * 4, inertia,
        np.array([0]), len(t) - 1, 0, bare=0.05,
    )  # fmt: skip
    forget()
    missed = [
        np.abs(
            roll_out(windows, (NAMES["coulomb_friction"](soft=s),), np.array([rubs]))[0][0] - q[1:]
        )
        for s in (True, False)
    ]
    forget()
    assert (missed[0].max() < 0.05 * missed[1].max()) == (by == 1.0), [x.max() for x in missed]


def test_a_dead_band_holds_small_errors_and_leaves_its_width_of_large_ones():
    u = np.concatenate([np.zeros(250), np.full(51, 0.1)])
    assert np.abs(step_response(Law.POSITION, "actuation_deadband", 0.11, u)).max() < 1e-12
    assert step_response(Law.POSITION, "actuation_deadband", 0.04, u)[-1] == pytest.approx(0.06)


def test_a_command_of_velocity_is_integrated_and_one_of_torque_twice():
    u = np.full(301, 0.5)
    moved_by = step_response(Law.VELOCITY, "actuation_gain", 0.2, u)
    assert moved_by[-1] == pytest.approx(0.6, rel=0.02)  # one second at 0.6 rad/s, from rest
    pushed = step_response(Law.TORQUE, "actuation_gain", 0.2, u)
    assert pushed[-1] == pytest.approx(0.3, rel=0.02)  # 0.6 N m on 1 kg m^2 for one second


@pytest.mark.parametrize("law", [Law.VELOCITY, Law.SERVO])
def test_a_lag_before_the_drive_is_exact_for_commands_that_run_straight(law):
    dt, lag, fine = 0.01, 0.05, 100
    t = np.arange(401) * dt
    u = np.sin(9.0 * t) + 0.5 * np.sin(31.0 * t + 1.0)
    filtered = [u[0]]
    for asked in np.interp((np.arange(400 * fine) + 0.5) * dt / fine, t, u):
        filtered.append(filtered[-1] + (asked - filtered[-1]) * (1 - np.exp(-dt / fine / lag)))
    memory = cs.SX.sym("memory", 5)
    one = Drive(
        law, cs.SX(dt), cs.SX.sym("u"), *(cs.SX(x) for x in (0, 1, 1, 1, 1)), lag=cs.SX(lag)
    )
    after = one.step(Memory(*cs.vertsplit(memory)))
    step = cs.Function("step", [memory, one.command], [cs.vertcat(after.asked, after.sent)])
    state, found = cs.DM([u[0], 0.0, 0.0, 0.0, u[0]]), [u[0]]
    for asked in u[1:]:
        state[[0, 4]] = step(state, asked)
        found.append(float(state[0]))
    np.testing.assert_allclose(found, filtered[::fine], atol=1e-6)
