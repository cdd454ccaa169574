"""An arm that MuJoCo moves and the efforts that its drives would report, link by link as a URDF.

Bodies are changed in the URDF text itself, gravity in MuJoCo; what drives add is added in NumPy.
Nothing here knows how the library states any of it.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.motion import engine
from plumbline.experiments.reality.ranges import Ranges

RANGES = Ranges("torque")
G = 9.81  # m/s^2
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")


@dataclass(frozen=True)
class Link:
    """A cylinder along z of its joint, with its centre off its axis."""

    length: float  # m
    mass: float  # kg
    centre: tuple[float, float, float]  # m, in the joint's frame
    radius: float  # m

    @property
    def inertia(self) -> tuple[float, float, float]:
        """About its centre, along its axes [kg m^2]."""
        side = self.mass * (3 * self.radius**2 + self.length**2) / 12
        return side, side, self.mass * self.radius**2 / 2

    def urdf(self, name: str) -> str:
        """Its text."""
        xyz, (ix, iy, iz) = " ".join(f"{c:.9g}" for c in self.centre), self.inertia
        return (
            f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{self.mass:.9g}"/>'
            f'<inertia ixx="{ix:.9g}" iyy="{iy:.9g}" izz="{iz:.9g}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )


@dataclass(frozen=True)
class Build:
    """All that decides what moving the arm takes."""

    links: tuple[Link, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -G)
    load: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # kg, and its place at the tip

    @property
    def joints(self) -> int:
        """How many."""
        return len(self.links)

    def urdf(self) -> str:
        """The arm as a URDF; a load hangs on the last link as a link of its own."""
        parts = ['<robot name="arm"><link name="base"/>']
        for i, link in enumerate(self.links):
            lift = self.links[i - 1].length if i else 0.1
            parent, name = (f"link{i}" if i else "base"), f"link{i + 1}"
            parts.append(link.urdf(name) + _joint(f"joint{i + 1}", parent, name, lift, AXES[i]))
        last = f"link{self.joints}"
        parts.append('<link name="flange"/>')
        parts.append(_joint("flange_joint", last, "flange", self.links[-1].length, None))
        mass, *place = self.load
        if mass:
            held = Link(1e-3, mass, (place[0], place[1], place[2]), 1e-3)
            parts.append(held.urdf("load") + _joint("load_joint", "flange", "load", 0.0, None))
        return "".join([*parts, "</robot>"])

    def efforts(self, q: Array, v: Array, a: Array) -> Array:
        """Efforts (N, n) [N m] that move it so."""
        mujoco = engine()
        model = mujoco.MjModel.from_xml_string(self.urdf())
        model.opt.gravity[:] = self.gravity
        data, found = mujoco.MjData(model), np.empty_like(q)
        for k in range(len(q)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
            mujoco.mj_inverse(model, data)
            found[k] = data.qfrc_inverse
        return found

    def with_link(self, i: int, share: float, shift: Array) -> Self:
        """Another mass and centre of link i (from 0)."""
        link = self.links[i]
        centre = np.array(link.centre) + shift
        changed = replace(
            link, mass=link.mass * (1 + share), centre=(centre[0], centre[1], centre[2])
        )
        return replace(self, links=(*self.links[:i], changed, *self.links[i + 1 :]))


def _joint(name: str, parent: str, child: str, lift: float, axis: str | None) -> str:
    kind = "fixed" if axis is None else "continuous"
    turns = "" if axis is None else f'<axis xyz="{axis}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {lift:.9g}"/>{turns}</joint>'
    )


def draw_build(rng: np.random.Generator) -> Build:
    """An arm of five to seven joints, from a hobby arm's size to an industrial one's."""
    joints, size = RANGES.whole("joints", rng), RANGES.one("size", rng)
    links = []
    for i in range(joints):
        length = size * RANGES.one("length", rng) * (1.0 if i < 3 else 0.5)
        radius = length / 5
        mass = 40.0 * length * size * RANGES.one("mass", rng)
        off = RANGES.many("aside", rng, 2) * length
        centre = (off[0], off[1], length * RANGES.one("height", rng))
        links.append(Link(length, mass, centre, radius))
    return Build(tuple(links))


@dataclass(frozen=True)
class Course:
    """What the joints did: sums of sines, from rest nowhere."""

    time: Array  # (N,) [s]
    q: Array  # (N, n) [rad]
    v: Array  # (N, n) [rad/s]
    a: Array  # (N, n) [rad/s^2]


def draw_course(joints: int, rows: int, rng: np.random.Generator) -> Course:
    """Three sines a joint, of 0.1 to 0.8 Hz."""
    time = np.arange(rows) * 0.02
    q, v, a = (np.zeros((rows, joints)) for _ in range(3))
    for j in range(joints):
        q[:, j] += RANGES.one("middle", rng)
        for w in 2 * np.pi * RANGES.many("frequency", rng, 3):
            size, phase = RANGES.one("swing", rng), rng.uniform(0, 2 * np.pi)
            q[:, j] += size * np.sin(w * time + phase)
            v[:, j] += size * w * np.cos(w * time + phase)
            a[:, j] -= size * w**2 * np.sin(w * time + phase)
    return Course(np.asarray(time), q, v, a)
