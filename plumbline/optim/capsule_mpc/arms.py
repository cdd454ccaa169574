r"""An instrument behind which there is a robot arm: its state is the arm's joints.

The shaft is the z axis of the chain's tip frame, so the trocar c (the remote centre of motion) is
held where its coordinates across the shaft vanish,

.. math:: \begin{pmatrix} 1 & 0 & 0 \\ 0 & 1 & 0 \end{pmatrix} R_{tip}^T (c - t_{tip}) = 0

and the tip is tracked. Joints are counted in units in which a step is of the size of a mm:
hundredths of a rad, and mm; see :attr:`ArmInstrument.unit`.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.capsules import LinkCapsule, Segment
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.frames import Transform
from plumbline.optim.capsule_mpc.bodies import Body, SymbolicCapsule
from plumbline.optim.capsule_mpc.constants import (
    ARRIVED,
    EASED,
    INSIDE,
    MM,
    PRISMATIC,
    REVOLUTE,
    STRIDE,
)
from plumbline.optim.capsule_mpc.settings import Point
from plumbline.optim.core.problem import Array


@dataclass(frozen=True, eq=False)
class ArmInstrument(Body):
    """An arm that holds an instrument."""

    chain: Chain  # the arm; the shaft lies along z of its tip frame
    trocar: Point  # in the world [m]
    links: tuple[LinkCapsule, ...]  # capsules of the links and of the shaft
    T_world_base: Array  # where the arm stands (4, 4) [m]
    rate: float = 0.3  # largest rate of every revolute joint [rad/s]
    slide: float = 0.04  # largest rate of every prismatic joint [m/s]
    ramp: float = 0.06  # time in which a joint comes from rest to its largest rate [s]
    onset: float = 0.02  # time in which that acceleration builds up [s]
    # which two of the links, by their numbers, must not touch each other; None for all but those
    # that follow each other, which meet in a joint. ``()`` for none.
    apart: tuple[tuple[int, int], ...] | None = None

    @property
    def size(self) -> int:
        """Number of joints."""
        return self.chain.n

    @cached_property
    def unit(self) -> Array:
        """What one unit of the state is, joint by joint (n,) [rad or m]."""
        kinds = self.chain.kinds
        return np.array([REVOLUTE if kind == "revolute" else PRISMATIC for kind in kinds])

    @cached_property
    def speed(self) -> Array:
        """Largest rate (n,) of every coordinate [units/s]."""
        return np.where(self.unit == REVOLUTE, self.rate, self.slide) / self.unit

    @property
    def groups(self) -> tuple[int, ...]:
        """Every joint for itself."""
        return (1,) * self.size

    @property
    def acceleration(self) -> Array:
        """Largest acceleration (n,) of every coordinate [units/s^2]."""
        return self.speed / self.ramp

    @property
    def jerk(self) -> Array:
        """Largest jerk (n,) of every coordinate [units/s^3]."""
        return self.acceleration / self.onset

    @property
    def constants(self) -> Array:
        """The trocar."""
        return MM * np.array(self.trocar)

    @cached_property
    def own_pairs(self) -> tuple[tuple[int, int], ...]:
        """Links that must not touch each other, by their numbers."""
        if self.apart is not None:
            return self.apart
        order = sorted(range(len(self.links)), key=lambda k: self.links[k].joint)
        return tuple((min(a, b), max(a, b)) for k, a in enumerate(order) for b in order[k + 2 :])

    @property
    def shape(self) -> Hashable:
        """The arm itself: arms share nothing, not even of one make, since they stand elsewhere."""
        return self

    def _frames(self, x: cs.SX) -> list[Transform]:
        """Frames of joints and tip in the world [m]."""
        T = Transform.from_matrix(self.T_world_base)
        return [T @ frame for frame in self.chain.joint_frames(x * cs.DM(self.unit))]

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[SymbolicCapsule, ...]:
        """All links that have one [mm]."""
        frames = self._frames(x)
        base = Transform.from_matrix(self.T_world_base)
        found = []
        for link in self.links:
            axis = link.axis(frames)
            if link.joint < 0:
                axis = Segment(base.point(axis.a), base.point(axis.b))
            found.append(SymbolicCapsule(Segment(MM * axis.a, MM * axis.b), MM * link.radius))
        return tuple(found)

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """The tip (3,) [mm]."""
        return MM * self._frames(x)[-1].t

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """The trocar across the shaft (2,) [mm]."""
        tip = self._frames(x)[-1]
        return (tip.R.T @ (c - MM * tip.t))[:2]

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Room to the limits of the joints that have some (l,) [units]."""
        rooms = [cs.SX(0, 1)]
        for k, (low, high) in enumerate(zip(self.chain.lower, self.chain.upper, strict=True)):
            rooms += [x[k] - low / self.unit[k]] if np.isfinite(low) else []
            rooms += [high / self.unit[k] - x[k]] if np.isfinite(high) else []
        return cs.vertcat(*rooms)

    def sagitta(self, x: cs.SX, c: cs.SX, d: cs.SX) -> tuple[cs.SX, ...]:
        r"""Of a point at R from the first axis: :math:`(\omega^2 R + 2\, \omega\, \dot s) / 8`."""
        far, spread = self._far
        size, turns = cs.fabs(d), self.unit == REVOLUTE
        found = []
        for link in self.links:
            own = range(link.joint + 1)
            turn = cs.sum(cs.vertcat(0, *(self.unit[k] * size[k] for k in own if turns[k])))
            slide = cs.sum(
                cs.vertcat(0, *(MM * self.unit[k] * size[k] for k in own if not turns[k]))
            )
            found.append((turn**2 * MM * (far[0] + spread) + 2 * turn * slide) / 8)
        return tuple(found)

    def through(self, c: cs.SX) -> tuple[cs.SX | None, ...]:
        """None, for any link: where a shaft begins and ends is the arm's affair."""
        return (None,) * len(self.links)

    @cached_property
    def _far(self) -> tuple[Array, float]:
        """The farthest that each joint carries (n,), and how far links stand out [m]."""
        ends = [joint.T_parent_joint[:3, 3] for joint in self.chain.joints[1:]]
        lengths = [float(np.linalg.norm(end)) for end in [*ends, self.chain.T_last_tip[:3, 3]]]
        slides = np.where(np.isfinite(self.chain.upper), np.abs(self.chain.upper), 0.0)
        far = np.cumsum((lengths + slides * (self.unit == PRISMATIC))[::-1])[::-1]
        return far, max(float(np.linalg.norm(link.ends, axis=1).max()) for link in self.links)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        """A turn moves what it carries by at most angle times the farthest that it carries."""
        far, spread = self._far
        moves = [
            within[k] * (MM * self.unit[k] * (far[k] + spread if kind == "revolute" else 1.0))
            for k, kind in enumerate(self.chain.kinds)
        ]
        return tuple(cs.sum(cs.vertcat(0, *moves[: link.joint + 1])) for link in self.links)


def held_tip(arm: ArmInstrument, tip: ArrayLike, start: ArrayLike, passes: int = 400) -> Array:
    """Joints (n,) near ``start`` with the tip at a point [m] through the trocar, or refused."""
    wanted = MM * np.asarray(tip, dtype=float)
    x, c = cs.SX.sym("x", arm.size), cs.SX(cs.DM(arm.constants))
    error = cs.vertcat(arm.tracked(x, c) - cs.DM(wanted), arm.held(x, c))
    function = cs.Function("e", [x], [error, cs.densify(cs.jacobian(error, x))])
    low, high = arm.chain.lower / arm.unit, arm.chain.upper / arm.unit
    state = np.asarray(start, dtype=float) / arm.unit
    for _ in range(passes):
        off, slope = (value.full() for value in function(state))
        if np.abs(off).max() < ARRIVED:
            return np.asarray(state * arm.unit)
        step = slope.T @ np.linalg.solve(slope @ slope.T + EASED * np.eye(5), off.ravel())
        largest = float(np.abs(step).max())
        state = np.clip(state - step * min(1.0, STRIDE / largest), low + INSIDE, high - INSIDE)
    worst, where = float(np.abs(off).max()), np.round(wanted / MM, 4).tolist()
    raise PlumblineError(f"tip {where}: {worst:.3g} mm off after {passes} steps; start elsewhere")
