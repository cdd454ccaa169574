"""``plumbline dhfit FOLDER``: fit the links of a robot to tip readings, within bounds.

What is reported are ``quantities``: sums of parameters that the readings tell, most of one term.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.diagnose import Folder, HeldOutBy, Seed
from plumbline.experiments.commands.out import Out
from plumbline.experiments.console.outputs import Json, Quiet, Report, write_text

if TYPE_CHECKING:
    from plumbline.optim.dh_fit import DHOptions, HeldOut
    from plumbline.optim.dh_fit.export import ExportedLinks
    from plumbline.optim.recording.recording import Recording


Objective = Literal["norms", "squares"]
SolverName = Literal[
    "gauss-newton", "sqp", "sqp-bfgs", "ipopt", "trust-region", "levenberg-marquardt"
]
Frame = Literal["joint", "registration"]
Parameters = Literal["identifiable", "all"]
Urdf = Annotated[Path | None, typer.Option(metavar="OUT", help="Write the fitted robot as URDF.")]
Toml = Annotated[Path | None, typer.Option(metavar="OUT", help="Write it as DH rows in TOML.")]
DeltaLength = Annotated[
    float, typer.Option(metavar="M", help="How far d and a may go from the drawing, m.")
]
DeltaAngle = Annotated[
    float, typer.Option(metavar="RAD", help="How far angles may go from the drawing, rad.")
]
Smoothing = Annotated[
    float, typer.Option(metavar="M", help="Misfits far below it count as their squares, m.")
]
Tilts = Annotated[bool, typer.Option("--tilts/--no-tilts", help="A tilt between parallel axes.")]
Replace = Annotated[
    bool, typer.Option("--overwrite", "--force", help="Replace files that are there.")
]


def dhfit(
    folder: Folder,
    json: Json = None,
    urdf: Urdf = None,
    toml: Toml = None,
    delta_length: DeltaLength = 0.01,
    delta_angle: DeltaAngle = 0.0873,
    objective: Objective = "norms",
    smoothing: Smoothing = 1e-6,
    solver: SolverName = "gauss-newton",
    frame: Frame = "joint",
    parameters: Parameters = "identifiable",
    tilts: Tilts = True,
    held_out: HeldOutBy = "auto",
    seed: Seed = 0,
    overwrite: Replace = False,
    report: Report = None,
    quiet: Quiet = False,
) -> None:
    """Fit the links of a robot to tip readings; say what the readings can tell."""
    out = Out(json, report, overwrite, quiet)
    out.check([folder], urdf=urdf, toml=toml)
    from plumbline.optim.dh_fit import BY_NAME, DHOptions, Norms, Squares, fit_dh
    from plumbline.optim.dh_fit.export import as_toml, as_urdf
    from plumbline.optim.recording.loading import load_recording

    loss = Norms(smoothing) if objective == "norms" else Squares()
    by = BY_NAME[solver]
    options = DHOptions(loss, frame, parameters, tilts, delta_length, delta_angle, solver=by)
    recording = load_recording(folder)
    fit = fit_dh(recording, options)
    unseen = _unseen(recording, options, held_out, seed)
    files = {
        option: (path, export(fit))
        for option, path, export in (("--urdf", urdf, as_urdf), ("--toml", toml, as_toml))
        if path is not None
    }
    for option, (path, exported) in files.items():
        write_text(path, exported.text, option)
    content = fit.to_dict() | _found(unseen, {o[2:]: e for o, (_, e) in files.items()})
    told = [f"{path}: read again, it agrees with the fit to {e.error:.0e}; tip frame {e.tip_frame}"
            for path, e in files.values()]  # fmt: skip
    out.hand_out(fit, content, unseen=unseen, files=told)


def _found(unseen: HeldOut | None, files: dict[str, ExportedLinks]) -> dict[str, Any]:
    if unseen is None:
        misfits = None
    else:
        misfits = {"before": unseen.before.numbers, "after": unseen.after.numbers}
    told = {o: {"tip_frame": e.tip_frame, "largest_error": e.error} for o, e in files.items()}
    return {"held_out": misfits, "files": told}


def _unseen(recording: Recording, options: DHOptions, kind: str, seed: int) -> HeldOut | None:
    """Misfits of rows that no fit has seen; None where there are too few readings."""
    from plumbline.optim.dh_fit import held_out
    from plumbline.optim.diagnosis.predict.folds import fold_of_rows

    rows = recording.training
    try:
        fold = fold_of_rows(rows, kind, seed)
    except ValueError as error:
        raise PlumblineError(f"--held-out {kind}: {error}") from None
    try:
        return held_out(rows, options, fold)
    except PlumblineError:
        return None
