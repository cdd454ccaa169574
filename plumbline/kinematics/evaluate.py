"""Numeric evaluation of CasADi functions over many rows, straight into NumPy memory.

Going through ``DM`` copies element by element; a function's buffer does not. Of many rows each
operation is done on all of them before the next: NumPy's loops over a column are several times as
fast as CasADi's over the operations of a row.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.kinematics import constants

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]
Integers = NDArray[np.int64]
Operation = Callable[..., Any]
Step = tuple[Operation | None, int, int, int, bool]


def _twice(a: Any, out: Array | None = None) -> Any:
    return np.add(a, a, out=out)


def _where(a: Any, b: Any, out: Array | None = None) -> Any:
    """The second where the first is not nought, whatever it is elsewhere."""
    found = np.where(a, b, 0.0)
    if out is None:
        return found
    out[:] = found
    return out


OPERATIONS: dict[int, Operation] = {
    cs.OP_ADD: np.add, cs.OP_SUB: np.subtract, cs.OP_MUL: np.multiply, cs.OP_DIV: np.divide,
    cs.OP_NEG: np.negative, cs.OP_INV: np.reciprocal, cs.OP_TWICE: _twice, cs.OP_SQ: np.square,
    cs.OP_SQRT: np.sqrt, cs.OP_EXP: np.exp, cs.OP_LOG: np.log, cs.OP_POW: np.power,
    cs.OP_CONSTPOW: np.power, cs.OP_SIN: np.sin, cs.OP_COS: np.cos, cs.OP_TAN: np.tan,
    cs.OP_ASIN: np.arcsin, cs.OP_ACOS: np.arccos, cs.OP_ATAN: np.arctan, cs.OP_TANH: np.tanh,
    cs.OP_ATAN2: np.arctan2, cs.OP_FABS: np.abs, cs.OP_SIGN: np.sign, cs.OP_FLOOR: np.floor,
    cs.OP_FMIN: np.minimum, cs.OP_FMAX: np.maximum, cs.OP_LT: np.less, cs.OP_LE: np.less_equal,
    cs.OP_EQ: np.equal, cs.OP_NE: np.not_equal, cs.OP_AND: np.logical_and,
    cs.OP_OR: np.logical_or, cs.OP_NOT: np.logical_not, cs.OP_IF_ELSE_ZERO: _where,
}  # fmt: skip


@lru_cache(maxsize=16)
def _mapped(function: cs.Function, count: int, shared: tuple[int, ...]) -> cs.Function:
    """Making a map copies the whole function: an expensive step for a large one."""
    return function.map(f"{function.name()}_rows", "serial", count, list(shared), [])


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
    program = _program(function) if count >= constants.FEWEST_ROWS else None
    if program is not None:
        return program.run(table, shared)
    # Rows of one call: a map holds what rows share as often as it has rows
    numbers = function.nnz_in() + function.nnz_out()
    size = min(count, max(constants.BLOCK_NUMBERS // max(numbers, 1), 1))
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


@dataclass(frozen=True, eq=False)
class _Program:
    """The operations of a function, each to be done on a column of rows.

    A step is ``(operation, result, first, second, varies)`` by places: of the work space, then of
    constants, then of inputs; without an operation it is the first that goes to an output's number.
    What rows share is worked out without them.
    """

    function: cs.Function
    steps: Sequence[Step]
    constants: Sequence[float]
    inputs: Sequence[tuple[int, int]]

    def run(self, table: Array, shared: Sequence[ArrayLike]) -> list[Array]:
        """The outputs, as :func:`over_rows` has them."""
        f, count = self.function, len(table)
        given = [np.asarray(s, dtype=float).ravel() for s in shared]
        found = [np.empty((f.nnz_out(i), count)) for i in range(f.n_out())]
        with np.errstate(all="ignore"):
            size = min(constants.MOST_ROWS, constants.AT_HAND // max(f.sz_w(), 1))
            for first in range(0, count, size):
                part = slice(first, min(first + size, count))
                self._column([*given, table[part].T.copy()], [one[:, part] for one in found])
        shapes = [f.size_out(i) for i in range(f.n_out())]
        return [
            np.ascontiguousarray(columns.T).reshape(count, c, r)
            for columns, (r, c) in zip(found, shapes, strict=True)
        ]

    def _column(self, given: Sequence[Array], found: Sequence[Array]) -> None:
        """Outputs (K, n) of some rows (k, n), which are the last of what is given."""
        space = np.empty((self.function.sz_w(), given[-1].shape[1]))
        now: list[Any] = [*space, *self.constants, *(given[i][k] for i, k in self.inputs)]
        for operation, r, a, b, varies in self.steps:
            if operation is None:
                found[r][b] = now[a]
            elif varies:
                on = (now[a],) if b < 0 else (now[a], now[b])
                now[r] = operation(*on, out=space[r])
            else:
                now[r] = operation(now[a]) if b < 0 else operation(now[a], now[b])


@lru_cache(maxsize=16)
def _program(function: cs.Function) -> _Program | None:
    """The operations of a function; None of one that has others, or too many columns at hand."""
    f = function
    if not f.is_a("SXFunction") or f.sz_w() > constants.MOST_WORK:
        return None
    every = range(f.n_instructions())
    each = [f.instruction_id(k) for k in every]
    fixed = [k for k in every if each[k] == cs.OP_CONST]
    inputs = [k for k in every if each[k] == cs.OP_INPUT]
    place = {k: f.sz_w() + i for i, k in enumerate([*fixed, *inputs])}
    read = [(int(i), int(n)) for i, n in map(f.instruction_input, inputs)]
    # Where each place of the work space is now, and whether that differs from row to row.
    at, varies = list(range(f.sz_w())), [False] * f.sz_w()
    steps: list[Step] = []
    for k in every:
        which, (r, *to), on = each[k], f.instruction_output(k), f.instruction_input(k)
        if k in place:
            at[r], varies[r] = place[k], which == cs.OP_INPUT and on[0] == f.n_in() - 1
        elif which == cs.OP_OUTPUT:
            steps.append((None, r, at[on[0]], to[0], True))
        elif which in OPERATIONS:
            a, b = at[on[0]], at[on[1]] if len(on) > 1 else -1
            at[r], varies[r] = r, any(varies[i] for i in on)
            steps.append((OPERATIONS[which], r, a, b, varies[r]))
        else:
            return None
    return _Program(f, steps, [f.instruction_constant(k) for k in fixed], read)
