r"""A ball resting in sockets: reading the MUKCa recordings of Panda, iiwa and Gen3 Lite.

A printed block has two sockets 50 mm apart and is placed in several parts of the workspace. The
ball on the flange rests in socket :math:`k` while the arm moves about it, so that

.. math:: p_{BF}(q_i) + R_{BF}(q_i) t = s_k,

with the ball's place :math:`t` in the tip frame and the sockets' places :math:`s_k` unknown.

Franzese, G. et al., MUKCa: Accurate and Affordable Cobot Calibration Without External Measurement
Devices, arXiv:2503.12584, 2025.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft, Value

SOCKET_DISTANCE = 0.05  # [m] between the two sockets of the block


@dataclass(frozen=True)
class Arm:
    """What a robot's URDF at the source calls things."""

    tip_frame: str  # the frame that carries the ball, the parent of `ball_joint`
    ball: tuple[float, float, float]  # the ball in the tip frame [m], the origin of `ball_joint`
    joints: int = 7  # movable joints between the root and the tip frame


PANDA = Arm("panda_hand_tcp", (7.773732033005863e-05, -4.214022515884392e-05, 0.030128297908475325))
ROBOTS = {  # by name of the source
    "panda-1": PANDA,
    "panda-1-sensor": PANDA,
    "panda-3": PANDA,
    "kuka-iiwa14": Arm("tool0", (0.0, 0.0, 0.04)),
    "dinova-1": Arm(
        "gripper_base_link", (0.00038860649894460975, -0.0005822849938650045, 0.180196205872143), 6
    ),
}


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one robot: joints, socket and group, with the robot's URDF.

    Its files are two a placement, the placements in alphabetical order, and the URDF last.
    """
    arm = ROBOTS[source.name]
    *holes, urdf = (file.path for file in source.files)
    frames = [_hole(local[path], socket, arm.joints) for socket, path in enumerate(holes)]
    pairs = [[2 * placement, 2 * placement + 1] for placement in range(len(holes) // 2)]
    tables: dict[str, dict[str, Value]] = {
        "robot": {"urdf": "robot.urdf", "tip_frame": arm.tip_frame},
        "tool": {"offset": list(arm.ball)},
        "sockets": {"distance": SOCKET_DISTANCE, "pairs": pairs},
        "fit": {"always": ["tool"]},
    }
    samples = pd.concat(frames, ignore_index=True)
    return Draft("fixed_point", {}, tables, samples, local[urdf])


def _hole(path: Path, socket: int, joints: int) -> pd.DataFrame:
    """Rows of one socket: its joint readings, its number and that of its placement."""
    readings = np.loadtxt(path, delimiter=",", ndmin=2)
    columns = [f"q{j + 1}" for j in range(joints)]
    return pd.DataFrame(readings, columns=columns).assign(socket=socket, group=socket // 2)
