"""Rows that a model is asked at: postures, and what else its effects read.

What is not given is taken as it is most of the time: no side of approach, at rest, the recording's
mean temperature and payload, the end of its time, the drives holding the arm against gravity.
"""

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import best_matches, fault, listed
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.model.constants import LARGEST, SAMPLES
from plumbline.optim.recording.recording import Recording

SCALARS = ("time", "temperature", "payload", "group")
VECTORS = ("direction", "velocity", "acceleration", "effort")
IN_SPACE = ("force",)  # three numbers, whatever the number of joints


# What a posture is reached with: one value for all rows, or one a row (N,), or (N, n) of joints.
CONTEXT = (*SCALARS, *VECTORS, *IN_SPACE)
Columns = Mapping[str, Array]


def columns_of(recording: Recording) -> dict[str, Array]:
    """Joints and context of a recording as columns (N, k), what the path leaves behind apart."""
    found: dict[str, Array] = {"q": recording.q}
    for name in CONTEXT:
        values = getattr(recording, name)
        if values is not None:
            found[name] = values.reshape(len(recording), -1)
    return found


def some_rows(columns: Columns) -> dict[str, Array]:
    """At most :data:`SAMPLES` rows, evenly spread over all."""
    count = len(columns["q"])
    chosen = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(int))
    return {name: values[chosen] for name, values in columns.items()}


def ranges_of(columns: Columns) -> dict[str, Array]:
    """Smallest and largest of every column (2, k)."""
    return {name: np.array([v.min(axis=0), v.max(axis=0)]) for name, v in columns.items()}


def completed(
    chain: Chain,
    q: Array,
    given: Mapping[str, ArrayLike],
    usual: Mapping[str, float],
    effects: Sequence[Effect],
    used: Collection[str] = CONTEXT,
) -> dict[str, Array]:
    """All columns that any effect may read (N, k), what was not given as it usually is, or refused.

    Some effects derive columns of their own from the path of the rows; else what is not ``used``
    and takes long is left out.
    """
    rows, n = q.shape
    for name in given:
        if name not in CONTEXT:
            near = best_matches(name, CONTEXT)
            known = listed(CONTEXT)
            raise fault(f"model, {name}", "an unknown name", f"one of {known}", f"best: {near}")
    pathed = [effect for effect in effects if type(effect).derive is not Effect.derive]
    found = {"q": q}
    for name in CONTEXT:
        width = 1 if name in SCALARS else 3 if name in IN_SPACE else n
        if given.get(name) is not None:
            found[name] = _sided(name, _shaped(name, given[name], rows, width))
        elif name != "effort":
            found[name] = np.full((rows, width), usual.get(name, 0.0))
        elif pathed or name in used:
            found[name] = over_rows(_holding(chain), np.hstack([q, found["payload"]]))[0][:, 0]
    for effect in pathed:
        for name, values in effect.derive(found).items():
            found[name] = np.reshape(values, (rows, 1))
    return found


def of_rows(context: Mapping[str, ArrayLike], rows: Indices, count: int) -> Mapping[str, ArrayLike]:
    """The context of some of so many rows: a column for each row, or what all of them share."""
    found: dict[str, ArrayLike] = {}
    for name, values in context.items():
        array = np.asarray(values)
        each = array.ndim == 2 or (array.ndim == 1 and name in SCALARS)
        found[name] = array[rows] if each and len(array) == count else values
    return found


@lru_cache(maxsize=8)
def _holding(chain: Chain) -> cs.Function:
    """Efforts (n,) [N m or N] that hold the arm with a payload [kg] still."""
    row = cs.SX.sym("row", chain.n + 1)
    torque = chain.gravity_torque(row[: chain.n], row[chain.n])
    return cs.Function("holding", [row], [cs.densify(torque)])


def _shaped(name: str, values: ArrayLike, rows: int, width: int) -> Array:
    try:
        array = np.asarray(values, dtype=float)
        if array.ndim == 1 and width == 1 and array.shape != (1,):
            array = array[:, None]
        shaped = np.array(np.broadcast_to(array, (rows, width)))
    except (TypeError, ValueError):
        found = f"shape {np.shape(values)}" if np.size(values) else "nothing"
        mend = "give one value, or one a row"
        raise fault(f"model, {name}", found, f"({rows}, {width})", mend) from None
    return _finite(name, shaped)


def _sided(name: str, values: Array) -> Array:
    """The same, refused if it is a side and none of the three: twice a side is twice the play."""
    wrong = values[~np.isin(values, (-1.0, 0.0, 1.0))] if name == "direction" else values[:0]
    if wrong.size:
        mend = "give 1 where a joint grew last, -1 where it fell"
        raise fault(f"model, {name}", f"{wrong.flat[0]:.6g}", "-1, 0 or 1", mend)
    return values


def _finite(name: str, values: Array) -> Array:
    if not (np.abs(values) <= LARGEST).all():
        raise fault(f"model, {name}", "a value that is not finite or far too large", "a finite one",
                    f"give numbers up to {LARGEST:g}")  # fmt: skip
    return values


def postures(chain: Chain, q: ArrayLike) -> Array:
    """Postures (N, n) from (N, n) or (n,), refused if of other joints or not finite."""
    return _finite("postures", chain.postures(q))
