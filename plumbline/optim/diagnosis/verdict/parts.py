"""What was always fitted to ranges and fiducials, as a reader wants it: beam, planes, transform."""

from __future__ import annotations

import casadi as cs
import numpy as np

from plumbline.optim.core.solution import Solution
from plumbline.optim.diagnosis.constants import LEFT_OPEN
from plumbline.optim.diagnosis.findings import Estimate
from plumbline.optim.measurement.nuisance import Nuisance
from plumbline.optim.model.making import FitEnd

Named = list[tuple[str, str, str]]  # name, unit, meaning


def nuisances_of_parts(observation: str, fit: FitEnd) -> dict[str, Estimate]:
    """Beam and planes in the base frame, or CT in the robot's frame, with standard errors.

    Args:
        observation: Kind of observation.
        fit: Where the fit ended.
    """
    n = fit.nuisance
    told, named = (_beam_and_planes if observation == "plane_range" else _transform)(n)
    both = cs.Function("told", [n.x], [told, cs.jacobian(told, n.x)])
    values, J = (part.full() for part in both.call([cs.DM(fit.x[: n.size])]))
    C = fit.covariance[: n.size, : n.size]
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", J, C, J), 0.0))
    pairs = zip(named, values.ravel().tolist(), std.tolist(), strict=True)
    return {name: Estimate(v, s, unit, doc=doc) for (name, unit, doc), v, s in pairs}


def left_open(fit: Solution, sigma: float) -> tuple[str, ...]:
    """A note on what the rows do not tell of what is always fitted; none where they tell it all.

    Args:
        fit: The fit without causes.
        sigma: Noise of a reading [m].
    """
    size = fit.problem.scale
    values, vectors = np.linalg.eigh(fit.gram.matrix * np.outer(size, size))
    loose = np.maximum(values, 0.0) * LEFT_OPEN**2 <= max(sigma, 1e-300) ** 2
    if not loose.any():
        return ()
    most = np.abs(vectors[:, loose]).argmax(axis=0)
    named = ", ".join(dict.fromkeys(fit.problem.names[k] for k in np.sort(most)))
    return (
        f"{int(loose.sum())} of {len(size)} unknowns that are always fitted are left open by these "
        f"rows, {named} among them: what goes with them cannot be told; turn the flange more, and "
        "to planes that face other ways",
    )


def _beam_and_planes(n: Nuisance) -> tuple[cs.SX, Named]:
    assert n.anchor is not None
    parts = [cs.DM(n.anchor[0][:3]) + n.tool, n.R_tip_tool[:, 2]]
    named = [(f"beam {c}", "m", "where the beam starts, on the flange") for c in "xyz"]
    named += [(f"beam v{c}", "1", "where the beam points, on the flange") for c in "xyz"]
    for k in range(n.normals.shape[1]):
        parts += [n.normals[:, k], cs.dot(n.normals[:, k], n.points[:, k])]
        doc = "the plane's normal in the base frame, away from the finder"
        named += [(f"plane {k + 1} n{c}", "1", doc) for c in "xyz"]
        doc = "how far the plane is from the base's origin, along its normal"
        named.append((f"plane {k + 1} offset", "m", doc))
    return cs.vertcat(*parts), named


def _transform(n: Nuisance) -> tuple[cs.SX, Named]:
    T = n.T_device_world
    named = [(f"frame {c}", "m", "CT's origin in the robot's frame") for c in "xyz"]
    named += [(f"frame r{c}", "rad", "rotation vector from CT to the robot's frame") for c in "xyz"]
    return cs.vertcat(T.t, rotation_vector(T.R)), named


def rotation_vector(R: cs.SX) -> cs.SX:
    """Rotation vector (3,) [rad] of a rotation short of half a turn."""
    sine = cs.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    size, cosine = cs.norm_2(sine), (cs.trace(R) - 1) / 2
    return sine * cs.atan2(size, cosine) / (size + 1e-300)
