r"""An arm with a range finder before three boards: drawn at random, planned, and measured.

The plan only knows the drawing of the holder, so beams land a little beside the patches that they
are meant for; the readings are of where they really land, by an arm that is not quite where its
encoders say. Paper's figures (Zeng et al., 2017): arm 0.02 mm, range 0.05 mm from 200 to 1000 mm,
spot 1.6 mm. How noisy slanted beams are, how flat the boards and how well a spot is aimed are not
given there: they are this module's assumptions, in :class:`Instrument`. Boards of 0.17 mm (a
workshop's, no surface plates) and groups of translations that lean a few degrees and vary their
stand-off by a decimetre (`LEAN`, `STAND`) are chosen so that the closed form on one plane comes out
near the paper's 1.37 mm; a few readings are poor, as its selection loop must have met.

Joints scatter so that the flange scatters as the maker says,

.. math:: \sigma_q = \sqrt 3\, \sigma_{axis} / \sqrt{\textstyle\sum_i |z_i \times (p - o_i)|^2}

for revolute joints about z_i through o_i and a flange at p. A built arm besides differs from its
drawing: every link and joint zero is a little off, all by so much that the flange errs by a given
root mean square over the workspace.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, forward, rotations
from plumbline.experiments.reality.arms import vs060
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.ranging.aim import Cone, each_reached, tilted, together
from plumbline.experiments.reality.ranging.finder import Board, Finder, draw_bumps, spoil

DRAWN = Ranges("ranging")
GRID = (5, 3)  # patches along and across a board
LEAN = (0.20, 0.35)  # tilt of the groups of translations over the largest
STAND = (0.25, 0.36)  # m: lengths of the beams in the groups of translations
POOR = (1e-3, 2e-3)  # m: how far poor readings are off
GROUPS = 3  # of pure translations on each plane
RANGES = (2.9, 2.0, 2.1, 4.6, 2.0, 6.2)  # rad: the maker's joint ranges, with a margin
NOMINAL = (np.array([0.045, -0.010, 0.060]), np.array([0.0, 0.0, 1.0]))
LENGTHS, ANGLES = 0.3e-3, 1e-3  # m, rad: how lengths and angles share an arm's error
POSTURES = 200  # over which an arm's error is measured


@dataclass(frozen=True)
class Instrument:
    """What the instruments and the workshop are good for; lengths in m, angles in rad."""

    noise: float = 0.05e-3  # repeatability of the range, 1 sigma
    spot: float = 1.6e-3  # diameter of the spot
    grain: float = 0.05  # share of the depths under the spot that is noise
    skew: float = 0.03  # share of the spot's growth that is bias
    repeatability: float = 0.02e-3  # scatter of the flange per axis, 1 sigma
    # how far the flange is from where the arm's drawing has it, root mean square
    accuracy: float = 0.0
    flatness: float = 0.17e-3  # departure of a board from its plane, root mean square
    aim: float = 0.05e-3  # how far a spot lies from the mark that it is aimed at, per axis, 1 sigma
    gross: float = 0.0  # share of readings that are gross errors, 2 to 30 mm off
    poor: float = 0.0  # share of readings that are poor, 1 to 2 mm off: specks, scratches, edges
    tilt: float = float(np.deg2rad(30.0))  # largest angle between beam and normal
    # how far the boards are from square to each other, 1 sigma
    square: float = float(np.deg2rad(0.3))
    tracker: float = 0.1e-3  # noise of the optical tracker, root mean square in space


@dataclass(frozen=True, eq=False)
class Scene:
    """An arm, its range finder, and the boards before it."""

    arm: Arm  # the arm as drawn
    finder: Finder  # the range finder as it really sits
    boards: tuple[Board, ...]  # the boards
    instrument: Instrument  # what everything is good for
    built: Arm | None = None  # the arm as it was built; None where that is as drawn


@dataclass(frozen=True, eq=False)
class Programme:
    """Postures in their order; columns as those of :class:`Survey`."""

    q: Array
    plane: NDArray[np.int64]
    motion: NDArray[np.int64]
    patch: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Survey:
    """Readings in the order of measurement."""

    q: Array  # (N, n) encoder readings [rad]
    distance: Array  # (N,) ranges read [m]
    plane: NDArray[np.int64]  # (N,) board, from 1; 0 for what is no board
    motion: NDArray[np.int64]  # (N,) group of motions on its board, from 1; the last one turns
    patch: NDArray[np.int64]  # (N,) which patch or mark was aimed at, from 0
    gross: NDArray[np.intp]  # (rows,) rows that are gross errors, from 0


def draw_scene(
    rng: np.random.Generator, instrument: Instrument | None = None, angles: float = 90.0
) -> Scene:
    """A scene of its own, by an instrument, its boards at angles [deg] to each other."""
    given = instrument or Instrument()
    arm = vs060()
    limits = np.array(RANGES)
    arm = replace(arm, lower=-limits, upper=limits)
    finder = _mounted(given, rng)
    return Scene(arm, finder, _boards(given, angles, rng), given)


def _mounted(given: Instrument, rng: np.random.Generator) -> Finder:
    """A range finder near where the drawing of its holder has it."""
    lean = tilted(NOMINAL[1], DRAWN.many("lean", rng, 1), rng.uniform(0.0, 2 * np.pi, 1))[0]
    return Finder(
        NOMINAL[0] + DRAWN.many("mount", rng, 3), lean,
        given.noise, given.spot, given.grain, given.skew,
    )  # fmt: skip


def _boards(given: Instrument, angles: float, rng: np.random.Generator) -> tuple[Board, ...]:
    """Floor, front and side, facing the arm; the front and side lean by what angles lack of 90."""
    lean = np.deg2rad(angles - 90.0)
    floor = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]).T
    front = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]).T
    side = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T
    front = rotations(np.array([0.0, lean, 0.0])) @ front
    side = rotations(np.array([-lean, 0.0, 0.0])) @ side
    whole = rotations(DRAWN.near("stands", rng, 3))
    centres = np.array([[0.40, -0.02, 0.02], [0.83, 0.0, 0.36], [0.36, 0.64, 0.36]])
    found = []
    for centre, axes in zip(centres, (floor, front, side), strict=True):
        own = rotations(rng.normal(0.0, given.square, 3))
        place = centre + DRAWN.many("board", rng, 3)
        bumps = draw_bumps(given.flatness, rng)
        found.append(Board(place, whole @ own @ axes, np.array([0.16, 0.13]), bumps))
    return tuple(found)


def patches() -> Array:
    """Middles of the patches (15, 2) on a board [m]."""
    x, y = np.meshgrid(np.linspace(-0.11, 0.11, GRID[0]), np.linspace(-0.08, 0.08, GRID[1]))
    return np.column_stack([x.ravel(), y.ravel()])


def plan(scene: Scene, rng: np.random.Generator) -> Programme:
    """The paper's programme, if in reach: on each board three translations and one that turns."""
    parts = []
    for k, board in enumerate(scene.boards):
        for group in range(GROUPS):
            parts.append((k, group, translations(scene, board, group, rng)))
        parts.append((k, GROUPS, turning(scene, board, rng)))
    count = len(patches())
    return Programme(
        q=np.concatenate([postures for _, _, postures in parts]),
        plane=np.repeat([k + 1 for k, _, _ in parts], count),
        motion=np.repeat([group + 1 for _, group, _ in parts], count),
        patch=np.tile(np.arange(count), len(parts)),
    )


def calibration(
    scene: Scene, rng: np.random.Generator, programme: Programme | None = None
) -> Survey:
    """The readings of a programme, of a fresh one by default (PlumblineError: a beam misses)."""
    p = programme or plan(scene, rng)
    distance = measure(scene, p.q, p.plane, rng)
    distance, poor = spoil(distance, scene.instrument.poor, rng, *POOR)
    distance, gross = spoil(distance, scene.instrument.gross, rng)
    return Survey(p.q, distance, p.plane, p.motion, p.patch, np.union1d(poor, gross))


def remounted(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with its range finder mounted anew, other boards on the stands, another arm."""
    boards = tuple(
        replace(board, bumps=draw_bumps(scene.instrument.flatness, rng)) for board in scene.boards
    )
    finder = _mounted(scene.instrument, rng)
    accuracy = scene.instrument.accuracy
    built = as_built(scene.arm, accuracy, rng) if accuracy else None
    return replace(scene, finder=finder, boards=boards, built=built)


def translations(scene: Scene, board: Board, group: int, rng: np.random.Generator) -> Array:
    """Postures (15, n) of one orientation that visit every patch at varied stand-offs."""
    points = board.at(patches())
    for attempt in range(40):
        tilt = rng.uniform(*LEAN) * scene.instrument.tilt
        azimuth = 2 * np.pi * group / GROUPS + DRAWN.one("azimuth", rng)
        seen = tilted(NOMINAL[1], np.array([tilt]), np.array([azimuth]))[0]
        # Stand-offs shrink where the arm runs out of space for them.
        stand = rng.uniform(STAND[0], max(STAND[1] - 0.003 * attempt, STAND[0]), len(points))
        q = together(scene.arm, NOMINAL, points, -board.normal, seen, stand, rng)
        if q is not None:
            return q
    raise PlumblineError("a board out of reach: no orientation visits all of its patches")


def turning(scene: Scene, board: Board, rng: np.random.Generator) -> Array:
    """Postures (15, n) that visit every patch, each from another side."""
    points = board.at(patches())
    inward = np.tile(-board.normal, (len(points), 1))
    q, good = each_reached(scene.arm, NOMINAL, points, inward, _cone(scene), rng)
    if not good.all():
        raise PlumblineError(f"a board out of reach: {int((~good).sum())} patches of {len(points)}")
    return q


def _cone(scene: Scene) -> Cone:
    return Cone(tilt=0.95 * scene.instrument.tilt)


def true_flange(scene: Scene, q: Array, rng: np.random.Generator) -> Array:
    """Where the flange really is (N, 4, 4) when the encoders say q (N, n)."""
    arm = scene.built or scene.arm
    frames = forward(arm, q)
    scatter = joint_scatter(frames, scene.instrument.repeatability)
    return forward(arm, q + scatter[:, None] * rng.normal(size=q.shape))[:, -1]


def measure(scene: Scene, q: Array, plane: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """Ranges (N,) [m] at encoder readings q (N, n) on boards (N,) from 1, refused if one misses."""
    origins, beams = scene.finder.beams(true_flange(scene, q, rng))
    distance, cosine = np.empty(len(q)), np.empty(len(q))
    met = np.empty(len(q), dtype=bool)
    for k, board in enumerate(scene.boards, start=1):
        rows = plane == k
        distance[rows], normal, met[rows] = board.hit(origins[rows], beams[rows])
        cosine[rows] = -np.sum(normal * beams[rows], axis=1)
    met &= scene.finder.reaches(distance)
    if not met.all():
        raise PlumblineError(f"{int((~met).sum())} beams miss their board or are out of range")
    return scene.finder.read(distance, cosine, rng)


def marks(
    scene: Scene, rng: np.random.Generator, count: int = 10, views: int = 5
) -> tuple[Survey, Array]:
    """Marks on the boards, each aimed at from several sides.

    The readings (count x views rows, a mark's own ones together), and the marks (count, 3) in the
    base frame [m].
    """
    which = rng.integers(0, len(scene.boards), count)
    found_q, found_at = [], []
    for k in which:
        board = scene.boards[k]
        for _ in range(40):
            place = DRAWN.many("mark", rng, (1, 2)) * board.half
            point = board.at(place)
            q, good = aimed(scene, point, -board.normal[None], views, rng)
            if good.all():
                break
        else:
            raise PlumblineError("a board out of reach: no mark can be seen from all sides")
        found_q.append(q)
        found_at.append(point)
    q = np.concatenate(found_q)
    plane = np.repeat(which + 1, views)
    patch = np.repeat(np.arange(count), views)
    none = np.zeros(0, dtype=np.intp)
    survey = Survey(q, measure(scene, q, plane, rng), plane, np.zeros_like(plane), patch, none)
    return survey, np.concatenate(found_at)


def aimed(
    scene: Scene, points: Array, inward: Array, views: int, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Postures (N views, n) whose spots lie on points (N, 3), as well as an eye can tell."""
    aim = np.repeat(points, views, axis=0)
    inward = np.repeat(inward, views, axis=0)
    off = rng.normal(0.0, scene.instrument.aim, aim.shape)
    off -= np.sum(off * inward, axis=1, keepdims=True) * inward
    beam = (scene.finder.r, scene.finder.v)
    return each_reached(scene.arm, beam, aim + off, inward, _cone(scene), rng)


def joint_scatter(frames: Array, per_axis: float) -> Array:
    """Scatter of each joint (N,) [rad] that moves the flange by `per_axis` [m] along each axis.

    By the frames (N, n + 1, 4, 4) of the links in the base frame; both are of 1 sigma.
    """
    axes, origins = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
    levers = np.linalg.norm(np.cross(axes, frames[:, -1:, :3, 3] - origins), axis=2)
    return np.asarray(np.sqrt(3.0) * per_axis / np.linalg.norm(levers, axis=1))


def as_built(arm: Arm, error: float, rng: np.random.Generator) -> Arm:
    """An arm whose flange lies `error` [m], root mean square, from where the drawing has it."""
    n = arm.joints
    steps = {
        "d": rng.normal(0.0, LENGTHS, n), "a": rng.normal(0.0, LENGTHS, n),
        "alpha": rng.normal(0.0, ANGLES, n), "theta": rng.normal(0.0, ANGLES, n),
    }  # fmt: skip
    q = rng.uniform(0.5 * arm.lower, 0.5 * arm.upper, (POSTURES, n))

    def off(share: float) -> Arm:
        return replace(arm, **{name: getattr(arm, name) + share * s for name, s in steps.items()})

    gaps = (forward(off(1.0), q) - forward(arm, q))[:, -1, :3, 3]
    return off(error / float(np.sqrt(np.mean(np.sum(gaps**2, axis=1)))))
