"""``plumbline reproduce PAPER``: a published method's figures beside ours."""

from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.pages import hand_out
from plumbline.experiments.console.outputs import Json, Overwrite, Quiet, Report, check_outputs
from plumbline.experiments.console.progress_bar import progress_bar


def reproduce(
    paper: Annotated[str, typer.Argument(help="registration, hand-eye, dh-fit or mpc.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    json: Json = None,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Reproduce a published method: the paper's figures beside ours."""
    check_outputs({"--json": json, "--report": report}, overwrite=overwrite)
    from plumbline.experiments.reproduce import PAPERS
    from plumbline.experiments.reproduce import reproduce as run

    if paper not in PAPERS:
        raise PlumblineError(f"no paper {paper!r}; there are {', '.join(PAPERS) or 'none yet'}")
    with progress_bar(quiet=quiet) as progress:
        found = run(paper, seed, progress)
    hand_out(found, found.to_dict(), json, report, quiet)
