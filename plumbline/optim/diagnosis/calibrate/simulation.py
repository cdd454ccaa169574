r"""Recordings that could have been: the same rows, with a fault that is known and noise afresh.

The residual of a row is :math:`r(x)`, predicted minus measured. Were the robot at :math:`x^*`, the
same postures would leave :math:`r(x^*) = e` with fresh noise e. What was measured is changed until
it does: a position or an encoder's angle by :math:`r(x^*) - e`, an orientation by the rotation
between the two. A tip in a socket has no measurement; there the joints give way, by the least
change of their angles (Gauss-Newton)

.. math:: q \leftarrow q + J^T (J J^T)^{-1} (e - r(x^*)), \qquad J = \partial r / \partial q .
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import TRIES
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.prior import ROUNDS
from plumbline.optim.measurement import observation
from plumbline.optim.measurement.pose_noise import as_read
from plumbline.optim.measurement.torque import effort_weights
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong in a simulated recording."""

    effects: tuple[Effect, ...] = ()  # the effects
    # their parameters, one after the other (k,)
    values: Array = field(default_factory=lambda: np.empty(0))

    @property
    def keys(self) -> frozenset[Key]:
        """Effect and element of each."""
        return frozenset((e.name, e.element) for e in self.effects)

    def and_also(self, other: Fault) -> Fault:
        """Both at once."""
        return Fault(self.effects + other.effects, np.concatenate([self.values, other.values]))


@dataclass(frozen=True, eq=False)
class Setting:
    """Where faults are simulated: the robot as calibrated before any cause was named."""

    recording: Recording  # the rows (N)
    # of the diagnosis: nuisances, and what is always fitted, at their nominal fit
    selected: SelectedModel
    sigma: float  # noise of one equation [m or rad]
    library: tuple[type[Effect], ...]  # effects to draw from

    def model(self, fault: Fault) -> tuple[observation.MeasurementModel, Array]:
        """The model with a fault in it, and its unknowns (P,) at that fault."""
        effects = [*self.selected.fixed, *fault.effects]
        model = observation.build_model(
            self.recording, effects, nuisance=self.selected.model.nuisance
        )
        return model, np.concatenate([self.selected.nominal.x, fault.values])

    def draw(
        self, ratio: float, rng: np.random.Generator, taken: frozenset[Key] = frozenset()
    ) -> Fault:
        """One fault with this unabsorbed gap over the noise; none where none can be so large.

        Every kind is as likely as every other, then every element, then every variant; what is
        taken already is not drawn again.
        """
        scope = observation.scope_of(self.recording)
        known = {e.name for e in self.selected.fixed}
        kinds = [c for c in self.library if c.name not in known and c.candidates(scope)]
        for _ in range(TRIES if kinds else 0):
            variants = kinds[rng.integers(len(kinds))].candidates(scope)
            elements = list(dict.fromkeys(v.element for v in variants))
            element = elements[rng.integers(len(elements))]
            offered = [v for v in variants if v.element == element]
            fault = self._sized(offered[rng.integers(len(offered))], ratio, rng)
            if fault is not None and not fault.keys & taken:
                return fault
        return Fault()

    def _sized(self, effect: Effect, ratio: float, rng: np.random.Generator) -> Fault | None:
        """A random mixture of the effect's parameters, as large as asked for within its bounds."""
        parameters = effect.parameters
        null, scale, lower, upper = (
            np.array([getattr(p, k) for p in parameters])
            for k in ("null", "scale", "lower", "upper")
        )
        way = rng.normal(size=len(parameters)) * scale
        way = np.where(lower >= null, np.abs(way), way)
        model, x = self.model(Fault((effect,), null))
        J = np.concatenate([part for _, _, part in Mapped(model.problem).jacobians(x)])
        columns = J.reshape(-1, len(x))
        moved = columns[:, -len(parameters) :] @ way
        own = columns[:, : -len(parameters)]
        left = moved - own @ np.linalg.lstsq(own, moved, rcond=None)[0]
        seen = float(np.sqrt(np.mean(left**2)))
        if seen <= 0.0:
            return None
        values = null + way * (ratio * self.sigma / seen)
        inside = np.all((values >= lower) & (values <= upper))
        return Fault((effect,), values) if inside else None

    def recorded(self, fault: Fault, errors: Array) -> Recording:
        """The recording whose residuals at the fault are these errors (N, m) [m or rad]."""
        model, x = self.model(fault)
        if self.recording.kind.sockets:
            return replace(self.recording, q=_given_way(model, x, errors))
        residuals = Mapped(model.problem).residuals(x)
        return replace(self.recording, measured=_as_read(self.recording, residuals, errors))


def _as_read(recording: Recording, residuals: Array, errors: Array) -> Array:
    """Measured values (N, k) that leave the errors in place of the residuals."""
    measured = np.array(recording.measured)
    if recording.kind.efforts:
        return measured + (residuals - errors) / effort_weights(recording)
    if recording.kind.encoders:
        measured[:, list(recording.measured_joints)] += residuals - errors
        return measured
    if recording.pose_spread is not None:
        residuals, errors = (as_read(recording, r) for r in (residuals, errors))
    measured[:, :3] += (residuals - errors)[:, :3]
    if recording.kind.oriented:
        lever = observation.rotation_lever(recording)
        was, wanted = (_turns(r[:, 3:] / lever) for r in (residuals, errors))
        seen = Rotation.from_quat(measured[:, 3:], scalar_first=True)
        measured[:, 3:] = (seen * was * wanted.inv()).as_quat(scalar_first=True)
    return measured


def _turns(sines: Array) -> Rotation:
    """Rotations from their axes times the sines of their angles (N, 3)."""
    size = np.linalg.norm(sines, axis=1, keepdims=True)
    angle = np.arcsin(np.minimum(size, 1.0))
    return Rotation.from_rotvec(sines * np.where(size > 0.0, angle / np.maximum(size, 1e-300), 1.0))


def _given_way(model: observation.MeasurementModel, x: Array, errors: Array) -> Array:
    """Joint readings (N, n) at which the tips leave these errors."""
    recording, problem = model.recording, model.problem
    n = recording.q.shape[1]
    J = cs.jacobian(problem.residual, problem.row)[:, :n]  # joints are a row's first numbers
    both = cs.Function(
        "give_way", [problem.x, problem.row], [cs.densify(problem.residual), cs.densify(J)]
    )
    for _ in range(ROUNDS):
        rows = observation.rows_of(recording, [t.effect for t in model.terms])
        r, J_t = over_rows(both, rows, x)
        J_rows = J_t.transpose(0, 2, 1)
        step = np.linalg.pinv(J_rows) @ (errors - r[:, 0])[:, :, None]
        recording = replace(recording, q=recording.q + step[:, :, 0])
    return np.array(recording.q)
