"""Where bodies were under torques: MuJoCo's seven joints, whose loads grow by readings' noise."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plumbline import build_motion
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion import settled as settled_module
from plumbline.optim.diagnosis.motion import states as states_module
from plumbline.optim.diagnosis.motion.bodies import bodies_at
from plumbline.optim.diagnosis.motion.constants import BELIEVED
from plumbline.optim.diagnosis.motion.fit import fitted
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.diagnosis.motion.states import States, slopes_at
from tests.pushed_arms import held_near, pushed_arm

AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "0 1 0", "1 0 0")
MASSES = (3.6, 3.2, 2.4, 1.9, 1.3, 0.8, 0.4)  # [kg]
LENGTHS = (0.12, 0.28, 0.1, 0.25, 0.2, 0.12, 0.09)  # [m]
STEP, EVERY, SECONDS, NOISE = 1e-3, 5, 6.0, 1e-4


def models():
    """The arm as URDF and as MuJoCo has it."""
    inertias = [m * length**2 / 8 for m, length in zip(MASSES, LENGTHS, strict=True)]
    return pushed_arm(AXES, LENGTHS, MASSES, inertias, STEP, "0.01 0.02")


def recorded(gain=1.0, noise=NOISE):
    """Torques that hold the arm near a way; what the second motor gives is scaled."""
    urdf, model = models()
    data, plan = mujoco.MjData(model), mujoco.MjData(model)
    rng = np.random.default_rng(5)
    size, turn = rng.uniform(0.15, 0.4, (7, 2)), rng.uniform(1.5, 4.0, (7, 2)) * [1.0, 2.2]
    phase, at = rng.uniform(0.0, 6.0, (7, 2)), rng.uniform(-0.5, 0.5, 7)
    data.qpos[:] = at + (size * np.sin(phase)).sum(axis=1)
    told, seen, speed = [], [], []
    for k in range(round(SECONDS / STEP)):
        if k % EVERY == 0:
            angle = turn * k * STEP + phase
            way = at, size, turn, angle
            told.append(held_near(plan, data, model, way, (100, 20)))
            seen.append(data.qpos.copy())
            speed.append(data.qvel.copy())
        data.ctrl[:] = told[-1] * [1.0, gain, *[1.0] * 5]
        mujoco.mj_step(model, data)
    q = np.array(seen) + np.random.default_rng(0).normal(0.0, noise, (len(seen), 7))
    log = build_motion(
        robot=Robot.from_urdf(urdf), time=STEP * EVERY * np.arange(len(q)),
        command=np.array(told), q=q, kind="torque", noise_std=NOISE,
    )  # fmt: skip
    return log, np.array(seen), np.array(speed)


@pytest.fixture(scope="module")
def as_told():
    return recorded()


@pytest.fixture(scope="module")
def weak():
    return recorded(gain=0.85)


def left_of(signals):
    """What ideal drives leave of each joint, in its noise."""
    every = (signals.windows(j, signals.training) for j in range(7))
    return np.array([fitted(w, (), np.empty(0)).square ** 0.5 / NOISE for w in every])


def test_seven_joints_that_do_as_told_leave_noise_alone(as_told):
    """Of places smoothed over 0.3 s the loads of joint 3 leave a quarter more."""
    signals = signals_of(as_told[0])
    assert left_of(signals).max() < 1.05
    inner = slice(20, -20)
    assert np.std((signals.posture - as_told[1])[inner]) < 0.15 * NOISE
    assert np.std((signals.speed - as_told[2])[inner]) < 2.0 * NOISE


def test_states_are_those_of_the_bodies_where_readings_have_no_noise():
    log, seen, speed = recorded(noise=0.0)
    signals = signals_of(log)
    np.testing.assert_allclose(signals.posture[5:-5], seen[5:-5], rtol=0, atol=0.02 * NOISE)
    np.testing.assert_allclose(signals.speed[5:-5], speed[5:-5], rtol=0, atol=2 * NOISE)


def test_where_one_drive_is_wrong_its_neighbours_are_not_taken_to_be(weak):
    """Were all drives believed alike, they would leave five to a hundred times their noise."""
    left = left_of(signals_of(weak[0]))
    assert left[1] > 100
    others = np.delete(left, 1)
    assert others.max() < 1.1
    assert others.min() > 0.85


@pytest.mark.parametrize("first", [10.0, 100.0])
def test_what_a_wrong_drive_gives_is_found_from_wherever_its_search_begins(
    first, weak, monkeypatch
):
    usual = signals_of(weak[0])
    monkeypatch.setattr(settled_module, "KNOWN", first)
    monkeypatch.setattr(settled_module, "PASSES", 14)
    other = signals_of(weak[0])
    np.testing.assert_allclose(other.posture[20:-20], usual.posture[20:-20], atol=0.3 * NOISE)


def test_states_in_stretches_are_the_same_states(as_told, monkeypatch):
    whole = signals_of(as_told[0])
    monkeypatch.setattr(settled_module, "AT_ONCE", 500)
    parts = signals_of(as_told[0])
    apart = np.abs(parts.posture - whole.posture)
    assert 0.0 < apart.max() < 2 * NOISE
    np.testing.assert_allclose(left_of(parts), left_of(whole), atol=0.05)


def states(K, n=2):
    """Of nothing in particular."""
    rng = np.random.default_rng(2)
    place, bent = rng.normal(size=(K, n)), 0.01 * rng.normal(size=(K, n))
    more = rng.normal(size=(3, K, n, n))
    read, speed = place + 0.1 * rng.normal(size=(K, n)), rng.normal(size=(K, n))
    masses, mean = np.eye(n) + 0.3 * more[0], rng.normal(size=(K - 1, n))
    return States(0.1, read, place, speed, masses, mean, bent, *more[1:])


def densely(begun, weights):
    """The same step (K, n), by all rows of the sum at once."""
    K, n = begun.place.shape
    rows = np.zeros((K - 3, n, K, n))
    for i, slope in enumerate(begun._by_places()):
        rows[np.arange(K - 3), :, np.arange(K - 3) + i] = slope
    root = np.sqrt(weights)
    rows = (root[:, None, None] * rows).reshape(-1, K * n)
    right = np.concatenate([(begun.read - begun.place).ravel(), -(root * begun.changes).ravel()])
    least = np.linalg.lstsq(np.concatenate([np.eye(K * n), rows]), right, rcond=None)[0]
    return least.reshape(K, n)


def test_states_are_where_the_sum_is_least():
    begun, weights = states(9), np.array([1e-4, 1e-3])
    step = begun.settled(weights).place - begun.place
    np.testing.assert_allclose(step, densely(begun, weights), rtol=1e-6, atol=1e-9)


def test_changes_are_by_places_as_they_are_said_to_be():
    """Where accelerations are of no state, that is."""
    begun = states(9)
    begun = replace(begun, by_place=0 * begun.by_place, by_speed=0 * begun.by_speed)
    step = np.random.default_rng(4).normal(size=(9, 2))
    by = begun._by_places()
    more = sum(np.einsum("kij,kj->ki", x, step[i : 6 + i]) for i, x in enumerate(by))
    np.testing.assert_allclose(begun._moved(step).changes, begun.changes + more, atol=1e-9)


@pytest.mark.parametrize(("most", "holds"), [(BELIEVED, True), (1e4 * BELIEVED, False)])
def test_torques_are_believed_as_far_as_digits_go(most, holds, monkeypatch):
    """Beyond that, readings are lost beside them: where all else is exact, that is a line's."""
    monkeypatch.setattr(states_module, "BELIEVED", most)
    K, rng = 400, np.random.default_rng(3)
    nothing = np.zeros((K, 2, 2))
    begun = States(1e-3, rng.normal(size=(K, 2)), np.zeros((K, 2)), np.zeros((K, 2)),
                   nothing + np.eye(2), np.zeros((K - 1, 2)), np.zeros((K, 2)), nothing,
                   nothing)  # fmt: skip
    weights = states_module.believed(1e-3, np.ones(2), np.zeros(2), np.ones(2))
    try:
        step = begun.settled(weights).place
    except np.linalg.LinAlgError:
        step = np.full((K, 2), np.inf)
    off = np.abs(step - densely(begun, weights)).max()
    assert (off < 0.02) == holds


@pytest.mark.parametrize("K", [2, 3])
def test_a_run_that_is_too_short_to_tell_of_drives_stays_as_it_was_read(K):
    begun = states(K)
    assert begun.settled(np.ones(2)) is begun


def test_slopes_are_those_of_the_accelerations_that_held_torques_make():
    robot = Robot.from_urdf(models()[0])
    log = build_motion(robot=robot, time=0.01 * np.arange(200), command=np.zeros((200, 7)),
                       q=np.cumsum(np.ones((200, 7)), 0) * 0.01, kind="torque")  # fmt: skip
    rng = np.random.default_rng(1)
    q, v, a = rng.normal(size=(3, 1, 7))
    masses, _ = bodies_at(log, q, v)
    by_place, by_speed = slopes_at(log, (q, v, a), masses)
    model = robot.model.copy()
    model.gravity.linear = np.asarray(robot.gravity)
    data = model.createData()
    torque = pin.rnea(model, data, q[0], v[0], a[0])
    for found, ahead in ((by_place, (1, 0)), (by_speed, (0, 1))):
        for k, one in enumerate(1e-6 * np.eye(7)):
            both = [
                pin.aba(model, data, q[0] + s * ahead[0] * one, v[0] + s * ahead[1] * one, torque)
                for s in (1, -1)
            ]
            np.testing.assert_allclose(
                found[0, :, k], (both[0] - both[1]) / 2e-6, rtol=1e-5, atol=1e-4
            )


def test_three_passes_are_too_few(as_told, monkeypatch):
    monkeypatch.setattr(settled_module, "PASSES", 3)
    few = signals_of(as_told[0])
    assert np.std((few.posture - as_told[1])[20:-20]) > 0.15 * NOISE


def test_states_are_by_the_noise_that_readings_have_whatever_is_stated(as_told):
    log = replace(as_told[0], noise_std=NOISE / 10)
    np.testing.assert_array_equal(signals_of(log).posture, signals_of(as_told[0]).posture)


def test_what_a_drive_gives_beyond_what_is_known_is_weighed_by_as_much_as_it_changes():
    """A walk of known steps, integrated twice and read with known noise: both are found again."""
    dt, sigma, s, K = 0.01, 1e-4, 1e-3, 20000
    rng = np.random.default_rng(0)
    e = rng.normal(0.0, s, (K, 1)).cumsum(axis=0)
    q = dt**2 * e.cumsum(axis=0).cumsum(axis=0)
    read, nothing = q + rng.normal(0.0, sigma, q.shape), np.zeros((K, 1, 1))
    begun = States(dt, read, read, 0 * read, nothing + 1.0, 0 * read[1:], 0 * read,
                   nothing, nothing)  # fmt: skip
    weights = np.array([(30.0**3 * dt) ** -2.0])
    for _ in range(30):
        found = begun.settled(weights)
        squares, noise = ((x**2).mean(axis=0) for x in (found.changes, read - found.place))
        weights = states_module.believed(dt, weights, squares, noise)
    assert weights[0] ** 0.5 == pytest.approx(sigma / s, rel=0.1)
