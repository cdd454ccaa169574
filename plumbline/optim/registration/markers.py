r"""Markers seen twice, in CT and by the robot, and how well each reading is known.

A reading rounded to a grid of pitch :math:`h` errs evenly over :math:`\pm h/2`, so that its
standard deviation is :math:`h / \sqrt{12}`. Who states a standard deviation u does not know it
exactly; one that is itself known to :math:`\Delta u` is worth

.. math:: \nu \approx \tfrac12 (\Delta u / u)^{-2}

readings that it was estimated from (JCGM 100:2008, eq. G.3). Lengths are in m; frame C is that of
the CT, frame R that of the robot.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.core.problem import Array
from plumbline.optim.registration import constants

UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class MarkerNoise:
    """Covariances of the readings of one marker, or of each."""

    ct: Array  #: in CT, along CT's axes, (3, 3) or (n, 3, 3) [m^2]
    robot: Array  #: by the robot, along the robot's axes, (3, 3) or (n, 3, 3) [m^2]
    #: how well their size is known, as so many readings that it was estimated from; inf where it is
    #: exact, 0 where only their proportions are known, and the size is estimated from what the
    #: markers leave over alone
    freedoms: float = constants.STATED

    @classmethod
    def from_std(
        cls, ct: ArrayLike = 0.0, robot: ArrayLike = 0.0, *, freedoms: float = constants.STATED
    ) -> Self:
        """From standard deviations [m]: one number, one an axis (3,), or one a marker (n, 3)."""
        return cls(_diagonal(ct), _diagonal(robot), freedoms)

    @classmethod
    def from_resolution(
        cls, ct: ArrayLike, robot_std: ArrayLike = 0.0, *, freedoms: float = constants.STATED
    ) -> Self:
        """From CT's pitch [m] (slices of 5 mm against 1 mm: ``[5e-3, 1e-3, 1e-3]``)."""
        pitch = np.asarray(ct, dtype=float)
        coarsest = max(pitch.max(initial=0.0), np.max(robot_std, initial=0.0))
        if coarsest > constants.COARSEST:
            found, mend = f"{coarsest:.4g} m", "looks like mm: divide by 1000"
            raise fault("noise", found, f"at most {constants.COARSEST:g} m", mend)
        return cls.from_std(pitch / np.sqrt(12.0), robot_std, freedoms=freedoms)

    @classmethod
    def unknown(cls) -> Self:
        """Alike along all axes and for all markers, of a size to be estimated."""
        return cls(np.zeros((3, 3)), np.eye(3), freedoms=0.0)

    @property
    def known(self) -> bool:
        """Whether anything is known of the covariances' size."""
        return self.freedoms > 0.0


@dataclass(frozen=True, eq=False)
class Markers:
    """n markers, checked: finite, in m, with covariances that have an inverse together."""

    ct: Array  # places in CT (n, 3) [m]
    robot: Array  # places by the robot (n, 3) [m]
    ct_cov: Array  # covariances in CT (n, 3, 3) [m^2]
    robot_cov: Array  # covariances by the robot (n, 3, 3) [m^2]
    labels: tuple[str, ...]  # names (n)
    freedoms: float  # how well the size of the covariances is known, as in :class:`MarkerNoise`

    @classmethod
    def of(
        cls,
        ct: ArrayLike,
        robot: ArrayLike,
        noise: MarkerNoise | None = None,
        labels: Sequence[str] | None = None,
    ) -> Self:
        """Check shapes, numbers, metres, labels and covariances; complete what is not given."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        if c.ndim != 2 or c.shape[1:] != (3,) or c.shape != r.shape:
            found = f"arrays of shapes {c.shape} and {r.shape}"
            raise fault("markers", found, "(n, 3) twice", "give one row a marker in both")
        names = tuple(f"M{k + 1}" for k in range(len(c))) if labels is None else tuple(labels)
        _check_labels(names, len(c))
        _check_numbers(c, "ct", names)
        _check_numbers(r, "robot", names)
        stated = MarkerNoise.unknown() if noise is None else noise
        cov = [_each(v, len(c), w) for v, w in ((stated.ct, "ct"), (stated.robot, "robot"))]
        _check_together(cov[0], cov[1], names)
        return cls(c, r, cov[0], cov[1], names, stated.freedoms)

    def __len__(self) -> int:
        return len(self.ct)

    def select(self, indices: Sequence[int]) -> Self:
        """Some of the markers, in that order."""
        k = list(indices)
        covariances = self.ct_cov[k], self.robot_cov[k]
        names = tuple(self.labels[i] for i in k)
        return type(self)(self.ct[k], self.robot[k], *covariances, names, self.freedoms)

    @property
    def known(self) -> bool:
        """Whether anything was stated of the noise's size."""
        return self.freedoms > 0.0

    @property
    def rows(self) -> Array:
        """One row a marker (n, 18): CT, robot, upper triangles of both covariances."""
        return rows_of(self.ct, self.robot, self.ct_cov, self.robot_cov)

    @property
    def covariance(self) -> Array:
        """Covariances (n, 6, 6) of each marker's six coordinates, CT first [m^2]."""
        joint = np.zeros((len(self), 6, 6))
        joint[:, :3, :3], joint[:, 3:, 3:] = self.ct_cov, self.robot_cov
        return joint


def rows_of(ct: Array, robot: Array, ct_cov: Array, robot_cov: Array) -> Array:
    """Rows (..., n, 18) of places (..., n, 3) and covariances (n, 3, 3)."""
    upper = np.concatenate([cov[:, UPPER[0], UPPER[1]] for cov in (ct_cov, robot_cov)], axis=1)
    return np.concatenate([ct, robot, np.broadcast_to(upper, (*ct.shape[:-1], 12))], axis=-1)


def _diagonal(std: ArrayLike) -> Array:
    values = np.asarray(std, dtype=float)
    if values.ndim > 2 or (values.ndim and values.shape[-1] != 3) or not np.all(values >= 0.0):
        mend = "give one number, three (one an axis) or three a marker"
        raise fault("noise", f"std of shape {values.shape}", "std >= 0, (), (3,) or (n, 3)", mend)
    return np.eye(3) * (np.broadcast_to(values, (*values.shape[:-1], 3)) ** 2)[..., None, :]


def _each(covariance: ArrayLike, n: int, what: str) -> Array:
    values = np.asarray(covariance, dtype=float)
    if values.shape not in ((3, 3), (n, 3, 3)) or not np.isfinite(values).all():
        found = f"a covariance of shape {values.shape}"
        raise fault(f"noise, {what}", found, f"finite, (3, 3) or ({n}, 3, 3)", "mend its shape")
    each = np.broadcast_to(values, (n, 3, 3))
    size = np.abs(each).max(initial=0.0)
    if not np.allclose(each, np.swapaxes(each, 1, 2), rtol=0.0, atol=constants.UNEVEN * size):
        raise fault(f"noise, {what}", "an asymmetric matrix", "a covariance", "symmetrise it")
    if np.linalg.eigvalsh(each).min() < -constants.UNEVEN * size:
        raise fault(f"noise, {what}", "a negative variance", "a covariance", "mend the matrix")
    return each.copy()


def _check_together(ct_cov: Array, robot_cov: Array, labels: Sequence[str]) -> None:
    """Readings known without any error would weigh infinitely much."""
    least = np.linalg.eigvalsh(ct_cov)[:, 0] + np.linalg.eigvalsh(robot_cov)[:, 0]
    largest = max(ct_cov.max(initial=0.0), robot_cov.max(initial=0.0))
    exact = np.flatnonzero(least <= constants.EXACT * largest)
    if len(exact) or largest == 0.0:
        where = f"noise, marker {labels[exact[0]] if len(exact) else labels[0]}"
        mend = "state the robot's std, or the CT's resolution along every axis"
        raise fault(where, "no error at all along some axis", "some noise", mend)


def _check_labels(labels: Sequence[str], n: int) -> None:
    if len(labels) != n:
        raise fault("markers", f"{len(labels)} labels", f"{n}", "name every marker")
    doubled = [name for name, count in Counter(labels).items() if count > 1]
    if doubled:
        raise fault(f"marker {doubled[0]}", "that label twice", "one of each", "rename one")
    if n < constants.FEWEST:
        mend = "stick at least three markers that do not lie on one line"
        raise fault("markers", f"{n} of them", "at least 3", mend)


def _check_numbers(points: Array, what: str, labels: Sequence[str]) -> None:
    broken = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(broken):
        where = f"marker {labels[broken[0]]}, {what}"
        mend = "measure the marker again or leave it out"
        raise fault(where, f"{points[broken[0]].tolist()}", "finite coordinates in m", mend)
    span = float(np.ptp(points, axis=0).max())
    if span > constants.LARGEST:
        where, found = f"markers, {what}", f"markers {span:.4g} m apart"
        raise fault(
            where, found, f"at most {constants.LARGEST:g} m", "looks like mm: divide by 1000"
        )
