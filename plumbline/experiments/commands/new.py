"""``plumbline new FOLDER``: a recording's folder to fill in."""

import shutil
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, check_output, say

JOINTS = 6  # of a robot that is not named yet


def new(
    folder: Annotated[Path, typer.Argument(help="The folder to make; must not exist.")],
    kind: Annotated[
        str, typer.Option(metavar="KIND", help="What a row measures, such as pose or motion.")
    ] = "tip_position",
    robot: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="A known robot, a URDF or an MJCF.")
    ] = None,
    json: Json = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a commented template: dataset.toml, and the header of samples.csv."""
    check_output(json, "--json", [folder], overwrite=overwrite)
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
    say(json, quiet, content, f"{words}\nnext: plumbline check {quote(str(folder))}")
