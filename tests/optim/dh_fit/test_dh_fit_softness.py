"""Joints that give way under weight bias links; a fit's errors allow for it as the misfits do."""

import numpy as np
import pytest

from plumbline.experiments.benches.dh_fit_coverage import holds, recording_of
from plumbline.experiments.reality.arms import bh7, ur5
from plumbline.experiments.reality.tip_readings import Reality, draw_crooked
from plumbline.kinematics.link_table import link_table
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.constants import STILL
from plumbline.optim.dh_fit import answer as numbers
from plumbline.optim.dh_fit import constants, fit_dh
from plumbline.optim.dh_fit.softness import SIZES, _size, joints, turns

TOOL = np.array([0.03, -0.02, 0.15])
DOWN = np.array([0.0, 0.0, -9.81])


def fitted(arm, compliance, seed, noise=1e-4):
    """A fit of an arm whose joints give way, and the truth behind it."""
    rng = np.random.default_rng(seed)
    drawn = draw_crooked(arm, Reality(compliance=compliance, noise=noise), 60, rng, tool=TOOL)
    return fit_dh(recording_of(arm, drawn, None)), drawn.truth


def test_intervals_hold_the_truth_of_an_arm_whose_joints_give_way():
    held = [inside for seed in range(12) for inside in holds(*fitted(ur5(), 1e-5, seed)).values()]
    assert 0.93 <= np.mean(held) <= 0.995


def test_a_stiff_arm_s_errors_are_hardly_wider_for_it(monkeypatch):
    fit, _ = fitted(ur5(), 0.0, 3)
    monkeypatch.setattr(numbers, "softness", lambda *_: np.zeros((len(fit._basis), 0)))
    plain, _ = fitted(ur5(), 0.0, 3)
    ratio = [a.std / b.std for a, b in zip(fit.quantities, plain.quantities, strict=True)]
    assert min(ratio) >= 1.0 - 1e-9
    assert np.median(ratio) < 1.1


def test_a_soft_arm_s_errors_are_wider_where_its_weight_turns_joints():
    wide, narrow = (
        {q.parts[0][0]: q.std for q in fitted(ur5(), c, 4)[0].quantities} for c in (3e-5, 0)
    )
    assert wide["joint 2 theta"] > 3.0 * narrow["joint 2 theta"]


@pytest.mark.parametrize("name", ["ur5", "bh7", "kr300"])
def test_a_turn_moves_the_tip_as_the_joint_does(name):
    robot = Robot.bundled(name)
    chain = robot.chain()
    q = np.random.default_rng(0).uniform(-0.9, 0.9, (7, chain.n))
    tips = chain.tips(q, np.zeros(3))
    G = turns(link_table(robot, chain), q, tips, np.array([0.3, -0.2, -1.0]))
    moves = []
    for j in (j for j, kind in enumerate(chain.kinds) if kind == "revolute"):
        step = 1e-6 * np.eye(chain.n)[j]
        moves.append((chain.tips(q + step, np.zeros(3)) - chain.tips(q - step, np.zeros(3))) / 2e-6)
    for column in np.moveaxis(G, 2, 0):
        across = [np.abs(np.cross(column, move)).max() for move in moves]
        assert min(across) < 1e-7 * max(np.abs(column).max(), 1.0)
    assert G.shape[2] >= 2


@pytest.mark.parametrize("name", ["ur5", "kr300"])
def test_a_weight_at_the_tip_turns_each_joint_as_far_as_it_lowers_the_tip_over_the_reach(name):
    robot = Robot.bundled(name)
    chain, down = robot.chain(), DOWN / 9.81
    q = np.random.default_rng(0).uniform(-0.9, 0.9, (7, chain.n))
    tips, links = chain.tips(q, np.zeros(3)), link_table(robot, chain)
    reach = np.linalg.norm(tips - joints(links, q)[1][0], axis=1).max()
    columns = np.moveaxis(turns(links, q, tips, DOWN), 2, 0)
    for step in 1e-6 * np.eye(chain.n)[1:3]:
        move = (chain.tips(q + step, np.zeros(3)) - chain.tips(q - step, np.zeros(3))) / 2e-6
        turned = move * (move @ down)[:, None] / reach
        assert min(np.abs(column - turned).max() for column in columns) < 1e-8


def test_misfits_tell_how_far_joints_give_way():
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        links, soft = rng.normal(size=(300, 3)), 1e7 * rng.normal(size=(300, 40))
        found.append(_size(links, soft, soft @ rng.normal(0.0, 1e-4, 40) + rng.normal(size=300)))
    assert np.mean(found) == pytest.approx(1e-4, rel=0.15)


def test_upright_axes_carry_no_weight():
    robot = Robot.bundled("bh7")
    chain = robot.chain("link3")
    q = np.random.default_rng(0).uniform(0.1, 0.9, (7, chain.n))
    assert turns(link_table(robot, chain), q, chain.tips(q, np.zeros(3)), DOWN).shape[2] == 0


def test_a_robot_without_weight_has_no_such_error():
    fit, _ = fitted(bh7(), 0.0, 5)
    assert np.isfinite([q.std for q in fit.quantities]).all()
    assert SIZES[0] == pytest.approx(1e-7)
    assert SIZES[-1] == pytest.approx(1e-2)


def test_thresholds_stand_where_they_were_set():
    assert (constants.CHANCE, constants.STATED_WITHIN, STILL) == (1e-3, 1.1, 0.1)
    assert (constants.FALSE_ALARM, constants.SLACK, constants.MOST_SHARE) == (0.01, 1.7, 0.4)
    assert (constants.SLIGHT, constants.WHOLE) == (0.1, 0.01)
