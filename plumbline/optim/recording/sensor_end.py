r"""Ends of a sensor of efforts: rows that read one only say that there was that much, or more.

.. math:: y_k = \min(\tau_k, E) + \epsilon_k

Where noise comes before the end, rows read it to the digit. Where it comes after, they scatter
about it, whatever the joint's effort should be: :math:`\tau = X \theta` by a generous straight-line
fit to the rows within the end (Tobin 1958, Econometrica 26(1), on limited readings).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import shown
from plumbline.optim.core.quantities import counted
from plumbline.optim.recording import constants
from plumbline.optim.recording.late import basis_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Array, Flags
from plumbline.optim.rigid import some_of

End = tuple[int, float, Flags]  # of a joint from 0, an end [N m or N], and rows (N,) that read it
Columns = Callable[[NDArray[np.integer]], Sequence[Array]]


def without_saturated(r: Recording, model: Array, columns: Columns) -> Recording:
    """Without rows in which a sensor reads its end: of what was there they only say that much more.

    Args:
        r: N rows of efforts.
        model: What they should be by the model alone (N, n) [N m or N].
        columns: Of rows (k,), what each joint's effort may depend on (k, p).
    """
    beyond, notes = np.zeros(len(r), bool), []
    for j, end, rows in (*_to_the_digit(r, model), *_within_noise(r, model, columns)):
        rows = rows & ~beyond
        if rows.any():
            beyond |= rows
            said = (
                f"efforts of joint {j + 1} end at {shown(end)} in {counted(int(rows.sum()), 'row')}"
            )
            notes.append(f"{said}, left aside: a sensor's end")
    return replace(r, notes=(*r.notes, *notes)).select(~beyond) if notes else r


def _to_the_digit(r: Recording, model: Array) -> Iterator[End]:
    """Joints, ends and rows (N,) that read one end again and again.

    One that holds a load reads the same for long, too: there the model's effort is one as well.
    """
    for (j, read), side in product(enumerate(r.measured.T), (1.0, -1.0)):
        values, counts = np.unique(side * read, return_counts=True)
        end, step = values[-1], np.diff(values).min(initial=np.inf)
        near = counts[values >= end - constants.ENDS_WITHIN * step].sum() - counts[-1]
        at = side * read == end
        spread = np.ptp(model[at, j])
        ends = len(values) > 1 and counts[-1] >= max(constants.AT_ITS_END, 2 * near + 1)
        if ends and spread > constants.ENDS_OFF * abs(end):
            yield j, float(side * end), at


def _within_noise(r: Recording, model: Array, columns: Columns) -> Iterator[End]:
    """Joints, ends and rows (N,) that scatter about one, where the effort should be beyond it."""
    rows = some_of(len(r), constants.EFFORT_ROWS)
    for j, X in enumerate(columns(rows)):
        basis = basis_of(X)
        for side in (1.0, -1.0):
            read = side * r.measured[rows, j]
            if (found := _end_of(read, model[rows, j], basis)) is None:
                continue
            end, least, within = found
            size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
            theta = np.linalg.lstsq(X[within] / size, read[within], rcond=1e-6)[0]
            beyond = columns(np.arange(len(r)))[j] / size @ theta > least
            yield j, side * end, beyond & (side * r.measured[:, j] > least)


def _end_of(read: Array, model: Array, basis: Array) -> tuple[float, float, Flags] | None:
    """An end of readings (k,), what efforts surely are within, and rows (k,) that a fit may see.

    What should be beyond reads one effort, and nothing reads more, though the bodies' torque by the
    model (k,) changes, and neither the fit within nor one to all rows has it so.
    """
    best: tuple[float, float, Flags] | None = None
    whole = basis @ (basis.T @ read)
    most = constants.SURELY_ENDS
    for share in constants.BEYOND_ENDS:
        end = float(np.quantile(read, 1.0 - share))
        wanted, sigma, within = _fitted(read, basis, end, 0.0)
        # The first fit saw readings of the end that noise had made less.
        wanted, sigma, within = _fitted(read, basis, end, constants.SURELY * sigma)
        over = wanted > end + constants.SURELY * sigma
        if over.sum() < constants.AT_ITS_END:
            continue
        there, asked = read[over], model[over]  # dry friction alone reads one effort, too
        mean, noise = float(there.mean()), max(float(there.std()), 1e-300)
        last = read.max() < mean + 2.0 * constants.SURELY * sigma
        varied = np.ptp(asked) > constants.ENDS_OFF * mean
        missed = min(float(np.sqrt(np.mean((f[over] - there) ** 2))) for f in (wanted, whole))
        gain = _alone(over, there - mean) * float(
            np.log(max(min(asked.std(), missed) / noise, 1e-300))
        )
        if last and varied and noise < constants.FLAT * sigma and gain > most:
            most, best = gain, (mean, mean - constants.SURELY * sigma, within)
    return best


def _alone(rows: Flags, left: Array) -> float:
    r"""As how many independent ones those of the rows (k,) count that leave so much of their mean.

    :math:`(1 - \rho) / (1 + \rho)` of them (AR(1)): noise behind an end is another in every row,
    where a slow crest is one swing, however many rows see it.
    """
    near = np.diff(np.flatnonzero(rows)) == 1
    past = float(left[1:][near] @ left[:-1][near]) / max(float(left @ left), 1e-300)
    past = min(max(past, 0.0), 1.0)
    return len(left) * (1.0 - past) / (1.0 + past)


def _fitted(read: Array, basis: Array, end: float, less: float) -> tuple[Array, float, Flags]:
    """Efforts by a fit to readings (k,) within an end, less so much; what it leaves, 1 sigma.

    And which those are. Too few tell nothing of what is beyond.
    """
    within = np.abs(read) < end - less
    if within.sum() < 2 * basis.shape[1]:
        return read, np.inf, within
    some = basis[within]
    # Directions that the rows within hardly show are told by none: pinv leaves them out.
    wanted = basis @ (
        np.linalg.pinv(some.T @ some, 1e-12, hermitian=True) @ (some.T @ read[within])
    )
    return wanted, float(np.median(np.abs(read - wanted)[within])) / constants.MEDIAN, within
