r"""What a scan says: angles between a block's faces, and where CT lies, with their errors.

The angle of two faces with unit normals n_1, n_2 errs by what their points leave over and by the
beam's own error,

.. math:: \sigma_\alpha^2 = \sum_{i \ne j} \sum_m \frac{\sigma_i^2}{\lambda_{im}}
          \Big(\frac{e_{im}^T n_j}{\sin\alpha}\Big)^2 + g^T \Sigma\, g

with e and lambda a face's own axes and its points' scatter along them, g the angle's derivative by
(r, v). A surface's points n^T (\omega \times p + \tau) = e give the motion's covariance likewise:
that of least squares, and that of the beam, which moves all points together.
"""

from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Self

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.accuracy import moved
from plumbline.optim.hand_eye.answer import HandEye
from plumbline.optim.hand_eye.readings import Beam, least_median_plane
from plumbline.optim.hand_eye.scan_recording import ScanRecording, load_scan
from plumbline.optim.hand_eye.surface import open_motions, register_surface, rows_of


@dataclass(frozen=True, eq=False)
class FaceAngle:
    """An angle between two faces."""

    faces: tuple[str, str]  # their names
    angle: float  # the angle [rad], 0 to 90 deg
    std: float  # its standard error [rad]


@dataclass(frozen=True, eq=False)
class Laid:
    """A scan laid on a surface."""

    T: Array  # from the base frame to CT (4, 4) [m]
    distances: Array  # of the points from the surface (N,) [m]
    targets: Array  # the targets in the base frame (j, 3) [m]
    stds: Array  # their standard errors (j,) [m]
    edge: float  # standard error at the scan's edge [m]


@dataclass(frozen=True, eq=False)
class ScanOptions:
    """With which beam a scan is rebuilt."""

    #: the answer of a calibration, or a beam; None takes that of the recording
    beam: HandEye | Beam | None = None
    #: of a beam's (r [m], v), (6, 6); none takes the beam as exact. An answer has one.
    covariance: Array | None = None

    def chosen(self, recording: ScanRecording) -> tuple[Beam, Array]:
        """The beam and its covariance (6, 6), refused where there is none."""
        if isinstance(self.beam, HandEye):
            return self.beam.calibration.beam, self.beam.calibration.covariance
        if self.beam is not None:
            return self.beam, np.zeros((6, 6)) if self.covariance is None else self.covariance
        if recording.beam is None:
            raise PlumblineError(
                "no beam: found neither --beam nor [beam] in dataset.toml; run: plumbline handeye "
                "FOLDER --json OUT, then give --beam OUT (in Python: ScanOptions(beam=...))"
            )
        return recording.beam, recording.covariance


@dataclass(frozen=True, eq=False)
class ScanAnswer(Answer):
    """Angles between a block's faces, or where CT lies for the robot."""

    recording: ScanRecording  # the scan
    beam: Beam  # the beam it was rebuilt with
    points: Array  # rebuilt points (N, 3) in the base frame [m]
    angles: tuple[FaceAngle, ...]  # between faces, pair by pair; empty without faces
    flatness: Array  # what each face's points leave over, root mean square [m]
    left_out: tuple[int, ...]  # how many readings of each face are gross
    laid: Laid | None  # on the surface; None without one
    judged: Judgement  # whether the surface's fit converged; of faces nothing is iterated

    def __repr__(self) -> str:
        found = f"{len(self.angles)} angles between faces"
        if self.laid is not None:
            found = f"{1e3 * self.laid.edge:.2g} mm standard error at its edge"
        return f"<ScanAnswer for {self.recording.name[:60]}: {len(self.points)} readings, {found}>"

    def to_dict(self) -> dict[str, Any]:
        """For JSON, in SI units and degrees."""
        r, laid = self.recording, self.laid
        content: dict[str, Any] = {"name": r.name, "rows": len(r), "notes": list(r.notes)}
        content["faces"] = [
            {"face": label, "rms": float(rms), "left_out": out, "unit": "m"}
            for label, rms, out in zip(r.labels, self.flatness, self.left_out, strict=True)
        ]
        content["angles"] = [
            {"faces": list(a.faces), "value": float(np.rad2deg(a.angle)),
             "std": float(np.rad2deg(a.std)), "unit": "deg"}
            for a in self.angles
        ]  # fmt: skip
        content["judged"] = asdict(self.judged)
        content["surface"] = None
        if laid is not None:
            d = laid.distances
            content["surface"] = {
                "T_ct_base": laid.T.tolist(), "distance": float(d.mean()), "std": float(d.std()),
                "max": float(d.max()), "std_at_edge": laid.edge, "unit": "m",
                "targets": [
                    {"label": label, "base": p.tolist(), "std": float(s), "unit": "m"}
                    for label, p, s in zip(r.target_labels, laid.targets, laid.stds, strict=True)
                ],
            }  # fmt: skip
        return content


def scan(recording: ScanRecording | str | Path, options: ScanOptions | None = None) -> ScanAnswer:
    """Rebuild a scan's points and say what they mean.

    Args:
        recording: The scan, or its folder.
        options: The beam that it was made with; the recording's own by default.

    Raises:
        PlumblineError: There is no beam, the scan does not find the surface, or the surface leaves
            it open.
    """
    r = load_scan(recording) if isinstance(recording, str | Path) else recording
    beam, covariance = (options or ScanOptions()).chosen(r)
    points = beam.points(r.R, r.t, r.distance)
    angles, flatness, left_out = _block(r, beam, covariance)
    if r.surface is None:
        return ScanAnswer(r, beam, points, angles, flatness, left_out, None, Judgement())
    laid, judged = _laid(r, points, covariance)
    fits = Judgement.of([judged])
    return ScanAnswer(r, beam, points, angles, flatness, left_out, laid, fits)


def _block(
    r: ScanRecording, beam: Beam, covariance: Array
) -> tuple[tuple[FaceAngle, ...], Array, tuple[int, ...]]:
    if r.face is None:
        return (), np.empty(0), ()
    start = beam.points(r.R, r.t, r.distance)
    rows = [_good(start, np.flatnonzero(r.face == k)) for k in np.unique(r.face)]

    def faces(at: Beam) -> list[_Face]:
        points = at.points(r.R, r.t, r.distance)
        return [_Face.of(points[own]) for own in rows]

    found = faces(beam)
    first = _angles(found)
    x = np.concatenate([beam.r, beam.v])
    shifted = [_angles(faces(Beam.of(y[:3], y[3:]))) for y in x + constants.SCAN_STEP * np.eye(6)]
    slope = (np.array(shifted) - first) / constants.SCAN_STEP
    by_beam = np.einsum("pa,pq,qa->a", slope, covariance, slope)
    own = np.array([_own_variance(one, two) for one, two in combinations(found, 2)])
    names = combinations(r.labels, 2)
    stds = np.sqrt(by_beam + own)
    found_angles = zip(names, first, stds, strict=True)
    angles = tuple(FaceAngle(n, float(a), float(s)) for n, a, s in found_angles)
    counts = np.unique(r.face, return_counts=True)[1]
    left_out = tuple(int(count - len(own)) for count, own in zip(counts, rows, strict=True))
    return angles, np.array([face.sigma for face in found]), left_out


def _good(points: Array, rows: Indices) -> Indices:
    """Those rows of a face whose points lie within reach of its plane of least median."""
    if len(rows) < constants.LEAST_ROBUST:
        return rows
    gaps = np.abs(least_median_plane(points[rows]).distances(points[rows]))
    sigma = constants.TO_SIGMA * np.sqrt(len(rows) / (len(rows) - 3.0)) * float(np.median(gaps))
    return rows[gaps <= max(constants.FACE_GROSS * sigma, constants.LEAST_GROSS)]


@dataclass(frozen=True, eq=False)
class _Face:
    """A face: its unit normal (3,), axes within it (2, 3), their scatter (2,), what is left."""

    normal: Array
    axes: Array
    scatter: Array
    sigma: float

    @classmethod
    def of(cls, points: Array) -> Self:
        _, sizes, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        sigma = float(sizes[2] / np.sqrt(max(len(points) - 3, 1)))
        return cls(axes[2], axes[:2], sizes[:2] ** 2, sigma)


def _angles(faces: list[_Face]) -> Array:
    pairs = np.array(list(combinations([face.normal for face in faces], 2)))
    one, two = pairs[:, 0], pairs[:, 1]
    return np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.abs(np.vecdot(one, two)))


def _own_variance(one: _Face, two: _Face) -> float:
    """Variance [rad^2] of an angle by what two faces' points leave over."""
    sine = max(float(np.linalg.norm(np.cross(one.normal, two.normal))), constants.LEAST_SINE)
    total = 0.0
    for own, other in ((one, two), (two, one)):
        lever = (own.axes @ other.normal) / sine
        total += float(
            np.sum(own.sigma**2 / np.maximum(own.scatter, constants.VANISHING) * lever**2)
        )
    return total


def _laid(r: ScanRecording, points: Array, covariance: Array) -> tuple[Laid, Judged]:
    assert r.surface is not None
    fit = register_surface(points, r.surface, r.landmarks)
    inverse = np.asarray(np.linalg.inv(fit.T), dtype=float)
    normals = fit.normals @ fit.T[:3, :3]  # in the base frame
    centre = points.mean(axis=0)
    A = rows_of(points, normals)
    reach = float(np.linalg.norm(points - centre, axis=1).max())
    scale = np.repeat([1.0 / reach, 1.0], 3)  # so that all six are lengths at the edge
    _, sizes, Vt = np.linalg.svd(A * scale, full_matrices=False)
    sigma = float(np.sqrt(np.sum(fit.distances**2) / max(len(points) - 6, 1)))
    edge = sigma / max(float(sizes[-1]), constants.VANISHING)
    _refuse_open(open_motions(points, fit, r.surface), edge)
    root = scale[:, None] * Vt.T / sizes
    # The beam's error moves every point by R (dr + d dv): what of it the motion takes up.
    seen = np.einsum("ni,nij->nj", normals, r.R)
    gain = root @ root.T @ A.T @ np.hstack([seen, r.distance[:, None] * seen])
    motion = sigma**2 * root @ root.T + gain @ covariance @ gain.T
    targets = moved(inverse, r.targets)
    stds = np.array([_spread(p - centre, motion) for p in targets])
    total = float(np.sqrt(np.linalg.eigvalsh(motion / np.outer(scale, scale))[-1]))
    return Laid(fit.T, fit.distances, targets, stds, total), fit.judged


def _refuse_open(motions: tuple[str, ...], edge: float) -> None:
    """Refuse a scan that may move on its surface unseen, naming how."""
    mend = "scan more sides: a plane, a pipe or a ball fixes nothing"
    if motions:
        what = f"{' and '.join(motions)} of the base"
        raise PlumblineError(
            f"the surface leaves the scan open: its normals show nothing of {what}; {mend}"
        )
    if not edge <= constants.LOST_EDGE:
        raise PlumblineError(
            f"the surface leaves the scan open: standard error {edge * 1e3:.3g} mm at its edge, at "
            f"most {constants.LOST_EDGE * 1e3:.0f} mm expected; {mend}"
        )


def _spread(arm: Array, motion: Array) -> float:
    """Standard error [m] of a point by the motion's covariance (6, 6) about the centre."""
    x, y, z = arm
    turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    J = np.hstack([turn, np.eye(3)])
    return float(np.sqrt(np.trace(J @ motion @ J.T)))
