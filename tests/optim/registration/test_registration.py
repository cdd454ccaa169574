"""Markers in two frames give one transform, by every method; what gives none is refused."""

import timeit
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import permutations, product

import casadi as cs
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import Transform
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.solvers import ALL
from plumbline.optim.registration import (
    METHODS,
    Anisotropic,
    BestTriple,
    Kabsch,
    MarkerNoise,
    Robust,
    ThreePoint,
    build_fiducials,
    localisation,
    rank_triples,
    register,
    three_point,
)
from plumbline.optim.registration.checks import condition_of
from plumbline.optim.registration.constants import ALPHA, LEAST_HELD
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.robust import _holds
from plumbline.optim.registration.statement import problem
from plumbline.optim.registration.triples import three_point_batch
from tests.phantoms import (
    ALIKE,
    COLLINEAR,
    CT,
    FIVE,
    FOUR,
    LABELS,
    LESION,
    NOISE,
    T_RC,
    TRIPLE,
    draws,
    labels,
    mapped,
    readings,
    registered,
    rigid,
)

statement_of_three = import_module(
    "plumbline.optim.registration.triples"
)  # the function has its name
SYMMETRIC = [m for m in METHODS.values() if m.name != "three-point"]  # the order does not matter
by_name = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
any_seed = st.integers(0, 10_000)


def turned(noise, T_ct, T_robot):
    """Noise along the axes of other frames."""
    C, R = T_ct[:3, :3], T_robot[:3, :3]
    return MarkerNoise(C @ noise.ct @ C.T, R @ noise.robot @ R.T, noise.freedoms)


@by_name
@pytest.mark.parametrize("which", [TRIPLE, FOUR, FIVE], ids=len)
def test_exact_markers_give_the_exact_transform(method, which):
    answer = registered(method, CT[list(which)], mapped(CT[list(which)]), NOISE, labels(which))
    assert np.allclose(answer.T_RC, T_RC, atol=1e-9)
    assert answer.fre < 1e-9
    assert np.allclose(answer.map(LESION), mapped(LESION), atol=1e-9)
    assert np.allclose(answer.T_CR @ answer.T_RC, np.eye(4), atol=1e-12)
    assert not answer.shifted


def test_the_three_point_frame_is_built_on_the_markers():
    ct, robot = readings(TRIPLE)
    f_R, T = (v.full() for v in localisation()(ct.T, robot.T, LESION))
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(f_R.ravel(), mapped(LESION, T))
    assert np.allclose(mapped(ct[0], T), robot[0], atol=1e-12)  # the first marker is the origin
    along, image = robot[1] - robot[0], mapped(ct, T) - robot[0]
    assert np.linalg.norm(np.cross(along, image[1])) < 1e-12  # the second gives the first axis
    normal = np.cross(along, robot[2] - robot[0])
    assert abs(normal @ image[2]) < 1e-12  # the third gives the plane,
    assert np.cross(along, image[2]) @ normal > 0  # and on which side of the axis it lies


def test_the_batch_agrees_with_the_symbolic_statement():
    rng = np.random.default_rng(3)
    ct, robot = rng.normal(size=(2, 300, 3, 3))
    T = three_point_batch(ct, robot)
    expected = [localisation()(c.T, r.T, LESION)[1].full() for c, r in zip(ct, robot, strict=True)]
    assert np.allclose(T, expected, atol=1e-9)
    assert np.allclose(ThreePoint((2, 0, 1)).batch(ct, robot)[5, :3, 3].shape, (3,))
    ct[7, 2] = 2 * ct[7, 1] - ct[7, 0]
    ct[7] = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    again = three_point_batch(ct, robot)
    assert np.isnan(again[7, :3]).any()
    assert np.array_equal(np.delete(again, 7, axis=0), np.delete(T, 7, axis=0))


def test_the_frame_that_answers_is_the_statement_itself(monkeypatch):
    ct, robot = readings(TRIPLE)
    before = registered(ThreePoint(), ct, robot, ALIKE).T_RC

    def lifted(ct, robot):
        T = three_point(ct, robot)
        return Transform(T.R, T.t + cs.DM([0.0, 0.0, 1e-3]))

    monkeypatch.setattr(statement_of_three, "three_point", lifted)
    statement_of_three._pose_of_row.cache_clear()
    try:
        after = registered(ThreePoint(), ct, robot, ALIKE).T_RC
    finally:
        statement_of_three._pose_of_row.cache_clear()
    assert np.allclose(after - before, np.array([[0.0] * 4] * 2 + [[0, 0, 0, 1e-3], [0] * 4]))


def test_many_frames_by_the_statement_take_less_than_three_fifths_of_least_squares():
    ct, robot = np.random.default_rng(0).normal(size=(2, 4000, 3, 3))
    seconds = {}
    for method in (ThreePoint(), Kabsch()):
        runs = timeit.repeat(partial(method.batch, ct, robot), number=1, repeat=9)
        seconds[method.name] = min(runs)
    assert seconds["three-point"] < 0.6 * seconds["kabsch"]


@by_name
def test_a_batch_is_the_single_answers(method):
    ct, robot = draws(FIVE, ALIKE, 6)
    T = method.batch(ct[None], robot[None], ALIKE)
    assert T.shape == (1, 6, 4, 4)
    if method.name in ("best-triple", "combined"):  # one choice of triples for all draws
        single = [registered(method, ct[0], robot[0], ALIKE).T_RC]
        assert np.allclose(method.batch(ct[:1], robot[:1], ALIKE), single, atol=1e-9)
        return
    single = [registered(method, c, r, ALIKE).T_RC for c, r in zip(ct, robot, strict=True)]
    assert np.allclose(T[0], single, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(any_seed, st.integers(3, 8))
def test_kabsch_is_the_best_rotation_by_scipy(seed, n):
    rng = np.random.default_rng(seed)
    ct, robot = rng.normal(0.0, 0.1, (2, n, 3))
    T = Kabsch().batch(ct, robot)
    oracle, _ = Rotation.align_vectors(robot - robot.mean(axis=0), ct - ct.mean(axis=0))
    assert np.allclose(T[:3, :3], oracle.as_matrix(), atol=1e-6)
    assert np.allclose(mapped(ct.mean(axis=0), T), robot.mean(axis=0))


def test_a_scale_is_found_if_asked_for():
    answer = registered(Kabsch(scale=True), CT, mapped(1.02 * CT), ALIKE)
    assert answer.scale == pytest.approx(1.02)
    assert answer.covariance.shape == (7, 7)
    assert np.allclose(answer.map(LESION), mapped(1.02 * LESION))
    assert any(
        "% longer" in note for note in registered(Kabsch(), CT, mapped(1.02 * CT), ALIKE).notes
    )


def test_without_preferred_axes_the_anisotropic_fit_is_kabschs():
    ct, robot = readings(FIVE)
    expected = registered(Kabsch(), ct, robot).T_RC
    assert np.allclose(registered(Anisotropic(), ct, robot).T_RC, expected, atol=1e-9)
    assert np.allclose(registered(Anisotropic(), ct, robot, ALIKE).T_RC, expected, atol=1e-9)


def test_the_anisotropic_fit_is_the_likeliest_with_the_true_places_unknown():
    ct, robot = readings(FOUR, NOISE, seed=1)
    n, C, R = len(ct), np.sqrt(np.diag(NOISE.ct)), np.sqrt(np.diag(NOISE.robot))

    def misfits(x):
        true = x[6:].reshape(n, 3)
        image = Rotation.from_rotvec(x[3:6]).apply(true) + x[:3]
        return np.concatenate([((true - ct) / C).ravel(), ((image - robot) / R).ravel()])

    start = np.concatenate(
        [T_RC[:3, 3], Rotation.from_matrix(T_RC[:3, :3]).as_rotvec(), ct.ravel()]
    )
    found = least_squares(misfits, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    answer = registered(Anisotropic(), ct, robot, NOISE)
    assert np.allclose(answer.T_RC[:3, 3], found[:3], atol=2e-7)
    assert np.allclose(answer.T_RC[:3, :3], Rotation.from_rotvec(found[3:6]).as_matrix(), atol=2e-6)


@pytest.mark.parametrize("solver", ALL, ids=lambda s: type(s).__name__)
def test_any_solver_may_be_chosen_for_the_stated_problem(solver):
    ct, robot = readings(FIVE, NOISE, seed=2)
    answer = registered(Anisotropic(), ct, robot, NOISE)
    assert np.allclose(
        registered(Anisotropic(solver), ct, robot, NOISE).T_RC, answer.T_RC, atol=1e-6
    )


def test_the_answer_is_optimal_by_the_problem_s_own_statement():
    ct, robot = readings(FIVE, NOISE, seed=2)
    markers, T = Markers.of(ct, robot, NOISE), registered(Anisotropic(), ct, robot, NOISE).T_RC
    assert Solution(problem(markers, T, robot.mean(axis=0)), np.zeros(6)).is_optimal(1e-12)
    start = registered(Kabsch(), ct, robot).T_RC
    assert not Solution(problem(markers, start, robot.mean(axis=0)), np.zeros(6)).is_optimal(1e-6)


@settings(max_examples=10, deadline=None)
@given(any_seed)
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_the_choice_of_frames_changes_nothing(method, seed):
    ct, robot = readings(FIVE, NOISE, seed)
    A, B = rigid(seed), rigid(seed + 1)
    plain = registered(method, ct, robot, NOISE)
    moved = registered(method, mapped(ct, A), mapped(robot, B), turned(NOISE, A, B))
    tolerance = 1e-6 if method.name == "combined" else 1e-8
    assert np.allclose(moved.T_RC, B @ plain.T_RC @ np.linalg.inv(A), atol=tolerance)
    assert moved.fre == pytest.approx(plain.fre, rel=1e-4)
    if method.name != "best-triple":  # its lesion is the markers' centre: the same place
        assert moved.tre(mapped(LESION, A)).rms == pytest.approx(plain.tre(LESION).rms, rel=1e-4)


@by_name
@pytest.mark.parametrize("scale", [0.1, 7.0])
def test_the_unit_changes_nothing(method, scale):
    ct, robot = readings(FIVE, NOISE)
    scaled = MarkerNoise(NOISE.ct * scale**2, NOISE.robot * scale**2, NOISE.freedoms)
    plain, other = (
        registered(method, ct, robot, NOISE),
        registered(method, ct * scale, robot * scale, scaled),
    )
    assert np.allclose(other.T_RC[:3, :3], plain.T_RC[:3, :3], atol=1e-8)
    assert np.allclose(other.T_RC[:3, 3], plain.T_RC[:3, 3] * scale, atol=1e-8)
    assert other.tre(LESION * scale).rms == pytest.approx(plain.tre(LESION).rms * scale, rel=1e-6)
    assert other.condition.angle == pytest.approx(plain.condition.angle)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(5)))
@pytest.mark.parametrize("method", SYMMETRIC, ids=lambda m: m.name)
def test_the_order_of_the_markers_changes_nothing(method, order):
    ct, robot = readings(FIVE, NOISE)
    plain, other = (
        registered(method, ct, robot, NOISE),
        registered(method, ct[order], robot[order], NOISE),
    )
    assert np.allclose(other.T_RC, plain.T_RC, atol=1e-7)
    assert np.allclose(other.misfits, plain.misfits[list(order)], atol=1e-7)


def test_the_mean_misfit_of_all_markers_is_the_calculation_error():
    ct, robot = readings(FIVE)
    answer = registered(ThreePoint((0, 1, 2)), ct, robot)
    off = np.linalg.norm(mapped(ct, answer.T_RC) - robot, axis=1)
    assert answer.calculation_error == pytest.approx(off.mean())
    assert answer.fre == pytest.approx(np.sqrt(np.mean(off[:3] ** 2)))
    assert answer.used == (0, 1, 2)


FAULTS = {
    "two": (lambda c, r: (c[:2], r[:2]), "found 2 of them, expected at least 3"),
    "one line": (lambda c, r: (c[0] + np.outer(range(5), [0.01, 0.02, 0.0]), r), "on one line"),
    "one line, robot": (lambda c, r: (c, r[0] + np.outer(range(5), [0.03, 0, 0])), "robot: found"),
    "one place": (lambda c, r: (c[[0, 0, 2, 3, 4]], r), "markers A and B, ct"),
    "nan": (lambda c, r: (c, np.where(np.arange(15).reshape(5, 3) == 7, np.nan, r)), "marker C"),
    "mm": (lambda c, r: (1e3 * c, r), "divide by 1000"),
    "both mm": (lambda c, r: (1e3 * c, 1e3 * r), "divide by 1000"),
    "robot in mm": (lambda c, r: (c / 40, 25 * r), "divide by 1000"),
    "mirrored": (lambda c, r: (c * [1, 1, -1], r), "a mirror image"),
    "mislabelled": (lambda c, r: (c[[1, 0, 2, 3, 4]], r), "CT's B is the robot's A"),
    "turned round": (
        lambda c, r: (c[[0, 2, 3, 1, 4]], r),
        "CT's D is the robot's B, CT's B is the robot's C",
    ),
    "shapes": (lambda c, r: (c, r[:4]), "(5, 3) and (4, 3)"),
}


@pytest.mark.parametrize("noise", [NOISE, None], ids=["stated", "unstated"])
@pytest.mark.parametrize("name", FAULTS)
def test_markers_that_give_no_frame_are_refused_in_one_line(name, noise):
    change, words = FAULTS[name]
    ct, robot = change(*readings(FIVE, ALIKE))
    for method in METHODS.values():
        with pytest.raises(PlumblineError) as caught:
            registered(method, ct, robot, noise, LABELS[: len(ct)])
        message = str(caught.value)
        assert words in message
        assert len(message.splitlines()) == 1
        assert "; " in message  # the way out


def test_a_line_is_refused_with_its_angle_and_the_remedy():
    ct = np.array([[0, 0, 0], [0.1, 0, 0], [0.2, 0.0005, 0]])
    with pytest.raises(PlumblineError, match=r"0\.14 deg, expected at least 1 deg; move one"):
        registered(Kabsch(), ct, mapped(ct))


@settings(max_examples=20, deadline=None)
@given(any_seed)
def test_a_mirrored_frame_is_refused(seed):
    ct, robot = readings(FIVE, NOISE, seed)
    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    with pytest.raises(PlumblineError, match="mirror image"):
        registered(Anisotropic(), ct - 2 * np.outer(ct @ normal, normal), robot, ALIKE)


def test_noise_alone_never_looks_like_a_mirror_image_or_wrong_labels():
    flat = CT * [1.0, 1.0, 0.02]  # nearly in one plane: noise is as large as the thickness
    rng = np.random.default_rng(5)
    for noise in (ALIKE, None):
        for _ in range(60):
            ct, robot = flat + rng.normal(0, 4e-4, CT.shape), mapped(flat)
            registered(Kabsch(), ct, robot + rng.normal(0, 3e-4, CT.shape), noise)


def test_wrong_noise_is_refused():
    with pytest.raises(PlumblineError, match="state the robot's std"):
        registered(Kabsch(), CT, mapped(CT), MarkerNoise.from_std(ct=[1e-3, 1e-3, 0.0]))
    with pytest.raises(PlumblineError, match="std >= 0"):
        MarkerNoise.from_std(ct=[1e-3, -1e-3, 0.0])
    with pytest.raises(PlumblineError, match="a negative variance"):
        registered(Kabsch(), CT, mapped(CT), MarkerNoise(np.diag([1.0, 1.0, -1.0]), np.eye(3)))
    with pytest.raises(PlumblineError, match="shape"):
        registered(Kabsch(), CT, mapped(CT), MarkerNoise(np.eye(2), np.eye(3)))


def test_a_nearly_collinear_triple_is_a_warning_with_its_angle_and_predicted_error():
    ct, robot = readings(COLLINEAR, ALIKE)
    answer = registered(ThreePoint(), ct, robot, ALIKE, labels(COLLINEAR))
    note = next(note for note in answer.notes if "nearly on one line" in note)
    assert f"{answer.condition.angle:.1f} deg" in note
    assert answer.condition.angle == pytest.approx(9.5, abs=1.0)
    assert answer.condition.sine == pytest.approx(0.165, abs=0.02)
    assert "A, C, D" in note
    assert "mm RMS; move one marker" in note
    good = registered(ThreePoint(), *readings(TRIPLE), ALIKE, labels(TRIPLE))
    assert good.condition.sine == pytest.approx(0.987, abs=0.01)
    assert not any("nearly on one line" in note for note in good.notes)
    assert answer.tre(LESION).rms > 4 * good.tre(LESION).rms


SQUARE = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]])
KITE = np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, -0.05, 0], [0, 0.02, 0]])
CUBE = 0.1 * np.array(list(product((0.0, 1.0), repeat=3)))
TURNS = np.radians(30.0) * np.arange(12)
RING = 0.1 * np.stack([np.cos(TURNS), np.sin(TURNS), 0 * TURNS], axis=1)
EIGHT = np.random.default_rng(8).uniform(-0.1, 0.1, (8, 3))
UNEVEN = np.array([[0.0, 0.0, 0.0], [0.11, 0.01, 0.0], [0.03, 0.09, 0.02], [0.06, 0.02, 0.07]])
ASIDE, ON_AXIS = [0.03, 0.04, -0.06], [0.05, 0.05, 0.0]


@pytest.mark.parametrize("noise", [ALIKE, None])
@pytest.mark.parametrize(
    ("points", "target", "doubted"),
    [
        (SQUARE, ASIDE, True),
        (KITE, ASIDE, True),
        (CUBE, ASIDE, True),
        (RING, ASIDE, True),
        (UNEVEN, ASIDE, False),
        (EIGHT, ASIDE, False),
        (np.vstack([CUBE, EIGHT[:1]]), ASIDE, False),
        (SQUARE, ON_AXIS, False),
    ],
)
def test_a_target_that_exchanged_labels_put_elsewhere_is_doubtful(points, target, doubted, noise):
    """In the middle of a square every exchange leaves it in place."""
    rng = np.random.default_rng(5)
    ct, robot = (p + rng.normal(0.0, 3e-4, p.shape) for p in (points, mapped(points)))
    said = register(build_fiducials(ct, robot, targets={"T": target}, noise=noise)).trust[0]
    assert said.startswith("T: doubtful: were labels exchanged (CT's") is doubted
    assert ("none would notice" in said) is doubted


def test_symmetric_markers_are_noted_since_exchanged_labels_would_go_unnoticed():
    isosceles = np.array([[0.0, 0.1, 0.0], [0.06, 0.0, 0.0], [-0.06, 0.0, 0.0]])
    notes = registered(Kabsch(), isosceles, mapped(isosceles), ALIKE).notes
    assert any("would go unnoticed" in n and "CT's M3 is the robot's M2" in n for n in notes)
    # With one more marker off the plane the exchange would take a mirror image.
    raised = np.vstack([isosceles, [0.0, 0.0, 0.05]])
    assert not any(
        "CT's M3" in note for note in registered(Kabsch(), raised, mapped(raised), ALIKE).notes
    )


@settings(max_examples=25, deadline=None)
@given(any_seed, st.integers(0, 4), st.sampled_from([FOUR, FIVE]))
def test_a_shifted_marker_is_found(seed, k, which):
    k = k % len(which)
    ct, robot = readings(which, ALIKE, seed)
    push = np.random.default_rng(seed).normal(size=3)
    robot[k] += 0.02 * push / np.linalg.norm(push)
    rest = [j for j in range(len(which)) if j != k]
    expected = registered(Anisotropic(), ct[rest], robot[rest], ALIKE)
    assume(expected.surprise >= ALPHA)  # one draw in 1000 belies the stated noise by chance
    answer = registered(Robust(), ct, robot, ALIKE, labels(which))
    name = labels(which)[k]
    said = " ".join(answer.notes)
    # Four markers cannot always tell; then the right one is at least among those named.
    assert answer.shifted == (name,) or (len(which) == 4 and name in said and "as well" in said)
    if answer.shifted == (name,):
        assert np.allclose(answer.T_RC, expected.T_RC, atol=1e-9)
        assert answer.tre(LESION).rms == pytest.approx(expected.tre(LESION).rms)
        assert f"marker {name} moved by" in said


def test_a_shifted_marker_is_found_without_any_stated_noise():
    ct, robot = readings(FIVE, ALIKE)
    robot[3] += [0.01, -0.01, 0.01]
    answer = registered(Robust(), ct, robot, names=LABELS)
    assert answer.shifted == ("D",)
    assert answer.fre < 2e-3
    assert registered(Kabsch(), ct, robot).fre > 4e-3


def test_two_shifted_markers_are_found_if_asked_for():
    rng = np.random.default_rng(1)
    ct = rng.uniform(-0.1, 0.1, (7, 3))
    robot = mapped(ct) + rng.normal(0, 3e-4, ct.shape)
    robot[1] += [0.015, 0, 0]
    robot[4] += [0.015, 0, 0]
    assert set(registered(Robust(most=2), ct, robot, ALIKE).shifted) == {"M2", "M5"}


def test_which_of_four_coplanar_markers_rose_cannot_be_told():
    ct = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.12, 0], [0.13, 0.11, 0]], dtype=float)
    risen = ct.copy()
    risen[3, 2] = 0.008
    robot = mapped(risen)
    said = " ".join(registered(Robust(), ct, robot, ALIKE).notes)
    assert "it may as well have been" in said
    assert all(name in said for name in ("M1", "M2", "M3", "M4"))


def test_good_markers_are_kept_even_where_the_stated_noise_is_too_small():
    small = MarkerNoise.from_std(ct=1e-5, robot=1e-5)
    kept = [registered(Robust(), *readings(FIVE, ALIKE, seed), small) for seed in range(20)]
    assert sum(not answer.shifted for answer in kept) >= 18
    assert all(any("stated noise allows" in n for n in a.notes) for a in kept)
    fine = [registered(Robust(), *readings(FIVE, ALIKE, seed), ALIKE) for seed in range(40)]
    assert not any(answer.shifted for answer in fine)


def test_the_bound_on_triples_says_what_the_triples_say():
    rng, narrow = np.random.default_rng(0), 0
    for _ in range(300):
        points = rng.normal(size=(rng.integers(3, 8), 3)) * [
            1.0,
            *(10.0 ** rng.uniform(-2.5, 0, 2)),
        ]
        best = condition_of(points).angle
        narrow += best < LEAST_HELD
        assert _holds(points) is bool(best >= LEAST_HELD)
    assert 50 < narrow < 250


def test_good_markers_are_kept_where_the_noise_is_stated_half_too_small():
    small = MarkerNoise(ALIKE.ct / 1.5**2, ALIKE.robot / 1.5**2)
    answers = [registered(Robust(), *readings(FIVE, ALIKE, seed), small) for seed in range(100)]
    assert sum(bool(answer.shifted) for answer in answers) <= 1


def test_the_best_triple_has_the_least_predicted_error():
    ct, robot = readings(FIVE, NOISE)
    ranked = rank_triples(build_fiducials(ct, robot, noise=NOISE, labels=LABELS), LESION)
    errors = [answer.tre(LESION).rms for answer in ranked]
    assert len(ranked) == 10
    assert errors == sorted(errors)
    assert sorted(ranked[-1].used) == list(COLLINEAR)  # A-C-D is nearly on a line
    best = registered(BestTriple(tuple(LESION)), ct, robot, NOISE)
    assert best.used == ranked[0].used
    assert np.allclose(best.T_RC, ranked[0].T_RC)
    with pytest.raises(PlumblineError):
        rank_triples(build_fiducials(ct[:2], robot[:2]), LESION)


def test_all_triples_combined_do_better_than_any_of_them():
    ct, robot = CT, mapped(CT)
    combined = registered(METHODS["combined"], ct, robot, NOISE)
    best = rank_triples(build_fiducials(ct, robot, noise=NOISE), LESION)[0]
    optimum = registered(Anisotropic(), ct, robot, NOISE).tre(LESION).rms
    assert optimum <= combined.tre(LESION).rms < 1.02 * optimum
    assert combined.tre(LESION).rms < best.tre(LESION).rms


def test_an_unknown_triple_is_refused():
    with pytest.raises(PlumblineError, match="indices below 5"):
        registered(ThreePoint((0, 1, 5)), CT, mapped(CT))


def test_a_triple_on_one_line_is_refused_though_others_are_not():
    ct = np.vstack([CT, CT[0] + 0.5 * (CT[1] - CT[0])])
    with pytest.raises(PlumblineError, match="triple M1, M2, M6, ct: found one line"):
        registered(ThreePoint((0, 1, 5)), ct, mapped(ct))
    assert len(rank_triples(build_fiducials(ct, mapped(ct), noise=NOISE), LESION)) == 19  # of 20
    for method in METHODS.values():
        assert np.allclose(registered(method, ct, mapped(ct), NOISE).T_RC, T_RC, atol=1e-9)


@pytest.mark.parametrize("order", list(permutations(range(4)))[1:])
def test_any_exchange_of_labels_is_seen_and_undone(order):
    ct, robot = readings(FOUR, ALIKE)
    with pytest.raises(PlumblineError, match="mend the labels") as caught:
        registered(Kabsch(), ct[list(order)], robot, ALIKE, labels(FOUR))
    for place, k in enumerate(order):
        named = f"CT's {labels(FOUR)[place]} is the robot's {labels(FOUR)[k]}"
        assert (named in str(caught.value)) is (place != k)


@pytest.mark.parametrize("n", [8, 12, 40])
def test_labels_of_many_markers_in_any_order_are_seen_and_undone(n):
    rng = np.random.default_rng(n)
    ct, order = rng.uniform(-0.1, 0.1, (n, 3)), rng.permutation(n)
    robot = mapped(ct) + rng.normal(0.0, 3e-4, ct.shape)
    with pytest.raises(PlumblineError, match="mend the labels") as caught:
        registered(Kabsch(), ct[order], robot, ALIKE)
    said = f"{caught.value},"
    for place, k in enumerate(order.tolist()):
        assert (f"CT's M{place + 1} is the robot's M{k + 1}," in said) is (place != k)


def test_a_good_marker_is_left_out_as_rarely_as_was_asked_for():
    ct, robot = draws(FIVE, ALIKE, 1500)
    exact = replace(ALIKE, freedoms=np.inf)
    plain = Anisotropic().batch(ct, robot, exact)
    for alpha in (0.02, 0.1):
        found = Robust(alpha=alpha).batch(ct, robot, exact)
        left_out = np.mean(np.any(np.abs(found - plain) > 1e-9, axis=(1, 2)))
        assert left_out == pytest.approx(alpha, abs=4 * np.sqrt(alpha * (1 - alpha) / 1500))
