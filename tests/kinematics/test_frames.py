"""Rotations and transforms in symbols against SciPy, and their smoothness at the identity."""

import casadi as cs
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from plumbline.kinematics.frames import (
    Transform,
    axis_rotation,
    constant,
    homogeneous,
    quaternion_rotation,
    rotation,
    unskew,
)

W = cs.SX.sym("w", 3)
EXP = cs.Function("exp", [W], [cs.densify(rotation(W))])
FIRST = cs.Function("first", [W], [cs.densify(cs.jacobian(rotation(W), W))])
SECOND = cs.Function("second", [W], [cs.densify(cs.jacobian(cs.jacobian(rotation(W), W), W))])


def values(function, vectors):
    """A function of w at many w (N, 3), as (N, rows, columns)."""
    rows, columns = function.size_out(0)
    flat = function.map(len(vectors))(np.transpose(vectors)).full()
    return flat.reshape(rows, len(vectors), columns).transpose(1, 0, 2)


def directions(count, seed=0):
    """Random unit vectors (count, 3)."""
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


ANGLES = (0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.009999, 0.010001, 0.1, 1.0, 3.0)
ANGLES += (np.pi - 1e-8, np.pi, np.pi + 1e-8, 4.0, 2 * np.pi - 1e-9, 2 * np.pi, 20.0)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_rotation_agrees_with_scipy(angle):
    vectors = angle * directions(200)
    expected = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(values(EXP, vectors), expected, rtol=0, atol=5e-14)


def test_random_rotations_agree_with_scipy_and_are_rotations():
    vectors = np.random.default_rng(1).normal(0, 2, (1000, 3))
    R = values(EXP, vectors)
    np.testing.assert_allclose(R, Rotation.from_rotvec(vectors).as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (1000, 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-14)


def test_a_rotation_is_the_matrix_exponential():
    for vector in np.random.default_rng(2).normal(size=(20, 3)):
        expected = expm(np.cross(vector, np.eye(3)).T)
        np.testing.assert_allclose(EXP(vector).full(), expected, atol=1e-13)


def test_at_zero_the_value_is_the_identity_and_the_slopes_are_the_generators():
    zero = np.zeros(3)
    np.testing.assert_array_equal(EXP(zero).full(), np.eye(3))
    first = FIRST(zero).full().reshape(3, 3, 3).transpose(1, 0, 2)
    generators = np.stack([np.cross(e, np.eye(3)).T for e in np.eye(3)], axis=-1)
    np.testing.assert_array_equal(first, generators)


def test_at_zero_the_curvature_is_that_of_the_series():
    """exp(w) = I + [w] + [w]^2 / 2 + ..., so d2/dwi dwj = ([ei][ej] + [ej][ei]) / 2."""
    G = [np.cross(e, np.eye(3)).T for e in np.eye(3)]
    expected = np.array([[(a @ b + b @ a) / 2 for b in G] for a in G])
    second = SECOND(np.zeros(3)).full().reshape(3, 3, 3, 3)
    np.testing.assert_allclose(second, expected.transpose(0, 3, 2, 1), atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.00999, 0.01001, 0.5, 3.1, 3.2])
def test_slopes_and_curvatures_agree_with_finite_differences(angle):
    h = 1e-4
    for w in angle * directions(3):
        for k, step in enumerate(h * np.eye(3)):
            slope = (EXP(w + step) - EXP(w - step)).full() / (2 * h)
            np.testing.assert_allclose(
                FIRST(w).full()[:, k].reshape(3, 3).T, slope, atol=1e-8, err_msg="first"
            )
            bend = (FIRST(w + step) - FIRST(w - step)).full() / (2 * h)
            second = SECOND(w).full()[:, k].reshape(3, 9).T
            np.testing.assert_allclose(second, bend, atol=1e-8, err_msg="second")


def test_nothing_jumps_where_the_series_takes_over():
    direction = directions(1)[0]
    below, above = (
        values(f, [0.01 * (1 + s) * direction for s in (-1e-9, 1e-9)]) for f in (EXP, FIRST)
    )
    np.testing.assert_allclose(below[0], below[1], atol=1e-10)
    np.testing.assert_allclose(above[0], above[1], atol=1e-10)
    second = values(SECOND, [0.01 * (1 + s) * direction for s in (-1e-9, 1e-9)])
    np.testing.assert_allclose(second[0], second[1], atol=1e-9)


def test_an_axis_rotation_is_the_rotation_about_that_axis():
    angle = cs.SX.sym("angle")
    for axis in [*directions(20), [1, 0, 0], [0, -1, 0]]:
        function = cs.Function("R", [angle], [axis_rotation(axis, angle)])
        for value in (-4.0, -1e-9, 0.0, 0.3, np.pi, 7.0):
            expected = Rotation.from_rotvec(value * np.asarray(axis)).as_matrix()
            np.testing.assert_allclose(function(value).full(), expected, atol=1e-14)


def test_a_quaternion_rotates_as_scipy_s_does():
    q = cs.SX.sym("q", 4)
    function = cs.Function("R", [q], [quaternion_rotation(q)])
    for R in Rotation.random(50, random_state=3):
        scalar_first = R.as_quat()[[3, 0, 1, 2]]
        np.testing.assert_allclose(function(scalar_first).full(), R.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(function(-scalar_first).full(), R.as_matrix(), atol=1e-14)


def test_unskew_is_the_axis_times_the_sine():
    function = cs.Function("u", [W], [unskew(rotation(W))])
    for w in np.random.default_rng(4).normal(size=(50, 3)):
        angle = np.linalg.norm(w)
        np.testing.assert_allclose(
            function(w).full().ravel(), np.sin(angle) * w / angle, atol=1e-14
        )


def test_a_constant_s_rounding_errors_are_structural_zeros():
    matrix = np.array([[1.0, 6e-17], [-1e-16, 2.0]])
    assert constant(matrix).nnz() == 2
    assert matrix[0, 1] == 6e-17
    np.testing.assert_array_equal(cs.DM(constant(matrix)).full(), np.diag([1.0, 2.0]))


def random_transforms(count, seed):
    """Numeric and symbolic transforms, side by side."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, random_state=seed).as_matrix()
    matrices = [homogeneous(R, rng.normal(size=3)) for R in turns]
    return matrices, [Transform.from_matrix(T) for T in matrices]


def numeric(T):
    """A constant transform as a matrix (4, 4)."""
    return homogeneous(cs.DM(T.R).full(), cs.DM(T.t).full())


def test_transforms_multiply_invert_and_map_points_as_matrices_do():
    (A, B, C), (a, b, c) = random_transforms(3, seed=5)
    p = np.array([0.3, -1.0, 2.0])
    np.testing.assert_allclose(numeric(a @ b @ c), A @ B @ C, atol=1e-14)
    np.testing.assert_allclose(numeric(a @ (b @ c)), numeric((a @ b) @ c), atol=1e-14)
    np.testing.assert_allclose(numeric(a.inverse()), np.linalg.inv(A), atol=1e-14)
    np.testing.assert_allclose(cs.DM(a.point(cs.SX(p))).full().ravel(), (A @ [*p, 1.0])[:3])
    np.testing.assert_array_equal(numeric(Transform.identity()), np.eye(4))
    np.testing.assert_array_equal(numeric(a @ Transform.identity()), A)


def test_a_twist_is_a_shift_and_a_turn():
    T = Transform.from_twist(cs.SX([1.0, 2.0, 3.0]), cs.SX([0.1, -0.7, 0.4]))
    R = Rotation.from_rotvec([0.1, -0.7, 0.4]).as_matrix()
    np.testing.assert_allclose(numeric(T), homogeneous(R, [1.0, 2.0, 3.0]), atol=1e-15)


def test_what_is_made_of_a_constant_leaves_others_like_it_as_they_are():
    one = constant(np.eye(2))
    one[0, 0] = 5.0
    np.testing.assert_array_equal(cs.DM(constant(np.eye(2))).full(), np.eye(2))
