"""``plumbline diagnose FOLDER FOLDER2 ...``: several recordings of one robot, one verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.motion import Outputs
from plumbline.experiments.commands.pages import write_page
from plumbline.experiments.console.outputs import talks, write_json
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.options import DiagnosisOptions


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
    from rich.console import Console

    from plumbline.experiments.report.diagnosis.text import print_verdict
    from plumbline.optim.diagnosis.ask import diagnose, session_of
    from plumbline.optim.recording.session_files import load_session

    for option, value in asked.items():
        if value:
            raise PlumblineError(f"{option} {value}: not for several recordings; leave it out")
    session = load_session(folders[0]) if len(folders) == 1 else session_of(folders)
    with progress_bar(quiet=outputs.silent) as progress:
        try:
            found = diagnose(session, options, progress=progress)
        except ValueError as error:  # folds that a recording has no column for
            raise PlumblineError(f"--held-out {options.held_out}: {error}") from None
    write_json(outputs.json, found.to_dict())
    write_page(outputs.report, found)
    if outputs.model is not None:
        found.model().save(outputs.model, overwrite=outputs.overwrite)
    if talks(outputs.json, outputs.quiet):
        console = Console(highlight=False)
        print_verdict(found.verdict, console)
        for name, path in (("Report", outputs.report), ("Model", outputs.model)):
            if path is not None:
                console.print(f"\n{name}: {path}", markup=False, soft_wrap=True)
