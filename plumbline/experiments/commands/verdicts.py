"""Where a verdict goes, whatever was recorded: JSON, a report, a model, words; that on several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out
from plumbline.experiments.console.outputs import check_new, write_json
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.model import Applied

Models = Mapping[str, tuple[Path, Any]]  # by what it is called: its file, and what is written


def one_model(answer: Any, path: Path) -> Models:
    """The model of one diagnosis."""
    return {"Model": (path, answer.model())}


@dataclass(frozen=True)
class Outputs(Out):
    """Where a verdict goes."""

    also: Path | None = None  # folder of another recording of the same robot
    model: Path | None = None  # file of what was found, for apply and export

    def hand_out_verdict(
        self,
        answer: Any,
        content: Mapping[str, Any],
        lines: Iterable[str] = (),
        models: Callable[[Any, Path], Models] = one_model,
        **page: Any,
    ) -> None:
        """Write and print an answer.

        Args:
            answer: A verdict with all that is behind it.
            content: The same for JSON.
            lines: What is printed below the verdict.
            models: What is written of it as models.
            **page: What else its page shows.

        Raises:
            PlumblineError: A file cannot be written, or a model is there already.
        """
        write_json(self.json, content)
        self.write_page(answer, **page)
        made = {} if self.model is None else models(answer, self.model)
        for path, _ in made.values():
            check_new(path, "--model", overwrite=self.overwrite)
        for path, model in made.values():
            model.save(path, overwrite=True)
        if self.silent:
            return
        from rich.console import Console

        from plumbline.experiments.report.diagnosis.page import in_words
        from plumbline.experiments.report.page.words import print_page

        console = Console(highlight=False)
        print_page(in_words(answer, page.get("elsewhere")), console)
        files = {"Report": self.report} | {name: path for name, (path, _) in made.items()}
        named = (f"\n{name}: {path}" for name, path in files.items() if path is not None)
        for line in (*lines, *named):
            console.print(line, markup=False, soft_wrap=True)


def refuse(asked: Mapping[str, object], what: str) -> None:
    """Refuse options that one kind of recording has no answer to."""
    for option, value in asked.items():
        if value:
            raise PlumblineError(f"{option} {value}: not for {what}; leave it out")


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
    outputs.hand_out_verdict(found, content, lines, _models)


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
