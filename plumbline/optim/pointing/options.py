"""What counts as safe, and how hard to look."""

from dataclasses import dataclass, field

import numpy as np

from plumbline.declared import AtLeastOne, Declared, NotNegative, Positive
from plumbline.errors import PlumblineError
from plumbline.optim.core.solvers import Solver
from plumbline.optim.pointing.statement import IPOPT, SweepWeights
from plumbline.optim.pointing.task import Bounded, NeedleTask


@dataclass(frozen=True)
class PointingOptions(Declared):
    """Limits that a plan has to keep."""

    least_singular_value: Positive = 0.02  #: of the needle's task [rad/rad]
    #: of arm and needle from the body, and of the tip in front of it [m]
    least_clearance: NotNegative = 2e-3
    #: largest motion of a joint between neighbouring angles [rad]; of one that slides, as a share
    #: of the arm's length
    longest_step: Positive = 0.3
    limit_margin: NotNegative = 0.01  #: what is kept free of each end of a joint's range [rad]
    branches: AtLeastOne = 1  #: how many branches of the inverse kinematics are planned in full
    weights: SweepWeights = field(default_factory=SweepWeights)  #: what the path is chosen for
    #: what solves for the path; it must take bounds, constraints and an objective
    solver: Solver = IPOPT

    def bounded(self, task: NeedleTask) -> Bounded:
        """A task within its joint limits and their margin, refused where no range is left."""
        margin = self.limit_margin * task.steps
        lower, upper = task.chain.lower + margin, task.chain.upper - margin
        if (lower >= upper).any():
            j = int(np.argmax(lower >= upper))
            raise PlumblineError(
                f"limit_margin = {self.limit_margin:g}: nothing is left of the range of joint "
                f"{task.chain.joint_names[j]!r}; choose a smaller one"
            )
        return Bounded(task, lower, upper)
