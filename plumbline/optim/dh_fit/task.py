"""A recording as a problem of links: everything but the choice of unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.link_table import LinkTable, link_table
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import Solver
from plumbline.optim.dh_fit.gauss_newton import Array
from plumbline.optim.dh_fit.options import DHOptions
from plumbline.optim.dh_fit.statement import (
    Readings,
    Statement,
    Unknown,
    frame_unknowns,
    link_unknowns,
    state,
    tool_unknowns,
)
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class LinkTask:
    """What a fit is made to."""

    table: LinkTable  # the nominal links
    tool: Array  # nominal tip in the tip frame (3,) [m]
    readings: Readings  # the rows that are not held out
    registration: Readings | None  # the four points that fix the frame, if they do
    options: DHOptions  # what is to be fitted, and how
    always: tuple[Unknown, ...]  # unknowns of frame and tool

    @classmethod
    def of(
        cls, recording: Recording, options: DHOptions, registration: Readings | None
    ) -> LinkTask:
        """The task of a recording."""
        table, always = link_table(recording.robot, recording.chain), []
        if options.frame == "joint" and "frame" in recording.always:
            always += frame_unknowns()
        if "tool" in recording.always:
            always += tool_unknowns(recording.tool_offset)
        readings = readings_of(recording)
        return cls(table, recording.tool_offset, readings, registration, options, tuple(always))

    @property
    def asked(self) -> tuple[Unknown, ...]:
        """All unknowns that were asked for, frame and tool first."""
        own = self.options
        links = link_unknowns(self.table, own.delta_length, own.delta_angle, hayati=own.hayati)
        return (*self.always, *links)

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

    def solved(self, unknowns: Sequence[Unknown], solver: Solver) -> Solution:
        """Its solution from the nominal robot."""
        statement = self.stated(unknowns)
        problem = statement.problem(self.readings)
        if not unknowns:
            return Solution(problem, np.empty(0), 0, "nothing to fit")
        return solver.solve(problem, statement.nominal)


def readings_of(recording: Recording, *, held_out: bool = False) -> Readings:
    """The rows that are to be fitted, or those that the recording holds out."""
    flags = recording.held_out
    marked = np.zeros(len(recording), dtype=bool) if flags is None else flags
    every = Readings(recording.q, recording.measured[:, :3])
    return every.select(marked if held_out else ~marked)
