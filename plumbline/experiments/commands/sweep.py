"""``plumbline sweep SPEC.toml``: a recording under many options, or a method on many realities."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from plumbline.errors import PlumblineError, fault, shown
from plumbline.experiments.commands.out import Out, with_out
from plumbline.experiments.console import outputs
from plumbline.experiments.console.outputs import STDOUT
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.experiments.report.page.page import Grid
    from plumbline.experiments.sweep.outcome import Crossed, Outcome, Sweep

WORDS = ("held_out", "without", "verdict", "causes", "truth", "effect", "kind", "arm")
HIDDEN = ("cause", "probability", "unit", "outside_probability", "reason")  # of the printed table
WIDTH = 160  # characters, where no terminal says that there are fewer
WRITING = 0.02  # most of the time [1] that goes into writing tables as they stand
Csv = Annotated[
    Path | None, typer.Option(metavar="OUT.csv", help="Write the table, one line a case.")
]
Parquet = Annotated[
    Path | None, typer.Option(metavar="OUT.parquet", help="Write the table, one row a case.")
]
Dask = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="Let this Dask cluster diagnose.")
]
By = Annotated[str | None, typer.Option(metavar="A,B", help="Print a figure by these two factors.")]
Of = Annotated[
    str | None, typer.Option("--of", metavar="FIGURE", help="Which figure; the first of them.")
]
Plot = Annotated[
    Path | None, typer.Option(metavar="OUT.svg", help="Draw it, as .svg, .png or .pdf.")
]
Jobs = Annotated[int, typer.Option(min=0, help="Processes at a time; 0 for one a core.")]


@with_out
def sweep(
    out: Out,
    spec: Annotated[
        Path, typer.Argument(help="TOML: a recording or a reality, and what to vary or to draw.")
    ],
    csv: Csv = None,
    parquet: Parquet = None,
    jobs: Jobs = 0,
    dask: Dask = None,
    by: By = None,
    figure: Of = None,
    plot: Plot = None,
) -> None:
    """Diagnose a recording under many options, or try a method on many made-up realities.

    Tables grow as cases are done and can be read at any time. Cases are kept beside the first
    output, too, in OUT.part: a sweep that was ended goes on where it was when it is called again.
    """
    from plumbline.experiments.sweep.spec import read_spec
    from plumbline.experiments.sweep.sweep import sweep as run_sweep

    asked = read_spec(spec)
    read = [] if asked.recording is None else [asked.recording]
    keep = _kept_beside(csv, parquet, None if out.json == STDOUT else out.json)
    begun = keep is not None and keep.is_file()
    asking = replace(out, overwrite=out.overwrite or begun)
    asking.check(read, {"SPEC": spec}, csv=csv, parquet=parquet, plot=plot)
    factors = _two_of(by, asked.cases[0].to_dict(), plot)
    tables = Tables(csv, parquet, figure)
    with progress_bar(quiet=out.silent) as progress, closing(tables):
        found = run_sweep(
            asked, jobs=jobs or -1, dask=dask, keep=keep, stands=tables.stand, progress=progress
        )
    outputs.write_json(out.json, found.to_dict())
    if keep is not None:
        keep.unlink(missing_ok=True)
    _refuse_if_all_are(found)
    table = None if factors is None else found.table(*factors, figure)
    if table is not None and plot is not None:
        drawn = io.BytesIO()
        table.plot().savefig(drawn, format=plot.suffix[1:])
        outputs.write_text(plot, drawn.getvalue(), "--plot")
    if not out.silent:
        _print(found, table)


def _kept_beside(*outputs: str | Path | None) -> Path | None:
    """Where finished cases are kept; nowhere if no file is asked for."""
    from plumbline.experiments.sweep.sweep import SUFFIX

    first = next((Path(path).resolve() for path in outputs if path is not None), None)
    return None if first is None else first.with_name(first.name + SUFFIX)


def _two_of(
    by: str | None, options: Mapping[str, Any], plot: Path | None
) -> tuple[str, str] | None:
    suffixes = (".svg", ".png", ".pdf")
    if plot is not None and (by is None or plot.suffix not in suffixes):
        known = ", ".join(suffixes)
        raise fault("--plot", shown(str(plot)), f"--by A,B beside it and one of {known}", "mend it")
    if by is None:
        return None
    names = [name.strip() for name in by.split(",")]
    if len(names) != 2 or not set(names) <= set(options):
        raise fault("--by", shown(by), f"two of {', '.join(options)}", "write --by A,B")
    return names[0], names[1]


def _refuse_if_all_are(found: Sweep) -> None:
    from plumbline.experiments.sweep.outcome import REFUSED

    if all(outcome.verdict == REFUSED for outcome in found.outcomes):
        reason = found.outcomes[0].reason
        raise PlumblineError(f"all {len(found.outcomes)} cases were refused: {reason}")


def as_rows(found: Sweep) -> list[dict[str, Any]]:
    """The outcomes as rows of a table; effects left out are parted by spaces, causes by "; "."""
    rows = [outcome.to_dict() for outcome in found.outcomes]
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [{name: _cell(row.get(name)) for name in names} for row in rows]


def _cell(value: Any) -> Any:
    """What one cell holds: of a list its words, of a cause its name and probability."""
    if not isinstance(value, list):
        return value
    if not all(isinstance(one, dict) for one in value):
        return " ".join(value)
    return "; ".join(f"{one['cause']} ({one['probability']:.2g})" for one in value)


def as_csv(found: Sweep) -> str:
    """The outcomes as a table of text."""
    import pandas as pd

    text = pd.DataFrame(as_rows(found), dtype=object).to_csv(index=False, lineterminator="\n")
    return str(text)


class Tables:
    """The tables of a sweep, written anew, each whole, as cases come."""

    def __init__(self, csv: Path | None, parquet: Path | None, figure: str | None = None) -> None:
        self.csv, self.parquet, self.figure = csv, parquet, figure
        self.so_far: Callable[[], Sweep] | None = None  # the cases done, none before the first
        self.due = 0.0  # when they are written next [s]

    def stand(self, so_far: Callable[[], Sweep]) -> None:
        """One more case is done (PlumblineError: it has no such figure)."""
        if self.figure is not None and so_far().has(self.figure):
            self.figure = None
        self.so_far = so_far
        if monotonic() >= self.due:
            self.close()

    def close(self) -> None:
        """Write what is done (PlumblineError: it cannot be written)."""
        began = monotonic()
        if self.so_far is not None and self.csv is not None:
            outputs.write_text(self.csv, as_csv(self.so_far()), "--csv")
        if self.so_far is not None and self.parquet is not None:
            outputs.write_text(self.parquet, as_parquet(self.so_far()), "--parquet")
        self.due = monotonic() + (monotonic() - began) / WRITING


def as_parquet(found: Sweep) -> bytes:
    """The outcomes as a table of columns (PlumblineError: nothing that writes it is installed)."""
    import pandas as pd

    whole = io.BytesIO()
    try:
        pd.DataFrame(as_rows(found)).convert_dtypes().to_parquet(whole, index=False)
    except ImportError:
        mend = "pip install 'plumbline-robotics[parquet]', or take --csv"
        raise fault("--parquet", "no pyarrow here", "it installed", mend) from None
    return whole.getvalue()


def _print(found: Sweep, table: Crossed | None) -> None:
    from plumbline.experiments.report.page.words import console, table_of

    out = console(WIDTH)
    title, grid = _table(found) if table is None else _crossed(table)
    out.print(title, style="bold", markup=False)
    out.print(table_of(grid))
    out.print(found.agreement[:1].upper() + found.agreement[1:] + ".", markup=False)
    for reason in dict.fromkeys(o.reason for o in found.outcomes if o.reason):
        out.print(f"refused: {reason}", markup=False, soft_wrap=True)


def _crossed(crossed: Crossed) -> tuple[str, Grid]:
    from plumbline.experiments.report.page.page import Grid

    rows = [
        (name, *(f"{v:.4g} ({n})" if n else "-" for v, n in zip(values, counts, strict=True)))
        for name, values, counts in zip(crossed.down, crossed.values, crossed.cases, strict=True)
    ]
    columns = (f"{crossed.rows} \\ {crossed.columns}", *crossed.across)
    return f"{crossed.of}; in brackets: cases", Grid(columns, rows, range(1, len(columns)))


def _table(found: Sweep) -> tuple[str, Grid]:
    from plumbline.experiments.report.page.page import Grid

    shown = [n for n in as_rows(found)[0] if n not in {*found.varied, *HIDDEN}]
    told = [n for n in shown if n not in found.outcomes[0].case.to_dict()]
    names, rows = (*found.varied, *told), []
    for outcome in found.outcomes:
        options = outcome.case.to_dict()
        cells = (_option(options[name]) for name in found.varied)
        rows.append((*cells, *(_told(outcome, name) for name in told)))
    numbers = [k for k, name in enumerate(names) if name not in WORDS]
    grid = Grid([name.replace("_", " ") for name in names], rows, numbers)
    return f"Sweep over {found.recording}", grid


def _option(value: Any) -> str:
    if isinstance(value, list):
        return "\n".join(value) or "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return "all" if value is None else str(value)


def _told(outcome: Outcome, name: str) -> str:
    from plumbline.experiments.sweep.outcome import GAPS, LENGTHS, TIMES
    from plumbline.optim.core.quantities import chance, quantity

    value = outcome.found.get(name)
    if name == "causes":
        named = (f"{n['cause']} {chance(n['probability'])}" for n in value or [])
        return "\n".join(named).replace(" of joint ", " ").replace(" of link ", " ") or "-"
    if name in GAPS and value is not None:
        return str(quantity(value, outcome.found.get("unit", "m")))
    if name in LENGTHS and value is not None:
        return str(quantity(value, "m"))
    if name in TIMES and value is not None:
        return f"{1e3 * value:.3g} ms"
    if value is None:
        return "-"
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else _option(value)
