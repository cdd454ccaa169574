"""Reading of measured efforts: units, derived motions, noise, signs, limbs; simulated cases."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter, savgol_coeffs, savgol_filter

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.commands.check import examined
from plumbline.experiments.reality.cases import Plan
from plumbline.experiments.reality.torques import BEYOND, simulate_torques
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.torque_dependences import torque_functions
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.model import apply
from plumbline.optim.recording import derivatives
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.constants import BANDWIDTH, SURE_SPEED, THIRD_DIFFERENCE
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Origin
from tests.random_trees import Tree
from tests.trocars import SHAFT, SIDE, through_a_trocar

ROWS = 300


def swing(n, rows=ROWS, rate=100.0):
    """A motion of one sine a joint, with its derivatives (rows, n), and its clock."""
    t = np.arange(rows) / rate
    w = 2 * np.pi * np.linspace(0.4, 1.1, n)
    angle = np.outer(t, w) + np.arange(n)
    return t, 0.5 * np.sin(angle), 0.5 * w * np.cos(angle), -0.5 * w**2 * np.sin(angle)


@pytest.fixture(scope="module")
def robot():
    return Robot.from_urdf(Tree(3, ("revolute",) * 4).urdf())


def recorded(robot, **given):
    t, q, v, a = swing(tree_of(robot).n)
    tau = tree_of(robot).dynamics.torques(q, v, a)
    whole = {"q": q, "velocity": v, "time": t, "measured": tau} | given
    return build_recording(observation="joint_torque", robot=robot, **whole)


def test_accelerations_are_derived_and_the_bandwidth_is_said(robot):
    _, _, v, a = swing(4)
    rec = recorded(robot)
    inner = slice(10, -10)
    assert np.abs(rec.velocity - v)[inner].max() < 2e-3 * np.abs(v).max()
    assert np.abs(rec.acceleration - a)[inner].max() < 2e-3 * np.abs(a).max()
    assert any("zero-phase" in note and "Hz" in note for note in rec.notes)


def test_velocities_too_come_from_the_joints_where_none_were_recorded(robot):
    _, _, v, a = swing(4)
    rec = recorded(robot, velocity=None)
    inner = slice(10, -10)
    assert np.abs(rec.velocity - v)[inner].max() < 5e-3 * np.abs(v).max()
    assert np.abs(rec.acceleration - a)[inner].max() < 2e-2 * np.abs(a).max()


def test_what_is_recorded_is_not_smoothed(robot):
    _, _, v, a = swing(4)
    rec = recorded(robot, acceleration=a + 1.0, time=None)
    np.testing.assert_array_equal(rec.velocity, v)
    np.testing.assert_array_equal(rec.acceleration, a + 1.0)


@pytest.mark.parametrize("rate", [50.0, 125.0, 1000.0])
def test_a_window_lets_half_of_the_power_pass_at_its_bandwidth(rate):
    half = derivatives.half_window(rate, 10_000)
    f = derivatives.bandwidth(rate, half)
    assert rate < 125.0 or abs(f - BANDWIDTH) < 1.5
    taps = savgol_coeffs(2 * half + 1, derivatives.constants.ORDER)
    tone = np.exp(2j * np.pi * f / rate * np.arange(-half, half + 1))
    assert abs(taps @ tone) ** 2 == pytest.approx(0.5, abs=1e-6)


def test_noise_of_accelerations_is_foretold():
    rng = np.random.default_rng(0)
    step, half = 0.01, derivatives.half_window(100.0, 20_000)
    raw = rng.normal(size=(20000, 1))
    from_velocity = savgol_filter(
        raw, 2 * half + 1, derivatives.constants.ORDER, deriv=1, delta=step, axis=0
    )
    taken = raw - savgol_filter(raw, 2 * half + 1, derivatives.constants.ORDER, axis=0)
    foretold = taken.std() * derivatives.noise_gain(step, half, 1)
    assert from_velocity.std() == pytest.approx(foretold, rel=0.05)


def test_near_standstill_the_sense_of_turning_is_unsure():
    v = np.array([[-1.0], [-1e-4], [0.0], [1e-4], [1.0]])
    sense = derivatives.turning(v, derivatives.velocity_noise(None, v, np.zeros(1)))
    assert sense[0] == -1
    assert sense[-1] == 1
    assert sense[2] == 0
    assert abs(sense[1]) < 0.05


def test_the_sense_of_turning_is_as_sure_as_the_velocities_are_smooth():
    v = np.sin(np.arange(0.0, 30.0, 0.02))[:, None]
    noisy, nothing = v + np.random.default_rng(0).normal(0.0, 1e-3, v.shape), np.zeros(1)
    assert derivatives.velocity_noise(v, v, nothing)[0] < 1e-5
    assert derivatives.velocity_noise(noisy, noisy, nothing)[0] == pytest.approx(1e-3, rel=0.1)
    assert derivatives.velocity_noise(noisy, v, np.full(1, 3e-4))[0] == 3e-4  # what is left of it
    shuffled = np.random.default_rng(1).permutation(v)  # whose differences tell nothing
    assert derivatives.velocity_noise(shuffled, shuffled, nothing)[0] == pytest.approx(
        SURE_SPEED, rel=1e-3
    )


@pytest.mark.parametrize("recorded", ["q", "velocity"])
def test_velocities_are_as_noisy_as_smoothing_leaves_them(recorded):
    t, q, v, _ = swing(1, rows=4000, rate=500.0)
    shaken = np.random.default_rng(0).normal(0.0, 1e-3, q.shape)
    read = (q + shaken, None) if recorded == "q" else (q, v + shaken)
    made = derivatives.derived_motion(*read, t, Origin())
    off = (made.velocity - v)[50:-50]
    assert made.velocity_noise[0] == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.2)


def test_a_gap_in_time_is_no_motion():
    t = np.concatenate([np.arange(50) * 0.01, 9.0 + np.arange(60) * 0.01, np.arange(70) * 0.01])
    assert [len(rows) for rows in derivatives.stretches(t, 0.01)] == [50, 60, 70]


def folder(tmp_path, robot, motion="", **columns):
    t, q, v, a = swing(4)
    table = {"time": t}
    tau = tree_of(robot).dynamics.torques(q, v, a)
    for prefix, values in {"q": q, "velocity": v, "effort": tau, **columns}.items():
        table |= {f"{prefix}{j + 1}": x for j, x in enumerate(values.T)}
    rows = np.column_stack(list(table.values()))
    np.savetxt(tmp_path / "samples.csv", rows, "%.9g", ",", header=",".join(table), comments="")
    (tmp_path / "robot.urdf").write_text(robot.urdf)
    (tmp_path / "dataset.toml").write_text(
        f'observation = "joint_torque"\n[robot]\nurdf = "robot.urdf"\n[motion]\n{motion}\n'
    )
    return tmp_path


@pytest.mark.parametrize("whose", ["[motion]", "recording"])
def test_amperes_become_newton_metres_by_their_constants(tmp_path, robot, whose):
    _, q, v, a = swing(4)
    tau = tree_of(robot).dynamics.torques(q, v, a)
    k = np.array([10.0, 5.0, 2.0, 1.0])
    motion = 'effort_unit = "A"\ntorque_constant = [10, 5, 2, 1]\n'
    own = whose == "[motion]"
    where = folder(tmp_path, robot, motion + "noise_std = [1, 1, 0.5, 0.2]" * own, effort=tau / k)
    if not own:
        text = (where / "dataset.toml").read_text()
        (where / "dataset.toml").write_text("noise_std = 0.5\n" + text)
    rec = load_recording(where)
    np.testing.assert_allclose(rec.measured, tau, atol=1e-6 * np.abs(tau).max())
    noise = k * ([1, 1, 0.5, 0.2] if own else 0.5)
    np.testing.assert_allclose(rec.noise_by_joint, noise, rtol=1e-3)
    content, words = examined(where)
    assert content["noise_by_joint"] == rec.noise_by_joint.tolist()
    assert f"stated [N m]  {', '.join(f'{x:.3g}' for x in noise)}" in words


def test_efforts_may_state_their_noise_row_by_row(tmp_path, robot):
    each = np.where(np.arange(ROWS) % 2, 0.5, 2.0)
    where = folder(tmp_path, robot, 'effort_unit = "A"\ntorque_constant = 2.0\n')
    table = (where / "samples.csv").read_text().splitlines()
    rows = [f"{row},{noise}" for row, noise in zip(table[1:], each, strict=True)]
    (where / "samples.csv").write_text("\n".join([f"{table[0]},noise_std", *rows]) + "\n")
    rec = load_recording(where)
    np.testing.assert_allclose(rec.noise_by_joint, 2.0 * np.sqrt(np.mean(each**2)), rtol=1e-2)
    models = [build_model(replace(rec, noise_shape=shape)) for shape in (None, rec.noise_shape)]
    plain, weighed = (Mapped(m.problem).residuals(m.start) for m in models)
    np.testing.assert_allclose(weighed * rec.noise_shape, plain, rtol=1e-9)
    np.testing.assert_allclose(rec.noise_shape[:2, 0], each[:2] / np.sqrt(np.mean(each**2)))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ('effort_unit = "A"', "torque_constant"),
        ('effort_unit = "kgf m"', "effort_unit"),
        ("torque_constant = [1, 2]", "a number above zero, or 4 of them"),
        ("torque_constant = -1", "a number above zero"),
    ],
)
def test_a_unit_that_says_nothing_is_refused(tmp_path, robot, motion, words):
    with pytest.raises(PlumblineError, match=words):
        load_recording(folder(tmp_path, robot, motion))


@pytest.mark.parametrize(
    ("step", "words"), [(0.0, "a clock that stands at 0 s"), (1e-11, "a run of 300 rows")]
)
def test_a_clock_that_derives_nothing_is_refused(robot, step, words):
    with pytest.raises(PlumblineError, match=words):
        recorded(robot, velocity=None, time=step * np.arange(ROWS))


def test_efforts_without_signs_turned_ones_and_exchanged_ones_are_refused(robot):
    tau = recorded(robot).measured
    with pytest.raises(PlumblineError, match="efforts with signs"):
        recorded(robot, measured=np.abs(tau))
    with pytest.raises(PlumblineError, match=r"effort2 against .*turn the sign"):
        recorded(robot, measured=tau * [1, -1, 1, 1])
    with pytest.raises(PlumblineError, match=r"effort2 with .*effort3.*exchange these"):
        recorded(robot, measured=tau[:, [0, 2, 1, 3]])


def test_a_joint_whose_effort_is_always_the_same_is_refused(robot):
    """No drive, or none read: bodies without mass, or a noise of nothing, would be told of it."""
    tau = recorded(robot).measured * [1, 0, 1, 1]
    with pytest.raises(PlumblineError, match=r"effort2.*0 in every row.*end at a .*tip_frame"):
        recorded(robot, measured=tau)
    with pytest.raises(PlumblineError, match=r"effort2.*0 in every row"):
        recorded(robot, measured=tau, noise_by_joint=np.ones(4))


def test_an_arm_of_one_joint_is_as_long_as_its_body():
    """What its bodies may weigh beside the model has a width though no link leads on."""
    arm = Robot.from_dh([{"alpha": 0.0, "mass": 1.0, "com": [0.2, 0.0, 0.0]}])
    arm = arm.with_gravity([0.0, -9.81, 0.0])
    t, q, v, a = swing(1)
    tau = tree_of(arm).dynamics.torques(q, v, a) * 1.3
    given = {"measured": tau + np.random.default_rng(1).normal(0.0, 0.02, tau.shape), "time": t}
    rec = build_recording(
        observation="joint_torque", robot=arm, q=q, velocity=v, noise_std=0.02, **given
    )
    assert diagnose(rec).gap.shrink > 0.9


@pytest.mark.parametrize(
    ("gravity", "words"),
    [
        ([0.0, 0.0, 9.81], r"write gravity = \[0.0, 0.0, 9.81\]"),
        ([0.0, -9.81, 0.0], r"write gravity = \[0.0, -9.81, 0.0\]"),
        ([0.0, 0.0, 0.0], r"write gravity = \[0.0, 0.0, 0.0\]: the controller takes"),
    ],
)
def test_a_mounting_that_is_not_stated_is_named(robot, gravity, words):
    _, q, v, a = swing(4)
    tau = replace(tree_of(robot).dynamics, gravity=np.array(gravity)).torques(q, v, a)
    with pytest.raises(PlumblineError, match=words):
        recorded(robot, measured=tau + np.sign(v))  # beside friction on every joint


def test_efforts_that_bear_a_weight_are_not_of_an_arm_without_gravity(robot):
    _, q, v, a = swing(4)
    tau = tree_of(robot).dynamics.torques(q, v, a) + np.sign(v)
    with pytest.raises(PlumblineError, match=r"write gravity = \[0.0, 0.0, -9.81\]"):
        recorded(robot.with_gravity([0.0, 0.0, 0.0]), measured=tau)


def test_an_effort_that_runs_against_its_joint_s_friction_is_refused(robot):
    """Where friction is most of it no likeness to the model's effort says so."""
    tau = recorded(robot).measured.copy()
    tau[:, 1] += 0.7 * np.abs(tau[:, 1]).max() * np.sign(recorded(robot).velocity[:, 1])
    recorded(robot, measured=tau)
    with pytest.raises(PlumblineError, match=r"effort2 against the model's and its friction"):
        recorded(robot, measured=tau * [1, -1, 1, 1])


def test_efforts_that_are_all_turned_are_no_other_mounting(robot):
    """Of a slow motion all but the weight is little, which another gravity turns as well."""
    _, q, v, a = swing(4)
    slow = {"velocity": 0.1 * v, "acceleration": 0.01 * a, "time": None}
    tau = tree_of(robot).dynamics.torques(q, 0.1 * v, 0.01 * a)
    with pytest.raises(PlumblineError, match="turn the sign of this column"):
        recorded(robot, measured=-tau, **slow)


def test_a_base_that_is_off_level_is_no_other_mounting(robot):
    _, q, v, a = swing(4)
    tilted = np.array([9.81 * np.sin(0.5), 0.0, -9.81 * np.cos(0.5)])
    recorded(robot, measured=replace(tree_of(robot).dynamics, gravity=tilted).torques(q, v, a))


@pytest.mark.parametrize(
    ("times", "refused"), [(0.32, True), (0.35, False), (2.8, False), (3.2, True)]
)
def test_efforts_of_another_size_than_any_scale_are_of_another_unit(robot, times, refused):
    tau = recorded(robot).measured * times
    if not refused:
        recorded(robot, measured=tau)
        return
    with pytest.raises(PlumblineError, match=rf"{times} times the model's.*torque_constant"):
        recorded(robot, measured=tau)


@pytest.mark.parametrize("rises", [1.0, -1.0])
def test_a_weight_lifted_with_next_to_no_effort_is_of_another_unit(rises):
    """Along one way a weight and dry friction go together; yet no friction bears what is lifted."""
    links = '<link name="a"/><link name="b"><inertial><mass value="20"/><inertia ixx="1" iyy="1"'
    links += ' izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="prismatic">'
    links += '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    lift = Robot.from_urdf(f'<robot name="lift">{links}{limit}</robot>')
    t = np.arange(100) / 25.0
    v = 0.05 * (1.0 + 0.5 * np.sin(3.0 * t))[:, None]
    given = {"q": np.cumsum(v, axis=0) / 25.0, "velocity": v, "time": t}
    rng = np.random.default_rng(1)
    tau = 20.0 * 9.81 + rng.normal(0.0, 1.0, v.shape)
    with pytest.raises(PlumblineError, match=r"efforts 0.0\d+ times the model's"):
        recorded(lift, **given, measured=0.01 * rises * tau)
    recorded(lift, **given, measured=tau + 150.0)  # friction of the way is no other unit


def test_a_rotor_is_no_other_unit_where_nothing_is_lifted():
    turntable = Robot.from_dh([{"a": 0.3, "mass": 1.0, "com": [-0.15, 0.0, 0.0]}])
    t, q, v, a = swing(1)
    tau = tree_of(turntable).dynamics.torques(q, v, a) + 2.0 * a
    build_recording(
        observation="joint_torque", robot=turntable, q=q, velocity=v, time=t, measured=tau
    )


@pytest.mark.parametrize("name", ["velocity", "acceleration"])
@pytest.mark.parametrize(("times", "refused"), [(57.3, True), (1e-3, True), (2.8, False)])
@pytest.mark.parametrize("joints", [(0, 1, 2, 3), (2,)], ids=["all", "one"])
def test_rates_in_another_unit_than_their_column_are_refused(robot, name, times, refused, joints):
    _, _, v, a = swing(4)
    given = {"velocity": v, "acceleration": a}
    given[name] = np.array(given[name])
    given[name][:, joints] *= times
    if not refused:
        recorded(robot, **given)
        return
    column = name if times > 1 else {"velocity": "q", "acceleration": "velocity"}[name]
    with pytest.raises(PlumblineError, match=rf"column '{column}{joints[0] + 1}'.*divide by 57.3"):
        recorded(robot, **given)


def test_a_robot_without_masses_is_refused():
    _, q, v, a = swing(6)
    rows = [{"d": 0.1, "a": 0.2, "alpha": 0.5, "theta": 0.0, "kind": "revolute"}] * 6
    with pytest.raises(PlumblineError, match="masses"):
        recorded(Robot.from_dh(rows), q=q, velocity=v, acceleration=a, measured=0 * q)


def test_noise_that_is_not_stated_is_estimated_joint_by_joint(robot):
    rng = np.random.default_rng(5)
    tau = recorded(robot).measured
    sigma = 0.01 * np.abs(tau).max() * np.array([1, 3, 0.3, 2])
    rec = recorded(robot, measured=tau + rng.normal(0, sigma, tau.shape))
    assert rec.noise_std is None
    np.testing.assert_allclose(rec.noise_by_joint, sigma, rtol=0.35)


@pytest.mark.parametrize("rows", [26, 40])
def test_the_noise_of_a_few_postures_is_not_what_the_model_misses(robot, rows):
    """Twice the gravity that is stated: every joint misses by all that it carries."""
    rng = np.random.default_rng(7)
    q = rng.uniform(-2.0, 2.0, (rows, 4))
    still = np.zeros_like(q)
    tau = 2.0 * tree_of(robot).dynamics.torques(q, still, still)
    sigma = 0.01 * np.abs(tau).max(axis=0)
    given = {"q": q, "velocity": still, "acceleration": still, "time": None}
    rec = recorded(robot, **given, measured=tau + rng.normal(0, sigma, tau.shape))
    ratio = rec.noise_by_joint[:3] / sigma[:3]  # the last joint carries nothing
    assert (np.maximum(ratio, 1.0 / ratio) < 3.0).all()


def test_a_diagnosis_of_efforts_is_told_in_newton_metres(robot):
    rng = np.random.default_rng(6)
    bare = recorded(robot)
    sigma = 0.02 * np.abs(bare.measured).max() * np.array([1, 0.5, 0.3, 0.2])
    size = 4 * sigma[1]
    tau = bare.measured + rng.normal(0, sigma, bare.measured.shape)
    tau[:, 1] += size * np.sign(bare.velocity[:, 1])
    found = diagnose(recorded(robot, measured=tau, noise_by_joint=sigma))
    assert [c.label for c in found.causes] == ["coulomb_friction of drive 2"]
    value = found.causes[0].parameters["dry"]
    assert abs(value.value - size) < 4 * value.std
    gap = found.gap
    assert gap.unit == "N m"
    assert gap.noise_floor == pytest.approx(np.sqrt(np.mean(sigma**2)), rel=0.05)
    own = np.sqrt(np.mean(found.residual_after**2, axis=0))
    np.testing.assert_allclose(own, sigma, rtol=0.15)
    for one, after in zip(found.by_joint, own, strict=True):
        assert (one.after, one.unit) == (pytest.approx(after), "N m")
    assert found.by_joint[1].before > 3.0 * found.by_joint[1].after
    for side, steps in (
        ("before", found.verdict.staircase[0]),
        ("after", found.verdict.staircase[-1]),
    ):
        whole = np.sqrt(np.mean([getattr(one, side) ** 2 for one in found.by_joint]))
        assert (getattr(gap, side), steps.gap) == pytest.approx((whole, whole))
    assert gap.shrink == pytest.approx(1 - gap.after / gap.before)
    assert gap.shrink_ci95[0] < gap.shrink < gap.shrink_ci95[1]
    model, r = found.model(), found.recording
    left = r.measured - model.tau(r.q, r.velocity, r.acceleration)
    np.testing.assert_allclose(np.sqrt(np.mean(left**2, axis=0)), sigma, rtol=0.15)
    tried = apply(model, r)
    assert tried.holds
    assert tried.after == pytest.approx(gap.noise_floor, rel=0.1)
    (curve,) = found.verdict.friction
    assert curve.joint == 2
    np.testing.assert_allclose(curve.torque, value.value * np.sign(curve.velocity), rtol=1e-9)
    np.testing.assert_allclose(curve.std, value.std, rtol=1e-3)
    assert found.to_dict()["friction"][0]["joint"] == 2
    assert [len(found.plot(name).figures) for name in ("friction", "torques")] == [1, 3]


def test_dry_and_viscous_friction_are_found_where_a_form_of_either_does_more_alone():
    """Of a dozen forms of a friction each is tried as the first of two."""
    robot = Robot.from_dh(
        [
            {"a": 0.4, "mass": 2.0, "com": [-0.2, 0, 0]},
            {"a": 0.3, "mass": 1.0, "com": [-0.15, 0, 0]},
        ]
    ).with_gravity(np.array([0.0, -9.81, 0.0]))
    rng, t = np.random.default_rng(3), np.arange(0.0, 20.0, 0.02)
    pulse = 2 * np.pi * np.array([[0.31, 0.47], [0.9, 0.7]])
    size, phase = np.array([[0.8, 0.9], [0.2, 0.3]]), pulse * t[:, None, None]
    q = (size * np.sin(phase)).sum(axis=1)
    v, a = (
        (size * pulse * np.cos(phase)).sum(axis=1),
        (-size * pulse**2 * np.sin(phase)).sum(axis=1),
    )
    read = robot.dynamics().torques(q, v, a) + rng.normal(0.0, 0.05, q.shape)
    read[:, 1] += 0.4 * np.sign(v[:, 1]) + 0.15 * v[:, 1]
    given = {"q": q, "velocity": v, "time": t, "measured": read, "noise_std": 0.05}
    found = diagnose(build_recording(observation="joint_torque", robot=robot, **given))
    assert {c.effect for c in found.causes} == {"coulomb_friction", "viscous_friction"}


def test_a_noise_of_efforts_that_is_larger_than_stated_is_told_in_their_unit(robot):
    rng = np.random.default_rng(9)
    bare = recorded(robot)
    sigma = 0.02 * np.abs(bare.measured).max() * np.array([1, 0.5, 0.3, 0.2])
    tau = bare.measured + rng.normal(0, 1.5 * sigma, bare.measured.shape)
    notes = diagnose(recorded(robot, measured=tau, noise_by_joint=sigma)).verdict.notes
    (said,) = [note for note in notes if note.startswith("noise larger than stated: ")]
    told = float(said.split()[4])
    assert told == pytest.approx(1.5 * np.sqrt(np.mean(sigma**2)), rel=0.15)


@pytest.mark.parametrize(("share", "dry"), [(0.007, True), (0.06, True), (0.8, False)])
def test_dry_friction_may_need_some_speed_to_hold(robot, share, dry):
    """Up to a tenth of the largest speed; what needs more is viscous for the most part."""
    rng = np.random.default_rng(8)
    bare = recorded(robot)
    sigma = 0.02 * np.abs(bare.measured).max() * np.array([1, 0.5, 0.3, 0.2])
    tau, v = bare.measured + rng.normal(0, sigma, bare.measured.shape), bare.velocity[:, 1]
    size = 20 * sigma[1]
    tau[:, 1] += size * np.tanh(v / (share * np.abs(v).max()))
    found = diagnose(recorded(robot, measured=tau, noise_by_joint=sigma))
    named = [c.label for c in found.causes if c.probability > 0.95]
    assert (named == ["coulomb_friction of drive 2"]) == dry
    if dry:
        assert found.verdict.outside_probability < 0.1
        assert found.causes[0].parameters["dry"].value == pytest.approx(size, rel=0.1)


def test_a_joint_that_creeps_to_and_fro_has_friction_that_remembers_its_way(robot):
    rng = np.random.default_rng(7)
    t, q, v, a = swing(4)
    q[:, 1], v[:, 1], a[:, 1] = (0.4 * x[:, 1] for x in (q, v, a))
    tau = tree_of(robot).dynamics.torques(q, v, a)
    sigma = 0.02 * np.abs(tau).max() * np.array([1, 0.5, 0.3, 0.2])
    side = np.ones(len(q))
    for k in range(1, len(q)):
        side[k] = np.clip(side[k - 1] + (q[k, 1] - q[k - 1, 1]) / 0.01, -1.0, 1.0)
    efforts = tau + rng.normal(0, sigma, tau.shape)
    efforts[:, 1] += 4 * sigma[1] * side
    given = {"q": q, "velocity": v, "time": t, "measured": efforts, "noise_by_joint": sigma}
    found = diagnose(recorded(robot, **given))
    assert [c.label for c in found.causes] == ["coulomb_friction of drive 2"]
    assert "changes sides" in found.causes[0].variant
    assert abs(found.causes[0].parameters["dry"].value - 4 * sigma[1]) < 0.5 * sigma[1]


@pytest.mark.parametrize("on", ["latency", "another joint's load"])
def test_a_torque_that_follows_what_no_effect_reads_is_no_effect_s(robot, on):
    rng = np.random.default_rng(8)
    tau = recorded(robot).measured
    sigma = 0.02 * np.abs(tau).max() * np.array([1, 0.5, 0.3, 0.2])
    shape = tau[:, 2] if on != "latency" else np.gradient(tau[:, 1])
    efforts = tau + rng.normal(0, sigma, tau.shape)
    efforts[:, 1] += 2 * sigma[1] * shape / np.sqrt(np.mean(shape**2))
    found = diagnose(recorded(robot, measured=efforts, noise_by_joint=sigma))
    assert found.outside_probability > 0.9
    place = found.verdict.tree[0]
    assert (place["stage"], place["element"]) == ("actuation", 2)
    assert on in [branch["on"] for branch in place["dependences"][:2]]
    assert not [c for c in found.causes if c.probability > 0.95]


def test_noise_that_wanders_within_what_is_stated_is_no_mechanism():
    rng = np.random.default_rng(0)
    two = Robot.from_urdf(Tree(3, ("revolute",) * 2).urdf())
    t, q, v, a = swing(2, 400)
    tau = tree_of(two).dynamics.torques(q, v, a)
    sigma = 0.02 * np.abs(tau).max(axis=0)
    noise = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], rng.normal(size=tau.shape), axis=0)
    given = {"q": q, "velocity": v, "time": t, "measured": tau + sigma * noise}
    found = diagnose(recorded(two, **given, noise_by_joint=sigma))
    assert found.verdict.verdict == "no-gap"
    assert found.outside_probability < 0.1
    assert any("correlates by 0.9" in note for note in found.verdict.notes)


@pytest.mark.parametrize("name", ["stribeck_friction", "payload"])
def test_a_simulated_cause_is_found(tmp_path, name):
    """One easy case a mechanism; shares over many cases are for the sealed sets."""
    facts = cased(tmp_path, Plan(kind="single", gap=(3.0, 4.0), rows=(60, 70), effects=(name,)))
    truth = facts["effects"][0]
    named = {(c.effect, c.element) for c in diagnose(tmp_path / "case").causes}
    alike = {(t["effect"], t["element"]) for t in facts["confounded"]}
    assert named & ({(truth["effect"], truth["element"])} | alike)


def cased(tmp_path, plan):
    for seed in range(20):
        try:
            return simulate_torques(tmp_path / "case", plan, "case", seed)
        except ValueError:
            continue
    raise AssertionError("no case drawn")


def test_what_no_library_of_drives_has_is_told_from_it(tmp_path):
    facts = cased(tmp_path, Plan(kind="outside", gap=(3.0, 4.0), rows=(60, 70), effects=BEYOND[:1]))
    found = diagnose(tmp_path / "case")
    assert found.outside_probability > 0.5
    assert f"joint {facts['effects'][0]['element']}'s" in found.verdict.outside_depends_on


def test_next_proposes_a_motion_that_parts_what_does_the_same(tmp_path, robot, capsys):
    """An offset of less than half the noise may be a spring whose middle is out of reach."""
    place, table = tmp_path / "arm", tmp_path / "commands.csv"
    place.mkdir()
    tau = tree_of(robot).dynamics.torques(*swing(4)[1:])
    tau += np.random.default_rng(0).normal(0.0, 0.02, tau.shape)
    tau[:, 2] += 0.009
    where = folder(place, robot, "noise_std = 0.02", effort=tau)
    assert run(["next", str(where), "--csv", str(table)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("joint 3: ")
    assert " of drive 3 from " in said
    assert table.read_text().splitlines()[0] == "time,u1,u2,u3,u4"


def test_a_sealed_set_of_efforts_is_made_and_sealed(tmp_path):
    cases, truth = tmp_path / "cases", tmp_path / "truth"
    words = ["withheld", "make", str(cases), "--truth", str(truth), "--count", "2"]
    assert run([*words, "--simulator", "torque", "--kind", "single", "--quiet"]) == 0
    facts = json.loads((truth / "case-0001.json").read_text())
    assert facts["observation"] == "joint_torque"
    assert isinstance(load_recording(cases / "case-0001"), Recording)


def test_a_trocar_that_rubs_and_pushes_is_named(robot):
    tree = tree_of(robot)
    _, q, v, a = swing(tree.n)
    tau = through_a_trocar(tree, (q, v, a), SHAFT, 3.0, SIDE)
    sigma = np.full(tree.n, 0.02)
    tau += np.random.default_rng(0).normal(0.0, sigma, tau.shape)
    made = recorded(robot, measured=tau, noise_by_joint=sigma, acceleration=a, tool_offset=SHAFT)
    found = diagnose(made)
    (cause,) = found.causes
    assert cause.effect == "trocar_load"
    assert cause.parameters["friction"].value == pytest.approx(3.0, abs=0.1)
    assert found.gap.after < 0.05 * found.gap.before


def test_a_clock_that_stands_every_other_row_foretells_no_change_of_load(robot):
    rec = recorded(robot, acceleration=swing(4)[3], time=0.02 * (np.arange(ROWS) // 2))
    named = {on for _, on, *_ in torque_functions(rec)}
    assert "load" in named
    assert "latency" not in named


def test_third_differences_of_white_noise_say_its_size():
    noise = np.random.default_rng(0).normal(0.0, 1.0, 100_000)
    assert np.median(np.abs(np.diff(noise, 3))) == pytest.approx(THIRD_DIFFERENCE, rel=0.02)


def balls(masses):
    """An arm whose links are balls of these masses [kg], 0.1 m in their radius of gyration."""
    said = '<robot name="balls"><link name="b0"/>'
    for k, m in enumerate(masses, start=1):
        shape = f'<inertia ixx="{0.01 * m}" iyy="{0.01 * m}" izz="{0.01 * m}"'
        said += f'<link name="b{k}"><inertial><origin xyz="0 0 0.05"/><mass value="{m}"/>{shape}'
        said += f' ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{k}" type="revolute">'
        said += f'<parent link="b{k - 1}"/><child link="b{k}"/><axis xyz="0 {1 - k % 2} {k % 2}"/>'
        said += f'<origin xyz="0 0 {0.2 if k < 3 else 0.05}"/>'
        said += '<limit lower="-3" upper="3" effort="99" velocity="9"/></joint>'
    return Robot.from_urdf(said + "</robot>")


def test_a_body_in_the_hand_is_a_payload_and_no_link_s_inertia():
    """Of a shape like the links' own, and as far from the tip as the wrist is long."""
    robot = balls((3.0, 3.5, 3.0, 2.5))
    t, q, v, a = swing(4, 1000)
    model = robot.dynamics().model.copy()
    model.inertias[4] += pin.Inertia(0.4, np.array([0.03, -0.02, 0.12]), 0.004 * np.eye(3))
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    sigma = np.full(4, 0.05)
    tau += sigma * np.random.default_rng(0).normal(size=tau.shape)
    given = {"q": q, "velocity": v, "acceleration": a, "time": t, "measured": tau}
    (cause,) = diagnose(recorded(robot, **given, noise_by_joint=sigma)).causes
    assert cause.effect == "payload"
    assert cause.probability > 0.95
    assert cause.parameters["mass"].value == pytest.approx(0.4, abs=0.05)
