"""How a range finder is calibrated."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

from plumbline.errors import fault
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.hand_eye.constants import (
    ARM_SHAPES,
    GROSS,
    LARGEST_NOISE,
    MOST_POSES,
    POSES,
    SHAPES,
)


@dataclass(frozen=True)
class HandEyeOptions:
    """What is fitted besides the beam, what is gross, and how many next poses are looked for.

    Attributes:
        shapes: Smooth shapes a board may take; 0 takes boards as flat.
        arm: Smooth shapes the arm's error may take; 0 takes the arm as its model.
        bias: Standard deviation [m] of kappa, the bias of slanted beams over 1 / cos - 1, that no
            readings on planes can show; 0 takes them as unbiased, None takes what the recording
            states, or else 0.4 mm.
        gross: Errors beyond so many sigmas are gross.
        poses: How many next poses to look for, 0 to 50.
        seed: Of their candidates.
        solver: What solves the statement in the end.

    Raises:
        PlumblineError: A value out of its range.
    """

    shapes: int = SHAPES
    arm: int = ARM_SHAPES
    bias: float | None = None
    gross: float = GROSS
    poses: int = POSES
    seed: int = 0
    solver: Solver = field(default_factory=LevenbergMarquardt)

    def __post_init__(self) -> None:
        """Refuse what is no choice."""
        for name, most in (("shapes", None), ("arm", None), ("poses", MOST_POSES), ("seed", None)):
            value = getattr(self, name)
            if value < 0 or (most is not None and value > most):
                limit = "0 or more" if most is None else f"0 to {most}"
                raise fault(name, f"{value}", limit, "give a whole number in that range")
        if not (isfinite(self.gross) and self.gross > 0.0):
            raise fault("gross", f"{self.gross:g} sigmas", "more than 0", "4.5 is the default")
        if self.bias is not None and not 0.0 <= self.bias < LARGEST_NOISE:
            mend = "give 1 sigma in m, over 1 / cos - 1 of the incidence"
            raise fault("bias", f"{self.bias:g} m", f"0 to {LARGEST_NOISE:g} m", mend)
