"""Laws of poses: trackers mounted in any way, and places and turns that err together."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.pose_noise import correlation_of_ways, in_one_noise, told_by
from plumbline.optim.measurement.refit import as_measured, in_noise
from plumbline.optim.measurement.uneven import rates
from tests.benches import bench

MARKERS = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.05, 0.18, 0.02]])
READ = 3e-5  # noise of a marker's axis, 1 sigma [m]


def remounted(recording, turn):
    """The same poses by a tracker that is turned on its tool."""
    seen = Rotation.from_quat(recording.measured[:, 3:], scalar_first=True)
    measured = recording.measured.copy()
    measured[:, 3:] = (seen * turn).as_quat(scalar_first=True)
    return replace(recording, measured=measured)


def by_markers(recording, rng):
    """The same poses as read off three markers, one of which is the origin."""
    R = Rotation.from_quat(recording.measured[:, 3:], scalar_first=True).as_matrix()
    seen = recording.measured[:, None, :3] + np.einsum("nij,mj->nmi", R, MARKERS)
    seen = seen + READ * rng.normal(size=seen.shape)
    measured = recording.measured.copy()
    measured[:, :3] = seen[:, 0]
    axes = axes_of(*np.moveaxis(seen, 1, 0)) @ axes_of(*MARKERS[:, None]).transpose(0, 2, 1)
    measured[:, 3:] = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    return replace(recording, measured=measured)


def axes_of(origin, first, second):
    x = (first - origin) / np.linalg.norm(first - origin, axis=1)[:, None]
    z = np.cross(x, second - origin)
    z /= np.linalg.norm(z, axis=1)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2)


@pytest.fixture(scope="module")
def poses():
    return bench("ur5", "pose")


@pytest.fixture(scope="module")
def exact(poses):
    """Poses without a gap or noise."""
    model = build_model(poses, [])
    T = poses.chain.placement(poses.q)
    quaternions = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
    tips = poses.chain.tips(poses.q, poses.tool_offset)
    assert model.recording is poses
    return replace(poses, measured=np.hstack([tips, quaternions]), noise_std=None)


@pytest.fixture
def spread():
    half = np.eye(6)
    half[1, 5] = half[5, 1] = -0.4
    return half


@pytest.mark.parametrize("angle", [0.0, 1.7, 2.6, 3.1])
def test_a_tracker_may_be_mounted_in_any_way(exact, angle):
    rng = np.random.default_rng(0)
    for axis in rng.normal(size=(4, 3)):
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        model = build_model(remounted(exact, turn), [])
        assert np.abs(Mapped(model.problem).residuals(model.start)).max() < 1e-9


def test_numbers_and_symbols_agree_on_what_one_noise_is(poses, spread):
    plain = Mapped(build_model(poses, []).problem)
    told = replace(poses, pose_spread=spread)
    mapped = Mapped(build_model(told, []).problem)
    x = build_model(poses, []).start + 1e-3
    np.testing.assert_allclose(
        mapped.residuals(x), in_noise(told, plain.residuals(x)), rtol=1e-9, atol=1e-15
    )
    np.testing.assert_allclose(
        as_measured(told, mapped.residuals(x)), plain.residuals(x), rtol=1e-9, atol=1e-15
    )


def test_what_a_clock_smears_is_in_units_of_the_same_noise(poses, spread):
    timed = replace(poses, time=np.arange(len(poses), dtype=float))
    np.testing.assert_allclose(
        rates(replace(timed, pose_spread=spread), 0.3),
        in_one_noise(replace(timed, pose_spread=spread), rates(timed, 0.3)),
    )


def errors_of(recording, rng, draws=1):
    """Residuals (draws N, 6) of the poses as read by markers, and their rows."""
    rows = recording.select(np.tile(np.arange(len(recording)), draws))
    read = by_markers(rows, rng)
    was, now = (Rotation.from_quat(r.measured[:, 3:], scalar_first=True) for r in (rows, read))
    turned = (now.inv() * was).as_rotvec()
    return rows, np.hstack([rows.measured[:, :3] - read.measured[:, :3], 0.1 * turned])


def test_the_noise_of_markers_is_told_and_gone(exact):
    rows, left = errors_of(exact, np.random.default_rng(0), draws=10)
    told = told_by(rows, left)
    assert told.odds > 100.0
    assert correlation_of_ways(told.spread) > 0.6
    left[:, 3:] *= told.lever
    white = in_one_noise(replace(rows, pose_spread=told.spread), left)
    again = told_by(rows, white)
    assert again.odds < 0.0
    assert np.sqrt(np.mean(white**2)) == pytest.approx(READ, rel=0.15)


def test_poses_of_one_noise_are_left_as_they_are(exact):
    rng = np.random.default_rng(0)
    assert all(told_by(exact, rng.normal(size=(len(exact), 6))).odds < 0.0 for _ in range(100))


@pytest.mark.parametrize(("rows", "told"), [(12, 0.0), (60, 1.0)])
def test_few_rows_tell_no_more_than_they_know(exact, rows, told):
    """The prior is worth a row: of twelve, six ways have two numbers each."""
    rng = np.random.default_rng(1)
    part = exact.select(np.arange(rows))
    odds = [told_by(part, errors_of(part, rng)[1]).odds > 0.0 for _ in range(20)]
    assert np.mean(odds) == pytest.approx(told, abs=0.2)


def test_the_prior_of_a_poses_noise_is_worth_one_row(exact):
    part = exact.select(np.zeros(6, dtype=np.intp))
    own = np.diag([2.0, 1.0, 1.0, 1.0, 1.0, 2.0])
    R = Rotation.from_quat(part.measured[0, 3:], scalar_first=True).as_matrix()
    left = np.hstack([own[:, :3] @ R.T, own[:, 3:]])
    C = np.linalg.matrix_power(told_by(part, left).spread, 2)
    S = np.square([2.0, 1.0]) / np.mean(own**2)
    assert C[0, 0] / C[1, 1] == pytest.approx((1.0 + S[0]) / (1.0 + S[1]))


def test_poses_that_markers_tell_have_no_gap_of_their_own(exact):
    turn = Rotation.from_rotvec([2.0, -0.5, 1.1])
    found = diagnose(by_markers(remounted(exact, turn), np.random.default_rng(0)))
    assert correlation_of_ways(found.recording.pose_spread) > 0.4
    assert not [c for c in found.causes if c.probability > 0.5]
    assert found.outside_probability < 0.5
