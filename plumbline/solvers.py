"""Solvers, and what a solver or a method of your own is made of (``docs/howto``).

A :class:`Problem` is stated once and :class:`Mapped` evaluates it; a :class:`Solver` answers with a
:class:`Solution`, which ``judged`` judges by the problem's own statement; ``refuse`` names what a
solver cannot take. What a method says is an :class:`Answer`, judged, shown and stored.
"""

from plumbline.declared import Declared as Declared
from plumbline.optim.core.answer import Answer as Answer
from plumbline.optim.core.judged import Judged as Judged
from plumbline.optim.core.judged import Judgement as Judgement
from plumbline.optim.core.judged import Solution as Solution
from plumbline.optim.core.judged import judged as judged
from plumbline.optim.core.mapped import Gram as Gram
from plumbline.optim.core.mapped import Mapped as Mapped
from plumbline.optim.core.problem import Problem as Problem
from plumbline.optim.core.solvers import ALL as ALL
from plumbline.optim.core.solvers import Fatrop as Fatrop
from plumbline.optim.core.solvers import Ipopt as Ipopt
from plumbline.optim.core.solvers import LevenbergMarquardt as LevenbergMarquardt
from plumbline.optim.core.solvers import Slsqp as Slsqp
from plumbline.optim.core.solvers import Solver as Solver
from plumbline.optim.core.solvers import Sqp as Sqp
from plumbline.optim.core.solvers import TrustRegion as TrustRegion
from plumbline.optim.core.solvers.solver import refuse as refuse
