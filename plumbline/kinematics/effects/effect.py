r"""What an effect is: a small change to one place of the measurement chain.

.. math:: y = h(\text{row};\ \phi, \theta), \qquad \theta = \text{null} \Rightarrow
          h = \text{the ideal chain}

Every effect is nested in the ideal chain: at its null value it changes nothing. So presence,
absence, ranking and removal are one and the same operation, whatever the effect.

To add one: write a file beside this one with a frozen dataclass that derives from :class:`Effect`
(or from :class:`JointEffect`), declare its parameters as class attributes, state its formula in
``apply``, and add its name to ``LISTED`` in ``kinematics/effects/__init__.py``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from typing import ClassVar

import casadi as cs
import numpy as np

from plumbline.errors import fault
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.dynamics import Nominal
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.parameters import Parameter

RANGES: tuple[str, ...] = ("plane_range",)
FIDUCIALS: tuple[str, ...] = ("fiducials",)
TOOL_OBSERVATIONS: tuple[str, ...] = ("tip_position", "pose", "fixed_point")
TIP_OBSERVATIONS: tuple[str, ...] = (*TOOL_OBSERVATIONS, *RANGES)
ALL_OBSERVATIONS: tuple[str, ...] = (*TIP_OBSERVATIONS, "joint_position")
OF_SLIDES = {
    "rad": "m", "rad/(N m)": "m/N", "rad/(N m)^2": "m/N^2", "N m": "N", "N m s/rad": "N s/m",
    "N m/rad": "N/m", "kg m^2": "kg", "rad kg/(N m)": "m kg/N",
}  # fmt: skip
ELEMENTS = ("joint", "link", "plane", "marker")  # fields that say which of them it is
LEAST_LOAD = 0.1  # of a load's span on either side of zero, for a joint's weight to change sides
UNSAID = {"said": False}  # of a field that tells no variant from another, but is how each is sized
DEVICE_OBSERVATIONS: tuple[str, ...] = ("tip_position", "pose")


class Stage(StrEnum):
    """Where along the chain an effect sits, in the order in which stages act."""

    ACTUATION = "actuation"
    JOINT = "joint"
    LINK = "link"
    TOOL = "tool"
    BASE = "base"
    REGISTRATION = "registration"
    SENSOR = "sensor"


OF_AN_ARM = (Stage.ACTUATION, Stage.JOINT, Stage.LINK)


@dataclass(frozen=True, eq=False)
class State:
    """The measurement chain on its way from the joints' readings to the device's."""

    nominal: Nominal  #: the arm as the model has it
    row: Mapping[str, cs.SX]  #: symbols of what one row of the recording holds, by column name
    q: cs.SX  #: joint coordinates as the links see them (n,) [rad or m]
    #: placement of every joint in its parent, last the tip (n + 1) [m]
    placements: tuple[Transform, ...]
    tool: cs.SX  #: tool tip in the tip frame (3,) [m]
    #: orientation of the tool in the tip frame (3, 3)
    R_tip_tool: cs.SX = field(default_factory=lambda: cs.SX.eye(3))
    #: where the base has moved to since the device was set up (6,) [m], [rad]
    base_twist: cs.SX = field(default_factory=lambda: cs.SX(6, 1))
    #: predicted position in the device's frame (3,), or range (1,) [m]; known once closed
    reading: cs.SX = field(default_factory=lambda: cs.SX(3, 1))
    #: of a range, the plane's normal away from the finder (3,), in the beam's frame
    normal: cs.SX = field(default_factory=lambda: cs.SX(3, 1))
    #: of a range, where the beam meets the plane (2,), from the plane's middle [m]
    spot: cs.SX = field(default_factory=lambda: cs.SX(2, 1))
    #: ten parameters of every body (n, 10), where torques are measured
    inertial: cs.SX = field(default_factory=lambda: cs.SX(0, 10))
    #: gravity as it is (3,) in the base frame, where torques are measured [m/s^2]
    gravity: cs.SX = field(default_factory=lambda: cs.SX(3, 1))
    #: what moving the bodies takes, joint by joint (n,) [N m or N]; known once closed
    carried: cs.SX = field(default_factory=lambda: cs.SX(0, 1))
    #: what the drives exert besides (n,) [N m or N]; known once closed
    torque: cs.SX = field(default_factory=lambda: cs.SX(0, 1))

    @classmethod
    def ideal(cls, chain: Chain, row: Mapping[str, cs.SX], tool: cs.SX) -> State:
        """The chain with nothing wrong, at the readings of a row."""
        return cls(Nominal.at(chain, row), row, row["q"], chain.placements, tool)

    @property
    def chain(self) -> Chain:
        """The nominal chain."""
        return self.nominal.chain

    @property
    def middle(self) -> cs.SX:
        """Where the tool has its middle (3,), in the base frame [m]."""
        return self.nominal.frames[-1].point(self.tool / 2)

    def move_joint(self, joint: int, by: cs.SX) -> State:
        """A copy in which joint ``joint`` (from 1) moved by ``by`` [rad or m], and what follows."""
        q = self.q[:]
        for k, share in ((joint - 1, 1.0), *self.chain.joints[joint - 1].drags):
            q[k] += by if share == 1.0 else share * by
        return replace(self, q=q)

    def place_link(self, link: int, T_parent_next: Transform) -> State:
        """A copy in which what link ``link`` (from 1) carries is placed so in its frame."""
        placements = list(self.placements)
        placements[link] = T_parent_next
        return replace(self, placements=tuple(placements))

    def add_torque(self, joint: int, by: cs.SX) -> State:
        """A copy in which the drive of joint ``joint`` (from 1) exerts ``by`` more [N m or N]."""
        torque = self.torque[:]
        torque[joint - 1] += by
        return replace(self, torque=torque)

    def move_base(self, translation: cs.SX, rotation_vector: cs.SX) -> State:
        """A copy whose base has moved by a small twist [m], [rad], given in the base frame.

        Small twists add up: what their order would change is of second order.
        """
        return replace(self, base_twist=self.base_twist + cs.vertcat(translation, rotation_vector))

    @property
    def T_world_base(self) -> Transform:
        """The base's place after all that moved it."""
        return Transform.from_twist(self.base_twist[:3], self.base_twist[3:])

    def reading_of_joint(self, joint: int) -> cs.SX:
        """What the encoder of joint ``joint`` (from 1) says [rad or m]."""
        return self.row["q"][joint - 1]

    def gravity_direction(self) -> cs.SX:
        """Unit vector (3,) of gravity in the base frame; zero if there is none."""
        size = float(np.linalg.norm(self.chain.gravity))
        return constant(self.chain.gravity / size if size else np.zeros(3))


@dataclass(frozen=True, eq=False)
class Scope:
    """What a recording offers, so that an effect can say which of its variants make sense."""

    chain: Chain  #: the chain that was recorded
    observation: str  #: what a row measured, e.g. ``"tip_position"``
    #: optional columns that the recording has, e.g. ``"time"``, ``"direction"``
    columns: frozenset[str]
    #: smallest and largest value of each scalar column, of each joint (``"q1"``), of what gravity
    #: asks of it (``"load1"``) and of its measured effort (``"effort1"``); of the device's field,
    #: the square of the range and the depth
    span: Mapping[str, tuple[float, float]]
    rows: int  #: number of rows
    #: whether successive rows are samples of one motion rather than separate postures
    moving: bool = False
    #: when each row was read, in ascending order [s]; empty without a clock
    times: tuple[float, ...] = ()
    groups: tuple[int, ...] = ()  #: the groups of rows, in ascending order
    #: whether the joints are an arm's, not a stand-in for poses or points as they were given
    arm: bool = True
    elements: int = 0  #: how many planes or markers the rows are of

    def has(self, *names: str) -> bool:
        """Whether the recording has all of these columns."""
        return set(names) <= self.columns

    def changes_sign(self, name: str, joint: int) -> bool:
        """Whether a joint's ``"load"`` or ``"effort"`` is well on either side of zero."""
        if name == "load" and not self.chain.gravity.any():
            return False
        low, high = self.span.get(f"{name}{joint}", (0.0, 0.0))
        return low < -LEAST_LOAD * (high - low) and high > LEAST_LOAD * (high - low)

    @property
    def joints(self) -> range:
        """Numbers of the joints, from 1."""
        return range(1, self.chain.n + 1)

    @property
    def turning(self) -> list[int]:
        """Numbers of the joints that turn, from 1."""
        return [j for j in self.joints if self.chain.kinds[j - 1] == "revolute"]

    @property
    def tool(self) -> Array:
        """The nominal tip (3,) in the tip frame [m]; at its origin where none is stated."""
        return np.array([self.span.get(f"tool_{c}", (0.0, 0.0))[0] for c in "xyz"])

    def stands_still(self, name: str) -> bool:
        """Whether a column has one value in all rows, so that nothing can run along it."""
        low, high = self.span.get(name, (0.0, 1.0))
        return not high > low


@dataclass(frozen=True)
class Effect(ABC):
    """A change to one place of the chain, with its parameters as class attributes.

    Fields of a subclass (a joint, an order, a time constant) tell variants apart; they are fixed
    while the parameters are fitted.
    """

    name: ClassVar[str]  #: what it is called, in snake case; its file is called like it
    stage: ClassVar[Stage]  #: where along the chain it sits: what is blamed
    #: what its error depends on, in a word or two: ``"own angle"``, ``"load"``
    depends_on: ClassVar[str] = "nothing"
    reference: ClassVar[str]  #: who describes it: authors, the year in brackets, where to look
    #: what it means, in a sentence; ``{element}``, or a field's name, stands for its value
    words: ClassVar[str]
    #: columns that the formula reads, all of which the recording must have
    needs: ClassVar[tuple[str, ...]] = ()
    #: columns of which one will do, as ``candidates`` decides; empty where there is no choice
    needs_one_of: ClassVar[tuple[str, ...]] = ()
    #: kinds of observation that can show it
    observations: ClassVar[tuple[str, ...]] = TIP_OBSERVATIONS
    #: stage at which the formula acts, where that is not the one that is blamed
    acts_at: ClassVar[Stage | None] = None
    #: field that is tried on a fine grid, such as the order of a ripple
    scanned: ClassVar[str | None] = None
    of_slides: ClassVar[bool] = False  #: whether it is of joints that slide alone
    in_motion: ClassVar[bool] = False  #: whether readings along one motion alone can show it
    #: whether there is nothing of it where there is no gravity
    needs_gravity: ClassVar[bool] = False
    #: where scales and bounds are from, of parameters that do not say it themselves
    source: ClassVar[str] = ""
    declared: ClassVar[tuple[Parameter, ...]] = ()  #: its parameters, collected from the class

    def __init_subclass__(cls, **kwargs: object) -> None:
        """Collect the parameters in the order of their declaration and give them their names."""
        super().__init_subclass__(**kwargs)
        found = {key: p for key, p in vars(cls).items() if isinstance(p, Parameter)}
        own = {k: replace(p, name=k, source=p.source or cls.source) for k, p in found.items()}
        for key, parameter in own.items():
            setattr(cls, key, parameter)
        if own:
            cls.declared = tuple(own.values())

    @cached_property
    def element(self) -> int | None:
        """Number of the joint, link, plane or marker that is guilty, from 1; none if it is none."""
        return next((getattr(self, name) for name in ELEMENTS if hasattr(self, name)), None)

    @property
    def port(self) -> Stage:
        """The stage at which the formula acts, where it is not the stage it is blamed on."""
        return self.acts_at or self.stage

    @property
    def remembers(self) -> bool:
        """Whether a row of it depends on the rows before."""
        return type(self).derive is not Effect.derive

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of this variant."""
        return self.declared

    @abstractmethod
    def apply(self, state: State, *values: cs.SX) -> State:
        """A changed copy of the state; ``values`` are the parameters in their order."""

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """The variants that a recording could show; empty where it could show none."""
        return cls.forms(scope) if cls.fits(scope) else []

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """The variants to be tried on a recording that has what the effect needs.

        Raises:
            PlumblineError: A field has no default, and nothing says which values to try.
        """
        open_ = [f.name for f in fields(cls) if f.default is MISSING]
        if open_:
            mend = "derive from JointEffect where each joint may have it, or write forms(scope)"
            raise fault(cls.__name__, f"{open_[0]} without a default", "its variants", mend)
        return [cls()]

    @classmethod
    def fits(cls, scope: Scope) -> bool:
        """Whether the recording has what the effect needs."""
        still = cls.in_motion and not scope.moving
        still = still or ("time" in cls.needs and scope.stands_still("time"))
        seen = scope.observation in cls.observations
        seen = seen and (not cls.needs_gravity or bool(scope.chain.gravity.any()))
        return seen and scope.has(*cls.needs) and not cls.lacks(scope) and not still

    @classmethod
    def lacks(cls, scope: Scope) -> str:
        """The column that is missing, ``direction, or velocity`` of several; empty if none is."""
        if cls.needs_one_of and not any(scope.has(column) for column in cls.needs_one_of):
            return ", or ".join(cls.needs_one_of)
        if cls.stage in OF_AN_ARM and not scope.arm:
            return "q1"
        apart = (column for column in cls.needs if column not in cls.needs_one_of)
        return next((column for column in apart if not scope.has(column)), "")

    @classmethod
    def out_of_reach(cls, scope: Scope) -> str:
        """Why a recording with all columns may still not be searched for it; empty if it may."""
        return ""

    @classmethod
    def runs_with_time(cls) -> bool:
        """Whether it follows the clock or the temperature, not the arm."""
        return bool({"time", "temperature"} & {*cls.needs, *cls.needs_one_of})

    def unit_of(self, parameter: Parameter, chain: Chain) -> str:
        """The parameter's unit on this robot."""
        return parameter.unit

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Variants close by, for a finer search once this one has been chosen."""
        return ()

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """Forms of it whose widths, all of them known, follow from its fit, these values."""
        return ()

    @property
    def plain(self) -> Effect | None:
        """Of such a form what it is a form of, whose values are its ``found``; of others none."""
        own = {f.name: () for f in fields(self) if f.name in ("found", "bodies", "drives")}
        return replace(self, **own) if getattr(self, "found", ()) else None

    def derive(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """Extra columns (M,) that the formula needs, from the columns of the whole path (M, k)."""
        return {}

    @property
    def variant(self) -> str:
        """What tells this variant from others of the same effect and element, in words."""
        said = (*ELEMENTS, *(f.name for f in fields(self) if f"{{{f.name}}}" in self.words))
        own = [f for f in fields(self) if f.name not in said and f.metadata != UNSAID]
        found = []
        for f in own:
            value, name = getattr(self, f.name), f.name.replace("_", " ")
            if isinstance(value, bool):
                found += [] if value == f.default else [name if value else f"not {name}"]
            else:
                found.append(f"{name} {_shown(value)} {f.metadata.get('unit', '')}".rstrip())
        return ", ".join(found)

    @property
    def sentence(self) -> str:
        """The effect's words with its element and its own fields in their places."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return self.words.format(**{**own, "element": self.element})

    @cached_property
    def tag(self) -> str:
        """What tells this variant from others, to the last digit; for names that must differ."""
        own = [f for f in fields(self) if f.name not in ELEMENTS]
        values = ", ".join(f"{f.name}={_told(getattr(self, f.name))}" for f in own)
        return f" [{values}]" if values else ""

    @cached_property
    def label(self) -> str:
        """Its name with what tells it from its siblings, e.g. ``backlash 2``."""
        return self.name if self.element is None else f"{self.name} {self.element}"


def _shown(value: object) -> str:
    """A field's value to four digits."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_shown, value))})"
    return f"{value:.4g}" if isinstance(value, float) else f"{value}"


def _told(value: object) -> str:
    """A field's value to the last digit; a direction, of which there is one, as it is shown."""
    return _shown(value) if isinstance(value, tuple) else repr(value)


@dataclass(frozen=True)
class JointEffect(Effect):
    """An effect of one joint, numbered from 1."""

    joint: int = 1

    stage = Stage.JOINT
    observations = ALL_OBSERVATIONS

    def unit_of(self, parameter: Parameter, chain: Chain) -> str:
        """Declared of a joint that turns; of one that slides in metres and newtons."""
        slides = chain.kinds[self.joint - 1] == "prismatic"
        return OF_SLIDES.get(parameter.unit, parameter.unit) if slides else parameter.unit

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """One variant a joint."""
        return [cls(joint=j) for j in scope.joints]
