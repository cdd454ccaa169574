"""Templates of recordings: a commented ``dataset.toml`` and the header of ``samples.csv``, by kind.

Every key stands there, those that are optional behind ``#``; without its ``# `` each is valid TOML.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plumbline.errors import PlumblineError, best_matches, shown


@dataclass(frozen=True)
class Template:
    """What a kind of recording needs."""

    meaning: str  # what a row holds
    # columns of ``samples.csv``; ``#`` stands for 1 to the number of joints
    columns: tuple[str, ...]
    noise: str = ""  # what ``noise_std`` is of, with its unit; empty where it is not stated
    robot: bool = True  # whether it needs one
    tool: bool = True  # whether it needs a tool
    more: tuple[str, ...] = ()  # further lines of ``dataset.toml``


TRACKED = "1 sigma per axis, m; left out, it is estimated"
FIT = ("[fit]", 'always = ["frame", "tool"]         # fitted in every model and never blamed')
MOTION = (
    "[motion]",
    'command = "position"               # what u is: "position", "velocity", "rate", "torque"',
    "# kp = [20.0, 20.0]                # the controller's gains, joint by joint, where known",
    "# kd = [1.5, 1.5]",
)
CONTEXT = (
    "time         s",
    "temperature  degC",
    "payload      kg, carried at the tip",
    "direction1.. way it came last: 1 if q grew, -1 if it fell, 0 unknown",
    "velocity1..  rad/s or m/s",
    "effort1..    N m or N",
    "group        rows that belong together, such as one session: 0, 1, 2, ...",
    "held_out     1 for rows that no fit may see",
)
TEMPLATES: Mapping[str, Template] = {
    "tip_position": Template(
        "the tip x,y,z in the device's frame, m", ("q#", "x", "y", "z"), TRACKED, more=FIT
    ),
    "pose": Template(
        "the tip's pose in the device's frame: m, and a unit quaternion, scalar first",
        ("q#", "x", "y", "z", "qw", "qx", "qy", "qz"),
        TRACKED,
        more=("# noise_std_rotation = 1e-4        # 1 sigma of rotations, rad", "", *FIT),
    ),
    "fixed_point": Template(
        "the socket that holds the tip, by number; its place is unknown",
        ("q#", "socket"),
        "1 sigma of the play, m; left out, it is estimated",
        more=(
            "[sockets]",
            "# distance = 0.05                  # between two sockets of a pair, m, if known",
            "# pairs = [[0, 1], [2, 3]]",
        ),
    ),
    "joint_position": Template(
        "the joints by second encoders on the link side, rad or m; empty where there is none",
        ("q#", "m#"),
        "1 sigma of a second encoder, rad",
        more=("[fit]", 'always = ["joint_offset"]          # zeros of the second encoders'),
    ),
    "joint_torque": Template(
        "what the drives give along a motion, in N m, N or A",
        ("time", "q#", "velocity#", "effort#"),
        tool=False,
        more=(
            "[motion]",
            'effort_unit = "N m"                # or "A", with the constants below',
            "# torque_constant = [0.1, 0.1]     # N m / A at the joint, joint by joint",
            "# noise_std = [0.05, 0.05]         # 1 sigma of the efforts, in their own unit",
        ),
    ),
    "motion": Template(
        "commanded u and measured q joints over time",
        ("time", "u#", "q#"),
        "1 sigma of a measured position, rad; left out, it is estimated",
        tool=False,
        more=MOTION,
    ),
    "plane_range": Template(
        "a range finder's reading on a plane, m",
        ("q#", "range", "plane", "motion"),
        "1 sigma of a range, m; left out, it is estimated",
        tool=False,
    ),
    "surface_scan": Template(
        "a range finder's reading on a block or a head, m", ("q#", "range"), tool=False
    ),
    "fiducials": Template(
        "a marker or target (role) in CT and in the robot's frame, m; targets need no robot_*",
        ("label", "role", "ct_x", "ct_y", "ct_z", "robot_x", "robot_y", "robot_z"),
        robot=False,
        tool=False,
    ),
    "tracking": Template(
        "an instrument's commanded velocity u, m/s, and measured state x, m, over time",
        ("time", "u1", "u2", "u3", "x1", "x2", "x3"),
        robot=False,
        tool=False,
    ),
}
WITHOUT_CONTEXT = ("fiducials", "tracking", "plane_range", "surface_scan")


def template(kind: str) -> Template:
    """The template of a kind.

    Raises:
        PlumblineError: There is none of that name.
    """
    if kind not in TEMPLATES:
        raise PlumblineError(
            f"--kind {shown(kind)}: not recognised. Best matches are "
            f"{best_matches(kind, TEMPLATES)}; all: {', '.join(TEMPLATES)}"
        )
    return TEMPLATES[kind]


def header(kind: str, joints: int) -> str:
    """The first line of ``samples.csv``, for so many joints."""
    names: list[str] = []
    for column in template(kind).columns:
        many = range(1, joints + 1)
        names += [column.replace("#", str(k)) for k in many] if "#" in column else [column]
    return ",".join(names)


def settings(kind: str, name: str, robot: Sequence[str]) -> str:
    """The text of ``dataset.toml``, with the lines of its table ``[robot]``."""
    made = template(kind)
    lines = [
        "# A recording: what was measured, and on which robot. SI units: m, rad, s, kg, N.",
        "# A row of samples.csv holds the joint readings q (rad or m) and what was observed:",
        f"# {made.meaning}.",
        *([] if kind in WITHOUT_CONTEXT else _context()),
        "",
        f'name = "{name}"',
        f'observation = "{kind}"',
    ]
    lines += [f"# noise_std = 1e-4                  # {made.noise}"] if made.noise else []
    top = [line for line in made.more if line.startswith("# noise")]
    lines += top
    if made.robot:
        lines += ["", "[robot]", *robot]
    if made.tool:
        known = "# the tip in the tip frame, as known, m"
        lines += ["", "[tool]", f"offset = [0.0, 0.0, 0.0]           {known}"]
    rest = [line for line in made.more if line not in top]
    return "\n".join([*lines, *([""] if rest and rest[0] else []), *rest]).rstrip() + "\n"


def _context() -> list[str]:
    return ["# Columns that may be added:", *(f"#   {line}" for line in CONTEXT)]


def robot_lines(source: Mapping[str, object], gravity: bool = True) -> list[str]:
    """Lines of ``[robot]``: the one that was named, the other ways behind ``#``."""
    ways = {
        "bundled": 'bundled = "ur5"                    # a robot of the package',
        "description": 'description = "ur10"               # a robot of example-robot-data',
        "urdf": 'urdf = "robot.urdf"                # a file beside this one',
        "mjcf": 'mjcf = "robot.xml"                 # MuJoCo\'s XML beside this one',
    }
    given = next(iter(source), "urdf")
    named = f'{given} = "{source.get(given, "robot.urdf")}"'
    lines = [named, *(f"# {line}" for key, line in ways.items() if key != given)]
    lines.append("# or [[robot.dh]], once a joint      # standard rows: d, a, alpha, theta, kind")
    lines.append('# tip_frame = "flange"               # the last link, if left out')
    return [*lines, "# gravity = [0.0, 0.0, -9.81]        # in the base frame, m/s^2"]
