"""Rows that are wrong together: a tool that slipped in its clamp and came back.

Gross errors owe nothing to each other. Distrusted rows whose residuals are one and the same shift,
in the tool's own frame, had one cause, and no effect of the library is it.
"""

from __future__ import annotations

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import Solution
from plumbline.optim.diagnosis.prior import FEWEST_SLIPPED, PAIR_ALIKE, SLIP_ALIKE
from plumbline.optim.measurement.observation import Model


def slipped_rows(
    model: Model, best: Solution, bad: NDArray[np.bool_], sigma: float
) -> NDArray[np.intp]:
    """Distrusted rows that share one shift of the tool; none if fewer than two do.

    Args:
        model: The fitted model.
        best: Its fit; distrusted rows have no weight in it.
        bad: Which rows are distrusted (N,).
        sigma: The noise of one axis [m].
    """
    recording = model.recording
    rows = np.flatnonzero(bad)
    if len(rows) < FEWEST_SLIPPED or recording.observation not in (
        "tip_position",
        "pose",
        "fixed_point",
    ):
        return np.empty(0, dtype=np.intp)
    shifts = _in_tool_frame(model, best, rows)
    apart = np.linalg.norm(shifts[:, None] - shifts[None], axis=2) / (np.sqrt(2.0) * sigma)
    near = apart < SLIP_ALIKE
    largest = near[int(np.argmax(near.sum(axis=1)))]
    count, shift = largest.sum(), np.linalg.norm(shifts[largest].mean(axis=0))
    # Two may agree by chance, so they must agree better, and about something larger.
    chance = count == FEWEST_SLIPPED and (
        apart[np.ix_(largest, largest)].max() > PAIR_ALIKE or shift < 2 * SLIP_ALIKE * sigma
    )
    if count < FEWEST_SLIPPED or chance or shift < SLIP_ALIKE * sigma:
        return np.empty(0, dtype=np.intp)
    return np.asarray(rows[largest])


def _in_tool_frame(model: Model, best: Solution, rows: NDArray[np.intp]) -> Array:
    """Measured minus predicted (K, 3) of some rows, turned into the tip frame [m]."""
    problem, recording = model.problem, model.recording
    turn = cs.Function("turn", [problem.x], [cs.densify(model.nuisance.T_device_world.R)])
    R_device_base = np.asarray(turn(best.x).full())
    R_base_tip = recording.chain.placement(recording.q[rows])[:, :3, :3]
    residual = best.mapped.residuals(best.x)[rows, :3]
    return -np.einsum("nji,kj,nk->ni", R_base_tip, R_device_base, residual)
