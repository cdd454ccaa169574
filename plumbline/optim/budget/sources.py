r"""One link of the chain: what it adds to the error at a point, or at each of N points.

.. math:: e_k = b_k + \epsilon_k, \qquad \epsilon_k \sim N(0, C_k), \qquad \hat b_k \sim N(b_k, S_k)

The mean :math:`b_k` is systematic, and known to :math:`S_k`; :math:`C_k` is what differs from one
time to the next, its size known from :math:`\nu_k` readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.errors import fault
from plumbline.optim.model.arm import Arm
from plumbline.optim.registration.target import TargetError

Array = NDArray[np.float64]
SYMMETRIC = 1e-9  # of a covariance's largest entry, by which two entries may differ


@dataclass(frozen=True, eq=False)
class Source:
    """A link of the chain.

    Attributes:
        name: What it is called.
        mean: Its systematic error at each point (N, 3) [m].
        covariance: Of what differs from time to time (N, 3, 3) [m^2].
        mean_covariance: How well the mean is known (N, 3, 3) [m^2].
        dof: Freedoms that the covariance's size was known from; inf where it is exact.
        cured: The same link once it is mended; None where nothing mends it.
    """

    name: str
    mean: Array
    covariance: Array
    mean_covariance: Array
    dof: float = np.inf
    cured: Source | None = None

    @classmethod
    def of(
        cls,
        name: str,
        *,
        mean: ArrayLike = (0.0, 0.0, 0.0),
        covariance: ArrayLike = 0.0,
        mean_covariance: ArrayLike = 0.0,
        dof: float = np.inf,
        cured: Source | None = None,
    ) -> Self:
        """A link by its moments, the same at all points or one a point.

        Args:
            name: What it is called.
            mean: Systematic error (3,) or (N, 3) [m].
            covariance: Variance of an axis, or matrix (3, 3) or (N, 3, 3) [m^2].
            mean_covariance: Of the mean, in the same forms.
            dof: Freedoms of the covariance's size.
            cured: The same link once it is mended.

        Raises:
            PlumblineError: A shape or a value that is no moment.
        """
        b = np.atleast_2d(np.asarray(mean, dtype=float))
        where = f"source {name}"
        if b.ndim != 2 or b.shape[1] != 3 or not np.isfinite(b).all():
            raise fault(f"{where}, mean", f"shape {np.shape(mean)}", "(3,) or (N, 3)", "give m")
        if not dof > 0.0:
            raise fault(f"{where}, dof", f"{dof}", "a number above 0", "leave it out if exact")
        C, S = (_covariances(v, where) for v in (covariance, mean_covariance))
        return cls(name, b, C, S, dof, cured)

    @classmethod
    def of_rms(cls, name: str, rms: float, *, dof: float = np.inf) -> Self:
        """A link of which only its RMS in space [m] is known: alike along all axes."""
        if not (np.isfinite(rms) and rms >= 0.0):
            raise fault(f"source {name}, rms", f"{rms}", "a length of at least 0", "give it in m")
        return cls.of(name, covariance=rms**2 / 3.0, dof=dof)

    @classmethod
    def of_target(cls, name: str, error: TargetError) -> Self:
        """What a registration says of its own error at a target.

        Raises:
            PlumblineError: It knows no region there.
        """
        if error.unknown:
            raise fault(f"source {name}", error.unknown, "a known error", "register more markers")
        return cls.of(name, mean=error.mean, covariance=error.covariance, dof=error.dof)

    @classmethod
    def of_arm(cls, name: str, arm: Arm, q: ArrayLike, **context: ArrayLike) -> Self:
        """An arm commanded by its nominal model, at postures (N, n); cured: by the found model.

        Cured there stays what the model itself is not sure of, and what it left on rows left out
        beyond their noise.
        """
        known = arm.uncertainty(q, device=False, **context)
        missed = np.nan_to_num(max(arm.held.after**2 - np.nan_to_num(arm.held.floor) ** 2, 0.0))
        beyond = missed / 3.0 * np.eye(3) if arm.held.unit == "m" else np.zeros((3, 3))
        off = arm.tip(q, **context) - arm.nominal.tip(q, **context)
        cured = cls.of(name, covariance=known + beyond)
        return cls.of(name, mean=off, covariance=beyond, mean_covariance=known, cured=cured)

    def mended(self, cured: Source | None) -> Self:
        """The same link with another cure."""
        return replace(self, cured=cured)

    @property
    def points(self) -> int:
        """At how many points it is told; one that is the same everywhere counts one."""
        return max(len(self.mean), len(self.covariance), len(self.mean_covariance))


def _covariances(values: ArrayLike, where: str) -> Array:
    given = np.asarray(values, dtype=float)
    C = given * np.eye(3) if given.ndim == 0 else given
    C = C[None] if C.ndim == 2 else C
    fits = C.ndim == 3 and C.shape[1:] == (3, 3) and np.isfinite(C).all()
    largest = float(np.abs(C).max(initial=0.0)) if fits else 0.0
    if not fits or np.abs(C - C.transpose(0, 2, 1)).max() > SYMMETRIC * largest:
        expected = "a variance, (3, 3) or (N, 3, 3), symmetric"
        raise fault(f"{where}, covariance", f"shape {given.shape}", expected, "give m^2")
    if largest and np.linalg.eigvalsh(C).min() < -SYMMETRIC * largest:
        raise fault(f"{where}, covariance", "a negative variance", "none", "check its signs")
    return np.asarray(C)
