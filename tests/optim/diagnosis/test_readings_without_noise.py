"""Laws of readings that a simulator wrote to the last digit: rounding is no gap and no unknown."""

from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.alternatives import spread_of_noise
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.recording.building import build_recording
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import causes

TOOL = (0.02, -0.03, 0.15)
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def exact(wrong=lambda q: q, digits=17, **given):
    """30 rows of a UR5 whose joints stand where ``wrong`` says, in ``digits`` digits."""
    robot = Robot.bundled("ur5")
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (30, 6))
    y = robot.chain().tips(wrong(q), TOOL) @ TURNED.T + [0.4, -0.3, 2.0]
    y = np.array([float(f"{value:.{digits}g}") for value in y.ravel()]).reshape(y.shape)
    return build_recording(
        observation="tip_position", robot=robot, q=q, measured=y, tool_offset=TOOL, **given
    )


@pytest.mark.parametrize("digits", [17, 6])
def test_a_robot_that_does_what_the_model_says_has_no_gap(digits):
    verdict = diagnose(exact(digits=digits), FEW_EFFECTS).verdict
    assert verdict.verdict == "no-gap"
    assert not verdict.causes


OFFSET = (lambda q: q + 2e-3 * np.eye(6)[2], ("joint_offset", 3))
SCALE = (lambda q: q * (1 + 1e-3 * np.eye(6)[1]), ("joint_scale", 2))


@pytest.mark.parametrize(
    ("wrong", "cause", "noise_std"), [(*OFFSET, None), (*OFFSET, 1e-6), (*SCALE, 1e-9)]
)
def test_the_only_cause_explains_readings_to_the_last_digit(wrong, cause, noise_std):
    found = diagnose(exact(wrong, noise_std=noise_std), FEW_EFFECTS)
    assert causes(found) == [cause]
    assert found.verdict.outside_probability < 0.2
    assert found.verdict.gap.after < 1e-9
    # Where no noise is stated, how small what is left would have to be is not known.
    assert found.verdict.verdict == ("explained" if noise_std else "partly-explained")


def test_rounding_is_as_large_on_every_axis_as_on_any_other():
    """Its true sizes say nothing, and a device that is unlike on its axes is a finding."""
    left = np.random.default_rng(0).normal(size=(30, 3)) * [1.0, 0.01, 0.1]
    pool = SimpleNamespace(noise=NoisePrior(), columns=lambda _: np.arange(0))
    none, empty = np.zeros(30, dtype=bool), np.empty((0, 30, 3))
    spreads = [
        spread_of_noise(
            pool,
            [],
            SimpleNamespace(
                target=size * left, base=empty, gross=none, live=np.ones(30, dtype=bool)
            ),
        )
        for size in (1e-13, 1e-4)
    ]
    np.testing.assert_array_equal(spreads[0], 1.0)
    assert spreads[1].max() > 1.5
