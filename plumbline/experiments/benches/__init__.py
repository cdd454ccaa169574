"""Benches of single methods: ratios within one run.

``python -m plumbline.experiments.benches.NAME``
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from time import perf_counter
from typing import TYPE_CHECKING, TypeVar

import typer
from rich.console import Console
from rich.table import Table

from plumbline.errors import PlumblineError
from plumbline.experiments.console.outputs import check_output, talks, write_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
Found = TypeVar("Found", bound="DataclassInstance")


def timed(
    task: Callable[[], T], runs: int = 1, clock: Callable[[], float] = perf_counter
) -> tuple[T, list[float]]:
    """What the last run gave, and the seconds of each by a clock."""
    seconds = []
    for _ in range(runs):
        begun = clock()
        found = task()
        seconds.append(clock() - begun)
    return found, seconds


def tell(
    measure: Callable[[], Found], tables: Callable[[Found], Sequence[Table]], json: str | None
) -> None:
    """Measure, write what was found, and print its tables; a fault in one line."""
    try:
        check_output(json, "--json")
        found = measure()
        write_json(json, asdict(found))
    except PlumblineError as error:
        typer.echo(f"bench: {error}", err=True)
        raise typer.Exit(2) from None
    if talks(json, quiet=False):
        console = Console(highlight=False)
        for table in tables(found):
            console.print(table)
