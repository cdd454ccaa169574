r"""The closed form on one plane (Zeng et al. 2017, eqs. 13-15).

Pure translations t_j, in the flange frame at the group's first pose, give

.. math:: (d_j - d_0)\, p = -n^T t_j, \quad p = n^T v
          \quad\Rightarrow\quad
          n = -g\, p, \quad g = \Big[\sum t_j t_j^T\Big]^{-1} \sum t_j\, (d_j - d_0)

so that :math:`|n| = 1` makes :math:`p = \pm 1/|g|`, and :math:`n_z > 0` chooses the sign: of n and
p together, which leaves :math:`n^T v = p` the same equation. Three orientations or more give v by
least squares; :math:`v_z > 0` holds for a finder that looks ahead. With the normal m in the base
frame, rotations with translations give r (eq. 15):

.. math:: m^T (R_j - R_0)\, r = -m^T (d_j R_j - d_0 R_0)\, v - m^T (t_j - t_0)

All three come from one symbolic statement (:mod:`plumbline.optim.hand_eye.plane_equation`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.hand_eye.beam import Array, Beam
from plumbline.optim.hand_eye.constants import ALIKE, FLAT, LEAST_GROUP, LEAST_GROUPS
from plumbline.optim.hand_eye.plane_equation import component, poses, rotation, system, translation
from plumbline.optim.hand_eye.readings import Readings


@dataclass(frozen=True, eq=False)
class Slope:
    """What one group of pure translations tells."""

    R: Array  # the group's orientation (3, 3)
    g: Array  # slope of the range over translations in the flange frame (3,)
    n: Array  # the plane's unit normal in that frame (3,), n_z > 0
    p: float  # its component along the beam


@dataclass(frozen=True, eq=False)
class SinglePlane:
    """The closed form's result."""

    beam: Beam  # the beam
    normal: Array  # the plane's unit normal in the base frame (3,), away from the flange
    length: float  # length of v before it was normalised: 1 where all is well


def slope(group: Readings) -> Slope:
    """Slope and normal of one group of pure translations.

    Raises:
        PlumblineError: Fewer than four readings, or translations that do not span space.
    """
    if len(group) < LEAST_GROUP:
        raise PlumblineError(
            f"motion {group.motion[0]}: {len(group)} readings, at least {LEAST_GROUP} expected for "
            "three translations; take more"
        )
    R0 = group.R[0]
    moves = (group.t[1:] - group.t[0]) @ R0
    A, b = system(translation(), np.column_stack([moves, group.distance[1:] - group.distance[0]]))
    gram = A.T @ A
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[::-1], 0.0))
    if not spread[-1] > FLAT * spread[0]:
        _refuse_repeated(group)
        raise PlumblineError(
            f"motion {group.motion[0]}: translations within a plane ({spread[-1] * 1e3:.2g} mm "
            f"beside {spread[0] * 1e3:.3g} mm), three directions expected; change the stand-off too"
        )
    g = np.asarray(-np.linalg.solve(gram, A.T @ b), dtype=float)
    n = -g / np.linalg.norm(g)
    n = n if n[2] > 0.0 else -n
    return Slope(R0, g, n, float(-(n @ g) / (g @ g)))


def _refuse_repeated(group: Readings) -> None:
    """Refuse readings of too few poses, however often each was read."""
    poses = group.distinct
    if poses < LEAST_GROUP:
        raise PlumblineError(
            f"motion {group.motion[0]}: {poses} distinct poses in {len(group)} readings, at least "
            f"{LEAST_GROUP} expected for three translations; move between the readings"
        )


def closed_form(readings: Readings) -> SinglePlane:
    """The beam from the readings of one plane.

    Args:
        readings: Of one plane, in groups of motions: three or more of pure translations at
            different orientations, and one or more that turn the flange.

    Raises:
        PlumblineError: Motions that leave the beam open; the message says which.
    """
    groups = list(readings.motions())
    moved = [group.is_translation for group in groups]
    slopes = [slope(group) for group, still in zip(groups, moved, strict=True) if still]
    v, length = _direction(slopes)
    normal = _common_normal(slopes, v)
    turning = [group for group, still in zip(groups, moved, strict=True) if not still]
    return SinglePlane(Beam(_origin(turning or [readings], normal, v), v), normal, length)


def _direction(slopes: list[Slope]) -> tuple[Array, float]:
    if len(slopes) < LEAST_GROUPS:
        raise PlumblineError(
            f"{len(slopes)} groups of pure translations, at least {LEAST_GROUPS} orientations "
            "expected; keep the flange's orientation within a group"
        )
    N, p = system(component(), np.array([[*s.n, s.p] for s in slopes]))
    sizes = np.linalg.svd(N, compute_uv=False)
    if sizes[-1] < ALIKE * sizes[0]:
        raise PlumblineError(
            "no rotation between the groups: their orientations see the plane alike "
            f"(singular values {sizes[-1]:.1e} beside {sizes[0]:.2g}); tilt the flange between them"
        )
    v = np.asarray(np.linalg.lstsq(N, p, rcond=None)[0], dtype=float)
    length = float(np.linalg.norm(v))
    return v / length, length


def _common_normal(slopes: list[Slope], v: Array) -> Array:
    """Mean of the groups' normals in the base frame, pointing along the beams."""
    normals = np.array([s.R @ s.n * np.sign(s.n @ v) for s in slopes])
    mean = normals.mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _origin(groups: list[Readings], normal: Array, v: Array) -> Array:
    """R (3,) by least squares over groups, each about its own first reading."""
    rows, right = [], []
    for group in groups:
        at = poses(group.R, group.t, group.distance)
        once = np.ones((len(at) - 1, 1))
        given = np.hstack([once * np.concatenate([normal, v]), at[1:], once * at[0]])
        matrix, values = system(rotation(), given)
        rows.append(matrix)
        right.append(values)
    A = np.concatenate(rows)
    sizes = np.linalg.svd(A, compute_uv=False) if len(A) >= 3 else np.zeros(1)
    if len(A) < 3 or sizes[-1] < ALIKE * max(sizes[0], 1e-9) or sizes[0] < ALIKE:
        raise PlumblineError(
            f"no rotation that shows r: {len(A) + len(groups)} readings see the plane from "
            "directions that leave it open; turn the flange by 10 deg or more, about two axes"
        )
    return np.asarray(np.linalg.lstsq(A, np.concatenate(right), rcond=None)[0])
