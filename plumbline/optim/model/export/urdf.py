"""A model as URDF: the robot's own with other joint origins, and a link where the tool is."""

import numpy as np

from plumbline.kinematics import link_export
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import dynamics_of_chain
from plumbline.optim.model.arm import MOTION, Arm
from plumbline.optim.model.export import exported, geometry
from plumbline.optim.model.export.exported import frames_by_pinocchio, torques_by_pinocchio
from plumbline.optim.model.fitted import chain_of
from plumbline.optim.recording.kinds import EFFORTS

TOOL = "calibrated_tool"


def urdf(arm: Arm) -> exported.Exported:
    """The model as URDF, read again by Pinocchio (PlumblineError: it stands otherwise)."""
    if arm.robot.urdf is None:
        exported.must_be_one_arm(arm, "URDF of a robot from MJCF")
    fixed, held = geometry.fixed_part(arm), geometry.held_by(arm, geometry.URDF, gravity=False)
    kept = [k for k, e in enumerate(arm.effects) if e in fixed.effects or e in held.effects]
    missing = exported.lacking(arm, arm.of(kept))
    if arm.robot.urdf is None:
        text = link_export.made_urdf(geometry.corrected_table(arm), arm.robot.name)
    else:
        text = link_export.edited_urdf(arm.chain, geometry.placements(arm), arm.robot.urdf)
    names = Robot.from_urdf(text).tip_frames
    tip = link_export.NAME if link_export.NAME in names else arm.tip_frame
    tip = tip if tip in names else link_export.safe_tip(tip)
    text = link_export.with_frame(_with_efforts(held, text, tip), tip, TOOL, geometry.tool_of(arm))
    q = arm.samples["q"]
    error = float(np.abs(frames_by_pinocchio(text, TOOL, q) - geometry.fixed_pose(arm, q)).max())
    exported.must_agree(arm.recording, "URDF misses the model", error)
    said = exported.head(arm, missing[0]).replace("--", "-")
    declared, _, body = text.partition("?>") if text.startswith("<?xml") else ("", "", text)
    begin = f"{declared}?>\n" if declared else ""
    return exported.Exported(f"{begin}<!--\n{said}\n-->\n{body.lstrip()}", TOOL, error, *missing)


def _with_efforts(held: Arm, text: str, tip: str) -> str:
    """The URDF with what of the efforts it holds, refused if Pinocchio reads others again."""
    if held.observation != EFFORTS:
        return text
    own, chain = geometry.drives_of(held, geometry.URDF), _chain(held, text, tip)
    wanted = [one.toDynamicParameters() for one in geometry.bodies_of(held)[0]]
    more = np.array(wanted) - dynamics_of_chain(chain).inertial
    numbered = list(enumerate(held.chain.joint_names))
    made = link_export.weighed_urdf(
        text,
        {name: more[k] for k, name in numbered if np.abs(more[k]).any()},
        {name: own.get(k + 1, {}) for k, name in numbered},
    )
    q, context = exported.samples_of(held)
    v, a = (context.get(name, np.zeros_like(q)) for name in MOTION[1:])
    said = geometry.sliding(held).tau(q, v, a, payload=0.0)
    worst = float(np.abs(torques_by_pinocchio(_chain(held, made, tip), q, v, a) - said).max())
    worst /= float(np.abs(said).max())
    exported.must_agree(held.recording, "URDF's torques miss the model's", worst, " of the largest")
    return made


def _chain(held: Arm, text: str, tip: str) -> Chain:
    robot = Robot.from_urdf(text, gravity=held.robot.gravity)
    return chain_of(robot, tip, held.observation, held.ranges)
