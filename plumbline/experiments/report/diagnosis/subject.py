"""What a report is about: the parts of a diagnosis that it reads, in the units that it shows."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import scaled
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import row_numbers

RUNS = 24  # of rows whose middles make a line
ENOUGH = 15  # rows that a running median takes on either side, at least


@dataclass(frozen=True, eq=False)
class Subject:
    """Residuals of the trusted rows, in mm or mrad."""

    recording: Recording  # the trusted rows
    verdict: Verdict  # what the diagnosis says of all of them
    before: Array  # residuals (N, m) before
    after: Array  # residuals (N, m) after
    places: Array  # tip positions (N, 3) in the base frame [m]
    unit: str  # ``"mm"`` or ``"mrad"``
    factor: float  # from the gap's unit to that
    rows: NDArray[np.int64]  # numbers (N,) of the rows in the whole recording, from 1

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Self:
        """The subject of a diagnosis."""
        factor, unit = scaled(diagnosis.verdict.gap.unit)
        keep = np.asarray(diagnosis.trusted, dtype=bool)
        # Of a pose, the gap is that of its position.
        columns = 3 if diagnosis.recording.kind.oriented else None
        return cls(
            recording=diagnosis.recording.select(keep),
            verdict=diagnosis.verdict,
            before=factor * np.asarray(diagnosis.residual_before)[keep, :columns],
            after=factor * np.asarray(diagnosis.residual_after)[keep, :columns],
            places=np.asarray(diagnosis.places)[keep],
            unit=unit,
            factor=factor,
            rows=np.array(row_numbers(keep), dtype=np.int64),
        )

    @property
    def encoders(self) -> bool:
        """Whether the rows are readings of joints, angles or efforts, rather than of the tip."""
        return self.recording.kind.encoders or self.torques

    @property
    def ranges(self) -> bool:
        """Whether the rows are ranges on planes."""
        return self.recording.kind.ranges

    @property
    def touches(self) -> bool:
        """Whether the rows are touches of markers."""
        return self.recording.kind.fiducials

    @property
    def torques(self) -> bool:
        """Whether the rows are efforts of drives."""
        return self.recording.kind.efforts

    @cached_property
    def encoder_columns(self) -> dict[int, int]:
        """Column of the residuals by measured joint, counted from 0."""
        joints = self.recording.measured_joints or tuple(range(self.recording.chain.n))
        whole = self.before.shape[1] == self.recording.chain.n
        return {j: j if whole else k for k, j in enumerate(joints)}

    @cached_property
    def sizes(self) -> tuple[Array, Array]:
        """Sizes (N,) before and after: distances, or root mean squares of a row's encoders."""
        if not self.encoders:
            return np.linalg.norm(self.before, axis=1), np.linalg.norm(self.after, axis=1)
        columns = list(self.encoder_columns.values())
        mean = [np.nanmean(r[:, columns] ** 2, axis=1) for r in (self.before, self.after)]
        return np.sqrt(mean[0]), np.sqrt(mean[1])


def running(
    x: Array, y: Array, middle: Callable[[Array], np.floating[Any]] = np.median
) -> tuple[Array, Array]:
    """The middle of y over runs of rows equal in number, ordered by x; empty where rows are few.

    A median leaps between the two branches of a loop; a mean does not.
    """
    good = np.isfinite(x) & np.isfinite(y)
    order = np.flatnonzero(good)[np.argsort(x[good], kind="stable")]
    count = min(RUNS, len(order) // ENOUGH)
    if count < 2:
        return np.empty(0), np.empty(0)
    runs = np.array_split(order, count)
    return (
        np.array([np.median(x[run]) for run in runs]),
        np.array([middle(y[run]) for run in runs]),
    )
