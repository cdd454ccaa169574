"""``plumbline budget SPEC.toml``: what each link of a chain contributes to the error at a point."""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.pages import write_page
from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, Report, check_outputs, say

Spec = Annotated[Path, typer.Argument(metavar="SPEC.toml", help=r"The links, by \[\[link]].")]


def budget(
    spec: Spec,
    json: Json = None,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Say what each link of a chain contributes to the error, and what to mend first."""
    outputs = {"--json": json, "--report": report}
    check_outputs(outputs, inputs={"SPEC": spec}, overwrite=overwrite)
    from plumbline.optim.budget import read_budget

    found = read_budget(spec)
    write_page(report, found)
    words = f"{found.table()}\n{found.headline}.\n{found.next_step()}"
    say(json, quiet, found.to_dict(), words)
