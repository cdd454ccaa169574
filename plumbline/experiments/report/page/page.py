"""A page's parts, and the HTML that they become: one file, nothing fetched, one script of ours.

Words of the data are escaped by the template, and none of them ever stands in the script: what a
scene shows is in an attribute, read as JSON.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from typing import TYPE_CHECKING, Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from plumbline.experiments.console.tables import table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKAGES = ("plumbline-robotics", "casadi", "pin", "numpy")
ROOM = "plumbline.experiments.report"
COLOURS = {  # of verdicts; legible on light and on dark
    "explained": "#00795a",
    "no-gap": "#00795a",
    "partly-explained": "#0072b2",
    "outside-library": "#b34700",
}
DAY = "--ink:#22262b;--muted:#6f757d;--faint:#b9bec5;--paper:#fff"  # as in style.css.j2
PICTURES = table(ROOM, "pictures.toml")


@dataclass(frozen=True)
class Made:
    """How a page was made; without a date and a command the same answer gives the same bytes."""

    date: str = ""  # when, in words
    command: str = ""  # the command line, if any

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
    """A table."""

    columns: Sequence[str]  # headings
    rows: Sequence[Sequence[str]]  # cells
    numbers: Sequence[int] = ()  # columns (from 0) of numbers
    sorts: bool = True  # whether a click on a heading sorts it


@dataclass(frozen=True)
class Part:
    """A heading with words, a table, points, and parts of its own."""

    title: str
    words: Sequence[str] = ()
    table: Grid | None = None
    points: Sequence[str] = ()
    most: int | None = None  # points that a terminal shows; all if not given
    on_paper: bool = False  # whether a terminal leaves it out
    note: str = ""  # what stands beside the title
    parts: Sequence[Part] = ()
    folded: bool = False  # whether it opens at a click; of a part of another one


@dataclass(frozen=True)
class View:
    """What a reader can turn."""

    scene: str  # its data as JSON


@dataclass(frozen=True, eq=False)
class Picture:
    """A finding and the figures that show it."""

    key: str  # A short name, unique on the page
    title: str  # the finding
    words: str  # what is to be seen
    figures: tuple[Figure, ...]  # the figures, side by side where there is room
    wide: bool = False  # whether each takes the page's full width
    last_wide: bool = False  # whether the last one does, being the scale of the others

    @classmethod
    def of(cls, name: str, *figures: Figure, **said: object) -> Picture:
        """One of ``pictures.toml``, with what is said in the place of its braces."""
        room, _, part = name.partition(".")
        told = {"key": part} | PICTURES[room][part]
        key, title, words = (told[which].format(**said) for which in ("key", "title", "words"))
        wide, last_wide = (told.get(which, False) for which in ("wide", "last_wide"))
        return cls(key, title, words, figures, wide, last_wide)

    def __repr__(self) -> str:
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
        from plumbline.experiments.report.style import svg

        label = html.escape(f"{picture.title}. {picture.words}", quote=True)
        drawn = [svg(one, f"{picture.key}{k}", label) for k, one in enumerate(picture.figures)]
        # The drawings are ours, their label is escaped; names inside were escaped by matplotlib.
        return cls(picture, tuple(Markup(text) for text in drawn))


# A picture may be one yet to be made, which a terminal never asks for.
Parts: TypeAlias = Sequence[Part | Picture | View | Callable[[], Picture]]


@dataclass(frozen=True, eq=False)
class Page:
    """What a method's answer says on paper."""

    name: str  # of the recording
    verdict: str  # in a word or two
    tone: str  # ``"explained"`` (good), ``"partly-explained"`` or ``"outside-library"`` (bad)
    lead: Sequence[str]  # what it means, in plain sentences
    tiles: Sequence[Tile]  # figures read first
    parts: Parts  # all else, in order
    warnings: Sequence[str] = ()  # what takes from the weight of every figure
    sha256: str = ""  # hash of the recording
    seed: int | None = None  # of random draws, if any
    sections: Sequence[Page] = ()  # pages below it, each of something of its own


def environment() -> Environment:
    """Templates by their path in the room of reports."""
    loader = PackageLoader("plumbline.experiments", "report")
    found = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    found.trim_blocks = found.lstrip_blocks = True
    return found


def page_html(page: Page, made: Made | None = None) -> str:
    """The page as HTML."""
    title, drawn = f"{page.name}: {page.verdict}", _Drawn(page)
    shown = {"sha256": page.sha256, "seed": page.seed, "made": made or Made(), "page": drawn}
    return environment().get_template("page/page.html.j2").render(title=title, **shown)


def card_html(page: Page) -> str:
    """What a page says as a compact piece of HTML that needs nothing else, its first part open."""
    said = [p for p in page.parts if isinstance(p, Part) and not p.on_paper]
    colour = COLOURS.get(page.tone, COLOURS["explained"])
    template = environment().get_template("page/card.html.j2")
    return " ".join(template.render(page=page, said=said, colour=colour).split())  # on one line


class _Drawn:
    """A page whose pictures are drawn."""

    def __init__(self, page: Page) -> None:
        self.page = page
        made = [p() if callable(p) else p for p in page.parts]
        self.parts = [Block.of(p) if isinstance(p, Picture) else p for p in made]
        self.sections = [_Drawn(section) for section in page.sections]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.page, name)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
