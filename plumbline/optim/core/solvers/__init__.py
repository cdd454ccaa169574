"""What solves a problem; the choice is made at the call, never in the statement."""

from plumbline.errors import PlumblineError
from plumbline.optim.core.solvers.ipopt import Ipopt
from plumbline.optim.core.solvers.levenberg_marquardt import LevenbergMarquardt
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion
from plumbline.optim.core.solvers.solver import Solver

ALL: tuple[Solver, ...] = (LevenbergMarquardt(), TrustRegion(), Ipopt())

__all__ = ["ALL", "Ipopt", "LevenbergMarquardt", "PlumblineError", "Solver", "TrustRegion"]
