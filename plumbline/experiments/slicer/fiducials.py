"""Points of either Slicer format by the file's name, and two lists as a recording of fiducials."""

from pathlib import Path

import pandas as pd

from plumbline.experiments.slicer.fcsv import read_fcsv
from plumbline.experiments.slicer.markups import read_markups
from plumbline.experiments.slicer.points import refusal
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.markers import MarkerNoise

READERS = {".mrk.json": read_markups, ".json": read_markups, ".fcsv": read_fcsv}


def read_points(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """Points of a ``.mrk.json`` or ``.fcsv`` [m], columns label, x, y, z, description.

    Raises:
        PlumblineError: The file is neither, or cannot be used.
    """
    return READERS[_ending(path)](path, axes)


def _ending(path: str | Path) -> str:
    name = Path(path).name.lower()
    for ending in READERS:
        if name.endswith(ending):
            return ending
    raise refusal(Path(path).name, "another kind of file", ".mrk.json or .fcsv", "save it as one")


def to_fiducials(
    ct: pd.DataFrame,
    robot: pd.DataFrame,
    *,
    name: str = "fiducials",
    noise: MarkerNoise | None = None,
) -> Fiducials:
    """A recording from points in CT and points by the robot, matched by their labels.

    What the robot did not measure is a target.

    Args:
        ct: Points in CT, columns label, x, y, z [m].
        robot: Points by the robot, the same columns [m]; every label must be one of CT's.
        name: What the recording is called.
        noise: How well they were read.

    Raises:
        PlumblineError: The robot measured a point that is not in CT.
        PlumblineError: There are too few markers, or doubled labels.
    """
    stray = [label for label in robot["label"] if label not in set(ct["label"])]
    if stray:
        known = ", ".join(map(str, ct["label"]))
        raise refusal(f"point {stray[0]}", "no such label in CT", f"one of {known}", "rename it")
    both = ct.merge(robot, on="label", how="left", suffixes=("_ct", "_robot"))
    columns = {f"ct_{a}": both[f"{a}_ct"] for a in "xyz"}
    columns |= {f"robot_{a}": both[f"{a}_robot"] for a in "xyz"}
    measured = both[[f"{a}_robot" for a in "xyz"]].notna().all(axis=1)
    role = measured.map({True: "marker", False: "target"})
    table = pd.DataFrame({"label": both["label"], "role": role, **columns})
    return Fiducials.from_table(table, name=name, noise=noise)
