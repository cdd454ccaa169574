"""What solves a problem; the choice is made at the call, never in the statement.

Each declares what it can take (:class:`~plumbline.optim.core.solvers.solver.Solver`), and refuses
the rest by name.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.optim.core.answer import register_kinds
from plumbline.optim.core.solvers.levenberg_marquardt import (
    LevenbergMarquardt as LevenbergMarquardt,
)
from plumbline.optim.core.solvers.programme import Fatrop as Fatrop
from plumbline.optim.core.solvers.programme import Ipopt as Ipopt
from plumbline.optim.core.solvers.programme import Sqp as Sqp
from plumbline.optim.core.solvers.scipy_trust_region import Slsqp as Slsqp
from plumbline.optim.core.solvers.scipy_trust_region import TrustRegion as TrustRegion
from plumbline.optim.core.solvers.solver import Solver as Solver

register_kinds(Solver, LevenbergMarquardt, TrustRegion, Ipopt, Sqp, Slsqp, Fatrop)

# Those that take any calibration: SLSQP is for few rows, FATROP for stages.
ALL: tuple[Solver, ...] = (LevenbergMarquardt(), TrustRegion(), Ipopt(), Sqp())
