"""``plumbline reproduce PAPER``: a published method's figures beside ours."""

from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_report
from plumbline.experiments.console.progress_bar import progress_bar


@with_report
def reproduce(
    out: Out,
    paper: Annotated[str, typer.Argument(help="registration, hand-eye, dh-fit or mpc.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> None:
    """Reproduce a published method: the paper's figures beside ours."""
    out.check()
    from plumbline.experiments.reproduce import PAPERS
    from plumbline.experiments.reproduce import reproduce as run

    if paper not in PAPERS:
        raise PlumblineError(f"no paper {paper!r}; there are {', '.join(PAPERS) or 'none yet'}")
    with progress_bar(quiet=out.quiet) as progress:
        found = run(paper, seed, progress)
    out.hand_out(found, found.to_dict())
