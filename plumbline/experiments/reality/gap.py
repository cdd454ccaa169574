"""How much of an effect no fit of the always-fitted quantities can swallow.

With D the effect's displacement of the noise-free readings and A their derivative by what is always
fitted, the unabsorbed gap is the root mean square, per axis, of the least-squares residual

    g = rms(D - A A^+ D),     gap to noise = g / sigma.

A holds the device frame (6) and the tool (3) for readings in a device's frame; the tool and the
sockets' places for a tip that rests in sockets; nothing for a second encoder.
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene, built, measured


def frame_and_tool(scene: Scene) -> Array:
    """Derivative (3 N, 9) of the device's readings by its frame (twist) and by the tool."""
    point, turn = scene.pose_in_device()
    centred = point - point.mean(axis=0)
    columns = np.zeros((len(point), 3, 9))
    columns[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        columns[:, :, 3 + k] = np.cross(axis, centred)
    columns[:, :, 6:] = turn
    return columns.reshape(-1, 9)


def sockets_and_tool(scene: Scene, number: NDArray[np.int64]) -> Array:
    """Derivative (3 N, 3 K + 3) of tip minus socket by the sockets' places and by the tool."""
    _, turn = scene.pose_in_world()
    count = int(number.max()) + 1
    columns = np.zeros((len(number), 3, 3 * count + 3))
    for k in range(3):
        columns[np.arange(len(number)), k, 3 * number + k] = 1.0
    columns[:, :, 3 * count :] = turn
    return columns.reshape(len(number) * 3, -1)


def unabsorbed(displacement: Array, columns: Array | None) -> float:
    """Root mean square of what is left of displacements once the columns, if any, are fitted."""
    left = displacement.ravel()
    if columns is not None:
        scale = np.linalg.norm(columns, axis=0)
        basis, sizes, _ = np.linalg.svd(
            columns / np.where(scale > 0.0, scale, 1.0), full_matrices=False
        )
        basis = basis[:, sizes > 1e-10 * sizes[0]]
        left = left - basis @ (basis.T @ left)
    return float(np.sqrt(np.mean(left**2)))


def displacement(scene: Scene, mechanisms: tuple[Mechanism, ...], observation: str) -> Array:
    """What the mechanisms do to the noise-free reading: (N, 3) [m], or (N, n) [rad or m]."""
    if observation == "joint_position":
        return built(scene, mechanisms).q - scene.q
    if observation == "fixed_point":
        return built(scene, mechanisms).pose_in_world()[0] - scene.pose_in_world()[0]
    return measured(scene, mechanisms) - measured(scene, ())


def gap(
    scene: Scene,
    mechanisms: tuple[Mechanism, ...],
    observation: str,
    sockets: NDArray[np.int64] | None = None,
) -> float:
    """Unabsorbed gap [m], or [rad] for a second encoder, over the columns that move at all."""
    moved = displacement(scene, mechanisms, observation)
    if observation == "joint_position":
        busy = np.any(moved != 0.0, axis=0)
        return unabsorbed(moved[:, busy], None) if busy.any() else 0.0
    if sockets is not None:
        return unabsorbed(moved, sockets_and_tool(scene, sockets))
    return unabsorbed(moved, frame_and_tool(scene))


def scaled(
    scene: Scene,
    mechanism: Mechanism,
    target: float,
    observation: str,
    sockets: NDArray[np.int64] | None = None,
) -> Mechanism | None:
    """The mechanism where its unabsorbed gap is `target`; None if that is beyond its limit."""
    trial = mechanism.sized(mechanism.typical)
    for _ in range(30):
        now = gap(scene, (trial,), observation, sockets)
        if now <= 0.0 or abs(trial.size) > 10.0 * mechanism.limit:
            return None
        if abs(now - target) <= 1e-6 * target:
            break
        trial = trial.sized(trial.size * target / now)
    else:
        if abs(now - target) > 0.01 * target:
            return None
    return trial if abs(trial.size) <= mechanism.limit else None
