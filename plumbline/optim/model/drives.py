r"""What the diagnosis of a motion found, to take home: every joint's drive with its causes.

``drives.rollout(time, command)`` says what the joints do with other commands, ``drives.as_mjcf()``
is a robot that does the same in MuJoCo, ``drives.save("drives.toml")`` keeps it.

Drives from the diagnosis of a motion.

Drives as TOML that a person can read, and the way back: strict, and nothing in it is run.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from plumbline.errors import fault, one_line, shown
from plumbline.kinematics.drive import Law
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.files import new_file, read_file
from plumbline.kinematics.toml_text import pairs
from plumbline.optim.diagnosis.findings import Gap
from plumbline.optim.diagnosis.motion.search import Joint
from plumbline.optim.diagnosis.motion.signals import Signals
from plumbline.optim.model import reading
from plumbline.optim.model.constants import HEAD, LARGEST_MODEL
from plumbline.optim.model.driven import Driven, Servo
from plumbline.optim.model.export.drives_mjcf import drives_mjcf
from plumbline.optim.model.export.exported import Exported
from plumbline.optim.model.stored import robot_blocks
from plumbline.optim.recording.settings import Section

FORMAT = "plumbline drives"
VERSION = 1


def is_drives(path: str | Path) -> bool:
    """Whether a file of TOML holds drives; no for what cannot be read."""
    try:
        return f'format = "{FORMAT}"'.encode() in read_file(Path(path), LARGEST_MODEL)[:HEAD]
    except (OSError, ValueError):
        return False


def text_of(drives: Driven) -> str:
    """The file's text."""
    head = {
        "format": FORMAT, "version": VERSION, "recording": drives.recording,
        "command": str(drives.law), "joints": list(drives.joints), "index": list(drives.index),
        "kp": drives.kp, "kd": drives.kd, "before": drives.before, "after": drives.after,
    }  # fmt: skip
    begin = [
        f"# {one_line(repr(drives))}",
        "# SI units: m, rad, s, kg, N. Read it with plumbline.load.",
        *pairs(head),
    ]
    blocks = [begin, *robot_blocks(drives.robot, drives.robot.default_tip)]
    for number, servo in drives.servos.items():
        own = {"joint": number, "inertia": servo.inertia, "span": servo.span}
        blocks.append(["[[servos]]", *pairs(own)])
        blocks += list(_effects(servo, drives.law))
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _effects(servo: Servo, law: Law) -> Iterator[list[str]]:
    for effect, value, std in zip(servo.effects, servo.values, servo.std, strict=True):
        form = {f.name: getattr(effect, f.name) for f in fields(effect)} | {"effect": effect.name}
        said = f"  # {effect.unit(law)}; {one_line(effect.parameter.doc)}"
        lines = [*pairs({**form, "value": float(value)}), *pairs({"std": float(std)})]
        lines[-2] += said
        yield ["[[servos.effects]]", *lines]


def read(path: str | Path) -> dict[str, Any]:
    """The fields of stored drives (PlumblineError: no such file, no drives, or a damaged file)."""
    top = reading.settings_of(path, FORMAT, VERSION)
    robot, _ = reading.robot_of(top.section("robot"))
    joints = top.words("joints") or ()
    n = len(joints)
    index = tuple(int(k) for k in reading.array_of(top, "index", (n,)))
    if not n or len(set(index)) != n or not all(0 <= k < robot.model.nv for k in index):
        raise top.fault("index", f"{n} places of joints of the robot", reading.SAVE_IT)
    if reading.word_of(top, "command") not in set(Law):
        raise top.fault("command", ", ".join(Law), reading.SAVE_IT)
    gaps = {key: reading.number_of(key, top.values.get(key)) for key in ("before", "after")}
    return gaps | {
        "recording": reading.word_of(top, "recording"),
        "robot": robot,
        "joints": joints,
        "index": index,
        "law": Law(reading.word_of(top, "command")),
        "kp": reading.array_of(top, "kp", (n,)),
        "kd": reading.array_of(top, "kd", (n,)),
        "servos": dict(_servos(top, n)),
    }


def _servos(top: Section, n: int) -> Iterator[tuple[int, Servo]]:
    for block in reading.tables_of(top, "servos", "servos"):
        own = Section(top.file, top.text, block, "servos")
        number = block.get("joint")
        if not isinstance(number, int) or not 1 <= number <= n:
            raise own.fault("joint", f"a number from 1 to {n}", reading.SAVE_IT)
        given = reading.tables_of(own, "effects", "servos.effects")
        where = f"{top.file}, joint {number}"
        effects = tuple(_effect(where, one) for one in given)
        values, std = np.array(
            [
                [reading.number_of(f"{where}, {key}", one.get(key)) for one in given]
                for key in ("value", "std")
            ]
        )
        inertia = reading.number_of(f"{where}, inertia", block.get("inertia"))
        yield number, Servo(effects, values, std, inertia, reading.array_of(own, "span", (2,)))


def _effect(where: str, given: Mapping[str, object]) -> MotionEffect:
    known = {effect.name: effect for effect in MOTION_EFFECTS}
    kind = known.get(str(given.get("effect")))
    if kind is None:
        raise fault(
            f"{where}, effect", shown(given.get("effect")), ", ".join(known), reading.SAVE_IT
        )
    own = {f.name: f.default for f in fields(kind)}
    form: dict[str, Any] = {k: v for k, v in given.items() if k not in ("effect", "value", "std")}
    if any(k not in own or type(v) is not type(own[k]) for k, v in form.items()):
        raise fault(f"{where}, {kind.name}", shown(form), f"{own}", reading.SAVE_IT)
    return kind(**form)


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
    def load(cls, path: str | Path) -> Self:
        """Bring back what :meth:`save` stored; nothing that is read is run.

        Raises:
            PlumblineError: No such file, no drives, or a damaged file.
        """
        return cls(**read(path))


def drives_of(signals: Signals, joints: Sequence[Joint], gap: Gap) -> Drives:
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
        gap.before, gap.after,
    )  # fmt: skip
