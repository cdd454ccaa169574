r"""How far estimates move from state to state, which is a part of what is not known of them.

In a state S of probability :math:`p_S` a term's values are :math:`z_S`, known to :math:`v_S`. Over
all states that hold the term their variance is, by the law of total variance,

.. math:: \sum_S p_S v_S + \sum_S p_S (z_S - \bar z)^2 .
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.slots import TermProblem


def spread(
    problem: TermProblem, states: Sequence[tuple[float, Sequence[SelectedTerm]]]
) -> dict[int, Array]:
    """Root of the second sum for every term (k,), in units of its parameters' scales.

    Args:
        problem: The terms.
        states: Sets of them, each with its share of the probability.
    """
    found: dict[int, list[tuple[float, Array]]] = defaultdict(list)
    for share, state in states:
        columns, precision = stack(problem.candidates, state, problem.variance(state))
        z, at = problem.linear.solve(columns, precision), 0
        for term in state:
            size = len(problem.candidates[term.index].columns)
            found[term.index].append((share, z[at : at + size]))
            at += size
    return {index: _deviation(*zip(*values, strict=True)) for index, values in found.items()}


def _deviation(shares: Sequence[float], values: Sequence[Array]) -> Array:
    mean = np.average(values, axis=0, weights=shares)
    return np.asarray(np.sqrt(np.average((np.array(values) - mean) ** 2, axis=0, weights=shares)))
