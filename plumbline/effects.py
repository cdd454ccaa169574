"""Effects: the library's, and what an effect of your own is made of (``docs/howto/own_effect.md``).

A frozen dataclass that derives from :class:`Effect`, or from :class:`JointEffect` where every joint
may have it, declares each unknown as a :class:`Parameter` and acts on a :class:`State` at its
:class:`Stage`; :class:`Scope` is what a recording offers to it.
"""

from plumbline.kinematics.effects import EFFECTS, REGISTRY
from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, Stage, State
from plumbline.kinematics.frames import Transform
from plumbline.kinematics.loads import Nominal
from plumbline.kinematics.parameters import Parameter

__all__ = [
    "EFFECTS",
    "REGISTRY",
    "Effect",
    "JointEffect",
    "Nominal",
    "Parameter",
    "Scope",
    "Stage",
    "State",
    "Transform",
]
