"""``plumbline codegen FOLDER``: a step of the capsule controller in C."""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_out
from plumbline.experiments.console.outputs import check_new

BUILD = "cc -O3 -o main main.c capsule_step.c program.c banded_qp.c -lm"
DEPTH, ASIDE = 0.12, 0.02  # [m] of the example's tips behind their trocars, and to the side


@with_out
def codegen(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="Where the sources go; made if need be.")],
    trocar: Annotated[list[str], typer.Option(help="x,y,z of a trocar [m]; once for each.")],
    horizon: Annotated[int, typer.Option(min=1, help="Steps of the horizon.")] = 10,
    capsules: Annotated[int, typer.Option(min=0, help="Capsules among the obstacles.")] = 0,
    balls: Annotated[int, typer.Option(min=0, help="Spheres among the obstacles.")] = 0,
) -> None:
    """Write a controller's step for instruments through trocars in C, with a program to try it."""
    out.check()
    if folder.exists() and not folder.is_dir():
        raise PlumblineError(f"{folder}: a file; name a folder")
    from plumbline.optim.capsule_mpc import Settings, Statement, TipInstrument
    from plumbline.optim.capsule_mpc.codegen import FILES, Example, write

    for name in FILES:
        check_new(folder / name, "FOLDER", overwrite=out.overwrite)
    points = [_point(words) for words in trocar]
    tools = tuple(TipInstrument(point) for point in points)
    statement = Statement(tools, capsules, Settings(p=horizon), balls)
    start = [[x, y - ASIDE, z - DEPTH] for x, y, z in points]
    goal = [[x, y + ASIDE, z - DEPTH] for x, y, z in points]
    try:
        write(statement, folder, Example(start, goal))
    except OSError as error:
        raise PlumblineError(f"{folder}: {error.strerror}; name another folder") from None
    content = {"folder": str(folder), "files": list(FILES)}
    out.say(content, f"{', '.join(FILES)} written to {folder}\n{BUILD}")


def _point(words: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in words.split(","))
    except ValueError:
        raise PlumblineError(f"--trocar {words}: expected x,y,z in m, such as -0.04,0,0") from None
    return x, y, z
