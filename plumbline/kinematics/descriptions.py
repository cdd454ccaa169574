"""Robots of the `example-robot-data` package: the URDF files that Pinocchio's own examples use.

The package holds files and no code; it is optional (``pip install "plumbline-robotics[robots]"``,
some 430 MB with its meshes). A robot is called as its file is, without a closing ``_robot``.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from plumbline.errors import PlumblineError

PACKAGE = "example-robot-data"
EXTRA = 'pip install "plumbline-robotics[robots]"'
SUFFIX = "_robot"


def descriptions() -> dict[str, Path]:
    """URDF files by the name of their robot.

    Raises:
        PlumblineError: The package is not installed; the message names the extra that brings it.
    """
    try:
        found = distribution(PACKAGE)
    except PackageNotFoundError:
        raise PlumblineError(f"robot descriptions need {PACKAGE}: {EXTRA}") from None
    files = sorted(f for f in found.files or () if f.suffix == ".urdf")
    # A file that is called as its robot is may be an empty head beside the robot's own: the longer
    # name comes later in the order, and wins.
    return {f.stem.removesuffix(SUFFIX): Path(str(found.locate_file(f))) for f in files}
