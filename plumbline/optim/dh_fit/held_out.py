"""How far a fit carries: every row predicted by a fit that has not seen it.

Folds are those of the diagnosis: sessions, stretches of time, blocks of the workspace, or single
rows. What is free, and what it can tell, is chosen anew without the fold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.dh_fit.answer import DHFit
from plumbline.optim.dh_fit.fit import fit_dh
from plumbline.optim.dh_fit.options import DHOptions
from plumbline.optim.dh_fit.report import Misfit
from plumbline.optim.dh_fit.statement import Readings
from plumbline.optim.recording.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Misfits of rows that no fit has seen."""

    nominal: Array  # of the nominal links, frame and tool fitted without the rows (N, 3) [m]
    fitted: Array  # of links fitted without the rows (N, 3) [m]
    fold: NDArray[np.intp]  # fold of every row (N,)

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
    fold: NDArray[np.intp],
    *,
    registration: Readings | None = None,
) -> HeldOut:
    """Fit without each fold, and predict it.

    Args:
        recording: N rows, none of them marked as held out.
        options: As for :func:`fit_dh`.
        fold: Fold of every row (N,).
        registration: As for :func:`fit_dh`.

    Raises:
        PlumblineError: A fold leaves too few readings.
    """
    recording = replace(recording, held_out=None)
    rows = Readings(recording.q, recording.measured[:, :3])
    nominal, fitted = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    for k in np.unique(fold):
        out = fold == k
        fit = fit_dh(recording.select(~out), options, registration=registration)
        nominal[out], fitted[out] = _predicted(fit, rows.select(out))
    return HeldOut(nominal, fitted, fold)


def _predicted(fit: DHFit, rows: Readings) -> tuple[Array, Array]:
    return fit.nominal_misfits(rows), fit.misfits(rows)
