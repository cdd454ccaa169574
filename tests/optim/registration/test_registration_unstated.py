"""Where no noise was stated, a region still holds what it promises, or says that it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import f as fisher

from plumbline.optim.registration import Anisotropic, Kabsch, MarkerNoise, Robust
from plumbline.optim.registration.constants import (
    DOUBTFUL,
    ENOUGH_FREEDOMS,
    FEWEST_UNSTATED,
    NO_PAIR,
    STATED,
    SURPRISING,
)
from plumbline.optim.registration.fiducials import build_fiducials
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.target import Unstated
from plumbline.optim.registration.to_diagnose import fiducials_to_diagnose
from plumbline.optim.registration.words import trust
from tests.phantoms import ALIKE, CT, FIVE, LESION, T_RC, mapped, readings, registered

TRIALS = 120
SHARE = (0.90, 0.995)  # of 120 draws: two standard errors about 95 %
SLICES = 1e-3 * np.array([5.0, 1.0, 1.0])  # pitch of CT [m]


def scene(rng, n):
    """Places of n markers (n, 3) and of a target (3,) [m], no two scenes alike."""
    points = rng.uniform(-0.075, 0.075, (n, 3))
    while np.linalg.svd(points - points.mean(axis=0))[1][1] < 0.02 * np.sqrt(n):
        points = rng.uniform(-0.075, 0.075, (n, 3))
    return points, rng.uniform(-0.06, 0.06, 3)


def test_a_target_read_with_an_own_noise_is_off_by_that_however_ct_is_turned():
    """Of markers that say nothing of the pose: squared distances have three freedoms."""
    noise = Unstated(np.full(3, 1e-6), np.full(3, 5.0), np.eye(12, 6), np.zeros((6, 4, 3)), "")
    turn = Rotation.from_rotvec([0.9, -0.4, 0.7]).as_matrix()
    found = noise.distances(np.zeros(3), turn, np.array([5e-3, 1e-3, 2e-4]))
    assert np.mean(found) == pytest.approx(3.0, rel=0.1)
    assert np.var(found) == pytest.approx(6.0, rel=0.25)


def test_a_noise_that_is_hardly_known_is_said_as_the_markers_have_it():
    """Ten times what was stated of them."""
    tenfold, hardly = MarkerNoise.from_std(ct=4e-3, robot=3e-3), replace(ALIKE, freedoms=0.1)
    read = [readings(FIVE, tenfold, seed=seed) for seed in range(20)]
    said = [registered(Kabsch(), *markers, hardly).noise_std for markers in read]
    assert np.mean(said) == pytest.approx(5e-3, rel=0.1)


def test_the_noise_of_touches_is_that_of_ct_as_the_robot_sees_it():
    std = np.array([3e-3, 1e-3, 2e-4])
    markers = build_fiducials(CT, mapped(CT), noise=MarkerNoise.from_std(std, 1e-4))
    found = fiducials_to_diagnose(markers)
    R = T_RC[:3, :3]
    seen = np.sqrt(np.diag(R @ np.diag(std**2) @ R.T) + 1e-8)
    np.testing.assert_allclose(found.noise_std * found.noise_shape, np.tile(seen, (len(CT), 1)))


def rounded(points, rng):
    """Places as slices and pixels give them, wherever those happen to lie."""
    phase = rng.uniform(size=3) * SLICES
    return np.round((points + phase) / SLICES) * SLICES - phase


def held(n, read, noise=None, method=None):
    """Share of scenes in which the target lies in its region, of those that have one."""
    inside = []
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        markers, target = scene(rng, n)
        ct = read(np.vstack([markers, target]), rng)
        robot = mapped(markers) + rng.normal(0, 1e-4, markers.shape)
        answer = registered(method or Kabsch(), ct[:-1], robot, noise)
        region = answer.tre(ct[-1], None)
        if not region.unknown:
            inside.append(region.holds(answer.map(ct[-1]) - mapped(target))[0])
    assert len(inside) > 0.9 * TRIALS
    return np.mean(inside)


def alike(points, rng):
    """Places read alike along all axes."""
    return points + rng.normal(0, 4e-4, points.shape)


@pytest.mark.parametrize("read", [alike, rounded], ids=["alike", "slices"])
@pytest.mark.parametrize("n", [4, 10])
def test_the_region_counts_the_target_s_own_reading(n, read):
    assert SHARE[0] <= held(n, read) <= 1.0


def test_stated_noise_of_slices_counts_the_target_s_own_reading():
    noise = MarkerNoise.from_resolution(SLICES, 1e-4, freedoms=np.inf)
    assert held(4, rounded, noise, Anisotropic()) >= SHARE[0]
    exact = [registered(Kabsch(), CT, mapped(CT), noise).tre(LESION, own) for own in (None, 0.0)]
    more = exact[0].covariance - exact[1].covariance
    R = registered(Kabsch(), CT, mapped(CT), noise).T_RC[:3, :3]
    assert np.allclose(R.T @ more @ R, np.diag(SLICES**2 / 12), atol=1e-12)


def test_draws_of_one_variance_give_hotelling_s_quantile():
    # For alike variances pooled by hand, the drawn limit must lie near 3 F(3, dof).
    rng = np.random.default_rng(1)
    ct = rng.uniform(-0.1, 0.1, (40, 3))
    answer = registered(Kabsch(), ct + rng.normal(0, 4e-4, ct.shape), mapped(ct))
    region = answer.tre(LESION, None)
    assert region.limit() == pytest.approx(3 * fisher.ppf(0.95, 3, 3 * 40 - 6), rel=0.12)
    four = registered(Kabsch(), *(p[:4] for p in readings(FIVE))).tre(LESION, None)
    assert four.limit() > 3 * fisher.ppf(0.95, 3, 6)  # three variances of two freedoms each


def test_each_axis_of_ct_has_a_noise_of_its_own():
    rng = np.random.default_rng(2)
    ct = rng.uniform(-0.1, 0.1, (60, 3))
    std = np.array([1.5e-3, 3e-4, 3e-4])
    markers = Markers.of(ct + rng.normal(0, 1, ct.shape) * std, mapped(ct))
    found = Unstated.of(markers, Kabsch().fit(markers).jacobian)
    assert np.allclose(np.sqrt(found.variances), std, rtol=0.3)
    assert found.freedoms.sum() == pytest.approx(3 * 60 - 6)


def test_the_same_markers_give_the_same_region():
    ct, robot = readings(FIVE)
    one, two = (registered(Kabsch(), ct, robot).tre(LESION, None) for _ in range(2))
    assert np.array_equal(one.semi_axes(), two.semi_axes())


def test_three_markers_without_stated_noise_are_not_known_and_never_good():
    assert FEWEST_UNSTATED == 4
    for seed in range(20):
        ct, robot = (p[:3] for p in readings(FIVE, ALIKE, seed))
        answer = registered(Kabsch(), ct, robot)
        region = answer.tre(LESION, None)
        assert region.semi_axes().tolist() == [np.inf] * 3
        assert region.holds([[1.0, 0.0, 0.0]]).all()
        said = trust(answer, region, "M")
        assert said.startswith("M: not known; three markers cannot show how large the noise is")
        assert "state the CT's resolution" in said


def test_markers_in_one_slice_do_not_show_how_thick_it_is():
    ct, robot = readings(FIVE)
    ct[:, 0] = 0.05
    answer = registered(Kabsch(), ct, robot)
    assert "one x of CT" in answer.unknown
    assert not registered(Kabsch(), ct, robot, MarkerNoise.from_std(ct=0.02, robot=1e-3)).unknown


def test_few_freedoms_are_never_good():
    assert ENOUGH_FREEDOMS == 8.0
    rng = np.random.default_rng(0)
    for n, grade in ((5, "fair"), (20, "good")):
        ct = rng.uniform(-0.1, 0.1, (n, 3))
        answer = registered(Kabsch(), ct + rng.normal(0, 1e-5, ct.shape), mapped(ct))
        assert trust(answer, answer.tre(LESION, None), "M").startswith(f"M: {grade}")


def test_noise_beyond_what_was_stated_widens_the_region_and_is_doubtful():
    tenth = MarkerNoise(ALIKE.ct / 100, ALIKE.robot / 100)
    ct, robot = readings(FIVE, ALIKE)
    answer, right = (registered(Anisotropic(), ct, robot, noise) for noise in (tenth, ALIKE))
    assert answer.noise_scale == pytest.approx(10 * np.sqrt(answer_square(right) / 9), rel=1e-3)
    regions = [a.tre(LESION, None) for a in (answer, right)]
    assert regions[0].semi_axes()[0] > 0.5 * regions[1].semi_axes()[0]
    assert trust(answer, regions[0], "M").startswith("M: doubtful")


def test_a_stated_noise_is_worth_eight_readings():
    assert STATED == 8.0
    ct, robot = readings(FIVE, ALIKE)
    answer, exact = (
        registered(Kabsch(), ct, robot, replace(ALIKE, freedoms=nu)) for nu in (STATED, np.inf)
    )
    square = answer_square(answer)
    assert answer.noise_scale**2 == pytest.approx((8.0 + square) / 17.0)
    assert answer.dof == 17.0
    assert (exact.noise_scale, exact.dof) == (1.0, np.inf)
    limit = answer.tre(LESION, curved=False).limit()
    assert limit == pytest.approx(3 * fisher.ppf(0.95, 3, 17))
    unknown = registered(Kabsch(), ct, robot, replace(ALIKE, freedoms=0.0))
    assert unknown.noise_scale**2 == pytest.approx(square / 9.0)


@pytest.mark.parametrize(("n", "least"), [(4, 0.77), (10, 0.85)])
def test_regions_hold_where_the_noise_is_stated_half_too_small(n, least):
    small = MarkerNoise.from_std(4e-4 / 1.5, 1e-4 / 1.5)
    exact = replace(small, freedoms=np.inf)
    # By the integral over chi-square: 88.5 and 92.3 %, less three errors of 120 draws.
    share = held(n, alike, small)
    assert share > least
    assert held(n, alike, exact) < share - 0.05


@pytest.mark.parametrize("times", [1.0, 1.5])
def test_misfits_that_few_markers_have_are_never_good(times):
    assert SURPRISING == 0.05
    rng, noise, good = np.random.default_rng(4), MarkerNoise.from_std(2e-5, 1e-5), []
    ct = rng.uniform(-0.1, 0.1, (12, 3))
    for _ in range(40):
        shifts = rng.normal(0, times * np.hypot(2e-5, 1e-5), ct.shape)
        answer = registered(Kabsch(), ct, mapped(ct) + shifts, noise)
        said = trust(answer, answer.tre(LESION, None), "M")
        assert said.startswith("M: good") is (answer.surprise >= SURPRISING)
        assert ("check what was stated" in said) is (DOUBTFUL <= answer.surprise < SURPRISING)
        good.append(said.startswith("M: good"))
    assert np.mean(good) >= 0.85 if times == 1.0 else np.mean(good) <= 0.2


def answer_square(answer):
    """Whitened squares of an answer under noise alike on all axes."""
    return np.sum(answer.residuals**2) / (ALIKE.ct[0, 0] + ALIKE.robot[0, 0])


def test_a_moved_marker_that_cannot_be_told_has_no_region():
    ct = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.12, 0], [0.13, 0.11, 0]], dtype=float)
    risen = ct.copy()
    risen[3, 2] = 0.008
    answer = registered(Robust(), ct, mapped(risen), ALIKE)
    assert "which marker moved cannot be told" in answer.unknown
    assert trust(answer, answer.tre(LESION, None), "M").startswith("M: not known")


def test_agreeing_exactly_is_no_division_by_zero():
    region = registered(Kabsch(), CT, mapped(CT)).tre(LESION, None)
    assert np.isfinite(region.semi_axes()).all()
    assert region.rms < 1e-9
    assert replace(region, unknown="why").limit() == np.inf


@pytest.mark.parametrize("noise", [ALIKE, None], ids=["stated", "unstated"])
@pytest.mark.parametrize("n", [4, 6])
def test_points_that_are_no_pairs_are_not_known(n, noise):
    assert NO_PAIR == 0.1
    ct, robot = np.random.default_rng(3).uniform(-0.1, 0.1, (2, n, 3))
    answer = registered(Robust(), ct, robot, noise)
    assert answer.unknown
    assert trust(answer, answer.tre(LESION, None), "M").startswith("M: not known")


def test_three_markers_are_never_good_since_one_may_have_moved():
    fine = MarkerNoise.from_std(ct=1e-5, robot=1e-5)
    for n, grade in ((3, "fair"), (5, "good")):
        answer = registered(Kabsch(), CT[:n], mapped(CT[:n]), fine)
        said = trust(answer, answer.tre(LESION, None), "M")
        assert said.startswith(f"M: {grade}")
        assert ("cannot show that one of them moved" in said) is (n == 3)
        assert ("that an axis of CT is mirrored" in said) is (n == 3)


def test_four_markers_hardly_check_a_stated_noise_and_are_good_only_where_it_is_exact():
    fine = MarkerNoise.from_std(ct=1e-5, robot=1e-5)
    for noise, grade in ((fine, "fair"), (replace(fine, freedoms=np.inf), "good")):
        answer = registered(Kabsch(), CT[:4], mapped(CT[:4]), noise)
        said = trust(answer, answer.tre(LESION, None), "M")
        assert said.startswith(f"M: {grade}")
        assert ("4 markers hardly check what was stated of the noise" in said) is (grade == "fair")
