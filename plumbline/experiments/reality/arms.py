"""The arms that take part: figures from their makers' documents, in ``arms.toml``.

- UR3, UR5, UR10: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
  (lengths, masses, centres of mass).
- VS060: DENSO WAVE, VS-060 external dimensions; masses are estimates.
- BH-7: a five-joint surgical arm on a vertical slide (Chen et al.); masses are estimates.
- KR300: KUKA KR 300 R2500 ultra SE as in Weigand, Gafur and Ruskowski (2021), 200 kg payload
  included. Its base axis points down, so gravity is along +z of its base frame.
- LBR: KUKA LBR iiwa 14 R820, seven joints; masses from its public URDF, rounded.
"""

from functools import partial

import numpy as np

from plumbline.experiments.reality.arm import STANDARD_GRAVITY, Arm
from plumbline.experiments.reality.ranges import table

TABLES = table("arms.toml")


def arm(name: str) -> Arm:
    """An arm of ``arms.toml``."""
    told = TABLES[name]
    rows, (lower, upper) = np.array(told["rows"]), np.array(told["reach"]).T
    slides = np.zeros(len(rows), dtype=bool)
    slides[told.get("slides", [])] = True
    return Arm(
        name=name,
        d=rows[:, 0],
        a=rows[:, 1],
        alpha=np.deg2rad(rows[:, 2]),
        theta=np.deg2rad(rows[:, 3]),
        prismatic=slides,
        mass=np.array(told["mass"]),
        com=np.array(told["com"]),
        lower=lower,
        upper=upper,
        gravity=np.array([0.0, 0.0, -told.get("up", 1.0) * STANDARD_GRAVITY]),
        bundled=name if told.get("bundled", True) else None,
        tip_frame=told.get("tip_frame", "flange"),
    )


ARMS = {name: partial(arm, name) for name in TABLES}
ur3, ur5, ur10, vs060, bh7, kr300, lbr = ARMS.values()
