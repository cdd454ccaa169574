"""A model as MJCF: the chain's bodies where they are, and what its drives add where it is known.

Masses and inertias are the robot's own; where it has none, MuJoCo's least ones stand in, which
changes no place.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
import scipy

from plumbline.kinematics.chain import Joint
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.link_export import words, xml_text
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import LEAST_INERTIA, LEAST_MASS, UNTURNED
from plumbline.optim.model.export import exported
from plumbline.optim.model.export.geometry import (
    MUJOCO,
    bodies_of,
    drives_of,
    fixed_part,
    fixed_pose,
    held_by,
    placements,
    tool_of,
)

TOOL = "calibrated_tool"
# Dry friction as hard as MuJoCo has it: held off its command by play, a joint creeps 1 % a second.
FRICTION = {"solreffriction": "0.002 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}


def mjcf(arm: Arm) -> exported.Exported:
    """The model as MJCF, refused if MuJoCo, where it is installed, reads another one again."""
    fixed = fixed_part(arm)
    held = held_by(arm, MUJOCO, gravity=True)
    kept = [k for k, e in enumerate(arm.effects) if e in fixed.effects or e in held.effects]
    missing = exported.lacking(arm, arm.of(kept))
    root = _tree(arm, held)
    root.insert(0, ElementTree.Comment(f"\n{exported.head(arm, missing[0]).replace('--', '-')}\n"))
    text = xml_text(root)
    error = _read_again(arm, text)
    exported.must_agree(arm.recording, "MJCF misses the model", float(np.nan_to_num(error)))
    return exported.Exported(text, TOOL, error, *missing)


def _tree(arm: Arm, held: Arm) -> ElementTree.Element:
    *moved, T_last_tip = placements(arm)
    inertias, gravity = bodies_of(held)
    robot = arm.robot.with_gravity(gravity)
    drives = drives_of(held, MUJOCO)
    root, bodies = world(robot, arm.chain.joints, arm.chain.hangs, moved, inertias, drives)
    parent = bodies[arm.chain.body_of_tip + 1]
    ElementTree.SubElement(parent, "site", {"name": arm.tip_frame} | _place(T_last_tip))
    ElementTree.SubElement(parent, "site", {"name": TOOL} | _place(T_last_tip @ tool_of(arm)))
    return root


def world(
    robot: Robot,
    joints: Sequence[Joint],
    hangs: Sequence[int],
    placements: Sequence[Array],
    inertias: Sequence[pin.Inertia],
    drives: Mapping[int, Mapping[str, float]],
) -> tuple[ElementTree.Element, list[ElementTree.Element]]:
    """A robot's bodies as MJCF: the root, and the elements of the world and of every body (n + 1).

    Each joint hangs on one, from 0, or on the base (-1), at a place (4, 4) [m] in it, and carries
    an inertia; ``drives`` are more attributes of a joint, by its number from 1.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    least = {"boundmass": repr(LEAST_MASS), "boundinertia": repr(LEAST_INERTIA)}
    ElementTree.SubElement(root, "compiler", {"angle": "radian", "autolimits": "true", **least})
    ElementTree.SubElement(root, "option", gravity=words(robot.gravity))
    bodies = [ElementTree.SubElement(root, "worldbody")]
    for k, (joint, T) in enumerate(zip(joints, placements, strict=True), start=1):
        on = bodies[hangs[k - 1] + 1]
        bodies.append(ElementTree.SubElement(on, "body", {"name": f"link_{k}"} | _place(T)))
        _inertial(bodies[-1], inertias[k - 1])
        kind = "hinge" if joint.kind == "revolute" else "slide"
        own = {"name": joint.name, "type": kind, "axis": words(joint.axis)}
        if np.isfinite([joint.lower, joint.upper]).all():
            own["range"] = words(np.array([joint.lower, joint.upper]))
        own |= {key: repr(float(value)) for key, value in drives.get(k, {}).items()}
        own |= FRICTION if float(own.get("frictionloss", 0.0)) else {}
        ElementTree.SubElement(bodies[-1], "joint", own)
    return root, bodies


def _inertial(body: ElementTree.Element, inertia: pin.Inertia) -> None:
    values, axes = np.linalg.eigh(inertia.inertia)
    values = np.maximum(values, LEAST_INERTIA)
    values[2] = min(values[2], values[0] + values[1])  # of a body: no more than the other two
    place = homogeneous(axes * np.sign(np.linalg.det(axes)), inertia.lever)
    own = {"mass": repr(max(float(inertia.mass), LEAST_MASS)), "diaginertia": words(values)}
    ElementTree.SubElement(body, "inertial", own | _place(place))


def _place(T: Array) -> dict[str, str]:
    quaternion = scipy.spatial.transform.Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    return {"pos": words(T[:3, 3]), "quat": words(quaternion)}


def _read_again(arm: Arm, text: str) -> float:
    if not exported.has_mujoco():
        return float("nan")
    q = arm.samples["q"]
    missed = np.abs(exported.frames_by_mujoco(text, TOOL, q) - fixed_pose(arm, q))
    place, turn = float(missed[:, :3, 3].max()), float(missed[:, :3, :3].max())
    return max(place, turn) if turn > UNTURNED else place
