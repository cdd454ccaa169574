"""What is to be fitted, and how; and a recording as a problem of links."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Self

import numpy as np

from plumbline.declared import Among, Declared, Positive
from plumbline.kinematics.link_table import LinkTable, link_table
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solvers import Solver
from plumbline.optim.dh_fit.constants import DELTA_ANGLE, DELTA_LENGTH
from plumbline.optim.dh_fit.losses import Loss, Norms
from plumbline.optim.dh_fit.solvers import SOLVERS
from plumbline.optim.dh_fit.statement import (
    DHStatement,
    Readings,
    Unknown,
    frame_unknowns,
    link_unknowns,
    state,
    tool_unknowns,
)
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True)
class DHOptions(Declared):
    """What is to be fitted, and how."""

    loss: Loss = field(default_factory=Norms)  #: what a misfit costs
    #: ``joint``: the camera's frame is six free unknowns on all readings. ``registration``: it
    #: follows from four points, as published.
    frame: Annotated[str, Among(("joint", "registration"))] = "joint"
    #: ``identifiable``: a largest set that the poses can tell, the others at their nominal values.
    #: ``all``: every one, as published.
    parameters: Annotated[str, Among(("identifiable", "all"))] = "identifiable"
    hayati: bool = True  #: whether parallel axes get a tilt
    delta_length: Positive = DELTA_LENGTH  #: half-width of the bounds of d and a [m]
    #: half-width of the bounds of alpha, theta and beta [rad]
    delta_angle: Positive = DELTA_ANGLE
    solver: Solver = SOLVERS[0]  #: what solves it


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
    def of(cls, recording: Recording, options: DHOptions, registration: Readings | None) -> Self:
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

    def stated(self, unknowns: Sequence[Unknown]) -> DHStatement:
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
