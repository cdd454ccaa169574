"""CasADi's sequential quadratic programming, its steps by the active-set solver qrqp.

Andersson and Rawlings 2018, IFAC-PapersOnLine 51(20). Globalised by a line search on a merit
function (Nocedal and Wright 2006, algorithm 18.3); with ``bfgs`` its Hessian is that of Broyden,
Fletcher, Goldfarb and Shanno (procedure 18.2). Its quadratic programmes must have a bottom: where
the Hessian has none, as that of a linear objective, take IPOPT.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from plumbline.optim.core.solvers.programme import Hessian, Programmed


@dataclass(frozen=True)
class Sqp(Programmed):
    """Options of the solver."""

    max_iterations: int = 1000  #: iterations at most
    tolerance: float = 1e-9  #: on the gradient and the constraints of the scaled problem
    bfgs: bool = False  #: hessian by updates instead of Gauss-Newton's or the exact one

    plugin: ClassVar[str] = "sqpmethod"

    @property
    def hessian(self) -> Hessian:
        """What stands for the Hessian."""
        return Hessian.UPDATED if self.bfgs else Hessian.GAUSS_NEWTON

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given."""
        silent = {"print_iter": False, "print_header": False, "error_on_fail": False}
        updates = {"hessian_approximation": "limited-memory"} if self.bfgs else {}
        return updates | {
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
            "error_on_fail": False,
            "max_iter": self.max_iterations,
            "tol_du": self.tolerance,
            "tol_pr": self.tolerance,
            "min_step_size": 1e-14,
            "max_iter_ls": 60,
            "beta": 0.5,
            "merit_memory": 1,
            "qpsol": "qrqp",
            "qpsol_options": silent,
        }
