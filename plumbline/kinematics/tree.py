r"""A robot of any tree shape as the chain that a recording holds, with what its bodies weigh.

.. math:: T_{base,i}(q) = T_{base,parent(i)}(q)\, T_{parent(i),i}\, J_i(q_i), \qquad
          \tau(q, \dot q, \ddot q)

Efforts are measured at the joints of all limbs, also of those that no tip frame hangs on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import casadi as cs

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.dynamics import Dynamics, dynamics_of, steiner
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.robot import Robot


@dataclass(frozen=True, eq=False)
class Tree(Chain):
    """Joints of all limbs; the tip frame is fixed to one of the bodies."""

    parents: tuple[int, ...] = ()  # the joint that each hangs on, from 0; -1 at the base (n)
    tip_body: int = 0  # the body that the tip frame is fixed to, from 0

    def __repr__(self) -> str:
        return f"<Tree of {self.n} joints with tip {self.tip_frame[:60]!r}>"

    @property
    def hangs(self) -> Sequence[int]:
        """The joint that each hangs on, from 0; -1 at the base (n)."""
        return self.parents

    @property
    def body_of_tip(self) -> int:
        """The body that the tip frame is fixed to, from 0."""
        return self.tip_body

    @cached_property
    def dynamics(self) -> Dynamics:
        """What its joints carry."""
        return dynamics_of(self.model, self.joints, self.gravity)


def tree_of(robot: Robot, joints: int | None = None, tip_frame: str | None = None) -> Tree:
    """The robot's joints: all where as many were recorded, else those that lead to the tip frame.

    All others are held at neutral then. The tip frame is the robot's own by default.
    """
    chain = robot.chain(tip_frame)
    movable = robot.model.njoints - 1
    if movable == chain.n or (joints is not None and joints != movable):
        own = {field.name: getattr(chain, field.name) for field in fields(chain)}
        return Tree(**own, parents=tuple(range(-1, chain.n - 1)), tip_body=chain.n - 1)
    whole = robot.dynamics()
    names = [joint.name for joint in whole.joints]
    return Tree(
        whole.model, whole.joints, chain.T_last_tip, chain.tip_frame, chain.gravity,
        parents=whole.parents, tip_body=names.index(chain.joint_names[-1]),
    )  # fmt: skip


def dynamics_of_chain(chain: Chain) -> Dynamics:
    """What a chain's joints carry (PlumblineError: the chain was not read with its bodies)."""
    if not isinstance(chain, Tree):
        raise PlumblineError(f"{chain!r}: no bodies, a Tree expected; make one with tree_of(robot)")
    return chain.dynamics


def laden(chain: Chain, mass: cs.SX | float, tool: cs.SX) -> cs.SX:
    """Ten parameters of every body (n, 10) with a mass [kg] at the tool's tip (3,) [m]."""
    place = Transform.from_matrix(chain.T_last_tip).point(tool)
    inertial = constant(dynamics_of_chain(chain).inertial)
    inertial[chain.body_of_tip, :] += cs.vertcat(mass, mass * place, steiner(mass, place)).T
    return inertial
