r"""Instruments through trocars as they really move, in plain NumPy or in MuJoCo; lengths in mm.

A commanded rate u is not what is carried out. It waits, falls into a dead band, is scaled, lags,
and the drives shake:

.. math:: \tau\, \dot v = (1 + \epsilon)\, \mathrm{dead}(u(t - \delta)) - v, \qquad
          \dot x = v + w, \qquad y = x + e

with a gain error :math:`\epsilon` per axis, a delay :math:`\delta` and Gaussian w and e; where
drives are weak, :math:`|\dot v| \le a_{max}`. The tip moves; the shaft passes through the trocar,
so its other end follows, and (L - r) / r times as fast where the tip is at the depth r.

MuJoCo moves tips on slides, whose velocity servos are late, scaled, and rub: an axis is a slide of
0.5 kg under its ``velocity`` actuator of gain kv. It lags by m / kv; dry friction F in the slide
takes F / kv of every rate and holds what is slower; commands wait in a queue.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.motion import engine

MASS = 0.5  # kg
MM = 1e3  # in a metre


@dataclass(frozen=True)
class Mismatch:
    """How the plant differs from x+ = x + dt u; all zero by default."""

    measured: float = 0.0  # 1 sigma per axis of a measurement [mm]
    across: float = 0.0  # share of an axis' rate that the next axis carries out as well
    shake: float = 0.0  # 1 sigma per axis that a control step adds [mm]
    gain: float = 0.0  # largest gain error of an axis
    lag: float = 0.0  # time constant [s]
    delay: float = 0.0  # time until a command acts [s]
    deadband: float = 0.0  # rates below this are not carried out [mm/s]
    acceleration: float = np.inf  # the most by which a tip's drives can change its speed [mm/s^2]


@dataclass(frozen=True)
class Instruments:
    """Fixed facts of some instruments."""

    trocars: Array  # where each shaft passes (I, 3) [mm]
    lengths: Array  # from the tip to the other end (I,) [mm]
    radii: Array  # of the shafts (I,) [mm]

    def shafts(self, tips: Array) -> Array:
        """Both ends (..., I, 2, 3) of shafts with their tips at (..., I, 3) [mm]."""
        inside = tips - self.trocars
        way = inside / np.linalg.norm(inside, axis=-1, keepdims=True)
        return np.stack([tips, tips - self.lengths[:, None] * way], axis=-2)


class Plant:
    """Instruments that carry out commands, more or less."""

    def __init__(
        self, tips: Array, mismatch: Mismatch, dt: float, substeps: int, rng: np.random.Generator
    ) -> None:
        """Start at rest with the tips (I, 3) [mm]; a control step dt [s] has so many substeps."""
        self.mismatch, self.substeps, self.h = mismatch, substeps, dt / substeps
        self.rng = rng
        self.gain = 1.0 + mismatch.gain * rng.uniform(-1.0, 1.0, tips.shape)
        self.wait = round(mismatch.delay / self.h)
        self.tips = tips.copy()
        self.speed = np.zeros_like(tips)
        self.queue = [np.zeros_like(tips)] * self.wait

    def measure(self) -> Array:
        """The tips (I, 3) as seen [mm]."""
        return self.tips + self.mismatch.measured * self.rng.standard_normal(self.tips.shape)

    def move(self, rate: Array) -> Array:
        """Carry out a rate (I, 3) [mm/s] for one control step; the tips (S, I, 3) on the way."""
        m, h = self.mismatch, self.h
        follow = 1.0 if m.lag <= 0.0 else 1.0 - np.exp(-h / m.lag)
        shake = m.shake / np.sqrt(self.substeps)
        noise = shake * self.rng.standard_normal((self.substeps, *self.tips.shape))
        asked = np.where(np.abs(rate) < m.deadband, 0.0, self.gain * rate)
        self.queue += [asked] * self.substeps
        way, weak = np.empty((self.substeps, *self.tips.shape)), np.isfinite(m.acceleration)
        for k in range(self.substeps):
            change = follow * (self.queue.pop(0) - self.speed)
            if weak:
                size = np.linalg.norm(change, axis=1, keepdims=True)
                change *= np.minimum(1.0, h * m.acceleration / np.maximum(size, 1e-12))
            self.speed = self.speed + change
            self.tips = self.tips + h * self.speed + noise[k]
            way[k] = self.tips
        return way


@dataclass(frozen=True)
class Slides:
    """How the axes (n) of tips are wrong; one number for all, or one each."""

    delay: float | Array = 0.0  # s
    lag: float | Array = 0.0  # s, m / kv
    gain: float | Array = 0.0  # share of a rate that is carried out beyond it
    band: float | Array = 0.0  # mm/s that friction takes
    measured: float = 0.0  # 1 sigma per axis of a measurement [mm]
    across: float = 0.0  # share of an axis' rate that the next axis carries out as well


class SlidingTips:
    """Tips that carry out rates."""

    def __init__(
        self, tips: Array, wrong: Slides, dt: float, substeps: int, rng: np.random.Generator
    ) -> None:
        """Start at rest with the tips (I, 3) [mm]; a control step dt [s] has so many substeps."""
        self.shape, self.wrong, self.substeps, self.rng = tips.shape, wrong, substeps, rng
        n = tips.size
        self.gain = 1.0 + np.broadcast_to(wrong.gain, n)
        lag, band = (np.broadcast_to(np.asarray(v, float), n) for v in (wrong.lag, wrong.band))
        kv = MASS / np.maximum(lag, 1e-4)
        mujoco = engine()
        self.model = mujoco.MjModel.from_xml_string(_xml(kv, band / MM * kv, dt / substeps))
        self.data, self._step = mujoco.MjData(self.model), mujoco.mj_step
        self.zero = tips.ravel().copy()
        self.wait = np.broadcast_to(np.round(np.asarray(wrong.delay) / dt * substeps), n).astype(
            int
        )
        self.queue = np.zeros((int(self.wait.max()) + 1, n))  # newest first

    @property
    def tips(self) -> Array:
        """Where they are (I, 3) [mm]."""
        return np.asarray(self.zero + MM * self.data.qpos).reshape(self.shape)

    def measure(self) -> Array:
        """Where they are seen (I, 3) [mm]."""
        return self.tips + self.wrong.measured * self.rng.standard_normal(self.shape)

    def move(self, rate: Array) -> Array:
        """Carry out a rate (I, 3) [mm/s] for one control step; the tips (S, I, 3) on the way."""
        asked, way = self.gain * rate.ravel() / MM, np.empty((self.substeps, *self.shape))
        asked = asked + self.wrong.across * np.roll(asked, 1)
        axes = np.arange(len(asked))
        for k in range(self.substeps):
            self.queue = np.concatenate([asked[None], self.queue[:-1]])
            self.data.ctrl[:] = self.queue[self.wait, axes]
            self._step(self.model, self.data)
            way[k] = self.tips
        return way


def _xml(kv: Array, friction: Array, step: float) -> str:
    bodies, servos = [], []
    for k, (gain, dry) in enumerate(zip(kv, friction, strict=True)):
        bodies.append(
            f'<body><joint name="x{k}" type="slide" axis="1 0 0" frictionloss="{dry:.9g}"/>'
            f'<geom size="0.01" mass="{MASS}" contype="0" conaffinity="0"/></body>'
        )
        servos.append(f'<velocity joint="x{k}" kv="{gain:.9g}"/>')
    return (
        f'<mujoco><option timestep="{step:.9g}" gravity="0 0 0" integrator="implicitfast"/>'
        f"<worldbody>{''.join(bodies)}</worldbody><actuator>{''.join(servos)}</actuator></mujoco>"
    )
