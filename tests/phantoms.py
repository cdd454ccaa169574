"""Markers of a published phantom in CT, a robot's frame, and noisy readings of both."""

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.optim.registration import (
    MarkerNoise,
    RegistrationOptions,
    build_fiducials,
    register,
)

# Chen Guangbiao et al., table 1, CT coordinates [m]: markers A to E, lesion M.
LABELS = tuple("ABCDE")
CT = 1e-3 * np.array(
    [[10, 20, 147], [110, 120, 147], [60, -10, 80], [90, -10, 20], [20, 150, 147]], dtype=float
)
LESION = 1e-3 * np.array([50.0, 130.0, 63.0])
R_RC = Rotation.from_euler("xyz", [3.0, 0.1, 0.5]).as_matrix()
T_RC = np.eye(4)
T_RC[:3, :3], T_RC[:3, 3] = R_RC, [0.5, -0.3, 0.6]
NOISE = MarkerNoise.from_resolution(
    [5e-3, 1e-3, 1e-3], robot_std=3e-4, freedoms=np.inf
)  # exactly known
ALIKE = MarkerNoise.from_std(ct=4e-4, robot=3e-4)
TRIPLE, COLLINEAR, FOUR, FIVE = (0, 1, 2), (0, 2, 3), (0, 1, 2, 4), (0, 1, 2, 3, 4)


def mapped(points, T=T_RC):
    """Points (..., 3) through a transform."""
    return points @ T[:3, :3].T + T[:3, 3]


def labels(which):
    """Names of some markers."""
    return tuple(LABELS[k] for k in which)


def draws(which, noise, count, seed=0):
    """Noisy readings (count, n, 3) of some markers in both frames."""
    rng = np.random.default_rng(seed)
    places = CT[list(which)]
    shape = (count, len(places), 3)
    ct = places + rng.normal(size=shape) @ np.linalg.cholesky(noise.ct).T
    return ct, mapped(places) + rng.normal(size=shape) @ np.linalg.cholesky(noise.robot).T


def readings(which, noise=ALIKE, seed=0):
    """One noisy reading (n, 3) of some markers in both frames."""
    ct, robot = draws(which, noise, 1, seed)
    return ct[0], robot[0]


def save_fiducials(fiducials, place):
    """A recording folder of fiducials; noise as one standard deviation an axis."""
    place.mkdir(parents=True)
    lines = [f'name = "{fiducials.name}"', 'observation = "fiducials"']
    if fiducials.noise is not None:
        lines.append("[noise]")
        for key, covariance in (
            ("ct_std", fiducials.noise.ct),
            ("robot_std", fiducials.noise.robot),
        ):
            lines.append(f"{key} = {np.sqrt(np.diag(covariance)).tolist()}")
    (place / "dataset.toml").write_text("\n".join(lines) + "\n")
    fiducials.table().to_csv(place / "samples.csv", index=False, float_format="%.9g")
    return place


def registered(method, ct, robot, noise=None, names=None):
    """What a method says of markers (n, 3) in both frames."""
    recording = build_fiducials(ct, robot, noise=noise, labels=names)
    return register(recording, RegistrationOptions(method))


def rigid(seed):
    """A random rigid transform (4, 4)."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-1.0, 1.0, 3)
    return T
