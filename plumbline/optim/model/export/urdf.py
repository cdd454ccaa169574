"""A model as URDF: the robot's own with other joint origins, and a link where the tool is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from plumbline.errors import PlumblineError
from plumbline.kinematics.link_export import NAME, edited_urdf, made_urdf, safe_tip, with_frame
from plumbline.kinematics.robot import Robot
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.export.exported import AGREES, Exported, head, lacking
from plumbline.optim.model.export.geometry import (
    corrected_table,
    fixed_part,
    fixed_pose,
    placements,
    tool_of,
)

TOOL = "calibrated_tool"


def urdf(arm: Arm) -> Exported:
    """The model as URDF, read again by Pinocchio.

    Raises:
        PlumblineError: Read again, it does not stand where the model has it.
    """
    lacks, whole, stays = lacking(arm, fixed_part(arm))
    if arm.robot.urdf is None:
        text = made_urdf(corrected_table(arm), arm.robot.name)
    else:
        text = edited_urdf(arm.chain, placements(arm), arm.robot.urdf)
    names = Robot.from_urdf(text).tip_frames
    tip = NAME if NAME in names and arm.tip_frame != NAME else arm.tip_frame
    text = with_frame(text, tip if tip in names else safe_tip(tip), TOOL, tool_of(arm))
    error = read_again(arm, Robot.from_urdf(text), TOOL)
    if not error <= AGREES:
        raise PlumblineError(
            f"{arm.recording}: the exported URDF misses the model by {error:.1e}, at most "
            f"{AGREES:.0e} allowed; nothing was written"
        )
    said = head(arm, lacks).replace("--", "-")
    declared, _, body = text.partition("?>") if text.startswith("<?xml") else ("", "", text)
    begin = f"{declared}?>\n" if declared else ""
    return Exported(f"{begin}<!--\n{said}\n-->\n{body.lstrip()}", TOOL, error, lacks, whole, stays)


def read_again(arm: Arm, robot: Robot, tip: str) -> float:
    """Largest difference of the tool's placements, by Pinocchio, from the model's fixed part."""
    chain = robot.chain(tip)
    q = arm.samples["q"]
    wanted = fixed_pose(arm, q)
    data, frame = chain.model.createData(), chain.model.getFrameId(tip, pin.FrameType.BODY)
    worst = 0.0
    for posture, T in zip(q, wanted, strict=True):
        pin.framesForwardKinematics(chain.model, data, chain.configuration(posture))
        worst = max(worst, float(np.abs(data.oMf[frame].homogeneous - T).max()))
    return worst
