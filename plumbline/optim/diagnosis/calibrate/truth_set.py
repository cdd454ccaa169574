r"""The set of causes that holds the truth with 90 %, and where true values rank among stated ones.

The score of a simulated case is the least probability :math:`p` that a true cause of it was given.
Of n cases take the threshold

.. math:: p^* = p_{(\lfloor (n + 1)(1 - 0.9) \rfloor)} \quad \text{from the least},

and the causes stated at :math:`p^*` or more hold those of the next case alike with 90 % at least
(split conformal prediction; Vovk, Gammerman and Shafer 2005, ch. 2). The rank of a true value is
its place in the normal that was stated of it, :math:`\Phi((x^* - x) / \sigma)`: as often in each
tenth, if values and errors are right (Talts et al. 2018, arXiv:1804.06788).
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from plumbline.optim.diagnosis.calibrate.simulation import Fault
from plumbline.optim.diagnosis.findings import Cause
from plumbline.optim.diagnosis.prior import TRUTH_HELD


def threshold(scores: Sequence[float]) -> float | None:
    """The probability from which the set takes causes; None where there are too few cases."""
    place = int(np.floor((len(scores) + 1) * (1.0 - TRUTH_HELD) + 1e-9))
    return sorted(scores)[place - 1] if place else None


def ranks(causes: Sequence[Cause], fault: Fault) -> tuple[float, ...]:
    """Where the true value of each parameter lies among what was stated of it, 0 to 1."""
    named = {(cause.effect, cause.element): cause for cause in causes}
    found, start = [], 0
    for effect in fault.effects:
        cause = named.get((effect.name, effect.element))
        for k, parameter in enumerate(effect.parameters):
            stated = cause.parameters.get(parameter.name) if cause else None
            if stated is not None and not stated.at_bound and stated.std > 0.0:
                found.append(float(ndtr((fault.values[start + k] - stated.value) / stated.std)))
        start += len(effect.parameters)
    return tuple(found)


def histogram(places: Sequence[float]) -> tuple[int, ...]:
    """How many ranks lie in each tenth."""
    return tuple(int(n) for n in np.histogram(places, 10, (0.0, 1.0))[0])
