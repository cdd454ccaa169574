"""Laws of the start: whichever joints move, the nominal fit ends where it fits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.registering import registered
from tests.benches import bench

ROWS = 60


def recorded(kind, moved, length, seed, *, straight=False):
    """Exact readings of a UR5 some joints of which move, its tool and tracker anywhere."""
    rng = np.random.default_rng(seed)
    plain = replace(bench("ur5", kind), noise_std=None, tool_offset=np.zeros(3), group=None)
    q = np.tile(rng.uniform(-1.5, 1.5, 6), (ROWS, 1))
    q[:, [j - 1 for j in moved]] += rng.uniform(-1.5, 1.5, (ROWS, len(moved)))
    T = plain.chain.placement(q)
    R, X = Rotation.random(2, rng)
    X = Rotation.identity() if straight else X
    measured = R.apply(T[:, :3, :3] @ (length * rng.normal(size=3)) + T[:, :3, 3]) + 1.0
    if kind == "pose":
        seen = R * Rotation.from_matrix(T[:, :3, :3]) * X
        measured = np.hstack([measured, seen.as_quat(scalar_first=True)])
    return replace(plain, q=q, measured=measured, whole=None, place=None), R


@pytest.mark.parametrize("kind", ["pose", "tip_position"])
@pytest.mark.parametrize("length", [0.1, 0.5])
@pytest.mark.parametrize("moved", [(6,), (4, 5), (5, 6), (4, 5, 6), (1, 6), (1, 2, 3, 4, 5, 6)])
def test_the_nominal_fit_ends_at_nothing_whichever_joints_move(kind, length, moved):
    for seed in range(2):
        recording, _ = recorded(kind, moved, length, seed)
        model = build_model(recording, [])
        found = LevenbergMarquardt().solve(model.problem, model.start)
        assert np.abs(Mapped(model.problem).residuals(found.x)).max() < 1e-6


def test_a_frame_of_poses_with_a_known_tool_is_met_at_once_though_their_tips_stand_still():
    recording, R = recorded("pose", (4, 5, 6), 0.0, 0, straight=True)
    found = registered(replace(recording, always=("frame",)))
    np.testing.assert_allclose(found[:3, :3], R.as_matrix(), atol=1e-9)
