"""Physics of torques: bodies against Pinocchio, drives against MuJoCo, all else in closed form."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.payload import LIGHTEST, CarriedMass
from plumbline.kinematics.effects.trocar_load import SHORTEST_SHAFT
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.measurement.constants import UNIT
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.efforts import nominal_efforts
from tests.benches import residuals
from tests.random_trees import Tree
from tests.trocars import SHAFT, SIDE, TROCAR, through_a_trocar

URDF = """<robot name="two">
 <link name="world"/>
 <link name="upper"><inertial><origin xyz="0.02 0.1 -0.2"/><mass value="3"/>
  <inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0.002" ixz="-0.003" iyz="0.001"/></inertial></link>
 <link name="lower"><inertial><origin xyz="0.05 0 -0.15"/><mass value="1.5"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.016" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
 <joint name="a" type="continuous"><parent link="world"/><child link="upper"/>
  <origin xyz="0 0 1" rpy="0.2 0 0.1"/><axis xyz="0 1 0"/></joint>
 <joint name="b" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0.05 -0.4" rpy="0 0.3 0"/><axis xyz="1 0 0"/></joint>
</robot>"""
N = 40


def motion(n, rows=N, seed=3):
    """Places, velocities and accelerations (rows, n) of nothing in particular."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (rows, n)), rng.normal(0, 1.5, (rows, n)), rng.normal(0, 4, (rows, n))


def recording(robot, q, v, a, efforts=None, **given):
    efforts = robot.dynamics().torques(q, v, a) if efforts is None else efforts
    return build_recording(
        observation="joint_torque", robot=robot, q=q, velocity=v, acceleration=a, measured=efforts,
        noise_by_joint=np.ones(q.shape[1]), **given,
    )  # fmt: skip


def predicted(rec, effects=(), values=()):
    """Torques (N, n) that the effects foretell [N m]."""
    return residuals(rec, effects, values) / UNIT + rec.measured


@pytest.fixture(scope="module")
def two():
    robot = Robot.from_urdf(URDF, name="two")
    q, v, a = motion(2)
    return robot, q, v, a, recording(robot, q, v, a)


@pytest.fixture(scope="module")
def simulator():
    return mujoco.MjModel.from_xml_string(URDF)


def inverse(model, q, v, a):
    """MuJoCo's inverse dynamics (N, n) [N m]."""
    data, found = mujoco.MjData(model), []
    for row in zip(q, v, a, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found)


def test_bodies_take_the_torque_that_two_other_engines_say(two, simulator):
    robot, q, v, a, rec = two
    tau = predicted(rec)
    model, data = robot.dynamics().model, robot.dynamics().model.createData()
    configuration = rec.chain.configuration
    oracle = [pin.rnea(model, data, configuration(q[k]), v[k], a[k]) for k in range(N)]
    np.testing.assert_allclose(tau, oracle, atol=1e-10)
    np.testing.assert_allclose(tau, inverse(simulator, q, v, a), atol=1e-10)


def test_a_payload_that_was_recorded_hangs_at_the_tools_tip(two):
    robot, q, v, a, _ = two
    tool, mass = np.array([0.1, 0.02, -0.2]), np.linspace(0.0, 2.0, N)
    oracle = []
    for k in range(N):
        model = robot.dynamics().model.copy()
        tip = tree_of(robot).T_last_tip
        place = pin.SE3(tip) * pin.SE3(np.eye(3), tool)
        model.appendBodyToJoint(2, pin.Inertia(mass[k], np.zeros(3), np.zeros((3, 3))), place)
        at = tree_of(robot).configuration(q[k])
        oracle.append(pin.rnea(model, model.createData(), at, v[k], a[k]))
    rec = recording(robot, q, v, a, np.array(oracle), payload=mass, tool_offset=tool)
    np.testing.assert_allclose(predicted(rec), oracle, atol=1e-10)
    np.testing.assert_allclose(nominal_efforts(rec), oracle, atol=1e-10)
    borne = nominal_efforts(rec, (0.0, 0.0, 0.0))
    expected = nominal_efforts(replace(rec, chain=replace(rec.chain, gravity=np.zeros(3))))
    np.testing.assert_allclose(borne, expected, atol=1e-10)
    assert np.abs(expected - oracle).max() > 1.0


@pytest.mark.parametrize("seed", range(4))
def test_a_tree_has_all_limbs_and_agrees_with_pinocchio(seed):
    rng = np.random.default_rng(seed)
    robot = Robot.from_urdf(Tree(seed, ("revolute", "prismatic", "revolute", "revolute")).urdf())
    tree = tree_of(robot)
    q = rng.uniform(-1, 1, (5, tree.n))
    data = tree.model.createData()
    for row in q:
        gravity = pin.computeGeneralizedGravity(tree.model, data, tree.configuration(row))
        own = tree.gravity_torque(row, 0.0).full().ravel()
        np.testing.assert_allclose(own, gravity, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("rotor_inertia", "dof_armature", 0.7),
        ("viscous_friction", "dof_damping", 1.3),
        ("coulomb_friction", "dof_frictionloss", 2.1),
    ],
)
def test_a_drive_is_that_of_mujoco(two, simulator, name, field, value):
    _, q, v, a, rec = two
    getattr(simulator, field)[1] = value
    theirs = inverse(simulator, q, v, a)
    getattr(simulator, field)[1] = 0.0
    ours = predicted(rec, [REGISTRY[name](joint=2)], [value])
    # MuJoCo's dry friction is a soft constraint, within per mille once the joint really turns.
    moving = (np.abs(v) > 0.2).all(axis=1) if name == "coulomb_friction" else np.full(N, True)
    np.testing.assert_allclose(ours[moving], theirs[moving], atol=2e-3 * value)
    assert np.ptp(theirs[:, 1] - predicted(rec)[:, 1]) > value


def test_creeping_and_thinning_friction_are_their_formulas(two):
    _, _, v, _, rec = two
    bare, sign = predicted(rec)[:, 0], rec.turning[:, 0]
    creeping = REGISTRY["stribeck_friction"](joint=1, speed=0.4)
    expected = 1.7 * np.exp(-((v[:, 0] / 0.4) ** 2)) * sign
    np.testing.assert_allclose(predicted(rec, [creeping], [1.7])[:, 0] - bare, expected, atol=1e-9)
    thinning = REGISTRY["viscous_friction"](joint=1, power=0.5)
    expected = 1.7 * np.sqrt(np.abs(v[:, 0])) * sign
    np.testing.assert_allclose(predicted(rec, [thinning], [1.7])[:, 0] - bare, expected, atol=1e-9)
    greased = REGISTRY["coulomb_friction"](joint=1, creep=0.05)
    expected = 1.7 * np.tanh(v[:, 0] / 0.05)
    np.testing.assert_allclose(predicted(rec, [greased], [1.7])[:, 0] - bare, expected, atol=1e-9)
    assert "over 0.05 rad/s" in greased.variant


def test_dry_friction_with_a_way_changes_sides_over_it_and_remembers_where_it_was():
    robot, step = Robot.from_urdf(URDF, name="two"), 2.5e-3
    turns = np.repeat([1.0, -1.0, 1.0, -1.0], [20, 4, 2, 20])
    q = np.column_stack([step * np.cumsum(turns), np.zeros(len(turns))])
    rec = recording(robot, q, 0 * q, 0 * q)
    side = np.ones(len(turns))
    for k in range(1, len(turns)):
        side[k] = np.clip(side[k - 1] + 2 * turns[k] * step / 0.02, -1.0, 1.0)
    rubbing = REGISTRY["coulomb_friction"](joint=1, way=0.02)
    more = (predicted(rec, [rubbing], [3.0]) - predicted(rec))[:, 0]
    np.testing.assert_allclose(more, 3.0 * side, atol=1e-9)
    assert 0.1 < np.abs(side[22:26]).max() < 0.9  # it is seen between its sides
    assert "0.02 rad" in rubbing.variant


@pytest.mark.parametrize(
    ("name", "fields", "values", "expected"),
    [
        ("load_friction", {}, [0.3], lambda q, bare, sign: 0.3 * np.abs(bare) * sign),
        ("torque_scale", {}, [0.2], lambda q, bare, sign: 0.2 * bare),
        ("torque_offset", {}, [-0.4], lambda q, bare, sign: np.full(N, -0.4)),
        ("cable_spring", {"middle": 0.3}, [2, 0.5], lambda q, bare, sign: 2 * (q - 0.3) + 0.5),
    ],
)
def test_what_a_drive_exerts_besides_is_its_formula(two, name, fields, values, expected):
    _, q, _, _, rec = two
    bare, sign = predicted(rec)[:, 1], rec.turning[:, 1]
    more = predicted(rec, [REGISTRY[name](joint=2, **fields)], values)[:, 1] - bare
    np.testing.assert_allclose(more, expected(q[:, 1], bare, sign), atol=1e-8)


def rnea(model, q, v, a):
    data = model.createData()
    place = np.array([(np.cos(x), np.sin(x)) for x in q.ravel()]).reshape(len(q), -1)
    return np.array([pin.rnea(model, data, *row) for row in zip(place, v, a, strict=True)])


def test_a_link_of_other_mass_and_centre_is_pinocchio_s(two):
    robot, q, v, a, rec = two
    model = robot.dynamics().model.copy()
    was, share, shift = model.inertias[2], 0.4, np.array([0.03, -0.02, 0.05])
    mass = was.mass * (1 + share)
    model.inertias[2] = pin.Inertia(
        mass, was.lever + shift / (1 + share), was.inertia * (1 + share)
    )
    ours = predicted(rec, [REGISTRY["link_inertia"](link=2)], [share, *shift])
    np.testing.assert_allclose(ours, rnea(model, q, v, a), atol=1e-9)


def test_gravity_that_points_elsewhere_is_pinocchio_s(two):
    robot, q, v, a, rec = two
    model = robot.dynamics().model.copy()
    model.gravity.linear = pin.exp3(np.array([0.1, -0.2, 0.0])) @ model.gravity.linear
    ours = predicted(rec, [REGISTRY["gravity_direction"]()], [0.1, -0.2])
    np.testing.assert_allclose(ours, rnea(model, q, v, a), atol=1e-9)


def carrying(two, load, still=False):
    """Oracle's torques with a load at the tip frame, and the recording of the same motion."""
    robot, q, v, a, _ = two
    q, v, a = q, v * (not still), a * (not still)
    model = robot.dynamics().model.copy()
    rec = recording(robot, q, v, a)
    model.inertias[2] += pin.SE3(rec.chain.T_last_tip).act(load)
    return rnea(model, q, v, a), rec


def test_a_payload_is_a_body_at_the_tip(two):
    mass, moment = 2.0, np.array([0.1, -0.05, 0.2])
    load = pin.Inertia(
        mass, moment / mass, np.array([[0.3, 0.1, 0], [0.1, 0.4, -0.05], [0, -0.05, 0.2]])
    )
    oracle, rec = carrying(two, load)
    about = load.matrix()[3:, 3:]
    values = [mass, *moment, *about[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]]
    np.testing.assert_allclose(predicted(rec, [CarriedMass(True)], values), oracle, atol=1e-9)


def test_a_payload_is_a_point_at_the_tip(two):
    mass, moment = 2.0, np.array([0.1, -0.05, 0.2])
    load, values = pin.Inertia(mass, moment / mass, np.zeros((3, 3))), [mass, *moment]
    oracle, rec = carrying(two, load)
    # Its inertia is rounded by a hundredth of a kilogram, so that a payload may be none.
    rounded = 10 * LIGHTEST * 0.25
    np.testing.assert_allclose(predicted(rec, [CarriedMass()], values), oracle, atol=rounded)
    oracle, rec = carrying(two, load, still=True)
    np.testing.assert_allclose(predicted(rec, [CarriedMass()], values), oracle, atol=1e-9)


def test_bodies_are_expected_to_err_by_the_weight_and_reach_of_their_arm(two):
    rec = two[-1]
    load = REGISTRY["payload"].candidates(scope_of(rec))[-1]
    link = REGISTRY["link_inertia"].candidates(scope_of(rec))[0]
    arm, reach = 4.5, 1.4  # kg; m, to two digits
    assert sum(body.mass for body in rec.chain.joints) == arm
    assert rec.chain.reach == pytest.approx(reach, abs=0.05)
    widths = [p.scale for p in (*load.parameters, *link.parameters)]
    wide = [0.06 * arm, *3 * [0.006 * arm * reach], *3 * [2.4e-3 * arm * reach**2]]
    wide += 3 * [6e-4 * arm * reach**2]
    np.testing.assert_allclose(widths, [*wide, 0.1, *3 * [0.02 * reach]])
    ends = [(p.lower, p.upper) for p in (*load.parameters, *link.parameters)]
    far = (-10 * arm * reach, 10 * arm * reach)
    large = [(0, 10 * arm), *3 * [far], *6 * [(-10 * arm * reach**2, 10 * arm * reach**2)]]
    other = (-0.5 * reach, 0.5 * reach)
    np.testing.assert_allclose(ends, [*large, (-0.9, 4.0), *3 * [other]])


@pytest.mark.parametrize(("friction", "side"), [(1.3, 0 * SIDE), (0.0, SIDE)])
def test_a_trocar_s_forces_are_pinocchio_s_forces_on_the_last_body(two, friction, side):
    robot, q, v, a, _ = two
    rec = recording(robot, q, v, a, tool_offset=SHAFT)
    (effect,) = REGISTRY["trocar_load"].candidates(scope_of(rec))
    ours = predicted(rec, [effect], [friction, *side, *np.cross(TROCAR, side)])
    theirs = through_a_trocar(rec.chain, (q, v, a), SHAFT, friction, side)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    assert np.abs(ours - predicted(rec)).max() > 0.1


def test_a_trocar_is_looked_for_where_a_shaft_is_stated(two):
    robot, q, v, a, rec = two
    assert not REGISTRY["trocar_load"].candidates(scope_of(rec))
    long = recording(robot, q, v, a, tool_offset=(0.0, 0.0, SHORTEST_SHAFT))
    short = recording(robot, q, v, a, tool_offset=(0.0, 0.0, 0.99 * SHORTEST_SHAFT))
    assert REGISTRY["trocar_load"].candidates(scope_of(long))
    assert not REGISTRY["trocar_load"].candidates(scope_of(short))
