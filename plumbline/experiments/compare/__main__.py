"""``python -m plumbline.experiments.compare``: every way of every contest, and the page."""

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.compare.contests import CONTESTS, Contest
from plumbline.experiments.compare.running import PEERS, Cell, cell, page, written
from plumbline.experiments.console.outputs import Json, Quiet, check_output, write_json, write_text

ROOT = Path(__file__).parents[3]
IMPORTS = "import run; from plumbline import diagnose, fit_dh, register; print(run.peak())"
Page = Annotated[Path | None, typer.Option(metavar="OUT.md", help="Write the page.")]
Build = Annotated[Path, typer.Option(metavar="DIR", help="Environments and recordings.")]
Only = Annotated[list[str] | None, typer.Option(metavar="CONTEST", help="May be repeated.")]


def compare(
    only: Only = None,
    json: Json = None,
    out: Page = None,
    build: Build = Path("build/peers"),
    quiet: Quiet = False,
) -> None:
    """Set plumbline beside its peers on the same data, each in an environment of its own."""
    try:
        for option, path in (("--json", json), ("--out", out)):
            check_output(path, option, overwrite=True)
        chosen = _chosen(only or [])
        build.mkdir(parents=True, exist_ok=True)
        cells = [one for contest in chosen for one in _cells(contest, build, quiet=quiet)]
        write_json(json, [one.to_dict() for one in cells])
        if out is not None:
            write_text(out, _page(chosen, cells), "--out")
    except PlumblineError as error:
        typer.echo(f"compare: {error}", err=True)
        raise typer.Exit(2) from None


def _chosen(only: Sequence[str]) -> Sequence[Contest]:
    known = {contest.name: contest for contest in CONTESTS}
    for name in only:
        if name not in known:
            raise PlumblineError(f"--only {name!r} not recognised; known: {', '.join(known)}")
    return [known[name] for name in only] or CONTESTS


def _cells(contest: Contest, build: Path, *, quiet: bool) -> list[Cell]:
    try:
        given = written(contest.given(build), build / f"{contest.name}.npz")
    except PlumblineError as error:  # data that are not to be had here
        return [Cell(contest.name, way.peer, why=str(error), note=way.note) for way in contest.ways]
    found = []
    for way in contest.ways:
        found.append(cell(contest, way, given, build))
        if not quiet:
            typer.echo(found[-1].words, err=True)
    return found


def _page(chosen: Sequence[Contest], cells: Sequence[Cell]) -> str:
    asked, path = [sys.executable, "-c", IMPORTS], {"PYTHONPATH": f"{PEERS}{os.pathsep}{ROOT}"}
    done = subprocess.run(asked, capture_output=True, text=True, check=True, env=os.environ | path)
    machine = f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
    floor = float(done.stdout) / 1e6
    return page(chosen, cells, day=date.today(), machine=machine, floor=floor)


if __name__ == "__main__":
    typer.run(compare)
