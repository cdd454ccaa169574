"""Random designs: candidates whose columns are known, and the selection problems that they make."""

import numpy as np

from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem

EFFECT_OF_SIZE = {1: JointOffset, 2: TransmissionRipple}


def statistics(X, t):
    """Sufficient statistics of columns X (N, P) and a target (N,)."""
    return Linear(X.T @ X, X.T @ t, float(t @ t), float(len(t)))


def candidates(sizes, first=0):
    """Candidates of one or two columns each, side by side from column ``first`` on."""
    found = []
    for k, size in enumerate(sizes):
        columns = np.arange(first, first + size)
        effect = EFFECT_OF_SIZE[size](joint=k + 1)
        found.append(Candidate(effect, columns, -float(np.log(len(sizes)))))
        first += size
    return tuple(found)


def selection(X, t, sigma, *, sizes=None, variants=None, allowed=None):
    """What selection is asked about columns X (N, P), the noise being known.

    ``variants`` names the effects, one a column, where they are not to be offsets of joints.
    """
    found = candidates(sizes or [1] * X.shape[1])
    if variants is not None:
        share = -float(np.log(len(variants)))
        found = tuple(Candidate(e, np.array([k]), share) for k, e in enumerate(variants))
    allowed = np.ones(len(found), dtype=bool) if allowed is None else np.asarray(allowed)
    return SelectionProblem(statistics(X, t), found, NoisePrior.of(sigma), allowed)


def wandering(shape, rho, rng):
    """Noise of variance one that wanders from row to row: AR(1)."""
    noise = rng.normal(size=shape)
    for k in range(1, len(noise)):
        noise[k] = rho * noise[k - 1] + np.sqrt(1.0 - rho**2) * noise[k]
    return noise
