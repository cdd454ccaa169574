"""What a command says of its answer: its page on a terminal, or as a report."""

from pathlib import Path
from typing import Any

from plumbline.experiments.console.outputs import COMMAND, talks, write_json, write_text


def write_page(path: Path | None, answer: Any, **more: Any) -> None:
    """Write the report of an answer, with the date and the command; nothing if there is no path.

    Raises:
        PlumblineError: It cannot be written.
    """
    if path is None:
        return
    from plumbline.experiments.report.page.page import Made
    from plumbline.experiments.report.writing import report_html

    write_text(path, report_html(answer, Made.now(COMMAND.get()), **more), "--report")


def print_answer(answer: Any, **more: Any) -> None:
    """Print the words and tables of an answer's page."""
    from plumbline.experiments.report.page.words import print_page
    from plumbline.experiments.report.writing import page_of

    print_page(page_of(answer, **more))


def hand_out(
    answer: Any, content: Any, json: str | None, report: Path | None, quiet: bool, **more: Any
) -> None:
    """Write an answer's content as JSON and its page as a report, and print its words.

    Raises:
        PlumblineError: A file cannot be written.
    """
    write_json(json, content)
    write_page(report, answer, **more)
    if talks(json, quiet):
        print_answer(answer, **more)
