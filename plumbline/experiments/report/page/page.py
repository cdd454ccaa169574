"""A page's parts, and the HTML that they become: one file, nothing fetched, one script of ours.

Words of the data are escaped by the template, and none of them ever stands in the script: what a
scene shows is in an attribute, read as JSON.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from plumbline.experiments.report.style import svg

PACKAGES = ("plumbline-robotics", "casadi", "pin", "numpy")
ROOM = "plumbline.experiments.report"
DAY = "--ink:#22262b;--muted:#6f757d;--faint:#b9bec5;--paper:#fff"  # as in style.css.j2


@dataclass(frozen=True)
class Made:
    """How a page was made; without a date and a command the same answer gives the same bytes.

    Attributes:
        date: When, in words.
        command: The command line, if any.
    """

    date: str = ""
    command: str = ""

    @classmethod
    def now(cls, command: str = "") -> Made:
        """Made at this moment."""
        return cls(datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z").strip(), command)

    @property
    def versions(self) -> tuple[tuple[str, str], ...]:
        """Packages that the figures depend on, with their versions."""
        return tuple((name, _version(name)) for name in PACKAGES)


@dataclass(frozen=True)
class Tile:
    """A figure that is read first."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes:
        columns: Headings.
        rows: Cells.
        numbers: Columns (from 0) of numbers.
        sorts: Whether a click on a heading sorts it.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    sorts: bool = True


@dataclass(frozen=True)
class Part:
    """A heading with words, a table, points."""

    title: str
    words: Sequence[str] = ()
    table: Grid | None = None
    points: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Picture:
    """A finding and the figures that show it.

    Attributes:
        key: A short name, unique on the page.
        title: The finding.
        words: What is to be seen.
        figures: The figures, side by side where there is room.
        wide: Whether each takes the page's full width.
        last_wide: Whether the last one does, being the scale of the others.
    """

    key: str
    title: str
    words: str
    figures: tuple[Figure, ...]
    wide: bool = False
    last_wide: bool = False

    def __repr__(self) -> str:
        """The finding."""
        return f"<Picture {self.key!r}: {self.title[:200]}>"

    def _repr_html_(self) -> str:
        """The same for a notebook: on white paper, in the colours of the page by day."""
        block = Block.of(self)
        panels = "".join(f'<div style="flex:1 1 18rem">{drawn}</div>' for drawn in block.drawings)
        return (
            f'<div style="background:#fff;color:#22262b;padding:.6rem;{DAY}"><b>'
            f"{html.escape(self.title)}</b><p>{html.escape(self.words)}</p>"
            f'<div style="display:flex;flex-wrap:wrap;gap:1rem">{panels}</div></div>'
        )


@dataclass(frozen=True)
class Block:
    """One picture as the page shows it."""

    picture: Picture
    drawings: tuple[Markup, ...]

    @classmethod
    def of(cls, picture: Picture) -> Block:
        """The picture with its drawings as SVG."""
        label = html.escape(f"{picture.title}. {picture.words}", quote=True)
        drawn = [
            svg(figure, f"{picture.key}{k}", label) for k, figure in enumerate(picture.figures)
        ]
        # The drawings are ours, their label is escaped; names inside were escaped by matplotlib.
        return cls(picture, tuple(Markup(text) for text in drawn))


@dataclass(frozen=True, eq=False)
class Page:
    """What a method's answer says on paper.

    Attributes:
        name: Of the recording.
        verdict: In a word or two.
        tone: ``"explained"`` (good), ``"partly-explained"`` or ``"outside-library"`` (bad).
        lead: What it means, in plain sentences.
        tiles: Figures read first.
        parts: All else, in order.
        warnings: What takes from the weight of every figure.
        sha256: Hash of the recording.
        seed: Of random draws, if any.
    """

    name: str
    verdict: str
    tone: str
    lead: Sequence[str]
    tiles: Sequence[Tile]
    parts: Sequence[Part | Picture]
    warnings: Sequence[str] = ()
    sha256: str = ""
    seed: int | None = None


def environment() -> Environment:
    """Templates by their path in the room of reports."""
    return Environment(
        loader=FunctionLoader(_template),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _template(name: str) -> str:
    return (files(ROOM) / name).read_text(encoding="utf-8")


def page_html(page: Page, made: Made | None = None) -> str:
    """The page as HTML."""
    shown: dict[str, Any] = {
        "title": f"{page.name}: {page.verdict}",
        "sha256": page.sha256,
        "seed": page.seed,
        "made": made or Made(),
        "page": _Drawn(page),
    }
    return environment().get_template("page/page.html.j2").render(**shown)


class _Drawn:
    """A page whose pictures are drawn."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.parts = [Block.of(p) if isinstance(p, Picture) else p for p in page.parts]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.page, name)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
