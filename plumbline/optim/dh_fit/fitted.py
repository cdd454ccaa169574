r"""A fit of links, which judges itself from its statement: misfits, sums, noise, gross rows.

.. math:: \chi^2 = \sum_{i\ \text{not gross}} |e_i|^2 / \sigma^2

has as many degrees of freedom as there are coordinates less what was fitted, if links are all that
is wrong and the noise is what was stated.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaincinv, ndtri, stdtrit

from plumbline.kinematics.link_table import LinkTable
from plumbline.optim.core.constants import SIDES
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.dh_fit.constants import CHANCE, RESTING, STATED_WITHIN
from plumbline.optim.dh_fit.gross_rows import factor, gross_rows
from plumbline.optim.dh_fit.identify import Identifiability, triangle
from plumbline.optim.dh_fit.quantities import Misfit, Quantity, quantities, shares, sums
from plumbline.optim.dh_fit.softness import softness
from plumbline.optim.dh_fit.statement import DHStatement, Pass, Readings, Unknown
from plumbline.optim.dh_fit.task import DHOptions, LinkTask
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False, repr=False)
class Fitted:
    """The numbers of a fit, all of them worked out from its statement."""

    recording: Recording  # what it was fitted to, rows held out among them
    options: DHOptions  # what was asked for
    registration: Readings | None  # the four points that fix the frame, if they do
    identifiability: Identifiability  # what the poses can tell
    unknowns: tuple[Unknown, ...]  # what was free (P)
    x: Array  # the solution (P,)
    iterations: int  # steps that the solver took
    message: str  # what it says, in words; never used to judge
    nominal_x: Array  # the solution without link parameters: frame and tool alone

    @cached_property
    def task(self) -> LinkTask:
        """The recording as a problem of links."""
        return LinkTask.of(self.recording, self.options, self.registration)

    @cached_property
    def statement(self) -> DHStatement:
        """The problem."""
        return self.task.stated(self.unknowns)

    @cached_property
    def nominal_statement(self) -> DHStatement:
        """The problem without link parameters."""
        return self.task.stated(self.task.always)

    @property
    def readings(self) -> Readings:
        """The rows that it was fitted to."""
        return self.task.readings

    @cached_property
    def objective(self) -> float:
        """F at the solution, recomputed from the statement [m or m^2]."""
        return Pass(self.statement, self.readings).objective(self.x)

    @property
    def links(self) -> LinkTable:
        """The fitted links."""
        return self.statement.links(self.x)

    @property
    def tool(self) -> Array:
        """The fitted tip in the tip frame (3,) [m]."""
        return self.statement.tool_at(self.x)

    @property
    def T_robot_camera(self) -> Array:
        """The camera's frame in the robot's base (4, 4) [m]."""
        return self.statement.frame_at(self.x)

    def misfits(self, readings: Readings | None = None) -> Array:
        """Predicted minus measured (N, 3) [m], robot's frame, of the fitted rows or others."""
        return Pass(self.statement, readings or self.readings).misfits(self.x)

    def nominal_misfits(self, readings: Readings | None = None) -> Array:
        """The same of the nominal links, frame and tool fitted or registered as here."""
        return Pass(self.nominal_statement, readings or self.readings).misfits(self.nominal_x)

    @cached_property
    def before(self) -> Misfit:
        """Misfits of the nominal links."""
        return Misfit.of(self.nominal_misfits())

    @cached_property
    def after(self) -> Misfit:
        """Misfits of the fitted links, on the rows that they were fitted to."""
        return Misfit.of(self.misfits())

    @property
    def registered(self) -> tuple[Misfit, Misfit] | None:
        """Misfits of the registration points before and after, apart from what was fitted."""
        if self.registration is None:
            return None
        points = self.registration
        return Misfit.of(self.nominal_misfits(points)), Misfit.of(self.misfits(points))

    @cached_property
    def resting(self) -> Flags:
        """Which unknowns (P,) rest on a bound."""
        room = RESTING * self.statement.delta
        low, high = self.statement.lower + room, self.statement.upper - room
        return (self.x <= low) | (self.x >= high)

    @cached_property
    def gross(self) -> Flags:
        """Which of the fitted rows (N,) are grossly wrong."""
        return gross_rows(self.statement, self.readings, self.x, self._basis)

    @property
    def gross_rows(self) -> tuple[int, ...]:
        """The same as places in the recording, counted from 0."""
        flags = self.recording.held_out
        rows = np.arange(len(self.recording)) if flags is None else np.flatnonzero(~flags)
        return tuple(int(row) for row in rows[self.gross])

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the noise: coordinates that are not gross, less what was fitted."""
        return 3 * int((~self.gross).sum()) - len(self._basis)

    @cached_property
    def noise(self) -> float:
        """Noise of one axis, 1 sigma [m], from what the fit leaves of rows that are not gross."""
        left = float((self.misfits()[~self.gross] ** 2).sum())
        return float(np.sqrt(left / max(self.freedom, 1)))

    @property
    def chi_square(self) -> float | None:
        """Sum of squared misfits over the stated noise; None where none is stated."""
        stated = self.recording.noise_std
        return None if not stated else self.freedom * (self.noise / stated) ** 2

    @cached_property
    def agrees(self) -> bool | None:
        """Whether what the fit leaves is the stated noise; None where none is stated."""
        if self.chi_square is None:
            return None
        half = max(self.freedom, 1) / 2.0
        low, high = (2.0 * float(gammaincinv(half, p)) for p in (CHANCE, 1.0 - CHANCE))
        return bool(low / STATED_WITHIN**2 <= self.chi_square <= high * STATED_WITHIN**2)

    @cached_property
    def _basis(self) -> Indices:
        """Places of the unknowns that count as estimated, the others as held, in the statement."""
        known = self.identifiability
        kept = {known.unknowns[k].name for k in known.kept}
        free = [name in kept for name in self.statement.names]
        return np.flatnonzero(np.array(free, dtype=bool) & ~self.resting)

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns (P, P), others held; NaN where they rest on a bound or cannot be told."""
        free = self._basis
        found = np.full((self.statement.size, self.statement.size), np.nan)
        if not len(free):
            return found
        good = self.misfits()[~self.gross]
        S = good.T @ good * (3.0 / max(self.freedom, 1))
        stated = self.recording.noise_std
        if self.agrees and stated and 0.0 < self.noise < stated:
            S *= (stated / self.noise) ** 2  # few rows leave little by chance
        about = (self.statement, self.readings, self.x, free, S)
        rest = (self.statement, self.readings.select(~self.gross), self.x, free, S)
        F = np.hstack([factor(*about), softness(*rest, self.recording.robot.gravity)])
        F *= self.statement.scale[free, None]
        found[np.ix_(free, free)] = F @ F.T
        return found

    @property
    def std(self) -> Array:
        """Standard errors (P,), NaN where there are none."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Array:
        """Correlations (P, P) of the estimates, NaN where there are none."""
        return self.covariance / np.outer(self.std, self.std)

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """What the readings tell of links and tool: sums of parameters, in the chain's order."""
        known, place = self.identifiability, {n: k for k, n in enumerate(self.statement.names)}
        at = {u.name: k for k, u in enumerate(known.unknowns)}
        basis = [at[self.statement.names[k]] for k in self._basis]
        values = np.array([u.nominal for u in known.unknowns])
        for name, k in place.items():
            values[at[name]] = self.x[k]
        fitted = triangle(self.task.stated(self.task.asked), self.readings, values)
        found = sums(known.unknowns, basis, known.triangle, fitted)
        free = [place[known.unknowns[k].name] for k in found.leading]
        covariance = self.covariance[np.ix_(free, free)]
        reach95 = ndtri(SIDES[1]) if self.agrees else stdtrit(max(self.freedom, 1), SIDES[1])
        return tuple(quantities(found, values, covariance, float(reach95)))

    @cached_property
    def shares(self) -> dict[str, float]:
        """Share of the nominal squared misfit that each sum, and all ``together``, explains."""
        names, cells = self.statement.names, [u.cell for u in self.statement.unknowns]
        links = [k for k in self._basis if cells[k] is not None]
        fixed = [k for k in self._basis if cells[k] is None]
        rows = self.readings.select(~self.gross)
        before = self.nominal_misfits(rows)
        each, together = shares(self.statement, rows, self.x, before, fixed, links)
        about = {q.parts[0][0]: q.name for q in self.quantities}
        found = {about[names[k]]: float(s) for k, s in zip(links, each, strict=True)}
        return found | {"together": together}
