"""``plumbline diagnose FOLDER FOLDER2 ...``: several recordings of one robot, one verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.motion import Outputs
from plumbline.experiments.commands.pages import write_page
from plumbline.experiments.console.outputs import check_new, talks, write_json
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.model import Applied


def diagnose_several(
    folders: Sequence[Path],
    options: DiagnosisOptions,
    outputs: Outputs,
    asked: Mapping[str, object],
) -> None:
    """Diagnose several recordings, or a session's folder, and hand out the verdict.

    Raises:
        PlumblineError: They cannot be used together, or are asked for what only one can answer.
    """
    from plumbline.optim.diagnosis.ask import diagnose_several as diagnosed
    from plumbline.optim.loading import load_part

    for option, value in asked.items():
        if value:
            raise PlumblineError(f"{option} {value}: not for several recordings; leave it out")
    other = None if outputs.also is None else load_part(outputs.also)
    given = list(folders) if len(folders) > 1 else folders[0]
    with progress_bar(quiet=outputs.silent) as progress:
        try:
            found = diagnosed(given, options, progress=progress)
        except PlumblineError:
            raise
        except ValueError as error:  # folds that a recording has no column for
            raise PlumblineError(f"--held-out {options.held_out}: {error}") from None
    tried = None if other is None else _tried(found, other)
    content = found.to_dict()
    write_json(outputs.json, content if tried is None else content | {"also": tried.to_dict()})
    write_page(outputs.report, found)
    models = {} if outputs.model is None else _models(found, outputs.model, outputs.overwrite)
    if talks(outputs.json, outputs.quiet):
        _print(found, tried, {"Report": outputs.report} | models)


def _tried(found: Any, other: Any) -> Applied:
    """How what was found does on another recording of one of its kinds."""
    from plumbline.optim.diagnosis.several.sections import Sections, tried

    return found.transfer(other) if isinstance(found, Sections) else tried(found, other)


def _models(found: Any, path: Path, overwrite: bool) -> dict[str, Path]:
    """Write the model of the first section, and those of others beside it, named by their kind.

    Raises:
        PlumblineError: One is there already, or cannot be written.
    """
    from plumbline.optim.diagnosis.several.sections import Sections

    sections = found.sections if isinstance(found, Sections) else [found]
    made: dict[str, tuple[Path, Any]] = {"Model": (path, sections[0].model())}
    for one in sections[1:]:
        if getattr(one.recording, "stand_in", False):
            continue  # of no arm: there is none
        kind = one.recording.observation
        made[f"Model of {kind}"] = (path.with_stem(f"{path.stem}-{kind}"), one.model())
    for target, _ in made.values():
        check_new(target, "--model", overwrite=overwrite)
    for target, model in made.values():
        model.save(target, overwrite=overwrite)
    return {name: target for name, (target, _) in made.items()}


def _print(found: Any, tried: Applied | None, files: Mapping[str, Path | None]) -> None:
    from rich.console import Console

    from plumbline.experiments.report.diagnosis.text import print_sections

    console = Console(highlight=False)
    print_sections(found, console)
    if tried is not None:
        console.print(f"\n{tried.words}", markup=False, soft_wrap=True)
    for name, path in files.items():
        if path is not None:
            console.print(f"\n{name}: {path}", markup=False, soft_wrap=True)
