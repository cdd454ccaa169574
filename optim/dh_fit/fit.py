r"""Fit the link parameters of a robot to tip readings, and say what the readings can tell.

State, solve, report: :mod:`optim.dh_fit.statement` states eqs. 8-9 of Chen et al., a solver of
:mod:`optim.dh_fit.solvers` solves it, and the result below judges itself from the statement.

Standard errors are those of Gaussian noise of one size on every axis, estimated from what the fit
leaves,

.. math:: \mathrm{cov}(x) = c\,\hat\sigma^2 (J^T J)^{-1}, \qquad c = 1 \text{ (squares)},\quad
          3\pi/8 \text{ (norms)},

the latter being the loss of efficiency of the spatial median in three dimensions (Brown 1983, J. R.
Stat. Soc. B 45(1)). They hold for readings; registration points' own noise comes on top.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinematics.link_table import LinkTable, link_table
from optim.dh_fit.gauss_newton import Found, GaussNewton
from optim.dh_fit.identify import Held, Identifiability, identify, triangle
from optim.dh_fit.losses import Loss, Norms
from optim.dh_fit.registration import spread_rows
from optim.dh_fit.report import DHParameter, Misfit, Status
from optim.dh_fit.solvers import DHSolver
from optim.dh_fit.statement import (
    Readings,
    Statement,
    Unknown,
    frame_unknowns,
    link_unknowns,
    state,
    tool_unknowns,
)
from optim.dh_fit.sums import Pass
from optim.recording import Recording

Array = NDArray[np.float64]
DELTA_LENGTH, DELTA_ANGLE = 0.01, float(np.radians(5.0))
FRAMES = ("joint", "registration")
CHOICES = ("identifiable", "all")
UNBOUNDED = 1e3  # half-widths in place of one
RESTING = 1e-6  # of a bound's half-width


class DHFitError(ValueError):
    """A recording or a choice that no fit can be made of; the message is one line."""


@dataclass(frozen=True)
class DHOptions:
    """What is to be fitted, and how.

    Attributes:
        loss: What a misfit costs.
        frame: ``joint``: the camera's frame is six free unknowns on all readings.
            ``registration``: it follows from four points, as published.
        parameters: ``identifiable``: a largest set that the poses can tell, the others at their
            nominal values. ``all``: every one, as published.
        hayati: Whether parallel axes get a tilt.
        delta_length: Half-width of the bounds of d and a [m].
        delta_angle: Half-width of the bounds of alpha, theta and beta [rad].
        solver: What solves it.
    """

    loss: Loss = field(default_factory=Norms)
    frame: str = "joint"
    parameters: str = "identifiable"
    hayati: bool = True
    delta_length: float = DELTA_LENGTH
    delta_angle: float = DELTA_ANGLE
    solver: DHSolver = field(default_factory=GaussNewton)

    def __post_init__(self) -> None:
        """Refuse what is no choice."""
        for name, value, known in (
            ("frame", self.frame, FRAMES),
            ("parameters", self.parameters, CHOICES),
        ):
            if value not in known:
                raise DHFitError(f"{name} {value!r} not recognised; choose {' or '.join(known)}")
        for name in ("delta_length", "delta_angle"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise DHFitError(f"{name} = {getattr(self, name)}: must be > 0 and finite")


@dataclass(frozen=True, eq=False)
class DHFit:
    """A fit, which judges itself.

    Attributes:
        recording: What it was fitted to, rows held out among them.
        options: What was asked for.
        statement: The problem.
        readings: The rows that it was fitted to.
        registration: The four points that fix the frame, if they do.
        identifiability: What the poses can tell.
        found: What the solver came back with.
        nominal: The statement without link parameters, and its solution.
    """

    recording: Recording
    options: DHOptions
    statement: Statement
    readings: Readings
    registration: Readings | None
    identifiability: Identifiability
    found: Found
    nominal: tuple[Statement, Array]

    def __repr__(self) -> str:
        """Rows, unknowns, and the mean misfit before and after."""
        sizes = f"mean misfit {1e3 * self.before.mean:.3g} mm -> {1e3 * self.after.mean:.3g} mm"
        shape = f"{len(self.readings)} rows, {self.statement.size} unknowns"
        return f"<DHFit of {self.recording.name[:60]}: {shape}; {sizes}>"

    @property
    def x(self) -> Array:
        """The solution (P,)."""
        return self.found.x

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
        stated, x = self.nominal
        return Pass(stated, readings or self.readings).misfits(x)

    @cached_property
    def before(self) -> Misfit:
        """Misfits of the nominal links."""
        return Misfit.of(self.nominal_misfits())

    @cached_property
    def after(self) -> Misfit:
        """Misfits of the fitted links, on the rows that they were fitted to."""
        return Misfit.of(self.misfits())

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """Which unknowns (P,) rest on a bound."""
        room = RESTING * self.statement.delta
        low, high = self.statement.lower + room, self.statement.upper - room
        return (self.x <= low) | (self.x >= high)

    @cached_property
    def noise(self) -> float:
        """Noise of one axis, 1 sigma [m], from what the fit leaves."""
        e = self.misfits()
        freedom = max(e.size - int((~self.resting).sum()), 1)
        return float(np.sqrt(self.options.loss.variance(e) * e.size / freedom))

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns (P, P); NaN where they rest on a bound or cannot be told."""
        free = np.flatnonzero(~self.resting & ~self._untold)
        R = triangle(self.statement, self.readings, self.x)[:, free]
        inverse = np.linalg.pinv(R, rcond=1e-12)
        scale = self.statement.scale[free]
        found = np.full((self.statement.size, self.statement.size), np.nan)
        size = self.options.loss.spread * self.noise**2
        found[np.ix_(free, free)] = size * (inverse @ inverse.T) * np.outer(scale, scale)
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
    def _untold(self) -> NDArray[np.bool_]:
        """Free unknowns that the data alone do not fix, which ``all`` may have."""
        null = self.identifiability.null
        moved = np.abs(null).max(axis=0, initial=0.0) > 0.0
        together = {u.name for u, m in zip(self.identifiability.unknowns, moved, strict=True) if m}
        if self.options.parameters == "identifiable":
            together = set()
        return np.array([name in together for name in self.statement.names], dtype=bool)

    @cached_property
    def parameters(self) -> tuple[DHParameter, ...]:
        """Every parameter of the links that was asked for, and the tool."""
        place = {name: k for k, name in enumerate(self.statement.names)}
        held = {h.name: h for h in self.identifiability.held}
        asked = [u for u in self.identifiability.unknowns if not u.name.startswith("frame")]
        return tuple(self._parameter(u, place.get(u.name), held.get(u.name)) for u in asked)

    def _parameter(self, unknown: Unknown, k: int | None, held: Held | None) -> DHParameter:
        about = (unknown.name, unknown.unit, unknown.nominal)
        if k is None or self._untold[k]:
            words = held.words if held else "moves together with others"
            return DHParameter(*about, None, None, Status.NOT_IDENTIFIABLE, words)
        value = float(self.x[k])
        if self.resting[k]:
            side = "upper" if value > unknown.nominal else "lower"
            return DHParameter(*about, value, None, Status.AT_BOUND, f"at its {side} bound")
        return DHParameter(*about, value, float(self.std[k]), Status.IDENTIFIED, "")

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that rest on a bound."""
        return tuple(p.name for p in self.parameters if p.status == Status.AT_BOUND)


def fit_dh(
    recording: Recording,
    options: DHOptions | None = None,
    *,
    registration: Readings | None = None,
) -> DHFit:
    """Fit the link parameters to a recording of tip positions.

    Rows marked ``held_out`` are left out.

    Args:
        recording: Tip positions in the camera's frame.
        options: What is to be fitted, and how.
        registration: Four readings that fix the frame, for ``frame="registration"``; if not given,
            four far-apart rows of the recording, which stay among those that are fitted.

    Raises:
        DHFitError: The recording holds no tip positions, or fewer than there are unknowns.
        LinkTableError: The chain cannot be written as rows of links.
        RegistrationError: The registration points fix no frame.
    """
    options = options or DHOptions()
    if recording.observation != "tip_position":
        raise DHFitError(
            f"{recording.name}: observation {recording.observation!r}, expected 'tip_position'"
        )
    rows = np.ones(len(recording), bool) if recording.held_out is None else ~recording.held_out
    readings = Readings(recording.q, recording.measured[:, :3]).select(rows)
    table = link_table(recording.robot, recording.chain)
    if options.frame == "joint":
        registration = None
    elif registration is None:
        registration = readings.select(list(spread_rows(readings.tips)))
    always = _always(recording, options)
    asked = always + link_unknowns(
        table, options.delta_length, options.delta_angle, hayati=options.hayati
    )
    first = _Task(table, recording.tool_offset, readings, registration, options)
    nominal = first.solved(always, GaussNewton())
    chosen, found = first.identified(asked, recording.name)
    statement = chosen.statement
    return DHFit(
        recording,
        options,
        statement,
        readings,
        registration,
        chosen.identifiability,
        found,
        (nominal.statement, nominal.found.x),
    )


def _always(recording: Recording, options: DHOptions) -> list[Unknown]:
    found = []
    if options.frame == "joint" and "frame" in recording.always:
        found += frame_unknowns()
    if "tool" in recording.always:
        found += tool_unknowns(recording.tool_offset)
    return found


@dataclass(frozen=True, eq=False)
class _Solved:
    """A statement with its solution."""

    statement: Statement
    found: Found


@dataclass(frozen=True, eq=False)
class _Chosen:
    """A statement and what was known when its unknowns were chosen."""

    statement: Statement
    identifiability: Identifiability


@dataclass(frozen=True, eq=False)
class _Task:
    """Everything but the unknowns."""

    table: LinkTable
    tool: Array
    readings: Readings
    registration: Readings | None
    options: DHOptions

    def stated(self, unknowns: Sequence[Unknown]) -> Statement:
        """The problem in these unknowns."""
        return state(
            self.table,
            self.tool,
            unknowns,
            self.options.loss,
            readings=self.readings,
            registration=self.registration,
        )

    def solved(self, unknowns: Sequence[Unknown], solver: DHSolver) -> _Solved:
        """Its solution from the nominal robot."""
        statement = self.stated(unknowns)
        if not unknowns:
            return _Solved(statement, Found(np.empty(0), 0, "nothing to fit"))
        return _Solved(statement, solver.solve(statement, self.readings, statement.nominal))

    def unbounded(self, first: _Solved) -> _Solved:
        """The same without bounds, if any of them binds: tight bounds are no noise."""
        stated, x = first.statement, first.found.x
        if (np.abs(x - stated.nominal) < stated.delta * (1.0 - RESTING)).all():
            return first
        wide = tuple(replace(u, delta=UNBOUNDED * u.delta) for u in stated.unknowns)
        free = replace(stated, unknowns=wide)
        return _Solved(free, GaussNewton().solve(free, self.readings, x))

    def identified(self, asked: Sequence[Unknown], name: str) -> tuple[_Chosen, Found]:
        """The final statement and its solution."""
        reference = None if self.registration is None else self.registration.q
        known = identify(self.table, self.tool, asked, self.readings.q, reference)
        if 3 * len(self.readings) <= known.rank:
            raise DHFitError(
                f"{name}: {len(self.readings)} readings for {known.rank} parameters that can be "
                f"told, more than {known.rank // 3} needed; record more poses or hold out fewer"
            )
        plain = GaussNewton()
        first = self.solved(known.free, plain)
        weighed = known.weighed(_noise(self.unbounded(first), self.readings, self.options))
        every = self.options.parameters == "all"
        if not every and weighed.kept == known.kept and self.options.solver == plain:
            return _Chosen(first.statement, weighed), first.found
        last = self.solved(asked if every else weighed.free, self.options.solver)
        return _Chosen(last.statement, weighed), last.found


def _noise(solved: _Solved, readings: Readings, options: DHOptions) -> float:
    e = Pass(solved.statement, readings).misfits(solved.found.x)
    freedom = max(e.size - solved.statement.size, 1)
    return float(np.sqrt(options.loss.variance(e) * e.size / freedom))
