"""A function over many rows says what it says of each."""

import casadi as cs
import numpy as np
import pytest

from plumbline.kinematics import evaluate
from plumbline.kinematics.evaluate import over_rows

X, ROW = cs.SX.sym("x", 2), cs.SX.sym("row", 3)
a, b, c = cs.vertsplit(ROW)
EVERY = cs.vertcat(
    a + b, a - b, a * b, a / c, -a, 1 / c, a + a, a * a, cs.sqrt(c), cs.exp(a), cs.log(c), c**b,
    c**3.5, cs.sin(a), cs.cos(a), cs.tan(a), cs.asin(a), cs.acos(a), cs.atan(a), cs.tanh(a),
    cs.atan2(a, b), cs.fabs(a), cs.sign(a), cs.floor(3 * a), cs.fmin(a, b), cs.fmax(a, b),
    cs.if_else(a < b, a, 2.0), cs.if_else(a <= b, cs.log(a), b), cs.if_else(a == b, a, 1.0),
    cs.if_else(a != b, a, 1.0), cs.if_else(cs.logic_and(a > 0, b > 0), 1.0, b),
    cs.if_else(cs.logic_or(a > 0, cs.logic_not(b > 0)), a, 7.0), X[0] * a + cs.sin(X[1]), 3.0,
)  # fmt: skip
ROWS = np.random.default_rng(1).uniform(-0.9, 0.9, (2101, 3)) + np.array([0.0, 0.0, 1.0])
SHARED = [0.3, -0.2]


@pytest.mark.parametrize("beyond", [0, cs.erf(a)], ids=["known", "of another operation"])
def test_columns_of_rows_say_what_every_row_says(beyond):
    function = cs.Function("f", [X, ROW], [EVERY + beyond, cs.densify(cs.jacobian(EVERY[:4], ROW))])
    assert (evaluate._program(function) is None) == isinstance(beyond, cs.SX)
    found = over_rows(function, ROWS, SHARED)
    assert [one.shape for one in found] == [(2101, 1, EVERY.numel()), (2101, 3, 4)]
    for k in (0, 1, 1999, 2000, 2100):
        one, slope = (value.full() for value in function(SHARED, ROWS[k]))
        np.testing.assert_allclose(found[0][k, 0], one[:, 0], rtol=1e-14)
        np.testing.assert_allclose(found[1][k].T, slope, rtol=1e-14)
