"""A linear axis of some metres is no slide in millimetres; one in millimetres is told by size."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording import constants
from plumbline.optim.recording.building import build_recording
from tests.recording_folders import URDF

TURN = np.pi / 2
ARM = ({"d": 0.2, "alpha": TURN}, {"a": 0.4}, {"a": 0.3}, {"d": 0.1, "alpha": -TURN})
RAIL = ({"kind": "prismatic", "alpha": TURN}, *ARM)
FREE = URDF.replace(' lower="0.0" upper="0.25"', "")  # a URDF that states no limits states zeros


def recorded(robot, kind, travel, scale=1.0, tip_frame=None):
    """A recording of an arm whose one slide goes so far [m], its readings times ``scale``."""
    rng = np.random.default_rng(7)
    chain = robot.chain(tip_frame)
    slide = chain.kinds.index("prismatic")
    q = rng.uniform(-1.5, 1.5, (60, chain.n))
    q[:, slide] = rng.uniform(0.0, travel, 60)
    given = {
        "tip_position": {"measured": chain.tips(q, np.zeros(3)) + rng.normal(0.0, 1e-3, (60, 3))},
        "fixed_point": {"socket": np.arange(60) % 4},
        "joint_position": {"measured": np.where(np.arange(chain.n) == slide, q + 1e-3, np.nan)},
    }[kind]
    scales = np.where(np.arange(chain.n) == slide, scale, 1.0)
    if kind == "joint_position":
        given["measured"] = given["measured"] * scales
    return build_recording(
        observation=kind, robot=robot, q=q * scales, tip_frame=tip_frame, **given
    )


KINDS = ("tip_position", "fixed_point", "joint_position")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("travel", [0.3, 3.0, 12.0])
def test_a_slide_of_some_metres_is_read_in_metres(kind, travel):
    found = recorded(Robot.from_dh(list(RAIL)), kind, travel)
    assert np.ptp(found.q[:, 0]) > 0.9 * travel
    assert not [note for note in found.notes if "millimetres" in note or "deg" in note]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("urdf", [URDF, FREE], ids=["limits", "no limits"])
def test_a_slide_beyond_its_limits_is_a_note_and_no_millimetres(kind, urdf):
    notes = recorded(Robot.from_urdf(urdf), kind, 3.0, tip_frame="tip").notes
    assert [n for n in notes if "outside of the joint's limits" in n] or urdf is FREE
    assert not [n for n in notes if "outside of the joint's limits" in n and urdf is FREE]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("travel", [0.25, 3.0])
def test_a_slide_in_millimetres_is_refused(kind, travel):
    with pytest.raises(PlumblineError, match="looks like millimetres: divide by 1000"):
        recorded(Robot.from_dh(list(RAIL)), kind, travel, scale=1e3)
    with pytest.raises(PlumblineError, match="looks like millimetres: divide by 1000"):
        recorded(Robot.from_urdf(URDF), kind, 0.25, scale=1e3, tip_frame="tip")


@pytest.mark.parametrize("travel", [0.005, 0.02])
def test_a_short_slide_in_millimetres_is_told_by_the_tips(travel):
    """Five millimetres read as five metres are a long axis, but for the tips that they move."""
    with pytest.raises(PlumblineError, match="looks like millimetres: divide by 1000"):
        recorded(Robot.from_dh(list(RAIL)), "tip_position", travel, scale=1e3)


def test_the_factor_lies_midway_between_one_and_a_thousand():
    assert pytest.approx(1000.0**0.5, rel=0.01) == constants.MILLIMETRES
    rail = Robot.from_dh(list(RAIL))
    most = constants.MILLIMETRES * max(rail.chain().reach, constants.LARGEST_TOOL)
    recorded(rail, "joint_position", 1.5 * most)
    with pytest.raises(PlumblineError, match="millimetres"):
        recorded(rail, "joint_position", 2.6 * most)


def test_metres_are_never_counted_as_radians():
    """Four turns are too many for a joint, thirteen metres are a long axis."""
    found = recorded(Robot.from_dh(list(RAIL)), "joint_position", 13.0)
    assert found.q[:, 0].max() > constants.TURNS
    with pytest.raises(PlumblineError, match="'q2'"):
        build_recording(
            observation="joint_position", robot=found.robot, measured=found.measured,
            q=np.add(found.q, [0.0, 13.0, 0.0, 0.0, 0.0]),
        )  # fmt: skip


def test_a_turntable_reaches_as_far_as_the_tool_on_it():
    """Its one joint stands in its base: of the links alone its reach, and any noise, are nought."""
    turntable = Robot.from_dh([{"a": 0.0}])
    angle = np.linspace(-2.0, 2.0, 14)
    tips = 0.3 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    read = tips + np.random.default_rng(1).normal(0.0, 5e-5, tips.shape)
    recording = build_recording(
        observation="tip_position",
        robot=turntable,
        tool_offset=[0.3, 0.0, 0.0],
        q=angle[:, None],
        measured=read,
        noise_std=5e-5,
    )
    assert recording.reach == pytest.approx(0.3)
