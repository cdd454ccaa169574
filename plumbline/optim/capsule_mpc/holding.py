r"""What is held is held exactly: the last correction of a command.

A program treats ``held`` to first order, so a step of it would miss a trocar by the curvature of
the arm. The state after the step is put right by Newton's method, along the shortest way,

.. math:: x \leftarrow x - E^+ e(x), \qquad E = \partial e / \partial x

so that the trocar is met at every step and not on average.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.statement import Shape, Statement

Array = NDArray[np.float64]
EXACT = 1e-6  # [mm]


@lru_cache(maxsize=16)
def _held(shape: Shape) -> Compiled:
    statement = shape.statement
    x, _, stage = statement.symbols
    held = cs.densify(statement.held)
    outputs = cs.cse([held, cs.densify(cs.jacobian(held, x).T)])
    return Compiled(cs.Function("held", [x, stage], outputs), False)


def held_exactly(statement: Statement, x: Array, stage: Array, passes: int = 4) -> Array:
    """The state nearest x (n,) at which all that is held is zero, by Newton's method."""
    found = x.copy()
    for _ in range(passes if statement.held.numel() else 0):
        off, slope = _held(statement.shape)(found, stage)
        if np.abs(off).max() < EXACT:
            break
        E = slope.reshape(len(off), -1)
        found = found - E.T @ np.linalg.lstsq(E @ E.T, off, rcond=None)[0]
    return found


def how_far_off(statement: Statement, x: Array, stage: Array) -> float:
    """The most by which anything held is not zero at x (n,), as it is stated (mm for a trocar)."""
    if not statement.held.numel():
        return 0.0
    return float(np.abs(_held(statement.shape)(x, stage)[0]).max())
