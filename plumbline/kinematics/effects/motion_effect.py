r"""What an effect of a joint's drive is: a term of :class:`~plumbline.kinematics.drive.Drive`.

.. math:: q_k = \text{drive}(u_1, \ldots, u_k;\ \theta), \qquad \theta = \text{null} \Rightarrow
          \text{the ideal drive}

A drive has memory, so it is not stated row by row as other effects are; all else is the same: a
name, a stage, parameters with unit, range, scale and null.

To add one: write a file beside this one, declare its parameter, and put its name into
``OF_DRIVES`` in ``kinematics/effects/__init__.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as cs

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.effect import Effect, Stage
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter

TOLD = ("name", "depends_on", "words", "reference", "source")  # of an effect
FOLLOWING = tuple(law for law in Law if law.follows)
INERT = tuple(law for law in Law if law.known or law.pushes)  # whose drives have one to move
UNITS = {Law.VELOCITY: "rad/s", Law.RATE: "rad/s", Law.TORQUE: "N m", Law.SAMPLED_TORQUE: "N m"}


@dataclass(frozen=True, eq=False)
class Seen:
    """What one joint did, where a search may start from."""

    speed: Array  #: its speeds (N,) [rad/s]
    torque: Array  #: what it took to move so, by the model, or what was asked for (N,) [N m]
    asked: Array  #: acceleration of its commands, where they are positions (N,) [rad/s^2]


@dataclass(frozen=True)
class MotionEffect:
    """One term of a joint's drive, with its parameter as a class attribute."""

    joint: int = 1  #: number of the joint, from 1

    name: ClassVar[str]  #: what it is called; its file is called like it
    term: ClassVar[str] = ""  #: the term of the drive that its number is, or is added to
    #: values that a fit starts from, where they are others than the scale
    first: ClassVar[tuple[float, ...]] = ()
    stage: ClassVar[Stage] = Stage.ACTUATION  #: what is blamed
    reference: ClassVar[str]  #: who describes it, the year in brackets
    #: what it means, in a sentence; ``{element}`` stands for the joint's number
    words: ClassVar[str]
    #: what its error depends on, in a word or two, as other effects say it
    depends_on: ClassVar[str] = "nothing"
    laws: ClassVar[tuple[Law, ...]] = tuple(Law)  #: drives that can have it
    #: whether nothing can be said without the masses of the robot
    needs_masses: ClassVar[bool] = False
    lags: ClassVar[float] = 0.0  #: how late a joint trails a ramp by it, for one of its parameter
    plans: ClassVar[bool] = False  #: whether it has a way of its own between command and servo
    of_command: ClassVar[bool] = False  #: whether its parameter is measured in the commands' unit
    #: where scale and bounds are from, if the parameter does not say it itself
    source: ClassVar[str] = ""
    parameter: ClassVar[Parameter]  #: its number

    def __init_subclass__(cls, of: type[Effect] | None = None, **kwargs: object) -> None:
        """Give the parameter its name, and what is told of the same cause elsewhere."""
        super().__init_subclass__(**kwargs)
        for told in TOLD if of is not None else ():
            if told not in vars(cls):
                setattr(cls, told, getattr(of, told))
        for key, value in list(vars(cls).items()):
            if isinstance(value, Parameter):
                cls.parameter = replace(value, name=key, source=value.source or cls.source)
                setattr(cls, key, cls.parameter)

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Its forms that a drive of this kind may have."""
        return [cls()] if law in cls.laws and (masses or not cls.needs_masses) else []

    @property
    def element(self) -> int:
        """The joint's number."""
        return self.joint

    @property
    def variant(self) -> str:
        """Which of its forms it is; nothing where it has one."""
        return ""

    @property
    def sentence(self) -> str:
        """Its words with the joint's number."""
        return self.words.format(element=self.joint)

    @property
    def is_limit(self) -> bool:
        """Whether it acts from some size on: nothing that stays below tells where that is."""
        return self.parameter.null == self.parameter.upper

    def unit(self, law: Law) -> str:
        """Unit of its parameter: that of the commands, where it is declared in theirs."""
        own = self.parameter.unit
        return UNITS.get(law, own) if self.of_command else own

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        """A copy of the drive that has this term."""
        return drive.changed(**{self.term: value})

    def starts(self, seen: Seen) -> Sequence[float]:
        """Values (k,) that a fit may start from: the scale, either way where signs are open."""
        if self.first:
            return self.first
        p = self.parameter
        both = (p.null + p.scale, p.null - p.scale)
        return [value for value in both if p.lower < value < p.upper]
