"""``plumbline diagnose FOLDER``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_report
from plumbline.experiments.commands.verdicts import Outputs, diagnose_motion, diagnose_several
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.experiments.report.diagnosis.phrases import Elsewhere
    from plumbline.optim.diagnosis.answer import Diagnosis
    from plumbline.optim.diagnosis.calibrate.check import CalibrationCheck
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.recording.recording import Recording


def effects_beginning(begun: str) -> list[str]:
    """Names of effects, for the shell to complete."""
    from plumbline.kinematics.effects import REGISTRY

    return sorted(name for name in REGISTRY if name.startswith(begun))


MOST_CASES = 10_000  # a day at ten seconds each; shares are known to half a percent
Folder = Annotated[Path, typer.Argument(help="A recording: dataset.toml and samples.csv.")]
Folders = Annotated[
    list[Path],
    typer.Argument(
        metavar="FOLDER...",
        help="A recording: dataset.toml and samples.csv; several of one robot; or a session.toml.",
    ),
]
HeldOutBy = Annotated[
    Literal["auto", "groups", "time", "workspace", "rows"],
    typer.Option("--held-out", help="What is left out together."),
]
Seed = Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of every random draw.")]
Also = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER2", help="Try the model there; what is always fitted is fitted again."
    ),
]
ModelOut = Annotated[
    Path | None,
    typer.Option(metavar="OUT.toml", help="Write what was found as a model, for apply and export."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT",
        help="Leave an effect out of the library; may be repeated.",
        autocompletion=effects_beginning,
    ),
]
Calibrate = Annotated[
    int,
    typer.Option(
        "--rehearse",
        "--calibrate",
        min=0,
        max=MOST_CASES,
        metavar="CASES",
        help="Diagnose so many simulated cases at the same rows, and recalibrate by them.",
    ),
]
Unlisted = Annotated[
    float | None,
    typer.Option(
        "--unlisted",
        metavar="P",
        help="Prior probability that a gap comes of what the library lacks, 0.2 unless given.",
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Diagnose even what another set-up explains far better.")
]


@with_report
def diagnose(
    out: Out,
    folders: Folders,
    held_out: HeldOutBy = "auto",
    seed: Seed = 0,
    also: Also = None,
    without: Without = None,
    calibrate: Calibrate = 0,
    model: ModelOut = None,
    unlisted: Unlisted = None,
    force: Force = False,
) -> None:
    """Say where a recording's gap lies, which effects cause it and how far it shrinks."""
    read = [*folders, *([also] if also is not None else [])]
    out.check(read, model=model)
    from plumbline.optim.loading import load_to_diagnose
    from plumbline.optim.recording.loading import open_folder
    from plumbline.optim.recording.session import is_session

    options = _options(held_out, seed, without or [], unlisted, force=force)
    folder, *more = folders
    outputs = Outputs(**vars(out), also=also, model=model)
    if more or is_session(folder):
        diagnose_several(folders, options, outputs, {"--rehearse": calibrate})
        return
    if open_folder(folder).settings.word("observation") in ("motion", "tracking"):
        diagnose_motion(folder, options, outputs, {"--rehearse": calibrate})
        return
    recording = load_to_diagnose(folder)
    if recording.element is not None:
        of_ct = recording.kind.fiducials
        refused = {"--also": also, "--model": not of_ct and model} if recording.stand_in else {}
        refuse_for_parts(recording, {**refused, "--rehearse": calibrate})
    other = None if also is None else load_to_diagnose(also)
    if other is not None:
        _check_same_robot(recording, other, force=force)
    diagnosis = _diagnosed(recording, options, quiet=outputs.silent)
    check = None
    if calibrate:
        check = _calibrated(diagnosis, calibrate, quiet=outputs.silent)
        diagnosis = replace(diagnosis, verdict=check.recalibrated)
    elsewhere = None if other is None else _elsewhere(diagnosis, other, force=force)
    content = _content(diagnosis, elsewhere, check)
    ranks = () if check is None else check.ranks
    outputs.hand_out_verdict(diagnosis, content, seed=seed, elsewhere=elsewhere, ranks=ranks)


def refuse_for_parts(recording: Recording, asked: Mapping[str, object]) -> None:
    """Refuse what a diagnosis of ranges or fiducials cannot give."""
    given = next((name for name, value in asked.items() if value), None)
    if given is not None:
        raise PlumblineError(
            f"{given}: {recording.observation} hold no arm to carry elsewhere, or cannot be "
            "simulated from, an arm's tips, poses, joints or efforts expected; leave it out"
        )


def _options(
    held_out: str, seed: int, without: Sequence[str], unlisted: float | None, *, force: bool
) -> DiagnosisOptions:
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.diagnosis.prior import UNLISTED

    prior = UNLISTED if unlisted is None else unlisted
    try:
        return DiagnosisOptions(held_out, seed, tuple(without), force=force, unlisted=prior)
    except PlumblineError as error:
        raise PlumblineError(f"--{error}") from None


def _diagnosed(recording: Recording, options: DiagnosisOptions, *, quiet: bool) -> Diagnosis:
    from plumbline.optim.diagnosis.diagnose import diagnose as diagnose_recording
    from plumbline.optim.diagnosis.predict.folds import fold_of_rows

    training = recording.training
    try:
        fold_of_rows(training, options.held_out, options.seed)
    except ValueError as error:
        raise PlumblineError(f"--held-out {options.held_out}: {error}") from None
    with progress_bar(quiet=quiet) as progress:
        return diagnose_recording(recording, options, progress=progress)


def _calibrated(diagnosis: Diagnosis, cases: int, *, quiet: bool) -> CalibrationCheck:
    from plumbline.optim.diagnosis.calibrate.check import check_calibration

    with progress_bar(quiet=quiet) as progress:
        return check_calibration(diagnosis, cases, progress=progress)


def _check_same_robot(recording: Recording, other: Recording, *, force: bool) -> None:
    """Refuse a second recording that the first one's model cannot predict."""
    from plumbline.optim.recording.session import placed_alike
    from plumbline.optim.recording.set_up import refuse_wrong_set_up

    for what, one, two in (
        ("joints", recording.chain.n, other.chain.n),
        ("observation", recording.observation, other.observation),
    ):
        if one != two:
            raise PlumblineError(
                f"--also {other.name}: {what} {two}, expected {one} as in {recording.name}; give a "
                "recording of the same robot"
            )
    if not placed_alike(recording.chain, other.chain):
        raise PlumblineError(
            f"--also {other.name}: robot {other.robot.name} with joints placed or turning "
            f"otherwise, expected {recording.robot.name} as in {recording.name}; give a recording "
            "of the same robot"
        )
    if not force:  # before the first one is diagnosed, which may take long
        refuse_wrong_set_up(other)


def _elsewhere(diagnosis: Diagnosis, other: Recording, *, force: bool) -> Elsewhere:
    from plumbline.experiments.report.diagnosis.phrases import Elsewhere
    from plumbline.optim.core.quantities import percent

    found = diagnosis.transfer(other, force=force)
    stays = ", ".join(found.left_out)
    note = f"not carried over, since it lacks what they need or they belong to one session: {stays}"
    outside = f"{percent(found.outside_share)} of its rows lie outside of the range that was fitted"
    notes = [*other.notes, *([note] if stays else []), *found.judged.failures]
    if found.outside_share:
        notes.append(outside)
    return Elsewhere(
        other.name, len(other), found.before, found.after, found.unit, tuple(notes),
        found.refitted, found.outside_share,
    )  # fmt: skip


def _content(
    diagnosis: Diagnosis, elsewhere: Elsewhere | None, check: CalibrationCheck | None
) -> dict[str, Any]:
    content = diagnosis.verdict.to_dict()
    if check is not None:
        content["calibration"] = check.to_dict()
    if elsewhere is not None:
        content["transfer"] = asdict(elsewhere)
    return content
