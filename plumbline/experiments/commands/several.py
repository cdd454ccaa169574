"""``plumbline diagnose FOLDER FOLDER2 ...``: several recordings of one robot, one verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumbline.experiments.commands.verdicts import Models, Outputs, refuse
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
    from plumbline.optim.diagnosis.of_any_kind import diagnose_several as diagnosed
    from plumbline.optim.loading import load_part

    refuse(asked, "several recordings")
    other = None if outputs.also is None else load_part(outputs.also)
    given = list(folders) if len(folders) > 1 else folders[0]
    with progress_bar(quiet=outputs.silent) as progress:
        found = diagnosed(given, options, progress=progress)
    content, lines = found.to_dict(), []
    if other is not None:
        tried = _tried(found, other)
        content, lines = content | {"also": tried.to_dict()}, [f"\n{tried.words}"]
    outputs.hand_out(found, content, lines, _models)


def _tried(found: Any, other: Any) -> Applied:
    from plumbline.optim.diagnosis.several.sections import Sections, tried

    return found.transfer(other) if isinstance(found, Sections) else tried(found, other)


def _models(found: Any, path: Path) -> Models:
    """The model of the first section, and those of others beside it, named by their kind."""
    from plumbline.optim.diagnosis.several.sections import Sections

    sections = found.sections if isinstance(found, Sections) else [found]
    made: dict[str, tuple[Path, Any]] = {"Model": (path, sections[0].model())}
    for one in sections[1:]:
        kind = one.recording.observation
        if getattr(one.recording, "stand_in", False) and kind != "fiducials":
            continue  # ranges from poses: there is none
        made[f"Model of {kind}"] = (path.with_stem(f"{path.stem}-{kind}"), one.model())
    return made
