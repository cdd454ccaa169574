"""``plumbline list`` and ``plumbline fetch NAME``: public recordings of real robots."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands import Json, Quiet, check_output, talks, write_json


def list_(json: Json = None, quiet: Quiet = False) -> None:
    """List the public recordings that can be fetched."""
    check_output(json, "--json")
    from experiments.sources import list_sources

    keys = ("name", "robot", "instrument", "rows", "licence", "url", "citation", "description")
    found = [{key: getattr(source, key) for key in keys} for source in list_sources()]
    write_json(json, found)
    if talks(json, quiet):
        for source in list_sources():
            typer.echo(
                f"{source.name:<12} {source.rows:>6} rows  {source.robot}: {source.description}"
            )


def fetch(
    name: Annotated[str, typer.Argument(help="A name of 'plumbline list'.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write into this folder, not the current one."),
    ] = None,
    json: Json = None,
    quiet: Quiet = False,
) -> None:
    """Write a public recording as a folder of that name, checked by its hash."""
    check_output(json, "--json", [(to or Path()) / name])
    from experiments.sources import fetch as fetch_source

    folder = fetch_source(name, to, progress=not quiet and sys.stderr.isatty())
    write_json(json, {"name": name, "folder": str(folder)})
    if talks(json, quiet):
        typer.echo(f"{folder}")
