"""What a gap budget says: parts that sum to one, now and after the cure, and what to mend first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.errors import fault
from plumbline.optim.budget.constants import ROUNDING
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.quantities import percent, quantity

COLUMNS = ("link", "alone", "share", "95 %", "cured", "share then", "95 % then", "to gain")


@dataclass(frozen=True)
class Part:
    """One link of the chain."""

    name: str  # its name
    # its share of the mean square error, covariances with others in halves; of links that
    # compensate each other it may be below nought
    share: float
    interval: tuple[float, float]  # 95 % of the shares that its own uncertainty allows
    rms: float  # RMS of its own error, were it alone [m]
    rms_after: float  # the same after the cure [m]
    share_after: float  # its share after all cures
    interval_after: tuple[float, float]  # 95 % of that
    # by how much the RMS falls if this link alone is mended, or taken away where nothing mends it
    # [m]
    gain: float
    curable: bool  # whether something mends it
    origin: str = ""  # where its figures are from


@dataclass(frozen=True)
class Budget(Answer):
    """Who contributes how much to the error."""

    parts: tuple[Part, ...]  # the links in the order of the chain
    rms: float  # RMS of the error now [m]
    interval: tuple[float, float]  # 95 % of it [m]
    rms_after: float  # RMS after all cures [m]
    interval_after: tuple[float, float]  # 95 % of it [m]
    points: int  # at how many points it was taken

    @property
    def first(self) -> tuple[Part, ...]:
        """What to mend first: links by how far the error falls."""
        return tuple(sorted(self.parts, key=lambda part: -part.gain))

    def to_gain(self, length: float = 1e-4) -> dict[str, float]:
        """What each link must come down to, alone, for the whole to fall by so much [m].

        Args:
            length: By how much the RMS shall fall [m].

        Returns:
            RMS of the link's own error by its name, the one that must fall least first; links that
            cannot do it alone are left out.

        Raises:
            PlumblineError: No length between nought and the error now.
        """
        if not 0.0 < length < self.rms:
            raise fault("budget", f"{length} m", f"0 to {self.rms:.3g} m", "ask for another gain")
        scales = {part.name: _scale(part, self.rms, length) for part in self.parts}
        can = {name: s for name, s in scales.items() if s is not None}
        own = {part.name: part.rms for part in self.parts}
        return {name: can[name] * own[name] for name in sorted(can, key=lambda n: -can[n])}

    def next_step(self, length: float = 1e-4) -> str:
        """The same in words."""
        if not 0.0 < length < self.rms:
            return f"All of it is less than {quantity(length, 'm')}."
        now = {part.name: part.rms for part in self.parts}
        ways = [
            f"{name} from {quantity(now[name], 'm')} to {quantity(goal, 'm')}"
            for name, goal in self.to_gain(length).items()
        ]
        return (
            f"For the next {quantity(length, 'm')}: " + (", or ".join(ways) or "no link alone will")
        ) + "."

    @property
    def judged(self) -> Judgement:
        """Nothing is solved here: sums alone."""
        return Judgement()

    @property
    def headline(self) -> str:
        """The error now and after, and what to mend first."""
        sizes = " -> ".join(quantity(v, "m") for v in (self.rms, self.rms_after))
        return f"{sizes}; mend {self.first[0].name[:60]} first ({percent(self.first[0].share)})"

    def __repr__(self) -> str:
        """The headline with the number of links."""
        return f"<Budget of {len(self.parts)} links: {self.headline}>"

    def table(self) -> str:
        """The links as lines of plain text."""
        rows = [COLUMNS, *(row_of(part) for part in self.parts)]
        whole = (quantity(self.rms, "m"), "100 %", "", quantity(self.rms_after, "m"), "100 %")
        rows.append(("all", *whole, "", ""))
        widths = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
        return "\n".join(
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )


def _scale(part: Part, rms: float, length: float) -> float | None:
    """The share of its own error that a link may keep; None if it cannot save that alone."""
    own, square = part.rms**2, rms**2
    cross = part.share * square - own  # with all other links
    # own s^2 + 2 cross s + rest = goal, at the root below one that is nearest to it
    roots = np.roots([own, 2.0 * cross, square - own - 2.0 * cross - (rms - length) ** 2])
    fit = [float(z.real) for z in roots if abs(z.imag) < ROUNDING and 0.0 <= z.real < 1.0]
    return max(fit, default=None)


def row_of(part: Part) -> tuple[str, ...]:
    """A link as the cells of :data:`COLUMNS`."""
    now, then = (" to ".join(map(percent, v)) for v in (part.interval, part.interval_after))
    after = quantity(part.rms_after, "m") if part.curable else "no cure"
    own = (part.name, quantity(part.rms, "m"), percent(part.share), now, after)
    return (*own, percent(part.share_after), then, quantity(part.gain, "m"))
