"""Below the plan: a command keeps its limits and is explained, and nothing is raised."""

import re
import time
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.touch import Touch, all_pairs
from plumbline.optim.capsule_mpc import (
    EndsInstrument,
    Mode,
    Noise,
    Obstacle,
    OneStep,
    Plan,
    Plant,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
    Trouble,
)
from plumbline.optim.capsule_mpc import planning as banded_qp
from tests.in_mm import Controller

BODIES = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
START = np.array([-30.0, 0.0, -120.0, 35.0, 0.0, -115.0])
GOAL = np.array([-10.0, 20.0, -110.0, 45.0, 5.0, -120.0])
STATEMENT = Statement(BODIES, 1, Settings(p=6), 2)
BALL = Obstacle.sphere((0.0, 60.0, -90.0), 5.0)
NAN = float("nan")
LIMIT = 60.0 + 1e-6


@dataclass(frozen=True)
class Broken:
    """A planner that fails in some way."""

    how: str

    def ready(self, statement):
        return self

    def plan(self, x0, stages, path):
        if self.how == "raises":
            raise RuntimeError("no memory\nat all")
        if self.how == "late":
            time.sleep(0.03)
        solved = self.how in ("late", "too fast")
        away = path + (50.0 if self.how == "too fast" else 0.0)
        return Plan(away * (NAN if self.how == "nan" else 1.0), solved, 0.0, 7, self.how)


def controller(planner=None, **safety):
    """A controller that is not in a hurry."""
    options = {"budget": 5.0, **safety}
    return Controller(STATEMENT, planner or RealTime(compiled=False), Safety(**options))


def legal(command):
    """Whether a command is finite and within the limits."""
    speeds = np.linalg.norm(command.rate.reshape(-1, 3), axis=1)
    return np.isfinite(command.rate).all() and speeds.max() <= LIMIT


def test_an_ordinary_step_plans_and_has_nothing_to_report():
    command = controller().step(START, GOAL, [BALL])
    assert command.mode is Mode.PLAN
    assert command.events == ()
    assert np.abs(command.rate).max() > 1.0


@pytest.mark.parametrize(
    ("how", "trouble"),
    [
        ("raises", Trouble.SOLVER_FAILED),
        ("fails", Trouble.SOLVER_FAILED),
        ("nan", Trouble.SOLVER_FAILED),
        ("late", Trouble.OVER_BUDGET),
    ],
)
def test_without_a_plan_one_step_takes_over(how, trouble):
    command = controller(Broken(how), budget=0.02).step(START, GOAL, [BALL])
    assert command.mode is Mode.ONE_STEP
    assert trouble in command.troubles()
    assert legal(command)
    assert np.abs(command.rate).max() > 1.0


def test_by_default_one_step_plans_and_under_it_there_is_the_stop_alone():
    own = Controller(STATEMENT)
    command = own.step(START, GOAL, [BALL])
    plain = Controller(STATEMENT, OneStep(compiled=False), Safety(budget=5.0))
    np.testing.assert_allclose(command.rate, plain.step(START, GOAL, [BALL]).rate, atol=1e-6)
    assert command.mode is Mode.PLAN
    assert (command.path == command.path[0]).all()
    own._planner = Broken("raises")
    command = own.step(START, GOAL, [BALL])
    assert command.mode is Mode.BRAKE
    assert legal(command)


def test_a_plan_of_numbers_that_are_none_is_refused_whatever_it_claims():
    @dataclass(frozen=True)
    class Liar:
        def ready(self, statement):
            return self

        def plan(self, x0, stages, path):
            return Plan(path * NAN, True, 0.0, 1, "solved")

    alone = Statement(BODIES[:1], 0, Settings(p=4))
    command = Controller(alone, Liar(), Safety(budget=5.0)).step(START[:3], GOAL[:3])
    assert command.mode is Mode.ONE_STEP
    assert legal(command)


def test_a_fault_is_told_in_one_line():
    (event,) = controller(Broken("raises")).step(START, GOAL, [BALL]).events
    assert event.words == "RuntimeError: no memory"


def test_contact_is_what_touches_and_not_what_is_near():
    """Two shafts inside of their margin, which is twice that of a shaft and an obstacle."""
    body = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.006, 0.0, 0.0)))
    statement = Statement(body, 0, Settings(p=4, noise=Noise(bias=0.001)))
    own = Controller(statement, RealTime(compiled=False), Safety(budget=5.0))
    x = np.array([0.0, 0.0, -100.0, 5.5, 0.0, -100.0])
    near = own.step(x, x, [])
    assert near.gap == pytest.approx(-3.5, abs=0.1)
    assert Trouble.INSIDE_MARGIN in near.troubles()
    touching = own.step(x - np.array([0, 0, 0, 1.0, 0, 0]), x, [])
    assert Trouble.CONTACT in touching.troubles()


def test_a_margin_for_an_error_with_a_lever_is_a_margin_and_no_contact():
    """Outer ends 230 mm behind the trocars, tips 20: an error of 0.5 mm moves them 5.75 mm."""
    body = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
    own = Controller(
        Statement(body, 0, Settings(p=4, noise=Noise(bias=0.0005))), OneStep(compiled=False)
    )
    # Outer ends 10 mm apart across, so 5 mm clear of each other.
    lean = 15.0 * 20.0 / 230.0
    tips = np.array([-lean, 0.0, -20.0, 40.0 + lean, 0.0, -20.0])
    found = own.step(tips, tips, [])
    assert Trouble.CONTACT not in found.troubles()
    assert Trouble.INSIDE_MARGIN in found.troubles()


def test_a_plan_beyond_the_limits_is_cut():
    command = controller(Broken("too fast")).step(START, GOAL, [])
    assert legal(command)


def test_without_any_planner_motion_stops_within_the_limits():
    own, x = Controller(STATEMENT, RealTime(compiled=False), Safety(budget=5.0)), START.copy()
    rates = [np.zeros(6)]
    for _ in range(6):
        rates.append(own.step(x, GOAL, [BALL]).rate)
        x = x + 0.02 * rates[-1]
    own._planner = own._fallback = Broken("raises")
    for _ in range(5):
        command = own.step(x, GOAL, [BALL])
        assert command.mode is Mode.BRAKE
        rates.append(command.rate)
        x = x + 0.02 * command.rate
    assert np.linalg.norm(rates[6][:3]) > 25.0
    assert not rates[-1].any()
    changes = np.diff(rates, axis=0).reshape(-1, 2, 3) / 0.02
    assert np.linalg.norm(changes, axis=2).max() <= 1000.0 + 1e-6
    assert np.linalg.norm(np.diff(changes, axis=0), axis=2).max() <= 5e4 * 0.02 + 1e-6


@pytest.mark.parametrize("bad", [START * NAN, START[:4], START + np.inf, np.zeros(0)])
def test_a_bad_measurement_is_bridged_and_then_stops_the_motion(bad):
    own = controller(patience=3)
    x = START.copy()
    for _ in range(4):
        x = x + 0.02 * own.step(x, GOAL, [BALL]).rate
    commands = [own.step(bad, GOAL, [BALL]) for _ in range(6)]
    assert all(map(legal, commands))
    assert all(Trouble.BAD_MEASUREMENT in c.troubles() for c in commands)
    assert [c.mode for c in commands] == [Mode.PLAN] * 3 + [Mode.STOP] * 3
    assert np.abs(commands[-1].rate).max() < np.abs(commands[2].rate).max()
    assert not [own.step(bad, GOAL, [BALL]) for _ in range(2)][-1].rate.any()
    assert own.step(x, GOAL, [BALL]).mode is Mode.PLAN


def test_a_bad_measurement_at_once_stops():
    command = controller().step(START * NAN, GOAL)
    assert command.mode is Mode.STOP
    assert not command.rate.any()


def test_a_bad_goal_keeps_the_last_one_and_is_reported():
    own, other = controller(), controller()
    own.step(START, GOAL)
    other.step(START, GOAL)
    again = own.step(START, GOAL * NAN)
    assert Trouble.BAD_GOAL in again.troubles()
    assert np.array_equal(again.rate, other.step(START, GOAL).rate)
    assert controller().step(START, GOAL * NAN).mode is Mode.STOP


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ([58.0, -20.0, 0.0, 0.0, 0.0, 0.0], r"instrument 1 and 2 nearer than allowed, by \d"),
        ([10.0, 40.0, 20.0, 0.0, 0.0, 0.0], "instrument 1 and an obstacle nearer than allowed, by"),
        (
            [0.0, 0.0, 0.0, 0.0, 0.0, -140.0],
            "instrument 2 beyond its depths or cone, by 30[.]096 mm",
        ),
        ([0.0, 0.0, 120.0, 0.0, 0.0, 0.0], "instrument 1 beyond its depths or cone, by"),
    ],
)
def test_a_goal_where_nothing_can_be_is_told_at_every_step(change, said):
    own, goal = controller(), GOAL + change
    for path in (goal, np.tile(goal, (6, 1))):
        (event,) = (e for e in own.step(START, path, [BALL]).events if "goal" in e.words)
        assert event.trouble is Trouble.BAD_GOAL
        assert re.search(said, event.words)
        assert len(event.words.splitlines()) == 1
    assert Trouble.BAD_GOAL not in own.step(START, GOAL, [BALL]).troubles()


def test_a_goal_is_judged_at_rest_whatever_lateness_was_learnt():
    """A tip seen 5 mm off for once is an error of lateness, and widens margins for a while."""
    own, near = controller(), np.array([40.0, 11.0, -110.0, -40.0, -4.0, -120.0])
    wrong = START + np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for seen in [START] * 20 + [wrong] + [START] * 30:
        assert Trouble.BAD_GOAL not in own.step(seen, near).troubles()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"radius": -0.001}, "radius: found -0.001"), ({"radius": 2.5}, "state it in m"),
        ({"length": 250.0}, "length: found 250"), ({"depths": (15.0, 230.0)}, "state it in m"),
        ({"depths": (0.23, 0.015)}, "expected least < most"), ({"cone": 120.0}, "less than 90"),
        ({"cone": 1.4}, "cone: found 1.4, expected at least 3.15 and less than 90; state it in"),
        ({"cone": 3.14}, "state it in degrees"),
        ({"trocar": (-40.0, 0.0, 0.0)}, "in m, not in mm"), ({"trocar": (0.0, NAN, 0.0)}, "trocar"),
        ({"v_max": 60.0}, "at most 2; state it in m/s"), ({"a_max": 1000.0}, "at most 50; state"),
        ({"j_max": 50000.0}, "at most 5000; state it"), ({"v_outer": 250.0}, "state it in m/s"),
        ({"trocar": (0.0, 0.0)}, "expected 3 items"), ({"inward": (0.0, 0.0, 0.0)}, "no direction"),
    ],
)  # fmt: skip
def test_an_instrument_that_is_none_or_in_mm_is_refused_in_a_line(change, said):
    with pytest.raises(PlumblineError, match=said) as caught:
        TipInstrument(**{"trocar": (0.0, 0.0, 0.0)} | change)
    assert len(str(caught.value).splitlines()) == 1


def test_a_clearance_and_a_noise_in_mm_are_refused():
    with pytest.raises(PlumblineError, match=r"safe: found 2, expected 0 to 0\.1"):
        Settings(safe=2.0)
    with pytest.raises(PlumblineError, match=r"measured: found 0.05, expected 0 to 0\.01"):
        Noise(measured=0.05)


def test_what_a_loop_gives_in_mm_is_never_taken_as_metres():
    own, far = controller(), BALL.scaled(1e3)
    assert own.step(1e3 * START, GOAL).mode is Mode.STOP
    assert own.step(START, GOAL, [far]).mode is Mode.STOP
    assert not own.step(START, GOAL, [BALL]).troubles()
    told = own.step(START, 1e3 * GOAL, [far])
    assert {Trouble.BAD_OBSTACLE, Trouble.BAD_GOAL} <= told.troubles()
    assert any("goal not usable (finite, within 5 m)" in e.words for e in told.events)


def test_an_obstacle_that_cannot_be_read_stays_where_it_was():
    own = controller()
    own.step(START, GOAL, [BALL])
    command = own.step(START, GOAL, [Obstacle.sphere((NAN, 0.0, 0.0), 5.0)])
    assert Trouble.BAD_OBSTACLE in command.troubles()
    assert command.mode is Mode.PLAN
    assert controller().step(START, GOAL, [Obstacle.sphere((NAN, 0.0, 0.0), 5.0)]).mode is Mode.STOP


def test_more_obstacles_than_slots_are_reported_and_the_nearest_are_kept():
    near = Obstacle.sphere((-14.0, 12.0, -112.0), 3.0)
    far = [Obstacle.sphere((300.0 + 20 * k, 0.0, 0.0), 5.0) for k in range(5)]
    own, x = controller(), START.copy()
    touch = Touch(all_pairs(2, 1), np.array([2.5, 2.5, 3.0]))
    for _ in range(40):
        command = own.step(x, GOAL, [*far, near])
        assert Trouble.TOO_MANY_OBSTACLES in command.troubles()
        x = x + 0.02 * command.rate
        shafts = [
            np.stack([t, t - 250 * (t - c) / np.linalg.norm(t - c)])
            for t, c in zip(x.reshape(2, 3), ([-40.0, 0, 0], [40.0, 0, 0]), strict=True)
        ]
        ends = np.stack([*shafts, np.array([near.a, near.b])])
        assert touch.clearances(ends).min() > 1.8


def test_a_capsule_without_a_capsule_s_slot_is_told_which_slots_there_are():
    own = Controller(Statement(BODIES, 0, Settings(p=6), 1), OneStep(compiled=False), Safety(9.0))
    rod = Obstacle((0.0, 60.0, -90.0), (0.0, 80.0, -90.0), 5.0)
    (event,) = own.step(START, GOAL, [rod]).events
    assert event.words.startswith("1 obstacles, at most 0 capsules and 1 spheres; 1 left out")


def test_a_plant_with_another_number_of_axes_is_refused_in_a_line():
    with pytest.raises(
        PlumblineError, match=r"plant delay: found shape \(2,\), expected a number or"
    ):
        controller(plant=Plant(delay=[0.0, 0.05]))


def test_an_obstacle_that_appears_inside_of_the_margin_is_left():
    own, x = controller(), START.copy()
    gaps = []
    beside = Obstacle.sphere((-30.0, 8.4, -118.0), 5.0)
    for k in range(20):
        command = own.step(x, x, [beside] if k else [])
        assert legal(command)
        x = x + 0.02 * command.rate
        gaps.append(command.gap)
    assert Trouble.INSIDE_MARGIN in own.step(START, START, [beside]).troubles()
    assert gaps[1] < -0.5
    assert gaps[-1] > -0.01
    assert (np.diff(gaps[1:]) > -1e-6).all()


def test_contact_at_the_start_is_reported_and_undone():
    own, x = controller(), START.copy()
    inside = Obstacle.sphere((-30.0, 4.0, -118.0), 5.0)
    first = own.step(x, x, [inside])
    assert Trouble.CONTACT in first.troubles()
    for _ in range(25):
        command = own.step(x, x, [inside])
        assert legal(command)
        x = x + 0.02 * command.rate
    assert own.step(x, x, [inside]).gap > -0.01


@dataclass(frozen=True)
class Into:
    """Plans to move the left tool straight along x, whatever is there."""

    def ready(self, statement):
        return self

    def plan(self, x0, stages, path):
        return Plan(path + np.array([1.2, 0, 0, 0, 0, 0]), True, 0.0, 1, "into")


def test_a_step_that_would_worsen_a_margin_is_held_back():
    touching = Obstacle.sphere((-20.0, 0.0, -120.0), 5.0)

    own, x = Controller(STATEMENT, Into(), Safety(budget=5.0)), START.copy()
    seen = set()
    for _ in range(10):
        command = own.step(x, GOAL, [touching])
        seen |= command.troubles()
        x = x + 0.02 * command.rate
        assert command.gap > -0.01
    assert Trouble.HELD_BACK in seen


def test_one_pair_inside_of_its_margin_excuses_no_other():
    """A step into a second obstacle is held back although the first is overlapped for good."""
    first = Obstacle.sphere((60.0, 0.0, -60.0), 30.0)
    second = Obstacle.sphere((-20.0, 0.0, -120.0), 5.0)

    own, x = Controller(STATEMENT, Into(), Safety(budget=5.0)), START.copy()
    for _ in range(10):
        command = own.step(x, GOAL, [first, second])
        assert command.gap < -5.0
        x = x + 0.02 * command.rate
    clear = np.linalg.norm(x[:3] - second.a) - 7.5
    assert clear > 2.0 - 0.02


def test_a_prediction_never_dates_from_before_a_fault():
    own, x = controller(), START.copy()
    own.step(x, GOAL, [])
    unknown = Obstacle.sphere((NAN, 0.0, 0.0), 5.0)
    moved = x + 20.0
    assert own.step(moved, GOAL, [unknown]).mode is Mode.STOP
    blind = own.step(x * NAN, moved, [])
    assert Trouble.BAD_MEASUREMENT in blind.troubles()
    again = own.step(moved, moved, [])
    assert np.abs(blind.path - moved).max() < 1.0
    assert again.mode is Mode.PLAN


def test_a_start_off_the_trocar_is_reported_and_put_right():
    body = EndsInstrument(trocar=(-0.04, 0.0, 0.0))
    statement = Statement((body,), 0, Settings(p=6))
    own = Controller(statement, RealTime(compiled=False), Safety(budget=5.0))
    x = 1e3 * body.state(1e-3 * START[:3]) + np.array([0.0, 3.0, 0.0, 0.0, 3.0, 0.0])
    first = own.step(x, START[:3], [])
    assert Trouble.OFF_HOLD in first.troubles()
    for _ in range(20):
        command = own.step(x, START[:3], [])
        assert legal(command)
        x = x + 0.02 * command.rate
    assert command.events == ()


def test_the_compiler_is_asked_for_while_the_controller_is_built(monkeypatch):
    asked = []

    def native():
        asked.append(1)
        return False

    monkeypatch.setattr(banded_qp, "native", native)
    controller()
    assert asked


@pytest.mark.parametrize("known", [0, 3])
def test_a_delay_is_looked_through_whether_it_is_known_or_not(known):
    """With commands that act three steps late, planning from where the tips are swings by 1 mm."""
    own, x, waiting = controller(delay=known), START.copy(), [np.zeros(6)] * 3
    over, said = 0.0, set()
    for _ in range(80):
        command = own.step(x, GOAL)
        waiting.append(command.rate)
        said |= command.troubles()
        x = x + 0.02 * waiting.pop(0)
        over = max(over, float(((x - GOAL) * np.sign(GOAL - START)).max()))
    assert over < 0.25
    assert (Trouble.LATE in said) == (known == 0)


weird = st.one_of(st.floats(-1e9, 1e9), st.sampled_from([NAN, np.inf, -np.inf, 0.0]))
rows = st.lists(weird, min_size=0, max_size=8)
balls = st.lists(st.tuples(weird, weird, weird, weird), max_size=4)
SHARED = Controller(STATEMENT, RealTime(compiled=False), Safety(budget=5.0))


@settings(max_examples=60, deadline=None)
@given(rows, rows, balls)
def test_no_input_raises(measured, goal, obstacles):
    shown = [Obstacle.sphere(tuple(o[:3]), o[3]) for o in obstacles]
    for inputs in ((measured, goal, shown), (START, goal, shown), (START, GOAL, shown)):
        command = SHARED.step(*inputs)
        assert legal(command)
        assert command.mode is Mode.PLAN or command.events


def test_noise_within_what_was_stated_keeps_the_distance():
    noise = Noise(measured=0.0001, step=5e-05)
    statement = Statement(BODIES, 0, Settings(p=8, noise=noise), 1)
    own = Controller(statement, RealTime(compiled=False), Safety(budget=5.0))
    rng = np.random.default_rng(4)
    x, goal = START.copy(), np.array([30.0, 0.0, -118.0, -30.0, 0.0, -118.0])
    ball = Obstacle.sphere((0.0, 0.0, -95.0), 4.0)
    touch = Touch(all_pairs(2, 1), np.array([2.5, 2.5, 4.0]))
    least = np.inf
    for _ in range(120):
        rate = own.step(x + rng.normal(0, 0.1, 6), goal, [ball]).rate
        x = x + 0.02 * rate + rng.normal(0, 0.05, 6)
        tips = x.reshape(2, 3)
        way = tips - [[-40.0, 0, 0], [40.0, 0, 0]]
        back = tips - 250 * way / np.linalg.norm(way, axis=1, keepdims=True)
        ends = np.concatenate([np.stack([tips, back], axis=1), [[ball.a, ball.b]]])
        least = min(least, float(touch.clearances(ends).min()))
    assert least > 2.0 - 0.1
    assert least < 4.0
