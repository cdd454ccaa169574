"""Laws of pointing: geometry, the path's quality by Pinocchio and coal, statuses, refusals."""

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.pointing import (
    Aim,
    Box,
    Cylinder,
    Needle,
    PointingOptions,
    Status,
    plan_sweep,
    safe_angle_map,
    tip_and_top,
)
from plumbline.optim.pointing.judge import Angles, checked, judged, why_not
from plumbline.optim.pointing.postures import solved, starts
from plumbline.optim.pointing.statement import SweepStatement, SweepWeights
from plumbline.optim.pointing.surroundings import surroundings
from plumbline.optim.pointing.task import (
    Bounded,
    across,
    links,
    needle_task,
    pointed,
    smallest_singular_values,
)
from tests.needle_scenes import least_at

deg = np.deg2rad
UR3, UR5 = Robot.bundled("ur3").chain(), Robot.bundled("ur5").chain()
LESION = (0.05, 0.13, 0.063)
PHANTOM = Box((0.0, -0.01, 0.0), (0.12, 0.16, 0.147))
NEEDLE = Needle(0.401, 0.150)
ANGLES = st.tuples(st.floats(0.0, np.pi / 2), st.floats(-np.pi, np.pi))


def placed(x=0.50, y=-0.30, z=0.70, turn=0.9):
    """A CT frame with its z downwards in the robot's."""
    T = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    T[:3, :3] = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
    T[:3, 3] = np.array([x, y, z]) - T[:3, :3] @ LESION
    return T


AIM = Aim(UR3, placed(), LESION, NEEDLE, PHANTOM)
ARC = (deg(35.0), np.linspace(deg(235.0), deg(305.0), 30))


@pytest.fixture(scope="module")
def sweep():
    """A sweep that the UR3 can hold throughout."""
    return plan_sweep(AIM, *ARC)


@given(angles=ANGLES, r=st.floats(0.01, 0.5), length=st.floats(0.05, 0.6))
@settings(max_examples=40, deadline=None)
def test_tip_and_top_lie_at_standoff_and_length_on_one_line(angles, r, length):
    T = placed()
    tip, top = tip_and_top(T, LESION, Needle(length, r), *angles)
    lesion = T[:3, :3] @ LESION + T[:3, 3]
    assert np.linalg.norm(tip - lesion) == pytest.approx(r, abs=1e-12)
    assert np.linalg.norm(top - tip) == pytest.approx(length, abs=1e-12)
    assert np.linalg.norm(np.cross(tip - lesion, top - lesion)) < 1e-12
    assert (T[:3, 2] @ (tip - lesion)) / r == pytest.approx(np.cos(angles[0]), abs=1e-12)


def test_theta_leaves_z_and_beta_turns_from_x_to_y():
    needle = Needle(1.0, 1.0)
    tips, _ = tip_and_top(np.eye(4), (0, 0, 0), needle, deg([0, 90, 90]), deg([0, 0, 90]))
    np.testing.assert_allclose(tips, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_angles_broadcast_and_keep_their_shape():
    tips, tops = tip_and_top(placed(), LESION, NEEDLE, deg([[10], [20]]), deg([0, 90, 180]))
    assert tips.shape == tops.shape == (2, 3, 3)


def test_pinocchio_finds_the_tool_centre_point_on_the_lesion_all_along(sweep):
    assert sweep.is_safe
    chain, data = AIM.chain, AIM.chain.model.createData()
    tips, tops = sweep.tips_and_tops
    for q, tip, top in zip(sweep.joints, tips, tops, strict=True):
        pin.forwardKinematics(chain.model, data, chain.configuration(q))
        T = data.oMi[chain.n].homogeneous @ chain.T_last_tip
        assert np.linalg.norm(T[:3, 3] - top) < 1e-8
        assert np.linalg.norm(T[:3, 3] + NEEDLE.length * T[:3, 2] - tip) < 1e-8
    assert sweep.rcm_error.max() < 1e-8
    assert sweep.direction_error.max() < 1e-8


def test_the_joint_path_is_continuous_and_within_limits(sweep):
    steps = np.abs(np.diff(sweep.joints, axis=0))
    np.testing.assert_allclose(sweep.step[1:], steps.max(axis=1))
    assert steps.max() < 0.1
    assert (sweep.joints >= UR3.lower).all()
    assert (sweep.joints <= UR3.upper).all()


def test_a_plan_is_the_same_every_time(sweep):
    np.testing.assert_array_equal(plan_sweep(AIM, *ARC).joints, sweep.joints)


def test_a_sweep_backwards_is_as_good(sweep):
    back = plan_sweep(AIM, ARC[0], ARC[1][::-1])
    assert back.is_safe
    assert back.singular_value.min() == pytest.approx(sweep.singular_value.min(), abs=0.02)


def test_turning_arm_and_body_together_about_the_base_changes_nothing(sweep):
    turned = np.eye(4)
    turned[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    other = plan_sweep(Aim(UR3, turned @ AIM.T_robot_ct, LESION, NEEDLE, PHANTOM), *ARC)
    np.testing.assert_allclose(other.singular_value, sweep.singular_value, atol=1e-6)
    assert other.is_safe


def test_a_free_turn_about_the_needle_keeps_away_from_singularities():
    # A needle aslant in its flange: turning about it moves all joints, so there is a choice.
    aslant = Needle(0.401, 0.150, axis=(0.0, 0.6, 0.8))
    aim = Aim(UR3, placed(), LESION, aslant)
    task = needle_task(UR3, aslant.axis)
    careless = PointingOptions(weights=SweepWeights(manipulability=0.0))
    careful = PointingOptions(weights=SweepWeights(manipulability=1e-2))
    worst = [plan_sweep(aim, *ARC, options).singular_value.min() for options in (careless, careful)]
    assert worst[1] > worst[0]
    assert task.chain.n == 6


def test_a_seven_joint_arm_with_a_slide_points_too():
    chain = Robot.bundled("laparoscopic").chain()
    T = np.eye(4)
    T[:3, 3] = np.array([0.45, 0.0, 0.05]) - np.array(LESION)
    found = plan_sweep(Aim(chain, T, LESION, Needle(0.05, 0.05)), deg(20), deg(np.arange(0, 60, 3)))
    assert found.is_safe, found.reasons
    assert found.rcm_error.max() < 1e-8


def test_out_of_reach_is_a_status_with_a_reason_and_no_posture():
    far = Aim(UR3, placed(x=1.5), LESION, NEEDLE, PHANTOM)
    found = plan_sweep(far, deg(20), deg([0.0, 90.0, 180.0]))
    assert set(found.status) == {Status.REACH}
    assert np.isnan(found.joints).all()
    assert repr(found).endswith("0 safe; no path through all>")
    assert all("misses by" in words for words in found.reasons)
    assert "0 of 3 angles safe" in found._repr_html_()


def test_the_reachable_part_of_a_sweep_is_planned_where_the_rest_is_not():
    found = plan_sweep(AIM, deg(30), np.linspace(deg(150), deg(300), 40))
    assert Status.REACH in found.status
    held = np.isfinite(found.joints).all(axis=1)
    assert held.sum() > 10
    assert found.rcm_error[held].max() < 1e-8
    assert not found.safe[~held].any()
    # Whatever a posture reaches is on the path: none is left to "another posture of the arm".
    assert set(found.status) <= {Status.SAFE, Status.SINGULAR, Status.REACH}


def test_a_short_stretch_that_the_anchors_miss_is_found():
    # Out of reach at both ends and in the middle.
    beta = deg(np.concatenate([np.full(4, 90.0), [240.0, 245.0, 250.0], np.full(8, 90.0)]))
    found = plan_sweep(AIM, deg(35), beta)
    assert np.flatnonzero(found.safe).tolist() == [4, 5, 6]


def test_a_leap_between_angles_far_apart_is_called_one():
    options = PointingOptions(longest_step=0.05)
    found = plan_sweep(AIM, deg(35), deg([240.0, 290.0]), options)
    assert found.status == (Status.SAFE, Status.JUMP)
    assert found.step[1] > 0.05
    assert "at most 0.05" in found.reasons[1]


def test_joint_limits_are_told_from_the_reach():
    tight = Robot.from_dh(
        [
            {"d": r.d, "a": r.a, "alpha": r.alpha, "theta": r.theta, "lower": -0.2, "upper": 0.2}
            for r in Robot.bundled("ur3").dh
        ]
    ).chain()
    aim = Aim(tight, placed(), LESION, NEEDLE)
    found = plan_sweep(aim, deg(35), deg([260.0, 270.0]))
    assert set(found.status) == {Status.LIMIT}
    ((kind, _words),) = why_not(Angles.of(AIM, None, deg([35.0]), deg([270.0])))
    assert kind == Status.JUMP  # another posture would hold it


def test_a_stricter_limit_makes_angles_singular(sweep):
    limit = float(np.median(sweep.singular_value))
    strict = plan_sweep(AIM, *ARC, PointingOptions(least_singular_value=limit))
    below = strict.singular_value < limit
    assert below.any()
    assert {status for status, low in zip(strict.status, below, strict=True) if low} == {
        Status.SINGULAR
    }


def test_a_short_standoff_leaves_the_tip_inside_of_the_body():
    short = Aim(UR5, placed(), LESION, Needle(0.401, 0.05), PHANTOM)
    found = plan_sweep(short, deg(5), deg([0.0]))
    assert found.status == (Status.INSIDE,)
    assert "longer stand-off" in found.reasons[0]


def test_an_arm_that_stands_in_the_body_collides():
    # Its face lies at z = 0.18 m of the base frame, below which the shoulder does not fit.
    big = Box((-2.0, -2.0, -0.05), (2.0, 2.0, 0.583))
    aim = Aim(UR3, placed(x=0.3, y=-0.2), LESION, Needle(0.05, 0.65), big)
    found = plan_sweep(aim, deg(5), deg([250.0]))
    assert found.status == (Status.COLLISION,)
    assert found.clearance[0] < 0.0


def test_clearance_is_coal_s_distance_of_the_capsules(sweep):
    for q, clearance in zip(sweep.joints[::10], sweep.clearance[::10], strict=True):
        assert clearance == pytest.approx(min(least_at(AIM, q).values()), abs=1e-6)


def test_the_needle_of_a_vertical_puncture_clears_the_body_by_what_is_outside():
    # Straight up from the lesion: the tip is standoff - depth above the top face.
    around = surroundings(AIM, 2e-3)
    segments = pointed(AIM, np.zeros((1, 6)), np.zeros(1), np.zeros(1))
    (pair,) = [p for p in around.pairs if (p.first, p.second) == ("needle", "body")]
    depth = 0.147 - 0.063
    expected = 0.150 - depth - NEEDLE.radius
    assert around.distance(segments[0], pair) == pytest.approx(expected, abs=1e-6)


def test_links_follow_pinocchio_s_joints():
    q = starts(needle_task(UR3, NEEDLE.axis), 3)
    data = UR3.model.createData()
    for posture, segments in zip(q, links(UR3, q), strict=True):
        pin.forwardKinematics(UR3.model, data, posture)
        origins = np.array([data.oMi[j + 1].translation for j in range(6)])
        np.testing.assert_allclose(segments[1::2, 0], origins, atol=1e-12)


@given(angles=ANGLES)
@settings(max_examples=40, deadline=None)
def test_the_way_out_of_a_body_ends_on_its_surface(angles):
    u = np.array(tip_and_top(np.eye(4), (0, 0, 0), Needle(1.0, 1.0), *angles)[0])[None]
    lesion = np.array(LESION)
    out = lesion + PHANTOM.depth(lesion, u)[0] * u[0]
    gaps = np.concatenate([out - PHANTOM.lower, np.array(PHANTOM.upper) - out])
    assert np.abs(gaps).min() < 1e-12
    assert gaps.min() > -1e-12
    trunk = Cylinder((0.0, 0.1, 0.05), 0.15, 0.6)
    out = lesion + trunk.depth(lesion, u)[0] * u[0]
    radial, axial = np.hypot(out[1] - 0.1, out[2] - 0.05) - 0.15, abs(out[0]) - 0.3
    assert max(radial, axial) == pytest.approx(0.0, abs=1e-12)


def test_smallest_singular_values_agree_with_pinocchio_and_finite_differences(sweep):
    task = needle_task(UR3, NEEDLE.axis)
    rows = AIM.rows(sweep.theta, sweep.beta)
    symbolic = smallest_singular_values(task, sweep.joints, rows)
    np.testing.assert_allclose(symbolic, sweep.singular_value, atol=1e-9)
    q, row, h = sweep.joints[:1], rows[:1], 1e-6
    numeric = np.stack(
        [
            (task.seek(q + h * e, row)[0] - task.seek(q - h * e, row)[0])[0] / (2 * h)
            for e in np.eye(6)
        ],
        axis=1,
    )
    np.testing.assert_allclose(task.seek(q, row)[1][0], numeric, atol=1e-8)


def test_the_hessian_handed_to_ipopt_is_that_of_the_lagrangian():
    task = needle_task(UR3, (0.0, 0.6, 0.8))
    equations, cost, curvature = SweepStatement(task, 2, SweepWeights()).stage
    rng = np.random.default_rng(0)
    x, force = rng.uniform(-1, 1, 6), rng.normal(size=5)
    row = AIM.rows(deg([35.0]), deg([250.0]))
    data = np.hstack([row[0], across(row[:, 3:6])[0].T.ravel()])
    symbol = cs.SX.sym("x", 6)
    lagrangian = 2.0 * cost(symbol, data) + cs.dot(cs.DM(force), equations(symbol, data))
    slope = cs.Function("slope", [symbol], [cs.gradient(lagrangian, symbol)])
    h = 1e-6
    numeric = [(slope(x + h * e) - slope(x - h * e)).full().ravel() / (2 * h) for e in np.eye(6)]
    np.testing.assert_allclose(curvature(x, data, 2.0, force).full(), numeric, atol=1e-6)


def test_a_needle_turned_about_its_own_point_is_not_held(sweep):
    # The tool centre point stays; a needle that comes from elsewhere is no pointing.
    other = Angles.of(AIM, None, sweep.theta[:3], sweep.beta[:3] + 1e-3)
    found = judged(other, sweep.joints[:3])
    assert found.rcm_error.max() < 1e-8
    assert set(found.status) == {Status.REACH}


def test_starts_lie_within_limits_and_are_spread():
    task = needle_task(Robot.bundled("laparoscopic").chain(), (0.0, 0.0, 1.0))
    q = starts(task, 64)
    assert (q >= task.chain.lower).all()
    assert (q <= task.chain.upper).all()
    shares = (q - q.min(axis=0)) / np.ptp(q, axis=0)
    assert (np.histogram2d(shares[:, 0], shares[:, 1], bins=3)[0] > 0).all()


def test_solved_postures_stay_within_limits():
    task = needle_task(UR3, NEEDLE.axis)
    row = np.tile(AIM.rows(deg([35.0]), deg([270.0])), (32, 1))
    lower, upper = np.full(6, -2.9), np.full(6, 2.9)
    q, held, _ = solved(Bounded(task, lower, upper), starts(task, 32), row)
    assert held.any()
    assert (q >= lower).all()
    assert (q <= upper).all()
    theta, beta = np.full(32, deg(35.0)), np.full(32, deg(270.0))
    assert checked(AIM, q, theta, beta).rcm_error[held].max() < 1e-8


@pytest.fixture(scope="module")
def angle_map():
    """Rings about the lesion, for the UR3."""
    return safe_angle_map(AIM, deg([10.0, 35.0, 55.0, 60.0]), deg(np.arange(0, 360, 30)))


def test_the_map_agrees_with_planned_sweeps(angle_map):
    assert {Status.SAFE, Status.REACH, Status.INSIDE} <= {kind for kind, _ in angle_map.counts()}
    ring = angle_map.safe[1]
    found = plan_sweep(AIM, angle_map.theta[1], angle_map.beta[ring])
    assert (np.isfinite(found.joints).all(axis=1)).sum() >= ring.sum() - 1
    assert angle_map.rcm_error[angle_map.safe].max() < 1e-5
    assert np.isnan(angle_map.joints[angle_map.status == Status.REACH]).all()


def test_every_status_of_the_map_has_its_reason(angle_map):
    for status, words in zip(angle_map.status.ravel(), angle_map.reasons.ravel(), strict=True):
        assert (words == "safe") == (status == Status.SAFE)
    assert "angles safe" in angle_map._repr_html_()


def test_a_cone_is_safe_all_around():
    aim = Aim(UR5, placed(), LESION, NEEDLE, PHANTOM)
    found = safe_angle_map(aim, deg([5.0, 15.0, 60.0]), deg(np.arange(0, 360, 45)))
    assert found.safe[2].any()
    assert not found.safe[2].all()
    assert found.cone == found.theta[1]
    far = safe_angle_map(Aim(UR3, placed(x=2.0), LESION, NEEDLE), deg([5.0]), deg([0.0]))
    assert np.isnan(far.cone)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Needle(0.0, 0.15), "length: found 0, expected more than 0"),
        (lambda: Needle(0.4, -0.1), "standoff: found -0.1, expected more than 0"),
        (lambda: Needle(float("nan"), 0.1), "length: found nan, expected a finite number"),
        (lambda: Needle(401.0, 150.0), "at most 5 m; give metres, not mm"),
        (lambda: Needle(0.4, 0.1, axis=(0, 0, 0)), "needle axis = 0 0 0"),
        (lambda: Aim(UR3, placed(), (0.05, np.nan, 0.06), NEEDLE), r"lesion: nan at \(1,\)"),
        (lambda: Aim(UR3, placed(), (0.05, 0.06), NEEDLE), r"shape \(2,\), \(3,\) expected"),
        (lambda: Aim(UR3, placed(), (0.5, 0.1, 0.05), NEEDLE, PHANTOM), "outside of the body"),
        (lambda: Aim(UR3, placed(), 1e3 * np.array(LESION), NEEDLE), "metres, not mm"),
        (lambda: Aim(UR3, np.eye(4) + np.eye(4, k=3) * 350, LESION, NEEDLE), "lesion 350 m from"),
        (lambda: Aim(UR3, np.diag([1.0, 1, -1, 1]), LESION, NEEDLE), "a mirror"),
        (lambda: Aim(UR3, placed().T, LESION, NEEDLE), r"last row \[.*; transpose it"),
        (lambda: Aim(UR3, 1.1 * placed(), LESION, NEEDLE), "off a rotation by 2.1e-01"),
        (
            lambda: Aim(Robot.from_dh([{"a": 0.3}] * 3).chain(), placed(), LESION, NEEDLE),
            "arm of 3 joints: at least 5 needed",
        ),
        (lambda: Box((0, 0, 0), (1, 1, 0)), "box z: lower 0 m is not below upper 0 m; swap"),
        (lambda: Cylinder((0, 0, 0), -1.0, 1.0), "radius: found -1, expected more than 0"),
        (lambda: plan_sweep(AIM, 10.0, 0.5), "theta = 10 rad: 0 to 1.571 rad expected; give radi"),
        (lambda: plan_sweep(AIM, -0.1, 0.5), "theta = -0.1 rad"),
        (lambda: plan_sweep(AIM, 0.1, 45.0), "beta = 45 rad"),
        (lambda: plan_sweep(AIM, np.nan, 0.0), "theta = nan rad"),
        (lambda: plan_sweep(AIM, [0.1, 0.2], [0.1, 0.2, 0.3]), "shapes that broadcast"),
        (lambda: plan_sweep(AIM, [], []), "at least 1 expected"),
        (lambda: safe_angle_map(AIM, [0.3, 0.2], [0.0]), "ascending"),
        (lambda: PointingOptions(longest_step=0.0), "longest_step: found 0, expected more than 0"),
        (lambda: PointingOptions(branches=0), "branches: found 0, expected at least 1"),
        (lambda: plan_sweep(AIM, 0.5, 4.5, PointingOptions(limit_margin=9.0)), "nothing is left"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(make, words):
    with pytest.raises(PlumblineError, match=words) as refusal:
        make()
    assert "\n" not in str(refusal.value)
