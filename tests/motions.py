"""Motions for tests: a plain NumPy servo that shares no code with the effects that it shows."""

import numpy as np

from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion.recording import build_motion

FINE = 10  # steps of the servo within a sample
ROWS = [
    {"d": 0.3, "a": 0.0, "alpha": np.pi / 2, "theta": 0.0, "mass": 3.0, "com": [0.0, -0.1, 0.0]},
    {"d": 0.0, "a": 0.4, "alpha": 0.0, "theta": 0.0, "mass": 2.0, "com": [-0.2, 0.0, 0.0]},
]


def arm():
    """Two joints, the second of which lifts 2 kg."""
    return Robot.from_dh(ROWS)


def multisine(seconds=60.0, dt=0.02, seed=0, size=0.5, fastest=1.0):
    """Times (N,) and commands (N, 2): a sum of sines a joint [s], [rad]."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, dt)
    f = rng.uniform(0.05, fastest, (5, 2))
    phase = rng.uniform(0.0, 2 * np.pi, (5, 2))
    waves = np.sin(2 * np.pi * f[None] * t[:, None, None] + phase[None]) / (1 + 3 * f[None])
    return t, size * waves.sum(axis=1)


def servo(t, u, *, delay=0.0, lag=0.0, play=0.0, wear=0.0, gain=0.0, offset=0.0, limit=np.inf):
    """What one joint does (N,), by small steps between the samples.

    Its half play is wider by a share ``wear`` a radian.
    """
    fine = np.linspace(t[0], t[-1], (len(t) - 1) * FINE + 1)
    asked = (1 + gain) * np.interp(fine - delay, t, u) + offset
    h = fine[1] - fine[0]
    share, most = float(1 - np.exp(-h / lag)) if lag else 1.0, float(limit * h)
    motor = joint = float(asked[0])
    out = np.empty(len(fine))
    for k, c in enumerate(asked.tolist()):  # of plain numbers, which cost a tenth
        motor += min(max((c - motor) * share, -most), most)
        half = play * (1 + wear * motor)
        joint = min(max(joint, motor - half), motor + half)
        out[k] = joint
    return out[::FINE]


def recorded(effects, *, seconds=30.0, dt=0.02, seed=0, noise=2e-4, state=True, **more):
    """A recording whose joint j has ``effects[j]``; noise [rad] is stated if asked for."""
    t, u = multisine(seconds, dt, seed, **more)
    rng = np.random.default_rng(seed + 100)
    q = np.column_stack([servo(t, u[:, j], **e) for j, e in enumerate(effects)])
    q += rng.normal(0.0, noise, q.shape)
    return build_motion(
        robot=arm(), time=t, command=u, q=q, noise_std=noise if state else None, name="made"
    )
