r"""What a set of poses can see of the beam, and what it cannot, in words.

The Fisher information of (r, v), every plane's normal, offset and bow eliminated, is the inverse of
its covariance :math:`\Sigma`. With u = R^T n the normal as the flange sees it, a reading's equation
moves by :math:`u^T \delta r + d\, u^T \delta v`: poses tell nothing new unless u or d changes.
Turning the flange about the normal changes neither. Along the beam, r shows only by the change of
:math:`\cos\theta = u^T v`, which is why it is known least; and an offset of the range, or a bias in
proportion to :math:`1/\cos\theta - 1`, moves the equations exactly as r along the beam does.
"""

from dataclasses import dataclass
from typing import SupportsFloat

import numpy as np
import scipy

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings
from plumbline.optim.hand_eye.three_planes import parallel_planes


@dataclass(frozen=True)
class Direction:
    """One direction of the unknown beam."""

    name: str  # what it is, in words
    std: float  # its standard error [m or rad]
    unit: str  # ``"m"`` or ``"rad"``

    @property
    def lost(self) -> bool:
        """Whether the poses say nothing of it."""
        return not self.std < (constants.LOST_R if self.unit == "m" else constants.LOST_V)

    @property
    def poor(self) -> bool:
        """Whether it is known badly."""
        return not self.std < (constants.POOR_R if self.unit == "m" else constants.POOR_V)


@dataclass(frozen=True)
class Observability:
    """What the poses see."""

    rank: int  # how many of the beam's five unknowns they determine
    directions: tuple[Direction, ...]  # r along the beam, the worst of r across it, the worst of v
    unseen: tuple[str, ...]  # what they cannot see, a line each


def observability(
    readings: Readings, frames: Frames, beam: Beam, covariance: Array, incidence: Array, bias: float
) -> Observability:
    """Read a covariance (6, 6) of (r [m], v) as words; incidence (N,) [rad], assumed bias [m]."""
    v, across = beam.v, np.linalg.svd(beam.v[None])[2][1:]
    r_cov, v_cov = covariance[:3, :3], across @ covariance[3:, 3:] @ across.T
    sizes, turns = (
        [_root(k) for k in np.linalg.eigvalsh(C)] for C in (across @ r_cov @ across.T, v_cov)
    )
    found = (
        Direction("r along the beam", _root(v @ r_cov @ v), "m"),
        Direction("r across the beam", sizes[-1], "m"),
        Direction("the direction of v", turns[-1], "rad"),
    )
    rank = sum(s < constants.LOST_R for s in [found[0].std, *sizes]) + sum(
        s < constants.LOST_V for s in turns
    )
    lines = [_reason(d, readings, incidence) for d in found if d.poor]
    lines += patch_words(readings, beam) + parallel_words(readings, frames)
    # What no readings on planes show, and what was assumed of it.
    lines.append(
        "an offset of the range, or a bias that grows as 1/cos of the incidence: r along the beam "
        f"takes them up; its error has {bias * 1e3:.2g} mm for the bias (incidence_bias_std)"
    )
    return Observability(rank, found, tuple(lines))


def _root(value: SupportsFloat) -> float:
    return float(np.sqrt(max(float(value), 0.0)))


def _reason(direction: Direction, readings: Readings, incidence: Array) -> str:
    """What cannot be seen well, why, and what would show it."""
    low, high = np.rad2deg([incidence.min(), incidence.max()])
    how = (
        f"{direction.std * 1e3:.2g} {'mm' if direction.unit == 'm' else 'mrad'} standard error"
        if not direction.lost
        else "not at all"
    )
    if direction.name.endswith("along the beam"):
        why = f"incidence spans {low:.0f} to {high:.0f} deg only; meet planes at 0 and at 30 deg"
    else:  # across the beam r and v go together, at the ranges' mean
        span = np.ptp(readings.distance) * 1e3
        why = (
            f"incidence spans {low:.0f} to {high:.0f} deg, ranges span {span:.3g} mm; tilt the "
            "flange about two axes, both ways, and vary the stand-off"
        )
    return f"{direction.name} ({how}): {why}"


def patch_words(readings: Readings, beam: Beam) -> list[str]:
    """A line for every plane all of whose points lie on one patch, or on one line."""
    points = beam.points(readings.R, readings.t, readings.distance)
    limit = constants.PATCH * float(np.mean(readings.distance))
    found = []
    for k in readings.planes:
        own = points[readings.plane == k]
        spread = np.linalg.svd(own - own.mean(axis=0), compute_uv=False) / np.sqrt(len(own))
        if 2.0 * spread[0] < limit:
            found.append(
                f"the normal of plane {k}: one patch, all its points within "
                f"{2e3 * spread[0]:.1f} mm; spread them over the board"
            )
        elif 2.0 * spread[1] < constants.LINE * float(np.mean(readings.distance)):
            found.append(f"the normal of plane {k}: its points lie on one line; spread them out")
    return found


def parallel_words(readings: Readings, frames: Frames) -> list[str]:
    """A line for every pair of parallel planes."""
    return [
        f"planes {readings.planes[i]} and {readings.planes[j]} apart: they are parallel planes "
        f"(within {np.rad2deg(angle):.1f} deg), so that the second adds rows but no direction"
        for i, j, angle in parallel_planes(frames)
    ]


def refuse_degenerate(readings: Readings) -> None:
    """Refuse motions without any turn, which leave the beam open whatever it is."""
    largest = float(readings.turns().max())
    if largest < constants.LEAST_TURN:
        raise PlumblineError(
            f"no rotation: all {len(readings)} orientations of the flange agree within "
            f"{np.rad2deg(largest):.2g} deg, so that r cannot be seen; turn the flange by 10 deg "
            "or more, about two axes"
        )


def refuse_unturned(readings: Readings, sigma: float) -> None:
    """Refuse turns that leave r open where a start of such a scatter [m] found no planes.

    An open beam lets a start end anywhere, and another way to read the poses may leave less scatter
    by chance. How far poses turn is the same in every order of a quaternion.
    """
    why = turn_words(readings)
    if sigma > constants.SUSPECT and why:
        raise PlumblineError(f"the readings leave open r: {why}")


def refuse_lost(
    found: Observability, readings: Readings, beam: Beam, covariance: Array, incidence: Array
) -> None:
    """Refuse readings that determine neither planes nor beam, saying what is open."""
    patches = [line for line in patch_words(readings, beam) if "one patch" in line]
    if len(patches) == len(readings.planes):
        raise PlumblineError(f"the readings cannot show {patches[0]}")
    if not any(d.lost for d in found.directions):
        return
    what = open_words(covariance, beam)
    worst = next(d for d in found.directions if d.lost)
    why = turn_words(readings) or _reason(worst, readings, incidence).split(": ", 1)[1]
    raise PlumblineError(f"the readings leave open {what}: {why}")


def open_words(covariance: Array, beam: Beam) -> str:
    """Which directions of the beam are lost, by the eigenvectors of their covariances."""
    values, axes = np.linalg.eigh(covariance[:3, :3])
    sizes = np.sqrt(np.maximum(values, 0.0))
    lost = axes[:, sizes >= constants.LOST_R]
    how = (
        f"standard error {sizes[-1] * 1e3:.0f} mm, at most {constants.LOST_R * 1e3:.0f} mm expected"
    )
    how = "infinite standard error" if sizes[-1] > constants.INFINITE else how
    if lost.shape[1] == 3:
        return f"r altogether ({how})"
    if lost.shape[1] == 2:
        return f"r in every direction but {_axis(axes[:, 0])} of the flange ({how})"
    if lost.shape[1] == 1:
        along = abs(float(lost[:, 0] @ beam.v)) > constants.ALONG
        name = "the beam" if along else f"{_axis(lost[:, 0])} of the flange"
        return f"r along {name} ({how})"
    return "the direction of v"


def _axis(axis: Array) -> str:
    """An axis in words, its largest component positive."""
    signed = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return "(" + ", ".join(f"{x + 0.0:.2f}" for x in np.round(signed, 2)) + ")"


def turn_words(readings: Readings) -> str:
    """Why turns show too little: no turn on any plane, or all about one axis; else empty."""
    turns = np.concatenate([_turns(readings.on_plane(int(k))) for k in readings.planes])
    _, sizes, axes = np.linalg.svd(turns, full_matrices=False)
    largest, second = sizes[:2] / np.sqrt(len(turns))
    if largest < constants.ONE_TURN:
        why = f"on each plane all orientations agree within {np.rad2deg(largest):.2g} deg"
    elif second < constants.ONE_TURN or second < constants.ONE_AXIS * largest:
        why = f"on each plane the flange turns about {_axis(axes[0])} of its own frame alone"
    else:
        return ""
    return f"{why}; turn it by 10 deg or more about two axes on every plane"


def _turns(readings: Readings) -> Array:
    """Rotation vectors (N, 3) [rad] from the first orientation, in the flange's own frame."""
    relative = np.swapaxes(readings.R[:1], 1, 2) @ readings.R
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(relative).as_rotvec())
