"""What solves a problem; the choice is made at the call, never in the statement."""

from plumbline.optim.core.solvers.ipopt import Ipopt
from plumbline.optim.core.solvers.levenberg_marquardt import LevenbergMarquardt
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion
from plumbline.optim.core.solvers.solver import Solver, SolverError

ALL: tuple[Solver, ...] = (LevenbergMarquardt(), TrustRegion(), Ipopt())

__all__ = ["ALL", "Ipopt", "LevenbergMarquardt", "Solver", "SolverError", "TrustRegion"]
