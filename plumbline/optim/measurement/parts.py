r"""Planes and markers: what a range should have read, and how far planes and CT's slices reach.

.. math:: d = \frac{n_k^T (p_k - o)}{n_k^T v}

with the beam from o along v, plane k through p_k with the normal n_k away from the finder, all in
the base frame.
"""

from dataclasses import replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import State
from plumbline.kinematics.frames import constant
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import LEAST_HALF
from plumbline.optim.measurement.nuisance import Nuisance, basis
from plumbline.optim.recording.recording import Recording

HALVES = "half widths"


def on_its_plane(state: State, R_base_tip: cs.SX, nuisance: Nuisance) -> State:
    """The state with its range as its reading, and where and how the beam meets the plane.

    Args:
        state: The closed chain, whose reading is where the beam starts.
        R_base_tip: Orientation of the flange.
        nuisance: Beam and planes.
    """
    assert nuisance.anchor is not None
    planes = nuisance.anchor[1]
    here = cs.vertcat(*(state.row["element"] == k for k in range(1, len(planes) + 1)))
    turned = R_base_tip @ state.R_tip_tool
    normal, way = nuisance.normals @ here, turned[:, 2]
    length = cs.dot(normal, nuisance.points @ here - state.reading) / cs.dot(normal, way)
    meets = state.reading + length * way
    axes = [constant(basis(plane[3:])[:, :2].T) @ (meets - plane[:3]) for plane in planes]
    spot = cs.horzcat(*axes) @ here
    return replace(state, reading=length, normal=turned.T @ normal, spot=spot)


def spans_of_parts(recording: Recording) -> dict[str, tuple[float, float]]:
    """Half width of each plane and pitch of each of CT's axes, as the effects' scope has them."""
    if recording.kind.ranges:
        halves = half_widths(recording)
        return {f"plane{k}": (half, half) for k, half in enumerate(halves.tolist(), start=1)}
    pitch = recording.pitch
    if not recording.kind.fiducials or pitch is None:
        return {}
    return {f"pitch{a}": (h, h) for a, h in enumerate(pitch.tolist())}


def half_widths(recording: Recording) -> Array:
    """How far the beams reach over each plane, from its middle (K,) [m]."""
    whole, _ = recording.path
    if HALVES not in whole.derived:
        spots, part = spots_at_start(whole), whole.element
        count = range(1, len(whole.elements) + 1)
        far = [np.abs(spots[part == k]).max(initial=LEAST_HALF) for k in count]
        whole.derived[HALVES] = np.array(far)
    return np.asarray(whole.derived[HALVES])


def spots_at_start(recording: Recording) -> Array:
    """Where the beams meet the planes (N, 2) [m], from their middles, as the fit starts."""
    assert recording.anchor is not None
    assert recording.element is not None
    beam, planes = recording.anchor
    T = recording.chain.placement(recording.q)
    on_flange = beam[:3] + recording.measured * beam[3:]
    points = np.einsum("nij,nj->ni", T[:, :3, :3], on_flange) + T[:, :3, 3]
    axes = np.stack([basis(plane[3:])[:, :2] for plane in planes])[recording.element - 1]
    return np.einsum("nji,nj->ni", axes, points - planes[recording.element - 1, :3])


def cosines_at_start(recording: Recording) -> tuple[Array, Array]:
    """Cosines (N,) of the incidence, and slopes (N, 2) as the beam sees them, as the fit starts."""
    assert recording.anchor is not None
    assert recording.element is not None
    beam, planes = recording.anchor
    turned = recording.chain.placement(recording.q)[:, :3, :3] @ basis(beam[3:])
    normal = np.einsum("nji,nj->ni", turned, planes[recording.element - 1, 3:])
    return normal[:, 2], normal[:, :2] / normal[:, 2:]
