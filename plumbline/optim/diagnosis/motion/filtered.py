r"""Roll-outs of drives in which nothing switches: filters, one behind the other.

A step that is a line in its state and its data, :math:`s' = A s + G d + c`, with A triangular in
some order, is no roll-out of all that it keeps together: each of its numbers is a filter of first
order, :math:`x_{k+1} = a x_k + b_k`, of what comes before it in that order, and a filter over all
samples is one triangular system of two bands. Sensitivities are numbers of the state like others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as cs
import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Needs = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Filters:
    """A step as filters, in the order in which they are worked out."""

    lines: cs.Function  # of the fixed numbers: each filter's row, of one, data and filters
    given: list[int]  # which of the data these need
    kept: list[int]  # which numbers of the state they are
    groups: list[tuple[int, int]]  # first and last but one of those that need none of each other
    outputs: list[int]  # which of them are asked for


def filters_of(step: cs.Function, outputs: Sequence[int]) -> Filters | None:
    """A step ``state, data, fixed -> state`` as filters; None where it is not a line, or a loop."""
    state, data, fixed = (cs.SX.sym(name, step.size1_in(k)) for k, name in enumerate("sdf"))
    after, n = step.call([state, data, fixed])[0], state.numel()
    both = cs.vertcat(state, data)
    line = cs.jacobian(after, both)
    if cs.depends_on(line, both):
        return None
    # A number that is worked out like another one, as an output is that nothing is behind of.
    alike = [next(j for j in range(n) if cs.is_equal(after[j], after[i])) for i in outputs]
    needs = np.asarray(cs.DM(line.sparsity(), 1.0)).astype(bool)
    groups = _in_turn(needs[:, :n], set(alike))
    if groups is None:
        return None
    kept = [i for group in groups for i in group]
    given = np.flatnonzero(needs[kept, n:].any(axis=0)).tolist()
    rest = cs.substitute(after, both, cs.DM.zeros(both.numel()))
    rows = cs.horzcat(rest, line[:, [n + k for k in given]], line[:, kept])[kept, :]
    bounds = np.cumsum([0, *map(len, groups)]).tolist()
    return Filters(
        cs.Function("lines", [fixed], [cs.densify(rows.T)]), given, kept,
        list(pairwise(bounds)), [kept.index(i) for i in alike],
    )  # fmt: skip


def _in_turn(needs: Needs, wanted: set[int]) -> list[list[int]] | None:
    """What is needed (n, n), each after all that it needs but its own past; None in a loop."""
    while more := {j for i in wanted for j in np.flatnonzero(needs[i]).tolist()} - wanted:
        wanted = wanted | more
    groups: list[list[int]] = []
    while wanted:
        ready = [i for i in sorted(wanted) if not wanted & set(np.flatnonzero(needs[i])) - {i}]
        if not ready:
            return None
        groups.append(ready)
        wanted = wanted.difference(ready)
    return groups


def filtered(filters: Filters, state: Array, data: Sequence[Array], fixed: Array) -> Array:
    """Outputs (R, K, O) after each of K steps.

    Args:
        filters: The step.
        state: Where each of R roll-outs begins (R, n).
        data: What each step is given, each (R, K).
        fixed: What all of them are given.
    """
    (R, K), more = data[0].shape, 1 + len(filters.given)
    own = np.empty((more + len(filters.kept), R, K + 1))  # what a step starts from, and is given
    own[0], own[1:more, :, K] = 1.0, 0.0
    for row, k in enumerate(filters.given):
        own[1 + row, :, :K] = data[k]
    # Rows of the filters, at fixed numbers
    lines = np.empty((len(filters.kept), 1 + len(filters.given) + len(filters.kept)))
    handle: Any = filters.lines.buffer()
    buffer, run = handle
    buffer.set_arg(0, fixed.data)
    buffer.set_res(0, lines.data)
    run()
    flat, begin = own.reshape(len(own), -1), state.T[filters.kept]
    band = np.ones((2, flat.shape[1]), order="F")
    for first, last in filters.groups:
        n, end = more + first, more + last
        np.matmul(lines[first:last, :n], flat[:n, :-1], out=flat[n:end, 1:])
        own[n:end, :, 0] = begin[first:last]
        for row in range(first, last):
            if stays := lines[row, more + row]:
                band[1] = -stays
                band[1, K :: K + 1] = 0.0  # where the next roll-out begins
                flat[more + row] = scipy.linalg.blas.dtbsv(
                    1, band, flat[more + row], lower=1, diag=1
                )
    return own[[more + k for k in filters.outputs], :, 1:].transpose(1, 2, 0)
