r"""One link of the chain: what it adds to the error at a point, or at each of N points.

.. math:: e_k = b_k + \epsilon_k, \qquad \epsilon_k \sim N(0, C_k), \qquad \hat b_k \sim N(b_k, S_k)

The mean :math:`b_k` is systematic, and known to :math:`S_k`; :math:`C_k` is what differs from one
time to the next, its size known from :math:`\nu_k` readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.budget.constants import FEWEST, SYMMETRIC
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.answer import HandEye
from plumbline.optim.hand_eye.constants import LONGEST
from plumbline.optim.model.arm import Arm
from plumbline.optim.registration.constants import COARSEST
from plumbline.optim.registration.target import TargetError

MEAN_TO_RMS = float(np.sqrt(3.0 * np.pi / 8.0))  # of a length whose axes are normal and alike


@dataclass(frozen=True, eq=False)
class Source:
    """A link of the chain."""

    name: str  # what it is called
    mean: Array  # its systematic error at each point (N, 3) [m]
    covariance: Array  # of what differs from time to time (N, 3, 3) [m^2]
    mean_covariance: Array  # how well the mean is known (N, 3, 3) [m^2]
    dof: float = np.inf  # freedoms that the covariance's size was known from; inf where it is exact
    cured: Source | None = None  # the same link once it is mended; None where nothing mends it
    origin: str = ""  # where its figures are from, in words

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
        origin: str = "",
    ) -> Self:
        """A link by its moments, the same at all points or one a point.

        Args:
            name: What it is called.
            mean: Systematic error (3,) or (N, 3) [m].
            covariance: Variance of an axis, or matrix (3, 3) or (N, 3, 3) [m^2].
            mean_covariance: Of the mean, in the same forms.
            dof: Freedoms of the covariance's size.
            cured: The same link once it is mended.
            origin: Where its figures are from.

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
        return cls(name, b, C, S, dof, cured, origin)

    @classmethod
    def of_rms(cls, name: str, rms: float, *, dof: float = np.inf, origin: str = "") -> Self:
        """A link of which only its RMS in space [m] is known: alike along all axes."""
        size_of(f"source {name}, rms", rms)
        return cls.of(name, covariance=rms**2 / 3.0, dof=dof, origin=origin)

    @classmethod
    def of_mean_length(
        cls, name: str, length: float, *, dof: float = np.inf, origin: str = ""
    ) -> Self:
        """A link of which the mean length of its error [m] is told, which is less than its RMS."""
        rms = MEAN_TO_RMS * size_of(f"source {name}, mean length", length)
        return cls.of(name, covariance=rms**2 / 3.0, dof=dof, origin=origin)

    @classmethod
    def of_target(cls, name: str, error: TargetError) -> Self:
        """What a registration says of its own error at a target.

        Raises:
            PlumblineError: It knows no region there.
        """
        if error.unknown:
            raise fault(f"source {name}", error.unknown, "a known error", "register more markers")
        return cls.of(
            name, mean=error.mean, covariance=error.covariance, dof=error.dof, origin="registration"
        )

    @classmethod
    def of_hand_eye(
        cls, name: str, found: HandEye, distance: float, R: ArrayLike | None = None
    ) -> Self:
        """What the beam's own error does to a point rebuilt with it, the arm's error left out.

        Args:
            name: What it is called.
            found: The calibration's answer.
            distance: Range at which the point is seen [m].
            R: Orientations of the flange in the base frame (3, 3) or (N, 3, 3); without them the
                error is told in the flange's frame, which is enough for its size.

        Raises:
            PlumblineError: A range that is none.
        """
        c = found.calibration
        return cls.of_beam(name, c.covariance, len(c.readings), len(c.planes), distance, R)

    @classmethod
    def of_beam(
        cls,
        name: str,
        covariance: ArrayLike,
        readings: int,
        boards: int,
        distance: float,
        R: ArrayLike | None = None,
    ) -> Self:
        """The same by a beam's covariance (6, 6) [m, 1], of so many readings on so many boards."""
        if not 0.0 < distance <= LONGEST:
            expected = f"a range above 0, at most {LONGEST:g} m"
            mend = "looks like mm: divide by 1000" if distance > LONGEST else "give it in m"
            raise fault(f"source {name}, range", f"{distance:g}", expected, mend)
        turn = np.eye(3) if R is None else np.asarray(R, dtype=float)
        J = turn @ np.hstack([np.eye(3), distance * np.eye(3)])  # r + d v
        spread = J @ np.asarray(covariance, dtype=float) @ np.swapaxes(J, -1, -2)
        # Five unknowns of the beam, three of each board.
        dof = max(readings - 5 - 3 * boards, 1)
        even = (spread + np.swapaxes(spread, -1, -2)) / 2.0
        return cls.of(name, covariance=even, dof=float(dof), origin="hand-eye calibration")

    @classmethod
    def of_tracking(cls, name: str, wanted: ArrayLike, reached: ArrayLike) -> Self:
        """A controller by a closed loop: where a tip should have been, and where it was.

        Errors of one motion resemble their neighbours, so the rows count for as many as are
        independent (Geyer 1992, Practical Markov chain Monte Carlo, initial positive sequence).

        Args:
            name: What it is called.
            wanted: In the order of time (N, 3) [m].
            reached: At the same times (N, 3) [m].

        Raises:
            PlumblineError: Other shapes, fewer than four rows, or values that are not finite.
        """
        to, at = np.asarray(wanted, dtype=float), np.asarray(reached, dtype=float)
        if to.ndim != 2 or to.shape[1:] != (3,) or to.shape != at.shape or len(to) < FEWEST:
            told = f"shapes {to.shape} and {at.shape}"
            expected = f"twice (N, 3), N at least {FEWEST}"
            raise fault(f"source {name}", told, expected, "give tips of one motion, m")
        e = at - to
        if not np.isfinite(e).all():
            raise fault(f"source {name}", "values that are not finite", "m", "leave them out")
        alone = _independent(e)
        C = np.cov(e, rowvar=False)
        return cls.of(
            name,
            mean=e.mean(axis=0),
            covariance=C,
            mean_covariance=C / alone,
            dof=max(3.0 * (alone - 1.0), 1.0),
            origin=f"closed loop of {len(e)} rows, {alone:.0f} independent",
        )

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
        return cls.of(
            name, mean=off, covariance=beyond, mean_covariance=known, cured=cured, origin="model"
        )

    def mended(self, cured: Source | None) -> Self:
        """The same link with another cure."""
        return replace(self, cured=cured)

    @property
    def points(self) -> int:
        """At how many points it is told; one that is the same everywhere counts one."""
        return max(len(self.mean), len(self.covariance), len(self.mean_covariance))


def size_of(where: str, length: float) -> float:
    """A length that someone wrote down as the size of an error [m] (PlumblineError: it is none)."""
    if not (np.isfinite(length) and length >= 0.0):
        raise fault(where, f"{length}", "a length of at least 0", "give it in m")
    if length > COARSEST:
        mend = "looks like mm: divide by 1000" if length <= 1e3 * COARSEST else "give it in m"
        raise fault(where, f"{length:g}", f"at most {COARSEST:g} m", mend)
    return length


def _independent(e: Array) -> float:
    """As how many independent rows the rows (N, 3) of a motion count."""
    off = e - e.mean(axis=0)
    size = float((off**2).sum())
    if not size:
        return float(len(e))
    lags = range(1, len(e) - 1)
    rho = np.array([(off[k:] * off[:-k]).sum() / size for k in lags])
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    positive = int(np.argmin(pairs > 0.0)) if (pairs <= 0.0).any() else len(pairs)
    return float(np.clip(len(e) / (1.0 + 2.0 * pairs[:positive].sum()), 1.0, len(e)))


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
