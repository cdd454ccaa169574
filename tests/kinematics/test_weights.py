"""Laws of effects far out of the noise: weights, drives and axes are not what the model says."""

from dataclasses import replace

import numpy as np
import pytest

import plumbline
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.weights import bodies_beyond
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior, block_evidence
from plumbline.optim.diagnosis.posterior.pool import make_pool, size_odds
from plumbline.optim.diagnosis.prior import LOG_SCALE_WEIGHTS, SCALES
from plumbline.optim.measurement.observation import build_model, scope_of
from tests.benches import TOOL, bench, measured, readings, residuals
from tests.kinematics.test_effect_physics import encoders, gravity_torques, predicted

ROWS = (
    {"d": 0.3, "alpha": 1.57, "mass": 9.0, "com": [0.02, -0.1, 0.05]},
    {"a": 0.5, "mass": 7.0, "com": [-0.2, 0.03, 0.0]},
    {"a": 0.4, "alpha": 1.2, "mass": 4.0, "com": [-0.2, 0.0, 0.04]},
    {"d": 0.1, "alpha": -1.57, "mass": 2.0, "com": [0.0, 0.03, 0.05]},
    {"d": 0.2, "mass": 1.0, "com": [0.02, 0.0, -0.06]},
)
MORE = np.array([0.1, -0.08, 0.12, -0.15, 0.07])  # shares by which the bodies weigh more
GIVING = {
    ("joint_compliance", "joint", 2): 3e-5,
    ("joint_tilt", "joint", 2): 2e-5,
    ("link_flex", "link", 2): 4e-5,
    ("base_compliance", None, 1): 2e-5,
}


def arm(more=0.0):
    """An arm whose bodies weigh so much more than they should (5,)."""
    grown = np.broadcast_to(1.0 + np.asarray(more), 5)
    rows = [{**row, "mass": row["mass"] * s} for row, s in zip(ROWS, grown, strict=True)]
    return Robot.from_dh(rows)


def with_bodies(key, recording):
    """Forms of an effect of an element in which each body counts by its own share."""
    name, field, element = key
    own = {field: element} if field else {}
    return REGISTRY[name](**own).deviations(scope_of(recording), [GIVING[key]])


@pytest.mark.parametrize("key", GIVING, ids=lambda key: key[0])
def test_what_gives_way_by_shares_is_the_plain_effect_of_an_arm_of_those_masses(key):
    compliance = GIVING[key]
    as_stated, heavier = (bench(arm(m), "pose", columns=[]) for m in (0.0, MORE))
    [effect] = [e for e in with_bodies(key, as_stated) if len(e.found) == 1]
    values = [compliance, *(compliance * MORE[k - 1] for k, _ in effect.bodies)]
    found = residuals(as_stated, [effect], values)
    expected = residuals(heavier, [effect.plain], [compliance])
    moved = np.abs(expected - residuals(as_stated, [effect.plain], [compliance])).max()
    np.testing.assert_allclose(found, expected, atol=1e-6 * moved)
    assert moved > 1e-6


@pytest.mark.parametrize("key", GIVING, ids=lambda key: key[0])
def test_a_body_is_known_to_a_tenth_of_its_mass(key):
    """Whatever the effect is usually: its size is the one that was found."""
    for effect in with_bodies(key, bench(arm(), "tip_position", columns=[])):
        count = len(effect.bodies)
        own, others = effect.parameters[:-count], effect.parameters[-count:]
        about = sum(p.scale for p in own if p.unit == own[0].unit)
        about /= len(own) if effect.name == "base_compliance" else 1
        assert about == pytest.approx(GIVING[key])
        assert [p.name for p in others] == [f"body_{k}" for k, _ in effect.bodies]
        np.testing.assert_allclose([p.scale for p in others], 0.1 * about)
        np.testing.assert_allclose([(p.lower, p.upper) for p in others], [(-about, about)] * count)
        assert "do not weigh what the model says" in effect.variant
        assert effect.plain is not None
        assert not effect.plain.bodies


@pytest.mark.parametrize("key", GIVING, ids=lambda key: key[0])
def test_a_body_whose_mass_is_assumed_may_weigh_half_as_much_again_or_half(key):
    """Links of real arms weigh what their length says to some six tenths."""
    unknown = Robot.from_dh([{k: v for k, v in row.items() if k != "mass"} for row in ROWS])
    recording = bench(unknown, "tip_position", columns=[])
    assert not recording.chain.has_masses
    for effect in with_bodies(key, recording):
        others = effect.parameters[-len(effect.bodies) :]
        np.testing.assert_allclose([p.scale / p.upper for p in others], 0.58)


def test_one_body_alone_has_no_share_of_its_own():
    chain = arm().chain()
    assert [k for k, _ in bodies_beyond(chain, 4)] == [4, 5]
    assert bodies_beyond(chain, 5) == ()
    last = REGISTRY["joint_compliance"](joint=5)
    assert not last.deviations(scope_of(bench(arm(), "tip_position")), [1e-5])


@pytest.mark.parametrize("key", GIVING, ids=lambda key: key[0])
def test_what_was_found_to_be_nothing_deviates_by_nothing(key):
    name, field, element = key
    effect = REGISTRY[name](**({field: element} if field else {}))
    assert not effect.deviations(scope_of(bench(arm(), "tip_position", columns=[])), [0.0])


def test_a_stiffening_drive_under_other_weights_twists_by_both():
    recording = bench(arm(), "joint_position", columns=[])
    key = ("joint_compliance", "joint", 2)
    [plain, both] = with_bodies(key, recording)
    assert (plain.stiffening, both.stiffening) == (False, True)
    own = [1e-6 * k for k in range(len(both.bodies))]
    one = encoders(recording, both.plain, 3e-5, 1e-7) - recording.q
    other = encoders(recording, plain, 0.0, *own) - recording.q
    np.testing.assert_allclose(
        encoders(recording, both, 3e-5, 1e-7, *own) - recording.q, one + other, atol=1e-13
    )


@pytest.mark.parametrize("key", [k for k in GIVING if k[0] in {"base_compliance", "joint_tilt"}])
def test_an_uneven_mounting_or_housing_under_other_weights_tilts_by_both(key):
    recording = bench(arm(), "tip_position", columns=[])
    alike, uneven = sorted(with_bodies(key, recording), key=lambda e: not e.alike)
    assert not uneven.alike
    c, d = [2e-7] * len(uneven.found), [1e-8 * k for k in range(len(uneven.bodies))]
    one = predicted(recording, uneven.plain, *c) - recording.measured
    other = predicted(recording, alike, 0.0, *d) - recording.measured
    both = predicted(recording, uneven, *c, *d) - recording.measured
    np.testing.assert_allclose(both, one + other, atol=1e-4 * np.abs(both).max())


def test_a_form_about_a_fit_is_not_paid_for_its_size():
    """Its share is what the plain form's widths say of that size: with it both are as probable."""
    usual = REGISTRY["link_flex"](link=2, load=100.0)
    scope = scope_of(bench(arm(), "tip_position", columns=[]))
    for size in (1e-6, 1e-5, 2e-4):
        [form] = usual.deviations(scope, [size])
        each = SCALES * usual.parameters[0].scale
        density = np.exp(LOG_SCALE_WEIGHTS) @ (np.exp(-0.5 * (size / each) ** 2) / each)
        known = np.exp(-0.5) / size
        assert size_odds(form) == pytest.approx(np.log(density / known))
    assert size_odds(usual) == 0.0


@pytest.mark.parametrize("name", ["link_flex", "joint_compliance", "base_compliance", "payload"])
def test_forms_about_a_fit_have_together_what_their_plain_form_has_without_them(name):
    """Or an effect would gain by being made more of: what is unlisted had lost half to it."""
    recording = bench(arm(), "tip_position", columns=[])
    kind = REGISTRY[name]
    usual = kind.candidates(scope_of(recording))[0]

    def shares(*chosen):
        fitted = build_model(recording, chosen)
        x = np.append(fitted.start[: fitted.fixed], [1e-5] * (len(fitted.start) - fitted.fixed))
        folds = np.arange(len(recording)) % 2
        found = make_pool(fitted, x, folds, NoisePrior.of(1e-4), library=[kind]).candidates
        own = [c for c in found if (c.effect.plain or c.effect) == usual]
        return len(own), sum(np.exp(c.log_prior - size_odds(c.effect)) for c in own)

    few, alone = shares()
    more, both = shares(usual)
    assert more > few
    assert both == pytest.approx(alone)


def test_a_width_that_is_known_is_not_tried_within_a_decade():
    usual = REGISTRY["link_flex"](link=2)
    [form] = usual.deviations(scope_of(bench(arm(), "tip_position", columns=[])), [1e-5])
    free, known = (Candidate(e, np.arange(len(e.parameters)), 0.0) for e in (usual, form))
    assert (free.widths == SCALES).all()
    assert (known.widths == 1.0).all()
    block, b = np.eye(1)[None] * 40.0, np.array([[30.0]])
    noise = NoisePrior.of(1.0)
    tried = block_evidence(block, b, 60.0, 30.0, noise)[0]
    once = block_evidence(block, b, 60.0, 30.0, noise, widths=known.widths)[0]
    np.testing.assert_allclose(once, tried[np.argmin(np.abs(np.log(SCALES)))])


def test_a_payload_twists_each_drive_by_its_own_share():
    recording = bench("laparoscopic", "joint_position", columns=[])
    [uneven] = REGISTRY["payload"]().deviations(scope_of(recording), [7.0])
    slides = [j for j, kind in enumerate(recording.chain.kinds, 1) if kind == "prismatic"]
    assert slides
    assert not set(slides) & set(uneven.drives)
    none, laden = (
        gravity_torques(recording.chain, recording.q, np.full(len(recording), mass))
        for mass in (0.0, 1.0)
    )
    own = np.linspace(-1.0, 1.0, len(uneven.drives))
    felt = np.zeros(recording.chain.n)
    felt[np.array(uneven.drives) - 1] = 7.0 + own
    expected = recording.q - 2e-5 * felt * (laden - none)
    np.testing.assert_allclose(encoders(recording, uneven, 7.0, *own), expected, atol=1e-13)
    assert uneven.parameters[0].scale == 7.0
    np.testing.assert_allclose([p.scale for p in uneven.parameters[1:]], 0.3 * 7.0)
    assert uneven.plain == REGISTRY["payload"]()
    assert not REGISTRY["payload"]().deviations(scope_of(recording), [0.0])


def test_a_needle_whose_axis_is_a_little_off_bends_across_its_own():
    """To first order: what a lean of 0.01 leaves is of its square."""
    recording = bench("ur5", "tip_position")
    straight = REGISTRY["needle_bending"].candidates(scope_of(recording))[0]
    [askew] = straight.neighbours(scope_of(recording))
    off = TOOL / np.linalg.norm(TOOL)
    side = np.cross(off, [1.0, 0.0, 0.0])
    leaning = off + 0.01 * side / np.linalg.norm(side)
    leaning /= np.linalg.norm(leaning)
    c = 1e-4
    expected = predicted(recording, replace(straight, axis=tuple(leaning)), c)
    plain = predicted(recording, straight, c)
    A = np.stack(
        [
            (predicted(recording, askew, 0.0, *unit) - recording.measured).ravel()
            for unit in np.eye(2)
        ]
    )
    lean = np.linalg.lstsq(A.T, (expected - plain).ravel(), rcond=None)[0]
    assert np.linalg.norm(lean) == pytest.approx(0.01 * c, rel=1e-3)
    left = expected - predicted(recording, askew, c, *lean)
    assert np.abs(left).max() < 0.03 * np.abs(expected - plain).max()
    assert {p.scale for p in askew.parameters[1:]} == {0.06 * askew.parameters[0].scale}


def test_a_pair_whose_disparity_is_off_errs_from_the_device_itself():
    """z = b f / d: with d off by a constant the point moves along its line of sight by k z."""
    recording = bench("ur5", "tip_position", columns=[])
    found = REGISTRY["sensor_distortion"].candidates(scope_of(recording))
    pair = next(e for e in found if e.kind == "depth" and e.right_at == 0.0)
    y, base_line_by_focus, off = recording.measured, 0.1, 1e-6
    z = base_line_by_focus / (base_line_by_focus / y[:, 2] + off)
    expected = y * (z / y[:, 2])[:, None]
    seen = predicted(recording, pair, -off / base_line_by_focus)
    np.testing.assert_allclose(seen, expected, atol=1e-4 * np.abs(expected - y).max())


def test_masses_that_are_a_tenth_off_make_no_second_cause():
    """A bearing that tilts by thirty times the noise, of an arm that its file weighs wrongly."""
    rng, robot = np.random.default_rng(3), arm()
    q = readings(robot.chain(), 100)
    heavier, tilts = arm(MORE), REGISTRY["joint_tilt"](joint=2)
    truth = bench(heavier, "tip_position", q=q, columns=[])
    seen = predicted(truth, tilts, 2e-5)
    sigma = float(np.sqrt(np.mean((seen - truth.measured) ** 2))) / 30.0
    seen = seen + rng.normal(0.0, sigma, seen.shape)
    assert np.allclose(truth.measured, measured(robot.chain(), q, "tip_position"))
    stated = bench(robot, "tip_position", q=q, columns=[], noise_std=sigma)
    found = plumbline.diagnose(replace(stated, measured=seen)).verdict
    assert [c.label for c in found.causes] == ["joint_tilt of joint 2"]
    assert found.causes[0].probability > 0.95
    assert found.outside_probability < 0.05
