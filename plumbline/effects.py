"""Effects: the library's, and what an effect of your own is made of (``docs/howto/own_effect.md``).

A frozen dataclass that derives from :class:`Effect`, or from :class:`JointEffect` where every joint
may have it, declares each unknown as a :class:`Parameter` and acts on a :class:`State` at its
:class:`Stage`; :class:`Scope` is what a recording offers to it.
"""

from plumbline.kinematics.dynamics import Nominal as Nominal
from plumbline.kinematics.effects import EFFECTS as EFFECTS
from plumbline.kinematics.effects import REGISTRY as REGISTRY
from plumbline.kinematics.effects.effect import Effect as Effect
from plumbline.kinematics.effects.effect import JointEffect as JointEffect
from plumbline.kinematics.effects.effect import Scope as Scope
from plumbline.kinematics.effects.effect import Stage as Stage
from plumbline.kinematics.effects.effect import State as State
from plumbline.kinematics.frames import Transform as Transform
from plumbline.kinematics.parameters import Parameter as Parameter
