"""How far a fit carries: every row predicted by a fit that has not seen it.

Folds are those of the diagnosis: sessions, stretches of time, blocks of the workspace, or single
rows. What is free, and what it can tell, is chosen anew without the fold. Links may be fitted in
the small space that matters, or over the whole workspace: both are asked inside of it and outside.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.dh_fit.fit import fit_dh
from plumbline.optim.dh_fit.quantities import Misfit
from plumbline.optim.dh_fit.statement import Readings
from plumbline.optim.dh_fit.task import DHOptions
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Misfits of rows that no fit has seen."""

    nominal: Array  # of the nominal links, frame and tool fitted without the rows (N, 3) [m]
    fitted: Array  # of links fitted without the rows (N, 3) [m]

    @property
    def before(self) -> Misfit:
        """Misfits of the nominal links."""
        return Misfit.of(self.nominal)

    @property
    def after(self) -> Misfit:
        """Misfits of the fitted links."""
        return Misfit.of(self.fitted)


def held_out(
    recording: Recording,
    options: DHOptions | None,
    fold: Indices,
    *,
    registration: Readings | None = None,
) -> HeldOut:
    """Fit without each fold (N,), and predict it; the rest is as for :func:`fit_dh`.

    Raises:
        PlumblineError: A fold leaves too few readings.
    """
    recording = replace(recording, held_out=None)
    rows = Readings(recording.q, recording.measured[:, :3])
    nominal, fitted = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    for k in np.unique(fold):
        out = fold == k
        fit = fit_dh(recording.select(~out), options, registration=registration)
        unseen = rows.select(out)
        nominal[out], fitted[out] = fit.nominal_misfits(unseen), fit.misfits(unseen)
    return HeldOut(nominal, fitted)


@dataclass(frozen=True, eq=False)
class Space:
    """A box in the robot's base frame."""

    lower: Array  # its lower corner (3,) [m]
    upper: Array  # its upper corner (3,) [m]

    @classmethod
    def about(cls, centre: ArrayLike, size: ArrayLike) -> Self:
        """From its middle (3,) and its edges (3,) [m]."""
        middle, half = np.asarray(centre, dtype=float), np.asarray(size, dtype=float) / 2.0
        return cls(middle - half, middle + half)

    def __post_init__(self) -> None:
        if self.lower.shape != (3,) or not (self.lower < self.upper).all():
            raise PlumblineError(
                f"space {self.lower.tolist()} to {self.upper.tolist()}: three lower corners below "
                "three upper ones expected, m"
            )

    def holds(self, points: Array) -> Flags:
        """Which points (N, 3) [m] lie in it."""
        return np.asarray(((points >= self.lower) & (points <= self.upper)).all(axis=1))


@dataclass(frozen=True)
class MisfitsOfLinks:
    """Misfits of one set of links: ``nominal``, fitted ``local`` or ``everywhere``."""

    fitted: str
    inside: Misfit
    outside: Misfit


@dataclass(frozen=True, eq=False)
class LocalGlobal:
    """Misfits of rows that no fit has seen."""

    tips: Array  # nominal tips in the robot's base (N, 3) [m]
    inside: Flags  # which rows lie in the space (N,)
    nominal: Array  # misfits of the nominal links (N, 3) [m], the frame fitted over the workspace
    local: Array  # of links fitted to rows inside (N, 3) [m]
    everywhere: Array  # of links fitted to all rows (N, 3) [m]

    @property
    def compared(self) -> tuple[MisfitsOfLinks, ...]:
        """Inside and outside, by what was fitted."""
        named = (("nominal", self.nominal), ("local", self.local), ("everywhere", self.everywhere))
        return tuple(
            MisfitsOfLinks(name, Misfit.of(values[self.inside]), Misfit.of(values[~self.inside]))
            for name, values in named
        )


def local_and_global(
    recording: Recording, space: Space, fold: Indices, options: DHOptions | None = None
) -> LocalGlobal:
    """Fit inside of a space in the robot's base and everywhere, and predict rows left out.

    Raises:
        PlumblineError: All rows lie inside or all outside, or too few of them do.
    """
    recording = replace(recording, held_out=None)
    tips = recording.chain.tips(recording.q, recording.tool_offset)
    inside = space.holds(tips)
    if inside.all() or not inside.any():
        raise PlumblineError(
            f"{recording.name}: {int(inside.sum())} of {len(inside)} tips in the space, some but "
            f"not all expected; they reach from {tips.min(axis=0).round(3).tolist()} to "
            f"{tips.max(axis=0).round(3).tolist()} m"
        )
    rows = Readings(recording.q, recording.measured[:, :3])
    nominal, local, everywhere = (np.empty((len(rows), 3)) for _ in range(3))
    for k in np.unique(fold):
        out = fold == k
        unseen = rows.select(out)
        everyone = fit_dh(recording.select(~out), options)
        nominal[out], everywhere[out] = everyone.nominal_misfits(unseen), everyone.misfits(unseen)
        local[out] = fit_dh(recording.select(~out & inside), options).misfits(unseen)
    return LocalGlobal(tips, inside, nominal, local, everywhere)
