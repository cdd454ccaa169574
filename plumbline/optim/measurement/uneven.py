r"""Noise that is wider along some ways: rows whose time is uncertain, joints that scatter.

A row that is read by :math:`\delta \sim N(0, \tau^2)` off its time, on a way of velocity v, by
joints that each stand :math:`N(0, s_j^2)` off what they read, which moves it along :math:`P_j`, is

.. math:: r \sim N(0, \sigma^2 S), \qquad \sigma^2 S = \sigma^2 I + \tau^2 v v^T
          + \sum_j s_j^2 P_j P_j^T

so that :math:`S^{-1/2} r` has the one noise :math:`\sigma` again. How far an arm's joints come
back to where they were is its repeatability (ISO 9283:1998, sec. 7.2), joint by joint.
"""

import numpy as np
import scipy

from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.constants import SMOOTH, TURNED
from plumbline.optim.measurement.pose_noise import in_one_noise
from plumbline.optim.recording.recording import Recording
from plumbline.optim.rigid import best_rotation, rotations


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
    return in_shape(recording, moved[place])


def may_scatter(recording: Recording) -> bool:
    """Whether joints that stand elsewhere than they read would move what is measured."""
    kind = recording.kind
    own = kind.device or kind.sockets
    return own and not (recording.several or recording.stand_in or recording.element is not None)


def swings(recording: Recording, lever: float) -> Array:
    """What a unit of each joint moves of every row (n, N, m) [residual/rad or /m], as modelled.

    A turn counts for the lever [m], about the tool's axes as they were read.
    """
    chain, q, tool = recording.chain, recording.q, recording.tool_offset
    tips, turned = chain.tips(q, tool), np.eye(3)
    if recording.kind.device:
        read = recording.measured[:, :3]
        turned = best_rotation(tips - tips.mean(axis=0), read - read.mean(axis=0))
    found = []
    for step in TURNED * np.eye(chain.n):
        a, b = chain.placement(q - step), chain.placement(q + step)
        moved = (b[:, :3, :3] - a[:, :3, :3]) @ tool + b[:, :3, 3] - a[:, :3, 3]
        ways = [moved @ turned.T]
        if recording.kind.oriented:
            skew = b[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2)
            skew = 0.5 * (skew - np.swapaxes(skew, 1, 2))
            about = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) @ turned.T
            own = rotations(recording.measured[:, 3:])
            ways.append(lever * np.einsum("nba,nb->na", own, about))
        found.append(np.hstack(ways) / (2.0 * TURNED))
    return in_shape(recording, np.array(found))


def in_shape(recording: Recording, values: Array) -> Array:
    """What moves the readings (..., N, m), in units of one noise but for what is wider along."""
    shape = recording.noise_shape
    if shape is not None:
        whole = values.shape[-1] == shape.shape[1]
        values = values / (shape if whole else shape[:, list(recording.measured_joints)])
    return values if recording.pose_spread is None else in_one_noise(recording, values)


def wider(recording: Recording, lever: float) -> Array:
    """S of every row (N, m, m)."""
    moved = np.empty((0, len(recording), 1))
    if recording.jitter:
        moved = recording.jitter * rates(recording, lever)[None]
    if recording.scatter is not None:
        own = recording.scatter[:, None, None] * swings(recording, lever)
        moved = np.concatenate([moved, own]) if recording.jitter else own
    return along(moved)


def along(moved: Array) -> Array:
    """S (N, m, m) of noise that is wider along some ways (K, N, m), by these over one noise."""
    return np.asarray(np.eye(moved.shape[-1]) + np.einsum("kna,knb->nab", moved, moved))


def whitened(values: Array, S: Array) -> Array:
    """Values (..., N, m) of such a noise, in units of one."""
    return np.asarray(np.einsum("...na,nab->...nb", values, powers(S, -0.5)))


def widened(values: Array, S: Array) -> Array:
    """The inverse of :func:`whitened`."""
    return np.asarray(np.einsum("...na,nab->...nb", values, powers(S, 0.5)))


def powers(S: Array, power: float) -> Array:
    """A power of each of some symmetric matrices (N, m, m)."""
    sizes, ways = np.linalg.eigh(S)
    return np.asarray((ways * sizes[:, None, :] ** power) @ np.swapaxes(ways, 1, 2))
