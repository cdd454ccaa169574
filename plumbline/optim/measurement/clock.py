r"""Rows whose time is uncertain: of an arm that moves, noise along its way that grows with speed.

A row that is read by :math:`\delta \sim N(0, \tau^2)` off its time, on a way of velocity v, is

.. math:: r \sim N(0, \Sigma), \qquad \Sigma = \sigma^2 I + \tau^2 v v^T

so that :math:`\Sigma^{-1/2} r` has the one noise :math:`\sigma` again, and with
:math:`s = |v|^2 \tau^2 / \sigma^2` :math:`\log\det \Sigma / \sigma^2 = \log (1 + s)`.
"""

import numpy as np
import scipy

from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import SMOOTH
from plumbline.optim.measurement.pose_noise import in_one_noise
from plumbline.optim.recording.recording import Recording


def may_jitter(recording: Recording) -> bool:
    """Whether rows are on their way: each near the middle of those about it."""
    kind, q = recording.kind, recording.path[0].q
    if recording.several or not (kind.device or kind.encoders):
        return False
    way = np.linalg.norm(q[2:] - q[:-2], axis=1)
    bend = np.linalg.norm(q[1:-1] - 0.5 * (q[2:] + q[:-2]), axis=1)
    return bool(np.median(bend) < SMOOTH * np.median(way))


def rates(recording: Recording, lever: float) -> Array:
    """How fast what was measured moves at each row (N, m) [residual/s], by the rows about it.

    A turn counts for the lever [m]; without a clock one of the units goes by from row to row.
    """
    whole, place = recording.path
    rows = np.arange(len(whole))
    time = rows.astype(float) if whole.time is None else whole.time
    group = np.zeros(len(whole)) if whole.group is None else whole.group
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(whole) - 1)
    before = np.where(group[before] == group, before, rows)
    after = np.where(group[after] == group, after, rows)
    kept = list(whole.measured_joints) if whole.kind.encoders else slice(0, 3)
    step = whole.measured[after][:, kept] - whole.measured[before][:, kept]
    if whole.kind.oriented:
        turns = scipy.spatial.transform.Rotation.from_quat(whole.measured[:, 3:], scalar_first=True)
        step = np.hstack([step, lever * (turns[before].inv() * turns[after]).as_rotvec()])
    took = time[after] - time[before]
    moved = np.where(took[:, None] > 0.0, step / np.where(took > 0.0, took, 1.0)[:, None], 0.0)
    shape = recording.noise_shape
    if recording.pose_spread is not None:
        return in_one_noise(recording, moved[place])
    if shape is None:
        return np.asarray(moved[place])
    return np.asarray(moved[place] / (shape[:, kept] if whole.kind.encoders else shape))


def along(v: Array, jitter: float) -> Array:
    """What :func:`less_smeared` takes, of rates (N, m) and the clock's 1 sigma over the noise's."""
    s = jitter**2 * np.sum(v**2, axis=1, keepdims=True)
    part = np.where(s > 0.0, (1.0 - 1.0 / np.sqrt(1.0 + s)) / np.where(s > 0.0, s, 1.0), 0.0)
    return np.asarray(jitter * np.sqrt(part) * v)


def less_smeared(values: Array, e: Array) -> Array:
    """Columns (..., N, m) in units of one noise, each row's less what is smeared along e (N, m)."""
    return np.asarray(values - np.sum(values * e, axis=-1, keepdims=True) * e)


def smeared(values: Array, e: Array) -> Array:
    """The inverse of :func:`less_smeared`."""
    kept = 1.0 - np.sum(e**2, axis=-1, keepdims=True)
    return np.asarray(values + np.sum(values * e, axis=-1, keepdims=True) / kept * e)
