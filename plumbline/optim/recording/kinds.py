"""The kinds of observation: what a row measured, in which columns, and how much it determines.

A row of m equations against u unknowns that every model fits (device frame 6, tool 3 or 6, each
socket 3): a recording of N rows says something about the robot only if N m > u.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

POSITIONS = ("tip_position", "pose", "fixed_point")  # that say where the tip is
ALWAYS = ("frame", "tool")  # what every model fits unless [fit] always says otherwise


@dataclass(frozen=True)
class Kind:
    """One kind of observation that ``diagnose`` reads."""

    columns: tuple[str, ...]  # names of the measured columns; empty where they depend on the robot
    # scalar equations a row; 0 stands for one a measured joint, whose encoder's zero is as many
    # unknowns
    equations: int
    frame: int  # unknowns of the device's frame
    tool: int  # unknowns of the tool
    unit: str  # unit of the measured columns, of the first three for a pose

    def unknowns(self, always: Sequence[str], sockets: int) -> int:
        """Unknowns that every model fits."""
        fitted = self.frame * ("frame" in always) + self.tool * ("tool" in always)
        return fitted + 3 * sockets


KINDS: Mapping[str, Kind] = {
    "tip_position": Kind(("x", "y", "z"), 3, 6, 3, "m"),
    "pose": Kind(("x", "y", "z", "qw", "qx", "qy", "qz"), 6, 6, 6, "m"),
    "fixed_point": Kind((), 3, 0, 3, "m"),
    "joint_position": Kind((), 0, 0, 0, "rad"),
    "joint_torque": Kind((), 0, 0, 0, "N m"),
}


@dataclass(frozen=True)
class Elsewhere:
    """A kind of observation that another command reads."""

    columns: tuple[str, ...]  # columns it must have
    prefixes: tuple[str, ...]  # numbered columns of which it must have one
    command: str  # the command for it


FIDUCIALS = ("label", "role", "ct_x", "ct_y", "ct_z", "robot_x", "robot_y", "robot_z")

ELSEWHERE: Mapping[str, Elsewhere] = {
    "plane_range": Elsewhere(
        ("range", "plane", "motion"), (), "plumbline handeye FOLDER, plumbline diagnose FOLDER"
    ),
    "surface_scan": Elsewhere(("range",), (), "plumbline scan FOLDER --beam HANDEYE.json"),
    "fiducials": Elsewhere(FIDUCIALS, (), "plumbline register FOLDER, plumbline diagnose FOLDER"),
    "motion": Elsewhere(("time",), ("u", "q"), "plumbline diagnose FOLDER"),
    "tracking": Elsewhere(("time",), ("u", "x"), "plumbline diagnose FOLDER"),
}
