"""Obstacles as fast as a tip: who stands in their way leaves it in time, and nobody else moves."""

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
    Trouble,
    constants,
    evasion,
    sweeps,
)
from plumbline.optim.capsule_mpc.waypoints import Tool
from tests.in_mm import Controller, Guide

BODIES = (TipInstrument((0.0, 0.0, 0.0)), TipInstrument((0.09, 0.0, 0.0)))
START = np.array([0.0, 0.0, -120.0, 90.0, 0.0, -120.0])
BALL = Obstacle.sphere((-70.0, 0.0, -70.0), 5.0, (55.0, 0.0, 0.0))
ROD = replace(BALL, a=(-70.0, -15.0, -70.0), b=(-70.0, 15.0, -70.0))
REST, FOR = np.zeros(6), np.array([1.2])  # [mm/s] of the tips, [s] that it goes straight on
WHITHER = {"where it is": START, "ahead of it": START + np.array([40.0, 0, 0, 0, 0, 0])}


def later(obstacle, time):
    """An obstacle that has gone straight on for a time [s]."""
    way = time * np.array(obstacle.velocity)
    return replace(obstacle, a=tuple(obstacle.a + way), b=tuple(obstacle.b + way))


def least(obstacle, goal, steps=120, start=START):
    """Least clearance of the first shaft on the way, and where the tips end."""
    own, x, found = (
        Controller(
            Statement(BODIES, 1, Settings(p=5)), OneStep(compiled=False), Safety(budget=9.0)
        ),
        start.copy(),
        np.inf,
    )
    for k in range(steps):
        rate = own.step(x, goal, [later(obstacle, 0.02 * k)]).rate
        for part in range(5):
            tip, there = x[:3] + 0.004 * part * rate[:3], later(obstacle, 0.02 * k + 0.004 * part)
            shaft = np.stack([tip, tip - 250.0 * tip / np.linalg.norm(tip)])
            gap = nearest(shaft[None], np.array([[there.a, there.b]])).distance[0]
            found = min(found, float(gap) - 2.5 - obstacle.radius)
        x = x + 0.02 * rate
    return found, x


@pytest.mark.parametrize("obstacle", [BALL, ROD], ids=["ball", "rod"])
@pytest.mark.parametrize("goal", WHITHER.values(), ids=WHITHER)
def test_who_is_overtaken_leaves_the_way_in_time(obstacle, goal):
    """Between trocar and tip a shaft is slower than what comes: giving way does not help."""
    clearance, _ = least(obstacle, goal)
    assert clearance > 1.95


TIGHT = {  # tips, and rods that come straight at their shafts; a ray leaves 2 mm and more
    "deep": ((17, -50, -117), Obstacle((18, 158, -79), (-7, 166, -69), 1.8, (13, -337, 2))),
    "shallow": ((-30, -14, -64), Obstacle((24, -119, 15), (23, -124, 16), 3.5, (-63, 226, -61))),
    "soon": ((2, -58, -111), Obstacle((-1, -60, -23), (-12, -67, -7), 3.2, (-1, 144, -277))),
}


@pytest.mark.parametrize(("tip", "rod"), TIGHT.values(), ids=TIGHT)
def test_ways_out_that_are_about_as_good_do_not_take_turns(tip, rod):
    """Which was best had hung on when it was looked at: tips stayed, and were hit."""
    start = np.array([*tip, 90.0, 0.0, -120.0])
    clearance, _ = least(rod, start, 40, start)
    assert clearance > 1.5


def head_on(way, seconds, radius=5.0):
    """A sphere at 400 mm/s that is to hit the first shaft in the middle after some time [s]."""
    rate = 400.0 * np.array(way) / np.linalg.norm(way)
    return Obstacle.sphere(tuple([0.0, 0.0, -70.0] - seconds * rate), radius, tuple(rate))


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (-1, 2, 0), (1, 1, 2), (2, -1, -1)])
@pytest.mark.parametrize("seconds", [0.5, 1.1])
def test_what_is_faster_than_a_tip_is_evaded_where_there_is_time(way, seconds):
    """The tip has time for 26 mm and more; pushed out of all of the way ahead it came to 12."""
    clearance, _ = least(head_on(way, seconds), START, 60)
    assert clearance > 1.9


@pytest.mark.parametrize(("seconds", "said"), [(0.15, True), (0.6, False)])
def test_what_cannot_be_evaded_is_said_at_once(seconds, said):
    own = Controller(
        Statement(BODIES, 1, Settings(p=5)), OneStep(compiled=False), Safety(budget=9.0)
    )
    events = own.step(START, START, [head_on((1, 1, 0), seconds)]).events
    words = [event.words for event in events if event.trouble is Trouble.CANNOT_BE_MET]
    assert any("instrument 1: no way out" in line for line in words) == said


def test_who_has_made_way_comes_back():
    _, x = least(BALL, START, 220)
    np.testing.assert_allclose(x, START, atol=1.0)


@pytest.mark.parametrize(
    "obstacle",
    [
        later(replace(BALL, velocity=(-55.0, 0.0, 0.0)), 0.1),
        replace(BALL, velocity=(55.0, 40.0, 0.0)),
        replace(BALL, velocity=(0.0, 0.0, 0.0)),
    ],
    ids=["goes away", "goes past", "stands"],
)
def test_nobody_makes_way_for_what_does_not_come(obstacle):
    own = evasion.Evasion(Statement(BODIES, 1, Settings(p=5)))
    assert own.goal(START, REST, START, [obstacle], FOR) is START


@pytest.mark.parametrize("rod", [0.0, 12.0])
@pytest.mark.parametrize("off", np.arange(0.0, 28.0, 4.0))
def test_what_is_fast_is_not_missed_between_two_looks(off, rod):
    """At 700 mm/s it is on this side of the shaft at one look and on the other at the next."""
    place = (-300.0 + off, 0.0, -70.0)
    flier = Obstacle((place[0], -rod, -70.0), (place[0], rod, -70.0), 3.0, (700.0, 0.0, 0.0))
    own = evasion.Evasion(Statement(BODIES[:1], 1, Settings(p=5)))
    goal = START[:3] + np.array([1.0, 0.0, 0.0])
    found = own.goal(START[:3], REST[:3], goal, [flier], FOR)
    assert np.linalg.norm(found - START[:3]) > 30.0


def test_a_rod_that_comes_end_foremost_past_a_shaft_is_no_reason_to_leave():
    rod = Obstacle((-90.0, 14.0, -70.0), (-50.0, 14.0, -70.0), 3.0, (55.0, 0.0, 0.0))
    own = evasion.Evasion(Statement(BODIES, 1, Settings(p=5)))
    assert own.goal(START, REST, START, [rod], FOR) is START


def test_a_way_out_is_kept_while_it_keeps_clear():
    own = evasion.Evasion(Statement(BODIES, 1, Settings(p=5)))
    first = own.goal(START, REST, START, [BALL], FOR)
    way = (first - START) / constants.AHEAD
    assert np.linalg.norm(way[:3]) == pytest.approx(60.0)
    assert not way[3:].any()
    on = own.goal(START + 0.02 * way, REST, START, [later(BALL, 0.02)], FOR)
    np.testing.assert_allclose(on - START - 0.02 * way, first - START)


def test_what_swings_is_believed_as_far_ahead_as_it_went_straight():
    """A swing of 20 mm at 100 mm/s leaves its tangent by 1 mm after some 60 ms."""
    own = sweeps.Sweeps(0.02, 60.0)
    believed = []
    for k in range(60):
        angle = 5.0 * 0.02 * k
        ball = Obstacle.sphere(
            (-35.0 + 20.0 * np.sin(angle), 0.0, -70.0), 5.0, (100.0 * np.cos(angle), 0.0, 0.0)
        )
        own.swept([ball])
        believed.append(float(own.straight[0]))
    assert believed[0] == constants.AHEAD
    assert max(believed[20:]) < 0.2


@pytest.mark.parametrize(("lean", "deep"), [(-0.6, True), (0.6, False)])
def test_shafts_that_meet_outside_go_deep_and_others_draw_back(lean, deep):
    """Tips that lean apart have their outer ends together; drawing back would add to those."""
    bodies = (TipInstrument((-0.02, 0.0, 0.0)), TipInstrument((0.02, 0.0, 0.0)))
    trocars = np.array([body.constants for body in bodies])
    tips = trocars + 60.0 * np.array([[lean, 0.0, -0.8], [-lean, 0.0, -0.8]])
    tools = [Tool(trocars[k], tips[k], tips[k] + [0.0, 30.0, 0.0], 250.0, 2.5) for k in range(2)]
    guide = Guide(Statement(bodies, 0))
    guide._stalls[0] = 2  # a detour was tried
    back, _, goal = guide._another(0, tools, np.zeros((0, 2, 3)), np.zeros(0))
    wanted = 0.5 * 250.0 if deep else 35.0
    assert np.linalg.norm(back - trocars[0]) == pytest.approx(wanted)
    np.testing.assert_array_equal(goal, tools[0].goal)
