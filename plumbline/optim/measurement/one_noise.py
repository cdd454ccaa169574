"""What moves the readings in units of one noise, and back: see :class:`.recording.Recording`."""

from __future__ import annotations

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.clock import along, less_smeared, rates, smeared
from plumbline.optim.measurement.observation import rotation_lever
from plumbline.optim.measurement.pose_noise import as_read, in_one_noise
from plumbline.optim.recording.recording import Recording


def _smear(recording: Recording) -> Array:
    """Along what its clock smears each row (N, m), see :func:`.clock.along`."""
    return along(rates(recording, rotation_lever(recording)), recording.jitter)


def in_noise(recording: Recording, values: Array) -> Array:
    """What moves the readings (..., N, m), in units of one noise."""
    shape = recording.noise_shape
    if shape is not None:
        whole = values.shape[-1] == shape.shape[1]
        values = values / (shape if whole else shape[:, list(recording.measured_joints)])
    if recording.pose_spread is not None:
        values = in_one_noise(recording, values)
    return less_smeared(values, _smear(recording)) if recording.jitter else values


def as_measured(recording: Recording, residuals: Array) -> Array:
    """Residuals (N, m) as they were measured, not in units of one noise."""
    if recording.jitter:
        residuals = smeared(residuals, _smear(recording))
    if recording.pose_spread is not None:
        residuals = as_read(recording, residuals)
    shape = recording.noise_shape if recording.several else None
    return residuals if shape is None else np.asarray(residuals * shape)


def smear(recording: Recording, components: int) -> float:
    """RMS of the noise of some first components of a row as measured, over that of one."""
    if not recording.jitter:
        return 1.0
    moved = recording.jitter * rates(recording, rotation_lever(recording))[:, :components]
    return float(np.sqrt(1.0 + np.mean(moved**2)))
