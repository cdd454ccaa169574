r"""Markers on a head: where a CT has them, and where a robot touches them again and again.

.. math:: y = R\,c + t + e, \qquad e \sim N(0, \sigma^2 I)

What is wrong with CT changes c before it is written down; what moves while the robot touches
changes y. Breathing is the cube of half a sine: long at one end, short at the other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array, rotations
from plumbline.experiments.reality.parts.room import Flaw

OF_HEAD = ("marker_shift", "slice_quantisation", "ct_scale", "respiration", "base_bump")
BEYOND = ("sheared_gantry", "sagging_table", "stretched_skin", "creeping_marker")
AXES = (0.075, 0.095, 0.085)  # half axes of a head [m]


@dataclass(frozen=True, eq=False)
class Head:
    """Markers (K, 3) [m], the touches' markers (N,) from 0 and times (N,) [s], CT to robot."""

    markers: Array
    marker: NDArray[np.int64]
    time: Array
    R: Array
    t: Array


def draw_head(rng: np.random.Generator, markers: int, touches: int) -> Head:
    """Markers spread over the upper half of a head, touched in rounds at an uneven pace."""
    way = rng.normal(size=(markers, 3))
    way[:, 2] = np.abs(way[:, 2])
    place = np.array(AXES) * way / np.linalg.norm(way, axis=1, keepdims=True)
    order = np.concatenate([rng.permutation(markers) for _ in range(touches)])
    time = np.cumsum(rng.uniform(3.0, 9.0, len(order)))
    R = rotations(rng.normal(size=3))
    return Head(place, order.astype(np.int64), time, R, rng.uniform(-0.5, 0.5, 3))


def draw_wrong(name: str, head: Head, rng: np.random.Generator) -> Flaw:
    """A thing wrong of that name."""
    way = rng.normal(size=3)
    marked = name in ("marker_shift", "creeping_marker")
    element = int(rng.integers(1, len(head.markers) + 1)) if marked else None
    form = {
        "way": way / np.linalg.norm(way),
        "period": rng.uniform(3.0, 5.5, 1),
        "moment": rng.uniform(0.3, 0.7, 1) * head.time.max(),
        "axis": rng.integers(0, 4, 1).astype(float),
        "spot": head.markers[rng.integers(len(head.markers))],
    }
    return Flaw(name, element, form)


def written(head: Head, wrong: Flaw | None, size: float) -> tuple[Array, Array]:
    """Places in CT (K, 3) as written down, and touches (N, 3) without noise [m]."""
    ct = head.markers.copy()
    if wrong is not None:
        ct = _in_ct(ct, wrong, size)
    at = head.markers[head.marker]
    if wrong is not None and wrong.name == "marker_shift":
        at = at + (head.marker + 1 == wrong.element)[:, None] * size * wrong.form["way"]
    y = at @ head.R.T + head.t
    if wrong is not None:
        y = y + size * _while_touching(head, wrong)
    return ct, y


def _in_ct(ct: Array, wrong: Flaw, size: float) -> Array:
    if wrong.name == "slice_quantisation" and size:
        ct[:, 2] = size * np.floor(ct[:, 2] / size)
    if wrong.name == "ct_scale":
        axis = int(wrong.form["axis"][0])
        wide = slice(None) if axis == 3 else axis
        ct[:, wide] = ct[:, wide] / (1.0 + size)
    if wrong.name == "sheared_gantry":
        ct[:, 1] += np.tan(size) * ct[:, 2]
    if wrong.name == "sagging_table":
        ct[:, 1] += size * (ct[:, 2] / 0.08) ** 2 * np.sign(wrong.form["way"][0])
    if wrong.name == "stretched_skin":
        far = np.linalg.norm(ct - wrong.form["spot"], axis=1)
        ct = ct + size * np.exp(-0.5 * (far / 0.06) ** 2)[:, None] * wrong.form["way"]
    return ct


def _while_touching(head: Head, wrong: Flaw) -> Array:
    time = head.time
    share = np.zeros(len(time))
    if wrong.name == "respiration":
        share = np.abs(np.sin(np.pi * time / wrong.form["period"])) ** 3
    if wrong.name == "base_bump":
        share = (time > wrong.form["moment"]).astype(float)
    if wrong.name == "creeping_marker":
        share = (head.marker + 1 == wrong.element) * (time / time.max())
    return share[:, None] * wrong.form["way"]
