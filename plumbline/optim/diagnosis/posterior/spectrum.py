r"""What is carried to postures that the recording lacks: whole spectra, with all of the library.

.. math:: a_N, b_N \sim N(0,\ s_{j,N}^2), \quad s_{j,N} = s_j / \sqrt N, \quad N = 1 .. 40,
          \qquad z_e \sim N(0,\ s_e^2\,\mathrm{scale}^2)

Over less than a turn neighbouring orders look alike. The few that a search picks may cancel each
other there with amplitudes that are far too large, and do not cancel where the recording holds no
posture. All whole orders together under one prior a joint fall back to nothing there. So it is with
what bends, tilts or displaces links: which of many small causes was picked is chance, and what it
says for the others holds among these rows alone. All that acts by the posture is carried, each
effect's parameters, of all elements, under one prior. The widths :math:`s` are those of the
greatest evidence (MacKay 1992, Neural Computation 4, sec. 4): at a maximum, :math:`s_j^2` is the
mean of :math:`m_N^2 + \Sigma_{NN}` over the orders. What belongs to its session, and what is
always fitted, stays near its fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from plumbline.kinematics.effects import EFFECTS, Effect, Stage
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.prior import (
    HIGHEST_ORDER,
    ROUNDS,
    SPECTRUM_FROM,
    USUAL,
    VARIANCE_ROUNDS,
    WIDE_PRIOR,
)
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.measurement.refit import always_fitted, candidates_of, runs_once
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Carried:
    """Effects and their values, stacked in the effects' order."""

    effects: tuple[Effect, ...]  # the effects
    values: Array  # their values
    # where ripples were filled up: the model, its unknowns (P,) and their inverse covariance (P, P)
    whole: tuple[MeasurementModel, Array, Array] | None = None


def as_spectra(
    recording: Recording,
    effects: Sequence[Effect],
    best: Solution,
    library: Sequence[type[Effect]] = EFFECTS,
) -> Carried:
    """The model with the ripples of every joint that has many of them as a spectrum.

    Args:
        recording: The N rows of the fit.
        effects: The fitted effects; their values are the last unknowns.
        best: The fit.
        library: Effects of which what acts by the posture alone is carried with them, too.
    """
    sizes = [len(e.parameters) for e in effects]
    values = np.split(best.x[len(best.x) - sum(sizes) :], np.cumsum(sizes))
    joints = _joints_with_spectra(effects)
    if not joints:
        return Carried(tuple(effects), np.concatenate([np.empty(0), *values]))
    others = (e for e in candidates_of(recording, library) if _by_posture(e))
    filled = _filled(tuple(dict.fromkeys((*effects, *others))), joints)
    full = build_model(recording, filled, weights=best.problem.weights)
    known = dict(zip(effects, values, strict=False))
    x = full.start.copy()
    for term in full.terms:
        x[term.columns] = known.get(term.effect, x[term.columns])
    prior = _Prior.of(full, joints, always_fitted(recording))
    centre = np.where(prior.family >= 0, full.start, x)
    ends = full.problem.lower - centre, full.problem.upper - centre
    for _ in range(ROUNDS):
        gram = Solution(full.problem, x).gram
        noise = 2 * best.cost / gram.count
        right = gram.matrix @ (x - centre) - gram.vector
        mean, spread = prior.most_probable(gram.matrix / noise, right / noise, *ends)
        x = centre + mean
        precision = gram.matrix / noise + np.diag(spread**-2)
    return Carried(filled, x[full.fixed :], (full, x, precision))


def _by_posture(effect: Effect) -> bool:
    """Whether it is of the arm and acts by the joints alone, not by their way or other columns."""
    of_device = effect.stage is Stage.SENSOR or isinstance(effect, TransmissionRipple)
    return not (of_device or effect.remembers or {*effect.needs, *effect.needs_one_of})


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
    """Which unknowns share a width: those of a joint's spectrum, or of an effect."""

    family: NDArray[np.intp]  # number of the width of every unknown (P,), -1 where it has none
    shape: Array  # its share of that width (P,)
    flat: Array  # width of the prior of the others about their fit (P,)

    @classmethod
    def of(cls, model: MeasurementModel, joints: Sequence[int], always: Sequence[Effect]) -> Self:
        """Of a model whose ripples are filled up."""
        family, shape = np.full(model.problem.size, -1), model.problem.scale.copy()
        numbers: dict[object, int] = {}
        for term in model.terms:
            effect = term.effect
            if isinstance(effect, TransmissionRipple):
                if effect.joint in joints:
                    family[term.columns] = numbers.setdefault(effect.joint, len(numbers))
                    shape[term.columns] = USUAL * effect.order**-0.5
            elif not runs_once(effect) and effect not in always:
                family[term.columns] = numbers.setdefault(effect.name, len(numbers))
        return cls(family, shape, WIDE_PRIOR * model.problem.scale)

    def most_probable(
        self, matrix: Array, right: Array, lower: Array, upper: Array
    ) -> tuple[Array, Array]:
        """The mean (P,), from the centre, under the prior's widths (P,) of the greatest evidence.

        An unknown that would leave its bounds is held there, and the others are asked again.

        Args:
            matrix: Information (P, P) of the rows.
            right: Information times the estimate that the rows alone would give (P,).
            lower: Bounds (P,), from the centre.
            upper: Bounds (P,).
        """
        width = np.ones(int(self.family.max()) + 1)
        mean, held = np.zeros(len(right)), np.zeros(len(right), dtype=bool)
        for _ in range(VARIANCE_ROUNDS):
            spread = np.where(self.family >= 0, width[self.family] * self.shape, self.flat)
            free = np.where(held, 0.0, spread)
            mean = np.where(held, mean, 0.0)
            factor = cho_factor(matrix * np.outer(free, free) + np.eye(len(free)))
            unit = cho_solve(factor, (right - matrix @ mean) * free)
            variance = np.diag(cho_solve(factor, np.eye(len(free))))
            mean = np.clip(mean + unit * free, lower, upper)
            pull = right - matrix @ mean
            held = ((mean <= lower) & (pull <= 0.0)) | ((mean >= upper) & (pull >= 0.0))
            growth = unit**2 + variance  # of the unit-width amplitudes: 1 at the fixed point
            width *= [np.sqrt(growth[self.family == k].mean()) for k in range(len(width))]
        return mean, spread
