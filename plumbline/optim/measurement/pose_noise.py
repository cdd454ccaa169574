r"""Poses whose place and turn err together, as where one is read off the markers that carry it.

What a pose is read by lies somewhere of its own and is no sphere: about the middle of three markers
place and turn know nothing of each other, read at one of them they do. In the axes of what is read,
the errors of place and turn of one row, turns in metres by their lever, are

.. math:: r \sim N(0, \sigma^2 C), \qquad C \sim W^{-1}((\nu - 7) I, \nu)

so that :math:`C^{-1/2} r` has the one noise :math:`\sigma` again. With :math:`\Psi = (\nu - 7) I`
the N rows R of a fit, in units of their root mean square, have the evidence (Gelman et al. 2013,
Bayesian Data Analysis, sec. 3.6)

.. math:: \frac{2^{3 N} |\Psi|^{\nu/2} \Gamma_6((\nu + N)/2)}
          {|\Psi + R^T R|^{(\nu + N)/2} \Gamma_6(\nu / 2)}

over :math:`e^{-3 N}` of that of :math:`C = I`.
"""

from typing import NamedTuple

import casadi as cs
import numpy as np
import scipy

from plumbline.kinematics.frames import quaternion_rotation
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import POSE_FREEDOM, WAYS
from plumbline.optim.recording.recording import Recording


class PoseNoise(NamedTuple):
    """What the rows of a fit tell of a pose's noise."""

    spread: Array  # square root (6, 6) of C, whose place and turn each have a mean variance of one
    lever: float  # what a turn counts for, over what it was
    odds: float  # log odds that place and turn do not have one noise each, alike to all sides


def told_by(recording: Recording, left: Array) -> PoseNoise:
    """The noise of N poses by what a fit leaves (N, 6).

    Places are in the device's axes, turns in the tool's, by their lever.
    """
    own = _turned(recording, left, back=False)
    lever = float(np.sqrt(np.sum(own[:, :3] ** 2) / max(np.sum(own[:, 3:] ** 2), 1e-300)))
    own[:, 3:] *= lever
    square, N, nu = float(np.mean(own**2)), len(own), POSE_FREEDOM
    own /= np.sqrt(max(square, 1e-300))
    prior, S = (nu - WAYS - 1) * np.eye(WAYS), own.T @ own
    gamma = scipy.special.multigammaln
    odds = (
        0.5 * WAYS * N * (np.log(2.0) + 1.0)
        + gamma(0.5 * (nu + N), WAYS)
        - gamma(0.5 * nu, WAYS)
        + 0.5 * nu * np.linalg.slogdet(prior)[1]
        - 0.5 * (nu + N) * np.linalg.slogdet(prior + S)[1]
    )
    C = (prior + S) / (nu + N - WAYS - 1)
    place, turn = (np.sqrt(np.trace(part) / 3) for part in (C[:3, :3], C[3:, 3:]))
    C /= np.outer(*[np.repeat([place, turn], 3)] * 2)
    values, axes = np.linalg.eigh(C)
    return PoseNoise((axes * np.sqrt(values)) @ axes.T, lever * place / turn, float(odds))


def correlation_of_ways(spread: Array) -> float:
    """The largest correlation between any two of a pose's six ways."""
    C = spread @ spread.T
    sizes = np.sqrt(np.diag(C))
    return float(np.max(np.abs(C / np.outer(sizes, sizes) - np.eye(WAYS))))


def in_one_noise(recording: Recording, values: Array) -> Array:
    """What moves poses (..., N, 6), in units of one noise."""
    assert recording.pose_spread is not None
    return _by(recording, values, np.asarray(np.linalg.inv(recording.pose_spread), dtype=float))


def as_read(recording: Recording, values: Array) -> Array:
    """The inverse of :func:`in_one_noise`."""
    assert recording.pose_spread is not None
    return _by(recording, values, recording.pose_spread)


def residual_in_one_noise(spread: Array, measured: cs.SX, residual: cs.SX) -> cs.SX:
    """:func:`in_one_noise` in symbols: of a row that was measured (7,) the residual (6,)."""
    R = quaternion_rotation(measured[3:])
    turn = cs.diagcat(R, cs.SX.eye(3))
    return turn @ (cs.DM(np.linalg.inv(spread)) @ (turn.T @ residual))


def _by(recording: Recording, values: Array, spread: Array) -> Array:
    own = _turned(recording, values, back=False)
    return _turned(recording, own @ spread.T, back=True)


def _turned(recording: Recording, values: Array, *, back: bool) -> Array:
    """Places in the axes of what is read, or back in the device's."""
    seen = scipy.spatial.transform.Rotation.from_quat(recording.measured[:, 3:], scalar_first=True)
    R = seen.as_matrix() if back else seen.inv().as_matrix()
    place = np.einsum("nij,...nj->...ni", R, values[..., :3])
    return np.concatenate([place, values[..., 3:]], axis=-1)
