"""The arms that take part: figures from their makers' documents.

- UR3, UR5, UR10: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
  (lengths, masses, centres of mass).
- VS060: DENSO WAVE, VS-060 external dimensions; masses are estimates.
- BH-7: a five-joint surgical arm on a vertical slide (Chen et al.); masses are estimates.
- KR300: KUKA KR 300 R2500 ultra SE as in Weigand, Gafur and Ruskowski (2021), 200 kg payload
  included. Its base axis points down, so gravity is along +z of its base frame.
- LBR: KUKA LBR iiwa 14 R820, seven joints; masses from its public URDF, rounded.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.arm import STANDARD_GRAVITY, Arm

Rows = list[tuple[float, float, float, float]]
Points = list[tuple[float, float, float]]


def _arm(
    name: str,
    rows: Rows,
    mass: list[float],
    com: Points,
    reach: list[tuple[float, float]],
    *,
    prismatic: tuple[int, ...] = (),
    up: float = 1.0,
    bundled: bool = True,
) -> Arm:
    """Build an arm from rows (d [m], a [m], alpha [deg], theta [deg]) and joint ranges."""
    table = np.array(rows)
    slides = np.zeros(len(rows), dtype=bool)
    slides[list(prismatic)] = True
    lower, upper = np.array(reach).T
    return Arm(
        name=name,
        d=table[:, 0],
        a=table[:, 1],
        alpha=np.deg2rad(table[:, 2]),
        theta=np.deg2rad(table[:, 3]),
        prismatic=slides,
        mass=np.array(mass),
        com=np.array(com),
        lower=lower,
        upper=upper,
        gravity=np.array([0.0, 0.0, -up * STANDARD_GRAVITY]),
        bundled=name if bundled else None,
    )


def _universal(name: str, d: list[float], a: list[float], mass: list[float], com: Points) -> Arm:
    alpha = [90.0, 0.0, 0.0, 90.0, -90.0, 0.0]
    lengths = [0.0, a[0], a[1], 0.0, 0.0, 0.0]
    offsets = [d[0], 0.0, 0.0, d[1], d[2], d[3]]
    rows = [(x, y, z, 0.0) for x, y, z in zip(offsets, lengths, alpha, strict=True)]
    reach = [(-2.6, 2.6), (-2.4, -0.4), (-2.2, 2.2), (-2.6, 1.6), (-2.4, 2.4), (-2.6, 2.6)]
    return _arm(name, rows, mass, com, reach)


def ur3() -> Arm:
    """UR3, CB series."""
    com = [
        (0.0, -0.02, 0.0), (0.13, 0.0, 0.1157), (0.05, 0.0, 0.0238),
        (0.0, 0.0, 0.01), (0.0, 0.0, 0.01), (0.0, 0.0, -0.02),
    ]  # fmt: skip
    d = [0.1519, 0.11235, 0.08535, 0.0819]
    return _universal("ur3", d, [-0.24365, -0.21325], [2.0, 3.42, 1.26, 0.8, 0.8, 0.35], com)


def ur5() -> Arm:
    """UR5, CB series."""
    com = [
        (0.0, -0.02561, 0.00193), (0.2125, 0.0, 0.11336), (0.15, 0.0, 0.0265),
        (0.0, -0.0018, 0.01634), (0.0, 0.0018, 0.01634), (0.0, 0.0, -0.001159),
    ]  # fmt: skip
    d = [0.089159, 0.10915, 0.09465, 0.0823]
    return _universal("ur5", d, [-0.425, -0.39225], [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879], com)


def ur10() -> Arm:
    """UR10, CB series."""
    com = [
        (0.021, 0.0, 0.027), (0.38, 0.0, 0.158), (0.24, 0.0, 0.068),
        (0.0, 0.007, 0.018), (0.0, 0.007, 0.018), (0.0, 0.0, -0.026),
    ]  # fmt: skip
    d = [0.1273, 0.163941, 0.1157, 0.0922]
    return _universal("ur10", d, [-0.612, -0.5723], [7.1, 12.7, 4.27, 2.0, 2.0, 0.365], com)


def vs060() -> Arm:
    """DENSO VS-060."""
    rows = [
        (0.345, 0.0, -90.0, 0.0), (0.0, 0.305, 0.0, -90.0), (0.0, -0.010, 90.0, 90.0),
        (0.300, 0.0, -90.0, 0.0), (0.0, 0.0, 90.0, 0.0), (0.070, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    com = [
        (0.0, 0.06, 0.0), (-0.15, 0.0, 0.0), (0.0, 0.0, 0.05),
        (0.0, 0.12, 0.0), (0.0, 0.0, 0.02), (0.0, 0.0, -0.01),
    ]  # fmt: skip
    reach = [(-2.4, 2.4), (-1.4, 1.4), (-1.4, 1.6), (-2.6, 2.6), (-1.9, 1.9), (-2.6, 2.6)]
    return _arm("vs060", rows, [6.0, 6.5, 4.0, 2.2, 1.2, 0.3], com, reach)


def bh7() -> Arm:
    """BH-7: a vertical slide, then four revolute joints; the needle is its tool."""
    rows = [
        (0.0, 0.0, 0.0, 0.0), (0.0, 0.2, 0.0, 0.0), (0.0, 0.2, 0.0, 0.0),
        (-0.170, 0.0, -90.0, -90.0), (0.145, 0.0, -90.0, 0.0),
    ]  # fmt: skip
    com = [
        (0.0, 0.0, -0.1), (-0.1, 0.0, 0.0), (-0.1, 0.0, 0.0), (0.0, -0.085, 0.0), (0.0, 0.07, 0.0),
    ]  # fmt: skip
    reach = [(0.05, 0.30), (-1.3, 1.3), (-1.8, 1.8), (-1.8, 1.8), (-1.6, 1.6)]
    arm = _arm("bh7", rows, [6.0, 2.5, 2.0, 1.0, 0.6], com, reach, prismatic=(0,))
    return replace(arm, tip_frame="link5")


def kr300() -> Arm:
    """KUKA KR 300 with a payload of 200 kg."""
    rows = [
        (-0.675, 0.350, 90.0, 0.0), (-0.189, 1.15, 0.0, 0.0), (0.189, 0.041, -90.0, 90.0),
        (-1.0, 0.0, 90.0, 0.0), (0.0, 0.0, -90.0, 0.0), (-0.24, 0.0, 180.0, 0.0),
    ]  # fmt: skip
    wrist, carried = 17.78, 200.0
    centre = (wrist * -0.050 + carried * 0.100) / (wrist + carried)
    com = [
        (-0.353, 0.174, -0.004), (-0.709, -0.001, 0.023), (-0.018, -0.018, -0.076),
        (0.0, 0.236, 0.001), (0.0, -0.080, -0.009), (0.0, 0.0, centre),
    ]  # fmt: skip
    mass = [395.40, 339.12, 105.21, 35.80, 31.46, wrist + carried]
    reach = [(-1.8, 1.8), (-2.2, -0.3), (-0.4, 2.2), (-2.6, 2.6), (-1.9, 1.9), (-2.6, 2.6)]
    return _arm("kr300", rows, mass, com, reach, up=-1.0)


def lbr() -> Arm:
    """KUKA LBR iiwa 14 R820, seven joints, written out as DH rows."""
    rows = [
        (0.34, 0.0, -90.0, 0.0), (0.0, 0.0, 90.0, 0.0),
        (0.40, 0.0, 90.0, 0.0), (0.0, 0.0, -90.0, 0.0),
        (0.40, 0.0, -90.0, 0.0), (0.0, 0.0, 90.0, 0.0), (0.126, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    com = [
        (0.0, 0.05, 0.0), (0.0, 0.04, 0.06), (0.0, -0.06, 0.0), (0.0, -0.03, 0.06),
        (0.0, 0.08, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -0.02),
    ]  # fmt: skip
    mass = [4.0, 4.0, 3.0, 2.7, 1.7, 1.8, 0.3]
    turn, tilt = (-2.4, 2.4), (-1.8, 1.8)
    reach = [turn, (-1.4, 1.4), turn, tilt, turn, tilt, turn]
    return _arm("lbr", rows, mass, com, reach, bundled=False)


ARMS = {f.__name__: f for f in (ur3, ur5, ur10, vs060, bh7, kr300, lbr)}
