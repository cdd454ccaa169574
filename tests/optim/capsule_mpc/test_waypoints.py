"""Waypoints: the plane, what interferes with the straight way, and ways around it."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plumbline.optim.capsule_mpc import Obstacle, Settings, Statement, TipInstrument
from plumbline.optim.capsule_mpc.waypoints import (
    Tool,
    detour,
    drawn_back,
    interferes,
    is_free,
    plane_distances,
    plane_normal,
    swept,
    waypoint,
)
from tests.in_mm import Guide

SAFE = 2.0
TOOL = Tool(np.zeros(3), np.array([-30.0, 0.0, -100.0]), np.array([30.0, 0.0, -100.0]), 250.0, 2.5)


def ball(x, y, z, radius=5.0):
    """A sphere as ends (1, 2, 3) and radii (1,)."""
    return np.array([[[x, y, z], [x, y, z]]]), np.array([radius])


def test_the_plane_holds_both_axes():
    n = plane_normal(TOOL)
    shafts = TOOL.shafts(np.stack([TOOL.tip, TOOL.goal]))
    assert np.linalg.norm(n) == pytest.approx(1.0)
    assert np.abs((shafts.reshape(-1, 3) - TOOL.tip) @ n).max() < 1e-9


def test_going_straight_in_has_no_plane():
    straight = Tool(np.zeros(3), np.array([0, 0, -50.0]), np.array([0, 0, -100.0]), 250.0, 2.5)
    assert not plane_normal(straight).any()
    assert interferes(straight, *ball(1.0, 0.0, -90.0), SAFE).all()
    assert not interferes(straight, *ball(30.0, 0.0, -90.0), SAFE).any()


def test_a_segment_through_a_plane_is_at_no_distance_from_it():
    n = np.array([0.0, 1.0, 0.0])
    ends = np.array([[[0, -1, 0], [0, 2, 0]], [[0, 3, 0], [5, 4, 1]], [[0, 0, 0], [1, 7, 0]]])
    assert plane_distances(n, np.zeros(3), ends) == pytest.approx([0.0, 3.0, 0.0])


@pytest.mark.parametrize(
    ("place", "blocked"),
    [
        ((0.0, 0.0, -90.0), True),  # in the middle of the sweep
        ((0.0, 9.0, -90.0), True),  # beside the plane, nearer than D = 9.5
        ((0.0, 10.0, -90.0), False),  # a little farther
        ((0.0, 0.0, -120.0), False),  # in the plane, beyond the tip
        ((80.0, 0.0, -100.0), False),  # in the plane, beyond the goal
        ((60.0, 0.0, 100.0), False),  # in the plane, behind the trocar, outside of the sweep
    ],
)
def test_what_interferes_is_near_the_plane_and_inside_of_the_sweep(place, blocked):
    assert interferes(TOOL, *ball(*place), SAFE).any() == blocked


def test_nothing_in_the_way_leaves_the_goal():
    found = waypoint(TOOL, *ball(0.0, 40.0, -90.0), SAFE)
    assert found.beta == 0.0
    assert found.blocking is None
    assert np.array_equal(found.reference, TOOL.goal)
    nothing = waypoint(TOOL, np.zeros((0, 2, 3)), np.zeros(0), SAFE)
    assert np.array_equal(nothing.reference, TOOL.goal)


@pytest.mark.parametrize("y", [-6.0, -1.0, 0.0, 3.0])
def test_the_waypoint_is_clear_of_what_blocks(y):
    ends, radii = ball(2.0, y, -80.0)
    found = waypoint(TOOL, ends, radii, SAFE)
    assert 0.0 < found.beta < 1.0
    assert found.blocking == 0
    assert np.linalg.norm(found.w - ends[0, 0]) >= radii[0] + TOOL.radius + SAFE
    through = TOOL.trocar + 100.0 * found.w / np.linalg.norm(found.w)
    assert swept(TOOL, through[None], ends, radii).min() >= SAFE - 0.5
    # T, Z and w lie on one line, w beyond T as seen from Z.
    assert np.linalg.norm(np.cross(found.T - found.Z, found.w - found.Z)) < 1e-6


@pytest.mark.parametrize("y", [-6.0, -1.0, 0.0, 3.0])
@pytest.mark.parametrize("safe", [0.0, SAFE, 5.0])
def test_a_shaft_through_a_waypoint_is_slowed_by_no_barrier_and_goes_no_farther_out(y, safe):
    ends, radii = ball(2.0, y, -80.0)
    w = waypoint(TOOL, ends, radii, safe).w
    through = TOOL.trocar + 100.0 * w / np.linalg.norm(w)
    assert safe + 1.75 < swept(TOOL, through[None], ends, radii).min() <= safe + 2.0


def test_of_several_the_nearest_blocks():
    first, second = ball(0.0, 8.0, -80.0), ball(5.0, 1.0, -80.0)
    ends = np.concatenate([first[0], second[0]])
    found = waypoint(TOOL, ends, np.concatenate([first[1], second[1]]), SAFE)
    assert found.blocking == 1


@pytest.mark.parametrize("y", [-4.0, 0.0, 4.0])
def test_a_detour_is_free(y):
    ends = np.array([[[0, -15.0 + y, -95.0], [0, 15.0 + y, -95.0]]])
    radii = np.array([4.0])
    legs = detour(TOOL, ends, radii, SAFE)
    assert legs is not None
    assert np.array_equal(legs[-1], TOOL.goal)
    assert is_free(TOOL, np.vstack([TOOL.tip, legs]), ends, radii, SAFE)


def test_no_detour_is_claimed_through_a_closed_wall():
    heights = np.linspace(-180.0, 60.0, 40)
    ends = np.array([[[0, -150.0, z], [0, 150.0, z]] for z in heights])
    assert detour(TOOL, ends, np.full(40, 4.0), SAFE) is None


def test_drawing_back_stays_on_the_axes():
    back, over, last = drawn_back(TOOL, 30.0)
    assert np.linalg.norm(back) == pytest.approx(30.0)
    assert np.linalg.norm(np.cross(back, TOOL.tip)) < 1e-9
    assert np.linalg.norm(np.cross(over, TOOL.goal)) < 1e-9
    assert np.array_equal(last, TOOL.goal)


places = st.tuples(st.floats(-40, 40), st.floats(-12, 12), st.floats(-120, -40))


@settings(max_examples=60, deadline=None)
@given(places, places, st.integers(0, 1000))
def test_waypoints_turn_with_the_frame(a, b, seed):
    ends, radii = np.array([[a, b]]), np.array([3.0])
    R = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    shift = np.array([5.0, -70.0, 20.0])
    moved = Tool(shift, R @ TOOL.tip + shift, R @ TOOL.goal + shift, TOOL.length, TOOL.radius)
    here, there = (
        waypoint(TOOL, ends, radii, SAFE),
        waypoint(moved, ends @ R.T + shift, radii, SAFE),
    )
    # Where shaft and obstacle are parallel, which of their points are nearest is undetermined.
    along, shaft = ends[0, 1] - ends[0, 0], here.T - TOOL.trocar
    across = np.linalg.norm(np.cross(along, shaft))
    assume(across >= 1e-2 * np.linalg.norm(along) * np.linalg.norm(shaft))
    if here.blocking is None or swept(TOOL, here.T[None], ends, radii).min() > -5.0:
        assert there.beta == here.beta
        assert np.abs(R @ here.reference + shift - there.reference).max() < 1e-5


def guide(*trocars):
    """A guide for instruments by their tips."""
    return Guide(
        Statement(tuple(TipInstrument(tuple(1e-3 * x for x in t)) for t in trocars), 0, Settings())
    )


def test_the_guide_says_the_goal_where_the_way_is_free():
    goals = np.array([[20.0, 0.0, -100.0]])
    found = guide((0.0, 0.0, 0.0)).reference(np.array([[-20.0, 0.0, -100.0]]), goals, [])
    assert np.allclose(found, goals, rtol=0, atol=1e-12)


def test_the_guide_leads_around_and_then_to_the_goal():
    own = guide((0.0, 0.0, 0.0))
    tip, goals = np.array([[-30.0, 0.0, -100.0]]), np.array([[30.0, 0.0, -100.0]])
    rod = Obstacle((0.0, -15.0, -95.0), (0.0, 15.0, -95.0), 4.0)
    seen = []
    for _ in range(200):
        target = own.reference(tip, goals, [rod])
        seen.append(target)
        way = target - tip
        tip = tip + way * min(1.0, 1.2 / max(float(np.linalg.norm(way)), 1e-9))
    assert not np.array_equal(seen[0], goals)
    assert np.abs(tip - goals).max() < 1e-9


def test_a_tool_that_comes_no_closer_is_sent_another_way():
    own = guide((-30.0, 0.0, 0.0), (30.0, 0.0, 0.0))
    tips = np.array([[0.0, 0.0, -100.0], [8.0, 0.0, -100.0]])
    goals = tips + np.array([[25.0, 15.0, 0.0], [-25.0, -15.0, 0.0]])
    changed = [k for k in range(120) if not np.allclose(own.reference(tips, goals, []), goals)]
    assert changed
    assert changed[0] > 20


def test_where_a_tool_cannot_be_it_is_not_sent_about():
    """Goals whose shafts cross, one too deep, one in an obstacle, and one at its own trocar."""
    tips = np.array([[0.0, 0.0, -100.0], [8.0, 0.0, -100.0]])
    ball = Obstacle.sphere((20.0, 30.0, -100.0), 10.0)
    for goal in ([25.0, 0.0, -100.0], [0.0, 0.0, -300.0], [20.0, 30.0, -100.0], [-30.0, 0.0, 0.0]):
        own = guide((-30.0, 0.0, 0.0), (30.0, 0.0, 0.0))
        goals = np.array([goal, [-17.0, 0.0, -100.0]])
        said = np.array([own.reference(tips, goals, [ball])[0] for _ in range(120)])
        assert np.allclose(said, goal, rtol=0, atol=1e-9)


def test_a_guide_is_not_upset_by_numbers_that_are_none():
    tips = np.full((1, 3), np.nan)
    assert np.isnan(guide((0.0, 0.0, 0.0)).reference(tips, tips, [])).all()
