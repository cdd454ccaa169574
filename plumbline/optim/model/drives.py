r"""What the diagnosis of a motion found, to take home: every joint's drive with its causes.

``drives.rollout(time, command)`` says what the joints do with other commands, ``drives.as_mjcf()``
is a robot that does the same in MuJoCo, ``drives.save("drives.toml")`` keeps it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from plumbline.errors import fault
from plumbline.kinematics.files import read_file
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import Gap
from plumbline.optim.diagnosis.motion.carrying import MassFindings
from plumbline.optim.diagnosis.motion.constants import OF_A_LINK, OF_A_TIP
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals
from plumbline.optim.measurement import storing as storing
from plumbline.optim.model.constants import HEAD, LARGEST_MODEL, LONGEST_WORD
from plumbline.optim.model.driven import Driven, Servo
from plumbline.optim.model.export.drives_mjcf import drives_mjcf
from plumbline.optim.model.export.exported import Exported
from plumbline.optim.model.stored import SAVE_IT, load, refuse_odd, refuse_words, save

FORM = ("plumbline drives", 2)


def is_drives(path: str | Path) -> bool:
    """Whether a file of TOML holds drives; no for what cannot be read."""
    try:
        return f'format = "{FORM[0]}"'.encode() in read_file(Path(path), LARGEST_MODEL)[:HEAD]
    except (OSError, ValueError):
        return False


def refuse_damaged(file: str, drives: Driven) -> None:
    """Refuse drives whose parts do not fit together."""
    n, index = len(drives.joints), drives.index
    refuse_words(file, drives.recording, *drives.joints)
    there = all(0 <= k < drives.robot.model.nv for k in index)
    if not n or len(set(index)) != n or len(index) != n or not there:
        raise fault(f"{file}, index", str(index), f"{n} places of joints of the robot", SAVE_IT)
    pieces: dict[str, tuple[Array, tuple[int, ...]]] = {
        "gaps": (np.array([drives.before, drives.after]), (2,))
    }
    pieces |= {key: (getattr(drives, key), (n,)) for key in ("kp", "kd")}
    for number, servo in drives.servos.items():
        if not 1 <= number <= n:
            raise fault(f"{file}, servos", f"joint {number}", f"1 to {n}", SAVE_IT)
        where, own = f"joint {number}", (len(servo.effects),)
        pieces |= {f"{where}, values": (servo.values, own), f"{where}, std": (servo.std, own),
                   f"{where}, span": (servo.span, (2,)),
                   f"{where}, inertia": (np.array(servo.inertia), ())}  # fmt: skip
    for body in drives.carried.bodies:
        forms, least = (OF_A_LINK, body.declared[0].lower) if body.link else (OF_A_TIP, 0.0)
        there = len(body.values) in forms and 0 <= body.link <= n and body.values[0] > least
        if not there:
            found = f"{body.values} of link {body.link}"[:LONGEST_WORD]
            raise fault(f"{file}, carried", found, f"a mass above {least:g}", SAVE_IT)
    masses = np.array(drives.carried.values)
    pieces |= {"carried": (masses, masses.shape), "carried_std": (drives.carried_std, masses.shape)}
    refuse_odd(file, pieces)


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
        remarks = [f"{name}: {one}; {one.doc}" for name, one in self.parameters.items()]
        save(path, self, FORM, remarks, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Bring back what :meth:`save` stored; nothing that is read is run.

        Raises:
            PlumblineError: No such file, no drives, or a damaged file.
        """
        found = load(path, cls, FORM)
        refuse_damaged(Path(path).name, found)
        return found


def drives_of(
    signals: Signals,
    joints: Sequence[JointFindings],
    gap: Gap,
    mass: MassFindings | None = None,
) -> Drives:
    """What a diagnosis found of every joint that moved."""
    r = signals.recording
    _, inertia = signals.loads
    servos = {}
    for joint in joints:
        at = joint.number - 1
        span = np.array([signals.command[:, at].min(), signals.command[:, at].max()])
        fit = joint.fit
        servos[joint.number] = Servo(
            fit.effects, fit.theta.copy(), joint.std, float(inertia[:, at].max()), span
        )
    return Drives(
        r.name, r.robot, r.joints, r.index, r.law, r.kp, r.kd, servos,
        gap.before, gap.after, r.lead, signals.drives, r.carried,
        np.empty(0) if mass is None else mass.std,
    )  # fmt: skip
