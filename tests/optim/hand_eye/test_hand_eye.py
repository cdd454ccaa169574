"""The closed form, the selection loop and the joint problem of Zeng et al. (2017)."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.reproduce.hand_eye_peers import METHODS, opencv_hand_eye, scipy_direct
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import Ipopt, LevenbergMarquardt, TrustRegion
from plumbline.optim.hand_eye import direct, single_plane
from plumbline.optim.hand_eye.accuracy import Marks, repeatability
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings, mean_beam, principal_plane
from plumbline.optim.hand_eye.single_plane import closed_form, select, slope
from plumbline.optim.hand_eye.three_planes import Weights, solve_three_planes, state, statement
from tests.ranging_scenes import CLEAN, PAPER, marked, surveyed, truth

POOR = replace(PAPER, poor=0.05)


def near(found, scene, distance=0.3):
    """Error of a point at some range [m]."""
    return found.error_at(truth(scene), distance)


def singles(readings):
    return [closed_form(readings.on_plane(int(k))) for k in readings.planes]


# The closed form


@pytest.mark.parametrize("plane", [1, 2, 3])
def test_the_closed_form_recovers_a_perfect_beam(plane):
    scene, _, readings = surveyed(0, CLEAN)
    found = closed_form(readings.on_plane(plane))
    assert near(found.beam, scene) < 1e-7
    assert found.length == pytest.approx(1.0, abs=1e-7)
    outward = scene.boards[plane - 1].normal
    np.testing.assert_allclose(found.normal, -outward, atol=1e-7)


@pytest.mark.parametrize("facing", [1.0, -1.0])
def test_the_sign_rules_hold(facing):
    _, _, readings = surveyed(0, CLEAN)
    readings = replace(readings, R=readings.R @ np.diag([1.0, facing, facing]))
    for k in readings.planes:
        for group in readings.on_plane(int(k)).motions():
            if group.is_translation:
                one = slope(group)
                assert one.n[2] > 0
                assert np.linalg.norm(one.n) == pytest.approx(1.0)
                np.testing.assert_allclose(one.n, -one.g * one.p, atol=1e-9)
                assert np.sign(one.p) == facing


def test_a_beam_that_looks_back_is_found_all_the_same():
    """Turning the flange's own frame about x turns r and v with it; n_z and p change sign."""
    _, _, readings = surveyed(0, CLEAN)
    back = np.diag([1.0, -1.0, -1.0])
    turned = replace(readings, R=readings.R @ back.T)
    one = closed_form(readings.on_plane(1)).beam
    other = closed_form(turned.on_plane(1)).beam
    np.testing.assert_allclose(other.r, back @ one.r, atol=1e-8)
    np.testing.assert_allclose(other.v, back @ one.v, atol=1e-8)


@settings(max_examples=10, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_the_base_frame_is_no_matter(numbers):
    _, _, readings = surveyed(0)
    turn = Rotation.from_rotvec(numbers[:3]).as_matrix()
    moved = replace(readings, R=turn @ readings.R, t=readings.t @ turn.T + numbers[3:])
    before, after = singles(readings)[0].beam, singles(moved)[0].beam
    np.testing.assert_allclose(after.r, before.r, atol=1e-9)
    np.testing.assert_allclose(after.v, before.v, atol=1e-9)


# The selection loop


def test_the_curve_falls_while_poor_readings_leave_then_rises():
    curves = []
    for seed in range(3):
        _, _, readings = surveyed(seed, POOR)
        for k in (1, 2, 3):
            found = select(readings.on_plane(k), marked(seed, POOR))
            curves.append(found.curve)
            assert found.curve[found.kept] == found.curve.min()
            assert repeatability(found.best.beam, marked(seed, POOR)) == found.curve.min()
            assert len(found.readings) == 60 - found.kept
            assert set(found.dropped[: found.kept]).isdisjoint(found.readings.row)
    first, least, last = (np.mean([f(c) for c in curves]) for f in (_first, np.min, _last))
    assert least < 0.85 * first
    assert last > 1.5 * least
    early = sum(np.isin(c.argmin(), range(1, 30)) for c in curves)
    assert early >= 5


def _first(curve):
    return curve[0]


def _last(curve):
    return curve[-1]


def test_what_is_dropped_first_is_what_was_spoilt():
    _, survey, readings = surveyed(1, POOR)
    named = [select(readings.on_plane(k), marked(1, POOR)).dropped[:4] for k in (1, 2, 3)]
    hits = np.isin(np.concatenate(named), survey.gross).sum()
    assert hits >= 5


def test_repeatability_of_a_perfect_beam_is_nothing():
    scene, _, _ = surveyed(0, CLEAN)
    assert repeatability(truth(scene), marked(0, CLEAN)) < 1e-9


def test_repeatability_is_the_mean_of_the_marks_deviations():
    R = np.tile(np.eye(3), (4, 1, 1))
    t = np.array([[0.0, 0, 0], [0, 0, 2], [0, 0, 0], [4, 0, 0]])
    marks = Marks(R, t, np.ones(4), np.array([7, 7, 9, 9]))
    beam = Beam.of(np.zeros(3), [0.0, 0.0, 1.0])
    assert repeatability(beam, marks) == pytest.approx((np.sqrt(2.0) + np.sqrt(8.0)) / 2)
    np.testing.assert_allclose(marks.means(beam), [[0, 0, 2], [2, 0, 1]])


def test_a_mark_seen_once_is_refused():
    with pytest.raises(PlumblineError, match="mark 3 in 1 reading, 2 readings or more expected"):
        Marks(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), np.ones(3), np.array([1, 1, 3]))


# Three planes


@pytest.mark.parametrize("solver", [LevenbergMarquardt(), TrustRegion(), Ipopt()], ids=str)
def test_three_planes_recover_a_perfect_beam_by_every_solver(solver):
    scene, _, readings = surveyed(0, CLEAN)
    start = singles(readings)
    start[0] = replace(start[0], beam=Beam.of(truth(scene).r + 2e-3, truth(scene).v + 5e-3))
    found = solve_three_planes(readings, start, solver=solver)
    assert near(found.beam, scene) < 1e-6
    assert found.solution.cost < 1e-6  # both terms vanish
    for plane, board in zip(found.planes, scene.boards, strict=True):
        np.testing.assert_allclose(plane.normal, -board.normal, atol=1e-6)


def test_the_normals_look_ahead():
    _, _, readings = surveyed(1)
    found = solve_three_planes(readings, singles(readings), solver=Ipopt())
    for plane, k in zip(found.planes, readings.planes, strict=True):
        first = readings.on_plane(int(k)).R[0]
        assert (first.T @ plane.normal)[2] > 0
    assert found.beam.v[2] > 0
    assert np.linalg.norm(found.beam.v) == pytest.approx(1.0)


def test_the_penalty_is_the_distance_from_the_principal_plane():
    """At the optimum the unknown plane m is PCA's own, as eq. 17 has it."""
    _, _, readings = surveyed(2)
    found = solve_three_planes(readings, singles(readings), Weights(1.0, 1.0))
    points = found.beam.points(readings.R, readings.t, readings.distance)
    squares = []
    for plane, k in zip(found.planes, readings.planes, strict=True):
        own = points[readings.plane == k]
        pca = principal_plane(own)
        assert plane.angle_to(pca) < 1e-5
        squares.append(1e6 * np.sum(pca.distances(own) ** 2))
    heights = found.solution.mapped.residuals(found.solution.x)[9:, 0]
    assert np.sum(heights**2) == pytest.approx(sum(squares), rel=1e-4)


def test_with_beta_alone_it_is_least_squares_on_eq_5():
    _, _, readings = surveyed(1)
    start = singles(readings)
    found = solve_three_planes(readings, start, Weights(0.0, 1.0))
    other = scipy_direct(readings, mean_beam([s.beam for s in start]))
    np.testing.assert_allclose(found.beam.r, other.r, atol=2e-7)
    np.testing.assert_allclose(found.beam.v, other.v, atol=2e-7)


def test_the_statement_s_derivatives_are_those_of_finite_differences():
    _, _, readings = surveyed(1)
    start = singles(readings)
    beam = mean_beam([s.beam for s in start])
    frames = Frames.of(readings, beam)
    problem = state(readings, frames, Weights(2.0, 3.0))
    x = direct.start(statement(3), beam, frames) + 1e-3
    _, _, J = next(Mapped(problem).jacobians(x))
    for i in range(problem.size):
        step = np.zeros(problem.size)
        step[i] = 1e-6
        ahead, back = (Mapped(problem).residuals(x + s) for s in (step, -step))
        np.testing.assert_allclose(J[:, :, i], (ahead - back) / 2e-6, rtol=1e-5, atol=1e-4)


def test_the_joint_result_beats_one_plane():
    single, joint = [], []
    for seed in range(4):
        scene, _, readings = surveyed(seed)
        found = singles(readings)
        single += [near(f.beam, scene) for f in found]
        joint.append(near(solve_three_planes(readings, found).beam, scene))
    assert np.mean(joint) < 0.6 * np.mean(single)


def test_relabelled_planes_give_the_same_beam():
    _, _, readings = surveyed(1)
    other = replace(readings, plane=10 - readings.plane, motion=readings.motion * 7 - 20)
    one = solve_three_planes(readings, singles(readings)).beam
    two = solve_three_planes(other, singles(other)).beam
    np.testing.assert_allclose(two.r, one.r, atol=1e-7)


# Degenerate motions


def still(readings, plane=1, motion=1):
    rows = (readings.plane == plane) & (readings.motion == motion)
    return readings.select(rows)


def test_translations_within_a_plane_are_named():
    _, _, readings = surveyed(0, CLEAN)
    one = still(readings)
    flat = one.t - one.t[0]
    flat = one.t[0] + flat - np.outer(flat @ one.R[0][:, 2], one.R[0][:, 2])
    with pytest.raises(PlumblineError, match="translations within a plane"):
        slope(replace(one, t=flat))


def test_groups_without_rotation_are_named():
    _, _, readings = surveyed(0, CLEAN)
    one = readings.on_plane(1)
    one = replace(one, R=np.tile(one.R[0], (60, 1, 1)))
    with pytest.raises(PlumblineError, match="no rotation between the groups"):
        closed_form(one)


def test_too_few_groups_are_named():
    _, _, readings = surveyed(0, CLEAN)
    one = readings.on_plane(1)
    with pytest.raises(PlumblineError, match="2 groups of pure translations, at least 3"):
        closed_form(one.select(one.motion != 2))


def test_turning_about_the_normal_alone_is_named():
    scene, _, readings = surveyed(0, CLEAN)
    one = readings.on_plane(1)
    turned = one.motion == 4
    normal = scene.boards[0].normal
    R = one.R.copy()
    spins = Rotation.from_rotvec(np.linspace(0, 2, 15)[:, None] * normal).as_matrix()
    R[turned] = spins @ one.R[0]
    with pytest.raises(PlumblineError, match="no rotation that shows r"):
        closed_form(replace(one, R=R))


def test_parallel_planes_are_named():
    _, _, readings = surveyed(0)
    same = replace(readings.on_plane(1), plane=np.where(np.arange(60) % 15 < 8, 1, 2))
    start = [closed_form(readings.on_plane(1))]
    with pytest.raises(PlumblineError, match="planes 1 and 2 are parallel within"):
        solve_three_planes(same, start)


# What is given


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: {"distance": r.distance * 1e3}, "looks like millimetres"),
        (lambda r: {"t": r.t * 1e3}, "looks like millimetres"),
        (lambda r: {"distance": np.where(np.arange(180) == 7, np.nan, r.distance)}, "row 7"),
        (lambda r: {"t": r.t * np.where(np.arange(180) == 3, np.inf, 1)[:, None]}, "row 3"),
        (lambda r: {"R": 1.01 * r.R}, "no rotation matrix"),
        (lambda r: {"distance": r.distance[:5]}, "expected"),
        (lambda r: {"distance": -r.distance}, "more than 0"),
    ],
)
def test_what_cannot_be_readings_is_refused_in_one_line(change, words):
    _, _, r = surveyed(0)
    given = {"R": r.R, "t": r.t, "distance": r.distance, **change(r)}
    with pytest.raises(PlumblineError, match=words) as caught:
        Readings.from_arrays(**given)
    assert len(str(caught.value).splitlines()) == 1


def test_too_few_readings_are_refused():
    _, _, r = surveyed(0)
    with pytest.raises(PlumblineError, match="5 readings, at least 8 expected"):
        Readings.from_arrays(r.R[:5], r.t[:5], r.distance[:5])


# A camera in its place


@pytest.mark.parametrize("method", METHODS)
def test_opencv_finds_a_camera_on_the_same_motions(method):
    pytest.importorskip("cv2")
    from plumbline.experiments.reality.ranging.phantoms import camera_place, target_poses

    scene, survey, _ = surveyed(0)
    poses = target_poses(scene, survey.q[survey.plane == 1], 1, np.random.default_rng(0))
    found = opencv_hand_eye(*poses, method=method)
    gap = np.linalg.norm(found[:3, 3] - camera_place(scene)[:3, 3])
    assert gap < 3e-3
    with pytest.raises(PlumblineError, match="one of tsai"):
        opencv_hand_eye(*poses, method="magic")


# One statement, many data


def test_a_statement_is_compiled_once_for_all_its_data():
    _, _, readings = surveyed(1)
    beam = mean_beam([s.beam for s in singles(readings)])
    frames = Frames.of(readings, beam)
    one, two = (state(readings, frames, Weights(1.0, b)) for b in (1.0, 2.0))
    assert Mapped(one)._compiled is Mapped(two)._compiled
    other = replace(one, residual=2 * one.residual)
    assert Mapped(other)._compiled is not Mapped(one)._compiled
    x = direct.start(statement(3), beam, frames)
    np.testing.assert_allclose(Mapped(other).residuals(x), 2 * Mapped(one).residuals(x))


def test_the_closed_form_s_equations_are_those_of_the_statement():
    """Eqs. 13 and 15 as differences of the direct statement's own residuals."""
    scene, _, readings = surveyed(1)
    one = readings.on_plane(1)
    beam, frames = truth(scene), Frames.of(one, truth(scene))
    problem = direct.state(one, frames)
    e = Mapped(problem).residuals(direct.start(problem, beam, frames))[:, 0]
    n = frames.B[0, :, 2]
    at = one.rows
    given = np.tile(np.concatenate([n, beam.v]), (59, 1))
    rows = np.hstack([given, at[1:], np.tile(at[0], (59, 1))])
    A, b = single_plane.system(single_plane.rotation(), rows)
    np.testing.assert_allclose(A @ beam.r - b, e[1:] - e[0], atol=1e-12)
    still = one.select(one.motion == 1)
    moves = (still.t[1:] - still.t[0]) @ still.R[0]
    table = np.column_stack([moves, still.distance[1:] - still.distance[0]])
    A, b = single_plane.system(single_plane.translation(), table)
    u = still.R[0].T @ n
    of_group = e[one.motion == 1]
    p = u @ beam.v
    np.testing.assert_allclose(p * (A @ (u / p) - b), of_group[1:] - of_group[0], atol=1e-12)


def test_the_selection_asks_the_statement_alone(monkeypatch):
    """With another statement there is another answer: nothing is computed beside it."""
    _, _, readings = surveyed(1)
    before = closed_form(readings.on_plane(1)).beam
    for name in ("translation", "component", "rotation"):
        own = getattr(single_plane, name)()
        row = cs.SX.sym("row", own.size1_in(0))
        matrix, value = own(row)
        other = cs.Function("other", [row], [matrix, cs.densify(value + 1e-3)])
        with monkeypatch.context() as patched:
            patched.setattr(single_plane, name, lambda other=other: other)
            after = closed_form(readings.on_plane(1)).beam
        assert np.linalg.norm(after.r - before.r) + np.linalg.norm(after.v - before.v) > 1e-5
