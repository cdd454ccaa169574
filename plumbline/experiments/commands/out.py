"""Where a command's answer goes, and the options that say so: JSON, a report, words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from plumbline.experiments.console import outputs
from plumbline.experiments.console.outputs import COMMAND, Json, Overwrite, Quiet, Report


@dataclass(frozen=True)
class Out:
    """Where an answer goes."""

    json: str | None = None  # file of JSON, ``-`` for standard output
    report: Path | None = None  # file of HTML
    overwrite: bool = False  # whether files that are there are replaced
    quiet: bool = False  # whether nothing is printed

    @property
    def silent(self) -> bool:
        """Whether no words go to standard output, and no progress is shown."""
        return not outputs.talks(self.json, self.quiet)

    def check(
        self, folders: Sequence[Path] = (), inputs: Mapping[str, Path] | None = None, /,
        **more: Path | None,
    ) -> None:  # fmt: skip
        """Refuse files that cannot be written, and ``more`` of them, by their options' names."""
        files = {"json": self.json, "report": self.report, **more}
        named = {f"--{option}": path for option, path in files.items()}
        outputs.check_outputs(named, folders, inputs=inputs, overwrite=self.overwrite)

    def say(self, content: Any, words: str) -> None:
        """Write JSON, and print the same in words where those are wanted."""
        outputs.write_json(self.json, content)
        if not self.silent:
            print(words)

    def write_page(self, answer: Any, **more: Any) -> None:
        """Write the report of an answer, if one is asked for, with the date and the command."""
        if self.report is None:
            return
        from plumbline.experiments.report.page.page import Made
        from plumbline.experiments.report.writing import report_html

        text = report_html(answer, Made.now(COMMAND.get()), **more)
        outputs.write_text(self.report, text, "--report")

    def hand_out(self, answer: Any, content: Any, **more: Any) -> None:
        """Write an answer's content as JSON and its page as a report, and print its words."""
        outputs.write_json(self.json, content)
        self.write_page(answer, **more)
        if self.silent:
            return
        from plumbline.experiments.report.page.words import console, print_page
        from plumbline.experiments.report.writing import page_of

        print_page(page_of(answer, **more), console())


def with_out(command: Callable[..., None], *, report: bool = False) -> Callable[..., None]:
    """A command with options in place of its first parameter, an :class:`Out`."""
    options: dict[str, tuple[Any, Any]] = {"json": (Json, None)}
    options |= {"report": (Report, None)} if report else {}
    options |= {"overwrite": (Overwrite, False), "quiet": (Quiet, False)}

    @wraps(command)
    def run(**given: Any) -> None:
        command(Out(**{name: given.pop(name) for name in options}), **given)

    own = signature(command, eval_str=True)
    _, *every = own.parameters.values()
    every += [
        Parameter(name, Parameter.KEYWORD_ONLY, default=usual, annotation=kind)
        for name, (kind, usual) in options.items()
    ]
    vars(run)["__signature__"] = own.replace(parameters=every)
    run.__annotations__ = {one.name: one.annotation for one in every}
    return run


with_report = partial(with_out, report=True)
