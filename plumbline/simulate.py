"""What is not measured but made up: arms, range finders and instruments, and loops on them.

``plumbline.simulate.session`` and so on; what simulates shares no code with what it judges.
"""

from plumbline.experiments.mpc import campaign, closed_loop, passes, tracked
from plumbline.experiments.reality import (
    arms,
    bench,
    cases,
    drives,
    mpc_scenarios,
    recorder,
    scene,
    session,
    tip_readings,
)
from plumbline.experiments.reality.parts import drawing
from plumbline.experiments.reality.ranging import finder, phantoms, writing
from plumbline.experiments.withheld import design, making

__all__ = [
    "arms",
    "bench",
    "campaign",
    "cases",
    "closed_loop",
    "design",
    "drawing",
    "drives",
    "finder",
    "making",
    "mpc_scenarios",
    "passes",
    "phantoms",
    "recorder",
    "scene",
    "session",
    "tip_readings",
    "tracked",
    "writing",
]
