"""A model as a table of corrections (CSV) for whoever programs a controller.

Rows of kind ``parameter`` are every number that was found, with unit, error and meaning; rows of
kind ``curve`` say, joint by joint and angle by angle, what to add to a reading for all that depends
on this reading alone (zeros, scales, ripples). They go with the links as delivered: files of links
hold the zeros themselves.

A model as rows of Denavit and Hartenberg in TOML, as the bundled robots are stored.
"""

import csv
import io
import tomllib
from collections.abc import Iterator

import casadi as cs
import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.link_export import dh_toml
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import MOST_POINTS, SAME_CONSTANT, SHAKEN, SLIDE_STEP
from plumbline.optim.model.export import exported
from plumbline.optim.model.export.geometry import corrected_table, fixed_part, fixed_pose, tool_of
from plumbline.optim.model.statement import acts_on_places

HEAD = ("kind", "joint", "effect", "name", "at", "value", "std", "unit", "meaning")
STEP = np.pi / 360  # [rad] of a curve: a line between misses order 40 by a hundredth of its size


def table(arm: Arm) -> exported.Exported:
    """The model as CSV; what no curve holds stands in its parameters alone."""
    own = _own(arm)
    missing = exported.lacking(arm, arm.of(own))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEAD)
    writer.writerows(_parameters(arm))
    writer.writerows(_curves(arm.of(own)))
    return exported.Exported(text.getvalue(), "", float("nan"), *missing)


def _own(arm: Arm) -> list[int]:
    """Effects that change one joint by its own reading alone, by index."""
    own = arm.kinds_that(_is_own)
    return [k for k, effect in enumerate(arm.effects) if type(effect) in own]


def _is_own(arm: Arm, effect: Effect) -> bool:
    """Whether it moves a joint by its own reading, and does nothing else."""
    joint = effect.element
    if joint is None or effect.port != "joint" or not acts_on_places(effect):
        return False
    symbols = arm.statement.symbols
    shift = arm.statement.links(arm.statement.row) - symbols["q"]
    if arm.statement.used != ("q",):
        return False
    q = np.random.default_rng(0).uniform(-1.0, 1.0, arm.chain.n)
    made = cs.Function("shift", [symbols["q"]], [shift])
    others = np.arange(arm.chain.n) != joint - 1
    moved = np.where(others, q + SHAKEN, q)
    change = made(moved).full() - made(q).full()
    still = np.append(change, made(q).full()[others])
    return bool(np.abs(still).max() < SAME_CONSTANT)


def _parameters(arm: Arm) -> Iterator[tuple[object, ...]]:
    for name, known in arm.nuisances.items():
        if name in arm.nuisance_names:
            yield "parameter", "", "", name, "", known.value, known.std, known.unit, known.doc
    pairs = [(e, p) for e in arm.effects for p in e.parameters]
    for (effect, p), known in zip(pairs, arm.parameters.values(), strict=True):
        joint = "" if effect.element is None else effect.element
        said = f"{known.doc}; {effect.sentence}"
        name = f"{p.name}{effect.tag}"
        yield "parameter", joint, effect.name, name, "", known.value, known.std, known.unit, said


def _curves(arm: Arm) -> Iterator[tuple[object, ...]]:
    joints = sorted({e.element for e in arm.effects if e.element is not None})
    for joint in joints:
        turning = arm.chain.kinds[joint - 1] == "revolute"
        at = _grid(arm.ranges["q"][:, joint - 1], STEP if turning else SLIDE_STEP)
        q = np.zeros((len(at), arm.chain.n))
        q[:, joint - 1] = at
        unit = "rad" if turning else "m"
        said = f"add to the reading of {arm.chain.joint_names[joint - 1]} of the nominal links"
        added = arm.joint_corrections(q)[:, joint - 1]
        for angle, value in zip(at.tolist(), added.tolist(), strict=True):
            yield "curve", joint, "", "", f"{angle:.6f}", f"{value:.9e}", "", unit, said


def _grid(ends: Array, step: float) -> Array:
    count = int(np.clip(np.ceil((ends[1] - ends[0]) / step), 1, MOST_POINTS))
    return np.linspace(ends[0], ends[1], count + 1)


def dh(arm: Arm) -> exported.Exported:
    """The model as DH rows, refused if, read again, they do not stand where the model has them."""
    exported.must_be_one_arm(arm, "DH rows")
    missing = exported.lacking(arm, fixed_part(arm))
    tool = ", ".join(f"{v:.12g}" for v in tool_of(arm)[:3, 3])
    text = dh_toml(
        corrected_table(arm),
        name=f"{arm.robot.name}-found",
        source=f"plumbline on {arm.recording}",
        comment=f"{exported.head(arm, missing[0])}\nTool in the tip frame, m: {tool}.",
    )
    table = tomllib.loads(text)
    tip = str(table["tip_frame"])
    robot = Robot.from_dh(table["dh"], tip_frame=tip, gravity=table["gravity"])
    q = arm.samples["q"]
    found = robot.chain(tip).placement(q) @ tool_of(arm)
    error = float(np.abs(found - fixed_pose(arm, q)).max())
    exported.must_agree(arm.recording, "DH rows miss the model", error)
    return exported.Exported(text, tip, error, *missing)
