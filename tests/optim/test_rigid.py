"""One rigid match for all: the best by SciPy, many at once, and nowhere written twice."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import plumbline
from plumbline.optim.rigid import best_rotation, nearest_rotation, rigid_match

# Timed as a controller would write it in plain NumPy; reality shares no code with the library.
PLAIN = {"registration_trial.py", "tip_readings.py"}


def clouds(seed, n, count=1):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(count, n, 3))
    R = Rotation.random(count, random_state=rng).as_matrix()
    b = a @ np.swapaxes(R, 1, 2) + rng.normal(size=(count, 1, 3))
    return a, b + rng.normal(0, 1e-2, b.shape)


@pytest.mark.parametrize("n", [3, 4, 50])
def test_a_match_is_scipys_best_rotation_about_the_middle(n):
    (a,), (b,) = clouds(n, n)
    T = rigid_match(a, b)
    wanted, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    np.testing.assert_allclose(T[:3, :3], wanted.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(T[:3, :3] @ a.mean(axis=0) + T[:3, 3], b.mean(axis=0), atol=1e-12)
    about_origin, _ = Rotation.align_vectors(b, a)
    np.testing.assert_allclose(best_rotation(a, b), about_origin.as_matrix(), atol=1e-12)


def test_many_matches_at_once_are_each_ones_own():
    a, b = clouds(1, 5, count=6)
    one_by_one = np.array([rigid_match(*pair) for pair in zip(a, b, strict=True)])
    np.testing.assert_allclose(rigid_match(a, b), one_by_one, atol=1e-14)
    shared = rigid_match(a.reshape(2, 3, 5, 3), b.reshape(2, 3, 5, 3))
    np.testing.assert_allclose(shared.reshape(6, 4, 4), one_by_one, atol=1e-14)


def test_a_mirror_image_is_never_matched_by_a_mirror():
    (a,), _ = clouds(2, 6)
    for mirrored in (-a, a * [1.0, 1.0, -1.0]):
        assert np.linalg.det(rigid_match(a, mirrored)[:3, :3]) == pytest.approx(1.0)
    assert np.linalg.det(nearest_rotation(-np.eye(3))) == pytest.approx(1.0)


def test_a_scale_is_found_only_where_it_is_asked_for():
    (a,), _ = clouds(3, 6)
    R = Rotation.random(random_state=4).as_matrix()
    b = 1.02 * a @ R.T + 0.3
    np.testing.assert_allclose(rigid_match(a, b, scale=True)[:3, :3], 1.02 * R, atol=1e-12)
    np.testing.assert_allclose(rigid_match(a, b)[:3, :3], R, atol=1e-12)


def test_the_rigid_match_is_written_once():
    root = Path(plumbline.__file__).parent
    signs = ("np.sign(np.linalg.det(U", "np.linalg.det(U @ Vt)", "np.linalg.det(U) *")
    found = {p.name for p in root.rglob("*.py") if any(s in p.read_text() for s in signs)}
    assert found == {"rigid.py", *PLAIN}
    assert not (root / "optim" / "registration" / "batch.py").exists()
