"""pybotics as its documentation has it: all of chain, tool and world frame by SciPy."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pybotics.optimization import OptimizationHandler, compute_absolute_errors, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares

Array = NDArray[np.float64]
PACKAGE = "pybotics"


def dh(given: Mapping[str, Array]) -> Any:
    """The robot with what was found."""
    d, a, alpha, theta = given["dh"].T
    # Modified rows: a row begins with the twist and length that end the standard one before.
    mdh = np.column_stack([np.r_[0.0, alpha[:-1]], np.r_[0.0, a[:-1]], theta, d])
    robot = Robot.from_parameters(mdh)
    robot.tool.position = given["tool"]
    robot.world_frame = np.linalg.inv(given["frame"])
    handler = OptimizationHandler(
        robot,
        kinematic_chain_mask=[True] * robot.kinematic_chain.num_parameters,
        tool_mask=[True] * 3 + [False] * 3,
        world_mask=True,
    )
    start = handler.generate_optimization_vector()
    rows = (handler, given["q"], given["tips"])
    found = least_squares(optimize_accuracy, start, args=rows, x_scale="jac", max_nfev=50)
    handler.apply_optimization_vector(found.x)
    return handler.robot


def dh_misses(given: Mapping[str, Array], found: Any) -> Array:
    """Distances of tips on rows not fitted (N,) [m]."""
    return np.asarray(compute_absolute_errors(given["q_new"], given["tips_new"], found))
