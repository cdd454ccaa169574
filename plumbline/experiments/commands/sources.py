"""``plumbline list`` and ``plumbline fetch NAME``: public recordings of real robots.

``plumbline list --effects`` lists the library of effects instead.
"""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.out import Out, with_out

Effects = Annotated[
    bool, typer.Option("--effects", help="List the effects that a gap is searched for instead.")
]


@with_out
def list_(out: Out, effects: Effects = False) -> None:
    """List the public recordings that can be fetched, or the library of effects."""
    out.check()
    if effects:
        _list_effects(out)
        return
    from plumbline.experiments.sources import list_sources

    keys = ("name", "robot", "instrument", "rows", "licence", "url", "citation", "description")
    found = [{key: getattr(source, key) for key in keys} for source in list_sources()]
    line = "{name:<12} {rows:>6} rows  {robot}: {description}"
    out.say(found, "\n".join(line.format(**source) for source in found))


def _list_effects(out: Out) -> None:
    from plumbline.experiments.report.effect_list import listed

    found = listed()
    lines = [
        f"{effect.name:<20} {effect.stage:<12}  {effect.words}"
        + (f" (needs {effect.needs})" if effect.needs else "")
        for effect in found
    ]
    out.say([asdict(effect) for effect in found], "\n".join(lines))


@with_out
def fetch(
    out: Out,
    name: Annotated[str, typer.Argument(help="A name of 'plumbline list'.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write into this folder, not the current one."),
    ] = None,
) -> None:
    """Write a public recording as a folder of that name, checked by its hash."""
    out.check([(to or Path()) / name])
    from plumbline.experiments.sources import fetch as fetch_source
    from plumbline.experiments.sources import list_sources

    folder = fetch_source(
        name, to, progress=not out.quiet and sys.stderr is not None and sys.stderr.isatty()
    )
    source = next(source for source in list_sources() if source.name == name)
    about = {"licence": source.licence, "citation": source.citation}
    words = f"{folder}\nlicence: {source.licence}\nto cite: {source.citation}"
    out.say({"name": name, "folder": str(folder), **about}, words)
