"""``plumbline withheld make|seal|run|score|...``: is the diagnosis right when nobody helps?"""

import secrets
from pathlib import Path
from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.diagnose import Seed, effects_beginning
from plumbline.experiments.commands.examples import BLIND, epilog
from plumbline.experiments.commands.out import Out, with_out, with_report
from plumbline.experiments.commands.sweep import Jobs
from plumbline.experiments.console import outputs
from plumbline.experiments.console.progress_bar import progress_bar

WIDTH = 120  # characters of a line, where no terminal says how many there are
app = typer.Typer(
    help="Check the diagnosis on recordings whose cause it cannot know.", epilog=epilog(*BLIND)
)

Cases = Annotated[Path, typer.Argument(help="Folder of recordings, one folder each.")]
TruthFolder = Annotated[Path, typer.Option("--truth", help="Folder of the truth, apart.")]
Count = Annotated[int, typer.Option(min=1, max=100_000, help="Number of cases.")]
SecretSeed = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="The set follows from it; drawn in secret if not given."),
]
LeftOut = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT",
        help="Run without it; each: all in turn, one: of a pair.",
        autocompletion=effects_beginning,
    ),
]
Names = Annotated[list[str] | None, typer.Option(metavar="NAME", help="May be repeated.")]


@app.callback(invoke_without_command=True)
def _without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command("make", epilog=epilog("withheld make"))
@with_out
def make(
    put: Out,
    out: Annotated[Path, typer.Argument(help="Folder for the recordings and their ledger.")],
    truth: TruthFolder,
    count: Count = 20,
    kind: Annotated[
        str, typer.Option(help="single, pair, none, outside, unseen, mixture, mixed.")
    ] = "mixed",
    level: Annotated[str, typer.Option(help="faint, slight, clear or mixed.")] = "clear",
    observation: Annotated[
        str, typer.Option(help="tip_position, pose, fixed_point, joint_position or mixed.")
    ] = "tip_position",
    gap: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Gap over noise, instead of the level's."),
    ] = None,
    rows: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="LOW HIGH", help="Number of rows, instead of the level's."),
    ] = None,
    gross: Annotated[float, typer.Option(min=0, max=0.2, help="Most gross errors.")] = 0.0,
    surgical: Annotated[float, typer.Option(min=0, max=1, help="Chance of a small box.")] = 0.25,
    moving: Annotated[float, typer.Option(min=0, max=1, help="Chance that it moves.")] = 0.2,
    effect: Names = None,
    arm: Names = None,
    leave_out: LeftOut = None,
    simulator: Annotated[
        str, typer.Option(help="numpy, mujoco (moving) or motion (drives).")
    ] = "numpy",
    unknown_noise: Annotated[bool, typer.Option("--unknown-noise", help="State no noise.")] = False,
    seed: SecretSeed = None,
) -> None:
    """Write sealed cases: recordings here, the truth there, its hashes in a ledger first."""
    put.check([out, truth])
    from plumbline.experiments.withheld.design import Design
    from plumbline.experiments.withheld.making import make_set

    design = Design(
        seed=secrets.randbits(60) if seed is None else seed,
        kind=kind,
        level=level,
        observation=observation,
        gap=gap,
        rows=rows,
        gross=gross,
        surgical=surgical,
        moving=moving,
        effects=tuple(effect or ()),
        arms=tuple(arm or ()),
        known_noise=not unknown_noise,
        leave_out=tuple(leave_out or ()),
        simulator=simulator,
    )
    with progress_bar(quiet=put.silent) as progress:
        ledger = make_set(out, truth, design, count, progress)
    content = {"cases": len(ledger.entries), "ledger_sha256": ledger.sha256}
    words = f"{len(ledger.entries)} cases in {out}, their truth in {truth}, ledger {ledger.sha256}"
    put.say(content, words)


@app.command("seal", epilog=epilog("withheld seal"))
@with_out
def seal(put: Out, cases: Cases, truth: TruthFolder) -> None:
    """Write the ledger of cases that were made elsewhere."""
    put.check([cases, truth])
    from plumbline.experiments.withheld.sealing import seal_folder

    ledger = seal_folder(cases, truth)
    content = {"cases": len(ledger.entries), "ledger_sha256": ledger.sha256}
    put.say(content, f"{len(ledger.entries)} cases sealed, ledger {ledger.sha256}")


@app.command("run", epilog=epilog("withheld run"))
@with_out
def run(
    put: Out,
    cases: Cases,
    out: Annotated[Path, typer.Option("--out", help="Folder for the verdicts.")],
    jobs: Jobs = 0,
    seed: Seed = 0,
) -> None:
    """Diagnose every case in a process that can open nothing but its recording."""
    put.check([cases, out])
    from plumbline.experiments.withheld.running import run_set

    with progress_bar(quiet=put.silent) as progress:
        done = run_set(cases, out, jobs=jobs, seed=seed, progress=progress)
    content = {"written": done.written, "kept": done.kept}
    put.say(content, f"{done.written} verdicts written to {out}, {done.kept} kept")


@app.command("score", epilog=epilog("withheld score"))
@with_report
def score(
    put: Out,
    verdicts: Annotated[Path, typer.Argument(help="Folder of the verdicts.")],
    truth: TruthFolder,
    partial: Annotated[bool, typer.Option("--partial", help="Verdicts may be missing.")] = False,
    seed: Seed = 0,
) -> None:
    """Compare the hashes, open the truth, and count."""
    put.check([verdicts, truth])
    from plumbline.experiments.report.page.page import page_html
    from plumbline.experiments.report.page.words import console, print_page
    from plumbline.experiments.withheld.picture import page
    from plumbline.experiments.withheld.scoring import score_run

    found = score_run(verdicts, truth, partial=partial, seed=seed)
    shown = page(found)
    outputs.write_json(put.json, found.to_dict())
    if put.report is not None:
        outputs.write_text(put.report, page_html(shown), "--report")
    if not put.silent:
        print_page(shown, console(WIDTH))  # a table of all figures is wide


@app.command("bench", epilog=epilog("withheld bench"))
@with_out
def bench(
    put: Out,
    folder: Annotated[Path, typer.Argument(help="Keeps the sets, so that it can go on.")],
    count: Count = 1000,
    seed: Seed = 2026,
    jobs: Jobs = 0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="SET", help="This set; may be repeated.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(metavar="OUT.md", help="Write the table of results.")
    ] = None,
) -> None:
    """Make, run and score every kind of case, so many each: the large run."""
    from plumbline.experiments.withheld.bench import SETS, markdown
    from plumbline.experiments.withheld.bench import bench as measure

    for name in only or ():
        if name not in SETS:
            raise PlumblineError(f"--only {name!r} not recognised; known: {', '.join(SETS)}")
    own = [folder / name for name in SETS]
    put.check(own, table=table)
    with progress_bar(quiet=put.silent) as progress:
        found = measure(
            folder, count, seed=seed, jobs=jobs, only=tuple(only or ()), progress=progress
        )
    text = markdown(found)
    if table is not None:
        outputs.write_text(table, text, "--table")
    put.say(found.to_dict(), text)
