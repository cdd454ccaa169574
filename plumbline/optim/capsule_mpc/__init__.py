"""Several instruments that reach their goals without touching each other or anything else.

Read :mod:`.statement` first: the problem, once, in symbols. :mod:`.bodies` says what moves
and what is in the way, :mod:`.settings` how far, how fast and how near.
:mod:`.linearised` makes a quadratic program of it, which :mod:`.planning` or a library solves at
every step; :mod:`.nonlinear` solves the whole statement, as a reference. :mod:`.controller` is what
a loop calls. What is given to these and what they answer is in SI units; the statement and the
planners count in mm.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.optim.capsule_mpc.bodies import Body as Body
from plumbline.optim.capsule_mpc.bodies import EndsInstrument as EndsInstrument
from plumbline.optim.capsule_mpc.bodies import Obstacle as Obstacle
from plumbline.optim.capsule_mpc.bodies import TipInstrument as TipInstrument
from plumbline.optim.capsule_mpc.controller import Controller as Controller
from plumbline.optim.capsule_mpc.events import Command as Command
from plumbline.optim.capsule_mpc.events import Event as Event
from plumbline.optim.capsule_mpc.events import Mode as Mode
from plumbline.optim.capsule_mpc.events import Trouble as Trouble
from plumbline.optim.capsule_mpc.library_qp import LibraryQp as LibraryQp
from plumbline.optim.capsule_mpc.nonlinear import Nonlinear as Nonlinear
from plumbline.optim.capsule_mpc.planning import BandedQp as BandedQp
from plumbline.optim.capsule_mpc.planning import OneStep as OneStep
from plumbline.optim.capsule_mpc.planning import Plan as Plan
from plumbline.optim.capsule_mpc.planning import Planner as Planner
from plumbline.optim.capsule_mpc.planning import RealTime as RealTime
from plumbline.optim.capsule_mpc.planning import shifted as shifted
from plumbline.optim.capsule_mpc.plant import Plant as Plant
from plumbline.optim.capsule_mpc.settings import Confidence as Confidence
from plumbline.optim.capsule_mpc.settings import Noise as Noise
from plumbline.optim.capsule_mpc.settings import Safety as Safety
from plumbline.optim.capsule_mpc.settings import Settings as Settings
from plumbline.optim.capsule_mpc.statement import Statement as Statement
from plumbline.optim.capsule_mpc.waypoints import Guide as Guide
