r"""A ball resting in sockets: reading the MUKCa recordings of Panda, iiwa and Gen3 Lite.

A printed block has two sockets 50 mm apart and is placed in several parts of the workspace. The
ball on the flange rests in socket :math:`k` while the arm moves about it, so that

.. math:: p_{BF}(q_i) + R_{BF}(q_i) t = s_k,

with the ball's place :math:`t` in the tip frame and the sockets' places :math:`s_k` unknown.

Franzese, G. et al., MUKCa: Accurate and Affordable Cobot Calibration Without External Measurement
Devices, arXiv:2503.12584, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.experiments.sources.catalogue import Source, SourceFile
from plumbline.experiments.sources.folder import Draft, Value
from plumbline.experiments.sources.mukca_files import PLACEMENTS

SOCKET_DISTANCE = 0.05  # [m] between the two sockets of the block


@dataclass(frozen=True)
class Arm:
    """What a robot's URDF at the source calls things."""

    urdf: SourceFile  # the file
    tip_frame: str  # the frame that carries the ball, the parent of `ball_joint`
    ball: tuple[float, float, float]  # the ball in the tip frame [m], the origin of `ball_joint`
    joints: int  # movable joints between the root and the tip frame
    note: str  # what the recording leaves out


PANDA = Arm(
    SourceFile(
        "urdf/panda.urdf", "6e30a37df12389628e68dfc18b98286284ca9e8f21eeff854965c75c1704d63f"
    ),
    "panda_hand_tcp",
    (7.773732033005863e-05, -4.214022515884392e-05, 0.030128297908475325),
    7,
    "Joints panda_joint1..7; the two finger joints of the URDF are off the chain and left out.",
)
IIWA = Arm(
    SourceFile(
        "urdf/iiwa14.urdf", "29e6e2e55bf676b4e901a4fd63a3b22373cc6f473aafdf09bf21ee922c64e141"
    ),
    "tool0",
    (0.0, 0.0, 0.04),
    7,
    "Joints joint_a1..7, all that the URDF has.",
)
GEN3_LITE = Arm(
    SourceFile(
        "urdf/gen3lite.urdf", "e423230f532024e702ef1988dbff616bf2250b9fa8a2e047428af4bb486f39cf"
    ),
    "gripper_base_link",
    (0.00038860649894460975, -0.0005822849938650045, 0.180196205872143),
    6,
    "Joints joint_1..6, all that the URDF moves; the mobile base stood still and is left out.",
)

#: By name of the source: the robot's folder at the source, and its URDF.
ROBOTS: dict[str, tuple[str, Arm]] = {
    "panda-1": ("panda_1", PANDA),
    "panda-3": ("panda_3", PANDA),
    "kuka-iiwa14": ("kuka_14", IIWA),
    "dinova-1": ("dinova_1", GEN3_LITE),
}

NOTES = (
    "Joint readings [rad] with the ball at rest in a socket. group: placement of the block;",
    "socket = 2 * placement + hole. Every row of the source's hole_0 and hole_1 files is here.",
    "The tool's offset is the URDF's ball_joint, a start value: the ball's place is fitted.",
    "The play of the ball in its sockets is not stated, so noise_std is left to be estimated.",
    "robot.urdf is the source's file as it is; its meshes are not part of this folder.",
)


def _source(name: str, robot: str, rows: int) -> Source:
    """One robot of the repository."""
    folder, arm = ROBOTS[name]
    holes = tuple(
        SourceFile(f"data/{folder}/{placement}/hole_{hole}.csv", sha256)
        for placement, *hashes in PLACEMENTS[folder]
        for hole, sha256 in enumerate(hashes)
    )
    return Source(
        name=name,
        robot=robot,
        instrument="printed ball and a block of two sockets 50 mm apart",
        rows=rows,
        licence="MIT, Copyright (c) 2024 platonics (Giovanni Franzese, Max Spahn, Mariano Ramirez)",
        repository="platonics-delft/kinematics_calibration",
        commit="05a05ab4cbbe328c8f5bfcc76479c752ed07b82e",
        folder="mukca_panda",
        files=(*holes, arm.urdf),
        citation=(
            "Franzese, G., Spahn, M., Kober, J., Della Santina, C. (2025). MUKCa: Accurate and "
            "Affordable Cobot Calibration Without External Measurement Devices. arXiv:2503.12584."
        ),
        description=f"{robot}, ball in two sockets at {len(holes) // 2} places of the block",
    )


SOURCES = (
    _source("panda-1", "Franka Panda 1", 182),
    _source("panda-3", "Franka Panda 3", 387),
    _source("kuka-iiwa14", "KUKA LBR iiwa 14", 180),
    _source("dinova-1", "Kinova Gen3 Lite on a mobile base", 137),
)


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one robot.

    Returns:
        The recording: joints, socket and group, with the robot's URDF.
    """
    arm = ROBOTS[source.name][1]
    holes = [file.path for file in source.files if file != arm.urdf]
    frames = [_hole(local[path], socket, arm.joints) for socket, path in enumerate(holes)]
    pairs = [[2 * placement, 2 * placement + 1] for placement in range(len(holes) // 2)]
    tables: dict[str, dict[str, Value]] = {
        "robot": {"urdf": "robot.urdf", "tip_frame": arm.tip_frame},
        "tool": {"offset": list(arm.ball)},
        "sockets": {"distance": SOCKET_DISTANCE, "pairs": pairs},
        "fit": {"always": ["tool"]},
    }
    samples = pd.concat(frames, ignore_index=True)
    return Draft("fixed_point", (*NOTES, arm.note), {}, tables, samples, local[arm.urdf.path])


def _hole(path: Path, socket: int, joints: int) -> pd.DataFrame:
    """Rows of one socket: its joint readings, its number and that of its placement."""
    readings = np.loadtxt(path, delimiter=",", ndmin=2)
    columns = [f"q{j + 1}" for j in range(joints)]
    return pd.DataFrame(readings, columns=columns).assign(socket=socket, group=socket // 2)
