"""Stated errors hold where boards are bent, the arm is off and slanted beams have a bias."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.benches.hand_eye_coverage import measure
from plumbline.experiments.reality.arm import forward
from plumbline.experiments.reality.arms import vs060
from plumbline.experiments.reality.ranging.scene import as_built
from plumbline.optim.hand_eye import direct
from plumbline.optim.hand_eye.calibrate import HandEyeOptions, calibrate
from plumbline.optim.hand_eye.constants import BIAS_STD
from plumbline.optim.hand_eye.readings import Frames
from plumbline.optim.hand_eye.shapes import arm_shapes
from tests.ranging_scenes import CLEAN, surveyed, truth


@pytest.fixture(scope="module")
def coverage():
    return measure(seed=3, count=25)


def test_the_truth_lies_within_the_stated_errors(coverage):
    along, across, v = coverage["covered"]
    assert along >= 0.84
    assert min(across, v) >= 0.86


def test_without_the_arm_and_the_bias_in_the_model_it_does_not(coverage):
    assert coverage["covered, arm as drawn"][0] < 0.84


def test_the_bias_of_slanted_beams_is_r_along_the_beam():
    """No reading tells the two apart, so that the error along the beam is the prior's at least."""
    scene, _, readings = surveyed(0, CLEAN)
    slanted = scene.finder.v @ np.swapaxes(readings.R, 1, 2)
    normals = np.array([-board.normal for board in scene.boards])[readings.plane - 1]
    cosine = np.sum(slanted * normals, axis=1)
    longer = replace(readings, distance=readings.distance + 0.3e-3 * (1.0 / cosine - 1.0))
    found = calibrate(longer)
    gap = found.beam.r - scene.finder.r
    np.testing.assert_allclose(gap, 0.3e-3 * scene.finder.v, atol=2e-5)
    v = found.beam.v
    assert np.sqrt(v @ found.covariance[:3, :3] @ v) == pytest.approx(BIAS_STD, rel=0.05)
    plain = calibrate(longer, HandEyeOptions(bias=0.0))
    assert np.sqrt(v @ plain.covariance[:3, :3] @ v) < 0.1 * BIAS_STD


def test_a_stated_bias_is_what_the_error_along_the_beam_has():
    _, _, readings = surveyed(1)
    sizes = []
    for bias in (0.0, 0.5e-3, 2e-3):
        found = calibrate(readings, HandEyeOptions(bias=bias))
        sizes.append(found.beam.v @ found.covariance[:3, :3] @ found.beam.v)
    np.testing.assert_allclose(np.sqrt(np.diff([sizes[0], sizes[1]])), 0.5e-3, rtol=0.15)
    np.testing.assert_allclose(np.sqrt(np.diff([sizes[0], sizes[2]])), 2e-3, rtol=0.15)


def test_shapes_of_the_arm_leave_shift_and_tilt_to_the_planes():
    scene, _, readings = surveyed(0, CLEAN)
    frames = Frames.of(readings, truth(scene))
    points = truth(scene).points(readings.R, readings.t, readings.distance)
    found = arm_shapes(readings, frames, points, 12)
    assert found.shape == (180, 17)
    index = frames.index(readings)
    for k in range(3):
        places = (points[index == k] - frames.c[k]) @ frames.B[k][:, :2]
        flat = np.column_stack([np.ones(len(places)), places])
        assert np.abs(flat.T @ found[index == k, :12]).max() < 1e-8
        # The beam's own columns span one unit at most.
        assert np.ptp(found[index == k, 12:], axis=0).max() <= 1.0 + 1e-12
    assert arm_shapes(readings, frames, points, 0).shape == (180, 0)


def test_the_statement_has_bias_and_arm_as_it_says():
    scene, _, readings = surveyed(0, CLEAN)
    beam = truth(scene)
    frames = Frames.of(readings, beam)
    psi = np.random.default_rng(0).normal(size=(180, 2))
    problem = direct.state(readings, frames, None, psi, biased=True)
    x = direct.start(problem, beam, frames)
    x[[problem.names.index(n) for n in ("kappa", "g1", "g2")]] = [2e-3, 1e-3, -3e-3]
    from plumbline.optim.core.mapped import Mapped

    e = Mapped(problem).residuals(x)[:, 0]
    flat = Mapped(problem).residuals(direct.start(problem, beam, frames))[:, 0]
    cosine = np.cos(direct.incidence(readings, beam, direct.planes_of(x, frames)))
    wanted = -2e-3 * (1.0 - cosine) - psi @ [1e-3, -3e-3]
    np.testing.assert_allclose((e - flat)[:180], wanted, atol=1e-7)
    np.testing.assert_allclose(e[180:], [-2e-3, -1e-3, 3e-3], atol=1e-15)
    kinds = [direct.BIAS, direct.ARM, direct.ARM]
    assert direct.prior_kinds(problem).tolist() == kinds


def test_a_built_arm_is_off_by_as_much_as_asked():
    arm = vs060()
    other = as_built(arm, 0.34e-3, np.random.default_rng(0))
    q = np.random.default_rng(1).uniform(0.5 * arm.lower, 0.5 * arm.upper, (2000, 6))
    gaps = (forward(other, q) - forward(arm, q))[:, -1, :3, 3]
    assert np.sqrt(np.mean(np.sum(gaps**2, axis=1))) == pytest.approx(0.34e-3, rel=0.1)
