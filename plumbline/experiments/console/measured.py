"""What was measured: tables and figures by their names, printed or written as JSON."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from time import perf_counter
from typing import Any, TypeVar

import pandas as pd
import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.console.outputs import Json, check_output, talks, write_json

T = TypeVar("T")
Found = Mapping[str, Any]  # tables and figures by name


def timed(task: Callable[[], T], runs: int = 1) -> tuple[T, list[float]]:
    """What the last run gave, and the seconds of each."""
    seconds = []
    for _ in range(runs):
        begun = perf_counter()
        found = task()
        seconds.append(perf_counter() - begun)
    return found, seconds


def tell(measure: Callable[[], Found], json: str | None, command: str = "bench") -> None:
    """Measure, write what was found, and print it; a fault in one line."""
    try:
        check_output(json, "--json", overwrite=True)
        found = measure()
        write_json(json, {name: plain(value) for name, value in found.items()})
    except PlumblineError as error:
        typer.echo(f"{command}: {error}", err=True)
        raise typer.Exit(2) from None
    if talks(json, quiet=False):
        typer.echo("\n\n".join(printed(name, value) for name, value in found.items()))


def as_command(measure: Callable[..., Found]) -> Callable[..., None]:
    """What measures as a command: its options and ``--json``, its words as help."""

    @wraps(measure)
    def command(*, json: str | None = None, **options: Any) -> None:
        tell(lambda: measure(**options), json, measure.__name__)

    own = signature(measure, eval_str=True)
    more = Parameter("json", Parameter.KEYWORD_ONLY, default=None, annotation=Json)
    every = [*own.parameters.values(), more]
    vars(command)["__signature__"] = own.replace(parameters=every, return_annotation=None)
    command.__annotations__ = {one.name: one.annotation for one in every}
    return command


def plain(value: Any) -> Any:
    """A table as records, a dataclass as its fields, what is not known as none."""
    if isinstance(value, pd.DataFrame):
        return [
            {str(k): plain(v) for k, v in record.items()} for record in value.to_dict("records")
        ]
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not abs(value) < float("inf") else value


def printed(name: str, value: Any) -> str:
    """A table under its name, or a figure beside it."""
    if not isinstance(value, pd.DataFrame):
        return f"{name}: {value}"
    shown = value.to_string(index=False, float_format=lambda v: f"{v:.3g}", na_rep="-")
    return f"{name}\n{shown if len(value) else 'none'}"
