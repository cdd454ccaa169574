"""Small recordings of one made-up arm by several instruments, for tests of several at once."""

import numpy as np
from scipy.spatial.transform import Rotation

import plumbline

SIGMA = 1e-4  # of a position's axis [m]
ENCODER = 5e-5  # of a second encoder [rad]
LEVER = 0.3  # of the noises of a pose's position and rotation [m]


def nothing(q):
    """Errors (N, n) of joints without any."""
    return np.zeros_like(q)


def recorded(
    kind, seed, error=nothing, *, rows=60, reach=1.5, noise=SIGMA, scale=0.0, slip=None,
    tool=(0.01, 0.0, 0.12), **given,
):  # fmt: skip
    """A recording of a UR5 whose joints err by ``error(q)``, seen by a device of its own.

    Args:
        kind: What a row measured.
        seed: Of postures, device and noise.
        error: Errors of the joints (N, n) at readings (N, n) [rad].
        rows: How many.
        reach: Of every joint either side of zero [rad].
        noise: Of a position's axis [m].
        scale: Relative error of the device.
        slip: Shift (3,) of the tool after half of the rows [m].
        tool: Nominal tip in the flange [m].
        given: What else the recording is told.
    """
    rng = np.random.default_rng(seed)
    chain = plumbline.Robot.bundled("ur5").chain()
    q = rng.uniform(-reach, reach, (rows, 6))
    tip = np.tile(np.array(tool) + np.array([0.001, -0.002, 0.001]), (rows, 1))
    given = {"name": f"{kind} {seed}", "robot": "ur5", "noise_std": noise} | given
    if slip is not None:
        tip[rows // 2 :] += slip
        given["time"] = 10.0 * np.arange(rows)
    T = chain.placement(q + error(q))
    turn, place = Rotation.from_rotvec(rng.normal(size=3)), rng.normal(size=3)
    seen = turn.apply(np.einsum("nij,nj->ni", T[:, :3, :3], tip) + T[:, :3, 3]) + place
    measured = seen * (1.0 + scale) + rng.normal(0.0, noise, (rows, 3))
    if kind == "pose":
        small = Rotation.from_rotvec(rng.normal(0.0, noise / LEVER, (rows, 3)))
        quaternions = (turn * Rotation.from_matrix(T[:, :3, :3]) * small).as_quat()[:, [3, 0, 1, 2]]
        measured = np.hstack([measured, quaternions])
        given["noise_std_rotation"] = noise / LEVER
    if kind == "joint_position":
        measured = q + error(q) + rng.normal(0.0, ENCODER, q.shape)
        given["noise_std"] = ENCODER
    if kind == "fixed_point":  # postures near sockets, which is all that a statement's law needs
        given["socket"] = np.arange(rows) % 3
        measured = None
    return plumbline.build_recording(
        observation=kind, q=q, measured=measured, tool_offset=tool, **given
    )


def written(recording, folder, robot="ur5"):
    """The folder of a recording, with a bundled robot of that name or none."""
    folder.mkdir(parents=True)
    lines = [f'name = "{folder.name}"', f'observation = "{recording.observation}"']
    lines += [f"noise_std = {recording.noise_std}"]
    lines += ["[robot]", f'bundled = "{robot}"'] if robot else []
    lines += ["[tool]", f"offset = {recording.tool_offset.tolist()}"]
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n")
    axes = [f"m{j}" for j in range(1, 7)] if recording.observation == "joint_position" else "xyz"
    names = [f"q{j}" for j in range(1, 7)] + list(axes)
    table = np.hstack([recording.q, recording.measured])
    np.savetxt(folder / "samples.csv", table, delimiter=",", header=",".join(names), comments="")
    return folder
