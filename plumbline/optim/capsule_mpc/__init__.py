"""Several instruments that reach their goals without touching each other or anything else.

Read :mod:`.statement` first: the problem, once, in symbols. :mod:`.bodies` says what moves,
:mod:`.settings` how far, how fast and how near, :mod:`.scene` what is in the way.
:mod:`.linearised` makes a quadratic program of it, which :mod:`.banded_qp` or a library solves at
every step; :mod:`.nonlinear` solves the whole statement, as a reference. :mod:`.controller` is what
a loop calls. Lengths are in mm throughout.
"""

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.banded_qp import BandedQp
from plumbline.optim.capsule_mpc.bodies import Body, EndsInstrument, TipInstrument
from plumbline.optim.capsule_mpc.controller import Controller
from plumbline.optim.capsule_mpc.events import Command, Event, Mode, Trouble
from plumbline.optim.capsule_mpc.guide import Guide
from plumbline.optim.capsule_mpc.library_qp import LibraryQp
from plumbline.optim.capsule_mpc.nonlinear import Nonlinear
from plumbline.optim.capsule_mpc.planning import OneStep, Plan, Planner, RealTime, shifted
from plumbline.optim.capsule_mpc.plant import Plant, Safety
from plumbline.optim.capsule_mpc.scene import Obstacle
from plumbline.optim.capsule_mpc.settings import Confidence, Noise, Settings
from plumbline.optim.capsule_mpc.statement import Statement

__all__ = [
    "BandedQp",
    "Body",
    "Command",
    "Confidence",
    "Controller",
    "EndsInstrument",
    "Event",
    "Guide",
    "LibraryQp",
    "Mode",
    "Noise",
    "Nonlinear",
    "Obstacle",
    "OneStep",
    "Plan",
    "Planner",
    "Plant",
    "PlumblineError",
    "RealTime",
    "Safety",
    "Settings",
    "Statement",
    "TipInstrument",
    "Trouble",
    "shifted",
]
