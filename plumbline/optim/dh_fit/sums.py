r"""Objective, gradient and generalised Gauss-Newton matrix, summed over the readings in chunks.

.. math:: J_i = \frac{\partial f}{\partial x} - \frac{\partial (g a_i)}{\partial m}
          \frac{\partial m}{\partial x}

The frame's derivative is worked out once; a row adds a product with its three coordinates. Memory
is bounded by the chunk, cost is linear in the readings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.constants import CHUNK_NUMBERS
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit.losses import Loss
from plumbline.optim.dh_fit.statement import DHStatement, Readings


@dataclass(frozen=True, eq=False)
class Sums:
    """What one pass over the readings gives at a point."""

    objective: float  # F, the mean loss [m or m^2]
    gradient: Array  # dF/dx (P,)
    matrix: Array  # its generalised Gauss-Newton matrix (P, P)


@dataclass(frozen=True, eq=False)
class Pass:
    """A statement and the readings that it is summed over."""

    statement: DHStatement  # the problem
    readings: Readings  # N readings
    other: Loss | None = None  # A loss in place of the statement's own, for a start

    @property
    def loss(self) -> Loss:
        """What a misfit costs."""
        return self.other or self.statement.loss

    def misfits(self, x: Array) -> Array:
        """Predicted minus measured (N, 3) [m], in the robot's frame."""
        T = self.statement.frame_at(x)
        seen = self.readings.tips @ T[:3, :3].T + T[:3, 3]
        return self.statement.tips(x, self.readings.q) - seen

    def objective(self, x: Array) -> float:
        """F at a point (P,)."""
        return float(self.loss.values(self.misfits(x)).mean())

    def jacobians(self, x: Array) -> Iterator[tuple[Array, Array]]:
        """Chunks of misfits (n, 3) and their Jacobians (n, 3, P)."""
        stated, size = self.statement, self.statement.size
        m, slope = (part.full() for part in stated.frame_function(x))
        R, t = m[:9].reshape(3, 3).T, m[9:, 0]
        turning = slope[:9].reshape(3, 3 * size)  # one row a coordinate of the reading
        moving = slope[9:]
        step = max(1, CHUNK_NUMBERS // (3 * size))
        for start in range(0, len(self.readings), step):
            part = slice(start, start + step)
            a = self.readings.tips[part]
            f, J = over_rows(stated.tip_functions[1], self.readings.q[part], x)
            J -= (a @ turning).reshape(-1, 3, size)
            J -= moving
            yield f[:, 0] - a @ R.T - t, J

    def curving(self, x: Array) -> Array:
        r"""What the Gauss-Newton matrix leaves out of the Hessian (P, P).

        .. math:: \frac1n \sum_i \lambda_i^T \nabla^2 f_i - \nabla^2 \langle C, m(x) \rangle,
                  \quad \lambda_i = \nabla\phi(e_i), \quad C = \frac1n \sum_i \lambda_i (a_i, 1)^T
        """
        stated, size = self.statement, self.statement.size
        pull = self.loss.slopes(self.misfits(x)) / len(self.readings)
        on_frame = np.concatenate([(self.readings.tips.T @ pull).ravel(), pull.sum(axis=0)])
        total = -stated.curve_functions[1](x, on_frame).full()
        table = np.hstack([self.readings.q, pull])
        step = max(1, CHUNK_NUMBERS // size**2)
        for start in range(0, len(table), step):
            rows = over_rows(stated.curve_functions[0], table[start : start + step], x)[0]
            total += rows.sum(axis=0)
        return total

    def sums(self, x: Array) -> Sums:
        """Objective, gradient and matrix at a point (P,)."""
        size, count = self.statement.size, len(self.readings)
        total, gradient, matrix = 0.0, np.zeros(size), np.zeros((size, size))
        for e, J in self.jacobians(x):
            loss = self.loss
            c, u = loss.curvatures(e)
            total += float(loss.values(e).sum())
            gradient += np.einsum("nk,nkp->p", loss.slopes(e), J)
            A = (J * np.sqrt(c)[:, None, None]).reshape(-1, size)
            matrix += A.T @ A
            if u.any():
                B = np.einsum("nk,nkp->np", u * np.sqrt(c)[:, None], J)
                matrix -= B.T @ B
        return Sums(total / count, gradient / count, matrix / count)
