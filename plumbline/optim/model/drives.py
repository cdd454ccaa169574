r"""What the diagnosis of a motion found, to take home: every joint's drive with its causes.

``drives.rollout(time, command)`` says what the joints do with other commands, ``drives.as_mjcf()``
is a robot that does the same in MuJoCo, ``drives.save("drives.toml")`` keeps it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plumbline.kinematics.files import new_file
from plumbline.optim.model.driven import Driven
from plumbline.optim.model.drives_file import read, text_of
from plumbline.optim.model.export.drives_mjcf import drives_mjcf
from plumbline.optim.model.export.exported import Exported


@dataclass(frozen=True, eq=False, repr=False)
class Drives(Driven):
    """A robot's drives as a diagnosis found them, and what to do with them."""

    def as_mjcf(self) -> Exported:
        """The robot with these drives as MJCF, read again by MuJoCo where it is installed."""
        return drives_mjcf(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store it as TOML, whole or not at all.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        new_file(path, text_of(self), overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Drives:
        """Bring back what :meth:`save` stored; nothing that is read is run.

        Raises:
            PlumblineError: No such file, no drives, or a damaged file.
        """
        return cls(**read(path))
