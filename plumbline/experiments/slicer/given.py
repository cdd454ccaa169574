"""What was given on the command line: a recording, lists of points, transforms; by their endings.

Two lists are CT's points and the robot's, in that order, matched by their labels; what the robot
did not touch is a target. A recording and one list: the list's points are further targets. A
transform is one that was found elsewhere, to be judged by the same markers.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.errors import fault
from plumbline.experiments.slicer.points import READERS, read_points, to_fiducials
from plumbline.experiments.slicer.tfm import along, read_h5, read_tfm
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.fiducials import Fiducials, Points, load_fiducials

TRANSFORMS = {".tfm": read_tfm, ".txt": read_tfm, ".h5": read_h5, ".hdf5": read_h5}
BETTER = 3.0  # times: the inverse fits so much better that it is what was meant


@dataclass(frozen=True, eq=False)
class Transformed:
    """A transform found elsewhere."""

    name: str  # its file
    T_RC: Array  # from CT to robot (4, 4) [m]
    inverted: bool  # whether the file's own direction is the other one


def given(
    paths: Sequence[Path], ct_axes: str = "LPS", robot_axes: str = "LPS"
) -> tuple[Fiducials, tuple[Transformed, ...]]:
    """The recording that some paths make, refused if none, and the transforms among them."""
    transforms = [path for path in paths if _ends(path, TRANSFORMS)]
    lists = [path for path in paths if _ends(path, READERS)]
    folders = [path for path in paths if path not in transforms and path not in lists]
    if len(folders) == 1 and len(lists) <= 1:
        fiducials = load_fiducials(folders[0])
        if lists:
            fiducials = _with_targets(fiducials, lists[0], read_points(lists[0], ct_axes))
    elif not folders and len(lists) == 2:
        fiducials = _of_lists(lists[0], lists[1], ct_axes, robot_axes)
    else:
        found = ", ".join(path.name for path in paths)
        expected = "one recording, or two lists of points: CT's, then the robot's"
        mend = "give both lists (.mrk.json or .fcsv), or the folder"
        raise fault("files", found, expected, mend)
    found_elsewhere = (_transformed(path, fiducials, ct_axes, robot_axes) for path in transforms)
    return fiducials, tuple(found_elsewhere)


def _ends(path: Path, endings: Iterable[str]) -> bool:
    return path.name.lower().endswith(tuple(endings)) and not path.is_dir()


def _of_lists(ct: Path, robot: Path, ct_axes: str, robot_axes: str) -> Fiducials:
    name = ct.name.split(".")[0] or ct.name
    points = [read_points(ct, ct_axes), read_points(robot, robot_axes)]
    for path, table in zip((ct, robot), points, strict=True):
        doubled = table["label"][table["label"].duplicated()]
        if len(doubled):
            found, mend = f"{doubled.iloc[0]!r} twice", "rename one in Slicer"
            raise fault(f"{path.name}, label", found, "every label once", mend)
    recording = to_fiducials(*points, name=name)
    note = (
        f"{robot.name}: the robot's points are read along {robot_axes}; if their numbers were "
        "typed into Slicer's table, which shows RAS, say --robot-axes RAS"
    )
    return replace(recording, notes=(*recording.notes, note))


def _with_targets(fiducials: Fiducials, path: Path, table: pd.DataFrame) -> Fiducials:
    """More targets, under new names."""
    known = (*fiducials.markers.labels, *fiducials.targets.labels)
    labels = tuple(str(label) for label in table["label"])
    for k, label in enumerate(labels):
        if label in known or label in labels[:k]:
            mend = "rename it in Slicer, or delete it there"
            raise fault(f"{path.name}, point {label}", "that label again", "a new one", mend)
    old, places = fiducials.targets, table[["x", "y", "z"]].to_numpy(dtype=float)
    nowhere = np.full(places.shape, np.nan)
    targets = Points(
        (*old.labels, *labels), np.vstack([old.ct, places]), np.vstack([old.robot, nowhere])
    )
    return replace(fiducials, targets=targets)


def _transformed(path: Path, fiducials: Fiducials, ct_axes: str, robot_axes: str) -> Transformed:
    """A file's transform, or its inverse where that is what fits the markers."""
    ending = next(e for e in TRANSFORMS if path.name.lower().endswith(e))
    read = TRANSFORMS[ending](path, "LPS")
    T, back = (along(one, ct_axes, robot_axes) for one in (read, np.linalg.inv(read)))
    inverted = BETTER * _misfit(back, fiducials.markers) < _misfit(T, fiducials.markers)
    return Transformed(path.name, back if inverted else T, inverted)


def _misfit(T: Array, markers: Points) -> float:
    left = markers.ct @ T[:3, :3].T + T[:3, 3] - markers.robot
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
