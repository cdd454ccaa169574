r"""The most probable rigid fit under any covariance of any reading, in either frame.

.. math:: \min_{R, t} \sum_i d_i^T (R\, \Sigma_{C,i} R^T + \Sigma_{R,i})^{-1} d_i, \qquad
          d_i = q_i - R p_i - t

Slices of 5 mm against 1 mm in plane make CT's readings poor along one axis of CT; that axis turns
with R, so the weights do, too (see :mod:`plumbline.optim.registration.statement`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Array
from plumbline.optim.core.solvers import Solver
from plumbline.optim.registration.least_squares import best_fit, judged_fit, minimise, move
from plumbline.optim.registration.markers import MarkerNoise, Markers, rows_of
from plumbline.optim.registration.method import Fit
from plumbline.optim.registration.statement import problem, sensitivity
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True)
class Anisotropic:
    """Each reading weighs by its own covariance; without any stated, it is Kabsch's fit."""

    # what solves the stated problem; damped Gauss-Newton steps if none is given
    solver: Solver | None = None

    name: ClassVar[str] = "anisotropic"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        T_RC = best_fit(markers)[0] if self.solver is None else _solved(self.solver, markers)
        centre = markers.robot.mean(axis=0)
        J = sensitivity(markers, T_RC, centre)
        every = tuple(range(len(markers)))
        return Fit(T_RC, centre, J, every, judged=judged_fit(markers, T_RC))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all draws with the same noise."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        first = Markers.of(c.reshape(-1, *c.shape[-2:])[0], r.reshape(-1, *r.shape[-2:])[0], noise)
        rows = rows_of(c, r, first.ct_cov, first.robot_cov).reshape(-1, len(first), 18)
        return minimise(rows)[0].reshape(*c.shape[:-2], 4, 4)


def _solved(solver: Solver, markers: Markers) -> Array:
    """``T_RC`` (4, 4) by a solver, from Kabsch's fit."""
    start, centre = rigid_match(markers.ct, markers.robot), markers.robot.mean(axis=0)
    found = solver.solve(problem(markers, start, centre), np.zeros(6))
    return move(start[None], centre[None], found.x[None])[0]
