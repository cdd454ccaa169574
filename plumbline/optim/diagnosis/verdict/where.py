r"""Where the gap lies: shares of the explained square by stage and element.

The share of an element is its Shapley value: the mean, over orders in which elements are let in, of
how much the residual square drops when its turn comes (Lindeman, Merenda, Gold 1980, sec. 4.9). One
Cholesky factor an order gives all drops at once.
"""

from collections.abc import Sequence
from itertools import permutations
from math import ceil, factorial

import numpy as np
from scipy.linalg import solve_triangular

from plumbline.kinematics.evaluate import Indices
from plumbline.optim.diagnosis.findings import Place
from plumbline.optim.diagnosis.linearise.linear import Linear, cholesky
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm, stack
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.prior import DRAWS, LEAST_TOLD


def shares(
    selection: SelectionProblem, chosen: Sequence[SelectedTerm], seed: int = 0, orders: int = DRAWS
) -> tuple[Place, ...]:
    """Shares that sum to one, largest first; none where nothing was chosen.

    Args:
        selection: What was asked.
        chosen: The terms.
        seed: Of the orders in which places are let in.
        orders: From how many of these there are on, so many are drawn.
    """
    if not chosen:
        return ()
    effects = [selection.candidates[c.index].effect for c in chosen]
    places = [(str(e.stage), e.element) for e in effects]
    drops = explained_by(selection, chosen, [str(p) for p in places], seed, orders)
    total = sum(drops.values())
    keyed = {str(p): p for p in places}
    found = [Place(*keyed[k], share=v / total) for k, v in drops.items()]
    return tuple(sorted(found, key=lambda p: -p.share))


def expected_shares(
    selection: SelectionProblem,
    states: Sequence[tuple[float, tuple[SelectedTerm, ...]]],
    seed: int = 0,
) -> tuple[Place, ...]:
    """Their mean over states of the library, each with its weight, given by its log."""
    weights = np.exp(np.array([log for log, _ in states]) - max(log for log, _ in states))
    weights = np.where(weights < LEAST_TOLD, 0.0, weights) / weights.sum()
    found: dict[tuple[str, int | None], float] = {}
    for k, (weight, (_, state)) in enumerate(zip(weights.tolist(), states, strict=True)):
        orders = ceil(weight * DRAWS)
        for place in shares(selection, state, seed + k, orders) if weight else ():
            key = place.stage, place.element
            found[key] = found.get(key, 0.0) + weight * place.share
    total = sum(found.values())
    return tuple(
        Place(*key, share / total)
        for key, share in sorted(found.items(), key=lambda item: -item[1])
    )


def explained_by(
    selection: SelectionProblem,
    chosen: Sequence[SelectedTerm],
    labels: Sequence[str],
    seed: int = 0,
    orders: int = DRAWS,
) -> dict[str, float]:
    """Explained square of each label's terms together, by Shapley."""
    linear: Linear = selection.linear
    variance = selection.variance(chosen)
    columns, precision = stack(selection.candidates, chosen, variance)
    A = linear.G[np.ix_(columns, columns)] + np.diag(precision)
    b = linear.b[columns]
    owners = np.concatenate(
        [np.full(len(selection.candidates[c.index].columns), i) for i, c in enumerate(chosen)]
    )
    names = list(dict.fromkeys(labels))
    group = np.array([names.index(labels[i]) for i in owners])
    drops = np.zeros(len(names))
    ranks = _orders(len(names), seed, orders)
    for rank in ranks:
        order = np.argsort(rank[group], kind="stable")
        lower = cholesky(A[np.ix_(order, order)], np.diag(A)[order])
        seen = solve_triangular(lower, b[order], lower=True, check_finite=False)
        drops += np.bincount(group[order], seen**2, len(names))
    floor = 1e-12 * max(float(drops.max()), 1e-300)
    return dict(zip(names, np.maximum(drops / len(ranks), floor).tolist(), strict=True))


def _orders(count: int, seed: int, most: int = DRAWS) -> Indices:
    """Orders of few elements: all of them; of many: so many, drawn."""
    if factorial(count) <= DRAWS:
        return np.array(list(permutations(range(count))), dtype=np.intp)
    rng = np.random.default_rng(seed)
    return np.array([rng.permutation(count) for _ in range(most)], dtype=np.intp)
