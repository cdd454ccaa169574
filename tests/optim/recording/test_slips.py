"""Slips undone: each is named by what it changes; what is left is of the best frame and tool."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from plumbline.optim.recording.from_a_row_on import matched
from plumbline.optim.recording.slips import (
    moved_zero,
    signs,
    swapped,
    swaps,
    turned_signs,
    zeros,
)

Q = np.random.default_rng(0).uniform(-2.0, 2.0, (9, 4))
SLIDE = (True, True, False, True)  # joint 3 slides


def test_each_slip_is_tried_once_and_changes_what_it_names():
    found = [*signs(Q), *zeros(Q, SLIDE), *swaps(Q)]
    assert len({slip.change for slip in found}) == len(found) == 4 + 3 * 3 + 6
    for slip in found:
        changed = np.flatnonzero(np.any(slip.q != Q, axis=0))
        assert all(f"q{j + 1}" in slip.change for j in changed)
        assert slip.change.count("q") == len(changed)
    assert not any("q3" in slip.change for slip in zeros(Q, SLIDE))


def test_a_slip_made_and_undone_is_none():
    np.testing.assert_array_equal(turned_signs(turned_signs(Q, [1, 3]), [1, 3]), Q)
    np.testing.assert_array_equal(swapped(swapped(Q, 0, 2), 2, 0), Q)
    np.testing.assert_allclose(moved_zero(moved_zero(Q, 1, 3), 1, 1), Q + 2 * np.pi * np.eye(4)[1])


@pytest.mark.parametrize("fit_tool", [True, False])
def test_what_is_left_is_least_squares(fit_tool):
    rng = np.random.default_rng(1)
    R, p = Rotation.random(20, rng=rng).as_matrix(), rng.normal(0.0, 0.3, (20, 3))
    F, d = Rotation.random(rng=rng).as_matrix(), np.array([0.03, -0.02, 0.05]) * fit_tool
    y = (p + R @ d) @ F.T + [1.0, -2.0, 0.5] + rng.normal(0.0, 1e-3, p.shape)

    def gaps(x):
        return (y - (p + R @ x[6:]) @ Rotation.from_rotvec(x[:3]).as_matrix().T - x[3:6]).ravel()

    start = np.concatenate([Rotation.from_matrix(F).as_rotvec(), [1.0, -2.0, 0.5], d])
    free = 9 if fit_tool else 6
    best = least_squares(lambda x: gaps(np.concatenate([x, d[free - 6 :]])), start[:free])
    assert np.sum(matched(R, p, y, fit_tool)[1] ** 2) == pytest.approx(2.0 * best.cost, rel=1e-6)
