r"""What a model predicts, in symbols of one row and of all that was fitted.

.. math:: T_{base,tool}(row;\ x) = T_{world,base}\, T_{base,tip}\, T_{tip,tool}, \qquad
          x = (\delta_{frame}, \delta_{tool}, \theta)

The fitted frame and tool stand in the statement as they were found; their unknowns are small
changes, nought at the fit, so that a covariance is one of what can be pictured.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect, State
from plumbline.kinematics.effects.effect import ALL_OBSERVATIONS, FIDUCIALS
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.kinematics.frames import Transform, constant, rotation
from plumbline.kinematics.spectrum import fourier_sum
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.observation import closed_chain
from plumbline.optim.model.fitted import Fitted, by_effect
from plumbline.optim.model.rows import Columns

Valued = tuple[Effect, list[cs.SX]]


@dataclass(frozen=True, eq=False)
class ModelFunctions:
    """Functions of a model, made when first asked for."""

    model: Fitted  # the model
    symbols: dict[str, cs.SX]  # A row's symbols by column

    @classmethod
    def of(cls, model: Fitted, columns: Columns) -> Self:
        """The statement with the columns that there are."""
        return cls(model, {name: cs.SX.sym(name, v.shape[1]) for name, v in columns.items()})

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Columns that the prediction depends on, the joints first."""
        T, links = self._at_the_fit
        whole = cs.vertcat(cs.vec(T.R), T.t, links)
        found = ["q"]
        for name, symbol in self.symbols.items():
            if name != "q" and any(cs.which_depends(whole, symbol, 1, False)):
                found.append(name)
        return tuple(found)

    @cached_property
    def row(self) -> cs.SX:
        """The row (k,) of all used columns."""
        return cs.vertcat(*[self.symbols[name] for name in self.used])

    def values(self, columns: Columns) -> Array:
        """Rows (N, k) of the used columns."""
        return np.hstack([columns[name] for name in self.used])

    @cached_property
    def pose(self) -> cs.Function:
        """``row -> (R (9,), tip (3,))`` of the tool in the base frame."""
        T, _ = self._at_the_fit
        out = cs.densify(cs.vertcat(cs.vec(T.R), T.t))
        return cs.Function("pose", [self.row], [out], ["row"], ["pose"])

    @cached_property
    def links(self) -> cs.Function:
        """``row -> q (n,)``: joint coordinates as the links see them."""
        _, links = self._at_the_fit
        return cs.Function("links", [self.row], [cs.densify(links)], ["row"], ["q_links"])

    @cached_property
    def slope(self) -> cs.Function:
        """``row -> (pose (12,), J (6, n))``: the tool's velocity and spin per joint's."""
        T, _ = self._at_the_fit
        q = self.symbols["q"]
        pose = cs.densify(cs.vertcat(cs.vec(T.R), T.t))
        moved = cs.jacobian(pose, q)
        spins = []
        for j in range(q.numel()):
            spin = cs.reshape(moved[:9, j], 3, 3) @ T.R.T
            spins.append(cs.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]))
        J = cs.vertcat(moved[9:, :], cs.horzcat(*spins))
        return cs.Function("slope", [self.row], [pose, cs.densify(J)], ["row"], ["pose", "J"])

    def by_unknowns(self, *, device: bool) -> cs.Function:
        """``row -> d tip / d x`` (3, P), of the tip in the base's or the device's frame."""
        x = cs.SX.sym("x", len(self.model.names))
        T = self._tool(cs.vertsplit(x) if x.numel() else [], device=device)[0]
        slope = cs.jacobian(T.t, x)
        at = cs.substitute(slope, x, cs.DM(self.model.unknowns))
        return cs.Function("by_unknowns", [self.row], [cs.densify(at)], ["row"], ["slope"])

    @cached_property
    def _at_the_fit(self) -> tuple[Transform, cs.SX]:
        T, links = self._tool([cs.SX(value) for value in self.model.unknowns], device=False)
        R, t, links = cs.cse([T.R, T.t, links])  # what effects share is worked out once
        return Transform(R, t), links

    def _tool(self, x: Sequence[cs.SX], *, device: bool) -> tuple[Transform, cs.SX]:
        """``T_frame_tool``, and the joints as the links see them."""
        model = self.model
        part = dict(zip(model.names, x, strict=True))
        tool = constant(model.tool) + _three(part, "tool ")
        R_tip_tool = rotation(_three(part, "tool r")) @ constant(model.R_tip_tool)
        state = State.ideal(model.chain, self.symbols, tool)
        state = replace(state, R_tip_tool=R_tip_tool)
        parts = by_effect(model.effects, x[len(model.nuisance_names) :])
        effects = [(effect, list(own)) for effect, own in parts if acts_on_places(effect)]
        where = self._device(part) if device else Transform.identity()
        others = [one for one in effects if not _is_ripple(one[0])]
        state, T_frame_tip = closed_chain(_summed(state, effects), others, where)
        return Transform(T_frame_tip.R @ state.R_tip_tool, state.reading), state.q

    def _device(self, part: dict[str, cs.SX]) -> Transform:
        model = self.model
        R, centre = rotation(_three(part, "frame r")), constant(model.centre)
        t = centre + R @ (constant(model.T_device_base[:3, 3]) - centre) + _three(part, "frame ")
        return Transform(R @ constant(model.T_device_base[:3, :3]), t)


def _is_ripple(effect: Effect) -> bool:
    """Whether it is a ripple of whole order, which many can be summed of at once."""
    ripple = type(effect) in (TransmissionRipple, GearRipple)
    return ripple and isinstance(effect, TransmissionRipple) and float(effect.order).is_integer()


def _summed(state: State, effects: Sequence[Valued]) -> State:
    """The state with all ripples of whole orders, joint by joint: two sines for all of them.

    They read the encoder alone and add up, so it is all the same when they act.
    """
    orders: dict[int, dict[int, tuple[cs.SX, cs.SX]]] = {}
    for effect, values in effects:
        if _is_ripple(effect) and isinstance(effect, TransmissionRipple):
            own = orders.setdefault(effect.joint, {})
            for k in range(len(values) // 2):
                order = (k + 1) * int(effect.order)
                sine, cosine = own.get(order, (cs.SX(0), cs.SX(0)))
                own[order] = (sine + values[2 * k], cosine + values[2 * k + 1])
    for joint, own in orders.items():
        state = state.move_joint(joint, fourier_sum(state.reading_of_joint(joint), own))
    return state


def acts_on_places(effect: Effect) -> bool:
    """Whether an effect moves joints, links, the tip or all of CT: not efforts or one marker alone.

    Where a marker is that has moved says nothing of another place.
    """
    of_places = {*ALL_OBSERVATIONS, *FIDUCIALS} & {*effect.observations}
    return bool(of_places) and effect.depends_on != "marker"


def _three(part: dict[str, cs.SX], begin: str) -> cs.SX:
    zero = cs.SX(0)
    return cs.vertcat(*[part.get(f"{begin}{axis}", zero) for axis in "xyz"])
