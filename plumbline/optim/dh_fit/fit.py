r"""Fit the link parameters of a robot to tip readings, and say what the readings can tell.

State, solve, report: :mod:`plumbline.optim.dh_fit.statement` states eqs. 8-9 of Chen et al., a
solver of :mod:`plumbline.optim.dh_fit.solvers` solves it, and :mod:`plumbline.optim.dh_fit.answer`
judges the solution. Set-ups that no links explain (:mod:`plumbline.optim.dh_fit.setups`) are
refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.link_table import LinkTable, link_table
from plumbline.optim.dh_fit.answer import RESTING, DHFit
from plumbline.optim.dh_fit.gauss_newton import Found, GaussNewton
from plumbline.optim.dh_fit.identify import Identifiability, identify
from plumbline.optim.dh_fit.options import DHOptions
from plumbline.optim.dh_fit.registration import spread_rows
from plumbline.optim.dh_fit.setups import IMPLAUSIBLE, Task, reach, slip
from plumbline.optim.dh_fit.solvers import DHSolver
from plumbline.optim.dh_fit.statement import (
    Readings,
    Statement,
    Unknown,
    frame_unknowns,
    link_unknowns,
    state,
    tool_unknowns,
)
from plumbline.optim.dh_fit.sums import Pass
from plumbline.optim.recording.recording import Recording

Array = NDArray[np.float64]
UNBOUNDED = 1e3  # half-widths in place of one
COARSE = 3.0  # stated noises: misfits within them are the device's


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
        PlumblineError: The recording holds no tip positions, fewer than there are unknowns, or ones
            that no links explain: a wrong set-up.
        PlumblineError: The chain cannot be written as rows of links.
        PlumblineError: The registration points fix no frame.
    """
    options = options or DHOptions()
    if recording.observation != "tip_position":
        raise PlumblineError(
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
    _refuse_slips(recording, readings)
    first = _Task(table, recording.tool_offset, readings, registration, options)
    nominal = first.solved(always, GaussNewton())
    chosen, found = first.identified(asked, recording.name)
    fit = DHFit(
        recording,
        options,
        chosen.statement,
        readings,
        registration,
        chosen.identifiability,
        found,
        (nominal.statement, nominal.found.x),
    )
    _refuse_nonsense(fit)
    return fit


def _refuse_slips(recording: Recording, readings: Readings) -> None:
    fit_tool = "tool" in recording.always
    task = Task.of(recording.chain, recording.tool_offset, readings, fit_tool=fit_tool)
    if words := slip(task):
        raise PlumblineError(f"{recording.name}: {words}")


def _refuse_nonsense(fit: DHFit) -> None:
    """A misfit that no robot that is this one has is of another robot, or of another recording."""
    recording, sizes = fit.recording, np.linalg.norm(fit.misfits(), axis=1)
    missed = float(np.median(sizes))
    far = reach(recording.chain, recording.tool_offset, fit.readings.q)
    limit = max(IMPLAUSIBLE * far, COARSE * (recording.noise_std or 0.0))
    if not missed <= limit:
        raise PlumblineError(
            f"{recording.name}: fitted links still miss the tips by {1e3 * missed:.3g} mm (median),"
            f" at most {1e3 * limit:.3g} mm is plausible for a reach of {far:.2g} m; joint order, "
            "signs or zeros, units, robot or tip frame wrong? Mend them, or state noise_std"
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
            raise PlumblineError(
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
