"""What solves a problem; the choice is made at the call, never in the statement.

Each declares what it can take (:class:`~plumbline.optim.core.solvers.solver.Solver`), and refuses
the rest by name.
"""

from plumbline.errors import PlumblineError
from plumbline.optim.core.solvers.fatrop import Fatrop
from plumbline.optim.core.solvers.ipopt import Ipopt
from plumbline.optim.core.solvers.levenberg_marquardt import LevenbergMarquardt
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion
from plumbline.optim.core.solvers.slsqp import Slsqp
from plumbline.optim.core.solvers.solver import Solver
from plumbline.optim.core.solvers.sqp import Sqp
from plumbline.optim.core.stored import register_kinds

register_kinds(Solver, LevenbergMarquardt, TrustRegion, Ipopt, Sqp, Slsqp, Fatrop)

# Those that take any calibration: SLSQP is for few rows, FATROP for stages.
ALL: tuple[Solver, ...] = (LevenbergMarquardt(), TrustRegion(), Ipopt(), Sqp())

__all__ = [
    "ALL",
    "Fatrop",
    "Ipopt",
    "LevenbergMarquardt",
    "PlumblineError",
    "Slsqp",
    "Solver",
    "Sqp",
    "TrustRegion",
]
