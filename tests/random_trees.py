"""Random URDF trees: joints of every kind about any axis, branches, fixed frames and masses."""

from dataclasses import dataclass

import numpy as np

KINDS = ("revolute", "continuous", "prismatic", "fixed")


@dataclass(frozen=True)
class Tree:
    """A recipe of a tree: the seed draws every number of it.

    Attributes:
        seed: Seed of the random numbers.
        kinds: Kind of every joint.
        branching: Chance that a joint hangs on an earlier link than the last.
    """

    seed: int
    kinds: tuple[str, ...]
    branching: float = 0.0

    @classmethod
    def drawn(cls, seed: int, joints: int, branching: float) -> "Tree":
        """A tree whose joints are of random kinds; the first one moves."""
        rng = np.random.default_rng(1000 + seed)
        kinds = [str(rng.choice(KINDS, p=(0.4, 0.2, 0.2, 0.2))) for _ in range(joints)]
        return cls(seed, ("revolute", *kinds[1:]), branching)

    @property
    def parents(self) -> tuple[int, ...]:
        """Number of the link that every joint hangs on; link 0 is the base."""
        rng = np.random.default_rng(2000 + self.seed)
        return tuple(
            int(rng.integers(0, k + 1)) if rng.random() < self.branching else k
            for k in range(len(self.kinds))
        )

    @property
    def tips(self) -> tuple[str, ...]:
        """The leaves that at least one joint moves."""
        parents = self.parents
        leaves = sorted(set(range(1, len(parents) + 1)) - set(parents))
        return tuple(f"link{k}" for k in leaves if self._moves(k))

    def _moves(self, link: int) -> bool:
        while link > 0:
            if self.kinds[link - 1] != "fixed":
                return True
            link = self.parents[link - 1]
        return False

    def urdf(self, order: tuple[int, ...] | None = None, prefix: str = "joint") -> str:
        """The URDF; ``order`` shuffles its lines, ``prefix`` names its joints."""
        rng = np.random.default_rng(self.seed)
        links = ['<link name="link0"/>'] + [_link(k + 1, rng) for k in range(len(self.kinds))]
        joints = [
            _joint(f"{prefix}{self._label(k, prefix)}", kind, parent, k + 1, rng)
            for k, (kind, parent) in enumerate(zip(self.kinds, self.parents, strict=True))
        ]
        lines = [*links, *joints]
        lines = lines if order is None else [lines[k] for k in order]
        return "\n".join(['<robot name="tree">', *lines, "</robot>"])

    def _label(self, k: int, prefix: str) -> str:
        return f"{k + 1}" if prefix == "joint" else f"{len(self.kinds) - k:03d}"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _link(number: int, rng: np.random.Generator) -> str:
    mass, com, moments = rng.uniform(0.1, 8.0), rng.normal(0.0, 0.1, 3), rng.uniform(0.1, 0.2, 3)
    if rng.random() < 0.2:
        return f'<link name="link{number}"/>'
    xx, yy, zz = moments * mass
    return (
        f'<link name="link{number}"><inertial><origin xyz="{_numbers(com)}"/>'
        f'<mass value="{mass:.12g}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" '
        'iyz="0"/></inertial></link>'
    )


def _joint(name: str, kind: str, parent: int, child: int, rng: np.random.Generator) -> str:
    place, turn, axis = rng.normal(0.0, 0.3, 3), rng.uniform(-3.0, 3.0, 3), rng.normal(size=3)
    limit = '<limit lower="-1.5" upper="2.0" effort="1" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="link{parent}"/>'
        f'<child link="link{child}"/><origin xyz="{_numbers(place)}" rpy="{_numbers(turn)}"/>'
        + ("" if kind == "fixed" else f'<axis xyz="{_numbers(axis)}"/>')
        + (limit if kind in ("revolute", "prismatic") else "")
        + "</joint>"
    )
