"""Laws of a ripple's curve: a joint's error over its angle, whose band holds the truth."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.report.diagnosis.causes import curves, with_curves
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.constants import POINTS
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.verdict.causes import _angles
from tests.benches import bench, readings

LIBRARY = tuple(REGISTRY[name] for name in ("transmission_ripple", "joint_offset"))


def error(q):
    """What is wrong with the joint [rad]."""
    return 8e-4 * np.sin(q + 0.3) + 5e-4 * np.cos(2.0 * q)


@pytest.fixture(scope="module")
def found():
    q = readings(Robot.bundled("ur5").chain(), 80)
    q[:, 2] = np.linspace(-3.0, 3.0, 80)
    recording = bench("ur5", "joint_position", q=q, columns=())
    link = np.array(q)
    link[:, 2] += error(q[:, 2])
    link += np.random.default_rng(3).normal(0.0, 1e-4, q.shape)
    recording = replace(recording, measured=link, noise_std=1e-4)
    return diagnose(recording, DiagnosisOptions(library=LIBRARY))


def test_the_band_of_a_ripple_holds_the_true_curve(found):
    [cause] = found.verdict.causes
    assert (cause.effect, cause.element) == ("transmission_ripple", 3)
    angle, value, std = (
        np.array(v) for v in (cause.curve.angle, cause.curve.value, cause.curve.std)
    )
    assert (angle[0], angle[-1]) == pytest.approx((-3.0, 3.0))
    deviation = (value - error(angle)) / std
    assert np.abs(deviation).max() < 4.0
    # Four numbers from 80 readings: on average their square over the noise's is 4 / 80.
    assert np.mean(std**2) == pytest.approx(1e-8 * 4 / 80, rel=0.3)


def test_a_curve_is_in_the_json_and_comes_back(found, tmp_path):
    found.verdict.save(tmp_path / "v.json")
    again = Verdict.load(tmp_path / "v.json")
    assert again.causes[0].curve == found.verdict.causes[0].curve
    told = found.verdict.to_dict()["causes"][0]["curve"]
    assert set(told) == {"angle", "value", "std"}
    assert len(told["angle"]) == len(told["value"]) == len(told["std"]) <= POINTS


def test_a_curve_has_a_picture(found):
    figure = curves(with_curves(found.verdict))
    assert len(figure.axes) == 1
    assert figure.axes[0].get_ylabel() == "mrad"


@pytest.mark.parametrize("order", [1.0, 20.0, 200.0])
def test_points_show_a_sine_s_shape_however_fast_it_is(order):
    angle = _angles(-3.0, 3.0, order)
    assert len(angle) <= POINTS
    assert np.diff(angle).max() * order <= 2 * np.pi / 8 * 1.001
    assert angle.mean() == pytest.approx(0.0, abs=1e-12)
