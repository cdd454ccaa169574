"""What every method of registration offers, and what it hands to the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.markers import MarkerNoise, Markers


@dataclass(frozen=True, eq=False)
class Fit:
    """A transform and how the markers move it; the report judges it."""

    T_RC: Array  # from CT to robot (4, 4) [m]
    centre: Array  # the point (3,) of frame R that the derivatives are taken at [m]
    # derivative (k, n, 6) of the pose by each marker's coordinates, CT first: displacement at the
    # centre [m/m], rotation vector [rad/m] and, where k = 7, the relative scale [1/m]
    jacobian: Array
    used: tuple[int, ...]  # which markers (from 0) the transform rests on
    scale: float = 1.0  # lengths in R over lengths in C
    shifted: tuple[int, ...] = ()  # markers found to have moved
    notes: tuple[str, ...] = ()  # what is odd, one line each
    doubt: str = ""  # why the error of this fit cannot be predicted; empty where it can
    # whether what was iterated converged; a closed form has nothing to judge
    judged: Judgement = field(default_factory=Judgement)


@runtime_checkable
class Method(Protocol):
    """A frozen dataclass of typed options; a new method is one file and one line in ``METHODS``."""

    @property
    def name(self) -> str:
        """What the command line calls it."""

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers' coordinates."""

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of many draws of the same markers (..., n, 3) [m], unchecked."""
