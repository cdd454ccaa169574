"""A report of whatever a method answers with: one HTML file that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from plumbline.errors import PlumblineError
from plumbline.experiments.report.page.page import Made, Page, card_html, page_html
from plumbline.kinematics.files import new_file

if TYPE_CHECKING:
    from plumbline.experiments.report.diagnosis.phrases import Elsewhere
    from plumbline.optim.dh_fit.local import HeldOut

ROOM = "plumbline.experiments.report"
# Class of an answer -> who makes its page: a module, and its function if not ``page``
PAGES: dict[str, str] = {
    "Registration": "registration.page",
    "HandEye": "hand_eye.page",
    "ScanAnswer": "hand_eye.scan",
    "DHFit": "dh_fit.page",
    "Reproduction": "reproduction",
    "Budget": "budget.page",
    "Applied": "applied",
    "AngleMap": "pointing.page:map_page",
    "Sweep": "pointing.page:sweep_page",
    "Diagnosis": "diagnosis.page",
    "MotionDiagnosis": "diagnosis.page",
    "Sections": "diagnosis.page",
    "Verdict": "diagnosis.page:of_verdict",
}


class More(TypedDict, total=False):
    """What else the page of one kind of answer shows."""

    unseen: HeldOut | None  # of a fit of links: misfits of rows that no fit has seen
    files: Sequence[str]  # of a fit of links: lines on files that were written of it
    methods: Sequence[Mapping[str, Any]]  # of a registration: what other methods find
    transforms: Sequence[Mapping[str, Any]]  # of a registration: those found elsewhere, judged
    seed: int | None  # of a diagnosis, as its page shall tell it
    elsewhere: Elsewhere | None  # of a diagnosis: how its model does on another recording
    # of a diagnosis: true values of simulated cases by tenths of what was stated
    ranks: Sequence[int]
    proof: bool  # of a diagnosis: whether its files are read again by others; they are


def page_of(answer: Any, **more: Unpack[More]) -> Page:
    """The page of an answer of one of the methods (PlumblineError: there is none of such)."""
    name = type(answer).__name__
    if name not in PAGES:
        raise PlumblineError(
            f"report of a {name}: there is none, expected one of {', '.join(PAGES)}"
        )
    module, _, function = PAGES[name].partition(":")
    page: Callable[..., Page] = getattr(import_module(f"{ROOM}.{module}"), function or "page")
    return page(answer, **more)


def card_of(answer: Any) -> str:
    """The page of an answer as a card of HTML for notebooks."""
    return card_html(page_of(answer))


def report_html(answer: Any, made: Made | None = None, **more: Unpack[More]) -> str:
    """The report's text; the same answer gives the same bytes, unless it says when it was made.

    Args:
        answer: A diagnosis, a registration, a hand-eye calibration, a scan, a fit of links, a
            reproduction, a gap budget or a model that was tried elsewhere.
        made: When and by which command, if that shall stand there.
        **more: What else its page shows, see :class:`More`.

    Raises:
        PlumblineError: There is no report of such an answer.
    """
    return page_html(page_of(answer, **more), made)


def write_report(
    answer: Any, path: str | Path, made: Made | None = None, **more: Unpack[More]
) -> Path:
    """Write the report of an answer of any method.

    Args:
        answer: The answer.
        path: File to write; one that is there is replaced.
        made: When and by which command, if that shall stand there.
        **more: What else its page shows, see :class:`More`.

    Raises:
        PlumblineError: There is no report of such an answer, or it cannot be written.
    """
    target = Path(path)
    new_file(target, report_html(answer, made, **more), overwrite=True)
    return target
