"""Commands of velocity and of torque, carried out by MuJoCo's own actuators."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from plumbline import build_motion, diagnose
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.motion import diagnose as diagnose_module
from plumbline.optim.diagnosis.motion import rollout
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.fit import fitted
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.model import Drives
from tests.motions import arm, multisine
from tests.optim.diagnosis.test_motion_physics import MJCF, STEP, URDF

EVERY, SECONDS, NOISE = 10, 10.0, 1e-3  # [rad]: an encoder of 11 bits
SERVOS = (
    '<position joint="a" kp="{kp}" kv="{kd}" {limit}/><position joint="b" kp="{kp}" kv="{kd}"/>'
)
VELOCITY = '<velocity joint="a" kv="{kv}"/><velocity joint="b" kv="{kv}"/>'
TORQUE = '<motor joint="a"/><motor joint="b"/>'


def moved(actuators, command, *, start=(0.0, 0.0), act=lambda k, told, q, v: told[k], noise=NOISE,
          held=False, integrator=mujoco.mjtIntegrator.mjINT_RK4):  # fmt: skip
    """Times (N,), commands (N, 2) and positions (N, 2): MuJoCo at 1 kHz, logged at 100 Hz.

    ``command(t, q, v)`` is what is logged, ``act`` what the actuators get of it; it may be held
    from row to row.
    By Runge and Kutta where torques act: implicit steps move places by the speed that they end
    with, which is half a millisecond of lead.
    """
    model = mujoco.MjModel.from_xml_string(
        MJCF.replace(SERVOS, actuators).replace("\n</actuator>", "</actuator>").format(step=STEP)
    )
    if actuators == TORQUE:
        model.opt.integrator = integrator
    data = mujoco.MjData(model)
    data.qpos[:] = start
    told, seen = [], []
    for k in range(round(SECONDS / STEP)):
        if not held or k % EVERY == 0:
            u = command(k * STEP, data.qpos, data.qvel)
        told.append(u)
        seen.append(data.qpos.copy())
        data.ctrl[:] = act(k, told, data.qpos, data.qvel)
        mujoco.mj_step(model, data)
    q = np.array(seen) + np.random.default_rng(0).normal(0.0, noise, (len(seen), 2))
    # A command is held for a step: at a row's time it changes from one to the next.
    u = np.array(told if held else [*told[:1], *(np.add(told[1:], told[:-1]) / 2)])
    return (STEP * np.arange(len(q)))[::EVERY], u[::EVERY], q[::EVERY]


def recorded(kind, t, u, q):
    return build_motion(
        robot=Robot.from_urdf(URDF), time=t, command=u, q=q, kind=kind, noise_std=NOISE
    )


def rates(t, q, v):
    """Velocities asked for (2,) [rad/s]."""
    one = 0.8 * np.cos(2.0 * t) + 0.9 * np.cos(7.0 * t + 1.0)
    return np.array([one, 0.7 * np.cos(3.1 * t) + 0.8 * np.cos(9.0 * t)])


def torques(t, q, v):
    """Torques asked for (2,) [N m]: a feedback that holds the arm near a path, as it was sent."""
    wanted = np.array([0.4 * np.sin(2.0 * t) + 0.2 * np.sin(3.7 * t), 0.5 * np.sin(3.1 * t)])
    return np.array([40.0, 12.0]) * (wanted - q) - np.array([4.0, 1.2]) * v


def by_name(answer, joint):
    return {c.effect: c for c in answer.causes if c.element == joint}


def test_of_two_velocity_servos_the_one_that_scales_and_is_late_is_told_so():
    late = 25

    def act(k, told, q, v):
        return [1.1 * told[max(k - late, 0)][0], told[k][1]]

    answer = diagnose(recorded("velocity", *moved(VELOCITY.format(kv=4e4), rates, act=act)))
    found = by_name(answer, 1)
    assert found["actuation_gain"].parameters["gain"].value == pytest.approx(0.1, abs=5e-3)
    assert found["actuation_delay"].parameters["delay"].value == pytest.approx(0.025, abs=2e-3)
    assert not by_name(answer, 2)


def test_motors_that_do_as_told_have_no_gap():
    answer = diagnose(recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2))))
    assert answer.verdict.verdict is Outcome.NO_GAP


def test_a_motor_that_gives_less_than_it_is_asked_for_is_told_so():
    def act(k, told, q, v):
        return [0.8 * told[k][0], told[k][1]]

    answer = diagnose(
        recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2), act=act))
    )
    found = by_name(answer, 1)
    assert next(iter(found)) == "actuation_gain"
    assert found["actuation_gain"].parameters["gain"].value == pytest.approx(-0.2, abs=0.02)
    assert "actuation_gain" not in by_name(answer, 2)


@pytest.mark.parametrize(("most", "anew"), [(7.0, 6), (5.0, 1), (5.0, 2), (5.0, 3)])
def test_a_motor_s_largest_torque_is_found_and_its_neighbour_not_blamed_for_it(
    monkeypatch, most, anew
):
    """Of what joint 1 was asked for and did not get, joint 2 feels nothing.

    Its load is of what the drive of joint 1 was found to give, not of readings smoothed alone: by
    those a delay and a lag, or past commands, had been at work at joint 2. However often the
    search begins anew.
    """
    monkeypatch.setattr(diagnose_module, "MOVES", anew)

    def act(k, told, q, v):
        return [np.clip(told[k][0], -most, most), told[k][1]]

    answer = diagnose(
        recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2), act=act))
    )
    strongest = by_name(answer, 1)["torque_limit"].parameters["strongest"]
    assert strongest.value == pytest.approx(most, rel=0.03)
    assert not by_name(answer, 2)
    assert answer.outside_probability < 0.05


@pytest.mark.parametrize("every", [1, 4])
def test_velocities_that_are_followed_with_a_lag_come_with_no_delay_however_seldom_logged(every):
    """Smooth commands, carried out in steps of 0.1 ms, logged every 10 or 40 ms."""
    dt, fine, lag = 0.01, 100, 0.05
    t, places = multisine(12.0, dt, fastest=1.2)
    way = CubicSpline(t, places)
    at = np.arange(len(t) * fine) * dt / fine
    asked, moved = way(at, 1)[:, 0], way(at)
    rate = np.zeros(len(asked))
    for k in range(1, len(asked)):
        rate[k] = rate[k - 1] + (asked[k - 1] - rate[k - 1]) * dt / fine / lag
    moved[:, 0] = np.cumsum(rate) * dt / fine
    q = moved[::fine] + np.random.default_rng(0).normal(0, 2e-4, places.shape)
    u = way(t, 1)
    answer = diagnose(build_motion(robot=arm(), time=t[::every], command=u[::every], q=q[::every],
                                   kind="velocity", noise_std=2e-4))  # fmt: skip
    assert [(c.effect, c.element) for c in answer.verdict.causes] == [("actuation_lag", 1)]
    assert answer.verdict.causes[0].parameters["lag"].value == pytest.approx(lag, abs=3e-4)


def carried(damping, torque_lag=0.0, strongest=np.inf, dry=0.0):
    """An arm of one joint [0.045 kg m^2, gravity off] under feedback torques held for 10 ms."""
    dt, fine, inertia = 0.01, 50, 0.045
    t, wanted = multisine(8.0, dt, fastest=1.2)
    place, speed, acts, q, u = wanted[0, 0], 0.0, 0.0, [], []
    for goal in wanted[:, 0]:
        q.append(place)
        u.append(9.0 * (goal - place) - 1.2 * speed)
        for _ in range(fine):
            acts = u[-1] if not torque_lag else acts + (u[-1] - acts) * dt / fine / torque_lag
            push = np.clip(acts, -strongest, strongest)
            speed += dt / fine / inertia * (push - damping * speed)
            speed -= np.clip(speed, -dt / fine / inertia * dry, dt / fine / inertia * dry)
            place += dt / fine * speed
    robot = Robot.from_dh([{"a": 0.3, "alpha": 0.0, "mass": 2.0, "com": [-0.15, 0.0, 0.0]}],
                          gravity=(0.0, 0.0, 0.0))  # fmt: skip
    q = np.array(q) + np.random.default_rng(0).normal(0.0, 2e-4, len(q))
    return build_motion(robot=robot, time=t, command=np.array(u)[:, None], q=q[:, None],
                        kind="torque", noise_std=2e-4)  # fmt: skip


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_of_held_torques_none_is_blamed_but_the_friction_they_work_against(damping):
    verdict = diagnose(carried(damping)).verdict
    assert [c.effect for c in verdict.causes] == ["viscous_friction"][: damping > 0.0]
    for cause in verdict.causes:
        assert cause.parameters["viscous"].value == pytest.approx(damping, rel=0.05)


def test_smoothing_takes_nothing_of_a_fast_motion_that_the_torques_foretell():
    t, inertia, size = 0.01 * np.arange(600), 0.045, 20.0
    turn = 2 * np.pi * 3.0  # rad/s: three swings a second
    acceleration, q = size * np.sin(turn * t), -size / turn**2 * np.sin(turn * t)
    exact = carried(0.0)
    noisy = q + np.random.default_rng(0).normal(0.0, 2e-3, len(q))
    signals = signals_of(replace(exact, law=Law.SAMPLED_TORQUE, time=t, q=noisy[:, None],
                                 command=inertia * acceleration[:, None]))  # fmt: skip
    inner = slice(20, -20)
    missed = signals.acceleration[inner, 0] - acceleration[inner]
    assert np.sqrt(np.mean(missed**2)) < 0.05 * size
    assert np.abs(signals.posture[inner, 0] - q[inner]).max() < 2e-3


def test_what_pushes_a_joint_is_what_bodies_did_whatever_its_and_their_drives_are_taken_for():
    """Else a drive is judged by a load that it was taken for itself, and two may take turns.

    By a drive that is taken to be 20 ms late alone, its neighbour would be pushed a tenth off.
    """
    late = (ActuationDelay(),), np.array([0.02])
    ideal = (), np.empty(0)
    r = recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2)))
    inner = slice(25, -25)  # where windows are
    as_told, other = (signals_of(r, drives=[ideal, one]).pushes[inner] for one in (ideal, late))
    changed = np.std(other - as_told, axis=0) / np.std(as_told, axis=0)
    assert changed[0] < 0.05
    assert changed[1] < 0.2


def test_readings_correct_what_pushes_a_joint_too_slowly_to_add_their_noise():
    """Of drives that do as told even a light joint behind a heavy one leaves noise alone."""
    r = recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2)))
    signals = signals_of(r, drives=[((), np.empty(0))] * 2)
    left = fitted(signals.windows(1, signals.training), (), np.empty(0))
    assert left.square**0.5 < 0.965 * NOISE


def test_readings_correct_what_pushes_a_joint_soon_enough_where_a_drive_is_not_as_told():
    """A motor that gives nine tenths, taken for ideal, leaves its neighbour little but noise."""

    def act(k, told, q, v):
        return [0.9 * told[k][0], told[k][1]]

    r = recorded("sampled_torque", *moved(TORQUE, torques, start=(0.0, 0.2), act=act))
    signals = signals_of(r, drives=[((), np.empty(0))] * 2)
    left = fitted(signals.windows(1, signals.training), (), np.empty(0))
    assert left.square**0.5 < 1.5 * NOISE


def test_what_neighbours_are_held_at_pushes_a_joint_over_the_whole_of_a_row():
    """Straight from row to row they would leave 2.6 times a good encoder's noise."""
    noise = 1e-4
    t, u, q = moved(
        TORQUE, lambda t, q, v: torques(2.0 * t, q, v), start=(0.0, 0.2), noise=noise, held=True
    )
    r = replace(recorded("torque", t, u, q), noise_std=noise)
    signals = signals_of(r, drives=[((), np.empty(0))] * 2)
    for j in range(2):
        left = fitted(signals.windows(j, signals.training), (), np.empty(0))
        assert left.square**0.5 < 1.03 * noise


def late_by_a_row(integrator):
    """Two joints under torques, the first of which obeys ten milliseconds late."""
    noise = 1e-4

    def act(k, told, q, v):
        return [told[max(k - 10, 0)][0], told[k][1]]

    t, u, q = moved(
        TORQUE, lambda t, q, v: torques(2.0 * t, q, v), start=(0.0, 0.2), noise=noise, held=True,
        act=act, integrator=integrator,
    )  # fmt: skip
    return diagnose(replace(recorded("torque", t, u, q), noise_std=noise))


@pytest.fixture(scope="module")
def ahead():
    """Steps that move places by the speed they end with lead, all joints alike; one is late."""
    return late_by_a_row(mujoco.mjtIntegrator.mjINT_EULER)


def test_a_drive_that_is_better_for_its_own_joint_is_tried_beside_the_other_s():
    """Fed with a lag in the delay's place its neighbour is worse by far more than it gains."""
    verdict = late_by_a_row(mujoco.mjtIntegrator.mjINT_RK4).verdict
    assert [(c.effect, c.element) for c in verdict.causes] == [("actuation_delay", 1)]
    assert verdict.causes[0].parameters["delay"].value == pytest.approx(0.01, abs=1e-4)


def test_half_a_simulator_s_step_is_of_one_clock_and_no_drive_s_delay(ahead):
    assert [(c.effect, c.element) for c in ahead.verdict.causes] == [("actuation_delay", 1)]
    assert ahead.verdict.causes[0].parameters["delay"].value == pytest.approx(0.01, abs=1e-4)
    assert ahead.recording.lead == pytest.approx(STEP / 2, rel=0.2)
    assert any("joints lead by" in note for note in ahead.verdict.notes)


def test_a_late_drive_and_a_clock_that_leads_are_kept_and_taken_home(ahead, tmp_path):
    ahead.save(tmp_path / "answer.json")
    again = MotionDiagnosis.load(tmp_path / "answer.json")
    for joint, other in zip(ahead.joints, again.joints, strict=True):
        assert other.fit.square == pytest.approx(joint.fit.square, rel=1e-9)
    ahead.model().save(tmp_path / "drives.toml")
    drives = Drives.load(tmp_path / "drives.toml")
    left = [joint.fit.square**0.5 for joint in ahead.joints]
    np.testing.assert_allclose(drives.gaps(ahead.recording)[1], left, rtol=0.02)
    np.testing.assert_allclose(ahead.transfer(ahead.recording)[1], left, rtol=0.02)
    assert max(replace(drives, lead=0.0).gaps(ahead.recording)[1] / left) > 1.2


def test_a_limit_that_no_row_comes_near_is_not_seen_and_one_that_acts_is_no_longer_there():
    free, limited = (diagnose(carried(0.0, strongest=most)).verdict for most in (np.inf, 0.4))
    assert [b.effect for b in free.unobservable] == ["velocity_limit", "torque_limit"]
    assert all("is within it" in b.why for b in free.unobservable)
    assert not {"velocity_limit", "torque_limit"} & {c.effect for c in free.candidates}
    assert "torque_limit" in {c.effect for c in limited.causes}
    assert [b.effect for b in limited.unobservable] == ["velocity_limit"]


def test_noise_that_wanders_within_what_is_stated_is_no_mechanism():
    """Of AR(1), .9 a sample: its variance over 24 s is known to a seventh only."""
    rng, rho, sigma = np.random.default_rng(3), 0.9, 5e-4
    t, u = multisine(24.0, 0.01)
    fresh, noise = rng.normal(0.0, sigma, u.shape), np.zeros(u.shape)
    for k in range(1, len(t)):
        noise[k] = rho * noise[k - 1] + (1 - rho**2) ** 0.5 * fresh[k]
    noise *= 1.07 * sigma / noise.std(axis=0)  # as chance would have it
    verdict = diagnose(
        build_motion(robot=arm(), time=t, command=u, q=u + noise, noise_std=sigma)
    ).verdict
    assert verdict.verdict == "no-gap"


@pytest.mark.parametrize("dry", [0.03, 0.0])
def test_dry_friction_of_a_drive_that_pushes_is_called_just_that(dry):
    """An arm of one joint, gravity off, whose drive rubs: sticks, breaks away, slips."""
    verdict = diagnose(carried(0.0, dry=dry)).verdict
    assert [c.effect for c in verdict.causes] == ["coulomb_friction"][: dry > 0.0]
    for cause in verdict.causes:
        assert cause.parameters["dry"].value == pytest.approx(dry, rel=0.05)


@pytest.mark.parametrize("stretch", [7, 1000])
def test_a_run_in_stretches_is_the_same_run(monkeypatch, stretch):
    """What a drive keeps goes on: here a lag, in the middle of which stretches end."""
    signals = signals_of(recorded("sampled_torque", *moved(TORQUE, torques)))
    given = (signals.windows(0, np.zeros(1, int)), (ActuationLag(),), np.array([0.3]))
    whole = [f(*given) for f in (rollout.pushed, rollout.played)]
    assert min(np.std(one) for one in whole) > 0.1
    monkeypatch.setattr(rollout, "STRETCH", stretch)
    for f, one in zip((rollout.pushed, rollout.played), whole, strict=True):
        np.testing.assert_allclose(f(*given), one, rtol=0, atol=1e-12 * np.abs(one).max())
