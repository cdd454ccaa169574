r"""A registration and how far to trust it, to first order in the readings' errors.

.. math:: \Sigma_x = \sum_i J_i \Sigma_i J_i^T, \qquad
          \Sigma_f = K \Sigma_x K^T, \quad K = [\,I\quad {-[f_R - c]_\times}\,]

J is the derivative of the pose by the markers' coordinates, from the symbols of the method, and K
carries it to a target f (Danilchenko and Fitzpatrick 2011, IEEE TMI 30(3)). A rotation that is
poorly held carries a target along an arc, not along its tangent. What is known is the arm a where
the target was found, so that without the turn w it is at :math:`e^{-[w]_\times} a`, and the error
is :math:`w \times a + y` with

.. math:: y = -\tfrac12\, w \times (w \times a), \quad
          E\,y = \tfrac12 (a\, \mathrm{tr}\, \Sigma_w - \Sigma_w a), \quad
          \mathrm{cov}(y_k, y_l) = \tfrac12 \mathrm{tr}(B_k \Sigma_w B_l \Sigma_w),

whose moments are added: next to nothing for well-placed markers, most of what there is across the
arc for markers that are nearly on a line. FRE is the root mean square of the markers' misfits; what
is called calculation error is their mean (Chen Guangbiao et al., eq. 16, rebuilt).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.core.answer import Answer, plain
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.checks import Condition
from plumbline.optim.registration.constants import LARGEST
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.target import (
    TargetError,
    Unstated,
    arc,
    bent,
    lever,
    numbers_of,
    point_of,
)


@dataclass(frozen=True, eq=False)
class Registration(Answer):
    """What a method found."""

    recording: Fiducials  # markers and targets, and how well they were read
    method: str  # its name
    T_RC: Array  # from CT to robot (4, 4) [m]
    scale: float  # lengths in R over lengths in C; 1 unless it was asked for
    used: tuple[int, ...]  # which markers (from 0) the transform rests on
    shifted: tuple[str, ...]  # markers found to have moved, by name
    condition: Condition  # the shape of the used markers, in CT
    centre: Array  # the point (3,) of frame R that ``covariance`` speaks of [m]
    # of the displacement there [m], the rotation vector [rad] and, if found, the relative scale:
    # (6, 6) or (7, 7), along the robot's axes
    covariance: Array
    noise_scale: float  # estimated size s of the noise over the stated one; 1 where that is exact
    # freedoms of that estimate, those of the stated noise included; inf where it is exact
    dof: float
    # chance of markers that fit as badly as these, if the stated noise is right; nan where none was
    # stated
    surprise: float
    notes: tuple[str, ...]  # what is odd, one line each
    reading: Array  # covariance of one reading of a point in CT (3, 3), along CT's axes [m^2]
    unknown: str = ""  # why no error can be predicted; empty where it can
    unstated: Unstated | None = None  # the noise along CT's axes, where nothing was stated of it
    # whether the fit behind it converged; no error is predicted where it has not
    judged: Judgement = field(default_factory=Judgement)
    trust: tuple[str, ...] = ()  # how far to trust it at each target, one sentence each

    def __repr__(self) -> str:
        count = f"{len(self.used)} of {len(self.labels)} markers"
        return f"<Registration by {self.method}: {count}, FRE {1e3 * self.fre:.3g} mm>"

    @property
    def labels(self) -> tuple[str, ...]:
        """The markers' names (n)."""
        return self.recording.markers.labels

    @property
    def residuals(self) -> Array:
        """``T_RC p_C - p_R`` of every marker (n, 3), along the robot's axes [m]."""
        return self.map(self.recording.markers.ct) - self.recording.markers.robot

    @property
    def noise_std(self) -> float:
        """RMS over the axes of the noise of a marker's misfit, stated or estimated [m]."""
        noise = self.recording.noise
        if noise is None:
            return self.noise_scale
        variance = np.trace(noise.ct + noise.robot, axis1=-2, axis2=-1).mean() / 3
        return float(np.sqrt(variance)) * self.noise_scale

    @property
    def misfits(self) -> Array:
        """Length of every marker's residual (n,) [m]."""
        return np.linalg.norm(self.residuals, axis=1)

    @property
    def fre(self) -> float:
        """Root mean square misfit of the markers used [m]."""
        return float(np.sqrt(np.mean(self.misfits[list(self.used)] ** 2)))

    @property
    def calculation_error(self) -> float:
        """Mean misfit of all markers, used or not (eq. 16) [m]."""
        return float(self.misfits.mean())

    @property
    def T_CR(self) -> Array:
        """From robot to CT (4, 4) [m]."""
        return np.linalg.inv(self.T_RC).astype(np.float64)

    def map(self, points: ArrayLike) -> Array:
        """Coordinates in frame R of points (..., 3) of CT [m]; refused if they are none."""
        places = numbers_of(points, "points")
        if places.shape[-1:] != (3,) or not np.isfinite(places).all():
            found = f"shape {places.shape}, {np.sum(~np.isfinite(places))} numbers not finite"
            raise fault("points", found, "finite ones (..., 3) in CT, m", "give x, y and z")
        there = places @ self.T_RC[:3, :3].T + self.T_RC[:3, 3]
        away = float(np.linalg.norm(there - self.centre, axis=-1).max(initial=0.0))
        if away > LARGEST:
            found, mend = f"a point {away:.4g} m from the markers", "looks like mm: divide by 1000"
            raise fault("points", found, f"at most {LARGEST:g} m", mend)
        return there

    def tre(
        self, target: ArrayLike, target_std: ArrayLike | None = 0.0, *, curved: bool = True
    ) -> TargetError:
        """Predicted error at a target (3,) of CT [m].

        Args:
            target: Where it is in CT.
            target_std: How well that is known itself, in CT: a number or one an axis [m]; None if
                it is read as the markers are, so that the region is that of what will be met.
            curved: Add the moments of the arc; without them it is first order alone.
        """
        point = point_of(target, "target")
        place, A = self.map(point), self.T_RC[:3, :3]
        std = None if target_std is None else np.broadcast_to(np.asarray(target_std, float), 3)
        own = self.reading if std is None else np.diag(std**2)
        mean, covariance = self._moments(place, curved)
        arm, read = place - self.centre, A @ own @ A.T
        along = bent(arm, self.covariance, read) if curved else None
        drawn = None
        if self.unstated is not None and not self.unknown:
            drawn = self.unstated.distances(arm, A, std)
        total = covariance + read
        return TargetError(point, place, total, mean, self.dof, self.unknown, drawn, along)

    def tre_rms(self, targets: ArrayLike) -> Array:
        """Predicted RMS error (...) at targets (..., 3) of CT [m], for maps of many points."""
        mean, covariance = self._moments(self.map(targets), curved=True)
        squares = np.trace(covariance, axis1=-2, axis2=-1) + np.sum(mean**2, axis=-1)
        return np.sqrt(squares)

    def _moments(self, places: Array, curved: bool) -> tuple[Array, Array]:
        """Mean (..., 3) and covariance (..., 3, 3) of the error at places (..., 3) of frame R."""
        arm = places - self.centre
        K = lever(arm, len(self.covariance))
        covariance = K @ self.covariance @ np.swapaxes(K, -1, -2)
        if not curved:
            return np.zeros(arm.shape), covariance
        mean, more = arc(arm, self.covariance[3:6, 3:6])
        return mean, covariance + more

    @property
    def rotation_std(self) -> float:
        """Largest standard deviation of the rotation about any axis [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[3:6, 3:6])[-1]))

    def to_dict(self) -> dict[str, Any]:
        """For JSON; lengths in m, angles in deg."""
        shape = self.condition
        return {
            "name": self.recording.name,
            "method": self.method,
            "T_RC": self.T_RC.tolist(),
            "scale": self.scale,
            "fre": self.fre,
            "calculation_error": self.calculation_error,
            "markers": [
                {"label": label, "misfit": float(misfit), "used": k in self.used}
                for k, (label, misfit) in enumerate(zip(self.labels, self.misfits, strict=True))
            ],
            "shifted": list(self.shifted),
            "condition": {
                "angle": shape.angle,
                "sine": shape.sine,
                "spread": shape.spread.tolist(),
            },
            "noise": {
                "stated": not np.isnan(self.surprise),
                "std": self.noise_std,
                "dof": None if np.isinf(self.dof) else self.dof,
                "surprise": None if np.isnan(self.surprise) else self.surprise,
            },
            "judged": plain(self.judged),
            "targets": [self._told(k, words) for k, words in enumerate(self.trust)],
            "notes": list(self.notes),
            "sha256": self.recording.sha256,
        }

    def _told(self, k: int, words: str) -> dict[str, Any]:
        """Where a target is, its predicted error and, if it was measured, the real one."""
        targets = self.recording.targets
        error = self.tre(targets.ct[k], None)
        measured = error.robot - targets.robot[k]
        there = bool(np.isfinite(measured).all())
        known = not error.unknown
        return {
            "label": targets.labels[k],
            "ct": targets.ct[k].tolist(),
            "robot": error.robot.tolist(),
            "tre_rms": error.rms if known else None,
            "mean": error.mean.tolist() if known else None,
            "covariance": error.covariance.tolist() if known else None,
            "semi_axes95": error.semi_axes().tolist() if known else None,
            "unknown": error.unknown or None,
            "measured_error": float(np.linalg.norm(measured)) if there else None,
            "within95": bool(error.holds(measured)[0]) if there and known and error.rms else None,
            "trust": words,
        }
