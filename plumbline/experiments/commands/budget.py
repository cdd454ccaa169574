"""``plumbline budget SPEC.toml``: what each link of a chain contributes to the error at a point."""

from pathlib import Path
from typing import Annotated

import typer

from plumbline.experiments.commands.out import Out, with_report

Spec = Annotated[Path, typer.Argument(metavar="SPEC.toml", help=r"The links, by \[\[link]].")]


@with_report
def budget(out: Out, spec: Spec) -> None:
    """Say what each link of a chain contributes to the error, and what to mend first."""
    out.check((), {"SPEC": spec})
    from plumbline.optim.budget import read_budget

    found = read_budget(spec)
    out.write_page(found)
    out.say(found.to_dict(), f"{found.table()}\n{found.headline}.\n{found.next_step()}")
