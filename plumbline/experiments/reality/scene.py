"""A session's course, and the scene that the mechanisms change.

The chain of a reading: the joints stand at `q` (not quite what the encoders say), the links carry
the tip to

    p_base = t_base_flange + R_base_flange tool + sag

the base itself has moved by a small twist, and the device looks at the result from where it stands:

    p_device = R_device_world (p_world) + t_device_world.

A mechanism changes the scene before the reading (`body`) or the points that the device reports
(`sense`).
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Self, dataclass_transform

import numpy as np

from plumbline.experiments.reality.arm import Arm, Array, Shape, forward, rotations
from plumbline.experiments.reality.ranges import table

MECHANISMS = table("mechanisms.toml")


@dataclass(frozen=True)
class Session:
    """The course of a recording, one row per reading."""

    q: Array  # (N, n) encoder readings [rad or m]
    time: Array  # (N,) [s]
    warmth: Array  # (N,) the arm's true temperature [degC]
    ambient: Array  # (N,) the air's temperature [degC]
    direction: Array  # (N, n) side of the last approach, -1, 0 or 1
    velocity: Array  # (N, n) joint velocities [rad/s or m/s], zero when the arm stands still
    group: Array  # (N,) number of the part of the session
    force: Array | None = None  # (N, 3) force on the tip, in the last link's frame [N]
    # how long what counts as the session takes [s]; that of all rows unless given
    length: float | None = None

    @property
    def rows(self) -> int:
        """Number of readings."""
        return len(self.q)

    @property
    def progress(self) -> Array:
        """(N,) progress through the session, 0 to 1, and beyond in rows that follow it."""
        span = np.ptp(self.time) if self.length is None else self.length
        return (self.time - self.time[0]) / (span if span > 0.0 else 1.0)


@dataclass(frozen=True)
class Scene:
    """The true state of everything at every row."""

    arm: Arm  # the arm with its real masses
    session: Session  # what the controller and the clock say
    q: Array  # (N, n) true joint positions [rad or m]
    shape: Shape  # true geometry by row
    tool: Array  # (N, 3) tip in the last link's frame [m]
    sag: Array  # (N, 3) displacement of the tip in the base frame [m]
    base: Array  # (N, 6) translation [m] and rotation [rad] of the base in the world
    device: Array  # (4, 4) T_device_world
    turn: Array  # (N, 3) rotation vector of the tool in the last link's frame [rad]

    @classmethod
    def ideal(cls, arm: Arm, session: Session, tool: Array, device: Array) -> Self:
        """A scene in which everything is as drawn; tool (3,) [m], device (4, 4)."""
        rows = session.rows
        still = np.zeros((rows, 3))
        return cls(
            arm=arm,
            session=session,
            q=session.q.copy(),
            shape=Shape.of(arm, rows),
            tool=np.tile(tool, (rows, 1)),
            sag=still,
            base=np.zeros((rows, 6)),
            device=device,
            turn=still,
        )

    def flexed(self, i: int, change: Array) -> Self:
        """With a displacement [m] and rotation [rad] (N, 6) added at the end of link i (from 0)."""
        flex = self.shape.flex.copy()
        flex[:, i] += change
        return replace(self, shape=replace(self.shape, flex=flex))

    def turned_base(self, turn: Array) -> Self:
        """With a rotation (N, 3) [rad] added to the base's."""
        return replace(self, base=self.base + np.hstack([np.zeros_like(turn), turn]))

    def frames(self) -> Array:
        """(N, n + 1, 4, 4) link frames in the base frame."""
        return forward(self.arm, self.q, self.shape)

    def tip(self) -> tuple[Array, Array]:
        """Link frames, and tips (N, 3) [m] in the base frame before the needle sags."""
        frames = self.frames()
        flange = frames[:, -1]
        return frames, flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], self.tool)

    def pose_in_world(self) -> tuple[Array, Array]:
        """Tip positions (N, 3) [m] and flange rotations (N, 3, 3) in the world frame."""
        frames, tip = self.tip()
        turn = rotations(self.base[:, 3:])
        point = np.einsum("nij,nj->ni", turn, tip + self.sag) + self.base[:, :3]
        return point, turn @ frames[:, -1, :3, :3] @ rotations(self.turn)

    def pose_in_device(self) -> tuple[Array, Array]:
        """Tip positions (N, 3) [m] and flange rotations (N, 3, 3) in the device frame."""
        point, turn = self.pose_in_world()
        R, t = self.device[:3, :3], self.device[:3, 3]
        return point @ R.T + t, R @ turn


@dataclass_transform(frozen_default=True)
class Frozen:
    """What derives from it is a frozen dataclass, and has what ``mechanisms.toml`` says of it."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name, value in MECHANISMS.get(cls.__name__, {}).items():
            plain = value[0] if name == "limit" else value
            setattr(cls, name, tuple(plain) if isinstance(plain, list) else plain)
        dataclass(frozen=True)(cls)


class Mechanism(Frozen):
    """One true deviation; `size` scales it, in the unit that the mechanism documents.

    A mechanism says what it does to the scene (`body`) or to what the device reports (`sense`).
    """

    size: float
    effect: ClassVar[str] = ""
    limit: ClassVar[float] = np.inf  # largest strength that a real arm would show
    typical: ClassVar[float] = 1e-3  # where the search for a strength begins
    named: ClassVar[tuple[str, ...]] = ("size",)  # the size's name, then fields by their own
    stage: ClassVar[str] = ""  # where along the chain it acts, where no effect of a library does
    depends: ClassVar[tuple[str, ...]] = ()  # on what, where no effect of a library does

    @property
    def element(self) -> int | None:
        """Joint or link that is at fault, from 1; None where there is none."""
        found: int | None = getattr(self, "joint", getattr(self, "link", None))
        return found

    @property
    def depends_on(self) -> tuple[str, ...]:
        """On what it depends, its own joints by their numbers."""
        return tuple(words.format(**vars(self)) for words in self.depends)

    def alike(self) -> "tuple[tuple[Mechanism, ...], ...]":
        """Forms of a library, by the terms each may mix, that only this mechanism calls for."""
        return ()

    def sized(self, size: float) -> Self:
        """The same mechanism at another strength."""
        return replace(self, size=float(size))

    def pinned(self, scene: Scene) -> "Mechanism":
        """The same mechanism with all that it reads off the rows of a scene written down."""
        return self

    def body(self, scene: Scene) -> Scene:
        """The scene with the mechanism at work."""
        return scene

    def sense(self, points: Array, session: Session) -> Array:
        """What the device makes of true points (N, 3) [m] in its own frame."""
        return points

    def parameters(self) -> dict[str, object]:
        """Named true values in SI units."""
        name, *others = self.named
        told = {key: getattr(self, key) for key in others}
        told = {key: list(v) if isinstance(v, tuple) else v for key, v in told.items()}
        beyond = {"depends_on": list(self.depends_on)} if self.depends_on else {}
        place = {"stage": self.stage} if self.stage else {}
        return {name: self.size} | told | beyond | place


def measured(scene: Scene, mechanisms: tuple[Mechanism, ...]) -> Array:
    """Noise-free tip readings (N, 3) [m] in the device frame, mechanisms in the order given."""
    points, _ = built(scene, mechanisms).pose_in_device()
    for mechanism in mechanisms:
        points = mechanism.sense(points, scene.session)
    return points


def built(scene: Scene, mechanisms: tuple[Mechanism, ...]) -> Scene:
    """The scene with every mechanism at work."""
    for mechanism in mechanisms:
        scene = mechanism.body(scene)
    return scene
