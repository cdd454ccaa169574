"""Numeric evaluation of CasADi functions over many rows, straight into NumPy memory.

Going through ``DM`` copies element by element; a function's buffer does not.
"""

from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BLOCK_NUMBERS = 20_000  # of inputs and outputs at a call: what a core keeps at hand (cost only)


@lru_cache(maxsize=16)
def _mapped(function: cs.Function, count: int, shared: tuple[int, ...]) -> cs.Function:
    """Making a map copies the whole function: an expensive step for a large one."""
    return function.map(f"{function.name()}_rows", "serial", count, list(shared), [])


def _at_once(function: cs.Function, count: int) -> int:
    """Rows of one call: a map holds what rows share as often as it has rows."""
    numbers = function.nnz_in() + function.nnz_out()
    return min(count, max(BLOCK_NUMBERS // max(numbers, 1), 1))


def over_rows(function: cs.Function, rows: ArrayLike, *shared: ArrayLike) -> list[Array]:
    """Evaluate a function of ``(*shared, row)`` at every row.

    Args:
        function: Its outputs must be dense; its last input is the row.
        rows: Rows (N, k).
        *shared: Inputs that are the same for all rows.

    Returns:
        One array an output: (N, c, r) for an output of r rows and c columns, so that a column
        vector comes as (N, 1, r).
    """
    table = np.ascontiguousarray(rows, dtype=float)
    count = len(table)
    if not count:
        shapes = [function.size_out(i) for i in range(function.n_out())]
        return [np.empty((0, c, r)) for r, c in shapes]
    size = _at_once(function, count)
    mapped = _mapped(function, size, tuple(range(len(shared))))
    inputs = [np.ascontiguousarray(s, dtype=float).ravel() for s in shared]
    sizes = [function.size_out(i) for i in range(function.n_out())]
    outputs = [np.empty((count, c, r)) for r, c in sizes]
    handle: Any = mapped.buffer()  # CasADi's own types leave out half of its signature
    buffer, run = handle
    # The buffer keeps addresses only: inputs and outputs must live until it has run.
    for i, values in enumerate(inputs):
        buffer.set_arg(i, values.data)
    for start in range(0, count, size):
        first = min(start, count - size)  # the last call takes rows of the one before it again
        buffer.set_arg(len(inputs), table[first : first + size].data)
        for i, found in enumerate(outputs):
            buffer.set_res(i, found[first : first + size].data)
        run()
    return outputs
