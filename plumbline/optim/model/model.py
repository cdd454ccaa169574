r"""What a diagnosis found, to take home: an arm with its causes, its frame and its tool.

``model.tip(q)`` says where the tip is, ``model.joint_command(q)`` what to command so that it comes
where it should, ``model.save("arm.toml")`` keeps it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.core.problem import Array
from plumbline.optim.model.arm import Arm, unlimited
from plumbline.optim.model.command import (
    Command,
    goals,
    nearest,
    refuse_outside,
    solved,
    starts,
    told,
)
from plumbline.optim.model.export.code import as_c, c_code, function
from plumbline.optim.model.export.exported import Exported
from plumbline.optim.model.export.geometry import fixed_part
from plumbline.optim.model.export.mjcf import mjcf
from plumbline.optim.model.export.table import dh, table
from plumbline.optim.model.export.urdf import urdf
from plumbline.optim.model.rows import postures
from plumbline.optim.model.stored import in_file, load, refuse_damaged, save
from plumbline.optim.recording import storing as storing

FORM = ("plumbline model", 3)


@dataclass(frozen=True, eq=False, repr=False)
class Model(Arm):
    """An arm as a diagnosis found it, and what to do with it."""

    def rollout(self, time: ArrayLike, command: ArrayLike) -> NoReturn:
        """What joints do with commands is told by :class:`.Drives` alone, the model of a motion.

        Raises:
            PlumblineError: Always.
        """
        raise fault(f"{self.recording}, rollout", f"a model of {self.observation}",
                    "one of a motion", "diagnose commands and joints over time")  # fmt: skip

    def joint_command(self, q_wanted: ArrayLike, **context: ArrayLike) -> Command:
        """What to command so that the tool comes where a faultless arm at ``q_wanted`` has it.

        Args:
            q_wanted: Postures (N, n) or (n,) of the nominal arm [rad or m].
            **context: How they will be approached: ``direction``, ``payload``, ``temperature``.

        Raises:
            PlumblineError: A posture outside of the joints' limits, or one that cannot be used.
        """
        wanted = postures(self.chain, q_wanted)
        refuse_outside(self, wanted, "q_wanted")
        return solved(self, wanted, self.nominal.placement(wanted), context, placed=True)

    def joint_command_for(
        self, pose: ArrayLike, *, near: ArrayLike | None = None, **context: ArrayLike
    ) -> Command:
        """What to command so that the tool comes to a pose, or its tip to a point.

        Args:
            pose: Poses (N, 4, 4) or (4, 4), or points (N, 3) or (3,), in the base frame [m].
            near: A posture (n,), or one each (N, n), to stay near to; by default those that the
                recording holds are tried.
            **context: As of :meth:`joint_command`.

        Raises:
            PlumblineError: Neither poses nor points, or a posture that cannot be used.
        """
        goal, posed = goals(pose)
        known = [told(self, near, len(goal))] if near is not None else []
        about = known or starts(self, goal, posed=posed)
        return nearest(self, goal, about, context, posed=posed)

    def corrections_beyond_links(self, q: ArrayLike, **context: ArrayLike) -> Array:
        """What to add to readings (N, n) [rad or m] so that exported links say what the model says.

        The exported URDF, MJCF or DH rows at the readings and these have the tool where the model
        has it: what bends links or tilts the base is told by the joints, too. They tell where
        joints are, and command nothing, so that they go beyond limits where the readings do.

        Args:
            q: Joint readings (N, n) or (n,).
            **context: As of :meth:`placement`.
        """
        read, goal = postures(self.chain, q), self.placement(q, **context)
        return np.asarray(solved(unlimited(fixed_part(self)), read, goal, {}, placed=True).q - read)

    def function(self) -> cs.Function:
        """``(q, ...) -> (T_base_tool (4, 4), J (6, n))`` as a CasADi function of what is read.

        Of a model of efforts, ``(q, velocity, acceleration, ...) -> tau (n,)``.
        """
        return function(self)

    def c_code(self) -> str:
        """The same function as C without any dependence."""
        return c_code(self)

    def as_urdf(self) -> Exported:
        """Links, zeros and tool as URDF, read again by Pinocchio."""
        return urdf(self)

    def as_mjcf(self) -> Exported:
        """The same as MJCF, read again by MuJoCo where it is installed."""
        return mjcf(self)

    def as_dh(self) -> Exported:
        """The same as DH rows in TOML."""
        return dh(self)

    def as_table(self) -> Exported:
        """Every number found, and what to add to each joint's reading, as CSV."""
        return table(self)

    def as_c(self) -> Exported:
        """All of it as C."""
        return as_c(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store it as TOML, whole or not at all.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        known = self.nuisances | self.parameters
        remarks = [f"{name}: {one}; {one.doc}" for name, one in known.items()]
        save(path, self, FORM, remarks, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Bring back what :meth:`save` stored; nothing that is read is run.

        Args:
            path: The file. Effects of your own that it names must have been imported.

        Raises:
            PlumblineError: No such file, no model, or a damaged one.
        """
        found = load(path, cls, FORM)
        try:
            refuse_damaged(Path(path).name, found)
        except (KeyError, IndexError, ValueError) as error:
            raise in_file(path, error) from None
        return found
