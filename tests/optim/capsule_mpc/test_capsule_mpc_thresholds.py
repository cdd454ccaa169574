"""Numbers of the capsule controller that are choices: a test says what each of them does."""

import casadi as cs
import numpy as np
import pytest

from plumbline.kinematics.capsules import nearest
from plumbline.optim.capsule_mpc import (
    EndsInstrument,
    Obstacle,
    OneStep,
    Safety,
    Settings,
    Statement,
    TipInstrument,
    controller,
    evasion,
)
from tests.in_mm import Controller

BODIES = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.09, 0.0, 0.0)))
START = np.array([0.0, 0.0, -120.0, 90.0, 0.0, -120.0])


def test_shafts_keep_95_percent_of_what_near_trocars_leave_them():
    near = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.006, 0.0, 0.0)))
    statement = Statement(near, 0, Settings(p=2))
    x, _, stage = statement.symbols
    asked = cs.Function("asked", [x, stage], [statement.pairs[0].asked])
    tips = np.array([0.0, 0.0, -100.0, 6.0, 0.0, -100.0])
    found = asked(tips, statement.stages(tips, [])[0])
    assert float(found) == pytest.approx(0.95 * 6.0, abs=1e-9)
    own = Controller(statement, OneStep(compiled=False), Safety(9.0))
    (event,) = [e for e in own.step(tips, tips).events if e.trouble.value == "cannot-be-met"]
    assert event.words.endswith("they keep 95 % of the trocars' distance")


@pytest.mark.parametrize(("beyond", "taken"), [(1.95, True), (2.05, False)])
def test_what_is_held_may_take_a_tenth_of_the_acceleration_beyond_it(beyond, taken, monkeypatch):
    """From rest a step may come to 20 mm/s; putting right, to 22."""
    own = Controller(
        Statement((EndsInstrument(0.2, 0.0025),), 0, Settings(p=2)),
        OneStep(compiled=False),
        Safety(9.0),
    )
    x = np.array([0.0, 0.0, -100.0, 0.0, 0.0, 100.0])
    right = np.array([20.0 + beyond, 0.0, 0.0, 0.0, 0.0, 0.0])
    monkeypatch.setattr(controller, "held_exactly", lambda *_: x + 0.02 * right)
    stage = own.statement.stages(x, [])[0]
    found = own._held(right, x, stage)
    assert (np.linalg.norm(found[:3]) > 20.0 + 1e-6) == taken


def test_a_step_across_that_of_the_path_has_half_of_its_length():
    statement = Statement(BODIES[:1], 0, Settings(p=1, effort=0.0, smooth=0.0))
    ready = OneStep(compiled=False).ready(statement)
    x, move = START[:3], np.array([1.2, 0.0, 0.0])
    plan = ready.plan(x, statement.stages(x + np.array([0.0, 50.0, 0.0]), [], move), x[None])
    assert plan.x[0, 1] - x[1] == pytest.approx(0.5 * 1.2, abs=1e-3)  # [mm]


def scenes(count):
    """A sphere that comes at the first shaft from somewhere, in 0.4 to 1 s, among others."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        depth, angle = rng.uniform(40.0, 110.0), rng.uniform(0.0, 2 * np.pi)
        speed, when = rng.uniform(30.0, 60.0), rng.uniform(0.4, 1.0)
        rate = speed * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.3, 0.3)])
        place = np.array([*rng.uniform(-4.0, 4.0, 2), -depth]) - when * rate
        comes = Obstacle.sphere(tuple(place), rng.uniform(2.0, 6.0), tuple(rate))
        turns = angle + rng.uniform(0.3, 2 * np.pi - 0.3, 6)
        far = rng.uniform(30.0, 50.0, 6)
        places = np.stack([far * np.cos(turns), far * np.sin(turns), rng.uniform(-140, -60, 6)])
        yield [comes, *(Obstacle.sphere(tuple(at), 12.0) for at in places.T)]


def room(obstacles, rates, looks):
    """Least clearance beyond D (C,) of the first shaft at rates (C, 3) from rest in 1.2 s."""
    t = np.arange(0.0, 1.2 + looks / 2, looks)
    turn = np.maximum(np.linalg.norm(rates, axis=1) / BODIES[0].acceleration[0], 0.02)[:, None]
    s = np.minimum(t, turn)
    late = t - s * (1.0 - (s + 0.02) / (2.0 * turn))
    tips = START[:3] + late[..., None] * rates[:, None]
    tails = tips - 250.0 * tips / np.linalg.norm(tips, axis=-1, keepdims=True)
    shafts = np.stack([tips, tails], axis=-2)
    found = np.full(len(rates), np.inf)
    for obstacle in [*obstacles, Obstacle((90.0, 0.0, -120.0), (90.0, 0.0, 130.0), 2.5)]:
        ends = np.array([obstacle.a, obstacle.b]) + t[:, None, None] * np.array(obstacle.velocity)
        pairs = shafts.reshape(-1, 2, 3), np.tile(ends, (len(rates), 1, 1))
        gaps = nearest(*pairs).distance.reshape(len(rates), -1) - obstacle.radius - 2.5 - 2.0
        found = np.minimum(found, gaps.min(axis=1))
    return found


def test_a_way_out_is_that_nearest_to_the_goal_s_of_those_with_2_mm_of_room():
    """Of 26 directions at full and at half speed, looked at every 40 ms; or as good as any."""
    around = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    rates, sought, slow = np.concatenate([60.0 * around, 30.0 * around]), 0, 0
    for obstacles in scenes(60):
        toward = -0.6 * np.array([*obstacles[0].velocity[:2], 20.0])
        goal = START + np.array([*toward, 0, 0, 0])
        own = evasion.Evasion(Statement(BODIES, 7, Settings(p=2)))
        found = own.goal(START, np.zeros(6), goal, obstacles, np.full(7, 1.2))
        rate = (found[:3] - START[:3]) / 1.2
        if np.allclose(rate, toward / 1.2):
            continue
        gaps = room(obstacles, rates, 0.04)
        gaps[np.linalg.norm(START[:3] + 1.2 * rates, axis=1) > 245.0] = -np.inf
        best = rates[np.where(gaps >= min(2.0, gaps.max()), rates @ toward, -np.inf).argmax()]
        if gaps.max() >= 2.0:
            np.testing.assert_allclose(rate, best, atol=1e-6)
        assert room(obstacles, rate[None], 0.001)[0] >= min(2.0, gaps.max()) - 0.1
        sought, slow = sought + 1, slow + int(np.linalg.norm(rate) < 31.0)
        assert np.diff(own._times) == pytest.approx(0.04)
    assert sought > 40
    assert slow > 3


def test_effort_costs_seven_tenths_of_the_root_of_what_changes_cost_unless_stated():
    assert Settings(smooth=100.0).weights == (pytest.approx(7.0, rel=0.2), 100.0)
    assert Settings(smooth=100.0, effort=1.0).weights == (1.0, 100.0)
