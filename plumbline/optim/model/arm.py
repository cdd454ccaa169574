r"""An arm as it was found: where its tip is, how that moves with the joints, how sure that is.

.. math:: p = T_{base,tool}(q, row;\ \hat x)\, 0, \qquad
          \operatorname{cov} p = J_x C J_x^T
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import by_columns
from plumbline.optim.core.problem import Array
from plumbline.optim.model.fitted import Fitted
from plumbline.optim.model.rows import CONTEXT, completed, postures
from plumbline.optim.model.statement import ModelFunctions


@dataclass(frozen=True, eq=False, repr=False)
class Arm(Fitted):
    """What was found, evaluated. Places are in the robot's base frame, SI units."""

    @cached_property
    def statement(self) -> ModelFunctions:
        """The model in symbols."""
        return ModelFunctions.of(self, self.columns(np.zeros((1, self.chain.n)), {}))

    def columns(
        self, q: Array, given: Mapping[str, ArrayLike], used: Collection[str] = CONTEXT
    ) -> dict[str, Array]:
        """All that any effect may read (N, k), by name, at postures (N, n) and their context."""
        return completed(self.chain, q, given, self.usual, self.effects, used)

    def rows(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """What the model reads (N, k) of postures (N, n) or (n,) and their context.

        Raises:
            PlumblineError: A posture or a context that cannot be used.
        """
        return self.rows_of(q, context)

    def rows_of(self, q: ArrayLike, context: Mapping[str, ArrayLike]) -> Array:
        """The same with the context as a mapping."""
        statement = self.statement
        return statement.values(self.columns(postures(self.chain, q), context, statement.used))

    def placement(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """``T_base_tool`` (N, 4, 4) [m] at joint readings (N, n) or (n,) [rad or m].

        Args:
            q: Joint readings.
            **context: ``direction``, ``payload``, ``temperature``, ...: see :data:`.rows.CONTEXT`.

        Raises:
            PlumblineError: A posture or a context that cannot be used.
        """
        return by_columns(over_rows(self.statement.pose, self.rows(q, **context))[0][:, 0])

    def tip(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """Where the tip really is (N, 3) in the base frame [m]; arguments as of `placement`."""
        return over_rows(self.statement.pose, self.rows(q, **context))[0][:, 0, 9:]

    def in_device(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """Where the tip really is (N, 3) in the device's frame [m]."""
        return self.tip(q, **context) @ self.T_device_base[:3, :3].T + self.T_device_base[:3, 3]

    def joint_corrections(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """What the joints turn more than their readings say (N, n) [rad or m]."""
        found = over_rows(self.statement.links, self.rows(q, **context))[0][:, 0]
        return np.asarray(found - postures(self.chain, q))

    def jacobian(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """The tool's velocity [m/s] and spin [rad/s] per joint velocity (N, 6, n), base frame."""
        J = over_rows(self.statement.slope, self.rows(q, **context))[1]
        return np.ascontiguousarray(J.transpose(0, 2, 1))

    def uncertainty(self, q: ArrayLike, *, device: bool = False, **context: ArrayLike) -> Array:
        """Covariance (N, 3, 3) of the predicted tip [m^2], from that of all that was fitted.

        Args:
            q: Joint readings (N, n) or (n,).
            device: In the device's frame, the frame's own uncertainty with it.
            **context: As of :meth:`placement`.
        """
        rows = self.rows(q, **context)
        slope = over_rows(self._by_unknowns(device=device), rows)[0].transpose(0, 2, 1)
        return np.asarray(slope @ self.covariance @ slope.transpose(0, 2, 1))

    def _by_unknowns(self, *, device: bool) -> cs.Function:
        if device not in self._slopes:
            self._slopes[device] = self.statement.by_unknowns(device=device)
        return self._slopes[device]

    @cached_property
    def _slopes(self) -> dict[bool, cs.Function]:
        return {}
