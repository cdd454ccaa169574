r"""How probable each cause is: its slots given all else, the unknown, and what is left over.

A cause is absent if it is absent from every slot of the model and from one slot more, so with
:math:`p_{ks}` its probability in slot s, :math:`P_k = [1 - \prod_s (1 - p_{ks})]\, \pi_k`, where
:math:`\pi_k` is its inclusion probability given the best unknown dependence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import Gap, Key
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.selection import slots
from plumbline.optim.diagnosis.prior import CONFOUNDED_SHARE, EXCLUDED_SHARE, LITTLE_LEFT


def probabilities_of(selected: SelectedModel, outside: Outside) -> dict[Key, float]:
    """Probability that each cause is at work, given all else in the model, and no unknown."""
    candidates = selected.selection.candidates
    absent: dict[Key, float] = {}
    log_odds, _ = selected.selection.scan(selected.selection.reduce(selected.chosen))
    # A rival that would be one cause more speaks against an empty slot only.
    room = float(np.logaddexp(0.0, logsumexp(log_odds)))
    for slot in slots(selected.selection, selected.chosen):
        _count_out(absent, candidates, slot.raised(room).probabilities)
    # What was excluded may still be at work: others have no claim to its share.
    log_odds, _ = selected.whole_selection.scan(selected.whole_selection.reduce(selected.chosen))
    top = max(float(log_odds.max(initial=-np.inf)), 0.0)
    more = np.exp(log_odds - top) / (np.exp(-top) + np.exp(log_odds - top).sum())
    _count_out(absent, candidates, more)
    inclusion = outside.inclusion
    named = {candidates[c.index].key for c in selected.chosen}
    # What is not in the model would have to do what the unknown is believed to do.
    spare = 1.0 - outside.probability
    share = {key: spare * (EXCLUDED_SHARE if key in selected.excluded else 1.0) for key in absent}
    share |= {key: inclusion.get(key, 1.0) for key in named}
    return {key: (1.0 - p) * share[key] for key, p in absent.items()}


def doubted(
    probabilities: dict[Key, float], named: Sequence[Key], beyond: float, left: float
) -> dict[Key, float]:
    """Named causes, as far as they can be believed given what the library lacks.

    The unknown that does the rest may do more, and causes be confounded with a part of it: of
    several some are, far oftener than a lone one is. With one of two true causes taken out of the
    library, 102 of 107 causes named alone together with an unknown were right, and 35 of 117 named
    together, whether half of the gap was left or a twentieth (240 recordings, gaps of 1 to 4 sigma:
    ``withheld bench --only beside --count 240 --seed 556``). Less is doubted where less is left
    than such gaps could show.

    Args:
        probabilities: Of all causes.
        named: The causes of the verdict.
        beyond: Probability that something outside of the library is at work.
        left: Share of the removable gap's square that the causes leave, 0 to 1.
    """
    share = 1.0 - CONFOUNDED_SHARE[len(named) > 1] * beyond * min(
        1.0, float(np.sqrt(left / LITTLE_LEFT))
    )
    return {key: p * (share if key in named else 1.0) for key, p in probabilities.items()}


def left_over_share(gap: Gap) -> float:
    """Share of what noise leaves to remove, as a square, that has not been removed."""
    room = gap.before**2 - gap.noise_floor**2
    rest = gap.after**2 - gap.noise_floor**2
    return float(np.clip(rest / room, 0.0, 1.0)) if room > 0.0 else 1.0


def _count_out(
    absent: dict[Key, float], candidates: Sequence[Candidate], probabilities: np.ndarray
) -> None:
    """Multiply each cause's probability of absence by that of being absent from one more slot."""
    share: dict[Key, float] = {}
    for candidate, p in zip(candidates, probabilities.tolist(), strict=True):
        share[candidate.key] = share.get(candidate.key, 0.0) + p
    for key, p in share.items():
        absent[key] = absent.get(key, 1.0) * (1.0 - min(p, 1.0))
