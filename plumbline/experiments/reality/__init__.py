"""Reality for static recordings: plain NumPy, sharing nothing with the models that it judges.

Read `arm` (geometry and weight), then `scene` (the chain of a reading), the five files of effects,
`gap` (how strong an effect is once frame and tool have been fitted), `recorder` and `cases`.
"""

from plumbline.experiments.reality.cases import Plan, draw_case
from plumbline.experiments.reality.recorder import Case, Recording, simulate, write

__all__ = ["Case", "Plan", "Recording", "draw_case", "simulate", "write"]
