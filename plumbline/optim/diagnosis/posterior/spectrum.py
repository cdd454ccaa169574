r"""Ripples as whole spectra: the model that is carried to postures which the recording lacks.

.. math:: a_N, b_N \sim N(0,\ s_{j,N}^2), \qquad s_{j,N} = s_j / \sqrt N, \qquad N = 1 .. 40

Over less than a turn neighbouring orders look alike. The few that a search picks may cancel each
other there with amplitudes that are far too large, and do not cancel where the recording holds no
posture. All whole orders together under one prior a joint fall back to nothing there. The widths
:math:`s_j` are those of the greatest evidence (MacKay 1992, Neural Computation 4, sec. 4): at a
maximum, :math:`s_j^2` is the mean of :math:`m_N^2 + \Sigma_{NN}` over the orders. All other
unknowns stay near their fit: lengths of parallel links, which the rows tell only together, would
else run apart until a bound stops one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import Solution
from plumbline.optim.diagnosis.prior import (
    HIGHEST_ORDER,
    ROUNDS,
    SPECTRUM_FROM,
    USUAL,
    VARIANCE_ROUNDS,
    WIDE_PRIOR,
)
from plumbline.optim.measurement.observation import Model, build_model
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Carried:
    """Effects and their values, stacked in the effects' order."""

    effects: tuple[Effect, ...]  # the effects
    values: Array  # their values
    # where ripples were filled up: the model, its unknowns (P,) and their inverse covariance (P, P)
    whole: tuple[Model, Array, Array] | None = None


def as_spectra(
    recording: Recording,
    effects: Sequence[Effect],
    best: Solution,
    spared: Sequence[Effect] = (),
) -> Carried:
    """The model with the ripples of every joint that has many of them as a spectrum.

    Args:
        recording: The N rows of the fit.
        effects: The fitted effects; their values are the last unknowns.
        best: The fit.
        spared: Effects that are negligible for these rows. At other postures they need not be, so
            they are carried beside whole spectra, within their typical sizes of none.
    """
    sizes = [len(e.parameters) for e in effects]
    values = np.split(best.x[len(best.x) - sum(sizes) :], np.cumsum(sizes))
    joints = _joints_with_spectra(effects)
    if not joints:
        return Carried(tuple(effects), np.concatenate([np.empty(0), *values]))
    filled = _filled((*effects, *spared), joints)
    full = build_model(recording, filled, weights=best.problem.weights)
    known = dict(zip(effects, values, strict=False))
    x = full.start
    for term in full.terms:
        x[term.columns] = known.get(term.effect, x[term.columns])
    prior = _Prior.of(full, joints, spared)
    centre = np.where(prior.family >= 0, 0.0, x)
    for _ in range(ROUNDS):
        gram = Solution(full.problem, x).gram
        noise = 2 * best.cost / gram.count
        right = gram.matrix @ (x - centre) - gram.vector
        mean, spread = prior.most_probable(gram.matrix / noise, right / noise)
        x = np.clip(centre + mean, full.problem.lower, full.problem.upper)
        precision = gram.matrix / noise + np.diag(spread**-2)
    return Carried(filled, x[full.fixed :], (full, x, precision))


def _joints_with_spectra(effects: Sequence[Effect]) -> tuple[int, ...]:
    joints = [e.joint for e in effects if isinstance(e, TransmissionRipple)]
    return tuple(sorted({j for j in joints if joints.count(j) >= SPECTRUM_FROM}))


def _filled(effects: Sequence[Effect], joints: Sequence[int]) -> tuple[Effect, ...]:
    """All whole orders up to the highest of these joints, in place of what the search picked."""
    kept = [
        e
        for e in effects
        if not (
            isinstance(e, TransmissionRipple) and e.joint in joints and e.order <= HIGHEST_ORDER
        )
    ]
    whole: list[Effect] = []
    for joint in joints:
        whole += [TransmissionRipple(joint=joint, order=order) for order in (1, 2)]
        whole += [GearRipple(joint=joint, order=float(n)) for n in range(3, HIGHEST_ORDER + 1)]
    return (*kept, *whole)


@dataclass(frozen=True, eq=False)
class _Prior:
    """Which unknowns belong to which joint's spectrum."""

    family: NDArray[np.intp]  # index of the spectrum of every unknown (P,), -1 for all others
    order: Array  # order of every unknown (P,), one where there is none
    flat: Array  # width of the prior of the others about their fit (P,)

    @classmethod
    def of(cls, model: Model, joints: Sequence[int], spared: Sequence[Effect] = ()) -> _Prior:
        """Of a model whose ripples are filled up, and of effects that no fit has found."""
        size = model.problem.size
        family, order = np.full(size, -1), np.ones(size)
        for term in model.terms:
            effect = term.effect
            if isinstance(effect, TransmissionRipple) and effect.joint in joints:
                family[term.columns] = joints.index(effect.joint)
                order[term.columns] = effect.order
        flat = WIDE_PRIOR * model.problem.scale
        for term in model.terms:
            if term.effect in spared:
                flat[term.columns] = model.problem.scale[term.columns]
        return cls(family, order, flat)

    def most_probable(self, matrix: Array, right: Array) -> tuple[Array, Array]:
        """The mean (P,), from the centre, under the prior's widths (P,) of the greatest evidence.

        Args:
            matrix: Information (P, P) of the rows.
            right: Information times the estimate that the rows alone would give (P,).
        """
        shape = self.order**-0.5
        inside = self.family >= 0
        width = np.full(int(self.family.max()) + 1, USUAL)
        for _ in range(VARIANCE_ROUNDS):
            spread = np.where(inside, width[self.family] * shape, self.flat)
            factor = cho_factor(matrix * np.outer(spread, spread) + np.eye(len(spread)))
            unit = cho_solve(factor, right * spread)
            variance = np.diag(cho_solve(factor, np.eye(len(spread))))
            growth = unit**2 + variance  # of the unit-width amplitudes: 1 at the fixed point
            width *= [np.sqrt(growth[self.family == k].mean()) for k in range(len(width))]
        return unit * spread, spread
