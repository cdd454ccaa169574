r"""Which motions of a scan does a surface not show? Those that its halves know nothing of alike.

A motion x moves each point along its normal by a = A x. Where a surface is a ball, a pipe or a
plane, some motion moves no point so; but normals from a few points of CT err, and what errs by
chance looks like information. Normals from every other point of the surface, and from the rest, err
apart. With a and b by either half,

.. math:: z = \frac{\sum_i a_i b_i}{\sqrt{\sum_i \big((a_i - b_i)^2 / 2\big)^2}}

is about zero for a motion that the surface does not show, with a variance of a third: for normal
errors of variance s the numerator has :math:`s^2` and the denominator :math:`3 s^2` a point.
"""

from __future__ import annotations

import numpy as np

from plumbline.optim.hand_eye.accuracy import moved
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.surface import Surface, SurfaceFit

# z of drawn balls, pipes and planes is at most 3.1, of drawn heads and boxes 6.7 at the least (8
# draws each of 60 to 1000 points).
SHOWN = 4.0
LEAST_TURN = 1e-3  # [rad]: no normal of a dozen points of CT is known better
SLIDE = 0.3  # of a motion's way at the scan's edge: what turns by less slides


def rows_of(points: Array, normals: Array) -> Array:
    """How unit turns about the middle of points (N, 3) [m], and shifts, move them (N, 6)."""
    return np.hstack([np.cross(points - points.mean(axis=0), normals), normals])


def open_motions(points: Array, fit: SurfaceFit, surface: Array) -> tuple[str, ...]:
    """Motions of a scan that the surface does not show, in words.

    Args:
        points: Scanned, in the base frame (N, 3) [m].
        fit: How they lie on the surface.
        surface: Its points in CT (M, 3) [m].
    """
    R, reach = fit.T[:3, :3], np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    scale = np.repeat([1.0 / reach, 1.0], 3)  # so that a motion's six numbers are ways at the edge
    whole = rows_of(points, fit.normals @ R) * scale
    ways = np.linalg.svd(whole, full_matrices=False)[2]
    halves = []
    for part in (surface[::2], surface[1::2]):
        normals = Surface.of(part).planes(moved(fit.T, points))[1]
        towards = np.sign(np.sum(normals * fit.normals, axis=1, keepdims=True))
        halves.append(rows_of(points, towards * normals @ R) * scale @ ways.T)
    a, b = halves
    noise = np.maximum((a - b) ** 2 / 2.0, LEAST_TURN**2)
    z = np.sum(a * b, axis=0) / np.sqrt(np.sum(noise**2, axis=0))
    left = ways[z < SHOWN]
    # Any mixture of open motions is open: turns are told from slides.
    apart = np.linalg.svd(left[:, :3])[0].T @ left
    return tuple(_words(way) for way in apart)


def _words(motion: Array) -> str:
    """A motion (6,), the turn's way at the scan's edge and the middle's own, as an axis."""
    slides = float(np.linalg.norm(motion[:3])) < SLIDE
    axis = motion[3:] if slides else motion[:3]
    axis = axis / np.linalg.norm(axis) * np.sign(axis[np.argmax(np.abs(axis))])
    return (
        f"{'a slide along' if slides else 'a turn about'} ({', '.join(f'{x:.2f}' for x in axis)})"
    )
