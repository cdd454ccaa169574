"""What is faster than a tip: who waits beside its way is never hit, however fast it is."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.capsules import nearest
from plumbline.optim.capsule_mpc import (
    Obstacle,
    OneStep,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.constants import FASTEST
from plumbline.optim.capsule_mpc.sweeps import Looks, Sweeps, _spring, about
from tests.in_mm import Controller

BODIES = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.09, 0.0, 0.0)))
START = np.array([0.0, 0.0, -120.0, 90.0, 0.0, -120.0])
BESIDE = START + np.array([60.0, 0, 0, 0, 0, 0])  # its shaft would stand in the swing's way


def swinging(time, rate=10.0, ball=(36.0, 0.0, -70.0), way=(22.0, 0.0, 0.0)):
    """A sphere that swings at up to 220 mm/s, 6 mm off the first shaft at the nearest."""
    ball, way = np.array(ball), np.array(way)
    middle, velocity = ball + way * np.sin(rate * time), rate * way * np.cos(rate * time)
    return Obstacle.sphere(tuple(middle), 5.0, tuple(velocity))


def flying(time):
    """A sphere at 700 mm/s that comes through the first shaft's way after 1.2 s."""
    velocity = np.array([0.0, 700.0, 0.0])
    return Obstacle.sphere(tuple([30.0, 0.0, -70.0] + velocity * (time - 1.2)), 3.0, (0, 700.0, 0))


def least(motion, goal, steps=150, seen=lambda there: there):
    """Least clearance of the first shaft at every 2 ms, and where the tips end."""
    own = Controller(Statement(BODIES, 1, Settings(p=5)), OneStep(compiled=False), Safety(9.0))
    x, found = START.copy(), np.inf
    for k in range(steps):
        command = own.step(x, goal, [seen(motion(0.02 * k))])
        for part in range(10):
            tip, there = x[:3] + 0.002 * part * command.rate[:3], motion(0.02 * k + 0.002 * part)
            shaft = np.stack([tip, tip - 250.0 * tip / np.linalg.norm(tip)])
            gap = nearest(shaft[None], np.array([[there.a, there.b]])).distance[0]
            found = min(found, float(gap) - 2.5 - there.radius)
        x = x + 0.02 * command.rate
    return found, x


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0])
def test_who_waits_for_what_swings_waits_outside_of_its_way(rate):
    clearance, _ = least(lambda time: swinging(time, rate), BESIDE)
    assert clearance > 1.95


def test_nobody_enters_the_way_of_what_flies_faster_than_a_tip():
    clearance, x = least(flying, BESIDE)
    assert clearance > 1.95
    np.testing.assert_allclose(x, BESIDE, atol=1.0)


def watched(motion, steps, dt=0.02, speed=60.0):
    """What is believed of an obstacle after so many looks."""
    own = Sweeps(dt, speed)
    for k in range(steps):
        found = own.swept([motion(dt * k)])
    return own, found[0]


@pytest.mark.parametrize(("rate", "steps"), [(4.0, 7), (10.0, 4), (25.0, 3), (4, 40), (25.0, 60)])
def test_all_that_a_swing_will_sweep_is_known_before_it_turns(rate, steps):
    """A tenth of its squared speed is a third of the way from the middle to where it turns."""
    _, found = watched(lambda time: swinging(time, rate), steps)
    ends = np.sort(np.array([found.a[0], found.b[0]]))
    np.testing.assert_allclose(ends, [14.0, 58.0], atol=0.3)
    assert found.velocity == (0.0, 0.0, 0.0)
    assert found.radius == pytest.approx(5.0, abs=0.01)


def circling(time):
    """A sphere that goes around in a circle of 20 mm: no spring, and yet confined."""
    angle = 8.0 * time
    place = (20.0 * np.cos(angle), 20.0 * np.sin(angle), 0.0)
    return Obstacle.sphere(place, 3.0, (-160.0 * np.sin(angle), 160.0 * np.cos(angle), 0.0))


def test_what_goes_around_is_within_the_capsule_about_its_way():
    _, found = watched(circling, 60)
    places = np.array([circling(0.003 * k).a for k in range(400)])[:, None]
    off = nearest(
        np.repeat(places, 2, axis=1), np.tile([[found.a, found.b]], (len(places), 1, 1))
    ).distance
    assert (off + 3.0 <= found.radius + 0.1).all()
    assert found.radius < 3.0 + 20.0 + 1.0


def test_what_turns_between_two_looks_is_seen_to():
    """Of 0.9 s to and fro, looks of 20 ms may miss the end by a quarter of a millimetre."""
    own, _ = watched(lambda time: swinging(time + 0.0137, 7.0), 200)
    assert own._places[:, 0, 0].max() == pytest.approx(58.0, abs=0.01)


def left(time):
    """Swings for two seconds, and goes away at 10 mm/s."""
    there, way = swinging(min(time, 2.0)), max(time - 2.0, 0.0) * 10.0
    rate = (10.0, 0.0, 0.0) if time > 2.0 else there.velocity
    ends = (there.a[0] + way, *there.a[1:])
    return replace(there, a=ends, b=ends, velocity=rate)


@pytest.mark.parametrize(("after", "known"), [(9.0, True), (11.0, False)])
def test_what_was_swept_is_forgotten_after_ten_seconds(after, known):
    _, found = watched(left, round((2.0 + after) / 0.02))
    assert (min(found.a[0], found.b[0]) < 15.0) == known
    assert (found.velocity == (10.0, 0.0, 0.0)) != known


def backing(by):
    """Flies 80 mm along x, goes back by so much, and stands."""

    def motion(time):
        x = min(200.0 * time, 80.0) - (by if time > 0.45 else 0.0)
        return Obstacle.sphere((x, 0.0, 0.0), 3.0, (200.0 if time < 0.39 else 0.0, 0.0, 0.0))

    return motion


@pytest.mark.parametrize(("by", "turned"), [(0.9, False), (1.1, True)])
def test_what_has_gone_back_by_more_than_a_millimetre_has_turned(by, turned):
    """As long after it stopped as there is no more to be seen of a spring: half a second."""
    _, found = watched(backing(by), 60)
    assert (found.a != found.b) == turned


def caught(time):
    """Swings for 0.12 s, and is held there."""
    there = swinging(min(time, 0.12))
    return there if time < 0.12 else replace(there, velocity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize(("looks", "seen"), [(22, True), (26, False)])
def test_a_spring_is_looked_for_in_the_last_half_second(looks, seen):
    _, found = watched(caught, 6 + looks)
    assert (found.a != found.b) == seen


@pytest.mark.parametrize(("angle", "seen"), [(0.3, False), (0.35, True)])
def test_a_spring_is_seen_by_a_tenth_of_the_squared_speed(angle, seen):
    """sin^2 is 0.087 and 0.118 there."""
    _, found = watched(lambda time: swinging(time, 10.0 * angle), 6, 0.02, 30.0)
    assert (found.a != found.b) == seen


@pytest.mark.parametrize(("off", "straight"), [(0.9, True), (1.1, False)])
def test_straight_is_what_is_within_a_millimetre_of_its_way(off, straight):
    rate = (100.0, 0.0, 0.0)
    own = Sweeps(0.02, 60.0)
    for k in range(5):
        own.swept([Obstacle.sphere((2.0 * k, off if k == 4 else 0.0, 0.0), 3.0, rate)])
    assert own.straight[0] == pytest.approx(1.2 if straight else 0.08)


def test_slow_ones_and_those_that_stand_are_what_they_are():
    _, slow = watched(lambda time: swinging(time, 2.5), 200)
    assert slow == swinging(0.02 * 199, 2.5)
    still = Obstacle.sphere((0.0, 0.0, -50.0), 3.0)
    assert watched(lambda _: still, 50)[1] == still


@pytest.mark.parametrize("way", [(30.0, 0, 0), (0, 12.0, 5.0), (0.0, 0, 0), (3.0, -40.0, 9.0)])
@pytest.mark.parametrize("rod", [(0.0, 20.0, 0.0), (5.0, 1.0, -8.0), (0.0, 0.0, 0.0)])
def test_the_capsule_about_a_way_holds_all_of_it(rod, way):
    rod, way = np.array(rod), np.array(way)
    own = Obstacle(tuple(-rod), tuple(rod), 2.0)
    found = about(own, np.zeros(3), way)
    shares = np.linspace(0.0, 1.0, 11)
    places = (shares[:, None] * way)[:, None] + (2 * shares[:, None] - 1) * rod
    places = places.reshape(-1, 1, 3)
    axes = np.tile([[found.a, found.b]], (len(places), 1, 1))
    off = nearest(np.repeat(places, 2, axis=1), axes).distance
    assert (off + 2.0 <= found.radius + 1e-9).all()


def test_a_gap_is_that_of_an_obstacle_and_not_of_its_way():
    own = Controller(Statement(BODIES, 1, Settings(p=5)), OneStep(compiled=False), Safety(9.0))
    for k in range(80):
        there = swinging(0.02 * k)
        own._underway.reset()  # the tips stand, whatever is sent
        command = own.step(START, START, [there])
        expected = min(there.a[0], 90.0 - there.a[0]) - 2.5 - 5.0 - 2.0
        assert command.gap == pytest.approx(expected, abs=1e-6)


def test_a_sphere_without_a_slot_for_its_way_is_a_sphere():
    """What it sweeps is a capsule; where spheres alone have a place, nothing is dropped."""
    own = Controller(Statement(BODIES, 0, Settings(p=5), 1), OneStep(compiled=False), Safety(9.0))
    for k in range(40):
        command = own.step(START, START, [swinging(0.02 * k)])
        assert all(e.trouble.value != "too-many-obstacles" for e in command.events)


def braking(time):
    """A sphere that flies at 300 mm/s, brakes evenly, and stands from 0.5 s on."""
    t = min(time, 0.5)
    return Obstacle.sphere((300.0 * t - 300.0 * t * t, 0, 0), 3.0, (300.0 - 600.0 * t, 0, 0))


@pytest.mark.parametrize("steps", [4, 10, 20, 26, 40, 60, 120])
def test_what_brakes_and_stands_is_somewhere(steps):
    _, found = watched(braking, steps)
    numbers = np.array([*found.a, *found.b, found.radius])
    assert np.isfinite(numbers).all()
    assert np.abs(numbers).max() <= 10.0 * 300.0 + 150.0


@pytest.mark.parametrize("seed", range(3))
def test_noise_of_what_is_seen_costs_a_margin_and_no_contact(seed):
    """0.1 mm and 2 mm/s per axis: a way seems longer than it is, and goes on all the same."""
    rng = np.random.default_rng(seed)

    def seen(there):
        place = tuple(there.a + rng.normal(0.0, 0.1, 3))
        rate = tuple(there.velocity + rng.normal(0.0, 2.0, 3))
        return replace(there, a=place, b=place, velocity=rate)

    assert least(lambda time: swinging(time, 4.0), BESIDE, 100, seen)[0] > 1.0


@pytest.mark.parametrize(
    ("looks", "off", "seen"), [(12, 1.5, True), (12, 1.8, False), (4, 2.0, True), (5, -2.4, False)]
)
def test_a_spring_leaves_less_than_a_fifth_of_the_changes_over(looks, off, seen):
    """Errors to and fro that leave 0.188, 0.210, 0.203 and 0.214; four looks cannot tell."""
    s, errors = np.linspace(0.0, 8.0, looks), 0.5 * off * (-1.0) ** np.arange(looks)
    steps = np.sqrt(16.0 - 0.05 * (s - 1.0) ** 2 + errors)
    axis = np.array([[1.0, 0.0, 0.0]])
    assert bool(len(_spring(s[:, None] * axis, steps[:, None] * axis, 500))) == seen


def test_places_tell_how_an_obstacle_moves_where_its_velocity_is_not_stated():
    def look(k, stated=(0.0, 0.0, 0.0), jump=0.0):
        return [Obstacle.sphere((0.8 * k + jump, 0.0, -70.0), 5.0, stated)]

    looks = Looks(0.02)
    found = [looks.believed(look(k)) for k in range(12)]
    assert not found[0][1]
    assert found[-1][1] == [0]
    assert found[-1][0][0].velocity == pytest.approx((40.0, 0.0, 0.0))
    # Who is somewhere else is another one, of whom nothing is known but what is stated.
    assert looks.believed(look(12, jump=500.0))[0][0].velocity == (0.0, 0.0, 0.0)
    fast = 1.01 * FASTEST * 0.02
    assert looks.believed(look(13, jump=500.0 + fast))[1] == []
    told = Looks(0.02)
    assert not any(told.believed(look(k, (40.0, 0.0, 0.0)))[1] for k in range(12))
    # Velocities of what swings are as stated, however fast it is, between looks too.
    swings = Looks(0.02)
    assert not any(swings.believed([swinging(0.02 * k, 30.0)])[1] for k in range(50))


def test_an_instrument_leaves_the_way_of_what_comes_though_its_velocity_is_not_stated():
    def coming(time):
        return Obstacle.sphere((0.0, 100.0 - 40.0 * time, -110.0), 8.0)

    clearance, _ = least(coming, START, steps=150)
    assert clearance > 1.0
