"""Laws of a needle's surroundings: organs, vessels, bones, table, the arm itself; by coal."""

import re
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.judged import judged
from plumbline.optim.pointing import (
    Aim,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Mesh,
    Needle,
    PointingOptions,
    Scene,
    Solid,
    Sphere,
    Status,
    plan_sweep,
    safe_angle_map,
)
from plumbline.optim.pointing.aim import directions
from plumbline.optim.pointing.between import Planes, between, curvatures
from plumbline.optim.pointing.constants import LARGEST_FILE, RESOLUTION, SLOTS
from plumbline.optim.pointing.postures import starts
from plumbline.optim.pointing.statement import IPOPT, SweepStatement, SweepWeights, sweep_statement
from plumbline.optim.pointing.surroundings import surroundings
from plumbline.optim.pointing.sweep import NO_SOLVE
from plumbline.optim.pointing.task import moving, needle_task, pointed
from tests.needle_scenes import ball, gap, in_coal, least_at, shortfall
from tests.optim.pointing.test_pointing import ARC, LESION, NEEDLE, PHANTOM, UR3, UR5, deg, placed

AORTA = Solid("aorta", Capsule((0.03, 0.02, 0.09), (0.03, 0.16, 0.09), 0.008), margin=3e-3)
RIB = Solid("rib", Box((0.0, 0.045, 0.125), (0.12, 0.055, 0.135)))
LIVER = Solid("liver", Sphere((0.06, 0.12, 0.06), 0.05), enter=True)
KIDNEY = Solid("kidney", ball((0.09, 0.05, 0.09), 0.02))
SPINE = Solid("spine", Cylinder((0.06, 0.08, 0.02), 0.012, 0.15, (0.0, 1.0, 0.0)))
TABLE = Solid("table", HalfSpace((0.0, 0.0, -0.01)))
ANATOMY = (AORTA, RIB, LIVER, KIDNEY, SPINE)
RINGS, AROUND = deg([15.0, 40.0, 55.0]), deg(np.arange(0.0, 360.0, 30.0))


def aimed(*anatomy, room=(), chain=UR3, needle=NEEDLE, body=PHANTOM, **place):
    return Aim(chain, placed(**place), LESION, needle, body, scene=Scene(anatomy, room))


@pytest.fixture(scope="module")
def mapped():
    """The angles of a UR5 in a full scene."""
    return safe_angle_map(aimed(*ANATOMY, room=(TABLE,), chain=UR5), RINGS, AROUND)


def test_a_blocked_angle_names_what_the_path_meets(mapped):
    T = placed()
    blocked = np.argwhere(mapped.status == Status.BLOCKED)
    named = set()
    for i, j in blocked:
        u = T[:3, :3] @ directions(mapped.theta[i], mapped.beta[j])
        q = np.zeros((1, 6))
        at = np.array([mapped.theta[i]]), np.array([mapped.beta[j]])
        path = pointed(mapped.aim, q, *at)[0, -1]
        np.testing.assert_allclose(path[1] - path[0], NEEDLE.standoff * u, atol=1e-12)
        gaps = {
            s.name: gap(in_coal(s.shape, T), in_coal(Capsule(*path, NEEDLE.radius), np.eye(4)))
            - (2e-3 if s.margin is None else s.margin)
            for s in (AORTA, RIB, KIDNEY, SPINE)
        }
        worst = min(gaps, key=gaps.get)
        named.add(worst)
        assert gaps[worst] < 0.0
        assert f" {worst}: clearance" in mapped.reasons[i, j]
        told = mapped.worst[i, j]
        assert (told.first, told.second) == ("needle path", worst)
        assert told.distance - told.limit == pytest.approx(gaps[worst], abs=1e-6)
    assert len(named) >= 2
    assert mapped.worst[mapped.safe].tolist() == [None] * int(mapped.safe.sum())


def test_a_safe_angle_keeps_every_limit_by_another_judge(mapped):
    assert mapped.safe.any()
    for q in mapped.joints[mapped.safe]:
        assert shortfall(mapped.aim, q[None], 1)[0] >= -1e-6


def test_a_solid_blocks_angles_and_never_frees_one(mapped):
    free = safe_angle_map(aimed(chain=UR5), RINGS, AROUND)
    assert (mapped.safe <= free.safe).all()
    assert mapped.safe.sum() < free.safe.sum()


def test_a_solid_that_may_be_entered_leaves_the_path_free():
    keep = Solid("tumour bed", Sphere((0.05, 0.13, 0.075), 0.005))
    angle = ([deg(40.0)], [deg(270.0)])
    (blocked,) = safe_angle_map(aimed(keep), *angle).status.ravel()
    (free,) = safe_angle_map(aimed(replace(keep, enter=True)), *angle).status.ravel()
    assert (blocked, free) == (Status.BLOCKED, Status.SAFE)


def test_a_margin_is_what_decides_at_the_edge():
    ask = ([deg(35.0)], [deg(270.0)])
    u = directions(deg(35.0), deg(270.0))
    side = np.cross(u, [1.0, 0.0, 0.0])
    centre = np.array(LESION) + 0.06 * u + 0.020 * side / np.linalg.norm(side)
    clearance = 0.020 - 0.010 - NEEDLE.radius
    for margin, status in ((clearance - 1e-6, Status.SAFE), (clearance + 1e-6, Status.BLOCKED)):
        vessel = Solid("vein", Sphere(tuple(centre), 0.010), margin=margin)
        assert safe_angle_map(aimed(vessel), *ask).status[0, 0] == status


def test_a_needle_that_would_pass_through_its_own_arm_collides():
    # Turned backwards in its flange it runs along the forearm; nothing else is near.
    backwards = Needle(0.30, 0.10, axis=(0.0, 0.0, -1.0))
    found = plan_sweep(aimed(needle=backwards, body=None, x=0.25, y=-0.15, z=0.3), deg(20.0), 0.0)
    own = [p for p in found.pairs if p.first == "needle" and p.second.startswith("link ")]
    assert own
    expected = least_at(found.aim, found.joints[0])
    for pair in own:
        if (pair.first, pair.second) in expected:
            assert pair.distance == pytest.approx(expected[pair.first, pair.second], abs=1e-6)


def test_the_needle_is_judged_beside_its_own_links_by_coal():
    aim = aimed()
    around = surroundings(aim, 2e-3)
    own = [pair for pair in around.pairs if pair.link >= 0]
    q = starts(needle_task(UR3, NEEDLE.axis), 200)
    segments = moving(UR3, NEEDLE, q)
    met = 0
    for posture, row in zip(q[:40], segments, strict=False):
        expected = least_at(aim, posture)
        ours = {}
        for p in own:
            if np.linalg.norm(np.diff(row[p.link], axis=0)) > 1e-6:
                key = (p.first, p.second)
                ours[key] = min(ours.get(key, np.inf), around.distance(row, p))
        assert ours
        for key, value in ours.items():
            if key in expected:
                assert value == pytest.approx(expected[key], abs=1e-6)
                met += value < 0.0
    assert met >= 3
    assert "link joint6, needle" in around.left_out


@pytest.mark.parametrize("shape", [HalfSpace((0, 0, 0.3)), Box((-1, -1, 0.2), (1, 1, 0.3))])
def test_a_table_in_the_arm_s_way_is_a_collision_and_one_below_is_not(shape):
    ask = ([deg(35.0)], [deg(270.0)])
    found = safe_angle_map(aimed(room=[Solid("table", shape)]), *ask)
    assert found.status[0, 0] == Status.COLLISION
    assert "table" in found.reasons[0, 0]
    assert safe_angle_map(aimed(room=[TABLE]), *ask).safe.all()


def test_only_what_never_moves_may_touch_the_room():
    around = surroundings(aimed(room=[TABLE]), 2e-3)
    judged = {p.first for p in around.pairs if p.second == "table"}
    assert judged == {f"link joint{j}" for j in range(2, 7)} | {"needle", "needle path"}
    assert set(around.left_out) >= {"link joint1, room"}


def test_a_sphere_and_its_mesh_are_equally_far():
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (60, 2, 3))
    sphere = in_coal(Sphere((0.01, 0.02, 0.03), 0.04), np.eye(4))
    mesh = Solid("ball", ball((0.01, 0.02, 0.03), 0.04, 24))
    around = surroundings(aimed(mesh, body=None), 2e-3)
    pair = next(p for p in around.pairs if p.first == "needle")
    T = placed()
    inside = 0
    for a, b in points:
        row = np.zeros((15, 2, 3))
        row[13] = np.array([a, b]) @ T[:3, :3].T + T[:3, 3]
        ours = around.distance(row, pair)
        theirs = gap(sphere, in_coal(Capsule(a, b, NEEDLE.radius), np.eye(4)))
        if theirs > 0.0:
            assert ours == pytest.approx(theirs, abs=4e-4)
        else:
            inside += 1
            assert ours < 4e-4
    assert inside > 10


def test_a_needle_wholly_within_a_mesh_is_in_it():
    # Its surface is far from the needle, so that only the inside tells.
    room = Scene(room=[Solid("tank", ball((0.5, -0.3, 0.7), 0.5), enter=True)])
    aim = Aim(UR3, placed(), LESION, Needle(0.1, 0.1), None, scene=room)
    around = surroundings(aim, 2e-3)
    pair = next(p for p in around.pairs if p.first == "needle")
    row = pointed(aim, np.zeros((1, 6)), np.zeros(1), np.zeros(1))[0]
    assert around.distance(row, pair) < -0.2


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_the_winding_number_tells_inside_from_outside(seed):
    rng = np.random.default_rng(seed)
    centre, radius = rng.uniform(-1, 1, 3), rng.uniform(0.01, 0.5)
    mesh = ball(centre, radius)
    share = np.concatenate([rng.uniform(0.0, 0.9, 20), rng.uniform(1.05, 2.0, 20)])
    way = rng.normal(size=(40, 3))
    points = centre + radius * share[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    np.testing.assert_array_equal(mesh.contains(points), share < 1.0)
    turned_over = Mesh(mesh.vertices, mesh.triangles[:, ::-1])
    np.testing.assert_array_equal(turned_over.contains(points), share < 1.0)


def test_the_way_out_of_a_mesh_is_that_of_the_box_it_stands_for():
    skin = Mesh(*box_surface(PHANTOM.lower, PHANTOM.upper))
    u = directions(*np.meshgrid(deg(np.arange(5, 90, 7.0)), deg(np.arange(0, 360, 13.0)))).reshape(
        -1, 3
    )
    np.testing.assert_allclose(
        skin.depth(np.array(LESION), u), PHANTOM.depth(np.array(LESION), u), atol=1e-9
    )
    as_mesh = safe_angle_map(Aim(UR5, placed(), LESION, NEEDLE, skin), RINGS, AROUND)
    as_box = safe_angle_map(Aim(UR5, placed(), LESION, NEEDLE, PHANTOM), RINGS, AROUND)
    np.testing.assert_array_equal(as_mesh.status, as_box.status)


def box_surface(lower, upper):
    """Corners and triangles of a box."""
    low, high = np.array(lower), np.array(upper)
    corners = np.array([[(low, high)[(k >> i) & 1][i] for i in range(3)] for k in range(8)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


# Between the angles.


@pytest.fixture(scope="module")
def ridge():
    """Two angles on both sides of the box's edge, behind which the tip would be at the edge."""
    fine = deg(np.linspace(230.0, 270.0, 401))
    theta = np.full(len(fine), deg(70.0))
    depth = PHANTOM.depth(np.array(LESION), directions(theta, fine))
    k = int(depth.argmax())
    beta = fine[[k - 30, k + 30]]
    standoff = float(depth[[k - 30, k + 30]].max()) + 3.5e-3
    aim = Aim(UR5, placed(turn=0.0, z=0.5), LESION, Needle(0.401, standoff), PHANTOM)
    return aim, deg(70.0), beta, PointingOptions(longest_step=0.6)


def test_an_edge_between_two_angles_is_seen(ridge):
    found = plan_sweep(*ridge)
    assert np.isfinite(found.joints).all()
    assert shortfall(found.aim, found.joints[:1], 1)[0] > 0.0
    assert shortfall(found.aim, found.joints, 100)[0] < -1e-3
    assert found.status == (Status.SAFE, Status.COLLISION)
    assert "on the way there needle" in found.reasons[1]
    assert found.pairs[0].where % 1.0 != 0.0


@pytest.mark.parametrize("robot", ["ur3", "laparoscopic", "bh7"])
def test_chords_are_left_by_no_more_than_the_bound(robot):
    chain = Robot.bundled(robot).chain()
    needle = Needle(0.2, 0.1, axis=(0.1, 0.3, 0.9))
    rng = np.random.default_rng(1)
    q = starts(needle_task(chain, needle.axis), 30)
    steps = rng.uniform(-0.4, 0.4, q.shape)
    shares = np.linspace(0.0, 1.0, 21)
    closest = 0.0
    for a, step in zip(q, steps, strict=True):
        path = a + shares[:, None] * step
        segments = moving(chain, needle, path)
        chord = segments[0] + shares[:, None, None, None] * (segments[-1] - segments[0])
        away = np.linalg.norm(segments - chord, axis=3).max(axis=(0, 2))
        bend = curvatures(chain, needle.reach, path)
        bound = np.einsum("a,mab,b->m", np.abs(step), bend, np.abs(step)) / 8
        assert (away <= bound + 1e-12).all()
        closest = max(closest, float(away[-1] / bound[-1]))
    assert closest > 0.15  # a bound that is not a law of its own


def test_what_is_proven_between_angles_is_so_and_what_is_told_is_exact():
    # A wall beside the path, moved until it is 0.3 mm from being too near and 0.3 mm too near.
    found = plan_sweep(aimed(body=None), *ARC)
    q = found.joints[::10]
    wall = least_by_wall(q)
    for spare in (3e-4, -3e-4):
        table = Solid("wall", HalfSpace((0.0, wall + spare + 2e-3, 0.0), (0.0, -1.0, 0.0)))
        aim = aimed(room=[table], body=None)
        around = surroundings(aim, 2e-3)
        values = around.table(moving(UR3, NEEDLE, q))
        ways = between(aim, around, q, values)
        short = float((ways.least - around.limits).min(initial=np.inf))
        exact, _ = shortfall(aim, q, 150)
        assert (short < 0.0) == (exact < 0.0)
        if short < 0.0:
            assert short == pytest.approx(exact, abs=2 * RESOLUTION)


def least_by_wall(q):
    """How far in y the arm comes along a path, finely [m]: the limit of a wall that it touches."""
    shares = np.linspace(0.0, 1.0, 401)[:, None]
    fine = np.vstack([a + shares * (b - a) for a, b in pairwise(q)])
    segments = moving(UR3, NEEDLE, fine)[:, 3:13]
    return float(segments[..., 1].max()) + 0.045


@pytest.mark.parametrize("seed", range(3))
def test_a_safe_sweep_stays_clear_however_finely_it_is_judged(seed):
    rng = np.random.default_rng(seed)
    theta = deg(rng.uniform(25.0, 45.0))
    beta = np.sort(deg(rng.uniform(235.0, 305.0, 6)))
    found = plan_sweep(aimed(*ANATOMY, room=[TABLE]), theta, beta)
    clear = [k for k in range(1, 6) if found.safe[k] and found.safe[k - 1]]
    for k in clear:
        assert shortfall(found.aim, found.joints[k - 1 : k + 1], 60)[0] >= -1e-6


def test_the_least_clearance_by_name_is_that_of_the_whole_way():
    # Part of the arc is out of reach: what the needle would meet there is not on the way.
    aim = aimed(*ANATOMY, room=[TABLE])
    found = plan_sweep(aim, deg(30.0), deg(np.linspace(150.0, 300.0, 16)))
    held = np.isfinite(found.joints).all(axis=1)
    assert 3 < held.sum() < 16
    spares = [p.distance - p.limit for p in found.pairs]
    assert spares == sorted(spares)
    exact = {}
    for q in found.joints[held]:
        for pair, value in least_at(aim, q).items():
            exact[pair] = min(exact.get(pair, np.inf), value)
    told = {(p.first, p.second): p for p in found.pairs}
    for pair in exact.keys() & told.keys():
        if told[pair].where.is_integer():
            assert told[pair].distance == pytest.approx(exact[pair], abs=1e-6)
            assert held[int(told[pair].where)]
        else:
            assert told[pair].distance <= exact[pair] + 1e-6
    assert len(exact.keys() & told.keys()) > 20
    assert (found.drift[1:][held[1:] & held[:-1]] > 0.0).all()


# The path is planned in front of what stands.

ASLANT = Needle(0.401, 0.150, axis=(0.0, 0.6, 0.8))


@pytest.fixture(scope="module")
def lamp():
    """A small capsule beside the upper arm of the path that does not know of it."""
    free = plan_sweep(aimed(needle=ASLANT), *ARC)
    start = np.array([0.0959, 0.0344, 0.1950])
    end = start + 0.1 * np.array([0.499, 0.239, -0.833])
    return free, Solid("lamp", Capsule(tuple(start), tuple(end), 0.0285))


def test_a_free_turn_is_used_to_keep_clear(lamp):
    free, solid = lamp
    aim = aimed(needle=ASLANT, room=[solid])
    assert shortfall(aim, free.joints, 1)[0] < -1e-3
    found = plan_sweep(aim, *ARC)
    assert found.is_safe
    assert shortfall(aim, found.joints, 20)[0] >= -1e-6
    assert any("lamp" in name for name in found.constrained)
    assert free.constrained == ()
    assert found.rcm_error.max() < 1e-8


def test_planes_that_cannot_be_kept_still_leave_a_path():
    wall = Solid("wall", HalfSpace((0.0, 0.0, 0.35), (0.0, 0.0, 1.0)))
    found = plan_sweep(aimed(needle=ASLANT, room=[wall]), ARC[0], ARC[1][::6])
    assert np.isfinite(found.joints).all()
    assert Status.COLLISION in found.status


def test_a_plane_is_kept_by_as_much_as_coal_says(lamp):
    free, solid = lamp
    aim = aimed(needle=ASLANT, room=[solid])
    around, task = surroundings(aim, 2e-3), needle_task(UR3, ASLANT.axis)
    statement = SweepStatement(task, 1, SweepWeights(), keeps_off=True)
    segments = moving(UR3, ASLANT, free.joints[:1])[0]
    row = aim.rows(np.array([ARC[0]]), ARC[1][:1])
    seen = 0
    for pair in around.pairs:
        ends = [segments[i] for i in (pair.capsule, pair.link) if i >= 0]
        if min(np.linalg.norm(np.diff(end, axis=0)) for end in ends) < 1e-6:
            continue
        planes = Planes.none(1, task)
        planes.add(0, around, ASLANT.length / ASLANT.reach, pair, segments, 0.0)
        data = np.hstack([row[0], np.zeros(6), planes.data[0]])
        kept = statement.planes[0](free.joints[0], data).full().ravel()[: planes.used[0]]
        spare = around.distance(segments, pair) - pair.limit
        assert kept.min() == pytest.approx(spare, abs=1e-4), pair.name
        seen += 1
    assert seen > 20


def test_the_hessian_of_planes_is_their_own():
    task = needle_task(UR3, (0.0, 0.6, 0.8))
    statement = SweepStatement(task, 2, SweepWeights(), keeps_off=True)
    rng = np.random.default_rng(0)
    x, data = rng.uniform(-1, 1, 6), rng.normal(size=statement.width)
    force, h = rng.normal(size=SLOTS), 1e-5
    g, bend = statement.planes

    def slope(at):
        steps = np.eye(6) * h
        return np.array([force @ (g(at + e, data) - g(at - e, data)).full() for e in steps]) / (
            2 * h
        )

    numeric = np.hstack([(slope(x + h * e) - slope(x - h * e)) / (2 * h) for e in np.eye(6)])
    np.testing.assert_allclose(bend(x, data, force).full(), numeric, atol=2e-4)


# Convergence.


@pytest.fixture(scope="module")
def solved():
    """A solve, what it was given, and its multipliers."""
    task = needle_task(UR3, NEEDLE.axis)
    statement = sweep_statement(task, 30, SweepWeights())
    aim = aimed()
    found = plan_sweep(aim, *ARC)
    rows = aim.rows(np.full(30, ARC[0]), ARC[1])
    held = np.ones(30, dtype=bool)
    return statement, found, rows, held


def test_a_converged_path_says_so_and_a_disturbed_one_does_not(solved):
    statement, found, rows, held = solved
    assert found.judged.converged
    assert "converged" in found.judged.fits[0].words
    problem = statement.at(rows, held, UR3.lower, UR3.upper, 0.3)
    result = IPOPT.solve(problem, statement.start(found.joints))
    assert judged(result).converged
    turned = result.x.copy()
    turned[5::12] += 0.01  # every other angle, about the needle alone: feasible, not the best
    stale = judged(replace(result, x=turned))
    assert not stale.converged
    assert stale.violation < 1e-7
    assert judged(replace(result, x=result.x + 1e-3)).violation > 1e-4
    forces = result.multipliers[1].copy()
    forces[-1] += 1.0
    pressed = judged(replace(result, multipliers=(result.multipliers[0], forces)))
    assert pressed.stationarity > 0.1
    beyond = replace(problem, upper=problem.upper - 20.0, lower=problem.lower - 20.0)
    assert judged(replace(result, problem=beyond)).violation > 1.0


def test_a_path_without_a_solve_is_not_called_converged():
    far = plan_sweep(aimed(x=1.5), deg(20.0), deg([0.0, 90.0]))
    assert not far.judged.converged
    assert "no solve" in far.judged.fits[0].words
    assert not NO_SOLVE.converged


# Refusals.


def cube():
    return box_surface((0, 0, 0), (0.02, 0.02, 0.02))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sphere((0, 0, 0), 0.0), "radius: found 0, expected more than 0"),
        (
            lambda: Sphere((0, np.nan, 0), 0.1),
            "centre: found .0, nan, 0., expected a finite",
        ),
        (lambda: Capsule((0, 0, 0), (0, 0, 0), 0.1), "use Sphere"),
        (
            lambda: Capsule((0, 0, 0), (0, 0, 1), float("inf")),
            "found inf, expected a finite",
        ),
        (lambda: HalfSpace((0, 0, 0), (0, 0, 0)), "half-space normal = 0 0 0"),
        (lambda: Mesh(cube()[0], cube()[1][:-1]), "3 edges with a triangle missing or turned over"),
        (
            lambda: Mesh(cube()[0], [*cube()[1][:-1], cube()[1][-1][::-1]]),
            "3 edges with a triangle missing or turned over",
        ),
        (lambda: Mesh(np.full((8, 3), np.nan), cube()[1]), "mesh vertices: nan"),
        (lambda: Mesh(0.0 * cube()[0], cube()[1]), "mesh of volume 0.0e\\+00"),
        (lambda: Mesh(cube()[0][:3], cube()[1]), r"shape \(3, 3\), at least \(4, 3\) expected"),
        (lambda: Mesh(cube()[0], [(0, 1, 99)] * 4), "whole numbers from 0 to 7 expected"),
        (lambda: Mesh(cube()[0], "triangles"), "mesh triangles: shape"),
        (lambda: Mesh.from_file("nowhere.stl"), "no regular file"),
        (lambda: Mesh.from_file("/dev/zero"), "no regular file"),
        (lambda: Solid("", Sphere((0, 0, 0), 0.1)), "name it"),
        (lambda: Solid("needle", Sphere((0, 0, 0), 0.1)), "the name is taken"),
        (lambda: Solid("link joint1", Sphere((0, 0, 0), 0.1)), "the name is taken"),
        (lambda: Solid("aorta", "a tube"), "expected a Box or a Cylinder or a Sphere"),
        (lambda: Solid("aorta", Sphere((0, 0, 0), 8.0)), "give metres, not mm"),
        (lambda: Solid("aorta", AORTA.shape, margin=-1e-3), "expected at least 0"),
        (lambda: Solid("aorta", AORTA.shape, margin=np.nan), "a finite number"),
        (lambda: Scene([AORTA, replace(RIB, name="aorta")]), "'aorta' is given 2 times"),
        (lambda: Scene([AORTA], [replace(TABLE, name="aorta")]), "'aorta' is given 2 times"),
        (lambda: Scene([AORTA.shape]), "expected a Solid"),
        (lambda: Scene(5), "expected a Solid"),
        (lambda: aimed(replace(LIVER, enter=False)), "lies inside of liver, which the needle may"),
        (
            lambda: aimed(Solid("organ", ball(LESION, 0.02))),
            "lies inside of organ, which the needle may not enter",
        ),
        (lambda: aimed(room=[Solid("table", HalfSpace((0, 0, 2.0)))]), "lies inside of table"),
        (lambda: Aim(UR3, placed(), LESION, NEEDLE, scene=(AORTA,)), "scene: .* expected a Scene"),
    ],
)
def test_what_cannot_stand_in_a_scene_is_refused_in_one_line(make, words):
    with pytest.raises(PlumblineError, match=words) as refusal:
        make()
    assert "\n" not in str(refusal.value)


def stl(vertices, triangles):
    """A binary STL file's bytes."""
    rows = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = np.asarray(vertices)[np.asarray(triangles)]
    return b"\0" * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes()


def test_a_mesh_is_read_from_a_file_in_millimetres(tmp_path):
    corners, triangles = cube()
    file = tmp_path / "cube.stl"
    file.write_bytes(stl(1e3 * np.array(corners), triangles))
    found = Mesh.from_file(file)
    assert len(found.vertices) == 8
    assert len(found.triangles) == 12
    np.testing.assert_allclose(found.half_size, 0.01 * np.sqrt(3), rtol=1e-6)
    assert found.contains([[0.01, 0.01, 0.01], [0.03, 0.01, 0.01]]).tolist() == [True, False]


def test_a_damaged_mesh_file_is_refused_in_one_line(tmp_path):
    whole = stl(1e3 * np.array(cube()[0]), cube()[1])
    rng = np.random.default_rng(0)
    odd = [b"", b"solid x\n garbage", whole[:-30], rng.bytes(500), whole[:80] + b"\xff" * 500]
    odd += [rng.bytes(5000), b"a"]
    for k, kind in product(range(len(odd)), ("stl", "obj", "ply", "txt")):
        content, file = odd[k], tmp_path / f"{k}.{kind}"
        file.write_bytes(content)
        with pytest.raises(PlumblineError) as refusal:
            Mesh.from_file(file)
        assert "\n" not in str(refusal.value)
        assert str(tmp_path) not in str(refusal.value)
        assert re.search(r": [^;]*\w{3}[^;]*; ", str(refusal.value)), "it says why"
    large = tmp_path / "large.stl"
    with large.open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(PlumblineError, match="decimate"):
        Mesh.from_file(large)
