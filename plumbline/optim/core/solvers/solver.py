"""What every solver offers."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solution import Solution


class Solver(Protocol):
    """A frozen dataclass of typed options that says what it can handle."""

    @property
    def handles_constraints(self) -> bool:
        """Whether general constraints g(x) are allowed."""

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,)."""


def refuse_constraints(name: str, problem: Problem) -> None:
    """Raise a PlumblineError if the problem has constraints that the solver would ignore."""
    if problem.constraints.numel():
        raise PlumblineError(
            f"{name}: {problem.constraints.numel()} constraints, 0 allowed; use Ipopt"
        )
