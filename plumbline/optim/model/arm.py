r"""An arm as it was found: where its tip is, how that moves with the joints, how sure that is.

.. math:: p = T_{base,tool}(q, row;\ \hat x)\, 0, \qquad
          \operatorname{cov} p = J_x C J_x^T

What the drives of an arm should read, in symbols of one row.

.. math:: \tau = \tau(q, \dot q, \ddot q;\ \hat\theta), \qquad
          \operatorname{cov} \tau = J_\theta C J_\theta^T

Friction goes with the sign of the velocity, which is 0 at rest.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import by_columns, constant
from plumbline.kinematics.tree import dynamics_of_chain
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.observation import apply_effects
from plumbline.optim.measurement.torque import BODIES, moved
from plumbline.optim.model.fitted import Fitted, by_effect
from plumbline.optim.model.rows import CONTEXT, completed, postures
from plumbline.optim.model.statement import ModelFunctions
from plumbline.optim.recording.kinds import EFFORTS


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
        """What the model reads (N, k) of postures (N, n) or (n,) and their context, or refuses."""
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
        slope = over_rows(_by_unknowns(self.statement, device=device), rows)[0].transpose(0, 2, 1)
        return np.asarray(slope @ self.covariance @ slope.transpose(0, 2, 1))

    def tau(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, **context: ArrayLike) -> Array:
        """What the drives read (N, n) [N m or N] when the joints move so; of a model of efforts.

        Args:
            q: Joints (N, n) or (n,) [rad or m].
            v: Their velocities, as many; friction goes with their sign, 0 at rest.
            a: Their accelerations, as many.
            **context: As of :meth:`placement`.

        Raises:
            PlumblineError: Rows that cannot be used, or a model of something else than efforts.
        """
        efforts = efforts_of(self)
        return over_rows(efforts.torque, efforts.rows(q, v, a, context))[0][:, 0]

    def tau_covariance(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, **context: ArrayLike
    ) -> Array:
        """Covariance (N, n, n) [(N m)^2] of :meth:`tau`, from that of all that was fitted."""
        efforts, first = efforts_of(self), len(self.nuisance_names)
        made = over_rows(efforts.slope, efforts.rows(q, v, a, context))[0]
        return np.asarray(made.transpose(0, 2, 1) @ self.covariance[first:, first:] @ made)


class Unlimited(Arm):
    """An arm whose joints go as far as they like."""

    @cached_property
    def chain(self) -> Chain:
        """The nominal chain without limits."""
        chain = super().chain
        return replace(chain, joints=tuple(
            replace(joint, lower=-np.inf, upper=np.inf) for joint in chain.joints
        ))  # fmt: skip


@lru_cache(maxsize=8)
def unlimited(arm: Arm) -> Unlimited:
    """The same arm without limits: of readings, that are where they are."""
    return Unlimited(**{one.name: getattr(arm, one.name) for one in fields(Arm)})


_by_unknowns = lru_cache(maxsize=8)(ModelFunctions.by_unknowns)
MOTION = ("q", "velocity", "acceleration")


@dataclass(frozen=True, eq=False)
class Efforts:
    """Functions of an arm's efforts, made when first asked for."""

    arm: Arm  # the arm
    symbols: dict[str, cs.SX]  # A row's symbols by column

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Columns that the efforts depend on, those of the motion first."""
        tau = self.torque_of(self.arm.values)
        more = [name for name, symbol in self.symbols.items()
                if name not in MOTION and any(cs.which_depends(tau, symbol, 1, False))]  # fmt: skip
        return (*MOTION, *more)

    @cached_property
    def row(self) -> cs.SX:
        """The row (k,) of all used columns."""
        return cs.vertcat(*[self.symbols[name] for name in self.used])

    def rows(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, context: Mapping[str, ArrayLike]
    ) -> Array:
        """Rows (N, k) of joints, velocities and accelerations, each (N, n), and their context."""
        given = {"effort": 0.0, **context, "velocity": v, "acceleration": a}
        columns = self.arm.columns(postures(self.arm.chain, q), given)
        return np.hstack([columns[name] for name in self.used])

    @cached_property
    def torque(self) -> cs.Function:
        """``row -> tau (n,)`` [N m or N]."""
        return cs.Function("torque", [self.row], [self.torque_of(self.arm.values)])

    @cached_property
    def slope(self) -> cs.Function:
        """``row -> d tau / d theta`` (n, P)."""
        theta = cs.SX.sym("theta", len(self.arm.values))
        slope = cs.jacobian(self.torque_of(cs.vertsplit(theta)), theta)
        at = cs.substitute(slope, theta, cs.DM(self.arm.values))
        return cs.Function("slope", [self.row], [cs.densify(at)])

    def torque_of(self, values: Sequence[cs.SX] | Array) -> cs.SX:
        """Efforts (n,) with other values of the parameters (P,)."""
        return cs.densify(moved(self.state, self._effects(values), apply_effects).torque)

    def bodies(self) -> State:
        """The state with the ten parameters of every body and gravity as they are."""
        dynamics = dynamics_of_chain(self.arm.chain)
        weighed = replace(
            self.state, inertial=constant(dynamics.inertial), gravity=constant(dynamics.gravity)
        )
        return apply_effects(weighed, self._effects(self.arm.values), BODIES)

    @cached_property
    def state(self) -> State:
        """The nominal chain at the row."""
        row = {**self.symbols, "turning": cs.sign(self.symbols["velocity"])}
        if "payload" not in self.arm.samples:
            del row["payload"]
        return State.ideal(self.arm.chain, row, constant(self.arm.tool))

    def _effects(self, values: Sequence[cs.SX] | Array) -> list[tuple[Effect, list[cs.SX]]]:
        return by_effect(self.arm.effects, [cs.SX(value) for value in values])


@lru_cache(maxsize=8)
def efforts_of(arm: Arm) -> Efforts:
    """The efforts of an arm in symbols (PlumblineError: it was not fitted to efforts)."""
    if arm.observation != EFFORTS:
        raise fault(f"{arm.recording}, tau", f"a model of {arm.observation}",
                    f"one of {EFFORTS}", "diagnose efforts, and take their model")  # fmt: skip
    columns = arm.columns(np.zeros((1, arm.chain.n)), {})
    return Efforts(arm, {name: cs.SX.sym(name, v.shape[1]) for name, v in columns.items()})
