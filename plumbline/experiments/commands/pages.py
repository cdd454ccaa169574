"""The report that a command writes of its answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from plumbline.experiments.console.outputs import COMMAND, write_text


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
