"""Drives as TOML that a person can read, and the way back: strict, and nothing in it is run."""

from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import fault, one_line, shown
from plumbline.kinematics.drive import Law
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.files import read_file
from plumbline.optim.model.constants import LARGEST_MODEL
from plumbline.optim.model.driven import Driven, Servo
from plumbline.optim.model.reading import (
    SAVE_IT,
    array_of,
    number_of,
    robot_of,
    settings_of,
    tables_of,
    word_of,
)
from plumbline.optim.model.stored import pairs, robot_blocks
from plumbline.optim.recording.settings import Section

FORMAT = "plumbline drives"
VERSION = 1


def is_drives(path: str | Path) -> bool:
    """Whether a file of TOML holds drives; no for what cannot be read."""
    try:
        return f'format = "{FORMAT}"'.encode() in read_file(Path(path), LARGEST_MODEL)[:10_000]
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
    top = settings_of(path)
    for key, expected in (("format", FORMAT), ("version", VERSION)):
        if top.values.get(key) != expected:
            raise top.fault(key, shown(expected), "give what --model wrote of a motion")
    robot, _ = robot_of(top.section("robot"))
    joints = top.words("joints") or ()
    n = len(joints)
    index = tuple(int(k) for k in array_of(top, "index", (n,)))
    if not n or len(set(index)) != n or not all(0 <= k < robot.model.nv for k in index):
        raise top.fault("index", f"{n} places of joints of the robot", SAVE_IT)
    if word_of(top, "command") not in set(Law):
        raise top.fault("command", ", ".join(Law), SAVE_IT)
    gaps = {key: number_of(key, top.values.get(key)) for key in ("before", "after")}
    return gaps | {
        "recording": word_of(top, "recording"),
        "robot": robot,
        "joints": joints,
        "index": index,
        "law": Law(word_of(top, "command")),
        "kp": array_of(top, "kp", (n,)),
        "kd": array_of(top, "kd", (n,)),
        "servos": dict(_servos(top, n)),
    }


def _servos(top: Section, n: int) -> Iterator[tuple[int, Servo]]:
    for block in tables_of(top, "servos", "servos"):
        own = Section(top.file, top.text, block, "servos")
        number = block.get("joint")
        if not isinstance(number, int) or not 1 <= number <= n:
            raise own.fault("joint", f"a number from 1 to {n}", SAVE_IT)
        given = tables_of(own, "effects", "servos.effects")
        where = f"{top.file}, joint {number}"
        effects = tuple(_effect(where, one) for one in given)
        values, std = np.array(
            [
                [number_of(f"{where}, {key}", one.get(key)) for one in given]
                for key in ("value", "std")
            ]
        )
        inertia = number_of(f"{where}, inertia", block.get("inertia"))
        yield number, Servo(effects, values, std, inertia, array_of(own, "span", (2,)))


def _effect(where: str, given: Mapping[str, object]) -> MotionEffect:
    known = {effect.name: effect for effect in MOTION_EFFECTS}
    kind = known.get(str(given.get("effect")))
    if kind is None:
        raise fault(f"{where}, effect", shown(given.get("effect")), ", ".join(known), SAVE_IT)
    own = {f.name: f.default for f in fields(kind)}
    form: dict[str, Any] = {k: v for k, v in given.items() if k not in ("effect", "value", "std")}
    if any(k not in own or type(v) is not type(own[k]) for k, v in form.items()):
        raise fault(f"{where}, {kind.name}", shown(form), f"{own}", SAVE_IT)
    return kind(**form)
