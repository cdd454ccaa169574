"""``plumbline apply MODEL FOLDER`` and ``plumbline export MODEL``: what becomes of what was found.

It is tried on another recording, or written as URDF, MJCF, DH rows, a table or C.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_out, with_report
from plumbline.experiments.console.outputs import write_text

if TYPE_CHECKING:
    from plumbline.optim.model import Applied

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.toml", help="What --model wrote.")]
Folder = Annotated[Path, typer.Argument(help="Another recording of the same robot.")]
Force = Annotated[
    bool, typer.Option("--force", help="Try even what another set-up explains far better.")
]
Urdf = Annotated[Path | None, typer.Option(metavar="FILE", help="Links and zeros as URDF.")]
Mjcf = Annotated[Path | None, typer.Option(metavar="FILE", help="The same, or drives, for MuJoCo.")]
Dh = Annotated[Path | None, typer.Option(metavar="FILE", help="The same as DH rows in TOML.")]
Csv = Annotated[Path | None, typer.Option(metavar="FILE", help="Corrections for a controller.")]
C = Annotated[Path | None, typer.Option(metavar="FILE", help="The whole model as C.")]


@with_report
def apply(out: Out, model: ModelFile, folder: Folder, force: Force = False) -> None:
    """Try a model on another recording: before, after, and whether it still holds."""
    out.check([folder])
    found = _tried(model, folder, force=force)
    said = [f"Not carried over: {', '.join(found.left_out)}."] if found.left_out else []
    said += [f"Note: {note}." for note in found.judged.failures]
    out.write_page(found)
    out.say({"model": str(model)} | found.to_dict(), "\n".join([found.words, *said]))


def _tried(path: Path, folder: Path, *, force: bool) -> Applied:
    from plumbline.optim.loading import load, load_model, load_to_diagnose
    from plumbline.optim.model import Drives
    from plumbline.optim.model import apply as apply_model

    model = load_model(path)
    other = load(folder) if isinstance(model, Drives) else load_to_diagnose(folder)
    return apply_model(model, other, force=force)


@with_out
def export(
    out: Out, model: ModelFile, urdf: Urdf = None, mjcf: Mjcf = None, dh: Dh = None,
    csv: Csv = None, c: C = None,
) -> None:  # fmt: skip
    """Write what was found for others, and say what each format cannot hold."""
    asked = {"urdf": urdf, "mjcf": mjcf, "dh": dh, "csv": csv, "c": c}
    files = {option: path for option, path in asked.items() if path is not None}
    if not files:
        raise PlumblineError("export: no format is named; add --urdf, --mjcf, --dh, --csv or --c")
    out.check((), {"MODEL": model}, **files)
    makers = _makers(model)
    for option in files:
        if option not in makers:
            known = ", ".join(f"--{name}" for name in makers)
            raise PlumblineError(f"--{option}: holds no drives; {known} expected")
    made = {option: makers[option]() for option in files}
    for option, path in files.items():
        write_text(path, made[option].text, f"--{option}")
    lines = [f"{path}: {made[option].words}." for option, path in files.items()]
    out.say({option: made[option].to_dict() for option in files}, "\n".join(lines))


def _makers(path: Path) -> dict[str, Callable[[], Any]]:
    """What a stored model can be written as, by option."""
    from plumbline.optim.loading import load_model
    from plumbline.optim.model import Drives

    found = load_model(path)
    if isinstance(found, Drives):
        return {"mjcf": found.as_mjcf}
    return {
        "urdf": found.as_urdf,
        "mjcf": found.as_mjcf,
        "dh": found.as_dh,
        "csv": found.as_table,
        "c": found.as_c,
    }
