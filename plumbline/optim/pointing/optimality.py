r"""Did a path's solve converge? Recomputed from the statement; the solver's word does not count.

With the Lagrangian :math:`L = f + \lambda \cdot g` and P the projection onto bounds, a point is
stationary, feasible and complementary if and only if both of

.. math:: \| z - P_z (z - \nabla_z L) \|_\infty, \qquad \| g - P_g (g + \lambda) \|_\infty

are zero (the natural residual of the conditions of Karush, Kuhn and Tucker: Facchinei and Pang
2003, sec. 1.5.2). Any multipliers may be offered for this: that some pass is the proof.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.optim.pointing.given import Array

# The solver's acceptable tolerance; it stops at 1e-7 times what its multipliers are scaled by.
STATIONARY = 1e-5
FEASIBLE = 1e-7  # in radians of the needle: of l + r = 0.5 m that is 0.05 um


@dataclass(frozen=True)
class Optimality:
    """How far a path is from one that cannot be bettered nearby.

    Attributes:
        stationarity: What a step along the slope would still change [rad].
        feasibility: Largest violation of an equation, a bound on steps or a plane [rad or m].
        complementarity: Largest residual of limits that press without being reached.
    """

    stationarity: float
    feasibility: float
    complementarity: float

    @property
    def converged(self) -> bool:
        """Whether all three are small."""
        slope = max(self.stationarity, self.complementarity)
        return slope <= STATIONARY and self.feasibility <= FEASIBLE

    @property
    def words(self) -> str:
        """The same in one line."""
        if np.isnan(self.stationarity):
            return "no solve: the path is the track it would start from"
        figures = (
            f"stationarity {self.stationarity:.1e} and complementarity "
            f"{self.complementarity:.1e} (limit {STATIONARY:g}), feasibility "
            f"{self.feasibility:.1e} (limit {FEASIBLE:g})"
        )
        return f"{'converged' if self.converged else 'not converged'}: {figures}"


NO_SOLVE = Optimality(float("nan"), float("nan"), float("nan"))


def optimality(
    z: Array, slope: Array, g: Array, forces: Array, bounds: dict[str, Array]
) -> Optimality:
    """The three residuals.

    Args:
        z: The point.
        slope: Gradient of the Lagrangian there, without the bounds on z.
        g: Constraints there.
        forces: Multipliers of the constraints, above 0 at an upper bound.
        bounds: ``lbx``, ``ubx``, ``lbg``, ``ubg``.
    """
    away = z - np.clip(z - slope, bounds["lbx"], bounds["ubx"])
    outside = np.maximum(bounds["lbg"] - g, g - bounds["ubg"])
    out = np.maximum(bounds["lbx"] - z, z - bounds["ubx"])
    pressed = g - np.clip(g + forces, bounds["lbg"], bounds["ubg"])
    return Optimality(
        float(np.abs(away).max(initial=0.0)),
        float(max(outside.max(initial=0.0), out.max(initial=0.0))),
        float(np.abs(pressed).max(initial=0.0)),
    )
