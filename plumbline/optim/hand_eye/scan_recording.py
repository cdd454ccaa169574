r"""Recordings of a scan (``observation = "surface_scan"``): a block's faces, a surface of CT.

``samples.csv`` has ``range`` [m] and the flange as :mod:`.recording` says. A column ``face``
(numbers or words) says which face of a block each reading lies on. The folder may hold, all in CT
coordinates [m]: ``surface.csv`` (``x,y,z``, points close together) or ``surface.stl``;
``landmarks.csv`` (``base_x,base_y,base_z,ct_x,ct_y,ct_z``, for a start); ``targets.csv``
(``label,ct_x,ct_y,ct_z``). The beam stands in ``[beam]`` of ``dataset.toml`` (``r`` [m], ``v``, and
if known ``r_std`` [m], ``v_std``), or in the JSON of ``plumbline handeye``. A triangle a, b, c of
an STL file gives points even over its area (Osada et al. 2002),

.. math:: p = (1 - \sqrt{u})\, a + \sqrt{u} (1 - w)\, b + \sqrt{u}\, w\, c, \qquad u, w \sim U(0, 1)
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plumbline.errors import fault
from plumbline.kinematics.constants import LARGEST_FILE
from plumbline.kinematics.files import read_file
from plumbline.optim.hand_eye.constants import (
    LARGEST_SURFACE,
    LEAST_FACE,
    LEAST_LANDMARKS,
    LEAST_SURFACE,
    LONGEST,
    SURFACE_POINTS,
)
from plumbline.optim.hand_eye.readings import Beam
from plumbline.optim.hand_eye.recording import labelled, open_ranges
from plumbline.optim.recording.loading import read_bytes
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Array, Integers, Table, read_table
from plumbline.optim.triangles import triangles_of


def surface_points(place: Path, metres: float) -> Array | None:
    """Points (M, 3) [m] of the surface in a folder, in units of so many metres; None if none."""
    csv, stl = "surface.csv", "surface.stl"
    if (place / csv).exists():
        name, table = csv, read_table(csv, read_bytes(place, csv))
        table.require(("x", "y", "z"))
        points = table.block(("x", "y", "z"))
    elif (place / stl).exists():
        corners, faces = triangles_of(place / stl, LARGEST_FILE)
        name, points = stl, sampled(corners[faces])
    else:
        return None
    points = points * metres
    if len(points) < LEAST_SURFACE:
        raise fault(name, f"{len(points)} points", f"{LEAST_SURFACE} or more", "give the surface")
    size = float(np.ptp(points, axis=0).max())
    if size > LARGEST_SURFACE:
        mend = 'looks like millimetres: write surface_unit = "mm" in dataset.toml'
        raise fault(name, f"a surface of {size:.4g} m", f"at most {LARGEST_SURFACE:g} m", mend)
    return points


def sampled(corners: Array) -> Array:
    """Points (`SURFACE_POINTS`, 3) even over triangles (T, 3, 3), the same in every run."""
    a, b, c = np.swapaxes(corners, 0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not area.sum() > 0.0:
        raise fault("surface.stl", "triangles without area", "a surface", "write it again")
    rng = np.random.default_rng(0)
    k = rng.choice(len(area), SURFACE_POINTS, p=area / area.sum())
    u, w = np.sqrt(rng.uniform(size=(SURFACE_POINTS, 1))), rng.uniform(size=(SURFACE_POINTS, 1))
    return np.asarray((1.0 - u) * a[k] + u * (1.0 - w) * b[k] + u * w * c[k])


OBSERVATION = "surface_scan"
BASE, CT = ("base_x", "base_y", "base_z"), ("ct_x", "ct_y", "ct_z")
UNITS = {"m": 1.0, "mm": 1e-3}
KEYS = ("name", "observation", "noise_std", "surface_unit", "description", "source", "licence")
TABLES = ("robot", "beam")


@dataclass(frozen=True, eq=False)
class ScanRecording:
    """A scan, and what it is laid on."""

    name: str  # what it is called
    R: Array  # orientations of the flange (N, 3, 3)
    t: Array  # its positions (N, 3) [m]
    distance: Array  # ranges (N,) [m]
    face: Integers | None  # which face each reading lies on (N,); None without faces
    labels: tuple[str, ...]  # what the faces are called, in their order
    beam: Beam | None  # the beam; None where it must be given
    covariance: Array  # of its (r [m], v), (6, 6)
    surface: Array | None  # points of the surface (M, 3) in CT [m]; None without one
    # the same points in the base frame and in CT (k, 3) [m]; None without
    landmarks: tuple[Array, Array] | None
    targets: Array  # points (j, 3) in CT [m]
    target_labels: tuple[str, ...]  # their names
    sha256: str  # hash of the files' bytes
    notes: tuple[str, ...]  # what is odd but no fault

    def __len__(self) -> int:
        return len(self.distance)


def load_scan(folder: str | Path) -> ScanRecording:
    """Read and check a recording of a scan, refused if it cannot be used."""
    opened, flange, distance = open_ranges(folder, OBSERVATION, "scan")
    place, settings, table = opened.place, opened.settings, opened.table
    face, labels = _faces(table)
    beam, covariance = _beam(settings.section("beam"))
    unit = settings.word("surface_unit") or "m"
    if unit not in UNITS:
        raise settings.fault("surface_unit", "m or mm", 'write surface_unit = "mm"')
    surface = surface_points(place, UNITS[unit])
    if face is None and surface is None:
        mend = "add a column face for a block, or surface.csv or surface.stl for a surface"
        raise fault(str(place.name), "neither faces nor a surface", "one of them", mend)
    landmarks, (targets, names) = _landmarks(place), _targets(place)
    return ScanRecording(
        name=opened.name,
        R=flange.T[:, :3, :3], t=flange.T[:, :3, 3], distance=distance, face=face, labels=labels,
        beam=beam, covariance=covariance, surface=surface, landmarks=landmarks, targets=targets,
        target_labels=names, sha256=opened.sha256(flange.data),
        notes=(*settings.unused((*KEYS, *TABLES)), *table.notes,
               *table.unused(("range", "face", "time", *flange.used))),
    )  # fmt: skip


def beam_from_json(path: str | Path) -> tuple[Beam, Array]:
    """The beam of an answer of ``plumbline handeye --json``, and its covariance (6, 6)."""
    try:
        content = json.loads(read_file(path).decode("utf-8"))
        r, v = (np.array(content[key]["value"], dtype=float) for key in ("r", "v"))
        covariance = np.array(content["covariance"], dtype=float)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        r, v, covariance = np.zeros(0), np.zeros(0), np.zeros(0)
    whole = r.shape == v.shape == (3,) and covariance.shape == (6, 6)
    if not (whole and np.isfinite(covariance).all() and np.linalg.norm(v) > 0.0):
        mend = "write it by: plumbline handeye FOLDER --json OUT"
        raise fault(str(path), "no calibration", "r, v and covariance", mend)
    return Beam.of(r, v), covariance


def _faces(table: Table) -> tuple[Integers | None, tuple[str, ...]]:
    if "face" not in table:
        return None, ()
    face, words = labelled(table, "face")
    numbers, counts = np.unique(face, return_counts=True)
    few = int(np.argmin(counts))
    if len(numbers) < 2 or counts[few] < LEAST_FACE:
        found = f"{counts[few]} readings on face {numbers[few]} of {len(numbers)}"
        mend = "take more readings, on more faces"
        expected = f"two faces or more of {LEAST_FACE} readings or more"
        raise fault(table.origin.at("face"), found, expected, mend)
    return face, tuple(words) or tuple(str(k) for k in numbers)


def _beam(section: Section) -> tuple[Beam | None, Array]:
    r, v = section.vector("r"), section.vector("v")
    if r is None and v is None:
        return None, np.zeros((6, 6))
    for key, value in (("r", r), ("v", v)):
        if value is None or (key == "v" and not np.linalg.norm(value) > 0.0):
            raise section.fault(key, "three numbers", "write r [m] and v, the beam's direction")
    assert r is not None
    assert v is not None
    if np.linalg.norm(r) > LONGEST:
        raise section.fault("r", f"at most {LONGEST:g} m", "looks like millimetres")
    given = (section.vector("r_std"), section.vector("v_std"))
    stds = [np.zeros(3) if std is None else std for std in given]
    return Beam.of(r, v), np.diag(np.concatenate(stds) ** 2)


def _landmarks(place: Path) -> tuple[Array, Array] | None:
    name = "landmarks.csv"
    if not (place / name).exists():
        return None
    table = read_table(name, read_bytes(place, name))
    table.require((*BASE, *CT))
    if len(table) < LEAST_LANDMARKS:
        found, mend = f"{len(table)} landmarks", "add others, not on one line"
        raise fault(name, found, f"{LEAST_LANDMARKS} or more", mend)
    return table.block(BASE), table.block(CT)


def _targets(place: Path) -> tuple[Array, tuple[str, ...]]:
    name = "targets.csv"
    if not (place / name).exists():
        return np.empty((0, 3)), ()
    table = read_table(name, read_bytes(place, name))
    table.require(("label", *CT))
    return table.block(CT), tuple(table.columns["label"])
