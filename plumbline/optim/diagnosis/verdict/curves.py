r"""A ripple as one curve with its band, whatever orders it was fitted by.

.. math:: e(q) = B(q)\, \theta, \qquad \mathrm{std}\, e(q) = \sigma \sqrt{B(q)\, G^{-1} B(q)^T}

with the sines and cosines B of all orders of one joint, their estimates and the normal matrix G of
the whole fit: what orders share, as neighbouring ones do, is in the band.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.effects.confined import plain
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import A_PERIOD, POINTS
from plumbline.optim.diagnosis.findings import Curve, Key, NoiseLevel
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.measurement.observation import loaded_chain


def curve_of(selected: SelectedModel, key: Key, noise: NoiseLevel) -> Curve | None:
    """The curve of a cause's ripples over the joint's recorded range; none of other causes.

    Of a ripple too fast for so many points, the middle of that range is shown.
    """
    terms = [t for t in selected.model.terms if (t.effect.name, t.effect.element) == key]
    ripples = [t for t in terms if isinstance(t.effect, TransmissionRipple)]
    if not ripples or len(ripples) < len(terms):
        return None
    readings = selected.model.recording.q[:, int(key[1] or 1) - 1]
    fastest = max(_fastest(t.effect) for t in ripples)
    angle = _angles(float(readings.min()), float(readings.max()), fastest)
    q = np.zeros((len(angle), selected.model.recording.chain.n))
    q[:, int(key[1] or 1) - 1] = angle
    basis = np.hstack([_basis(selected, t.effect, q) for t in ripples])
    columns = np.concatenate([np.arange(t.columns.start, t.columns.stop) for t in ripples])
    value = basis @ selected.best.x[columns]
    matrix, sigma = selected.best.gram.matrix, noise.sigma * max(noise.ratio, 1.0)
    covariance = np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)[np.ix_(columns, columns)]
    std = sigma * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", basis, covariance, basis), 0.0))
    return Curve(tuple(angle.tolist()), tuple(value.tolist()), tuple(std.tolist()))


def _fastest(effect: Effect) -> float:
    assert isinstance(effect, TransmissionRipple)
    return float(effect.order) * (len(effect.parameters) // 2)


def _angles(low: float, high: float, fastest: float) -> Array:
    """Angles (K,) [rad] that show a sine of that order, evenly over the range or its middle."""
    wanted = int(np.ceil((high - low) * fastest / (2 * np.pi) * A_PERIOD)) + 1
    if wanted <= POINTS:
        return np.linspace(low, high, max(wanted, POINTS // 6))
    half = 0.5 * (high - low) * POINTS / wanted
    return np.linspace(-half, half, POINTS) + (low + high) / 2


def _basis(selected: SelectedModel, effect: Effect, q: Array) -> Array:
    """What each parameter of a ripple, at one, adds to the joint's angle (K, p)."""
    chain = loaded_chain(selected.model.recording.chain)
    reading, theta = cs.SX.sym("q", chain.n), cs.SX.sym("theta", len(effect.parameters))
    moved = plain(effect).apply(
        State.ideal(chain, {"q": reading}, cs.SX(3, 1)), *cs.vertsplit(theta)
    )
    slope = cs.densify(cs.jacobian(moved.q[int(effect.element or 1) - 1], theta))
    function = cs.Function("basis", [reading], [slope.T]).map(len(q))
    return np.asarray(function(q.T).full().T)
