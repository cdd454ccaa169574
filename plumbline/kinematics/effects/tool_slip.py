r"""The tool was re-seated: at one moment, or between the groups of a recording.

.. math:: p_{tool} \leftarrow p_{tool} + [t > t_s]\, \delta \quad\text{or}\quad
          p_{tool} \leftarrow p_{tool} + \delta_g

with one shift for every group g but the first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs

from plumbline.kinematics.constants import HOURS
from plumbline.kinematics.effects.base_bump import moments, moments_near
from plumbline.kinematics.effects.effect import Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

MOST_GROUPS = 12  # more are a session for each reading: a tool by group is then always fitted


class _Slipped(Effect):
    """Shared by both kinds: the tool sits elsewhere in a part of the rows."""

    name = "tool_slip"
    depends_on = "group"
    stage = Stage.TOOL
    words = "the tool was re-seated and sits elsewhere since"
    reference = "Page (1954), Biometrika 41, sec. 1 (one change point)"
    source = (
        "by hand: a tool set back into its clamp sits within tenths of a millimetre; beyond 20 mm "
        "it is another tool"
    )
    x, y, z = Parameter("m", -0.02, 0.02, 3e-4, doc="shift along the tip frame's {}").each(*"xyz")


@dataclass(frozen=True)
class ToolSlip(_Slipped):
    """A step of the tool's place in the tip frame after the time ``moment`` [s]."""

    moment: float = field(default=0.0, metadata={"unit": "s"})

    needs_one_of = ("time", "group")  # re-seated between groups will do, see candidates
    scanned = "moment"

    @property
    def variant(self) -> str:
        """When it happened."""
        hours = self.moment > HOURS
        return f"at {self.moment / 3600.0:.3f} h" if hours else f"at {self.moment:.5g} s"

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Moments between rows, and all groups of a few."""
        timed = cls.fits(scope) and scope.has("time") and not scope.stands_still("time")
        return [
            *(cls(t) for t in (moments(scope) if timed else ())),
            *ToolByGroup.candidates(scope),
        ]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Of many rows, moments between this one's neighbours among those that were tried."""
        return [replace(self, moment=t) for t in moments_near(scope, self.moment)]

    def apply(self, state: State, *values: cs.SX) -> State:
        return _shifted(state, (state.row["time"] > self.moment) * cs.vertcat(*values))


@dataclass(frozen=True)
class ToolByGroup(_Slipped):
    """A place of the tool for each of the ``groups``, the first of which is as fitted for all."""

    groups: tuple[int, ...] = (0, 1)

    needs = ("group",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Three a group but the first."""
        later = self.groups[1:]
        told = [replace(p, name=f"{p.name} of {g}") for g in later for p in self.declared]
        return tuple(replace(p, doc=f"{p.doc}, group {p.name.split()[-1]}") for p in told)

    @property
    def variant(self) -> str:
        """How many groups."""
        return f"with each of {len(self.groups)} groups"

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """One, where there are a few groups."""
        few = 2 <= len(scope.groups) <= MOST_GROUPS
        return [cls(scope.groups)] if few and cls.fits(scope) else []

    def apply(self, state: State, *values: cs.SX) -> State:
        shift = cs.SX(3, 1)
        for k, g in enumerate(self.groups[1:]):
            here = state.row["group"] == g
            shift += here * cs.vertcat(*values[3 * k : 3 * k + 3])
        return _shifted(state, shift)


def _shifted(state: State, shift: cs.SX) -> State:
    return replace(state, tool=state.tool + shift)
