"""Sentences about other recordings, gross rows and rows to come."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plumbline.errors import listed
from plumbline.optim.core.quantities import counted, quantity
from plumbline.optim.recording.table import HEADER

LIKELY = 0.01  # probability from which a rival is worth a bar, or a line
ROWS_NAMED = 40  # distrusted rows that are named one by one


@dataclass(frozen=True)
class Elsewhere:
    """How the fitted model does on another recording."""

    recording: str  # name of that recording
    rows: int  # number of its rows
    before: float  # RMS without the causes [unit]
    after: float  # RMS with them, frame and tool alone fitted again [unit]
    unit: str  # ``"m"`` or ``"rad"``
    notes: tuple[str, ...] = ()  # what else is to be known about it
    refitted: tuple[str, ...] = ("frame", "tool")  # what was fitted again
    outside_range: float = 0.0  # share of its rows outside of the range that was fitted

    @property
    def words(self) -> str:
        """The finding in a sentence."""
        before, after = (quantity(v, self.unit) for v in (self.before, self.after))
        again = " and ".join(self.refitted) or "nothing"
        notes = "".join(f" Note: {note}." for note in self.notes)
        return (
            f"On {self.recording} ({counted(self.rows, 'row')}), with only {again} fitted "
            f"again: {before} without the causes, {after} with them.{notes}"
        )


def distrusted_words(rows: Sequence[int]) -> str:
    """Which rows were left out as gross errors; empty if none."""
    if not rows:
        return ""
    was = "was" if len(rows) == 1 else "were"
    said = f"{counted(len(rows), 'row')} {was} taken for gross errors"
    return f"{said}, {HEADER}: {listed(rows, ROWS_NAMED)}."


def suggestion_words(entry: Mapping[str, object]) -> str:
    """A suggestion of what to record next, key by key."""
    return "; ".join(f"{key.replace('_', ' ')}: {_shown(value)}" for key, value in entry.items())


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(_shown(item) for item in value)
    return str(value)
