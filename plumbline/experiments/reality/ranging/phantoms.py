r"""What a calibrated range finder is tried on: tracked points, a block, a head, and a camera.

The head is star-shaped about its middle, an ellipsoid with a brow, a nose, a chin and ears:

.. math:: \rho(u) = \rho_{ellipsoid}(u) + \sum_i a_i \exp(-k_i (1 - u^T w_i))

Beams meet it where :math:`|x| - \rho(x / |x|)` changes sign along them.

A camera in the range finder's place, on the same motions, shows what its hand-eye problem would be.
It sits at r and looks along v; a target stands in the middle of a board, and its pose is measured
with noise,

.. math:: T_{ct} = T_{fc}^{-1}\, T_{bf}^{-1}\, T_{bt}\, \delta

with b the base, f the flange, c the camera, t the target, and delta a small random motion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array, forward, placed, rotations
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.ranging.aim import Cone, each_reached, taking
from plumbline.experiments.reality.ranging.finder import ORDERS, Board
from plumbline.experiments.reality.ranging.scene import Scene, aimed, true_flange

RANGES = Ranges("ranging")
BLOCK = (0.090, 0.055, 0.045)  # m, the paper's
FLAT = np.zeros(len(ORDERS))
SEMI_AXES = np.array([0.095, 0.075, 0.115])  # m: front to back, side to side, bottom to top
# Height [m], sharpness, direction: nose, brow left and right, chin, ears.
FEATURES = (
    (0.022, 60.0, (1.0, 0.0, -0.05)), (0.006, 25.0, (1.0, 0.35, 0.35)),
    (0.006, 25.0, (1.0, -0.35, 0.35)), (0.014, 30.0, (1.0, 0.0, -0.75)),
    (0.010, 80.0, (0.0, 1.0, 0.0)), (0.010, 80.0, (0.0, -1.0, 0.0)),
)  # fmt: skip
CT_NOISE = 0.3e-3  # m: of the segmented surface, along its normal
TARGETS = 13  # inside the head, as in the paper
SHIFT, TURN = 0.1e-3, 0.5e-3  # m, rad: noise of a target's pose per axis, 1 sigma


@dataclass(frozen=True, eq=False)
class Scan:
    """Readings of a scan."""

    q: Array  # (N, n) encoder readings [rad]
    distance: Array  # (N,) ranges read [m]
    part: NDArray[np.int64]  # (N,) which face, or 0


@dataclass(frozen=True, eq=False)
class Head:
    """A head on the table, and what CT shows of it."""

    T: Array  # (4, 4) its frame in the base frame [m]
    T_ct: Array  # (4, 4) its frame in the CT frame [m]
    surface: Array  # (M, 3) points of its surface in the CT frame [m]
    targets: Array  # (13, 3) points inside, in the CT frame [m]
    landmarks: Array  # (6, 3) features of its surface, in the head's own frame [m]


def tracked(
    scene: Scene, head: Head, rng: np.random.Generator, count: int = 12, views: int = 5
) -> tuple[Scan, Array]:
    """Marks on the head's face that an optical tracker sees too.

    The readings, `views` for each mark, whose number from 0 is their part; and the tracker's points
    (count, 3) [m] in its own frame.
    """
    ways = _faced(rng, 6 * count, 0.3)
    points = _carried(head.T, ways * radius(ways)[:, None])
    inward = -_normals(ways) @ head.T[:3, :3].T
    q, good = aimed(scene, points, inward, views, rng)
    origins, beams = scene.finder.beams(true_flange(scene, q, rng))
    distance, cosine, met = hit(head, origins, beams)
    good &= met & scene.finder.reaches(distance)
    chosen = np.flatnonzero(good.reshape(-1, views).all(axis=1))[:count]
    rows = (chosen[:, None] * views + np.arange(views)).ravel()
    read = scene.finder.read(distance[rows], cosine[rows], rng)
    turn, aside = RANGES.near("tracker", rng, 3), RANGES.many("tracker_aside", rng, 2)
    T = placed(rotations(turn), np.append(aside, RANGES.one("tracker_away", rng)))
    seen = _carried(T, points[chosen])
    # Trackers are specified by the root mean square in space.
    seen += rng.normal(0.0, scene.instrument.tracker / np.sqrt(3.0), seen.shape)
    return Scan(q[rows], read, np.repeat(np.arange(len(chosen)), views)), seen


def _faced(rng: np.random.Generator, count: int, least: float) -> Array:
    """Unit vectors (count, 3), even over the part of the head that faces the arm."""
    ways = rng.normal(size=(8 * count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.asarray(ways[ways[:, 0] > least][:count])


def block(scene: Scene, rng: np.random.Generator, grid: tuple[int, int] = (5, 3)) -> Scan:
    """A scan of three faces of the block, on a grid of points each."""
    faces = _faces(rng)
    lines = [np.linspace(-0.75, 0.75, count) for count in grid]
    places = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
    q, distance, part = [], [], []
    for k, face in enumerate(faces):
        points = face.at(places * face.half)
        inward = np.tile(-face.normal, (len(points), 1))
        postures, good = aimed(scene, points, inward, 1, rng)
        origins, beams = scene.finder.beams(true_flange(scene, postures, rng))
        d, normal, met = face.hit(origins, beams)
        good &= met & scene.finder.reaches(d)
        cosine = -np.sum(normal * beams, axis=1)
        q.append(postures[good])
        distance.append(scene.finder.read(d, np.abs(cosine), rng)[good])
        part.append(np.full(int(good.sum()), k))
    return Scan(np.concatenate(q), np.concatenate(distance), np.concatenate(part))


def _faces(rng: np.random.Generator) -> list[Board]:
    """Top, front and side of the block on the table before the arm; machined, so flat."""
    turn = rotations(np.array([0.0, 0.0, RANGES.one("block_turn", rng)]))
    centre = np.array([0.42, 0.03, 0.30]) + RANGES.many("put", rng, 3)
    a, b, c = np.array(BLOCK) / 2.0
    frames = [  # x, y and outward normal of a face, its half sides, and its offset
        (np.eye(3), (a, b), c),
        (np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]).T, (b, c), a),
        (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T, (a, c), b),
    ]
    return [
        Board(centre + turn @ axes[:, 2] * out, turn @ axes, np.array(half), FLAT)
        for axes, half, out in frames
    ]


def draw_head(rng: np.random.Generator, points: int = 20_000) -> Head:
    """A head before the arm, facing it and up, and its CT."""
    face = np.array([[-0.6, 0.0, 0.8], [0.0, -1.0, 0.0], [0.8, 0.0, 0.6]]).T  # x of the head
    turn = rotations(RANGES.near("head", rng, 3)) @ face
    T = placed(turn, np.array([0.50, 0.0, 0.10]) + RANGES.many("put", rng, 3))
    T_ct = placed(rotations(RANGES.near("scanner", rng, 3)), RANGES.many("ct", rng, 3))
    ways = rng.normal(size=(points, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    surface = ways * (radius(ways) + rng.normal(0.0, CT_NOISE, points))[:, None]
    inside = rng.normal(size=(TARGETS, 3))
    inside *= RANGES.many("inside", rng, (TARGETS, 1)) / np.linalg.norm(
        inside, axis=1, keepdims=True
    )
    marks = np.array([w for _, _, w in FEATURES])
    marks /= np.linalg.norm(marks, axis=1, keepdims=True)
    return Head(
        T=T,
        T_ct=T_ct,
        surface=_carried(T_ct, surface),
        targets=_carried(T_ct, inside * SEMI_AXES),
        landmarks=marks * radius(marks)[:, None],
    )


def scan_head(
    scene: Scene, head: Head, rng: np.random.Generator, count: int = 1000, slip: float = 3e-3
) -> tuple[Scan, Array, Array]:
    """A scan of the face, so many points, and landmarks pointed at roughly for a start.

    The landmarks are in the base and in the CT frame, (6, 3) each [m]; each errs by ``slip`` [m]
    per axis, 1 sigma.
    """
    ways = _faced(rng, count, 0.15)
    local = ways * radius(ways)[:, None]
    inward = -_normals(ways) @ head.T[:3, :3].T
    beam = (scene.finder.r, scene.finder.v)
    cone = Cone(tilt=0.95 * scene.instrument.tilt)
    q, good = each_reached(scene.arm, beam, _carried(head.T, local), inward, cone, rng, rounds=3)
    q = q[good]
    origins, beams = scene.finder.beams(true_flange(scene, q, rng))
    distance, cosine, met = hit(head, origins, beams)
    good = met & scene.finder.reaches(distance) & (cosine > np.cos(1.1 * scene.instrument.tilt))
    read = scene.finder.read(distance[good], cosine[good], rng)
    seen = _carried(head.T, head.landmarks) + rng.normal(0.0, slip, head.landmarks.shape)
    scan = Scan(q[good], read, np.zeros(int(good.sum()), dtype=np.int64))
    return scan, seen, _carried(head.T_ct, head.landmarks)


def hit(head: Head, origins: Array, beams: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Where beams (N, 3) from origins (N, 3) [m] meet the head.

    Distances (N,) [m], cosines of the incidence (N,), and which met it.
    """
    R, t = head.T[:3, :3], head.T[:3, 3]
    start, way = (origins - t) @ R, beams @ R
    near = -np.sum(start * way, axis=1)
    low, high = near - 0.16, near.copy()
    met = (_outside(start + low[:, None] * way) > 0) & (_outside(start + high[:, None] * way) < 0)
    for _ in range(34):
        middle = (low + high) / 2.0
        out = _outside(start + middle[:, None] * way) > 0
        low, high = np.where(out, middle, low), np.where(out, high, middle)
    points = start + low[:, None] * way
    ways = points / np.linalg.norm(points, axis=1, keepdims=True)
    return low, -np.sum(_normals(ways) * way, axis=1), met


def radius(ways: Array) -> Array:
    """Distance (N,) [m] of the surface from the middle, along unit vectors (N, 3)."""
    found = 1.0 / np.linalg.norm(ways / SEMI_AXES, axis=1)
    for height, sharp, way in FEATURES:
        axis = np.array(way) / np.linalg.norm(way)
        found = found + height * np.exp(-sharp * (1.0 - ways @ axis))
    return np.asarray(found)


def _outside(points: Array) -> Array:
    size = np.linalg.norm(points, axis=1)
    return np.asarray(size - radius(points / size[:, None]))


def _normals(ways: Array) -> Array:
    """Outward unit normals (N, 3) of the surface along unit vectors (N, 3)."""
    points, step = ways * radius(ways)[:, None], 1e-6
    slopes = [(_outside(points + step * e) - _outside(points - step * e)) for e in np.eye(3)]
    normals = np.stack(slopes, axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _carried(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def camera_place(scene: Scene) -> Array:
    """``T_flange_camera`` (4, 4) [m]: at r, its z along v."""
    return placed(taking(np.array([[0.0, 0.0, 1.0]]), scene.finder.v[None])[0], scene.finder.r)


def target_poses(
    scene: Scene, q: Array, board: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """What encoders and camera say at postures (N, n) [rad] of a target on a board, from 1.

    ``T_base_flange`` (N, 4, 4) by the encoders, ``T_camera_target`` (N, 4, 4) as measured [m].
    """
    face = scene.boards[board - 1]
    camera = true_flange(scene, q, rng) @ camera_place(scene)
    turn, shift = (rng.normal(0.0, size, (len(q), 3)) for size in (TURN, SHIFT))
    seen = np.linalg.inv(camera) @ placed(face.axes, face.centre) @ placed(rotations(turn), shift)
    return forward(scene.arm, q)[:, -1], seen
