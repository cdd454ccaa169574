"""A path is followed without staying behind it, smooth as commands are."""

import numpy as np
import pytest

from plumbline.optim.capsule_mpc import (
    Nonlinear,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from tests.in_mm import Controller

BODIES = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
MIDDLE = np.array([-30.0, 0.0, -110.0, 30.0, 0.0, -115.0])
DT, P = 0.02, 8


def way(t):
    """Where both tips should be (T, 6) at times (T,)."""
    rates = np.array([1.3, 0.9, 1.7, 1.1, 1.6, 0.8])
    return MIDDLE + 9.0 * np.sin(rates * np.asarray(t)[:, None])


def followed(planner, steps=120, turn=0.0):
    """How far (T, 6) the tips of a plant without fault are from where they should be."""
    own = Controller(Statement(BODIES, 0, Settings(p=P)), planner, Safety(9.0))
    tips, off = way([0.0])[0], []
    for k in range(steps):
        off.append(tips - way([DT * k])[0])
        ahead = DT * (k + 1 + np.arange(P + 2))
        tips = tips + DT * own.step(tips, way(ahead)).rate
    return np.array(off)


@pytest.mark.parametrize("planner", [RealTime(compiled=False), Nonlinear("ipopt")])
def test_a_smooth_command_does_not_stay_behind_a_path(planner):
    """It had stayed 50 ms behind, 0.7 mm of these: what the path asks for counted as effort."""
    count = 120 if isinstance(planner, RealTime) else 40
    off = followed(planner, count)[20:]
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert np.abs(off).max() < 0.1


def test_both_ways_to_count_the_steps_of_a_path_have_one_optimum():
    statement = Statement(BODIES, 0, Settings(p=P))
    goal, x0 = way(DT * np.arange(1, P + 1)), way([0.0])[0] + 0.5
    stages = statement.stages(goal, [], 0.3 * np.ones(6))
    path = np.tile(x0, (P, 1))
    plans = [
        planner.ready(statement).plan(x0, stages, path).x
        for planner in (RealTime(compiled=False), Nonlinear("ipopt", tolerance=1e-8))
    ]
    np.testing.assert_allclose(*plans, atol=0.01)
    still = statement.stages(np.tile(goal[0], (P, 1)), [], 0.3 * np.ones(6))
    held = RealTime(compiled=False).ready(statement).plan(x0, still, path).x
    assert np.abs(held - plans[0]).max() > 0.5
