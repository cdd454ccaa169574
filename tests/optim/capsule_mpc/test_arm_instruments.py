"""Arms behind the instruments: links as capsules, the trocar held, Pinocchio and coal watching."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest

from plumbline.experiments.mpc.arm_loop import BEND, POSTURE, Watch, arm_task, make_arm, run_arms
from plumbline.kinematics.capsules import bones
from plumbline.kinematics.robot import Robot
from plumbline.optim.capsule_mpc import (
    Noise,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.arms import held_tip
from plumbline.optim.capsule_mpc.stopping import held_exactly
from plumbline.optim.capsule_mpc.sweeps import tip_speed
from tests.in_mm import Controller


@pytest.mark.parametrize("name", ["ur5", "laparoscopic"])
def test_symbolic_link_capsules_are_where_pinocchio_has_them(name):
    chain = Robot.bundled(name).chain()
    links = bones(chain, 0.04)
    assert len(links) >= 5
    q, data = cs.SX.sym("q", chain.n), chain.model.createData()
    frames = chain.joint_frames(q)
    axes = cs.Function("axes", [q], [cs.horzcat(*(link.axis(frames).ends for link in links))])
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (10, chain.n)):
        pin.forwardKinematics(chain.model, data, chain.configuration(q))
        found = axes(q).full().T.reshape(-1, 2, 3)
        for link, ends in zip(links, found, strict=True):
            T = data.oMi[link.joint + 1]
            assert np.abs(np.stack([T.act(end) for end in link.ends]) - ends).max() < 1e-12


def test_the_held_posture_meets_trocar_and_tip():
    arm = make_arm(-1.0)
    wanted = np.array([-0.01, 0.004, 0.38])
    q = held_tip(arm, wanted, np.array([0.0, 0.2, 1.1, 0.0, 1.1, 0.0, 0.1]))
    watch = Watch((arm,), [])
    assert (q >= arm.chain.lower).all()
    assert (q <= arm.chain.upper).all()
    assert np.abs(watch.tips([q])[0] - 1e3 * wanted).max() < 1e-6
    x, c = cs.SX.sym("x", 7), cs.SX(cs.DM(arm.constants))
    held = cs.Function("h", [x], [arm.held(x, c)])
    assert np.abs(held(q / arm.unit).full()).max() < 1e-6
    with pytest.raises(ValueError, match="start elsewhere"):
        held_tip(arm, [0.9, 0.0, 2.0], q, passes=30)


def test_what_is_held_is_put_right_by_the_shortest_way():
    arms, q, goal, balls = arm_task(0)
    statement = Statement(arms, 0, Settings(p=2), len(balls))
    unit = statement.unit
    stage = statement.stages(1e3 * goal, [ball.scaled(1e3) for ball in balls])[0]
    off = q / unit + np.random.default_rng(1).normal(0, 0.5, 14)
    right = held_exactly(statement, off, stage)
    watch = Watch(arms, balls)
    assert watch.look(np.split(off * unit, 2))[1] > 0.1
    assert watch.look(np.split(right * unit, 2))[1] < 1e-5
    assert np.linalg.norm(right - off) < 3.0


def test_no_link_moves_farther_than_its_reach():
    arm = make_arm(1.0)
    x, c, within = cs.SX.sym("x", 7), cs.SX.sym("c", 3), cs.SX.sym("w", 7)
    ends = cs.horzcat(*(capsule.axis.ends for capsule in arm.capsules(x, c)))
    axes = cs.Function("a", [x, c], [ends])
    reach = cs.Function("r", [x, c, within], [cs.vertcat(*arm.reach(x, c, within))])
    rng = np.random.default_rng(2)
    low, high = arm.chain.lower / arm.unit, arm.chain.upper / arm.unit
    for _ in range(200):
        start = rng.uniform(low, high)
        end = np.clip(start + rng.uniform(-8, 8, 7), low, high)
        moved = (axes(end, 0) - axes(start, 0)).full().T.reshape(-1, 2, 3)
        bound = reach(start, 0, np.abs(end - start)).full().ravel()
        assert (np.linalg.norm(moved, axis=2).max(axis=1) <= bound + 1e-9).all()


def test_two_arms_reach_their_goals_on_their_trocars():
    found = run_arms(0, RealTime(compiled=False), p=5, most=80)
    assert found.reached
    assert found.within_limits
    assert found.rcm <= 0.01
    assert found.clearance > 2.0 - 0.1


@pytest.mark.parametrize("apart", [None, ()])
def test_an_arm_keeps_clear_of_itself_unless_told_otherwise(apart):
    """A forearm in a wide housing, and a goal at which the shaft would stand in it."""
    plain = make_arm(-1.0)
    links = tuple(
        replace(link, radius=0.095) if link.name == "joint4" else link for link in plain.links
    )
    arm = replace(plain, links=links, apart=apart)
    q, goal = held_tip(arm, [-0.04, 0.0, 0.385], POSTURE), np.array([-70.0, -60.0, 330.0])
    settings = Settings(p=5, effort=0.5, smooth=0.0, noise=Noise(bias=BEND))
    own = Controller(Statement((arm,), 0, settings), RealTime(compiled=False), Safety(budget=9.0))
    watch, gaps = Watch((arm,), []), []
    for _ in range(85):
        gaps.append(watch.look([q])[0])
        q = q + 0.02 * own.step(q / arm.unit, goal).rate * arm.unit
    assert gaps[0] > 30.0
    if apart is None:
        assert 2.0 - 0.05 < min(gaps) < 4.0
    else:
        assert min(gaps) < -5.0


def test_links_that_meet_in_a_joint_may_touch():
    arm = make_arm(1.0)
    assert [link.joint for link in arm.links] == [0, 1, 3, 5, 6]
    assert arm.own_pairs == ((0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4))
    mixed = replace(arm, links=arm.links[::-1])
    assert {tuple(4 - k for k in pair)[::-1] for pair in mixed.own_pairs} == set(arm.own_pairs)


def test_an_obstacle_is_not_compared_with_the_speed_of_a_joint():
    """60 rad/s are none of 60 mm/s: for arms an obstacle is where it is seen and goes on."""
    statement = Statement((make_arm(-1.0), make_arm(1.0)), 1, Settings(p=2))
    assert tip_speed(statement) == np.inf
    assert tip_speed(Statement((TipInstrument((0.0, 0.0, 0.0)),), 0)) == 60.0
