r"""Along a shaft and across it: the axes of drives that turn a shaft about its trocar and slide it.

A frame R of a shaft has its direction e for the third axis, and comes from that of the direction
inward, i, by the shortest turn. With :math:`v = i \times e`,

.. math:: R w = w + v \times w + \frac{v \times (v \times w)}{1 + i \cdot e}

What moves by rates u moves by :math:`R^T u` along these axes, and its way along them is the sum of
:math:`R^T dx`.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import TINY
from plumbline.optim.core.problem import Array


@runtime_checkable
class ThroughTrocar(Protocol):
    """A body whose state is the place of its tip: a ``TipInstrument``."""

    @property
    def trocar(self) -> Sequence[float]:
        """The point that the shaft passes through [m]."""

    @property
    def inward(self) -> Sequence[float]:
        """Direction into the body through the trocar's plane."""


class Shafts:
    """Shafts through trocars, by their tips."""

    def __init__(self, bodies: Sequence[object], unit: float) -> None:
        """For places in units of so many metres."""
        tips = [body for body in bodies if isinstance(body, ThroughTrocar)]
        if len(tips) < len(bodies):
            raise PlumblineError(
                f"turned: found {len(bodies) - len(tips)} bodies that are no TipInstrument, "
                "expected none; give a plant along the axes of the state"
            )
        self._trocars = np.array([body.trocar for body in tips]) / unit
        inward = np.array([body.inward for body in tips], dtype=float)
        self._inward = inward / np.linalg.norm(inward, axis=1, keepdims=True)
        # Two axes across the direction inward, then that, for each (I, 3, 3), as columns.
        aside = np.eye(3)[np.abs(self._inward).argmin(axis=1)]
        first = np.cross(np.cross(self._inward, aside), self._inward)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        self._rest = np.stack([first, np.cross(self._inward, first), self._inward], axis=-1)

    def frames(self, tips: Array) -> Array:
        """Frames (..., I, 3, 3) of shafts with tips (..., 3 I), axes as columns."""
        e = tips.reshape(*tips.shape[:-1], -1, 3) - self._trocars
        e = e / np.maximum(np.linalg.norm(e, axis=-1, keepdims=True), TINY)
        v = np.cross(self._inward, e)
        share = 1.0 / np.maximum(1.0 + np.vecdot(self._inward, e), 1e-3)
        across = np.zeros((*v.shape, 3))  # the matrix of v x
        across[..., [2, 0, 1], [1, 2, 0]], across[..., [1, 2, 0], [2, 0, 1]] = v, -v
        once = across @ self._rest
        return np.asarray(self._rest + once + share[..., None, None] * (across @ once))


def along(frames: Array, values: Array) -> Array:
    """Vectors (..., 3 I) along the axes of frames (..., I, 3, 3)."""
    parts = values.reshape(*values.shape[:-1], -1, 3)
    return np.asarray((parts[..., None, :] @ frames).reshape(values.shape))


def back(frames: Array, values: Array) -> Array:
    """The same vectors (..., 3 I) from what they are along the frames' axes."""
    parts = values.reshape(*values.shape[:-1], -1, 3)
    return np.asarray((frames @ parts[..., None]).reshape(values.shape))
