"""What solves a problem; the choice is made at the call, never in the statement.

Each declares what it can take (:class:`~plumbline.optim.core.solvers.solver.Solver`), and refuses
the rest by name.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.optim.core.solvers.fatrop import Fatrop as Fatrop
from plumbline.optim.core.solvers.ipopt import Ipopt as Ipopt
from plumbline.optim.core.solvers.levenberg_marquardt import (
    LevenbergMarquardt as LevenbergMarquardt,
)
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion as TrustRegion
from plumbline.optim.core.solvers.slsqp import Slsqp as Slsqp
from plumbline.optim.core.solvers.solver import Solver as Solver
from plumbline.optim.core.solvers.sqp import Sqp as Sqp
from plumbline.optim.core.stored import register_kinds

register_kinds(Solver, LevenbergMarquardt, TrustRegion, Ipopt, Sqp, Slsqp, Fatrop)

# Those that take any calibration: SLSQP is for few rows, FATROP for stages.
ALL: tuple[Solver, ...] = (LevenbergMarquardt(), TrustRegion(), Ipopt(), Sqp())
