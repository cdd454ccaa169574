"""Drives taken home: other commands foretold, a file for MuJoCo alone, kept and brought back."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.kinematics.effects.actuation_deadband import ActuationDeadband
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_gain import ActuationGain
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.actuation_offset import ActuationOffset
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.kinematics.effects.coulomb_friction import CoulombFrictionOfMotion
from plumbline.kinematics.effects.servo_bandwidth import ServoBandwidth
from plumbline.kinematics.effects.servo_stiffness import ServoStiffness
from plumbline.kinematics.effects.torque_limit import TorqueLimit
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion.constants import LEAST_INERTIA
from plumbline.optim.diagnosis.motion.recording import build_motion
from plumbline.optim.model import Drives
from plumbline.optim.model.driven import Servo
from plumbline.optim.model.export import drives_mjcf, mjcf
from plumbline.optim.model.export.drives_mjcf import actuator_of
from plumbline.optim.model.export.exported import replay
from tests.motions import ROWS, arm, multisine, servo

LATE = {"delay": 0.04, "lag": 0.05, "play": 0.012}  # of joint 1 [s], [s], [rad]
OFF = {"gain": 0.05, "offset": 0.03, "delay": 0.03}  # of joint 2 [1], [rad], [s]


def one(*pairs, inertia=0.3):
    """A servo with these effects and values."""
    effects, values = zip(*pairs, strict=True) if pairs else ((), ())
    n = len(effects)
    return Servo(effects, np.array(values), np.full(n, 1e-4), inertia, np.array([-0.8, 0.8]))


def drives(*servos, law=Law.POSITION, robot=None):
    robot = robot or arm()
    names = tuple(str(name) for name in robot.model.names)[1 : 1 + len(servos)]
    n, numbered = len(servos), dict(enumerate(servos, start=1))
    zeros = np.zeros(n)
    return Drives("made", robot, names, tuple(range(n)), law, zeros, zeros, numbered, 0.03, 1e-3)


@pytest.fixture(scope="module")
def made():
    return drives(
        one((ActuationDelay(), 0.04), (ActuationLag(), 0.05), (ActuationPlay(), 0.012)),
        one((ActuationGain(), 0.05), (ActuationOffset(), 0.03), (ActuationDelay(), 0.03)),
    )


@pytest.fixture(scope="module")
def real():
    """What a servo that shares no code does with commands."""
    t, u = multisine(12.0, seed=3)
    return t, u, np.column_stack([servo(t, u[:, 0], **LATE), servo(t, u[:, 1], **OFF)])


def rms(apart):
    return np.sqrt(np.mean(apart[50:] ** 2, axis=0))


def test_ideal_drives_do_what_they_are_told():
    t, u = multisine(4.0)
    np.testing.assert_allclose(drives(one(), one()).rollout(t, u), u, atol=1e-12)


def test_other_commands_are_foretold(made, real):
    t, u, q = real
    assert (rms(made.rollout(t, u) - q) < 0.03 * rms(u - q)).all()


def test_the_exported_file_alone_does_the_same_in_mujoco(made, real):
    t, u, q = real
    file = made.as_mjcf()
    assert file.error < 1e-9
    assert not file.lacks
    left = rms(replay(file.text, t, u) - q)
    assert (left < 0.1 * rms(u - q)).all()


def test_a_servo_that_yields_to_its_load_does_so_in_mujoco(real):
    t, u, _ = real
    yields = drives(one(), one((ServoStiffness(), 0.002), (ActuationDelay(), 0.05)))
    there = yields.rollout(t, u)
    stiff = drives(one(), one((ActuationDelay(), 0.05))).rollout(t, u)
    left = rms(replay(yields.as_mjcf().text, t, u) - there)[1]
    assert left < 0.5 * rms(stiff - there)[1]
    assert left < 0.1 * rms(u - there)[1]


@pytest.mark.parametrize("more", [(), ((ActuationPlay(inside=True), 0.02),)])
def test_a_servo_of_second_order_is_as_slow_in_mujoco(real, more):
    t, u, _ = real
    effects = (ServoBandwidth(), 0.25), (ActuationLag(), 0.02), *more
    slow = drives(one(*effects), one())
    there = slow.rollout(t, u)[:, 0]
    left = rms(replay(slow.as_mjcf().text, t, u)[:, 0] - there)
    assert left < 0.01 * rms(u[:, 0] - there)


@pytest.mark.parametrize(
    ("constant", "value"),
    [
        ("STIFF", 30.0),
        ("DAMPED", 10.0),
        ("MJCF_STEP", 0.02),
        ("FRICTION", {"solreffriction": "0.1 1"}),
    ],
)
def test_every_number_of_the_file_matters(constant, value, made, real, monkeypatch):
    t, u, q = real
    best = rms(replay(made.as_mjcf().text, t, u) - q)
    monkeypatch.setattr(mjcf if constant == "FRICTION" else drives_mjcf, constant, value)
    with np.errstate(all="ignore"):
        worse = rms(replay(made.as_mjcf().text, t, u) - q)
    assert not (worse < 1.2 * best).all()


def test_what_mujoco_has_no_word_for_is_told_with_its_size(made):
    band, late = (ActuationDeadband(), 0.02), (ActuationDelay(), 0.04)
    assert not drives(one(band, late), one()).as_mjcf().lacks  # dry friction does the same
    banded = drives(one(band, (ActuationPlay(), 0.01), late), one())
    file = banded.as_mjcf()
    (lack,) = file.lacks
    assert lack.label == "actuation_deadband 1"
    assert 1e-3 < lack.size < 0.04
    assert file.stays == pytest.approx(lack.size)
    assert "mrad" in file.words
    assert "Not in this file: actuation_deadband 1" in file.text
    assert file.to_dict()["unit"] == "rad"


@pytest.mark.parametrize("soft", [False, True])
def test_soft_friction_is_left_as_mujoco_has_it(soft):
    rubs = one((CoulombFrictionOfMotion(soft=soft), 0.3))
    text = drives(rubs, one(), law=Law.TORQUE).as_mjcf().text
    assert 'frictionloss="0.3"' in text
    assert ("solreffriction" in text) != soft


@pytest.mark.parametrize(("law", "more"), [(Law.TORQUE, 0.0), (Law.POSITION, LEAST_INERTIA)])
def test_what_torques_move_is_no_heavier_than_its_file_states(law, more):
    root = ElementTree.fromstring(drives(one(), one(), law=law).as_mjcf().text)
    armatures = [float(joint.get("armature", 0.0)) for joint in root.iter("joint")]
    assert max(armatures) == pytest.approx(more)


def test_an_actuator_is_what_was_found():
    stiff = 0.3 + LEAST_INERTIA
    inside = one((ActuationPlay(inside=True), 0.01), (ActuationLag(), 0.1))
    a = actuator_of(Law.POSITION, inside, 0.0, 0.0)
    assert a.friction == pytest.approx(0.01 * stiff * drives_mjcf.STIFF**2)
    assert -a.bias[2] == pytest.approx(0.1 * a.gain)  # the lag is the loop's own
    assert a.filter == 0.0
    short = actuator_of(Law.POSITION, one((ActuationDeadband(), 0.01)), 0.0, 0.0)
    assert short.friction == a.friction  # it stops a slow servo as play does
    known = actuator_of(Law.SERVO, one((ServoStiffness(), 0.05)), 20.0, 1.5)
    assert known.gain == pytest.approx(10.0)
    assert known.bias == pytest.approx((0.0, -10.0, -1.5))
    soft = actuator_of(Law.POSITION, one((ServoStiffness(), 0.05)), 0.0, 0.0)
    assert -soft.bias[2] == pytest.approx(2 * 0.4 * np.sqrt(20.0 * stiff))  # no later than need be
    pushed = one((TorqueLimit(), 7.0), (ActuationGain(), 0.1), (ActuationOffset(), 0.2))
    push = actuator_of(Law.TORQUE, pushed, 0.0, 0.0)
    assert (push.gain, push.bias, push.force) == (pytest.approx(1.1), (0.2, 0.0, -0.0), 7.0)


def test_stored_drives_come_back_whole(made, real, tmp_path):
    t, u, _ = real
    made.save(tmp_path / "drives.toml")
    again = plumbline.load(tmp_path / "drives.toml")
    assert isinstance(again, plumbline.Drives)
    assert again.parameters == made.parameters
    np.testing.assert_array_equal(again.rollout(t, u), made.rollout(t, u))
    with pytest.raises(PlumblineError, match="found a file, expected a new one"):
        made.save(tmp_path / "drives.toml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("version = 2", "version = 1"),
        ('law = "position"', 'law = "wishes"'),
        ("index = [0, 1]", "index = [0, 7]"),
        ("[servos.2]", "[servos.3]"),
        ('name = "actuation_lag"', 'name = "actuation_wish"'),
        ("inside = false", 'inside = "no"'),
        ("[0.05, ", "[nan, "),
        ("[0.0001, ", '["small", '),
        ("inertia = 0.3", "inertia = []"),
        ("values = [-0.8, 0.8]", "values = [0.8]"),
        ("[[servos.2.effects]]", "[[servos.2.defects]]"),
    ],
)
def test_damaged_drives_are_refused_in_one_line(old, new, made, tmp_path):
    path = tmp_path / "drives.toml"
    made.save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(PlumblineError) as error:
        plumbline.load(path)
    assert str(error.value).startswith("drives.toml")
    assert "\n" not in str(error.value)


def test_commands_of_another_number_of_joints_are_refused(made):
    with pytest.raises(PlumblineError, match=r"\(100, 2\)"):
        made.rollout(np.arange(100) * 0.02, np.zeros((100, 3)))
    t = np.arange(100.0) / 50
    u, q = np.outer(np.cos(t), [1.0, 0.5]), np.outer(np.sin(t), [1.0, 0.5])
    other = build_motion(robot=arm(), time=t, command=u, q=q, kind="velocity")
    with pytest.raises(PlumblineError, match="give a motion of the same drives"):
        made.tried(other)


T = np.arange(100) * 0.02


@pytest.mark.parametrize(
    ("time", "command", "start", "words"),
    [
        (T[::-1], 0.1, (), "time: found no step forwards, expected 2 or more, ascending"),
        (T[:1], 0.1, (), r"time: found an array \(1,\), expected 2 or more"),
        (1.0, 0.1, (), r"time: found an array \(\), expected 2 or more"),
        (T, np.nan, (), "command: found a value that is not finite"),
        (T, 0.1, [0.0], r"start: found an array \(1,\), expected \(2,\)"),
        (T, 0.1, [0.0, np.inf], "start: found a value that is not finite"),
        ("x", 0.1, (), "time: found no numbers"),
    ],
)
def test_a_rollout_that_cannot_be_made_is_refused_in_one_line(made, time, command, start, words):
    with pytest.raises(PlumblineError, match=words):
        made.rollout(time, np.full((np.size(time), 2), command), start=start)


def test_a_model_of_either_kind_is_tried_by_one_call_and_on_its_own_robot_alone(made, real):
    t, u, q = real
    own = build_motion(robot=arm(), time=t, command=u, q=q)
    assert plumbline.apply_model(made, own).after == made.tried(own).after
    longer = [row | {"a": row["a"] + 0.1} for row in ROWS]
    other = build_motion(robot=plumbline.Robot.from_dh(longer), time=t, command=u, q=q)
    with pytest.raises(PlumblineError, match="joints placed or turning otherwise"):
        plumbline.apply_model(made, other)
    with pytest.raises(PlumblineError, match="found tip_position, expected a motion as in made"):
        plumbline.apply_model(made, plumbline.load(plumbline.example()))


@pytest.fixture(scope="module")
def folder(real, tmp_path_factory):
    t, u, q = real
    out = tmp_path_factory.mktemp("motions") / "run"
    out.mkdir()
    noisy = q + np.random.default_rng(0).normal(0.0, 2e-4, q.shape)
    np.savetxt(out / "samples.csv", np.column_stack([t, u, noisy]), fmt="%.9g", delimiter=",",
               header="time,u1,u2,q1,q2", comments="")  # fmt: skip
    rows = "\n".join(
        "[[robot.dh]]\n" + "\n".join(f"{k} = {v}" for k, v in row.items()) for row in ROWS
    )
    head = 'name = "run"\nobservation = "motion"\nnoise_std = 2e-4\n[robot]\n'
    (out / "dataset.toml").write_text(f'{head}{rows}\n[motion]\ncommand = "position"\n')
    return out


def test_from_a_motion_to_a_file_for_mujoco_in_two_commands(folder, real, tmp_path, capsys):
    model, file = tmp_path / "drives.toml", tmp_path / "arm.xml"
    asked = ["diagnose", str(folder), "--model", str(model), "--unlisted", "0.1", "--quiet"]
    assert run(asked) == 0
    assert run(["export", str(model), "--mjcf", str(file), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["mjcf"]["unit"] == "rad"
    t, u, q = real
    assert (rms(replay(file.read_text(), t, u) - q) < 0.15 * rms(u - q)).all()
    assert run(["apply", str(model), str(folder), "--json", "-"]) == 0
    tried = json.loads(capsys.readouterr().out)
    assert tried["after"] < 0.1 * tried["before"]
    assert tried["holds"]
    assert run(["export", str(model), "--urdf", str(tmp_path / "no.urdf")]) == 2
    assert "holds no drives; --mjcf expected" in capsys.readouterr().err


def test_drives_are_tried_on_motions_alone(made, tmp_path, capsys):
    made.save(tmp_path / "drives.toml")
    assert run(["apply", str(tmp_path / "drives.toml"), str(plumbline.example())]) == 2
    assert "expected a motion" in capsys.readouterr().err
