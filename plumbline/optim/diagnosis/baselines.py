r"""Candidates fitted one by one, as a script would: what the search is compared with.

For every effect alone a nonlinear least-squares fit of nuisances and effect, its Jacobian by
forward differences, and the criterion of Schwarz (1978), Ann. Statist. 6(2),

.. math:: \mathrm{BIC} = n \ln \frac{|r|^2}{n} + k \ln n .
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.optimize import least_squares

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.nuisance import Nuisance, nuisances_of
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.recording import Recording

TOLERANCE = 1e-10


@dataclass(frozen=True)
class Single:
    """The fit of one effect, nuisances fitted as well.

    Attributes:
        effect: The effect.
        cost: Half the sum of squared residuals [m^2], or [rad^2] for encoders.
        bic: Schwarz's criterion; the smallest is best.
        seconds: Time of the fit alone, without stating its residual.
    """

    effect: Effect
    cost: float
    bic: float
    seconds: float


def one_by_one(recording: Recording, effects: Iterable[Effect]) -> list[Single]:
    """Fit every effect alone with SciPy's trust region and forward differences.

    Args:
        recording: N rows, all trusted.
        effects: Effects to be fitted, one fit each.
    """
    nuisance = nuisances_of(recording)
    return [_single(recording, effect, nuisance) for effect in effects]


def _single(recording: Recording, effect: Effect, nuisance: Nuisance) -> Single:
    model = build_model(recording, [effect], nuisance=nuisance)
    problem, mapped = model.problem, Mapped(model.problem)

    def residuals(x: Array) -> Array:
        return np.concatenate([mapped.residuals(x).ravel(), mapped.shared(x)[0]])

    residuals(model.start)  # compiled before the clock starts
    begun = perf_counter()
    found = least_squares(
        residuals,
        model.start,
        jac="2-point",
        bounds=(problem.lower, problem.upper),
        x_scale=problem.scale,
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=TOLERANCE,
    )
    seconds = perf_counter() - begun
    n = len(found.fun)
    bic = n * np.log(2.0 * found.cost / n) + problem.size * np.log(n)
    return Single(effect, float(found.cost), float(bic), seconds)
