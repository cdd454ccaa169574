"""Torques are Pinocchio's, to rounding, for every tree; and linear in what bodies weigh."""

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.dynamics import Dynamics, Nominal, nominal_of
from plumbline.kinematics.robot import Robot, bundled_names
from tests.random_trees import Tree

TREES = [Tree.drawn(seed, 3 + seed % 9, (0.0, 0.5)[seed % 2]) for seed in range(12)]
GRAVITY = np.array([1.0, -2.0, -9.0])


def rows(dynamics: Dynamics, count: int = 7):
    rng = np.random.default_rng(3)
    return rng.uniform(-2, 2, (count, dynamics.n)), *rng.normal(0, 2, (2, count, dynamics.n))


def configuration(dynamics: Dynamics, q):
    values = np.zeros(dynamics.model.nq)
    for i, angle in enumerate(q):
        joint = dynamics.model.joints[i + 1]
        both = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        values[joint.idx_q : joint.idx_q + joint.nq] = both
    return values


def by_pinocchio(dynamics: Dynamics, q, v, a):
    data = dynamics.model.createData()
    return np.array(
        [
            pin.rnea(dynamics.model, data, configuration(dynamics, one), two, three)
            for one, two, three in zip(q, v, a, strict=True)
        ]
    )


@pytest.mark.parametrize("name", bundled_names())
def test_torques_of_bundled_robots_are_pinocchios(name):
    dynamics = Robot.bundled(name).with_gravity(GRAVITY).dynamics()
    q, v, a = rows(dynamics)
    expected = by_pinocchio(dynamics, q, v, a)
    scale = max(np.abs(expected).max(), 1.0)
    np.testing.assert_allclose(dynamics.torques(q, v, a), expected, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize("tree", TREES, ids=str)
def test_torques_of_random_trees_are_pinocchios(tree):
    dynamics = Robot.from_urdf(tree.urdf()).with_gravity(GRAVITY).dynamics()
    q, v, a = rows(dynamics)
    expected = by_pinocchio(dynamics, q, v, a)
    scale = max(np.abs(expected).max(), 1.0)
    np.testing.assert_allclose(dynamics.torques(q, v, a), expected, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize("tree", TREES[:4], ids=str)
def test_the_regressor_times_the_inertial_parameters_is_the_torque(tree):
    dynamics = Robot.from_urdf(tree.urdf()).dynamics()
    q, v, a = rows(dynamics)
    data = dynamics.model.createData()
    for one, two, three in zip(q, v, a, strict=True):
        Y = dynamics.regressor_function(np.concatenate([one, two, three])).full()
        at = configuration(dynamics, one)
        expected = pin.computeJointTorqueRegressor(dynamics.model, data, at, two, three)
        np.testing.assert_allclose(Y, expected, atol=1e-9)


def test_at_rest_torques_hold_the_arm_against_gravity():
    robot = Robot.bundled("ur5")
    dynamics, chain = robot.dynamics(), robot.chain()
    q = np.array([0.3, -1.0, 1.2, 0.1, 0.4, -0.2])
    still = np.zeros(6)
    held = chain.gravity_torque(q, 0.0).full().ravel()
    np.testing.assert_allclose(dynamics.torques(q, still, still)[0], held, atol=1e-10)


def test_motion_on_earth_less_rest_is_motion_without_gravity():
    robot = Robot.bundled("ur5")
    heavy, light = robot.dynamics(), robot.with_gravity(np.zeros(3)).dynamics()
    q, v, a = rows(heavy)
    still = np.zeros_like(q)
    rest = heavy.torques(q, still, still)
    np.testing.assert_allclose(heavy.torques(q, v, a) - rest, light.torques(q, v, a), atol=1e-9)


def test_rows_of_another_robot_are_refused():
    dynamics = Robot.bundled("ur5").dynamics()
    with pytest.raises(PlumblineError, match="N x 6 expected"):
        dynamics.torques(np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((2, 6)))


def test_a_row_in_symbols_of_its_own_is_of_no_arm_that_others_share():
    chain = Robot.bundled("ur5").chain()
    shared = nominal_of(chain, carrying=True)
    same = {"q": shared.q, "payload": shared.payload}
    assert Nominal.at(chain, same) is shared
    for name, symbol in (("q", cs.SX.sym("q", chain.n)), ("payload", cs.SX.sym("payload"))):
        own = Nominal.at(chain, same | {name: symbol})
        assert getattr(own, name) is symbol
        cs.Function("load", [*(same | {name: symbol}).values()], [own.load])
    assert Nominal.at(chain, {"q": shared.q}).payload.is_zero()
