r"""A gear's many small orders as one term: a whole spectrum under one width and one prior.

.. math:: \delta q_j = s \sum_{N=3}^{40} N^{-1/2} (a_N \sin N q_j + b_N \cos N q_j), \qquad
          a_N, b_N \sim N(0, 1)

That a gear errs is one hypothesis, however many of its orders show. Were each a term of its own,
which of them fewer rows find would be chance, and a smooth function of the angle, one term, would
do what is left. The process is that in which a spectrum is carried (posterior/spectrum). It is as
fine as its highest order and has no more in its lowest: what bends once over the way, or at one
place, is not like it. It is one form more
of its cause, as probable as a single order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.effects.confined import parts_of
from plumbline.kinematics.effects.effect import Effect
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import NYSTROM
from plumbline.optim.diagnosis.discrepancy.dependence import OfAnySize
from plumbline.optim.diagnosis.linearise.linear import Columns
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import HIGHEST_ORDER, USUAL
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Spectrum(OfAnySize):
    """All orders of one joint's gear, as columns of the linear problem."""

    effect: Effect  # one of them
    columns: Columns  # its columns (k,)


def spectra(pool: Pool, recording: Recording, ports: Ports) -> tuple[list[int], list[Array]]:
    """Of every gear the number of a candidate, and the columns (k, N, m) of all its orders.

    Args:
        pool: The candidates.
        recording: The rows (N).
        ports: Ports of these rows.
    """
    forms = dict.fromkeys(GearRipple.forms(scope_of(recording)))
    first: dict[int, int] = {}
    for k, candidate in enumerate(pool.candidates):
        effect = candidate.effect
        if isinstance(effect, GearRipple) and effect in forms and parts_of(effect) is None:
            first.setdefault(effect.joint, k)
    found = []
    for joint, k in first.items():
        own = (e for e in forms if isinstance(e, GearRipple) and e.joint == joint)
        orders = np.array([e.order for e in own if e.order <= HIGHEST_ORDER])
        if len(orders):
            functions = _process(recording.q[:, joint - 1], orders)
            found.append((k, USUAL * functions[:, :, None] * ports.joint[joint - 1]))
    return [k for k, _ in found], [columns for _, columns in found]


def _process(angle: Array, orders: Array) -> Array:
    """Leading features (K, N) of the process of these orders (o,) at some angles (N,) [rad]."""
    phase = orders[:, None] * angle
    waves = np.concatenate([np.sin(phase), np.cos(phase)]) / np.sqrt(np.tile(orders, 2))[:, None]
    values, vectors = np.linalg.eigh(waves @ waves.T)
    return np.asarray(vectors[:, values > values.sum() * NYSTROM].T @ waves)


def orders_of(pool: Pool, chosen: Sequence[SelectedTerm], effect: Effect) -> list[SelectedTerm]:
    """Single orders that stand for a gear's spectrum in a fit: those that were chosen, and more.

    One after the other that is more probable than not, given that the gear errs; one at least.
    """
    key = (effect.name, effect.element)
    mine = [t for t in chosen if pool.candidates[t.index].key == key]
    others = [t for t in chosen if t not in mine]
    own = [c.key == key for c in pool.candidates]
    shares = np.array([c.log_prior - c.log_cause for c in pool.candidates])
    while True:
        log_odds, scores = pool.selection.odds(pool.selection.reduce([*others, *mine]))
        given = np.where(own & np.isfinite(log_odds), scores.log_bayes + shares, -np.inf)
        best = int(np.argmax(given))
        if mine and not given[best] > 0.0:
            return mine
        mine.append(SelectedTerm(best, float(scores.scale[best])))
