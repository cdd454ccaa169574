"""A problem is a statement: frozen, and refused where it contradicts itself."""

import dataclasses
import re

import casadi as cs
import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.parameters import Parameter
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Problem
from plumbline.optim.measurement.observation import build_model
from tests.benches import bench, residuals


def line(**given):
    """y = a + b t, one measured y a row."""
    x, row = cs.SX.sym("x", 2), cs.SX.sym("row", 2)
    t = np.linspace(0.0, 1.0, 5)
    parts = {
        "x": x,
        "names": ("a", "b"),
        "lower": np.full(2, -9.0),
        "upper": np.full(2, 9.0),
        "scale": np.ones(2),
        "residual": x[0] + x[1] * row[0] - row[1],
        "row": row,
        "rows": np.column_stack([t, 1.0 + 2.0 * t]),
        "weights": np.ones(5),
    }
    return Problem(**{**parts, **given})


def test_a_problem_knows_its_size():
    problem = line()
    assert (problem.size, problem.equations) == (2, 1)
    assert problem.shared.numel() == 0
    assert problem.constraints.numel() == 0


def test_rows_without_weights_count_all_alike():
    x, row = cs.SX.sym("x"), cs.SX.sym("row")
    free = np.full(1, np.inf)
    stated = Problem(x, ("x",), -free, free, np.ones(1), x - row, row, np.array([[1.0], [3.0]]))
    assert Mapped(stated).gram(np.zeros(1)).square == pytest.approx(10.0)


def test_bounds_that_contradict_each_other_are_refused():
    words = "^b: lower bound 2.0 exceeds upper bound 1.0; swap them$"
    with pytest.raises(ValueError, match=words):
        line(lower=np.array([0.0, 2.0]), upper=np.array([1.0, 1.0]))


def test_a_problem_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        line().rows = np.empty((0, 2))


def test_other_rows_are_a_copy_with_unit_weights():
    problem = line(weights=np.full(5, 3.0))
    other = problem.on(problem.rows[:2])
    np.testing.assert_array_equal(other.weights, [1.0, 1.0])
    np.testing.assert_array_equal(problem.on(problem.rows[:1], np.array([4.0])).weights, [4.0])
    assert other.x is problem.x
    assert len(problem.rows) == 5


def test_a_model_s_unknowns_are_the_nuisances_and_then_the_effects():
    recording = bench("ur5", "tip_position")
    effects = [REGISTRY["joint_offset"](joint=2), REGISTRY["base_drift"](end=90.0, turning=False)]
    model = build_model(recording, effects)
    assert model.problem.names == (
        *("frame x", "frame y", "frame z", "frame rx", "frame ry", "frame rz"),
        *("tool x", "tool y", "tool z"),
        "joint_offset 2 offset",
        *(f"base_drift {c} [turning=False, start=0.0, end=90.0, rate=0.0]" for c in "xyz"),
    )
    assert model.fixed == 9
    assert [term.columns for term in model.terms] == [slice(9, 10), slice(10, 13)]


def test_no_two_unknowns_share_a_name():
    ripple = REGISTRY["gear_ripple"]
    effects = [ripple(joint=3, order=order) for order in (17.0, 17.00001, 34.0)]
    names = build_model(bench("ur5", "tip_position"), effects).problem.names
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("observation", "given", "names"),
    [
        ("tip_position", {"always": ("tool",)}, ("tool x", "tool y", "tool z")),
        ("tip_position", {"always": ()}, ()),
        ("pose", {}, ("tool rx", "tool ry", "tool rz")),
        ("fixed_point", {}, ("socket 3 z", "tool x", "tool y", "tool z")),
        ("joint_position", {}, ()),
    ],
)
def test_nuisances_are_those_of_the_observation(observation, given, names):
    model = build_model(bench("ur5", observation, **given))
    assert model.problem.names[len(model.problem.names) - len(names) :] == names


@pytest.mark.parametrize("observation", ["tip_position", "pose", "joint_position"])
def test_a_perfect_recording_is_registered_without_a_residual(observation):
    assert np.abs(residuals(bench("ur5", observation))).max() < 1e-13


def test_a_fixed_point_s_residuals_are_those_about_its_sockets():
    """Each socket starts in the middle of its tips, so its residuals sum to nothing."""
    recording = bench("ur5", "fixed_point")
    apart = residuals(recording)
    for socket in range(4):
        np.testing.assert_allclose(apart[recording.socket == socket].mean(axis=0), 0, atol=1e-14)
    T = recording.chain.placement(recording.q)
    tips = T[:, :3, :3] @ recording.tool_offset + T[:, :3, 3]
    centre = np.array([tips[recording.socket == k].mean(axis=0) for k in range(4)])
    np.testing.assert_allclose(apart, tips - centre[recording.socket], atol=1e-13)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"lower": 1.0, "upper": 2.0, "scale": 1.0, "doc": "gain"},
            "Parameter 'gain': null 0.0 is outside of its bounds 1.0 <= x <= 2.0; widen the bounds",
        ),
        (
            {"lower": -1.0, "upper": 2.0, "scale": 0.0, "doc": "gain"},
            "Parameter 'gain': scale 0.0 must be > 0",
        ),
    ],
)
def test_a_parameter_that_contradicts_itself_is_refused(given, words):
    with pytest.raises(ValueError, match=f"^{re.escape(words)}$"):
        Parameter("1", **given)
