r"""What was always fitted to ranges and fiducials, as a reader wants it: beam, planes, transform.

Friction of a drive over its speed, all its causes together, with a band.

.. math:: \tau_f(\dot q) = B(\dot q)\, \theta, \qquad
          \mathrm{std}\, \tau_f(\dot q) = \sqrt{B(\dot q)\, C\, B(\dot q)^T}

with the columns B of every friction of the joint as it slides, their estimates and their covariance
C in the fit, wider by as much as the verdict's standard errors exceed those of the rows.
"""

from dataclasses import replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import LEFT_OPEN, SPEEDS
from plumbline.optim.diagnosis.findings import Estimate, FrictionCurve, NoiseLevel
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.measurement.nuisance import Nuisance
from plumbline.optim.model.making import FitEnd
from plumbline.optim.recording.efforts import nominal_efforts
from plumbline.optim.recording.recording import Recording

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


def left_open(fit: Solution, sigma: float, turned: str) -> tuple[str, ...]:
    """A note on what the rows do not tell of what is always fitted; none where they tell it all.

    Args:
        fit: The fit without causes.
        sigma: Noise of a reading [m].
        turned: What to turn so that they tell it, in words.
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
        f"rows, {named} among them: what goes with them cannot be told; turn the {turned}",
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


FRICTIONS = ("coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction")


def friction_curves(
    selected: SelectedModel, noise: NoiseLevel, least: Array | float
) -> tuple[FrictionCurve, ...]:
    """A curve of every joint whose drive is found to rub, at its median load.

    Args:
        selected: The model of the verdict.
        noise: Of one residual.
        least: Standard errors (P,) below which none is told.
    """
    recording, best = selected.model.recording, selected.best
    if not recording.kind.efforts:
        return ()
    sigma = noise.sigma * max(noise.ratio, 1.0)
    covariance = sigma**2 * np.linalg.pinv(best.gram.matrix, rcond=1e-13, hermitian=True)
    own = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    wider = (np.maximum(own, least) / own) ** 2
    load = np.median(np.abs(nominal_efforts(recording)), axis=0)
    found = []
    for joint in range(1, recording.chain.n + 1):
        terms = [t for t in selected.model.terms if t.effect.element == joint]
        terms = [t for t in terms if t.effect.name in FRICTIONS]
        if not terms:
            continue
        velocity = _speeds(recording, joint)
        basis = np.hstack([_basis(recording, t.effect, velocity, load) for t in terms])
        mine = np.concatenate([np.arange(t.columns.start, t.columns.stop) for t in terms])
        # One factor for all: their correlations, by which errors cancel, stay what they are.
        own_part = wider[mine].mean() * covariance[np.ix_(mine, mine)]
        square = np.einsum("ni,ij,nj->n", basis, own_part, basis)
        torque, std = basis @ best.x[mine], np.sqrt(np.maximum(square, 0.0))
        found.append(FrictionCurve(joint, *(tuple(x.tolist()) for x in (velocity, torque, std))))
    return tuple(found)


def _speeds(recording: Recording, joint: int) -> Array:
    """Speeds either way (K,) [rad/s or m/s] up to the fastest that was recorded; none is zero."""
    assert recording.velocity is not None
    side = np.linspace(0.0, float(np.abs(recording.velocity[:, joint - 1]).max()), SPEEDS + 1)[1:]
    return np.concatenate([-side[::-1], side])


def _basis(recording: Recording, effect: Effect, velocity: Array, load: Array) -> Array:
    """What each parameter of a friction, at one, adds to its joint's torque as it slides (K, p)."""
    if isinstance(effect, CoulombFriction):
        effect = effect.sliding
    n, j = recording.chain.n, int(effect.element or 1) - 1
    v, theta = cs.SX.sym("v"), cs.SX.sym("theta", len(effect.parameters))
    all_at = cs.repmat(v, n, 1)
    row = {"q": cs.SX(n, 1), "velocity": all_at, "turning": cs.sign(all_at)}
    state = State.ideal(recording.chain, row, cs.SX(3, 1))
    state = replace(state, carried=cs.SX(load), torque=cs.SX(n, 1))
    torque = effect.apply(state, *cs.vertsplit(theta)).torque[j]
    slope = cs.densify(cs.jacobian(torque, theta))
    function = cs.Function("friction", [v], [slope.T]).map(len(velocity))
    return np.asarray(function(velocity[None]).full().T)
