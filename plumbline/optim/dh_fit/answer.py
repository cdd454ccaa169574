r"""A fit of links, which judges itself from its statement: misfits, sums, noise, gross rows.

.. math:: \chi^2 = \sum_{i\ \text{not gross}} |e_i|^2 / \sigma^2

has as many degrees of freedom as there are coordinates less what was fitted, if links are all that
is wrong and the noise is what was stated. What is reported are ``quantities``: sums of parameters
that the readings tell, most of one term. Lengths are in m, angles in rad, None where nothing is
known.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import gammaincinv, ndtri, stdtrit

from plumbline.kinematics.link_table import LinkTable
from plumbline.optim.core.answer import Answer, plain
from plumbline.optim.core.constants import FEASIBLE, SIDES, STILL
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.dh_fit.constants import CHANCE, RESTING, ROUNDING, STATED_WITHIN
from plumbline.optim.dh_fit.gross_rows import factor, gross_rows
from plumbline.optim.dh_fit.identify import Held, Identifiability, triangle
from plumbline.optim.dh_fit.quantities import (
    DHParameter,
    Misfit,
    Quantity,
    Status,
    quantities,
    shares,
    sums,
)
from plumbline.optim.dh_fit.softness import softness
from plumbline.optim.dh_fit.solvers import promised_drop
from plumbline.optim.dh_fit.statement import DHStatement, Pass, Readings, Unknown
from plumbline.optim.dh_fit.task import DHOptions, LinkTask, readings_of
from plumbline.optim.recording import storing as storing
from plumbline.optim.recording.constants import ASKED, FIRST_ROW
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible

UNITS = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}


@dataclass(frozen=True, eq=False, repr=False)
class DHFit(Answer):
    """A fit, which judges itself: all its numbers are worked out from its statement."""

    recording: Recording  # what it was fitted to, rows held out among them
    options: DHOptions  # what was asked for
    registration: Readings | None  # the four points that fix the frame, if they do
    identifiability: Identifiability  # what the poses can tell
    unknowns: tuple[Unknown, ...]  # what was free (P)
    x: Array  # the solution (P,)
    iterations: int  # steps that the solver took
    message: str  # what it says, in words; never used to judge
    nominal_x: Array  # the solution without link parameters: frame and tool alone

    def __repr__(self) -> str:
        sizes = f"mean misfit {1e3 * self.before.mean:.3g} mm -> {1e3 * self.after.mean:.3g} mm"
        shape = f"{len(self.readings)} rows, {self.statement.size} unknowns"
        return f"<DHFit of {self.recording.name[:60]}: {shape}; {sizes}>"

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
        drawn = [u.nominal if u.cell else v for u, v in zip(known.unknowns, values, strict=True)]
        about = self.task.stated(self.task.asked), self.readings
        triangles = (triangle(*about, at) for at in (np.array(drawn), values))
        found = sums(known.unknowns, basis, *triangles)
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

    def to_dict(self) -> dict[str, Any]:
        """Every figure; rows not seen and files, which are made of it, have their place."""
        registered = self.registered
        chi_square = None
        if self.chi_square is not None:
            chi_square = {"value": self.chi_square, "freedom": self.freedom, "agrees": self.agrees}
        found: dict[str, Any] = plain(
            {
                "name": self.recording.name,
                "robot": self.recording.robot.name,
                "rows": len(self.readings),
                "unit": "m",
                "objective": {"name": self.options.loss.name, "value": self.objective},
                "solver": {"name": self.solver, "iterations": self.iterations},
                "frame": self.options.frame,
                "before": self.before.numbers,
                "after": self.after.numbers,
                "held_out": None,
                "registration_points": None
                if registered is None
                else {"before": registered[0].numbers, "after": registered[1].numbers},
                "marked_rows": self._marked(),
                "noise": self.noise,
                "noise_stated": self.recording.noise_std,
                "chi_square": chi_square,
                "remarks": list(self.remarks),
                "gross_rows": self._gross(),
                "rank": self.identifiability.rank,
                "quantities": [self._quantity(q) for q in self.quantities],
                "explained_together": self.shares["together"],
                "parameters": [p.to_dict() for p in self.parameters],
                "moves_together": [held.words for held in self.identifiability.held],
                "at_bound": list(self.at_bound),
                "tool": self.tool.tolist(),
                "T_robot_camera": self.T_robot_camera.tolist(),
                "files": {},
            }
        )
        return found

    def _quantity(self, q: Quantity) -> dict[str, Any]:
        parts = [{"name": name, "coefficient": c} for name, c in q.parts]
        return asdict(q) | {"parts": parts, "ci95": list(q.ci95), "share": self.shares.get(q.name)}

    def _gross(self) -> list[dict[str, Any]]:
        """Rows as an editor counts, the header being row 1, and by place, counted from 0."""
        sizes = np.linalg.norm(self.misfits()[self.gross], axis=1).tolist()
        return [
            {"row": FIRST_ROW + k, "index": k, "misfit": size}
            for k, size in zip(self.gross_rows, sizes, strict=True)
        ]

    def _marked(self) -> dict[str, Any] | None:
        """Misfits of the rows that the recording itself marks as held out."""
        rows = readings_of(self.recording, held_out=True)
        if not len(rows):
            return None
        before, after = Misfit.of(self.nominal_misfits(rows)), Misfit.of(self.misfits(rows))
        return {"rows": len(rows), "before": before.numbers, "after": after.numbers}

    @cached_property
    def parameters(self) -> tuple[DHParameter, ...]:
        """Every parameter of the links that was asked for, and the tool."""
        about = {q.parts[0][0]: q for q in self.quantities}
        place = {name: k for k, name in enumerate(self.statement.names)}
        held = {h.name: h for h in self.identifiability.held}
        asked = [u for u in self.identifiability.unknowns if not u.name.startswith("frame")]
        return tuple(
            self._parameter(u, place.get(u.name), about.get(u.name), held.get(u.name))
            for u in asked
        )

    def _parameter(
        self, unknown: Unknown, k: int | None, told: Quantity | None, held: Held | None
    ) -> DHParameter:
        about = (unknown.name, unknown.unit, unknown.nominal)
        if told is not None and told.alone:
            return DHParameter(*about, told.value, told.std, Status.IDENTIFIED, "")
        if told is not None:
            return DHParameter(*about, None, None, Status.IN_A_SUM, f"known only in {told.name}")
        if k is not None and held is None and self.resting[k]:
            value = float(self.x[k])
            side = "upper" if value > unknown.nominal else "lower"
            return DHParameter(*about, value, None, Status.AT_BOUND, f"at its {side} bound")
        words = held.words if held else "moves together with others"
        return DHParameter(*about, None, None, Status.NOT_IDENTIFIABLE, words)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the fit is used, one line each."""
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[str]:
        left, stated = f"{1e3 * self.noise:.3f} mm", self.recording.noise_std
        if self.agrees is False and stated and self.noise > stated:
            yield (
                f"links leave {left} on an axis where {1e3 * stated:.3f} mm are stated "
                f"(chi-square {self.chi_square:.0f} with {self.freedom} degrees of freedom): "
                f"{self._why}"
            )
        elif self.agrees is False and stated:
            yield (
                f"links leave {left} on an axis where {1e3 * stated:.3f} mm are stated: "
                "noise_std is too large, or rows are copies of others"
            )
        doubtful = ASKED * plausible(self.recording)  # more than measuring devices err
        if not stated and self.noise > doubtful:
            yield (
                f"links leave {left} on an axis, more than {1e3 * doubtful:.3g} mm, a thousandth "
                "of the reach: state noise_std if the device is that coarse; "
                f"else {self._why}"
            )
        for words in self.judged.failures:
            yield f"{words}, or try solver gauss-newton"

    @property
    def _why(self) -> str:
        """What is to blame for what links leave: their bounds first, where some rest on one."""
        if self.at_bound:
            rests = f"{', '.join(self.at_bound)} at the bound: widen it (delta-length, delta-angle)"
            return f"{rests}; if that does not help, run plumbline diagnose"
        return "links are not the (whole) cause; run plumbline diagnose"

    @cached_property
    def judged(self) -> Judgement:
        r"""Whether the solver came to its end, by what one more step promises.

        The mean loss drops by :math:`\lambda^2 b / (2 n a)` over a step of :math:`\lambda` standard
        errors, with a and b the traces of the loss's moments.
        """
        drop = promised_drop(self.statement, self.readings, self.x)
        sigma = max(self.noise, ROUNDING)
        A, B = self.options.loss.moments(sigma**2 * np.eye(3))
        moves = np.sqrt(2.0 * len(self.readings) * max(drop, 0.0) * np.trace(A) / np.trace(B))
        low, high = self.statement.lower - self.x, self.x - self.statement.upper
        violation = float(np.concatenate([low, high]).max(initial=0.0))
        name, good = f"the fit by {self.solver}", moves <= STILL and violation <= FEASIBLE
        return Judgement.of([Judged(name, bool(good), float(moves), violation, self.at_bound)])

    @property
    def solver(self) -> str:
        """Name of the solver."""
        return str(getattr(self.options.solver, "name", type(self.options.solver).__name__))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that rest on a bound."""
        return tuple(p.name for p in self.parameters if p.status == Status.AT_BOUND)
