"""Distances are kept between two samples too, speeds by their norm, and stops within limits."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from plumbline.experiments.reality.touch import Touch, all_pairs
from plumbline.kinematics.capsules import Segment, nearest, squared_distance
from plumbline.optim.capsule_mpc import (
    Mode,
    Noise,
    Nonlinear,
    Obstacle,
    OneStep,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
    Trouble,
)
from plumbline.optim.capsule_mpc.pairs import farthest, on_the_way, wide_enough
from plumbline.optim.capsule_mpc.stopping import Stop
from tests.in_mm import Controller

PLAIN = RealTime(compiled=False)
PLANNERS = [PLAIN, OneStep(compiled=False), Nonlinear()]
SHALLOW = (TipInstrument((-0.025, 0.0, 0.0)), TipInstrument((0.025, 0.0, 0.0)))
# Tips some 25 mm behind their trocars, whose outer ends pass each other: at 60 mm/s along each axis
# shafts went through each other by 4.85 mm between samples that were all 2.00 mm apart.
THROUGH = 18
EXACT = Noise()


def shafts(bodies, tips):
    """Both ends (I, 2, 3) of shafts with their tips at (I, 3)."""
    trocars = np.array([body.constants for body in bodies])
    inside = tips - trocars
    way = inside / np.linalg.norm(inside, axis=1, keepdims=True)
    lengths = 1e3 * np.array([body.length for body in bodies])[:, None]
    return np.stack([tips, tips - lengths * way], axis=1)


def shallow_task(seed):
    """Start and goal (6,) with tips at 16 to 30 mm, by coal at least 4 mm apart."""
    rng, touch = np.random.default_rng(seed), Touch(all_pairs(2, 0), np.full(2, 2.5))

    def posture():
        found = []
        for side in (-1.0, 1.0):
            tilt = np.radians(rng.uniform(15, 55))
            turn = rng.normal(0, 0.5) + (np.pi if side < 0 else 0.0)
            depth = rng.uniform(16, 30)
            across = depth * np.sin(tilt) * np.array([np.cos(turn), np.sin(turn)])
            found.append([side * 25.0 + across[0], across[1], -depth * np.cos(tilt)])
        return np.array(found)

    while True:
        start, goal = posture(), posture()
        rooms = [touch.clearances(shafts(SHALLOW, tips)).min() for tips in (start, goal)]
        if min(rooms) > 4.0:
            return start.ravel(), goal.ravel()


def watched(bodies, planner, start, goal, obstacles=(), steps=100, noise=EXACT, slots=None):
    """Least clearance by coal at every millisecond without a report, rates, commands, last x."""
    balls = sum(o.a == o.b for o in obstacles)
    slots = len(obstacles) - balls if slots is None else slots
    statement = Statement(bodies, slots, Settings(p=10, noise=noise), balls)
    own = Controller(statement, planner, Safety(budget=9.0))
    radii = [*(1e3 * body.radius for body in bodies), *(o.radius for o in obstacles)]
    touch = Touch(all_pairs(len(bodies), len(obstacles)), np.array(radii))
    x, least, commands, seen, time = start.copy(), np.inf, [], list(obstacles), 0.0
    reports = {Trouble.INSIDE_MARGIN, Trouble.CONTACT, Trouble.HELD_BACK}

    def at(time):
        places = []
        for o in obstacles:
            moved = time * np.array(o.velocity)
            places.append([np.array(o.a) + moved, np.array(o.b) + moved])
        return np.array(places).reshape(-1, 2, 3)

    for _ in range(steps):
        seen = [
            replace(o, a=tuple(ends[0]), b=tuple(ends[1]))
            for o, ends in zip(obstacles, at(time), strict=True)
        ]
        command = own.step(x, goal, seen)
        commands.append(command)
        for k in range(1, 21):
            ends = shafts(bodies, (x + 1e-3 * k * command.rate).reshape(-1, 3))
            gap = touch.clearances(np.concatenate([ends, at(time + 1e-3 * k)])).min()
            if not reports & command.troubles():
                least = min(least, float(gap))
        x, time = x + 0.02 * command.rate, time + 0.02
    return least, np.array([c.rate for c in commands]), commands, x


@pytest.mark.parametrize("planner", PLANNERS)
def test_shafts_keep_their_distance_between_the_samples_too(planner):
    start, goal = shallow_task(THROUGH)
    least, *_ = watched(SHALLOW, planner, start, goal, steps=60)
    assert least > 2.0 - 0.01


@pytest.mark.parametrize("planner", PLANNERS)
def test_what_flies_through_a_shaft_between_two_samples_is_reported(planner):
    """A thin rod at a metre a second: at the samples it is 5 mm off, on either side."""
    body = (TipInstrument((0.0, 0.0, 0.0)),)
    rod = Obstacle((-30.0, -130.0, -40.0), (30.0, -130.0, -40.0), 0.5, (0.0, 1000.0, 0.0))
    start = np.array([0.0, 0.0, -60.0])
    least, _, commands, _ = watched(body, planner, start, start, [rod], steps=12)
    assert least > 2.0 - 0.01
    assert Trouble.INSIDE_MARGIN in {t for c in commands for t in c.troubles()}


def test_the_bound_on_the_way_holds_and_is_sharp():
    one, two = (Segment.of(cs.SX.sym(k, 6)) for k in "ab")
    old = Segment.of(cs.SX.sym("c", 6)), Segment.of(cs.SX.sym("d", 6))
    bound = on_the_way(
        squared_distance(*old), squared_distance(one, two), farthest((one, two), old)
    )
    wide = wide_enough(bound, (one, two), old)
    ends = [one.ends, two.ends, old[0].ends, old[1].ends]
    function = cs.Function("b", ends, [bound, wide])
    rng = np.random.default_rng(0)
    share = np.linspace(0.0, 1.0, 201)[:, None, None]
    tightest = np.inf
    for _ in range(300):
        before = rng.normal(size=(2, 2, 3)) * 30.0
        now = before + rng.normal(size=(2, 2, 3)) * 10.0 ** rng.uniform(-1, 1.5)
        low, least = (float(v) for v in function(*now.reshape(2, 6), *before.reshape(2, 6)))
        way = [before[k] + share * (now[k] - before[k]) for k in range(2)]
        distances = nearest(*way).distance
        assert distances.min() >= low - 1e-6
        # Who keeps the wide distance at both ends keeps the least one on all of the way.
        assert min(distances[0], distances[-1]) < least or distances.min() >= low - 1e-6
        if min(distances[0], distances[-1]) - low > 0.1:
            tightest = min(tightest, float(distances.min()) - low)
    assert tightest < 0.2


def test_an_outer_end_leaves_its_chord_by_the_sagitta_at_most():
    body = TipInstrument((0.0, 0.0, 0.0))
    x, c, d = (cs.SX.sym(k, 3) for k in "xcd")
    sagitta = cs.Function("s", [x, c, d], list(body.sagitta(x, c, d)))
    rng = np.random.default_rng(1)
    share = np.linspace(0.0, 1.0, 101)[:, None]
    nearest_to_bound = 0.0
    for _ in range(300):
        start = rng.normal(size=3) * 0.3 + [0.0, 0.0, -1.0]
        start *= rng.uniform(15, 60) / np.linalg.norm(start)
        move = rng.normal(size=3)
        move *= rng.uniform(0.1, 3.0) / np.linalg.norm(move)
        tips = start + share * move
        outer = np.array([shafts((body,), tip[None])[0, 1] for tip in tips])
        off = np.linalg.norm(outer - outer[0] - share * (outer[-1] - outer[0]), axis=1).max()
        bound = float(sagitta(start + move, np.zeros(3), move))
        assert off <= bound + 1e-9
        nearest_to_bound = max(nearest_to_bound, off / bound)
    assert nearest_to_bound > 0.6


@pytest.mark.parametrize("planner", [PLAIN, OneStep(compiled=False)])
def test_speed_acceleration_and_jerk_are_bounded_by_their_norms(planner):
    bodies = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
    start = np.array([-30.0, 0.0, -120.0, 35.0, 0.0, -115.0])
    goal = np.array([20.0, 40.0, -80.0, -30.0, -50.0, -150.0])
    rod = Obstacle((-60.0, 20.0, -100.0), (60.0, 20.0, -120.0), 4.0)
    _, rates, *_ = watched(bodies, planner, start, goal, [rod], steps=80)
    rates = np.concatenate([np.zeros((2, 6)), rates]).reshape(-1, 2, 3)
    changes = np.diff(rates, axis=0) / 0.02
    jerks = np.diff(changes, axis=0) / 0.02
    assert 55.0 < np.linalg.norm(rates, axis=2).max() <= 60.0 + 1e-6
    assert 500.0 < np.linalg.norm(changes, axis=2).max() <= 1000.0 + 1e-4
    assert np.linalg.norm(jerks, axis=2).max() <= 5e4 + 1e-2


def test_a_lost_measurement_stops_within_the_limits_and_without_contact():
    body = (TipInstrument((0.0, 0.0, 0.0)),)
    statement = Statement(body, 0, Settings(p=10), 1)
    own = Controller(statement, PLAIN, Safety(budget=9.0, patience=0))
    x, goal = np.array([-40.0, 0.0, -100.0]), np.array([40.0, 30.0, -100.0])
    wall = Obstacle.sphere((22.0, 0.0, -100.0), 20.0)
    rates = [np.zeros(3)]
    for k in range(40):
        command = own.step(x if k < 22 else x * np.nan, goal, [wall])
        rates.append(command.rate)
        x = x + 0.02 * command.rate
        assert np.linalg.norm(x - wall.a) > 24.5 - 0.02
    assert command.mode is Mode.STOP
    assert not command.rate.any()
    assert np.linalg.norm(rates[22]) > 30.0
    assert np.linalg.norm(np.diff(rates, axis=0), axis=1).max() <= 1000.0 * 0.02 + 1e-6


@pytest.mark.parametrize(
    ("a_max", "j_max", "dt"), [(1e3, 5e4, 0.02), (6e2, 8e3, 0.01), (3e3, 1e6, 0.03)]
)
def test_a_stop_ends_and_keeps_acceleration_and_jerk(a_max, j_max, dt):
    body = TipInstrument((0.0, 0.0, 0.0), a_max=1e-3 * a_max, j_max=1e-3 * j_max)
    stop = Stop(Statement((body,), 0, Settings(p=4, dt=dt)))
    rng = np.random.default_rng(2)
    for _ in range(200):
        ways = rng.normal(size=(2, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        rate, change = 60.0 * rng.uniform() * ways[0], a_max * rng.uniform() * ways[1]
        after = stop.after(rate, rate - dt * change)
        assert after is not None
        changes = np.diff([rate, *after, 0 * rate], axis=0) / dt
        jerks = np.diff([change, *changes], axis=0) / dt
        assert np.linalg.norm(changes, axis=1).max() <= a_max * (1 + 1e-6)
        assert np.linalg.norm(jerks, axis=1).max() <= j_max * (1 + 1e-3) + 1e-6 * 60.0 / dt**2


def test_the_outer_end_is_no_faster_than_stated():
    start, goal = shallow_task(THROUGH)
    _, rates, *_ = watched(SHALLOW, PLAIN, start, goal, steps=40)
    x, fastest = start, 0.0
    for rate in rates:
        ways = shafts(SHALLOW, (x + 0.02 * rate).reshape(2, 3)) - shafts(SHALLOW, x.reshape(2, 3))
        fastest = max(fastest, float(np.linalg.norm(ways[:, 1], axis=1).max()) / 0.02)
        x = x + 0.02 * rate
    assert 100.0 < fastest <= 250.0


def test_the_nearest_obstacles_get_the_slots_and_all_count_for_the_gap():
    """A rod whose middle is far from the goal touches the shaft far from its tip."""
    body = (TipInstrument((0.0, 0.0, 0.0)),)
    x, goal = np.array([0.0, 0.0, -150.0]), np.array([0.0, 50.0, -150.0])
    long_rod = Obstacle((0.0, 9.0, -40.0), (300.0, 9.0, -40.0), 3.0)
    near_goal = Obstacle((-30.0, 70.0, -150.0), (-40.0, 70.0, -150.0), 3.0)
    least, _, commands, _ = watched(body, PLAIN, x, goal, [near_goal, long_rod], slots=1)
    assert all(Trouble.TOO_MANY_OBSTACLES in c.troubles() for c in commands)
    assert commands[0].gap == pytest.approx(9.0 - 2.5 - 3.0 - 2.0, abs=0.01)
    assert 2.0 - 0.01 < least < 3.0


def test_an_obstacle_without_a_slot_within_reach_stops_the_motion():
    body = (TipInstrument((0.0, 0.0, 0.0)),)
    own = Controller(Statement(body, 1, Settings(p=10)), PLAIN, Safety(budget=9.0))
    x, goal = np.array([0.0, 0.0, -150.0]), np.array([0.0, 0.0, -100.0])
    rods = [Obstacle((-50.0, y, -150.0), (50.0, y, -150.0), 3.0) for y in (9.0, -9.5)]
    command = own.step(x, goal, rods)
    assert command.mode is Mode.STOP
    assert "within reach" in next(e.words for e in command.events)
    assert command.gap == pytest.approx(9.0 - 7.5, abs=0.01)
    inside = own.step(
        x, goal, [rods[0], Obstacle((-50.0, -4.0, -150.0), (50.0, -4.0, -150.0), 3.0)]
    )
    assert Trouble.CONTACT in inside.troubles()


@pytest.mark.parametrize("planner", [PLAIN, OneStep(compiled=False)])
def test_a_margin_that_cannot_be_met_drives_nothing_away(planner):
    """Trocars 12.6 mm apart, and a stated bias for which 14 mm would be needed."""
    bodies = (TipInstrument((-0.0063, 0.0, 0.0)), TipInstrument((0.0063, 0.0, 0.0)))
    start = np.array([-1.0, -34.0, -120.0, 1.0, 36.0, -115.0])
    goal = np.array([-2.0, 32.0, -120.0, 1.0, -36.0, -115.0])
    noise = Noise(bias=0.0035)
    _, _, commands, x = watched(bodies, planner, start, goal, steps=250, noise=noise)
    assert np.linalg.norm((x - goal).reshape(2, 3), axis=1).max() < 1.0
    assert all(Trouble.CANNOT_BE_MET in c.troubles() for c in commands)
    assert "1.400 mm" in next(
        e.words for e in commands[0].events if e.trouble is Trouble.CANNOT_BE_MET
    )


def test_a_tip_stays_inside_of_the_body():
    """The goal is above the trocar, and everything pushes the tip there."""
    body = (TipInstrument((0.0, 0.0, 0.0)),)
    start, goal = np.array([30.0, 0.0, -60.0]), np.array([90.0, 0.0, 40.0])
    statement = Statement(body, 0, Settings(p=10), 1)
    own, x = Controller(statement, PLAIN, Safety(budget=9.0)), start
    for k in range(120):
        pusher = Obstacle.sphere((60.0, 0.0, -75.0 + 0.4 * k), 10.0, (0.0, 0.0, 20.0))
        x = x + 0.02 * own.step(x, goal, [pusher]).rate
        assert -x[2] >= np.cos(np.radians(80.0)) * np.linalg.norm(x) - 0.02


def test_an_error_of_a_tip_has_a_lever():
    """An outer end errs by (L - r) / r of what the tip does."""
    bodies = (TipInstrument((-0.025, 0.0, 0.0)), TipInstrument((0.025, 0.0, 0.0)))
    # Tips 20 mm deep that lean apart: the shafts meet above, 100 mm from their tips.
    x = np.array([-31.0, 1.0, -19.0, 31.0, -9.0, -19.0])
    plain, noisy = (
        Statement(bodies, 0, Settings(p=2, noise=noise)) for noise in (Noise(), Noise(bias=0.0001))
    )
    gaps = [float(s.clearances(x, s.stages(x, [])[0])) for s in (plain, noisy)]
    shares = nearest(*(end[None] for end in shafts(bodies, x.reshape(2, 3))))
    depths = np.linalg.norm((x - np.ravel([b.constants for b in bodies])).reshape(2, 3), axis=1)
    along = 250.0 * np.array([shares.share_one[0], shares.share_two[0]])
    levers = np.abs(along - depths) / depths
    assert levers.min() > 2.0
    assert gaps[0] - gaps[1] == pytest.approx(0.1 * levers.sum(), rel=1e-6)


def test_a_row_is_widened_by_what_passes_between_two_samples():
    """Ends that move by 12 mm past each other, 10 mm to be kept: 11.66 mm at the samples."""
    one, other = (Segment(cs.SX([0, y, 0]), cs.SX([0, y, 50])) for y in (0, 10))
    before = Segment(one.a - cs.SX([12, 0, 0]), one.b - cs.SX([12, 0, 0]))
    wide = float(cs.evalf(wide_enough(cs.SX(10.0), (one, other), (before, other))))
    assert np.hypot(10.0, 6.0) <= wide + 1e-6 < 1.1 * np.hypot(10.0, 6.0)
