"""A model as rows of Denavit and Hartenberg in TOML, as the bundled robots are stored."""

import tomllib

import numpy as np

from plumbline.kinematics.link_export import dh_toml
from plumbline.kinematics.robot import Robot
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.export.exported import (
    Exported,
    head,
    lacking,
    must_agree,
    must_be_one_arm,
)
from plumbline.optim.model.export.geometry import corrected_table, fixed_part, fixed_pose, tool_of


def dh(arm: Arm) -> Exported:
    """The model as DH rows, read again.

    Raises:
        PlumblineError: Read again, they do not stand where the model has them.
    """
    must_be_one_arm(arm, "DH rows")
    missing = lacking(arm, fixed_part(arm))
    tool = ", ".join(f"{v:.12g}" for v in tool_of(arm)[:3, 3])
    text = dh_toml(
        corrected_table(arm),
        name=f"{arm.robot.name}-found",
        source=f"plumbline on {arm.recording}",
        comment=f"{head(arm, missing[0])}\nTool in the tip frame, m: {tool}.",
    )
    table = tomllib.loads(text)
    tip = str(table["tip_frame"])
    robot = Robot.from_dh(table["dh"], tip_frame=tip, gravity=table["gravity"])
    q = arm.samples["q"]
    found = robot.chain(tip).placement(q) @ tool_of(arm)
    error = float(np.abs(found - fixed_pose(arm, q)).max())
    must_agree(arm.recording, "DH rows miss the model", error)
    return Exported(text, tip, error, *missing)
