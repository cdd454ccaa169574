"""The published methods made again: a paper's figures beside ours, one file a paper.

Each file has ``run(seed, progress=None)``, which returns a :class:`Reproduction`; a new paper is
one file and one table in ``papers.toml``.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Self

from plumbline.experiments.console.tables import table
from plumbline.optim.core.progress import Progress

ABOUT = table("plumbline.experiments.reproduce", "papers.toml")
# Name on the command line: module of this package.
PAPERS: Mapping[str, str] = {name: told["module"] for name, told in ABOUT.items()}


@dataclass(frozen=True)
class Table:
    """One table in words: a title, headings, rows of cells."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(
        cls, name: str, rows: Iterable[Iterable[str]], more: Iterable[str] = (), **values: object
    ) -> Self:
        """One of ``papers.toml``, with ``more`` headings and values in the place of its braces."""
        paper, _, which = name.partition(".")
        title, *heads = ABOUT[paper]["tables"][which]
        return cls(title.format(**values), (*heads, *more), tuple(map(tuple, rows)))


@dataclass(frozen=True)
class Compared:
    """Figures that a picture shows on one scale: ours, and the paper's where it gives one."""

    title: str  # the finding
    rows: tuple[tuple[str, Mapping[str, Any]], ...]  # by name; see :func:`figure`


@dataclass(frozen=True)
class Reproduction:
    """A paper's figures beside ours."""

    title: str  # what is reproduced
    source: str  # the paper, as one cites it
    figures: dict[str, Any]  # our figures by name, ready for JSON; see :func:`figure`
    tables: tuple[Table, ...]  # the same for people
    # what must be known to read them: what was simulated, which data are lost
    notes: tuple[str, ...] = ()
    said: str = ""  # the verdict in plain words
    compared: tuple[Compared, ...] = ()  # what is shown in pictures

    @classmethod
    def of(
        cls, paper: str, figures: dict[str, Any], tables: Iterable[Table], **values: object
    ) -> Self:
        """That of a paper, with these values in the place of its notes' braces."""
        told = ABOUT[paper]
        notes = tuple(note.format(**values) for note in told["notes"])
        return cls(told["title"], told["source"], figures, tuple(tables), notes)

    def to_dict(self) -> dict[str, Any]:
        """For JSON: the figures at the top level, beside title, source and notes."""
        about = {"title": self.title, "source": self.source, "notes": list(self.notes)}
        return {**about, **self.figures}


def figure(value: float, unit: str, paper: float | None = None, **more: Any) -> dict[str, Any]:
    """One figure for JSON: its value and unit, the paper's where it gives one, and what else."""
    found: dict[str, Any] = {"value": float(value), "unit": unit}
    if paper is not None:
        found["paper"] = paper
    return {**found, **more}


def reproduce(paper: str, seed: int = 0, progress: Progress | None = None) -> Reproduction:
    """Run one paper's reproduction.

    Raises:
        KeyError: No such paper; see :data:`PAPERS`.
    """
    module = import_module(f"plumbline.experiments.reproduce.{PAPERS[paper]}")
    found: Reproduction = module.run(seed, progress)
    return found
