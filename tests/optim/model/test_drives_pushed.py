"""Drives taken home that push: what they do with other torques is what MuJoCo's bodies do."""

import mujoco
import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion import forward as forward_module
from plumbline.optim.model.driven import Driven, Servo
from tests.pushed_arms import pushed_arm

NAMES = {e.name: e for e in MOTION_EFFECTS}
STEP, DT, ROWS = 2e-4, 0.005, 300
AXES, LENGTHS, MASSES = ("0 1 0", "0 1 0", "1 0 0"), (0.3, 0.2, 0.1), (2.0, 1.0, 0.5)
INERTIAS = (0.02, 0.008, 0.001)  # [kg m^2]


def arms():
    """A robot and MuJoCo's model of it."""
    urdf, model = pushed_arm(AXES, LENGTHS, MASSES, INERTIAS, STEP, "0 0.01")
    return Robot.from_urdf(urdf), model


def told(t):
    """Torques (..., 3) [N m]."""
    turns, phase = np.array([5.0, 7.0, 9.0]), np.array([0.3, 1.0, 2.0])
    return np.sin(np.multiply.outer(t, turns) + phase) * [1.2, 0.3, 0.03]


def moved(start, *, straight=False, late=0.0, damping=0.0, dry=0.0):
    """What MuJoCo's joints do (ROWS, 3) [rad]."""
    model = arms()[1]
    model.dof_damping[:], model.dof_frictionloss[:] = damping, dry
    data, seen, t, per = mujoco.MjData(model), [], DT * np.arange(ROWS), round(DT / STEP)
    data.qpos[:] = start
    rows, times = told(t), STEP * np.arange(per * (ROWS - 1)) - late
    if straight:
        u = np.column_stack([np.interp(times + STEP / 2, t, x) for x in rows.T])
    else:
        u = rows[np.maximum((times / DT + 1e-6).astype(int), 0)]
    for k, push in enumerate([*u, u[-1]]):
        if k % per == 0:
            seen.append(data.qpos.copy())
        data.ctrl[:] = push
        mujoco.mj_step(model, data)
    return np.array(seen)


def drives(law=Law.TORQUE, **values):
    """The same arm's, each joint with these effects."""
    effects = tuple(NAMES[name]() for name in values)
    by = np.array([*values.values()], dtype=float)
    servo = Servo(effects, by, 0 * by, 1.0, np.array([-9.0, 9.0]))
    robot = arms()[0]
    return Driven(
        "made", robot, tuple(f"j{k}" for k in range(3)), (0, 1, 2), law, np.zeros(3), np.zeros(3),
        dict.fromkeys((1, 2, 3), servo) if values else {}, 1.0, 1.0,
    )  # fmt: skip


T, START = DT * np.arange(ROWS), np.array([0.2, -0.4, 0.1])
CASES = {
    "nothing": ({}, {}, 3e-4),
    "viscous friction": ({"damping": 0.02}, {"viscous_friction": 0.02}, 3e-4),
    "a delay": ({"late": 0.012}, {"actuation_delay": 0.012}, 3e-4),
    # MuJoCo's dry friction gives way a little before it slides.
    "dry friction": ({"dry": 0.01}, {"coulomb_friction": 0.01}, 0.05),
}


@pytest.mark.parametrize("case", CASES)
def test_torques_move_coupled_bodies_as_mujoco_does(case):
    """One and a half seconds of an arm that swings by turns; once they ran off by radians."""
    given, values, most = CASES[case]
    expected = moved(START, **given)
    there = drives(**values).rollout(T, told(T), start=START)
    assert np.ptp(expected, axis=0).min() > 0.25
    assert np.abs(there - expected).max() < most


def test_torques_that_run_straight_from_row_to_row_are_not_held():
    expected = moved(START, straight=True)
    there = drives(Law.SAMPLED_TORQUE).rollout(T, told(T), start=START)
    held = drives().rollout(T, told(T), start=START)
    assert np.abs(there - expected).max() < 1e-3
    assert np.abs(held - expected).max() > 0.02


def test_rows_may_be_unevenly_spaced():
    chosen = np.sort(np.random.default_rng(0).choice(np.arange(1, ROWS), 240, replace=False))
    some = np.concatenate([[0], chosen])
    law = drives(Law.SAMPLED_TORQUE)
    whole, part = (law.rollout(t, told(t), start=START) for t in (T, T[some]))
    assert np.abs(part - whole[some]).max() < 0.05
    assert np.ptp(whole, axis=0).min() > 0.5


def test_torques_under_which_no_state_is_left_are_refused_by_their_row():
    with pytest.raises(PlumblineError, match=r"rows before \d+: .*torques that no state comes of"):
        drives().rollout(T, 1e9 * told(T))


@pytest.mark.parametrize(("constant", "value"), [("PART", 1.0), ("MIDDLES", 1)])
def test_a_row_is_stepped_as_finely_as_makes_a_difference(constant, value, monkeypatch):
    expected = moved(START)
    monkeypatch.setattr(forward_module, constant, value)
    assert np.abs(drives().rollout(T, told(T), start=START) - expected).max() > 1e-3


def test_drives_push_in_turn_until_what_friction_holds_is_settled(monkeypatch):
    rubs = dict.fromkeys(("coulomb_friction", "viscous_friction"), 0.3)
    usual = drives(**rubs).rollout(T, told(T), start=START)
    monkeypatch.setattr(forward_module, "IN_TURN", 8)
    settled = drives(**rubs).rollout(T, told(T), start=START)
    assert np.abs(usual - settled).max() < 1e-9
    assert np.ptp(settled, axis=0)[0] > 2.0
