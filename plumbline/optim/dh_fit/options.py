"""What is to be fitted, and how; and the one error of a fit that cannot be made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.solvers import Solver
from plumbline.optim.dh_fit.constants import DELTA_ANGLE, DELTA_LENGTH
from plumbline.optim.dh_fit.gauss_newton import GaussNewton
from plumbline.optim.dh_fit.losses import Loss, Norms

FRAMES = ("joint", "registration")
CHOICES = ("identifiable", "all")


@dataclass(frozen=True)
class DHOptions:
    """What is to be fitted, and how.

    Attributes:
        loss: What a misfit costs.
        frame: ``joint``: the camera's frame is six free unknowns on all readings.
            ``registration``: it follows from four points, as published.
        parameters: ``identifiable``: a largest set that the poses can tell, the others at their
            nominal values. ``all``: every one, as published.
        hayati: Whether parallel axes get a tilt.
        delta_length: Half-width of the bounds of d and a [m].
        delta_angle: Half-width of the bounds of alpha, theta and beta [rad].
        solver: What solves it.
    """

    loss: Loss = field(default_factory=Norms)
    frame: str = "joint"
    parameters: str = "identifiable"
    hayati: bool = True
    delta_length: float = DELTA_LENGTH
    delta_angle: float = DELTA_ANGLE
    solver: Solver = field(default_factory=GaussNewton)

    def __post_init__(self) -> None:
        """Refuse what is no choice."""
        for name, value, known in (
            ("frame", self.frame, FRAMES),
            ("parameters", self.parameters, CHOICES),
        ):
            if value not in known:
                raise PlumblineError(
                    f"{name} {value!r} not recognised; choose {' or '.join(known)}"
                )
        for name in ("delta_length", "delta_angle"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise PlumblineError(f"{name} = {getattr(self, name)}: must be > 0 and finite")
