"""The kinds of observation: what a row measured, in which columns, and how much it determines.

A row of m equations against u unknowns that every model fits (device frame 6, tool 3 or 6, each
socket 3): a recording of N rows says something about the robot only if N m > u.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

ALWAYS = ("frame", "tool")  # what every model fits unless [fit] always says otherwise


@dataclass(frozen=True)
class Kind:
    """One kind of observation: all that the diagnosis asks of it."""

    columns: tuple[str, ...]  # names of the measured columns; empty where they depend on the robot
    # scalar equations a row; 0 stands for one a measured joint, whose encoder's zero is as many
    # unknowns
    equations: int
    frame: int  # unknowns of the device's frame
    tool: int  # unknowns of the tool
    unit: str  # unit of the measured columns, of the first three for a pose
    places: bool = False  # whether rows say where the tip is
    device: bool = False  # whether they do so in the frame of a measuring device
    oriented: bool = False  # whether they also say how the tip is turned
    sockets: bool = False  # whether the tip rested in sockets
    encoders: bool = False  # whether second encoders were read
    efforts: bool = False  # whether the drives' efforts were
    ranges: bool = False  # whether a beam met planes
    fiducials: bool = False  # whether markers of a CT were touched

    @property
    def joints(self) -> bool:
        """Whether joints were measured, not the tip."""
        return self.encoders or self.efforts

    def unknowns(self, always: Sequence[str], sockets: int) -> int:
        """Unknowns that every model fits."""
        fitted = self.frame * ("frame" in always) + self.tool * ("tool" in always)
        return fitted + 3 * sockets


# Those whose folders ``diagnose`` reads itself.
KINDS: Mapping[str, Kind] = {
    "tip_position": Kind(("x", "y", "z"), 3, 6, 3, "m", places=True, device=True),
    "pose": Kind(
        ("x", "y", "z", "qw", "qx", "qy", "qz"), 6, 6, 6, "m",
        places=True, device=True, oriented=True,
    ),
    "fixed_point": Kind((), 3, 0, 3, "m", places=True, sockets=True),
    "joint_position": Kind((), 0, 0, 0, "rad", encoders=True),
    "joint_torque": Kind((), 0, 0, 0, "N m", efforts=True),
}  # fmt: skip
EFFORTS = "joint_torque"
PLACES = tuple(name for name in KINDS if name != EFFORTS)  # that one fit can hold together
MIXED = "several"  # what rows of several of them are
ROWS: Mapping[str, Kind] = {
    **KINDS,
    "plane_range": Kind(("range",), 1, 0, 0, "m", ranges=True),
    "fiducials": Kind((), 3, 0, 0, "m", fiducials=True),
    MIXED: Kind((), 0, 0, 0, "m"),
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
