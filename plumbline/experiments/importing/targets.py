"""The columns that a recording knows, what each measures, and which kind of recording they make."""

import re
from collections.abc import Iterable, Mapping, Sequence

from plumbline.errors import PlumblineError, best_matches, shown
from plumbline.experiments.importing.units import SI, UNITS, Unit

JOINT = ("angle", "length")
NUMBERED: Mapping[str, tuple[str, ...]] = {
    "q": JOINT, "m": JOINT, "direction": ("number",), "x": ("length", "angle"),
    "u": ("angle", "length", "angular velocity", "velocity", "torque", "force", "current"),
    "velocity": ("angular velocity", "velocity"), "effort": ("torque", "force", "current"),
    "acceleration": ("angular acceleration", "acceleration"), "pose": ("length",),
}  # fmt: skip
LENGTHS = ("x", "y", "z", "px", "py", "pz", "range", "ct_x", "ct_y", "ct_z", "robot_x", "robot_y",
           "robot_z")  # fmt: skip
QUATERNION, ROTATION = ("qw", "qx", "qy", "qz"), ("rx", "ry", "rz")
SINGLE: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(LENGTHS, ("length",)), **dict.fromkeys(QUATERNION, ("number",)),
    **dict.fromkeys(ROTATION, ("angle",)), "time": ("time",), "temperature": ("temperature",),
    "payload": ("mass",), **dict.fromkeys(("force_x", "force_y", "force_z"), ("force",)),
    "held_out": ("number",),
}  # fmt: skip
# Whole numbers or words, by which rows belong together.
LABELS = ("group", "socket", "plane", "motion", "label", "role")
WORDS = ("label", "role", "plane", "motion")
KINDS_BY_COLUMN = (
    (("ct_x",), "fiducials"), (("range", "plane"), "plane_range"), (("range",), "surface_scan"),
    (("x", "qw"), "pose"), (("x", "rx"), "pose"), (("pose1",), "pose"),
    (("x",), "tip_position"), (("m1",), "joint_position"),
    (("u1", "x1"), "tracking"), (("u1", "q1"), "motion"), (("socket",), "fixed_point"),
    (("q1", "effort1"), "joint_torque"),
)  # fmt: skip
# Kinds whose rows hold the readings of joints.
JOINTED = ("tip_position", "pose", "fixed_point", "joint_position", "joint_torque", "motion")
# Rows are those of the table that holds the first of these: what is measured is not interpolated.
MEASURED = ("x", "pose1", "m1", "range", "socket", "ct_x", "x1", "effort1", "q1", "u1")


def is_target(name: str) -> bool:
    """Whether a recording has a column of that name."""
    return name in SINGLE or name in LABELS or numbered(name) is not None


def numbered(name: str) -> tuple[str, int] | None:
    """Prefix and number of ``q3``; None for another column."""
    match = re.fullmatch(r"([a-z]+)([1-9][0-9]{0,2})", name)
    return (match[1], int(match[2])) if match and match[1] in NUMBERED else None


def from_one(name: str, names: Iterable[str]) -> str:
    """``q1`` of ``q0``, where columns of that beginning count from 0; else the name itself."""
    match = re.fullmatch(r"([a-z]+)([0-9]{1,3})", name)
    if match is None or match[1] not in NUMBERED or f"{match[1]}0" not in names:
        return name
    return f"{match[1]}{int(match[2]) + 1}"


def check_target(name: str) -> None:
    """Refuse a column that no recording has."""
    if not is_target(name):
        known = [*(f"{prefix}1" for prefix in NUMBERED), *SINGLE, *LABELS]
        raise PlumblineError(
            f"--map {name}=...: column {shown(name)} not recognised. Best matches are "
            f"{best_matches(name, known)}"
        )


def dimensions(target: str, kinds: Sequence[str] = ()) -> tuple[str, ...]:
    """What a column may measure, the likeliest first; of joints by their kinds, where known."""
    parts = numbered(target)
    if parts is None:
        return SINGLE[target]
    allowed, joint = NUMBERED[parts[0]], parts[1] - 1
    if parts[0] in ("direction", "x", "pose") or joint >= len(kinds):
        return allowed
    slides = kinds[joint] == "prismatic"
    lengthy = ("length", "velocity", "acceleration", "force", "current")
    return tuple(d for d in allowed if (d in lengthy) == slides or d == "current")


def unit_for(
    target: str, given: Unit | None, defaults: Iterable[Unit], kinds: Sequence[str]
) -> Unit:
    """The unit of a column: the given, refused if of something else; else a default, else SI's."""
    allowed = dimensions(target, kinds)
    if given is not None:
        if given.dimension in allowed:
            return given
        some = ", ".join(name for name, u in UNITS.items() if u.dimension in allowed)
        raise PlumblineError(
            f"{target}: unit {given.name} is of {given.dimension}, expected one of {some}"
        )
    fitting = [unit for unit in defaults if unit.dimension in allowed]
    likeliest = UNITS[SI[allowed[0]]]
    return min(fitting, key=lambda unit: allowed.index(unit.dimension), default=likeliest)


def kind_of(columns: Iterable[str]) -> str:
    """The kind of recording that columns make (PlumblineError: they make none)."""
    there = set(columns)
    for needed, kind in KINDS_BY_COLUMN:
        if set(needed) <= there:
            return kind
    raise PlumblineError(
        f"columns {', '.join(sorted(there)) or 'none'}: nothing measured among them, expected "
        "x,y,z or m1.. or range or socket or effort1.. or, of commands, u1..; map one: "
        "--map x=COLUMN:mm"
    )
