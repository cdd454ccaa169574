"""FATROP (Vanroye et al. 2023, IROS): for unknowns that are states and controls of stages.

The statement must stand as it looks for it: stage by stage states, then controls; dynamics, then
the rest of a stage.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from plumbline.optim.core.solvers.programme import Programmed


@dataclass(frozen=True)
class Fatrop(Programmed):
    """Options of the solver."""

    max_iterations: int = 200  #: iterations at most
    tolerance: float = 1e-8  #: its own
    barrier: float = 1e-1  #: its first barrier parameter

    rows: ClassVar[bool] = False
    plugin: ClassVar[str] = "fatrop"

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given; ``equality`` says which constraints (c) are equations."""
        own = {"print_level": 0, "tol": self.tolerance, "mu_init": self.barrier}
        found = {"expand": True, "error_on_fail": False, "equality": equality}
        return found | {
            "structure_detection": "auto",
            "fatrop": own | {"max_iter": self.max_iterations},
        }
