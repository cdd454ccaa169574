"""``plumbline sweep SPEC.toml``: one recording diagnosed under many options, side by side."""

from __future__ import annotations

import csv as csv_module
import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from plumbline.errors import PlumblineError, fault
from plumbline.experiments.console import outputs
from plumbline.experiments.console.outputs import STDOUT, Json, Quiet, check_outputs
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from rich.console import JustifyMethod
    from rich.table import Table

    from plumbline.experiments.sweep.sweep import Outcome, Sweep

NUMERIC = ("seed", "rows", "before", "after")
WIDTH = 160  # characters, where no terminal says that there are fewer
Csv = Annotated[
    Path | None, typer.Option(metavar="OUT.csv", help="Write the table, one line a case.")
]
Parquet = Annotated[
    Path | None, typer.Option(metavar="OUT.parquet", help="Write the table, one row a case.")
]
Dask = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="Let this Dask cluster diagnose.")
]
Jobs = Annotated[int, typer.Option(min=0, help="Processes at a time; 0 for one a core.")]


def sweep(
    spec: Annotated[Path, typer.Argument(help="TOML: a recording, and options to [vary].")],
    json: Json = None,
    csv: Csv = None,
    parquet: Parquet = None,
    jobs: Jobs = 0,
    dask: Dask = None,
    quiet: Quiet = False,
) -> None:
    """Diagnose a recording under every combination of options; say what the verdict hangs on.

    Cases are kept in a file beside the first output, OUT.part, as they are done: a sweep that was
    ended goes on where it was when it is called again.
    """
    from plumbline.experiments.sweep.sweep import read_spec
    from plumbline.experiments.sweep.sweep import sweep as run_sweep

    asked = read_spec(spec)
    files = {"--json": json, "--csv": csv, "--parquet": parquet}
    check_outputs(files, [asked.recording], inputs={"SPEC": spec})
    keep = _kept_beside(csv, parquet, None if json == STDOUT else json)
    with progress_bar(quiet=quiet or json == STDOUT) as progress:
        found = run_sweep(asked, jobs=jobs or -1, dask=dask, keep=keep, progress=progress)
    outputs.write_json(json, found.to_dict())
    if csv is not None:
        outputs.write_text(csv, as_csv(found), "--csv")
    if parquet is not None:
        _write_parquet(parquet, found)
    if keep is not None:
        keep.unlink(missing_ok=True)
    _refuse_if_all_are(found)
    if outputs.talks(json, quiet):
        _print(found)


def _kept_beside(*outputs: str | Path | None) -> Path | None:
    """Where finished cases are kept; nowhere if no file is asked for."""
    from plumbline.experiments.sweep.cases import SUFFIX

    first = next((Path(path).resolve() for path in outputs if path is not None), None)
    return None if first is None else first.with_name(first.name + SUFFIX)


def _refuse_if_all_are(found: Sweep) -> None:
    """No case at all is no result.

    Raises:
        PlumblineError: Every case was refused; the first reason is told.
    """
    from plumbline.experiments.sweep.sweep import REFUSED

    if all(outcome.verdict == REFUSED for outcome in found.outcomes):
        reason = found.outcomes[0].reason
        raise PlumblineError(f"all {len(found.outcomes)} cases were refused: {reason}")


def as_rows(found: Sweep) -> list[dict[str, Any]]:
    """The outcomes as rows of a table; effects left out are parted by spaces, causes by "; "."""
    return [
        outcome.to_dict()
        | {"without": " ".join(outcome.case.without)}
        | {"causes": "; ".join(map(str, outcome.causes))}
        for outcome in found.outcomes
    ]


def as_csv(found: Sweep) -> str:
    """The outcomes as a table of text."""
    rows = as_rows(found)
    out = io.StringIO()
    writer = csv_module.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _write_parquet(path: Path, found: Sweep) -> None:
    """Write the outcomes as a table of columns.

    Raises:
        PlumblineError: It cannot be written.
    """
    import pandas as pd

    try:
        pd.DataFrame(as_rows(found)).astype({"rows": "Int64"}).to_parquet(path, index=False)
    except ImportError:
        mend = "pip install 'plumbline-robotics[parquet]', or take --csv"
        raise fault("--parquet", "no pyarrow here", "it installed", mend) from None
    except OSError as error:
        found_there = f"a file that cannot be written ({error.strerror or error})"
        raise fault(f"--parquet {path}", found_there, "a place", "name another") from None


def _print(found: Sweep) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    console.print(_table(found))
    console.print(found.agreement[:1].upper() + found.agreement[1:] + ".", markup=False)
    for reason in dict.fromkeys(o.reason for o in found.outcomes if o.reason):
        console.print(f"refused: {reason}", markup=False, soft_wrap=True)


def _table(found: Sweep) -> Table:
    from rich import box
    from rich.table import Table

    title = f"Sweep over {found.recording}".replace("[", "\\[")
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for name in (*found.varied, "verdict", "causes", "before", "after"):
        justify: JustifyMethod = "right" if name in NUMERIC else "left"
        table.add_column(name.replace("_", " "), justify=justify, overflow="fold")
    for outcome in found.outcomes:
        table.add_row(*(_option(outcome, name) for name in found.varied), *_found(outcome))
    return table


def _option(outcome: Outcome, name: str) -> str:
    value = getattr(outcome.case, name)
    if isinstance(value, tuple):
        return "\n".join(value) or "-"
    return "all" if value is None else str(value)


def _found(outcome: Outcome) -> tuple[str, ...]:
    from plumbline.optim.core.quantities import chance, quantity

    gaps = (outcome.before, outcome.after)
    return (
        outcome.verdict,
        "\n".join(f"{_short(n.cause)} {chance(n.probability)}" for n in outcome.causes) or "-",
        *("-" if gap is None else quantity(gap, outcome.unit) for gap in gaps),
    )


def _short(label: str) -> str:
    return label.replace(" of joint ", " ").replace(" of link ", " ")
