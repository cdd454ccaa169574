"""IPOPT (Waechter and Biegler 2006, Math. Programming 106) with exact derivatives."""

from dataclasses import dataclass
from typing import Any, ClassVar

from plumbline.optim.core.solvers.programme import Hessian, Programmed


@dataclass(frozen=True)
class Ipopt(Programmed):
    """Options of the solver."""

    max_iterations: int = 200  #: iterations at most
    tolerance: float = 1e-9  #: IPOPT's own tolerance on the scaled problem
    exact_hessian: bool = False  #: full second derivatives of the squares instead of Gauss-Newton's
    #: IPOPT's other options by their names there; these go before our own
    further: tuple[tuple[str, float | str], ...] = ()
    #: whether functions are expanded into scalar operations: faster for small ones
    expand: bool = False

    plugin: ClassVar[str] = "ipopt"

    @property
    def hessian(self) -> Hessian:
        """What stands for the Hessian."""
        return Hessian.EXACT if self.exact_hessian else Hessian.GAUSS_NEWTON

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given."""
        own = {
            "print_level": 0,
            "sb": "yes",
            "tol": self.tolerance,
            # Close to the optimum rounding spoils the line search: three tries are enough.
            "acceptable_tol": 10 * self.tolerance,
            "acceptable_iter": 3,
            "max_iter": self.max_iterations,
            "bound_relax_factor": 0.0,
            "nlp_scaling_method": "none",
        }
        quiet = {"show_eval_warnings": False, "error_on_fail": False, "expand": self.expand}
        return quiet | {"ipopt": own | dict(self.further)}
