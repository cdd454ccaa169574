"""Laws of sides of approach that were written down the other way round."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.optim.diagnosis.diagnose import diagnose
from tests.benches import T_DEVICE_BASE, bench


@pytest.mark.parametrize(("sign", "said"), [(1.0, False), (-1.0, True)])
def test_a_play_of_less_than_nothing_asks_what_a_direction_means(sign, said):
    rng = np.random.default_rng(1)
    plain = bench("ur5", "tip_position", columns=[])
    q = rng.uniform(-2.0, 2.0, (120, 6))
    side = rng.choice([-1.0, 1.0], q.shape)
    true = q - 1.5e-3 * sign * side * (np.arange(6) == 1)
    measured = plain.chain.tips(true, plain.tool_offset) + T_DEVICE_BASE
    measured = measured + 1e-4 * rng.normal(size=measured.shape)
    recording = replace(
        plain, q=q, direction=side, measured=measured, noise_std=1e-4, whole=None, place=None
    )
    verdict = diagnose(recording).verdict
    assert any("direction2 is 1 where it came from below" in n for n in verdict.notes) == said
    assert bool(verdict.causes) != said
