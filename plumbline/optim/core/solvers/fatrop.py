"""FATROP (Vanroye et al. 2023, IROS): for unknowns that are states and controls of stages.

The statement must stand as it looks for it: stage by stage states, then controls; dynamics, then
the rest of a stage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers.programme import Hessian, solve


@dataclass(frozen=True)
class Fatrop:
    """Options of the solver.

    Attributes:
        max_iterations: Iterations at most.
        tolerance: Its own.
        barrier: Its first barrier parameter.
    """

    max_iterations: int = 200
    tolerance: float = 1e-8
    barrier: float = 1e-1

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    rows: ClassVar[bool] = False
    plugin: ClassVar[str] = "fatrop"
    hessian: ClassVar[Hessian] = Hessian.EXACT

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given; ``equality`` says which constraints (c) are equations."""
        own = {"print_level": 0, "tol": self.tolerance, "mu_init": self.barrier}
        found = {"expand": True, "error_on_fail": False, "equality": equality}
        return found | {
            "structure_detection": "auto",
            "fatrop": own | {"max_iter": self.max_iterations},
        }

    def solve(
        self,
        problem: Problem,
        start: ArrayLike,
        multipliers: tuple[Array, Array] | None = None,
    ) -> Solution:
        """Solve from a start (P,), and from multipliers, if given."""
        return solve(self, problem, start, multipliers)
