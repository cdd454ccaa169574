"""Tips on slides that MuJoCo moves: velocity servos that are late, scaled, and rub.

An axis is a slide of 0.5 kg under MuJoCo's ``velocity`` actuator of gain kv. It lags by m / kv;
dry friction F in the slide takes F / kv of every rate and holds what is slower; commands wait in a
queue. Lengths outside of MuJoCo are in mm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.motion import engine

Array = NDArray[np.float64]
MASS = 0.5  # kg
MM = 1e3  # in a metre


@dataclass(frozen=True)
class Slides:
    """How the axes (n) of tips are wrong; one number for all, or one each."""

    delay: float | Array = 0.0  # s
    lag: float | Array = 0.0  # s, m / kv
    gain: float | Array = 0.0  # share of a rate that is carried out beyond it
    band: float | Array = 0.0  # mm/s that friction takes
    measured: float = 0.0  # 1 sigma per axis of a measurement [mm]


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
