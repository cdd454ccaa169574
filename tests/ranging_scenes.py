"""Rooms with a range finder before boards, and their readings as the library has them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.experiments.reality.ranging.scene import (
    Instrument,
    calibration,
    draw_scene,
    marks,
    plan,
)
from plumbline.experiments.reality.recorder import Recording, numbered, write, write_table
from plumbline.experiments.reproduce.hand_eye_trials import marks_of, readings_of
from plumbline.optim.hand_eye.readings import Beam, Readings

CLEAN = Instrument(
    noise=0.0, grain=0.0, skew=0.0, repeatability=0.0, flatness=1e-12, aim=0.0, square=0.0
)
PAPER = Instrument()


@lru_cache(maxsize=8)
def planned(seed=0, angles=90.0):
    """A scene and its programme; instruments do not matter to the plan."""
    rng = np.random.default_rng(seed)
    scene = draw_scene(rng, PAPER, angles)
    return scene, plan(scene, rng)


def room_of(seed=0, instrument=PAPER, angles=90.0):
    """The planned scene with other instruments."""
    scene, _ = planned(seed, angles)
    given = instrument
    finder = replace(
        scene.finder, noise=given.noise, spot=given.spot, grain=given.grain, skew=given.skew
    )
    factor = given.flatness / PAPER.flatness
    boards = tuple(replace(b, bumps=factor * b.bumps) for b in scene.boards)
    return replace(scene, finder=finder, boards=boards, instrument=given)


@lru_cache(maxsize=16)
def surveyed(seed=0, instrument=PAPER, angles=90.0):
    """A scene, its survey and its readings."""
    scene, programme = room_of(seed, instrument, angles), planned(seed, angles)[1]
    survey = calibration(scene, np.random.default_rng([seed, 5]), programme)
    return scene, survey, readings_of(survey)


@lru_cache(maxsize=16)
def marked(seed=0, instrument=PAPER):
    """Marks in the scene."""
    return marks_of(marks(room_of(seed, instrument), np.random.default_rng([seed, 6]))[0])


def truth(scene):
    """The true beam."""
    return Beam(scene.finder.r, scene.finder.v)


def seen_from(scene, orientations, rng, noise=5e-5):
    """Readings on the boards at exact orientations (K, N, 3, 3), spots and stand-offs at random."""
    beam, parts = truth(scene), []
    for k, (board, R) in enumerate(zip(scene.boards, orientations, strict=True)):
        spots = board.at(rng.uniform(-0.1, 0.1, (len(R), 2)))
        stand = rng.uniform(0.25, 0.45, len(R))
        t = spots - np.einsum("nij,nj->ni", R, beam.r + stand[:, None] * beam.v)
        read = stand + noise * rng.normal(size=len(R))
        parts.append((R, t, read, np.full(len(R), k + 1)))
    return Readings.from_arrays(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def facing(scene, rng, lean=0.2):
    """One orientation for each board that points the beam at it, leaning a little (K, 3, 3)."""
    v = truth(scene).v
    found = [Rotation.align_vectors(-board.normal[None], v[None])[0] for board in scene.boards]
    return [(Rotation.from_rotvec(rng.normal(0.0, lean, 3)) * one).as_matrix() for one in found]


def turned(orientations, turns):
    """Orientations turned in the flange's own frame by rotation vectors (N, 3) [rad]."""
    own = Rotation.from_rotvec(turns).as_matrix()
    return [R @ own for R in orientations]


def spoilt(readings, share, rng, *, boards=False):
    """Readings of which a share lies 5 to 50 cm too far, or has the wrong board's number."""
    rows = rng.choice(len(readings), round(share * len(readings)), replace=False)
    plane, distance = readings.plane.copy(), readings.distance.copy()
    if boards:
        plane[rows] = (plane[rows] + rng.integers(0, 2, len(rows))) % 3 + 1
    else:
        distance[rows] += rng.uniform(0.05, 0.5, len(rows))
    return replace(readings, plane=plane, distance=distance), rows


def pose_lines(readings, *, scalar_first=True):
    """A table of readings by flange poses, as samples.csv has it."""
    quaternions = Rotation.from_matrix(readings.R).as_quat(scalar_first=scalar_first)
    columns = (readings.t, quaternions, readings.distance, readings.plane, readings.motion)
    rows = np.column_stack(columns)
    lines = ["px,py,pz,qw,qx,qy,qz,range,plane,motion"]
    lines += [",".join(f"{x:.9g}" for x in row) for row in rows]
    return "\n".join(lines) + "\n"


def write_block(folder, scene, scan):
    """Write a scan of a block, its faces numbered from 1."""
    return _write_scan(folder, scene, scan, {"face": np.asarray(scan.part + 1, dtype=float)})


def write_head(folder, scene, scan, head, landmarks):
    """Write a scan of a head, its surface in CT, landmarks in base and CT, and targets."""
    _write_scan(folder, scene, scan, {})
    base, ct = ("base_x", "base_y", "base_z"), ("ct_x", "ct_y", "ct_z")
    write_table(folder / "surface.csv", dict(zip("xyz", head.surface.T, strict=True)))
    marks_of_both = np.hstack(landmarks)
    write_table(folder / "landmarks.csv", dict(zip((*base, *ct), marks_of_both.T, strict=True)))
    numbers = np.arange(1.0, len(head.targets) + 1.0)
    targets = dict(zip(ct, head.targets.T, strict=True))
    write_table(folder / "targets.csv", {"label": numbers, **targets})
    return folder


def _write_scan(folder, scene, scan, more):
    columns = {**numbered("q", scan.q), "range": scan.distance, **more}
    text = f'name = "{folder.name}"\nobservation = "surface_scan"\n\n[robot]\n'
    text += f'bundled = "{scene.arm.name}"\ntip_frame = "{scene.arm.tip_frame}"\n'
    write(folder, Recording(text, columns))
    return folder
