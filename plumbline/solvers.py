"""Solvers, and what a solver or a method of your own is made of (``docs/howto``).

A :class:`Problem` is stated once and :class:`Mapped` evaluates it; a :class:`Solver` answers with a
:class:`Solution`, which ``judged`` judges by the problem's own statement; ``refuse`` names what a
solver cannot take. What a method says is an :class:`Answer`, judged, shown and stored.
"""

from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judged, Judgement, judged
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import (
    ALL,
    Fatrop,
    Ipopt,
    LevenbergMarquardt,
    Slsqp,
    Solver,
    Sqp,
    TrustRegion,
)
from plumbline.optim.core.solvers.solver import refuse

__all__ = [
    "ALL",
    "Answer",
    "Fatrop",
    "Gram",
    "Ipopt",
    "Judged",
    "Judgement",
    "LevenbergMarquardt",
    "Mapped",
    "Problem",
    "Slsqp",
    "Solution",
    "Solver",
    "Sqp",
    "TrustRegion",
    "judged",
    "refuse",
]
