r"""The fitted robot as files, read again before anyone relies on them.

What the chain read from the URDF, or from the DH rows, is held against the product of the fitted
links, worked out here in NumPy:

.. math:: \max_q |T_{file}(q) - T_{fit}(q)| \le 10^{-9} .
"""

import tomllib
from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.link_export import NAME, dh_toml, safe_tip, urdf_text
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit.answer import DHFit
from plumbline.optim.dh_fit.constants import AGREES, POSTURES
from plumbline.optim.dh_fit.softness import joints
from plumbline.optim.rigid import some_of


@dataclass(frozen=True)
class ExportedLinks:
    """A robot as text."""

    text: str  # the file's content
    tip_frame: str  # name of the tip frame in it
    error: float  # largest difference of a placement from the fit's [m, or of a rotation's entry]


def as_urdf(fit: DHFit) -> ExportedLinks:
    """The fitted robot as a URDF, refused if, read again, it stands elsewhere."""
    text = urdf_text(fit.links, fit.recording.robot)
    robot = Robot.from_urdf(text, gravity=fit.recording.robot.gravity)
    tip = NAME if NAME in robot.tip_frames else fit.recording.tip_frame
    return _checked(fit, text, robot, tip, "URDF")


def as_toml(fit: DHFit) -> ExportedLinks:
    """The fitted robot as DH rows in TOML, as the bundled robots are stored; refused likewise."""
    name = fit.recording.robot.name
    comment = (
        f"{name}, its links fitted to {len(fit.readings)} tip readings of {fit.recording.name}.\n"
        f"Tip in the tip frame, m: {', '.join(f'{v:.9g}' for v in fit.tool)}."
    )
    source = f"plumbline dhfit on {fit.recording.name}, sha256 {fit.recording.sha256[:12]}"
    text = dh_toml(fit.links, name=f"{name}-fitted", source=source, comment=comment)
    table = tomllib.loads(text)
    tip = str(table["tip_frame"])
    robot = Robot.from_dh(table["dh"], tip_frame=tip, gravity=table["gravity"])
    return _checked(fit, text, robot, tip, "DH rows")


def _checked(fit: DHFit, text: str, robot: Robot, tip: str, what: str) -> ExportedLinks:
    tip = tip if tip in robot.tip_frames else safe_tip(tip)
    q = fit.recording.q[some_of(len(fit.recording), POSTURES)]
    worst = float(np.abs(robot.chain(tip).placement(q) - joints(fit.links, q)[-1]).max())
    if not worst <= AGREES:
        raise PlumblineError(
            f"{fit.recording.name}: the exported {what} miss the fit by {worst:.1e}, at most "
            f"{AGREES:.0e} allowed; nothing was written"
        )
    return ExportedLinks(text, tip, worst)
