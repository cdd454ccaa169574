"""Efforts that passed a filter come back, and noise behind a sensor's end hides it from no one."""

import numpy as np
import pytest
import scipy

from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.efforts import nominal_efforts
from plumbline.optim.recording.late import basis_of
from plumbline.optim.recording.sensor_end import _end_of
from tests.random_trees import Tree

TIME = np.arange(-2.0, 12.0, 0.001)  # [s], of what the filter sees; logged are every tenth from 0
NOISE = 0.05


@pytest.fixture(scope="module")
def robot():
    return Robot.from_urdf(Tree(3, ("revolute",) * 3).urdf())


def motion():
    rng = np.random.default_rng(1)
    w, phase = 2 * np.pi * rng.uniform(0.1, 0.9, (3, 3)), rng.uniform(0, 6, (3, 3))
    angle = w * TIME[:, None, None] + phase
    waves = 0.4 * np.sin(angle), 0.4 * w * np.cos(angle), -0.4 * w**2 * np.sin(angle)
    return tuple(x.sum(axis=1) for x in waves)


def logged(robot, changed, *, noise=NOISE, stated=True, cut=np.inf, rubs=0.3):
    """What passes ``changed`` of the torques, cut off, with noise after."""
    q, v, a = motion()
    tau = changed(tree_of(robot).dynamics.torques(q, v, a) + rubs * np.sign(v) * [0.0, 0.0, 1.0])
    tau[:, 1] = np.clip(tau[:, 1], -cut, cut)
    kept = slice(2000, None, 10)
    read = tau[kept] + np.random.default_rng(0).normal(0.0, noise, tau[kept].shape)
    return build_recording(
        observation="joint_torque", robot=robot, time=TIME[kept], q=q[kept], velocity=v[kept],
        measured=read, noise_by_joint=np.full(3, noise) if stated else None,
    )  # fmt: skip


def filtered(T):
    stays = np.exp(-0.001 / T)
    return lambda tau: scipy.signal.lfilter([1 - stays], [1, -stays], tau, axis=0)


def late(by):
    return lambda tau: np.roll(tau, round(by / 0.001), axis=0)


def told(recording):
    return [note for note in recording.notes if "filter of" in note]


def ends(recording):
    return [note for note in recording.notes if "a sensor's end" in note]


@pytest.mark.parametrize("T", [0.03, 0.06, 0.15])
def test_efforts_behind_a_filter_come_back_and_its_time_is_told(robot, T):
    rec = logged(robot, filtered(T))
    (note,) = told(rec)
    assert float(note.split()[8]) == pytest.approx(1e3 * T, rel=0.02)
    dry = 0.3 * np.sign(rec.velocity) * [0.0, 0.0, 1.0]
    left = rec.measured - nominal_efforts(rec) - dry
    assert left.std(axis=0) == pytest.approx(rec.noise_by_joint, rel=0.15)
    assert (rec.noise_by_joint > NOISE).all()  # the more, the more of what is fast comes back


def test_efforts_behind_a_filter_are_no_cause(robot):
    """Taken for late, they were those of bodies that weigh as much and have no inertia."""
    found = {c.label: c for c in diagnose(logged(robot, filtered(0.06))).causes}
    assert set(found) == {"coulomb_friction of drive 3"}
    dry = found["coulomb_friction of drive 3"].parameters["dry"]
    assert abs(dry.value - 0.3) < 3 * dry.std


@pytest.mark.parametrize("by", [0.03, 0.06])
def test_efforts_that_wait_in_a_queue_passed_no_filter(robot, by):
    assert told(logged(robot, late(by))) == []


@pytest.mark.parametrize(("noise", "seen"), [(1.2, True), (2.4, False)])
def test_a_filter_is_told_where_it_is_surely_more_probable_than_a_queue(robot, noise, seen):
    assert bool(told(logged(robot, filtered(0.06), noise=noise))) is seen


@pytest.mark.parametrize("stated", [True, False])
def test_noise_behind_a_sensors_end_hides_it_from_no_one(robot, stated):
    rec = logged(robot, lambda tau: tau, cut=12.0, stated=stated)
    assert ends(rec)
    assert all(abs(abs(float(note.split()[6])) - 12.0) < NOISE for note in ends(rec))
    assert [c.label for c in diagnose(rec).causes] == ["coulomb_friction of drive 3"]


def test_without_an_end_no_row_is_left_aside(robot):
    """Dry friction of a light joint reads one effort either way."""
    for rubs in (0.0, 0.3, 3.0):
        assert ends(logged(robot, lambda tau: tau, rubs=rubs)) == []


@pytest.mark.parametrize(
    ("rows", "slope", "seen"),
    [(12, 0.0, False), (30, 0.0, True), (80, 0.0, True), (80, 0.4, False)],
)
def test_an_end_is_told_where_enough_rows_read_it_and_it_is_one(rows, slope, seen):
    """Of 400 efforts so many are cut off; a dozen may be a slow crest, what rises on is no end."""
    t = np.linspace(0.0, 20.0, 400)
    X = np.column_stack([np.sin(t), np.cos(1.7 * t), np.ones(len(t))])
    wanted = X @ [3.0, 1.0, 0.5]
    end = np.quantile(wanted, 1.0 - rows / len(t))
    noise = 0.05 * np.random.default_rng(0).normal(size=len(t))
    read = np.where(wanted < end, wanted, end + slope * (wanted - end)) + noise
    assert (_end_of(read, wanted, basis_of(X)) is not None) == seen


@pytest.mark.parametrize(("wanders", "seen"), [(0.0, True), (0.97, False)])
def test_rows_count_for_an_end_as_many_as_know_nothing_of_each_other(wanders, seen):
    """Two slow crests of a UR10, which a straight fit had higher, were ends of 63 and 124 rows."""
    rng, t = np.random.default_rng(0), np.linspace(0.0, 20.0, 2000)
    X = np.column_stack([np.sin(t), np.cos(1.7 * t), np.ones(len(t))])
    wanted = X @ [3.0, 1.0, 0.5]
    end = np.quantile(wanted, 0.9)
    noise = scipy.signal.lfilter([np.sqrt(1 - wanders**2)], [1.0, -wanders], rng.normal(size=2000))
    read = np.minimum(wanted, end) + 0.2 * noise
    assert (_end_of(read, wanted, basis_of(X)) is not None) == seen
