"""What the cases of a sweep came to, and how any two factors bear on a figure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.optim.core.quantities import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFUSED = "refused"
MOST_LEVELS = 8  # values of a factor of which each is a line; of more, quarters of the cases are
LENGTHS = ("error", "expected", "misfit", "clearance", "noise")  # [m]
TIMES = ("step_p50", "step_p99")  # [s]
GAPS = ("before", "after")  # in the verdict's own unit
FIGURE_UNITS = {**dict.fromkeys(LENGTHS, "m"), **dict.fromkeys(TIMES, "s")}
QUANTILES = (0.25, 0.5, 0.75)  # that part them


class Case(Protocol):
    """The options of one case: frozen, so that it is a key."""

    def to_dict(self) -> dict[str, Any]:
        """For JSON and tables."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What one case came to."""

    case: Any  # its options, a Case
    found: Mapping[str, Any]  # figures by name, numbers in SI units
    reason: str = ""  # why it was refused

    @classmethod
    def refusal(cls, case: Case, reason: str) -> Outcome:
        """A case whose options make none."""
        return cls(case, {"verdict": REFUSED}, reason)

    @property
    def verdict(self) -> str:
        """The verdict; ``refused`` where options do not fit, empty of a method without any."""
        return str(self.found.get("verdict", ""))

    @property
    def cause(self) -> str:
        """Label of the first cause, empty if there is none."""
        return str(self.found.get("cause", ""))

    def to_dict(self) -> dict[str, Any]:
        """For JSON and tables: the options, then what was found."""
        return {**self.case.to_dict(), **self.found, "reason": self.reason}


@dataclass(frozen=True)
class Crossed:
    """A figure by two factors: medians of numbers, shares of what is true or not."""

    rows: str  # the factor down
    columns: str  # the factor across
    figure: str  # what is shown
    down: tuple[str, ...]  # levels of the one
    across: tuple[str, ...]  # levels of the other
    values: tuple[tuple[float, ...], ...]  # (rows, columns); nan where there is no case
    cases: tuple[tuple[int, ...], ...]  # how many each rests on
    unit: str = ""  # of the values, where they have one

    @property
    def of(self) -> str:
        """What the values are, in words."""
        return f"{self.named} by {self.rows} and {self.columns}: median, or share of cases"

    @property
    def named(self) -> str:
        """The figure with its unit."""
        return f"{self.figure} [{self.unit}]" if self.unit else self.figure

    def plot(self) -> Figure:
        """The table as a picture, each field with its value."""
        from matplotlib.figure import Figure

        beside = 0.1 * max(len(level) for level in self.down)  # a letter's width [in]
        size = (2.8 + beside + 0.8 * len(self.across), 1.8 + 0.45 * len(self.down))
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.add_subplot()
        values = np.array(self.values)
        image = axes.imshow(values, aspect="auto", cmap="cividis")
        middle = 0.5 * (np.nanmin(values) + np.nanmax(values))
        for (i, j), value in np.ndenumerate(values):
            if np.isfinite(value):
                ink = "black" if value > middle else "white"
                axes.text(j, i, f"{value:.3g}", ha="center", va="center", color=ink)
        axes.set_xticks(range(len(self.across)), self.across)
        axes.set_yticks(range(len(self.down)), self.down)
        axes.set(xlabel=self.columns, ylabel=self.rows)
        figure.colorbar(image, ax=axes, label=self.named)
        return figure


@dataclass(frozen=True)
class Sweep:
    """All outcomes of a sweep, in the order of its cases."""

    recording: str  # name of the recording, or of the reality and the method
    sha256: str  # hash of its files, empty of a reality
    outcomes: tuple[Outcome, ...]  # one a case
    varied: tuple[str, ...] = field(default=())  # options of which there is more than one value

    def __repr__(self) -> str:
        return f"<Sweep over {self.recording[:60]}: {self.agreement}>"

    @property
    def agreement(self) -> str:
        """How many cases say the same, in words."""
        told = [o for o in self.outcomes if o.verdict != REFUSED]
        of, out = len(told), len(self.outcomes) - len(told)
        refused = f"; {out} of {len(self.outcomes)} refused" if out else ""
        if not any(o.verdict for o in told):
            return f"{counted(of, 'case')}{refused}"
        kind, often = Counter(o.verdict for o in told).most_common(1)[0]
        cause, led = Counter(o.cause for o in told).most_common(1)[0]
        said = f"{kind} in {often} of {of}; first {cause or 'no cause'} in {led} of {of}"
        said += refused
        judged = [o.found["right"] for o in self.outcomes if "right" in o.found]
        return f"{said}; right in {sum(judged)} of {len(judged)}" if judged else said

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of what can be set out by two factors: numbers, and what is true or not."""
        kinds = (bool, int, float)
        named = (k for o in self.outcomes for k, v in o.found.items() if isinstance(v, kinds))
        return tuple(dict.fromkeys(named))

    def has(self, figure: str) -> bool:
        """Whether cases have a figure; refused if the ones that were not refused lack it."""
        there = list(dict.fromkeys(k for o in self.outcomes if not o.reason for k in o.found))
        if there and figure not in there:
            _known("figure", figure, self.figures)
        return bool(there)

    def table(self, rows: str, columns: str, figure: str | None = None) -> Crossed:
        """A figure by two factors.

        Args:
            rows: The factor down; of more than eight values, quarters of the cases.
            columns: The factor across, likewise.
            figure: One of :attr:`figures`; the first unless given (``right`` where it is there).

        Raises:
            PlumblineError: No such factor or figure.
        """
        first = "right" if "right" in self.figures else next(iter(self.figures), "")
        figure = figure or first
        _known("figure", figure, self.figures)
        options = [o.case.to_dict() for o in self.outcomes]
        for name in (rows, columns):
            _known("factor", name, list(options[0]))
        of_rows, of_columns = (_levels([o[name] for o in options]) for name in (rows, columns))
        cells: dict[tuple[str, str], list[float]] = {}
        for outcome, option in zip(self.outcomes, options, strict=True):
            value = outcome.found.get(figure)
            if value is not None:
                place = of_rows.of(option[rows]), of_columns.of(option[columns])
                cells.setdefault(place, []).append(float(value))
        share = all(isinstance(o.found.get(figure, True), bool) for o in self.outcomes)
        middle = np.mean if share else np.median
        at = [[cells.get((r, c), []) for c in of_columns.names] for r in of_rows.names]
        return Crossed(
            rows, columns, figure, of_rows.names, of_columns.names,
            tuple(tuple(float(middle(v)) if v else float("nan") for v in line) for line in at),
            tuple(tuple(map(len, line)) for line in at), self._unit(figure),
        )  # fmt: skip

    def _unit(self, figure: str) -> str:
        """A figure's unit; of a gap that which all verdicts tell it in."""
        gaps = {str(o.found.get("unit", "m")) for o in self.outcomes if figure in o.found}
        of_gap = gaps.pop() if figure in GAPS and len(gaps) == 1 else ""
        return FIGURE_UNITS.get(figure, of_gap)

    def plot(self, rows: str, columns: str, figure: str | None = None) -> Figure:
        """The picture of :meth:`table`."""
        return self.table(rows, columns, figure).plot()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "recording": self.recording,
            "sha256": self.sha256,
            "cases": [outcome.to_dict() for outcome in self.outcomes],
        }


def _known(what: str, name: str, known: Sequence[str]) -> None:
    if name not in known:
        expected = f"one of {', '.join(known) or 'none here'}"
        raise fault(what, shown(name), expected, f"best matches: {best_matches(name, known)}")


@dataclass(frozen=True)
class _Levels:
    names: tuple[str, ...]
    of: Callable[[Any], str]


def _levels(values: Sequence[Any]) -> _Levels:
    """The values of a factor as lines of a table."""
    few = list(dict.fromkeys(map(_word, values)))
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if len(few) <= MOST_LEVELS or not numbers:
        if numbers:
            few.sort(key=float)
        return _Levels(tuple(few), _word)
    cuts = np.quantile(np.array(values, dtype=float), QUANTILES)
    ends = [min(values), *cuts, max(values)]
    names = [f"{a:.3g} to {b:.3g}" for a, b in pairwise(ends)]
    return _Levels(tuple(names), lambda value: names[int(np.searchsorted(cuts, value))])


def _word(value: Any) -> str:
    if value is None:
        return "all"
    if isinstance(value, list | tuple):
        return " ".join(value) or "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
