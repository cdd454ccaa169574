"""Templates of recordings: a commented ``dataset.toml`` and the header of ``samples.csv``, by kind.

Every key stands there, those that are optional behind ``#``; without its ``# `` each is valid TOML.
"""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined

from plumbline.errors import PlumblineError, best_matches, shown
from plumbline.experiments.console.tables import table

ROOM = files("plumbline.experiments.importing")
TEMPLATES: Mapping[str, Mapping[str, Any]] = table("plumbline.experiments.importing", "kinds.toml")


def template(kind: str) -> Mapping[str, Any]:
    """What a kind, refused if unknown, needs: ``meaning``, ``columns``, ``noise``, ``without``."""
    if kind not in TEMPLATES:
        raise PlumblineError(
            f"--kind {shown(kind)}: not recognised. Best matches are "
            f"{best_matches(kind, TEMPLATES)}; all: {', '.join(TEMPLATES)}"
        )
    return {"noise": "", "without": (), **TEMPLATES[kind]}


def header(kind: str, joints: int) -> str:
    """The first line of ``samples.csv``, for so many joints."""
    names: list[str] = []
    for column in template(kind)["columns"]:
        many = range(1, joints + 1)
        names += [column.replace("#", str(k)) for k in many] if "#" in column else [column]
    return ",".join(names)


def settings(kind: str, name: str, robot: Sequence[str]) -> str:
    """The text of ``dataset.toml``, with the lines of its table ``[robot]``."""
    # What is written is TOML, no HTML.
    environment = Environment(
        autoescape=False, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    text = (ROOM / "dataset.toml.j2").read_text(encoding="utf-8")
    made = environment.from_string(text)
    return made.render(kind=kind, name=name, robot=robot, **template(kind))


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
