"""``plumbline dhfit FOLDER``: fit the links of a robot to tip readings, within bounds.

What is reported are ``quantities``: sums of parameters that the readings tell, most of one term.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.commands import (
    STDOUT,
    CommandError,
    Json,
    Quiet,
    check_distinct,
    check_output,
    talks,
    write_json,
    write_text,
)
from experiments.commands.diagnose import Folder, HeldOut, HeldOutBy, Seed

if TYPE_CHECKING:
    from optim.dh_fit import DHFit, DHOptions, Misfit
    from optim.dh_fit import HeldOut as HeldOutMisfits
    from optim.dh_fit.export import Exported
    from optim.recording import Recording


FIRST_ROW = 2  # of a table: the header is row 1


class Objective(StrEnum):
    """What a misfit costs."""

    NORMS = "norms"
    SQUARES = "squares"


class SolverName(StrEnum):
    """What solves the problem."""

    GAUSS_NEWTON = "gauss-newton"
    SQP = "sqp"
    SQP_BFGS = "sqp-bfgs"
    IPOPT = "ipopt"
    TRUST_REGION = "trust-region"
    LEVENBERG_MARQUARDT = "levenberg-marquardt"


class Frame(StrEnum):
    """Where the camera's frame comes from."""

    JOINT = "joint"
    REGISTRATION = "registration"


class Parameters(StrEnum):
    """What is free."""

    IDENTIFIABLE = "identifiable"
    ALL = "all"


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
Force = Annotated[bool, typer.Option("--force", help="Overwrite files of --urdf and --toml.")]


def dhfit(
    folder: Folder,
    json: Json = None,
    urdf: Urdf = None,
    toml: Toml = None,
    delta_length: DeltaLength = 0.01,
    delta_angle: DeltaAngle = 0.0873,
    objective: Objective = Objective.NORMS,
    smoothing: Smoothing = 1e-6,
    solver: SolverName = SolverName.GAUSS_NEWTON,
    frame: Frame = Frame.JOINT,
    parameters: Parameters = Parameters.IDENTIFIABLE,
    tilts: Tilts = True,
    held_out: HeldOutBy = HeldOut.AUTO,
    seed: Seed = 0,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit the links of a robot to tip readings; say what the readings can tell."""
    check_output(json, "--json", [folder])
    for option, path in (("--urdf", urdf), ("--toml", toml)):
        check_output(path, option, [folder])
        _keep(path, option, force=force)
    check_distinct({"--json": json, "--urdf": urdf, "--toml": toml})
    options = _options(
        objective, smoothing, solver, frame, parameters, tilts, delta_length, delta_angle
    )
    from optim.dh_fit import fit_dh
    from optim.dh_fit.export import as_toml, as_urdf
    from optim.loading import load_recording

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
    write_json(json, content(fit, unseen, {o[2:]: e for o, (_, e) in files.items()}))
    if talks(json, quiet):
        _print(fit, unseen, list(files.values()))


def _keep(path: Path | None, option: str, *, force: bool) -> None:
    if path is None:
        return
    if str(path) == STDOUT:
        raise CommandError(f"{option} -: standard output is for --json; name a file")
    if path.exists() and not force:
        raise CommandError(f"{option} {path}: is there already; choose another, or add --force")


def _options(
    objective: Objective,
    smoothing: float,
    solver: SolverName,
    frame: Frame,
    parameters: Parameters,
    tilts: bool,
    delta_length: float,
    delta_angle: float,
) -> DHOptions:
    from optim.dh_fit import BY_NAME, DHFitError, DHOptions, Norms, Squares

    try:
        loss = Norms(smoothing) if objective == Objective.NORMS else Squares()
    except ValueError as error:
        raise DHFitError(str(error)) from None
    return DHOptions(
        loss=loss,
        frame=frame.value,
        parameters=parameters.value,
        hayati=tilts,
        delta_length=delta_length,
        delta_angle=delta_angle,
        solver=BY_NAME[solver.value],
    )


def _unseen(
    recording: Recording, options: DHOptions, kind: HeldOut, seed: int
) -> HeldOutMisfits | None:
    """Misfits of rows that no fit has seen; None where there are too few readings."""
    from optim.dh_fit import DHFitError, held_out
    from optim.diagnosis.folds import fold_of_rows

    rows = recording if recording.held_out is None else recording.select(~recording.held_out)
    try:
        fold = fold_of_rows(rows, kind.value, seed)
    except ValueError as error:
        raise CommandError(f"--held-out {kind.value}: {error}") from None
    try:
        return held_out(rows, options, fold)
    except DHFitError:
        return None


def content(
    fit: DHFit, unseen: HeldOutMisfits | None, files: dict[str, Exported]
) -> dict[str, Any]:
    """For JSON: lengths in m, angles in rad, None where nothing is known."""
    known = fit.identifiability
    return {
        "name": fit.recording.name,
        "robot": fit.recording.robot.name,
        "rows": len(fit.readings),
        "unit": "m",
        "objective": {"name": fit.options.loss.name, "value": fit.objective},
        "solver": {"name": fit.options.solver.name, "iterations": fit.found.iterations},
        "frame": fit.options.frame,
        "before": _numbers(fit.before),
        "after": _numbers(fit.after),
        "held_out": None
        if unseen is None
        else {"before": _numbers(unseen.before), "after": _numbers(unseen.after)},
        "marked_rows": _marked(fit),
        "noise": fit.noise,
        "noise_stated": fit.recording.noise_std,
        "chi_square": _chi_square(fit),
        "remarks": list(fit.remarks),
        "gross_rows": _gross(fit),
        "rank": known.rank,
        "quantities": [
            {
                "name": q.name,
                "parts": [{"name": name, "coefficient": c} for name, c in q.parts],
                "unit": q.unit,
                "nominal": q.nominal,
                "value": q.value,
                "std": q.std,
                "ci95": list(q.ci95),
                "share": fit.shares.get(q.name),
            }
            for q in fit.quantities
        ],
        "explained_together": fit.shares["together"],
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "nominal": p.nominal,
                "value": p.value,
                "std": p.std,
                "status": p.status.value,
                "why": p.words,
            }
            for p in fit.parameters
        ],
        "moves_together": [held.words for held in known.held],
        "at_bound": list(fit.at_bound),
        "tool": fit.tool.tolist(),
        "T_robot_camera": fit.T_robot_camera.tolist(),
        "files": {
            option: {"tip_frame": e.tip_frame, "largest_error": e.error}
            for option, e in files.items()
        },
    }


def _chi_square(fit: DHFit) -> dict[str, Any] | None:
    if fit.chi_square is None:
        return None
    return {"value": fit.chi_square, "freedom": fit.freedom, "agrees": fit.agrees}


def _gross(fit: DHFit) -> list[dict[str, Any]]:
    """Rows as an editor counts lines, the header being row 1, and by place, counted from 0."""
    found = [float((e @ e) ** 0.5) for e in fit.misfits()[fit.gross]]
    return [
        {"row": FIRST_ROW + k, "index": k, "misfit": size}
        for k, size in zip(fit.gross_rows, found, strict=True)
    ]


def _numbers(misfit: Misfit) -> dict[str, float]:
    return {key: getattr(misfit, key) for key in ("mean", "max", "std", "rms")}


def _marked(fit: DHFit) -> dict[str, Any] | None:
    """Misfits of the rows that the recording itself marks as held out."""
    from optim.dh_fit import Misfit, Readings

    flags = fit.recording.held_out
    if flags is None or not flags.any():
        return None
    rows = Readings(fit.recording.q, fit.recording.measured[:, :3]).select(flags)
    before, after = Misfit.of(fit.nominal_misfits(rows)), Misfit.of(fit.misfits(rows))
    return {"rows": len(rows), "before": _numbers(before), "after": _numbers(after)}


def _print(fit: DHFit, unseen: HeldOutMisfits | None, files: list[tuple[Path, Exported]]) -> None:
    from rich.console import Console

    from experiments.report.dh_text import print_fit

    console = Console(highlight=False)
    print_fit(fit, unseen, console)
    for path, exported in files:
        said = f"{path}: read again, it agrees with the fit to {exported.error:.0e}"
        console.print(f"{said}; tip frame {exported.tip_frame}", markup=False, soft_wrap=True)
