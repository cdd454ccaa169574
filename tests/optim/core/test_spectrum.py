"""A model that is carried on does not invent ripples where its recording holds no posture."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.link_geometry import LinkGeometry
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.posterior.spectrum import _Prior, as_spectra
from plumbline.optim.diagnosis.predict.held_out import refitted
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.building import build_recording

NOISE = 3e-5
ORDERS = np.arange(3, 31)


def recording(rows, seed, where, amplitudes, reach=1.2):
    """A UR5 whose first joint ripples; its postures are those with joint 1 ``where``."""
    rng = np.random.default_rng(seed)
    robot = Robot.bundled("ur5")
    q = rng.uniform(-reach, reach, (rows, 6)) + np.array([0, -1, 1, 0, 1, 0])
    q[:, 0] = rng.choice(where, rows)
    turned = q.copy()
    phases = q[:, :1] * ORDERS
    turned[:, 0] += np.sin(phases) @ amplitudes[0] + np.cos(phases) @ amplitudes[1]
    tips = robot.chain("flange").placement(turned)[:, :3, 3]
    tips = tips + NOISE * rng.standard_normal(tips.shape)
    return build_recording(
        observation="tip_position", robot=robot, q=q, measured=tips, noise_std=NOISE
    )


def fitted(data, effects):
    model = build_model(data, effects)
    return LevenbergMarquardt().solve(model.problem, model.start)


def rms(ended):
    residuals, _ = ended
    return np.sqrt((residuals**2).sum(axis=1).mean())


@pytest.fixture(scope="module")
def spectrum():
    rng = np.random.default_rng(4)
    return rng.standard_normal((2, len(ORDERS))) * 3e-4 / np.sqrt(ORDERS)


SEEN = np.concatenate([np.linspace(-2.0, -0.6, 2000), np.linspace(0.4, 1.0, 800)])
PICKED = tuple(GearRipple(joint=1, order=float(n)) for n in range(3, 31))


def test_a_spectrum_falls_back_to_nothing_where_no_posture_was_seen(spectrum):
    known = recording(700, 1, SEEN, spectrum)
    beyond = recording(300, 2, np.linspace(-0.5, 0.3, 500), spectrum)
    alike = recording(300, 3, SEEN, spectrum)
    free = fitted(known, PICKED)
    carried = as_spectra(known, PICKED, free)
    bare = rms(refitted(beyond, (), np.empty(0)))
    picked = rms(refitted(beyond, PICKED, free.x[-2 * len(PICKED) :]))
    held = rms(refitted(beyond, carried.effects, carried.values))
    assert picked > 1.5 * bare  # what the search's own choice would do there
    assert held < 1.1 * bare
    assert rms(refitted(alike, carried.effects, carried.values)) < 1.3 * np.sqrt(3) * NOISE


def test_a_model_of_few_ripples_is_carried_as_it_is(spectrum):
    known = recording(200, 1, SEEN, spectrum)
    few = (PICKED[0], TransmissionRipple(joint=1, order=1))
    fit = fitted(known, few)
    carried = as_spectra(known, few, fit)
    assert carried.effects == few
    np.testing.assert_array_equal(carried.values, fit.x[-2 * len(few) :])
    third = (*few, PICKED[1])
    assert len(as_spectra(known, third, fitted(known, third)).effects) > 40


def test_lengths_that_only_move_together_stay_where_the_fit_has_them(spectrum):
    """The UR5's axes 2 and 3 are parallel: of their offsets d the rows tell the sum alone."""
    known = recording(500, 1, SEEN, spectrum)
    others = (LinkGeometry(link=2, parallel=True), LinkGeometry(link=3, parallel=True))
    known = _displaced(known, others, [0.0, 0.0, 1e-4, 8e-5, 0.0, 0.0, -9e-5, 1e-4])
    effects = (*others, *PICKED)
    model = build_model(known, effects, ridge=[1e-5] * len(effects))
    fit = LevenbergMarquardt().solve(model.problem, model.start)
    carried = as_spectra(known, effects, fit)
    before = rms((fit.mapped.residuals(fit.x), None))
    assert rms(refitted(known, carried.effects, carried.values)) < 1.1 * before
    moved = carried.values[:8] - fit.x[model.fixed : model.fixed + 8]
    assert np.abs(moved).max() < 2e-3


def test_orders_of_other_joints_and_high_ones_stay(spectrum):
    known = recording(400, 1, SEEN, spectrum)
    others = (GearRipple(joint=2, order=17.0), GearRipple(joint=1, order=55.5))
    carried = as_spectra(known, (*others, *PICKED), fitted(known, (*others, *PICKED)))
    assert carried.effects[:2] == others
    whole = [e.order for e in carried.effects[2:] if isinstance(e, TransmissionRipple)]
    assert whole == list(range(1, 41))


def test_what_was_not_picked_is_carried_and_stays_nothing_where_rows_do_not_tell_it(spectrum):
    """A zero of joint 3 is found beside the spectrum; one that rows do not tell stays nothing."""
    known = recording(400, 1, SEEN, spectrum)
    zero, untold = JointOffset(joint=3), JointOffset(joint=6)
    known = _displaced(known, (zero,), [2e-4])
    carried = as_spectra(known, PICKED, fitted(known, PICKED))
    model, unknowns, _ = carried.whole
    values = {t.effect: unknowns[t.columns] for t in model.terms}
    assert values[zero][0] == pytest.approx(2e-4, rel=0.2)
    assert abs(values[untold][0]) < 1e-5
    restricted = as_spectra(known, PICKED, fitted(known, PICKED), (TransmissionRipple, GearRipple))
    assert zero not in restricted.effects
    assert not any(effect.remembers for effect in carried.effects)


def test_what_was_picked_where_the_arm_hardly_moved_does_not_mislead_where_it_does(spectrum):
    """Zeros of joints 2 to 5 are missing; scales and a coupling stand in for them near by."""
    zeros = tuple(JointOffset(joint=j) for j in (2, 3, 4, 5))
    near, far = (recording(300, k, SEEN, spectrum, reach) for k, reach in ((1, 0.25), (2, 1.2)))
    near, far = (_displaced(r, zeros, [4e-4, -3e-4, 5e-4, 4e-4]) for r in (near, far))
    picked = (JointScale(joint=2), JointScale(joint=3), JointCoupling(joint=5, by=4), *PICKED)
    free = fitted(near, picked)
    carried = as_spectra(near, picked, free)
    alone = free.x[-sum(len(e.parameters) for e in picked) :]
    held = rms(refitted(far, carried.effects, carried.values))
    assert held < 0.7 * rms(refitted(far, picked, alone))


def _displaced(known, effects, values):
    """The recording with effects besides."""
    model = build_model(known, effects)
    x = model.start.copy()
    x[model.fixed :] = values
    shifts = Mapped(model.problem).residuals(x) - Mapped(model.problem).residuals(model.start)
    return replace(known, measured=known.measured + shifts)


def test_an_unknown_at_its_bound_leaves_the_others_where_they_are_best():
    rng = np.random.default_rng(3)
    X = rng.standard_normal((200, 4))
    X[:, 1] = 0.8 * X[:, 0] + 0.3 * X[:, 1]
    y, s = X @ np.array([1.0, -0.6, 0.5, 0.2]), 0.01
    prior = _Prior(np.array([0, 0, 1, 1]), np.ones(4), np.ones(4))
    least = np.array([-9.0, 0.0, -9.0, -9.0])
    mean, _ = prior.most_probable(X.T @ X / s**2, X.T @ y / s**2, least, np.full(4, 9.0))
    best = lsq_linear(X, y, (least, 9.0)).x
    np.testing.assert_allclose(mean, best, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_widths_of_greatest_evidence_are_those_of_the_draw(seed):
    rng = np.random.default_rng(seed)
    family = np.repeat([0, 1], 60)
    widths = np.array([1e-4, 1e-5])
    truth = rng.standard_normal(120) * widths[family]
    X, sigma = rng.standard_normal((800, 120)), 4e-4
    y = X @ truth + sigma * rng.standard_normal(800)
    prior = _Prior(family, np.full(120, 15.0**-0.5), np.ones(120))
    none = np.full(120, np.inf)
    mean, _ = prior.most_probable(X.T @ X / sigma**2, X.T @ y / sigma**2, -none, none)
    free = np.linalg.lstsq(X, y, rcond=None)[0]
    small = family == 1
    assert np.linalg.norm((mean - truth)[small]) < np.linalg.norm((free - truth)[small])
    assert mean[~small].std() == pytest.approx(1e-4, rel=0.25)
    assert mean[small].std() < 1.5e-5
