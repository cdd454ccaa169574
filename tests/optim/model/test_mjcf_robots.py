"""Models of robots that came as MJCF, two arms on one trunk: kept, brought back, handed out."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.robot import Robot
from plumbline.optim.model import Drives, Model
from tests.motions import multisine
from tests.optim.model.test_commands import arm as bare
from tests.optim.model.test_drives import drives, one

__all__ = ["bare"]
LINK = """<body name="{s}{k}" pos="{at}"><inertial pos=".1 0 0" mass="2" diaginertia=".1 .1 .1"/>
<joint name="{s}j{k}" type="hinge" axis="{axis}" range="-2 2"/>"""


def twin():
    """A trunk with two arms of three joints, as MJCF."""
    arms = ""
    for side, y in (("l", 0.2), ("r", -0.2)):
        places = ((f"0 {y} .4", "0 1 0"), (".3 0 0", "0 1 0"), (".25 0 0", "0 0 1"))
        arms += "".join(LINK.format(s=side, k=k, at=at, axis=a) for k, (at, a) in enumerate(places))
        arms += f'<site name="{side}tip" pos=".08 0 0"/>' + 3 * "</body>"
    trunk = LINK.format(s="t", k=0, at="0 0 .8", axis="0 0 1")
    world = f"<worldbody>{trunk}{arms}</body></worldbody>"
    return f'<mujoco model="twin"><compiler angle="radian"/>{world}</mujoco>'


@pytest.fixture(scope="module")
def arm(bare):
    q = np.random.default_rng(5).uniform(-1.0, 1.0, (30, 4))
    effects = (REGISTRY["joint_offset"](joint=3), REGISTRY["joint_compliance"](joint=2))
    return replace(
        bare, robot=Robot.from_mjcf(twin()), tip_frame="ltip", effects=effects, samples={"q": q},
        values=np.array([3e-3, 2e-4]), covariance=1e-12 * np.eye(2),
        ranges={"q": np.array([q.min(axis=0), q.max(axis=0)])},
    )  # fmt: skip


def test_the_model_of_one_arm_of_two_is_brought_back(arm, tmp_path):
    arm.save(tmp_path / "arm.toml")
    again, q = Model.load(tmp_path / "arm.toml"), arm.samples["q"]
    np.testing.assert_allclose(again.tip(q), arm.tip(q), atol=1e-15)
    assert again.joint_command(0.9 * q).reached.all()


def test_its_urdf_and_its_mjcf_stand_where_it_does_at_corrected_readings(arm):
    q = arm.samples["q"]
    at = q + arm.corrections_beyond_links(q)
    for made, read in ((arm.as_urdf(), Robot.from_urdf), (arm.as_mjcf(), Robot.from_mjcf)):
        assert made.error < 1e-9
        tip = read(made.text).chain(made.tip_frame).placement(at)[:, :3, 3]
        np.testing.assert_allclose(tip, arm.tip(q), atol=1e-8)


def test_its_drives_are_brought_back(tmp_path):
    made = drives(one((ActuationDelay(), 0.04)), one(), robot=Robot.from_mjcf(twin()))
    made.save(tmp_path / "drives.toml")
    t, u = multisine(2.0)
    again = Drives.load(tmp_path / "drives.toml")
    np.testing.assert_array_equal(again.rollout(t, u), made.rollout(t, u))


def test_a_robot_made_of_no_file_is_not_kept(arm, tmp_path):
    with pytest.raises(PlumblineError, match=r"made of no file.*from_mjcf"):
        replace(arm, robot=replace(arm.robot, mjcf=None)).save(tmp_path / "arm.toml")
    assert not (tmp_path / "arm.toml").exists()


@pytest.mark.parametrize("made", ["as_urdf", "as_dh"])
def test_files_of_one_joint_behind_the_other_refuse_limbs_and_name_the_way_out(arm, made):
    q = np.zeros((3, 7))
    efforts = replace(
        arm, observation="joint_torque", effects=(), values=np.empty(0),
        covariance=np.empty((0, 0)), samples={"q": q}, ranges={"q": np.array([q[0] - 1, q[0] + 1])},
    )  # fmt: skip
    with pytest.raises(PlumblineError, match="found limbs of 7 joints, expected one arm; export M"):
        getattr(efforts, made)()
    assert efforts.as_mjcf().error < 1e-9
