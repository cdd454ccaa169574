"""Each threshold of the hand-eye and the scan holds between 3/4 and 3/2 of its own figure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from plumbline.optim.hand_eye import answer, calibrate, scan, start, surface
from plumbline.optim.hand_eye import single_plane as closed
from plumbline.optim.hand_eye.accuracy import leave_one_out
from plumbline.optim.hand_eye.calibrate import HandEyeOptions
from plumbline.optim.hand_eye.constants import (
    BIAS_STD,
    CAUCHY,
    GROSS,
    SAMPLE,
    SURFACE_POINTS,
    THREES,
    TRIALS,
)
from plumbline.optim.hand_eye.design import candidates
from plumbline.optim.hand_eye.observability import (
    Direction,
    open_words,
    patch_words,
    refuse_degenerate,
    turn_words,
)
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings
from plumbline.optim.hand_eye.recording import _check_angles
from plumbline.optim.hand_eye.reweighting import Variance, _robust_sigma, fit_variance
from plumbline.optim.hand_eye.scan_recording import _faces, _landmarks, surface_points
from plumbline.optim.hand_eye.shapes import arm_shapes, shapes
from plumbline.optim.hand_eye.start import _is_sure
from plumbline.optim.hand_eye.three_planes import parallel_planes
from plumbline.optim.recording.table import read_table
from tests.ranging_scenes import surveyed
from tests.refusals import is_refused as refused

AHEAD = Beam.of([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def at(t, turns=None, distance=1.0, plane=1):
    """Readings from positions (N, 3), with turns (N, 3) [rad]."""
    t = np.asarray(t, dtype=float)
    n = len(t)
    R = np.tile(np.eye(3), (n, 1, 1)) if turns is None else Rotation.from_rotvec(turns).as_matrix()
    whole = np.ones(n, dtype=np.int64)
    return Readings(R, t, np.full(n, distance), plane * whole, whole, np.arange(n))


def spread(n=30, *sizes):
    """Positions (n, 3) of standard deviations as given, uncorrelated."""
    x = np.random.default_rng(0).normal(size=(n, 3))
    x -= x.mean(axis=0)
    return np.linalg.svd(x, full_matrices=False)[0] * np.sqrt(n) * sizes


# What is a reading


@pytest.mark.parametrize(("size", "wrong"), [(15.0, False), (30.0, True)])
def test_ranges_beyond_twenty_metres_are_millimetres(size, wrong):
    r = at(spread(8, 1, 1, 1), distance=size)
    assert refused(Readings.from_arrays, r.R, r.t, r.distance, match="millimetres") is wrong


@pytest.mark.parametrize(("bias", "wrong"), [(0.075, False), (0.15, True)])
def test_a_bias_of_a_tenth_of_a_metre_is_none(bias, wrong):
    assert refused(lambda: HandEyeOptions(bias=bias)) is wrong


@pytest.mark.parametrize(("angle", "wrong"), [(9.0, False), (18.0, True)])
def test_an_angle_beyond_two_turns_is_in_degrees(angle, wrong):
    table = read_table("samples.csv", f"q1\n{angle}\n".encode())
    chain = SimpleNamespace(turning=np.array([True]))
    given = (table, ("q1",), np.array([[angle]]), chain)
    assert refused(_check_angles, *given, match="degrees") is wrong


@pytest.mark.parametrize(("turn", "same"), [(1.5e-3, True), (3e-3, False)])
def test_orientations_agree_within_two_milliradians(turn, same):
    assert at(np.zeros((2, 3)), [[0, 0, 0], [turn, 0, 0]]).is_translation is same


@pytest.mark.parametrize(("apart", "poses"), [(0.4e-6, 1), (0.8e-6, 2)])
def test_poses_a_micrometre_apart_are_two(apart, poses):
    assert at([[0, 0, 0], [apart, 0, 0]]).distinct == poses


@pytest.mark.parametrize(("skew", "wrong"), [(0.75e-4, False), (1.5e-4, True)])
def test_a_rotation_is_one_to_four_digits(skew, wrong):
    r = at(spread(8, 1, 1, 1))
    R = r.R * np.sqrt(1.0 + skew)
    assert refused(Readings.from_arrays, R, r.t, r.distance, match="no rotation") is wrong


@pytest.mark.parametrize(("rows", "wrong"), [(7, True), (8, False)])
def test_eight_unknowns_take_eight_readings(rows, wrong):
    r = at(spread(rows, 1, 1, 1))
    assert refused(Readings.from_arrays, r.R, r.t, r.distance, match="at least 8") is wrong


@pytest.mark.parametrize(("rows", "wrong"), [(15, True), (16, False)])
def test_eight_readings_more_judge_a_calibration(rows, wrong):
    given = at(spread(rows, 1, 1, 1))
    assert refused(calibrate._check_count, given, match="at least 16") is wrong


@pytest.mark.parametrize(("rows", "wrong"), [(2, True), (3, False)])
def test_a_plane_takes_three_usable_readings(rows, wrong):
    r = at(spread(10, 1, 1, 1))
    kept = r.select(np.arange(10) < rows)
    assert refused(calibrate._check_planes, kept, r, match="at least 3") is wrong


@pytest.mark.parametrize(("rows", "wrong"), [(3, True), (4, False)])
def test_a_face_takes_four_readings(rows, wrong):
    cells = "\n".join(["face", *["a"] * 8, *["b"] * rows]) + "\n"
    table = read_table("samples.csv", cells.encode())
    assert refused(_faces, table, match="4 readings or more") is wrong


# The closed form


@pytest.mark.parametrize(("share", "wrong"), [(0.75e-3, True), (1.5e-3, False)])
def test_translations_flat_to_a_thousandth_lack_a_direction(share, wrong):
    moves = np.diag([1.0, 1.0, share])
    r = at(np.vstack([np.zeros(3), moves, -moves]))
    given = replace(r, distance=1.0 - r.t @ [0.6, 0.0, 0.8])
    assert refused(closed.slope, given, match="three directions") is wrong


@pytest.mark.parametrize(("share", "wrong"), [(0.75e-3, True), (1.5e-3, False)])
def test_normals_alike_to_a_thousandth_leave_v_open(share, wrong):
    normals = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rows = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    N = rows @ np.diag([1.0, 1.0, share]) @ normals
    slopes = [closed.Slope(np.eye(3), n, n, float(n @ [0, 0, 1])) for n in N]
    assert refused(closed._direction, slopes, match="no rotation between") is wrong


@pytest.mark.parametrize(("rows", "wrong"), [(3, True), (4, False)])
def test_three_translations_take_four_readings(rows, wrong):
    t = np.vstack([np.zeros(3), np.eye(3)])[:rows]
    given = replace(at(t), distance=1.0 - t @ [0.6, 0.0, 0.8])
    assert refused(closed.slope, given, match="at least 4") is wrong


@pytest.mark.parametrize(("count", "wrong"), [(2, True), (3, False)])
def test_a_direction_takes_three_orientations(count, wrong):
    slopes = [closed.Slope(np.eye(3), n, n, n[2] + 0.1) for n in np.eye(3)[:count]]
    assert refused(closed._direction, slopes, match="groups of pure") is wrong


@pytest.mark.parametrize(("angle", "alike"), [(3.75, True), (7.5, False)])
def test_planes_within_five_degrees_are_parallel(angle, alike):
    B = np.stack([np.eye(3), Rotation.from_rotvec([np.deg2rad(angle), 0, 0]).as_matrix()])
    assert bool(parallel_planes(Frames(B, np.zeros((2, 3)), np.eye(3)))) is alike


# The robust fit


def test_cauchy_s_loss_is_95_percent_efficient_on_normal_errors():
    e = np.linspace(-9.0, 9.0, 20_001)
    p = norm.pdf(e) * (e[1] - e[0])
    u = (e / CAUCHY) ** 2
    slope = np.sum(p * (1.0 - u) / (1.0 + u) ** 2)
    assert slope**2 / np.sum(p * (e / (1.0 + u)) ** 2) == pytest.approx(0.95, abs=1e-3)


def test_the_robust_scatter_of_normal_errors_is_theirs():
    e = norm.ppf((np.arange(4000) + 0.5) / 4000)
    assert _robust_sigma(e, 0) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("sigma", "far", "share", "sure"),
    [
        (0.375e-3, 9.0, 0.15, True), (0.75e-3, 9.0, 0.15, False), (0.4e-3, 9.0, 0.3, False),
        (0.4e-3, 3.4, 0.3, True), (0.4e-3, 6.7, 0.3, False),
    ],
)  # fmt: skip
def test_a_start_is_sure_with_little_scatter_and_few_readings_beyond(sigma, far, share, sure):
    errors = np.where(np.arange(100) < 100 * share, far * sigma, 0.0)
    assert _is_sure((AHEAD, sigma, errors)) is sure


def test_samples_are_so_many_that_a_clean_one_is_among_them():
    none_clean = (1.0 - 0.8**SAMPLE) ** TRIALS
    assert 1e-7 < none_clean < 1e-5
    assert 1e-18 < (1.0 - 0.5**3) ** THREES < 1e-17


@pytest.mark.parametrize(("sigma", "wrong"), [(15e-3, False), (30e-3, True)])
def test_a_scatter_of_two_centimetres_is_of_other_rows(monkeypatch, sigma, wrong):
    monkeypatch.setattr(start, "robust_start", lambda *_, **__: (AHEAD, sigma, None))
    given = (at(spread(9, 1, 1, 1)), sigma)
    assert refused(start.refuse_misread, *given, match="at most 20 mm") is wrong


@pytest.mark.parametrize(
    ("sigma", "other", "wrong"),
    [(0.75e-3, 1e-9, False), (1.5e-3, 1e-9, True), (0.01, 1.5e-3, True), (0.01, 3e-3, False)],
)
def test_poses_are_misread_where_another_way_leaves_a_fifth(monkeypatch, sigma, other, wrong):
    monkeypatch.setattr(start, "robust_start", lambda *_, **__: (AHEAD, other, None))
    assert refused(start.refuse_misread, at(spread(9, 1, 1, 1)), sigma) is wrong


# Statement and variances


def test_one_good_reading_of_150000_is_called_gross():
    assert 2.0 * norm.sf(GROSS) == pytest.approx(1.0 / 150_000, rel=0.1)
    assert HandEyeOptions().gross == GROSS


def test_a_bias_of_a_quarter_of_the_spot_is_60_micrometres_at_30_degrees():
    assert BIAS_STD * (1.0 / np.cos(np.deg2rad(30.0)) - 1.0) == pytest.approx(0.06e-3, rel=0.05)


@pytest.mark.parametrize(("error", "gross"), [(0.87, False), (1.23, True)])
def test_a_reading_that_its_fit_takes_up_whole_is_judged_by_a_twentieth(error, gross):
    fit = SimpleNamespace(
        leverage=np.ones(1), errors=np.array([error]), variance=Variance(1.0, 0.0)
    )
    assert calibrate._gross(fit, np.zeros(1), 4.5)[0] == gross


@pytest.mark.parametrize(("rows", "bowed"), [(19, False), (20, True)])
def test_twenty_readings_show_a_bow(rows, bowed):
    readings = at(spread(rows, 0.2, 0.2, 0.0))
    frames = Frames(np.eye(3)[None], np.zeros((1, 3)), np.eye(3))
    assert shapes(readings, frames, readings.t, 4).any() == bowed


def test_four_readings_pay_for_a_shape_of_the_arm():
    readings = at(spread(40, 0.2, 0.2, 0.2), spread(40, 0.3, 0.3, 0.3))
    frames = Frames(np.eye(3)[None], np.zeros((1, 3)), np.eye(3))
    assert arm_shapes(readings, frames, readings.t, 48).shape == (40, 10 + 5)


def test_a_variance_never_falls_below_a_twentieth():
    assert Variance(1.0, -2.0).at(np.array([np.pi / 2]))[0] == 0.05


@pytest.mark.parametrize(("slant", "told"), [(0.75e-3, False), (1.5e-3, True)])
def test_a_variance_s_slope_takes_slant(slant, told):
    incidence = np.arcsin(np.sqrt(np.linspace(0.0, slant, 40)))
    found = fit_variance(np.linspace(0.2, 5.0, 40), incidence)
    assert bool(found.slant) is told


def test_a_slope_is_told_where_the_readings_show_it_and_not_by_their_noise():
    rng, incidence = np.random.default_rng(1), np.linspace(0.0, 0.6, 40)
    even = [fit_variance(rng.standard_normal(40) ** 2, incidence).slant for _ in range(200)]
    grown = 1.0 + 24.0 * np.sin(incidence) ** 2 / np.sin(0.6) ** 2
    steep = [fit_variance(grown * rng.standard_normal(40) ** 2, incidence) for _ in range(200)]
    assert np.count_nonzero(even) < 0.1 * 200
    assert sum(found.slant > 0.0 for found in steep) > 0.9 * 200


# What is said and refused


@pytest.mark.parametrize(
    ("unit", "std", "poor", "lost"),
    [
        ("m", 0.375e-3, False, False), ("m", 0.75e-3, True, False), ("m", 15e-3, True, False),
        ("m", 30e-3, True, True), ("rad", 1.5e-3, False, False), ("rad", 3e-3, True, False),
        ("rad", 37e-3, True, False), ("rad", 75e-3, True, True),
    ],
)  # fmt: skip
def test_a_direction_is_poor_and_then_lost(unit, std, poor, lost):
    found = Direction("r along the beam", std, unit)
    assert (found.poor, found.lost) == (poor, lost)


@pytest.mark.parametrize(("std", "said"), [(0.75, "standard error 750 mm"), (1.5, "infinite")])
def test_an_error_beyond_a_metre_is_infinite(std, said):
    assert said in open_words(np.diag([0, 0, std**2, 0, 0, 0]), AHEAD)


@pytest.mark.parametrize(("angle", "along"), [(15.0, True), (27.0, False)])
def test_an_axis_within_20_degrees_of_the_beam_is_along_it(angle, along):
    axis = np.array([np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.outer(axis, axis)
    assert ("r along the beam" in open_words(covariance, AHEAD)) is along


@pytest.mark.parametrize(
    ("wide", "narrow", "said"),
    [(0.011, 0.001, "one patch"), (0.0225, 0.02, ""), (0.1, 0.0037, "one line"), (0.1, 0.0075, "")],
)
def test_points_are_a_patch_or_a_line_within_hundredths_of_the_range(wide, narrow, said):
    found = patch_words(at(spread(30, wide, narrow, 0.0)), AHEAD)
    assert [said in line for line in found] == [True] * bool(said)


@pytest.mark.parametrize(("turn", "wrong"), [(7.5e-3, True), (15e-3, False)])
def test_a_turn_of_a_hundredth_of_a_radian_is_a_rotation(turn, wrong):
    r = at(np.zeros((9, 3)), np.linspace(0, 1, 9)[:, None] * [[turn, 0, 0]])
    assert refused(refuse_degenerate, r, match="no rotation") is wrong


@pytest.mark.parametrize(
    ("one", "two", "said"),
    [(3.7e-3, 0.0, "agree within"), (0.4, 0.4 * 0.015, "alone"), (0.4, 0.4 * 0.03, ""),
     (7.5e-3, 7.4e-3, "")],
)  # fmt: skip
def test_turns_show_r_about_two_axes(one, two, said):
    rng = np.random.default_rng(2)
    turns = rng.choice([-1.0, 1.0], (60, 2)) * [[one, two]]
    turns = np.column_stack([turns, np.zeros(60)])
    turns[0] = 0.0
    found = turn_words(at(np.zeros((60, 3)), turns))
    assert said in found if said else not found


@pytest.mark.parametrize(
    ("rows", "gross", "said"), [(40, 6, ""), (40, 12, "many"), (16, 0, ""), (15, 0, "are few")]
)
def test_many_gross_and_few_readings_are_said(rows, gross, said):
    notes = calibrate._notes(at(spread(rows, 1, 1, 1)), np.arange(gross))
    assert [said in note for note in notes[1:]] == [True] * bool(said)


@pytest.mark.parametrize(
    ("stated", "said"),
    [(0.67e-3, ""), (0.34e-3, "look at"), (3.7e-3, ""), (7.5e-3, "one sigma in m")],
)
def test_a_stated_noise_is_doubted_at_half_and_at_five_times_the_scatter(monkeypatch, stated, said):
    monkeypatch.setattr(answer, "incidence", lambda *_: np.zeros(1))
    c = SimpleNamespace(variance=Variance(1e-6), readings=None, beam=None, planes=None)
    notes = answer._noise_notes(c, stated)
    assert [said in note for note in notes] == [True] * bool(said)


# Next poses


@pytest.mark.parametrize(("poses", "wrong"), [(50, False), (51, True)])
def test_fifty_next_poses_are_the_most(poses, wrong):
    assert HandEyeOptions().poses == 5
    assert refused(lambda: HandEyeOptions(poses=poses)) is wrong


def test_candidates_tilt_by_60_degrees_and_meet_boards_at_30_in_any_case():
    readings = surveyed(0)[2]
    c = calibrate.calibrate(readings)
    steep = replace(c, incidence=np.full_like(c.incidence, np.pi / 2))
    found, source = candidates(steep, np.random.default_rng(0))
    between = np.swapaxes(c.readings.R[source], 1, 2) @ found.R
    largest = np.rad2deg(np.linalg.norm(Rotation.from_matrix(between).as_rotvec(), axis=1)).max()
    assert 45.0 < largest <= 60.0
    straight, _ = candidates(replace(c, incidence=np.zeros(1)), np.random.default_rng(0))
    index = np.searchsorted(c.readings.planes, straight.plane)
    cosine = np.sum((straight.R @ c.beam.v) * c.frames.B[index, :, 2], axis=1)
    assert 22.0 < np.rad2deg(np.arccos(cosine)).max() <= 30.0


# Scan and surface


@pytest.mark.parametrize(
    ("rows", "noise", "off", "left"),
    [(9, 0.0, 5e-3, 0), (10, 0.0, 5e-3, 1), (30, 0.0, 0.37e-3, 0), (30, 0.0, 0.75e-3, 1),
     (200, 1e-3, 4.5e-3, 0), (200, 1e-3, 9e-3, 1)],
)  # fmt: skip
def test_a_face_s_reading_is_gross_beyond_six_sigmas_and_half_a_millimetre(rows, noise, off, left):
    points = np.random.default_rng(3).normal(size=(rows, 3)) * [0.05, 0.05, 0.0]
    points[:, 2] = noise * norm.ppf((np.arange(rows) + 0.5) / rows).clip(-2.0, 2.0)
    points[rows // 2, 2] = off
    assert rows - len(scan._good(points, np.arange(rows))) == left


@pytest.mark.parametrize(("sine", "lever"), [(1.5e-3, 1.0), (0.75e-3, 0.75)])
def test_faces_nearer_to_parallel_than_a_thousandth_have_no_larger_error(sine, lever):
    def face(normal, first):
        axes = np.array([first, np.cross(normal, first)])
        return scan._Face(normal, axes, np.ones(2), 1.0)

    flat = face(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    cosine = np.sqrt(1.0 - sine**2)
    tilted = face(np.array([sine, 0.0, cosine]), np.array([cosine, 0.0, -sine]))
    assert scan._own_variance(flat, tilted) == pytest.approx(2.0 * lever**2, rel=1e-6)


@pytest.mark.parametrize(("times", "wrong"), [(0.75, False), (1.5, True)])
def test_a_surface_fixes_a_scan_to_a_centimetre(monkeypatch, times, wrong):
    rng = np.random.default_rng(4)
    points, normals = rng.normal(size=(2, 300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centred = points - points.mean(axis=0)
    reach = np.linalg.norm(centred, axis=1).max()
    A = np.hstack([np.cross(centred, normals) / reach, normals])
    each = 0.01 * np.linalg.svd(A, compute_uv=False)[-1] * np.sqrt(294 / 300)
    fit = SimpleNamespace(
        T=np.eye(4), normals=normals, distances=np.full(300, times * each), judged=None
    )
    monkeypatch.setattr(scan, "register_surface", lambda *_: fit)
    monkeypatch.setattr(scan, "open_motions", lambda *_: ())
    r = SimpleNamespace(
        surface=points, landmarks=None, R=np.tile(np.eye(3), (300, 1, 1)),
        distance=np.ones(300), targets=np.empty((0, 3)),
    )  # fmt: skip
    assert refused(scan._laid, r, points, np.zeros((6, 6)), match="at most 10 mm") is wrong


def grid(spacing=2e-3, half=20):
    """Points of a plane (M, 3) [m]."""
    ways = spacing * np.arange(-half, half + 1)
    x, y = (c.ravel() for c in np.meshgrid(ways, ways))
    return np.column_stack([x, y, np.zeros(len(x))])


@pytest.mark.parametrize(("matched", "wrong"), [(37, True), (75, False)])
def test_half_of_a_scan_finds_the_surface(monkeypatch, matched, wrong):
    reached, settled = [], surface._settled

    def watched(T, scan, target, reach):
        reached.append(reach)
        return settled(T, scan, target, reach)

    monkeypatch.setattr(surface, "_settled", watched)
    points = grid(half=10)[:100]
    scan = points + np.where(np.arange(100) < matched, 0.0, 0.5)[:, None]
    assert refused(surface.register_surface, scan, points, match="half of them") is wrong
    assert reached == ([20e-3] if wrong else [20e-3, 3e-3])


@pytest.mark.parametrize(
    ("place", "counted"),
    [
        ((0.0, 0.0, 2.9e-3), True),
        ((0.0, 0.0, 3.1e-3), False),
        ((0.04 + 3e-3 + 5.9e-3, 0.0, 0.0), True),
        ((0.04 + 3e-3 + 6.1e-3, 0.0, 0.0), False),
    ],
)
def test_a_point_counts_within_reach_and_three_spacings_of_the_surface(place, counted):
    target = surface.Surface.of(grid())
    assert target.spacing == pytest.approx(2e-3)
    assert (len(surface._rows(np.array([place]), target, 3e-3)[1]) == 1) is counted


def test_a_surface_s_step_is_damped_by_a_millionth_of_the_curvature():
    rng = np.random.default_rng(3)
    J, d = np.linalg.qr(rng.normal(size=(50, 6)))[0], rng.normal(size=50)
    plain = np.linalg.lstsq(J, -d, rcond=None)[0]
    np.testing.assert_allclose(surface._step(J, d) / plain, 1.0 - 3e-6, rtol=0, atol=1e-8)
    flat = J * [1.0, 1.0, 0.0, 0.0, 0.0, 1.0]  # turns and slides that the surface does not show
    assert (surface._step(flat, d)[2:5] == 0.0).all()


@pytest.mark.parametrize(("step", "steps"), [(0.9e-9, 1), (1.1e-9, 60)])
def test_a_surface_s_fit_rests_at_a_billionth(monkeypatch, step, steps):
    made = []
    monkeypatch.setattr(surface, "_step", lambda *_: made.append(1) or np.full(6, step))
    surface._settled(np.eye(4), grid(half=3), surface.Surface.of(grid(half=3)), 20e-3)
    assert len(made) == steps


def test_points_of_a_head_lie_two_millimetres_apart():
    assert np.sqrt(0.15 / SURFACE_POINTS) == pytest.approx(2e-3, rel=0.15)


@pytest.mark.parametrize(
    ("count", "size", "said"),
    [(75, 1.0, "100 or more"), (150, 2.2, ""), (150, 4.5, "millimetres")],
)
def test_a_surface_has_a_hundred_points_within_three_metres(tmp_path, count, size, said):
    points = np.linspace(0.0, size, count)[:, None] * [[1.0, 0.0, 0.0]]
    lines = ["x,y,z", *(",".join(map(str, p)) for p in points)]
    (tmp_path / "surface.csv").write_text("\n".join(lines) + "\n")
    assert refused(surface_points, tmp_path, 1.0, match=said) is bool(said)


@pytest.mark.parametrize(("count", "wrong"), [(3, True), (4, False)])
def test_leaving_one_out_takes_four_points(count, wrong):
    points = np.random.default_rng(6).normal(size=(count, 3))
    assert refused(leave_one_out, points, points, match="n >= 4") is wrong


@pytest.mark.parametrize(("count", "wrong"), [(2, True), (3, False)])
def test_landmarks_are_three(tmp_path, count, wrong):
    head = "base_x,base_y,base_z,ct_x,ct_y,ct_z"
    rows = [",".join(map(str, np.arange(6.0) + k)) for k in range(count)]
    (tmp_path / "landmarks.csv").write_text("\n".join([head, *rows]) + "\n")
    assert refused(_landmarks, tmp_path, match="3 or more") is wrong
