"""Of short recordings together the noise is what all of them leave, not what one alone lacks."""

import numpy as np
import pytest

import plumbline
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.diagnosis.options import DiagnosisOptions
from tests.several import SIGMA, recorded

ROWS = (10, 15, 21)  # of three reflectors on one flange
TOOLS = ((0.12, 0.0, 0.11), (0.12, 0.11, 0.0), (0.12, -0.11, 0.0))  # m


def worn(q):
    """Zeros of three joints that are off, and a wheel that is not round."""
    ripple = 1e-3 * np.sin(q[:, 1])
    off = np.array([0.0, 1e-3, -2e-3, 2e-3, 1e-2, 0.0])
    return off + ripple[:, None] * (np.arange(6) == 1)


@pytest.mark.parametrize("seed", [4])
def test_a_short_recording_weighs_by_the_noise_that_it_has_beside_the_others(seed):
    parts = [
        recorded(
            "tip_position",
            10 * seed + k,
            worn,
            rows=rows,
            tool=tool,
            noise_std=None,
            name=f"smr{k}",
        )
        for k, (rows, tool) in enumerate(zip(ROWS, TOOLS, strict=True), start=1)
    ]
    answer = plumbline.diagnose(parts, DiagnosisOptions(library=(JointOffset, TransmissionRipple)))
    assert next(c.label for c in answer.causes) == "joint_offset of joint 5"
    for one in answer.verdict.recordings:
        assert 0.5 * SIGMA < one.noise < 1.7 * SIGMA
