"""``plumbline import FILE... --to FOLDER`` and ``plumbline new FOLDER``: how a recording begins.

What a laboratory has on disk becomes a recording, or a folder to fill in.
"""

import shutil
import sys
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_out
from plumbline.experiments.console.outputs import write_json

Files = Annotated[
    list[Path], typer.Argument(metavar="FILE...", help="CSV, Parquet, .mat, ROS bag or MCAP.")
]
To = Annotated[Path, typer.Option(metavar="FOLDER", help="The recording; must not exist.")]
JOINTS = 6  # of a robot that is not named yet


@with_out
def import_(
    out: Out,
    files: Files,
    to: To,
    map_: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="X=COLUMN:UNIT", help="A column's meaning, or a TOML file."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(metavar="mm,deg", help="Units of what has none of its own; else SI."),
    ] = None,
    kind: Annotated[
        str | None, typer.Option(metavar="KIND", help="Kind of recording, where columns tell not.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="A known robot, a URDF or an MJCF.")
    ] = None,
    tip_frame: Annotated[str | None, typer.Option(metavar="FRAME")] = None,
    tool: Annotated[
        str | None, typer.Option(metavar="0,0,200mm", help="The tip in the tip frame.")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="0.1mm", help="The instrument's 1 sigma per axis.")
    ] = None,
    gap: Annotated[
        float | None, typer.Option(metavar="S", help="Readings within S seconds belong together.")
    ] = None,
    shift: Annotated[
        list[str] | None, typer.Option(metavar="NAME=S", help="Add S seconds to a file's clock.")
    ] = None,
    derive: Annotated[
        list[str] | None, typer.Option(metavar="velocity,direction", help="From the path.")
    ] = None,
    still: Annotated[
        float | None, typer.Option(metavar="RAD", help="Motion that counts as none.", min=0.0)
    ] = None,
    rotation: Annotated[
        str | None, typer.Option(metavar="rotvec|xyz|ZYX", help="How rx, ry, rz turn.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Write without asking.")] = False,
) -> None:
    """Turn files of a laboratory into a recording, shown as understood before it is written."""
    out.check([to])
    from plumbline.experiments.console.places import check_free
    from plumbline.experiments.importing.asked import shift as parse_shift

    check_free(to)
    options = {
        "units": unit, "observation": kind, "robot": robot, "tip_frame": tip_frame, "tool": tool,
        "noise": noise, "gap": gap, "shift": dict(map(parse_shift, shift or [])),
        "derive": derive, "still": still, "rotation": rotation,
    }  # fmt: skip
    _import(out, files, options, _maps(map_ or []), to, yes)


def _maps(given: list[str]) -> tuple[list[str], Path | None]:
    """Lines ``TARGET=COLUMN:UNIT``, and a file of such lines, if there is one."""
    lines = [line for line in given if "=" in line or not line.endswith(".toml")]
    maps = [Path(line) for line in given if line not in lines]
    if len(maps) > 1:
        raise PlumblineError(f"--map {maps[1]}: a second file, expected one; join them")
    return lines, maps[0] if maps else None


def _import(
    out: Out, files: list[Path], options: dict[str, Any], maps: tuple[list[str], Path | None],
    to: Path, yes: bool,
) -> None:  # fmt: skip
    from plumbline.experiments.importing import files as importing
    from plumbline.experiments.importing import tables
    from plumbline.experiments.importing.asked import asked
    from plumbline.experiments.importing.understood import understand

    raws = tables.told_apart([raw for path in files for raw in importing.read(path)])
    request = asked(options, *maps, raws)
    found = understand(raws, request.request)
    if not out.silent:
        print(importing.words(raws, found))
    if not yes:
        _ask(to, out.json)
    settings = importing.described(to, found, request.settings)
    checked = importing.write(found, settings, request.files, to, _checked)
    facts = {
        "folder": str(to), "observation": found.observation, "rows": len(found.samples),
        "columns": {k: {"from": s.place, "unit": s.unit} for k, s in found.sources.items()},
        "notes": [*found.notes, *checked.get("notes", [])], "command": checked["command"],
    }  # fmt: skip
    write_json(out.json, facts)
    if not out.silent:
        said = [f"note: {note}" for note in checked.get("notes", [])]
        following = checked["command"].replace("FOLDER", quote(str(to)))
        print("\n".join([*said, f"written: {to}", f"next: {following}"]))


def _ask(to: Path, json: str | None) -> None:
    if sys.stdin is None or not sys.stdin.isatty() or json == "-":
        raise PlumblineError(f"--to {to}: nothing was written; say --yes to write what was shown")
    if not typer.confirm(f"Write {to}?", err=True):
        raise PlumblineError(f"--to {to}: nothing was written, as was asked")


def _checked(folder: Path) -> dict[str, Any]:
    from plumbline.experiments.commands.check import examined

    try:
        return examined(folder)[0]
    except PlumblineError as error:
        remedy = error.remedy or ""
        unit = any(word in remedy for word in ("multiply", "divide"))
        said = "; or say its unit: --unit mm,deg, or --map x=COLUMN:mm" if unit else ""
        said += "; or say --robot ur5, or --robot arm.urdf" if "[robot]" in remedy else ""
        raise PlumblineError(f"as understood, it is no recording: {error}{said}") from None


@with_out
def new(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="The folder to make; must not exist.")],
    kind: Annotated[
        str, typer.Option(metavar="KIND", help="What a row measures, such as pose or motion.")
    ] = "tip_position",
    robot: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="A known robot, a URDF or an MJCF.")
    ] = None,
) -> None:
    """Write a commented template: dataset.toml, and the header of samples.csv."""
    out.check([folder])
    from plumbline.experiments.console.places import place
    from plumbline.experiments.importing import templates
    from plumbline.experiments.importing.asked import named_robot

    templates.template(kind)
    source, files, made = named_robot(robot)
    joints = made.chain().n if made else JOINTS
    text = templates.settings(kind, folder.resolve().name, templates.robot_lines(source))
    header = templates.header(kind, joints)

    def fill(target: Path) -> None:
        (target / "dataset.toml").write_text(text, encoding="utf-8")
        (target / "samples.csv").write_text(header + "\n", encoding="utf-8")
        for name, path in files.items():
            shutil.copyfile(path, target / name)

    place(folder, fill)
    content = {"folder": str(folder), "observation": kind, "columns": header.split(",")}
    words = f"{folder}/dataset.toml and samples.csv: fill in rows of {header}"
    out.say(content, f"{words}\nnext: plumbline check {quote(str(folder))}")
