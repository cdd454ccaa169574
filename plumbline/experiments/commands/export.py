"""``plumbline export MODEL``: what was found as URDF, MJCF, DH rows, a table or C."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.console.outputs import (
    Json,
    Overwrite,
    Quiet,
    check_outputs,
    say,
    write_text,
)

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.toml", help="What --model wrote.")]
Urdf = Annotated[Path | None, typer.Option(metavar="FILE", help="Links and zeros as URDF.")]
Mjcf = Annotated[Path | None, typer.Option(metavar="FILE", help="The same, or drives, for MuJoCo.")]
Dh = Annotated[Path | None, typer.Option(metavar="FILE", help="The same as DH rows in TOML.")]
Csv = Annotated[Path | None, typer.Option(metavar="FILE", help="Corrections for a controller.")]
C = Annotated[Path | None, typer.Option(metavar="FILE", help="The whole model as C.")]


def export(
    model: ModelFile,
    urdf: Urdf = None,
    mjcf: Mjcf = None,
    dh: Dh = None,
    csv: Csv = None,
    c: C = None,
    json: Json = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write what was found for others, and say what each format cannot hold."""
    asked = {"--urdf": urdf, "--mjcf": mjcf, "--dh": dh, "--csv": csv, "--c": c}
    files = {option: path for option, path in asked.items() if path is not None}
    if not files:
        raise PlumblineError("export: no format is named; add --urdf, --mjcf, --dh, --csv or --c")
    check_outputs({**files, "--json": json}, inputs={"MODEL": model}, overwrite=overwrite)
    makers = _makers(model)
    for option in files:
        if option not in makers:
            raise PlumblineError(f"{option}: holds no drives; {', '.join(makers)} expected")
    made = {option: makers[option]() for option in files}
    for option, path in files.items():
        write_text(path, made[option].text, option)
    lines = [f"{path}: {made[option].words}." for option, path in files.items()]
    content = {option[2:]: made[option].to_dict() for option in files}
    say(json, quiet, content, "\n".join(lines))


def _makers(path: Path) -> dict[str, Callable[[], Any]]:
    """What a stored model can be written as, by option."""
    from plumbline.optim.loading import load_model
    from plumbline.optim.model import Drives

    found = load_model(path)
    if isinstance(found, Drives):
        return {"--mjcf": found.as_mjcf}
    return {
        "--urdf": found.as_urdf,
        "--mjcf": found.as_mjcf,
        "--dh": found.as_dh,
        "--csv": found.as_table,
        "--c": found.as_c,
    }
