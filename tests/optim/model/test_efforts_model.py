"""A model of efforts that is taken home says what drives read, and its files say the same."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import plumbline
from plumbline.experiments.commands.app import run
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.model import Model
from plumbline.optim.model.fitted import HeldOutGap
from plumbline.optim.model.making import FitEnd, model_of
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.efforts import payload_efforts
from tests.random_trees import Tree

N = 4
CAUSES = {
    REGISTRY["coulomb_friction"](joint=2): [0.6],
    REGISTRY["viscous_friction"](joint=1): [0.3],
    REGISTRY["rotor_inertia"](joint=3): [0.05],
    REGISTRY["cable_spring"](joint=2, middle=0.2): [0.8, 0.1],
    REGISTRY["link_inertia"](link=2): [0.2, 0.01, -0.02, 0.03],
    CarriedMass(True): [0.4, 0.01, 0.0, 0.02, 0.003, 0.004, 0.002, 0.0002, 0.0, 0.0001],
    REGISTRY["gravity_direction"](): [0.05, -0.03],
    REGISTRY["stribeck_friction"](joint=4, speed=0.3): [0.2],
    REGISTRY["torque_offset"](joint=1): [0.15],
}


def motion(rows=60, seed=0):
    """Postures, velocities that are sure of their sign, accelerations (rows, N)."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0.3, 2.0, (rows, N)) * rng.choice([-1.0, 1.0], (rows, N))
    return rng.uniform(-1.0, 1.0, (rows, N)), speed, rng.uniform(-3.0, 3.0, (rows, N))


@pytest.fixture(scope="module")
def recording():
    robot = Robot.from_urdf(Tree(3, ("revolute",) * N).urdf())
    q, v, a = motion()
    return build_recording(
        observation="joint_torque", robot=robot, q=q, velocity=v, acceleration=a, name="swung",
        measured=tree_of(robot).dynamics.torques(q, v, a), noise_std=0.1,
    )  # fmt: skip


def found(recording, causes):
    """The model of a recording with these causes."""
    stated = build_model(recording, tuple(causes))
    x = np.concatenate(list(causes.values()))
    precision = np.diag((1e3 / np.maximum(np.abs(x), 1e-2)) ** 2)
    fit = FitEnd(stated.nuisance, tuple(causes), x, stated.problem.scale, precision)
    return model_of(recording, fit, HeldOutGap(1.0, 0.1, 0.1, "N m", 0.1))


@pytest.fixture(scope="module")
def model(recording):
    return found(recording, CAUSES)


def test_efforts_are_those_of_the_bodies_and_of_every_cause(model, recording):
    """Beside Pinocchio's bodies what each formula adds."""
    alone = found(recording, {e: v for e, v in CAUSES.items() if e.stage == "actuation"
                              and e.element is not None and e.name != "link_inertia"})  # fmt: skip
    q, v, a = motion(seed=1)
    tau = tree_of(recording.robot).dynamics.torques(q, v, a)
    tau[:, 1] += 0.6 * np.sign(v[:, 1]) + 0.8 * (q[:, 1] - 0.2) + 0.1
    tau[:, 0] += 0.3 * v[:, 0] + 0.15
    tau[:, 2] += 0.05 * a[:, 2]
    tau[:, 3] += 0.2 * np.exp(-((v[:, 3] / 0.3) ** 2)) * np.sign(v[:, 3])
    np.testing.assert_allclose(alone.tau(q, v, a), tau, atol=1e-12)
    np.testing.assert_allclose(alone.tau(q[0], v[0], a[0])[0], tau[0], atol=1e-12)
    assert np.abs(model.tau(q, v, a) - tau).max() > 0.1


def test_a_payload_that_was_recorded_is_asked_for_and_is_in_no_file(recording):
    """Left out it is the mean one; a file has the robot alone."""
    q, v, a = motion(seed=8)
    mass, rows = np.linspace(0.0, 2.0, len(q)), len(recording)
    friction = REGISTRY["coulomb_friction"](joint=2)
    laden = replace(recording, payload=np.full(rows, 1.0), tool_offset=np.array([0.1, 0.0, 0.2]))
    model = found(laden, {friction: [0.6]})
    bare = found(recording, {friction: [0.6]})
    carried = replace(laden, q=q, velocity=v, acceleration=a, payload=mass)
    more = payload_efforts(carried)
    assert np.abs(more).max() > 1.0
    np.testing.assert_allclose(model.tau(q, v, a, payload=mass), bare.tau(q, v, a) + more)
    np.testing.assert_allclose(model.tau(q, v, a), model.tau(q, v, a, payload=1.0))
    assert model.function().name_in() == ["q", "velocity", "acceleration", "payload"]
    for made in (model.as_urdf(), model.as_mjcf()):
        assert made.stays == 0.0


def test_the_covariance_is_the_slope_s(model):
    """Joint 4 errs by its Stribeck friction's own error, and by that of the bodies behind it."""
    bare = model.of([k for k, e in enumerate(model.effects) if e.name == "stribeck_friction"])
    q, v, a = motion(rows=2, seed=2)
    std = np.sqrt(bare.covariance[-1, -1]) * np.exp(-((v[:, 3] / 0.3) ** 2))
    covariance = bare.tau_covariance(q, v, a)
    np.testing.assert_allclose(covariance[:, 3, 3], std**2)
    assert (model.tau_covariance(q, v, a)[:, 3, 3] > covariance[:, 3, 3]).all()


def test_a_stored_model_of_efforts_says_the_same(model, tmp_path):
    model.save(tmp_path / "efforts.toml")
    again = plumbline.load(tmp_path / "efforts.toml")
    assert isinstance(again, Model)
    np.testing.assert_allclose(again.tau(*motion(seed=4)), model.tau(*motion(seed=4)), atol=1e-9)
    np.testing.assert_allclose(again.samples["acceleration"], model.samples["acceleration"])


def test_the_c_code_s_function_is_the_model(model):
    made = model.function()
    assert made.name_in() == ["q", "velocity", "acceleration"]
    q, v, a = motion(rows=1, seed=5)
    np.testing.assert_allclose(made(q[0], v[0], a[0]).full().T, model.tau(q, v, a), atol=1e-12)
    assert "tau (n,) [N m or N]" in model.as_c().text


def test_mujoco_s_inverse_dynamics_of_the_file_agree(model):
    """To what a gram moves, which MuJoCo needs of a body without mass."""
    mujoco = pytest.importorskip("mujoco")
    made = model.as_mjcf()
    assert {lack.label for lack in made.lacks} == {"stribeck_friction 4", "torque_offset 1"}
    assert made.unit == "N m"
    read = mujoco.MjModel.from_xml_string(made.text)
    data = mujoco.MjData(read)
    held = model.without("stribeck_friction", "torque_offset")
    q, v, a = motion(seed=6)
    for row, tau in zip(zip(q, v, a, strict=True), held.tau(q, v, a), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(read, data)
        np.testing.assert_allclose(data.qfrc_inverse, tau, atol=1e-3)
    stays = np.sqrt(np.mean((held.tau(*motion()) - model.tau(*motion())) ** 2))
    assert made.stays == pytest.approx(stays)


def test_pinocchio_s_inverse_dynamics_of_the_urdf_agree(model, recording):
    made = model.as_urdf()
    out = {"stribeck_friction", "torque_offset", "rotor_inertia", "cable_spring"}
    out |= {"gravity_direction"}
    assert {lack.label.split()[0] for lack in made.lacks} == out
    robot = Robot.from_urdf(made.text, gravity=recording.robot.gravity)
    read, held = robot.model, model.without(*out)
    read.gravity.linear = robot.gravity
    q, v, a = motion(seed=7)
    friction = read.damping * v + read.friction * np.sign(v)
    chain = tree_of(robot)
    tau = [pin.rnea(read, read.createData(), chain.configuration(x), y, z)
           for x, y, z in zip(q, v, a, strict=True)]  # fmt: skip
    np.testing.assert_allclose(np.array(tau) + friction, held.tau(q, v, a), atol=1e-9)


def test_files_have_dry_friction_as_it_slides_of_all_its_forms_together(recording):
    rubs = REGISTRY["coulomb_friction"]
    forms = {rubs(joint=2): [0.2], rubs(joint=2, creep=0.05): [0.3], rubs(joint=2, way=0.02): [0.4]}
    made = found(recording, forms)
    read = Robot.from_urdf(made.as_urdf().text).model
    np.testing.assert_allclose(read.friction, [0.0, 0.9, 0.0, 0.0])
    joints = ElementTree.fromstring(made.as_mjcf().text).iter("joint")
    lost = [float(joint.get("frictionloss", "0")) for joint in joints]
    np.testing.assert_allclose(lost, [0.0, 0.9, 0.0, 0.0])


def test_the_commands_take_efforts_home(model, recording, tmp_path, capsys):
    toml = tmp_path / "efforts.toml"
    model.save(toml)
    files = {k: tmp_path / f"arm.{k}" for k in ("urdf", "mjcf", "csv", "c")}
    words = [word for k, path in files.items() for word in (f"--{k}", str(path))]
    assert run(["export", str(toml), *words, "--json", str(tmp_path / "out.json")]) == 0
    told = json.loads((tmp_path / "out.json").read_text())
    assert told["mjcf"]["unit"] == "N m"
    assert told["c"]["lacks"] == []
    assert "torque_offset 1" in capsys.readouterr().out
