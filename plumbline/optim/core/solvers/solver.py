"""What every solver offers: which parts of a problem it can take, and its solution."""

from typing import ClassVar, Protocol

from numpy.typing import ArrayLike

from plumbline.declared import Declared
from plumbline.errors import PlumblineError
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Problem


class Solver(Protocol):
    """A frozen dataclass of typed options that declares what it can take."""

    bounds: ClassVar[bool]  #: bounds of the unknowns
    constraints: ClassVar[bool]  #: general constraints g(x)
    objective: ClassVar[bool]  #: an f(x) that is no square
    rows: ClassVar[bool]  #: residuals, of rows and shared ones

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds.

        Raises:
            PlumblineError: The problem has a part that it cannot take.
        """


class OfRows(Declared):
    """What solvers of calibrations take: rows within bounds, and nothing else."""

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    rows: ClassVar[bool] = True


def refuse(solver: Solver, problem: Problem) -> None:
    """Raise a PlumblineError if the problem has a part that the solver would ignore."""
    for part, count in problem.parts.items():
        if count and not getattr(solver, part):
            name = type(solver).__name__
            raise PlumblineError(f"{name}: {count} {part}, 0 allowed; use Ipopt")
