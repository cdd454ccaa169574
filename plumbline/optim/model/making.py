r"""A model from a fit: its unknowns brought to small changes of frame and tool.

.. math:: C = (P + D^{-2})^{-1}

with the fit's precision P and a width D so large (a thousand times what is usual) that it matters
only to what the rows do not tell, which stays finite.

One recording's part of a joint fit: its own frame and tool, with the causes at work in it.

.. math:: P' = P_{aa} - P_{ab} P_{bb}^{-1} P_{ba}

is the inverse covariance of the unknowns a that are of one recording, whatever the others b are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.confined import parts_of, plain
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.nuisance import Nuisance
from plumbline.optim.model.constants import WIDE
from plumbline.optim.model.fitted import HeldOutGap, by_effect, left_jacobian
from plumbline.optim.model.model import Model
from plumbline.optim.model.rows import columns_of, ranges_of, some_rows
from plumbline.optim.recording.recording import Recording, Session, socket_labels


@dataclass(frozen=True, eq=False)
class FitEnd:
    """Where a fit ended."""

    nuisance: Nuisance  # what was always fitted
    effects: Sequence[Effect]  # the effects
    x: Array  # all unknowns (P,): the nuisances, then the effects' parameters
    scale: Array  # their typical sizes (P,)
    precision: Array  # their inverse covariance (P, P)

    @property
    def covariance(self) -> Array:
        """Of the unknowns (P, P)."""
        matrix = self.precision * np.outer(self.scale, self.scale)
        inverse = np.linalg.inv(matrix + np.eye(len(self.x)) / WIDE**2)
        return np.asarray(inverse * np.outer(self.scale, self.scale))


def model_of(recording: Recording, fit: FitEnd, held: HeldOutGap) -> Model:
    """The model of a fit to a recording's rows."""
    n = fit.nuisance
    x = fit.x[: n.size]
    at = {name: k for k, name in enumerate(n.names)}
    R, t, turned, tool, sockets = _found(n, x)
    centre, A = np.zeros(3), np.eye(len(fit.x))
    if "frame x" in at:
        centre = recording.measured[:, :3].mean(axis=0) + x[[at[f"frame {c}"] for c in "xyz"]]
    for begin in ("frame r", "tool r"):
        if f"{begin}x" in at:
            turn = [at[f"{begin}{c}"] for c in "xyz"]
            A[np.ix_(turn, turn)] = left_jacobian(x[turn])
    columns = columns_of(recording)
    labels = socket_labels(recording) if recording.socket is not None else ()
    return Model(
        recording=recording.name,
        observation=recording.observation,
        robot=recording.robot,
        tip_frame=recording.tip_frame,
        effects=tuple(fit.effects),
        values=fit.x[n.size :].copy(),
        covariance=A @ fit.covariance @ A.T,
        nuisance_names=n.names,
        always=recording.always,
        T_device_base=homogeneous(R, t),
        centre=centre,
        tool_offset=np.array(recording.tool_offset),
        tool=recording.tool_offset + tool,
        R_tip_tool=turned,
        sockets={int(k): place for k, place in zip(labels, sockets.T, strict=False)},
        samples=some_rows(columns),
        ranges=ranges_of(columns),
        held=held,
    )


def beam_model(model: Model) -> Model:
    """The model of ranges: the tool is the beam, its tip where it starts, its z along it.

    Planes belong to the room; of the beam its start is carried with its covariance.
    """
    begin = [f"beam {c}" for c in "xyz"]
    kept = [model.nuisance_names.index(name) for name in begin]
    first = len(model.nuisance_names)
    columns = [*kept, *range(first, len(model.covariance))]
    names = tuple(name.replace("beam", "tool") for name in begin)
    covariance = model.covariance[np.ix_(columns, columns)]
    return replace(model, nuisance_names=names, covariance=covariance)


def _found(n: Nuisance, x: Array) -> tuple[Array, ...]:
    """Rotation and place of the frame, the tool's turn and shift, the sockets, in numbers."""
    parts = [n.T_device_world.R, n.T_device_world.t, n.R_tip_tool, n.tool, n.sockets]
    made = cs.Function("found", [n.x], [cs.densify(part) for part in parts])
    R, t, turned, tool, sockets = (part.full() for part in made.call([cs.DM(x)]))
    return R, t.ravel(), turned, tool.ravel(), sockets


def number_of(session: Session, name: str) -> int:
    """Number of the recording of a name, refused if none; of none the first that has places."""
    names = [part.name for part in session.parts]
    if not name:
        places = [k for k, part in enumerate(session.parts) if part.kind.places]
        return (places or [0])[0]
    if name not in names:
        near = best_matches(name, names)
        raise fault("recording", shown(name), "one of the session", f"best matches: {near}")
    return names.index(name)


def of_part(fit: FitEnd, k: int) -> FitEnd:
    """The fit as recording k has it."""
    own = fit.nuisance.own[k]
    each = by_effect(fit.effects, np.arange(fit.nuisance.size, len(fit.x)))
    kept = [(plain(effect), at) for effect, at in each if k in (parts_of(effect) or (k,))]
    effects, mine = [e for e, _ in kept], np.concatenate([own.columns, *(at for _, at in kept)])
    rest = np.setdiff1d(np.arange(len(fit.x)), mine)
    P = fit.precision
    cross = P[np.ix_(mine, rest)]
    back = np.linalg.pinv(P[np.ix_(rest, rest)], hermitian=True)
    precision = P[np.ix_(mine, mine)] - cross @ back @ cross.T
    return FitEnd(fit.nuisance.parts[k], effects, fit.x[mine], fit.scale[mine], precision)
