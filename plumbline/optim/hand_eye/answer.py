"""What a recording of a range finder says: the beam, its planes, what to distrust, what is next."""

from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.optim.core.answer import Answer, plain
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.accuracy import repeatability
from plumbline.optim.hand_eye.calibrate import Calibration, HandEyeOptions, calibrate
from plumbline.optim.hand_eye.constants import OVERSTATED, UNDERSTATED
from plumbline.optim.hand_eye.design import NextPose, next_poses, point_std
from plumbline.optim.hand_eye.direct import incidence
from plumbline.optim.hand_eye.recording import RangeRecording, load_ranges


@dataclass(frozen=True, eq=False)
class Board:
    """One plane of the recording."""

    label: str  # what the recording calls it
    normal: Array  # unit normal (3,) in the base frame, away from the flange
    centre: Array  # a point of it (3,) in the base frame [m]
    rows: int  # readings that count
    rms: float  # what the fit leaves over [m]
    unflatness: float  # how far it is from flat where it was read, root mean square [m]


@dataclass(frozen=True, eq=False)
class HandEye(Answer):
    """Where the beam sits, and what it rests on."""

    name: str  # name of the recording
    rows: int  # readings in it
    calibration: Calibration  # the calibration
    boards: tuple[Board, ...]  # its planes
    angles: Array  # angles between them [rad], pair by pair in their order
    repeatability: float | None  # of points rebuilt [m]: measured on marks, or None without marks
    point_std: float  # standard error of points rebuilt, by the beam's own alone [m]
    # distance of held-out readings from the planes, root mean square [m], or None
    held_out: float | None
    next: tuple[NextPose, ...]  # poses that would help most
    notes: tuple[str, ...]  # what must be known to read it

    def __repr__(self) -> str:
        return f"<HandEye for {self.name[:60]}: {self.calibration!r}>"

    @property
    def judged(self) -> Judgement:
        """Whether the fit behind it converged, with the figures."""
        return self.calibration.judged

    def to_dict(self) -> dict[str, Any]:
        """For JSON, in SI units."""
        c = self.calibration
        measured = self.repeatability is not None
        spread = self.repeatability if measured else self.point_std
        return {
            "name": self.name,
            "rows": self.rows,
            "r": _estimate(c.beam.r, c.std[:3], "m"),
            "v": _estimate(c.beam.v, c.std[3:], "1"),
            "covariance": c.covariance.tolist(),
            "repeatability": {"value": spread, "unit": "m", "measured": measured},
            "point_std": {"value": self.point_std, "unit": "m"},
            "noise": {
                "normal": float(np.sqrt(c.variance.normal)),
                "at_30_deg": float(np.sqrt(max(c.variance.normal + c.variance.slant / 4.0, 0.0))),
                "unit": "m",
            },
            "incidence_bias": {"std": c.bias, "unit": "m"},
            "arm": {"std": c.arm, "unit": "m"},
            "held_out": self.held_out,
            "planes": [_board(board) for board in self.boards],
            "angles": {"value": np.rad2deg(self.angles).tolist(), "unit": "deg"},
            "gross": [int(row) for row in c.gross],
            "observability": {
                "rank": c.seen.rank,
                "of": 5,
                "directions": [asdict(direction) for direction in c.seen.directions],
            },
            "unseen": list(c.seen.unseen),
            "judged": asdict(c.judged),
            "next": [_pose(pose) for pose in self.next],
            "notes": list(self.notes),
        }


def hand_eye(
    recording: RangeRecording | str | Path, options: HandEyeOptions | None = None
) -> HandEye:
    """Calibrate a range finder on a flange and say what is known of its beam.

    Args:
        recording: Readings on planes, or their folder.
        options: What is fitted besides, what is gross, how many next poses are looked for.

    Raises:
        PlumblineError: The folder cannot be used, the motions leave the beam open, or the readings
            contradict each other.
    """
    recording = load_ranges(recording) if isinstance(recording, str | Path) else recording
    given = options or HandEyeOptions()
    if given.bias is None:
        given = replace(given, bias=recording.incidence_bias_std)
    c = calibrate(recording.readings, given)
    kept = np.isin(recording.readings.row, c.readings.row)
    q = None if recording.q is None else recording.q[kept]
    found: tuple[NextPose, ...] = ()
    if given.poses:
        found = next_poses(c, given.poses, seed=given.seed, chain=recording.chain, q=q)
    return HandEye(
        name=recording.name,
        rows=len(recording.readings),
        calibration=c,
        boards=_boards(c, recording.labels),
        angles=np.array([one.angle_to(other) for one, other in combinations(c.planes, 2)]),
        repeatability=None if recording.marks is None else repeatability(c.beam, recording.marks),
        point_std=point_std(c),
        held_out=_held_out(c, recording),
        next=found,
        notes=(
            *recording.notes,
            *c.notes,
            *c.judged.failures,
            *_noise_notes(c, recording.noise_std),
        ),
    )


def _held_out(c: Calibration, recording: RangeRecording) -> float | None:
    """Root mean square distance [m] of held-out readings from the planes taken as flat."""
    held = recording.held_out
    if held is None:
        return None
    known = np.isin(held.plane, c.readings.planes)
    held = held.select(known)
    points = c.beam.points(held.R, held.t, held.distance)
    index = np.searchsorted(c.readings.planes, held.plane)
    gaps = [c.planes[k].distances(p[None])[0] for k, p in zip(index, points, strict=True)]
    return float(np.sqrt(np.mean(np.square(gaps)))) if len(gaps) else None


def _boards(c: Calibration, labels: tuple[str, ...]) -> tuple[Board, ...]:
    heights, found = c.heights(), []
    for plane, k in zip(c.planes, c.readings.planes, strict=True):
        rows = c.readings.plane == k
        found.append(
            Board(
                label=labels[k - 1] if labels else str(k),
                normal=plane.normal,
                centre=plane.centre,
                rows=int(rows.sum()),
                rms=_rms(c.errors[rows]),
                unflatness=_rms(heights[rows]),
            )
        )
    return tuple(found)


def _noise_notes(c: Calibration, stated: float | None) -> tuple[str, ...]:
    scatter = float(np.sqrt(c.variance.normal))
    if stated is not None and scatter * OVERSTATED < stated:
        return (
            f"the finder states {stated * 1e3:.3g} mm, but readings scatter by {scatter * 1e3:.3g} "
            "mm about the boards: is noise_std one sigma in m? It is not used, the scatter is",
        )
    if stated is None or scatter <= UNDERSTATED * stated:
        return ()
    steep = float(np.rad2deg(incidence(c.readings, c.beam, c.planes).max()))
    return (
        f"readings scatter by {scatter * 1e3:.3f} mm about the boards, the finder states "
        f"{stated * 1e3:.3f} mm: look at the finder's scale, the boards, the arm and beams up to "
        f"{steep:.0f} deg, or ask plumbline diagnose",
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _estimate(value: Array, std: Array, unit: str) -> dict[str, Any]:
    return {"value": value.tolist(), "std": std.tolist(), "unit": unit}


def _board(board: Board) -> dict[str, Any]:
    found: dict[str, Any] = plain(asdict(board))
    return {"plane": found.pop("label"), **found, "unit": "m"}


def _pose(pose: NextPose) -> dict[str, Any]:
    found: dict[str, Any] = plain(asdict(pose))
    incidence, distance = np.rad2deg(found.pop("incidence")), found.pop("distance")
    return {**found, "range": distance, "incidence_deg": float(incidence)}
