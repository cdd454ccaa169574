r"""Fiducials as what the diagnosis reads: one touch of a marker a row, markers as its parts.

A marker may be touched more than once, with the ``time`` of each touch where that is known. Its
place in CT stands in for joint readings (:mod:`plumbline.optim.recording.stand_in`). The noise of a
touch is the robot's and the CT's together, along the robot's axes,

.. math:: \Sigma = R\, \Sigma_{CT} R^T + \Sigma_{robot}

and a marker is read in CT once: its touches share the CT's part, so that they correlate by

.. math:: c = \operatorname{tr} \Sigma_{CT} / \operatorname{tr} \Sigma

The CT's pitch is no noise but a cause of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, fault, one_line, shown
from plumbline.optim.core.quantities import counted
from plumbline.optim.recording import checks
from plumbline.optim.recording.building import held_flags
from plumbline.optim.recording.loading import open_folder
from plumbline.optim.recording.recording import Recording, hash_of
from plumbline.optim.recording.stand_in import numbered, points_robot
from plumbline.optim.recording.table import Array, Integers, Origin, Table, as_integers
from plumbline.optim.registration import constants
from plumbline.optim.registration.checks import check
from plumbline.optim.registration.fiducials import (
    KIND,
    Fiducials,
    Stated,
    load_fiducials,
    stated_of,
    touches_of,
)
from plumbline.optim.registration.markers import Markers
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class _Touches:
    """Touches of markers: their labels, places in CT and by the robot (N, 3) [m], and context."""

    labels: Sequence[str]
    ct: Array
    robot: Array
    origin: Origin = field(default_factory=Origin)
    context: dict[str, Any] = field(default_factory=dict)


def load_markers(folder: str | Path) -> Fiducials | Recording:
    """Markers as both registration and diagnosis take them; touched again, as diagnosis alone does.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened = open_folder(folder)
    opened.must_be(KIND, "markers")
    touches, _, _ = touches_of(opened.table)
    labels = [cell.strip() for cell in touches.columns["label"]]
    again = len(set(labels)) < len(labels)
    return fiducials_to_diagnose(folder) if again else load_fiducials(folder)


def fiducials_to_diagnose(source: Fiducials | str | Path) -> Recording:
    """The touches of the markers, several of each in a folder; targets take no part."""
    if isinstance(source, Fiducials):
        m = source.markers
        digest = source.sha256 or hash_of(m.ct.tobytes(), m.robot.tobytes())
        noise = source.noise if source.noise is not None and source.noise.known else None
        stated = Stated(None, None, None, None) if noise is None else Stated.of(noise)
        touches = _Touches(m.labels, m.ct, m.robot)
        found = _recording(source.name, touches, stated, digest, source.notes)
        return replace(found, unjudged=_unjudged(len(source.targets)))
    opened = open_folder(source)
    opened.must_be(KIND, "markers")
    stated, notes = stated_of(opened.settings)
    table, targets, more = touches_of(opened.table)
    context, used = _context(table)
    touches = _Touches(
        [cell.strip() for cell in table.columns["label"]],
        table.block(("ct_x", "ct_y", "ct_z")),
        table.block(("robot_x", "robot_y", "robot_z")),
        table.origin,
        context,
    )
    notes = (*notes, *more, *opened.table.unused(used))
    found = _recording(opened.name, touches, stated, opened.sha256(), notes)
    return replace(found, unjudged=_unjudged(targets))


def _unjudged(targets: int) -> str:
    """Targets, which are found by the markers: whether they themselves move nothing here tells."""
    return f"{counted(targets, 'target')}, which may move (respiration)" if targets else ""


def _recording(
    name: str, touches: _Touches, stated: Stated, digest: str, notes: tuple[str, ...]
) -> Recording:
    labels = tuple(dict.fromkeys(touches.labels))
    part = np.array([labels.index(label) + 1 for label in touches.labels], dtype=np.int64)
    if len(labels) < constants.FEWEST_DIAGNOSED:
        raise PlumblineError(
            f"{name}: {len(labels)} markers, at least {constants.FEWEST_DIAGNOSED} expected to "
            "tell a cause: three leave three distances, and any of them may be to blame; add "
            "markers, or run plumbline register FOLDER"
        )
    ct, robot = (_means(values, part) for values in (touches.ct, touches.robot))
    _same_place(touches, part, ct)
    check(Markers.of(ct, robot, None, labels))
    sigma = stated.along(rigid_match(ct, robot)[:3, :3])
    noise: dict[str, Any] = {}
    if sigma is not None:
        noise["noise_std"] = mean = float(np.sqrt(np.mean(sigma**2)))
        if np.ptp(sigma) > constants.ON_GRID * mean:
            noise["noise_shape"] = np.tile(sigma / mean, (len(part), 1))
    rig = points_robot()
    found = Recording(
        name=name,
        observation=KIND,
        robot=rig,
        chain=rig.chain(),
        tip_frame=rig.default_tip,
        q=touches.ct,
        measured=touches.robot,
        tool_offset=np.zeros(3),
        element=part,
        elements=labels,
        pitch=_pitch(ct, stated),
        stand_in=True,
        alike=stated.shared if len(labels) < len(part) else 0.0,
        always=("frame",),
        sha256=digest,
        notes=notes,
        **noise,
        **touches.context,
    )
    odd = [one_line(note) for note in checks.time_runs_forwards(found, touches.origin)]
    return replace(found, notes=(*found.notes, *numbered("markers", labels), *odd))


def _means(values: Array, part: Integers) -> Array:
    """Mean (K, 3) of the touches of each marker."""
    return np.stack([values[part == k].mean(axis=0) for k in range(1, int(part.max()) + 1)])


def _same_place(touches: _Touches, part: Integers, ct: Array) -> None:
    away = np.abs(touches.ct - ct[part - 1])
    if away.max() > constants.SAME_PLACE:
        row, axis = np.unravel_index(int(away.argmax()), away.shape)
        where = touches.origin.at(f"ct_{'xyz'[int(axis)]}", row)
        found = f"another place in CT of marker {shown(touches.labels[int(row)])}"
        mend = "give all touches of a marker its one place in CT"
        raise fault(where, found, "the same in all its rows", mend)


def _context(table: Table) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Time, group and held-out rows where they are there, and all columns that are read."""
    told: dict[str, Any] = {}
    if "time" in table:
        told["time"] = table.numbers("time")
    for name in [name for name in ("group", "held_out") if name in table]:
        told[name] = as_integers(table.numbers(name), name, table.origin)
    if "held_out" in told:
        held = held_flags(told["held_out"], len(table), table.origin)
        told["held_out"] = held if held is not None and held.any() else None
    points = [f"{frame}_{axis}" for frame in ("ct", "robot") for axis in "xyz"]
    return told, ("label", "role", *points, *told)


def _pitch(ct: Array, stated: Stated) -> Array:
    """Pitch (3,) of CT [m]: as stated, else of the grid that the coordinates lie on, else 0."""
    if stated.resolution is not None:
        return stated.resolution
    return np.array([_grid(values) for values in ct.T])


def _grid(values: Array) -> float:
    """The largest step that all differences are multiples of [m]; 0 where it is below any CT's."""
    steps = np.unique([abs(a - b) for a, b in combinations(values.tolist(), 2)])
    steps = steps[steps > constants.ON_GRID]
    if not len(steps):
        return 0.0
    for parts in range(1, int(steps[0] / constants.FINEST_GRID) + 1):
        h = float(steps[0]) / parts
        for step in steps.tolist():  # the longer, the better it tells the pitch
            count = round(step / h)
            if abs(step - count * h) > constants.ON_GRID:
                break
            h = step / count
        else:
            return h
    return 0.0
