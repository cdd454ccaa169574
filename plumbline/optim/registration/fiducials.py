r"""A recording of fiducials: markers and targets, each in CT and in the robot's frame.

``samples.csv`` has the columns ``label, role, ct_x, ct_y, ct_z, robot_x, robot_y, robot_z`` [m];
the role is ``marker`` or ``target``, and a target that no one could touch leaves the robot's three
cells empty. ``dataset.toml`` says ``observation = "fiducials"`` and may say how well points were
read:

.. code-block:: toml

    [noise]
    ct_resolution = [0.005, 0.001, 0.001]  # pitch [m]; its std is pitch / sqrt(12), or: ct_std
    robot_std = 0.0003                     # one number or one an axis [m]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import best_matches, fault, shown
from plumbline.optim.recording.columns import elsewhere_columns
from plumbline.optim.recording.kinds import FIDUCIALS
from plumbline.optim.recording.loading import PROVENANCE, open_folder
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Array, Table, read_table
from plumbline.optim.registration.constants import COARSEST, FEWEST, LARGEST
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.target import point_of

if TYPE_CHECKING:
    import pandas as pd

KIND = "fiducials"
ROLES = ("marker", "target")
CT, ROBOT = FIDUCIALS[2:5], FIDUCIALS[5:8]
NOISE = ("ct_resolution", "ct_std", "robot_std")

KNOWN = ("name", "observation", "noise", "noise_std", "robot", "tool", "fit", *NOISE, *PROVENANCE)


@dataclass(frozen=True, eq=False)
class Points:
    """Named points in both frames."""

    labels: tuple[str, ...]  # their names (n)
    ct: Array  # in CT (n, 3) [m]
    robot: Array  # in the robot's frame (n, 3) [m]; nan where not measured

    def __len__(self) -> int:
        return len(self.labels)


@dataclass(frozen=True, eq=False)
class Fiducials:
    """A recording of fiducials."""

    name: str  # what the recording is called
    markers: Points  # what is registered, n >= 3
    targets: Points  # what is to be found; may be none
    noise: MarkerNoise | None = None  # how well markers were read; None where nothing was stated
    sha256: str = ""  # hash of the files; empty where there are none
    notes: tuple[str, ...] = ()  # what is odd about the files, one line each

    def checked(self) -> Markers:
        """The markers with their noise, refused where no method can register them."""
        return Markers.of(self.markers.ct, self.markers.robot, self.noise, self.markers.labels)

    @classmethod
    def from_table(
        cls, table: pd.DataFrame, *, name: str = "fiducials", noise: MarkerNoise | None = None
    ) -> Fiducials:
        """From a table with the columns of ``samples.csv`` [m], refused where one is missing."""
        text = table.to_csv(index=False, na_rep="").encode()
        markers, targets, notes = _points(read_table("table", text))
        return cls(name, markers, targets, noise, notes=notes)

    def table(self) -> pd.DataFrame:
        """The columns of ``samples.csv`` [m], markers first."""
        import pandas as pd

        parts = []
        for role, points in zip(ROLES, (self.markers, self.targets), strict=True):
            columns: dict[str, object] = {"label": list(points.labels), "role": role}
            columns |= {c: points.ct[:, k] for k, c in enumerate(CT)}
            columns |= {c: points.robot[:, k] for k, c in enumerate(ROBOT)}
            parts.append(pd.DataFrame(columns, columns=list(FIDUCIALS)))
        return pd.concat([part for part in parts if len(part)], ignore_index=True)


def load_fiducials(folder: str | Path) -> Fiducials:
    """Read and check a recording folder of fiducials; it is never written to.

    Raises:
        PlumblineError: It cannot be used; one line says where, why and how to mend it.
    """
    opened = open_folder(folder)
    opened.must_be(KIND, "markers")
    noise, notes = _noise(opened.settings)
    markers, targets, more = _points(opened.table)
    return Fiducials(opened.name, markers, targets, noise, opened.sha256(), (*notes, *more))


def build_fiducials(
    ct: ArrayLike,
    robot: ArrayLike,
    *,
    noise: MarkerNoise | None = None,
    labels: Sequence[str] | None = None,
    targets: Mapping[str, ArrayLike] | None = None,
    name: str = "fiducials",
) -> Fiducials:
    """A recording from arrays.

    Args:
        ct: Markers in CT (n, 3) [m].
        robot: The same by the robot, in the same order (n, 3) [m].
        noise: How well they were read; estimated from what a fit leaves over if not given.
        labels: Their names (n); M1, M2, ... if not given.
        targets: What is to be found: name and place in CT (3,) [m].
        name: What the recording is called.

    Raises:
        PlumblineError: Wrong shapes, too few markers, no finite numbers, no metres, doubled labels,
            or covariances that are none.
    """
    markers = Markers.of(ct, robot, noise, labels)
    given = {} if targets is None else targets
    doubled = [label for label in given if label in markers.labels]
    if doubled:
        where = f"target {doubled[0]}"
        raise fault(where, "a marker's label", "every label once", "rename one")
    places = [point_of(place, f"target {label}") for label, place in given.items()]
    there = np.reshape(places, (-1, 3))
    return Fiducials(
        name=name,
        markers=Points(markers.labels, markers.ct, markers.robot),
        targets=Points(tuple(given), there, np.full(there.shape, np.nan)),
        noise=noise,
    )


@dataclass(frozen=True, eq=False)
class Stated:
    """What is stated of the readings, each one number an axis (3,) [m] or None."""

    resolution: Array | None  # CT's pitch
    ct: Array | None  # standard deviation in CT, along its axes
    robot: Array | None  # standard deviation by the robot, along its axes
    both: Array | None  # of both together, along the robot's axes, where that was stated as one

    @classmethod
    def of(cls, noise: MarkerNoise) -> Stated:
        """What a noise of all markers says along the axes; nothing of one that differs."""
        if noise.ct.ndim != 2 or noise.robot.ndim != 2:
            return cls(None, None, None, None)
        return cls(None, np.sqrt(np.diag(noise.ct)), np.sqrt(np.diag(noise.robot)), None)

    def along(self, R: Array) -> Array | None:
        """1 sigma (3,) [m] of a touch along the robot's axes; the pitch is none."""
        if self.both is not None or self.robot is None:
            return self.both
        ct = np.zeros(3) if self.ct is None else self.ct
        return np.asarray(np.sqrt(R**2 @ ct**2 + self.robot**2))

    @property
    def shared(self) -> float:
        """Correlation of two touches of one marker: it is read in CT once."""
        if self.both is not None or self.robot is None or self.ct is None:
            return 0.0
        return float(self.ct @ self.ct / (self.ct @ self.ct + self.robot @ self.robot))


def stated_of(settings: Section) -> tuple[Stated, tuple[str, ...]]:
    """What is stated of the readings, in ``[noise]`` or at the top, and notes on unused keys."""
    _, std, notes = _noise_keys(settings)
    both = _std(settings, "noise_std")
    return Stated(std["ct_resolution"], std["ct_std"], std["robot_std"], both), notes


def _noise_keys(
    settings: Section,
) -> tuple[dict[str, Section], dict[str, Array | None], tuple[str, ...]]:
    """Where each key of a noise stands, what it says, and notes on keys that nothing reads."""
    table = settings.section("noise")
    homes = {key: table if key in table.values else settings for key in NOISE}
    std = {key: _std(homes[key], key) for key in NOISE}
    return homes, std, (*settings.unused(KNOWN), *table.unused(NOISE))


def _noise(settings: Section) -> tuple[MarkerNoise | None, tuple[str, ...]]:
    """The markers' noise, and notes on what is not used."""
    homes, std, notes = _noise_keys(settings)
    if std["ct_std"] is not None and std["ct_resolution"] is not None:
        raise homes["ct_std"].fault("ct_std", "ct_std or ct_resolution", "leave one of them out")
    both = _std(settings, "noise_std")
    resolution, robot = std["ct_resolution"], std["robot_std"]
    ct = std["ct_std"] if resolution is None else resolution / np.sqrt(12.0)
    if both is not None and ct is None and robot is None:
        # How much of it is CT's is not known: all of it, so that a target's reading is not praised.
        largest = float(both.max())
        said = f"noise_std: taken for CT's, {1e3 * largest:.3g} mm along every axis, robot exact"
        return MarkerNoise.from_std(largest), (*notes, said)
    if ct is None:
        said = (
            f"{homes['robot_std'].where('robot_std')}: not used without ct_resolution: state both"
        )
        return None, notes if robot is None else (*notes, said)
    stated = MarkerNoise.from_std(ct, 0.0 if robot is None else robot)
    if np.linalg.eigvalsh(stated.ct)[0] + np.linalg.eigvalsh(stated.robot)[0] <= 0.0:
        spoken = [key for key in ("robot_std", "ct_resolution", "ct_std") if std[key] is not None]
        mend = "write robot_std, too: no reading is exact"
        raise homes[spoken[0]].fault(spoken[0], "some noise along every axis", mend)
    return stated, notes


def _std(section: Section, key: str) -> Array | None:
    """One number or three, not negative and in m."""
    value = section.values.get(key)
    if value is None:
        return None
    given = section.vector(key) if isinstance(value, list) else section.number(key)
    numbers = np.broadcast_to(np.asarray(given, dtype=float), 3)
    if numbers.min() < 0.0:
        raise section.fault(key, "no negative number", "mend it")
    if numbers.max() > COARSEST:
        raise section.fault(key, f"at most {COARSEST:g} m", "looks like mm: divide by 1000")
    return numbers


def touches_of(table: Table) -> tuple[Table, int, tuple[str, ...]]:
    """The rows of markers, each of which may have several, how many are targets, and notes."""
    _, roles = _words(table, once=False)
    rows = [k for k, role in enumerate(roles) if role == "marker"]
    markers = _rows(table, rows)
    for columns in (CT, ROBOT):
        _check_metres(markers, columns, markers.block(columns))
    return markers, len(roles) - len(rows), (*table.notes, *_nearly_the_same(table))


def _points(table: Table) -> tuple[Points, Points, tuple[str, ...]]:
    """Markers, targets and notes."""
    labels, roles = _words(table, once=True)
    rows = [[k for k, r in enumerate(roles) if r == role] for role in ROLES]
    markers = _select(table, labels, rows[0], ROLES[0])
    targets = _select(table, labels, rows[1], ROLES[1], markers if len(markers) else None)
    if len(markers) < FEWEST:
        found = f"{len(markers)} rows of role marker"
        mend = "give three markers that are not on one line, or more"
        raise fault(f"{table.origin.file}, column 'role'", found, f"at least {FEWEST}", mend)
    notes = (*table.notes, *table.unused(FIDUCIALS), *_nearly_the_same(table))
    return markers, targets, notes


def _nearly_the_same(table: Table) -> Iterator[str]:
    """A note on labels of different points that a hand that typed them may have meant as one."""
    labels = dict.fromkeys(cell.strip() for cell in table.columns["label"])
    alike: dict[str, list[str]] = {}
    for label in labels:
        alike.setdefault("".join(label.casefold().split()), []).append(shown(label))
    for one in alike.values():
        if len(one) > 1:
            said = f"{' and '.join(one)} differ by case or blanks alone and are points of their own"
            yield f"{table.origin.file}, column 'label': {said}: rename them if they are one"


def _words(table: Table, *, once: bool) -> tuple[list[str], list[str]]:
    """Labels, each of them once if that is asked, and roles."""
    elsewhere_columns(table, KIND)
    labels = [cell.strip() for cell in table.columns["label"]]
    roles = [cell.strip().lower() for cell in table.columns["role"]]
    seen: set[str] = set()
    for k, (label, role) in enumerate(zip(labels, roles, strict=True)):
        if not label:
            raise fault(table.origin.at("label", k), "an empty cell", "a name", "name the point")
        if label in seen and once:
            where = table.origin.at("label", k)
            mend = "rename one or delete the row; plumbline diagnose reads repeated touches"
            raise fault(where, f"{shown(label)} again", "every label once", mend)
        seen.add(label)
        if role not in ROLES:
            found, near = shown(table.columns["role"][k]), best_matches(role, ROLES)
            raise fault(table.origin.at("role", k), found, " or ".join(ROLES), f"nearest: {near}")
    return labels, roles


def _select(
    table: Table,
    labels: Sequence[str],
    rows: Sequence[int],
    role: str,
    about: Points | None = None,
) -> Points:
    """The points of one role, in m, none of them far from the points about which they are."""
    part = _rows(table, rows)
    ct, robot = part.block(CT), _measured(part, role)
    _check_metres(part, CT, ct, None if about is None else about.ct)
    _check_metres(part, ROBOT, robot, None if about is None else about.robot)
    return Points(tuple(labels[k] for k in rows), ct, robot)


def _measured(table: Table, role: str) -> Array:
    """Places by the robot (n, 3); a target that none were measured of has nan."""
    empty = [all(not table.columns[c][k].strip() for c in ROBOT) for k in range(len(table))]
    if role == "marker" or not any(empty):
        return table.block(ROBOT)
    robot = np.full((len(table), 3), np.nan)
    there = [k for k, blank in enumerate(empty) if not blank]
    if there:
        robot[there] = _rows(table, there).block(ROBOT)
    return robot


def _rows(table: Table, rows: Sequence[int]) -> Table:
    """Some rows of a table, with their places in the file."""
    lines = None if table.origin.lines is None else table.origin.lines[list(rows)]
    columns: Mapping[str, Sequence[str]] = {
        name: [cells[k] for k in rows] for name, cells in table.columns.items()
    }
    return Table(replace(table.origin, lines=lines), columns)


def _check_metres(
    table: Table, columns: Sequence[str], values: ArrayLike, others: ArrayLike | None = None
) -> None:
    """Refuse the place that is farthest from the middle of all, or of others, if it is too far."""
    points = np.asarray(values, dtype=float)
    middle = np.asarray(points if others is None else others, dtype=float)
    away = np.abs(points - np.nanmedian(middle, axis=0)) if np.isfinite(points).any() else points
    away = np.nan_to_num(away)
    if len(away) and away.max() > LARGEST:
        row, axis = np.unravel_index(int(away.argmax()), away.shape)
        found = f"{points[row, axis]:.6g}, {away[row, axis]:.4g} m from the others"
        mend = "looks like mm: divide by 1000"
        raise fault(table.origin.at(columns[int(axis)], row), found, f"at most {LARGEST:g} m", mend)
