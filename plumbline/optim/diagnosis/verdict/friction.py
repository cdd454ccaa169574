r"""Friction of a drive over its speed, all its causes together, with a band.

.. math:: \tau_f(\dot q) = B(\dot q)\, \theta, \qquad
          \mathrm{std}\, \tau_f(\dot q) = \sqrt{B(\dot q)\, C\, B(\dot q)^T}

with the columns B of every friction of the joint as it slides, their estimates and their covariance
C in the fit, wider by as much as the verdict's standard errors exceed those of the rows.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import SPEEDS
from plumbline.optim.diagnosis.findings import FrictionCurve, NoiseLevel
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.recording.efforts import nominal_efforts
from plumbline.optim.recording.recording import Recording

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
