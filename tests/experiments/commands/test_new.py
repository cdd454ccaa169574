"""A template of every kind can be filled in as it stands; an MJCF is read as by MuJoCo."""

from __future__ import annotations

import re
import shlex
import tomllib

import numpy as np
import pinocchio as pin
import pytest

from plumbline import Robot, load
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.importing.templates import TEMPLATES, header, robot_lines, settings
from plumbline.optim.core.answer import restored, stored
from plumbline.optim.recording.kinds import ELSEWHERE, KINDS
from tests.experiments.commands.test_command_line import contents
from tests.recording_folders import URDF, columns, csv_text
from tests.refusals import refused

ORIENTATIONS = (
    "", 'quat="0.6 0.2 -0.7 0.3"', 'euler="20 -50 70"', 'axisangle="1 2 -2 40"',
    'xyaxes="1 0.2 0 -0.2 1 0.3"', 'zaxis="0.1 0.2 1"',
)  # fmt: skip


def test_every_kind_of_recording_has_a_template():
    assert set(KINDS) | set(ELSEWHERE) <= set(TEMPLATES)


@pytest.mark.parametrize("kind", TEMPLATES)
def test_a_template_is_toml_with_and_without_its_remarks(kind):
    text = settings(kind, "bench", robot_lines({"bundled": "ur5"}))
    found = tomllib.loads(text)
    assert (found["name"], found["observation"]) == ("bench", kind)
    keys = re.compile(r"^# (?=\w+ = )", re.MULTILINE)
    robots = re.compile(r"^# (urdf|mjcf|description) = .*\n", re.MULTILINE)
    tomllib.loads(keys.sub("", robots.sub("", text)))
    assert all(len(line) <= 100 for line in text.splitlines())


def test_what_comes_next_can_be_copied_whatever_the_folder_is_called(tmp_path, capsys):
    folder = tmp_path / "arm of Prüfstand 3"
    assert run(["new", str(folder), "--robot", "ur5"]) == 0
    said = capsys.readouterr().out.splitlines()[-1].removeprefix("next: ")
    assert shlex.split(said) == ["plumbline", "check", str(folder)]


@pytest.mark.parametrize(
    "kind", sorted(KINDS.keys() & {"tip_position", "pose", "fixed_point", "joint_position"})
)
def test_a_template_filled_with_rows_passes_the_check(kind, tmp_path):
    folder = tmp_path / "made"
    assert run(["new", str(folder), "--kind", kind, "--robot", "ur5", "-q"]) == 0
    head = (folder / "samples.csv").read_text().strip()
    rows = {name: values for name, values in columns(kind).items() if name in head.split(",")}
    assert ",".join(rows) == head
    (folder / "samples.csv").write_text(csv_text(rows))
    assert run(["check", str(folder), "-q"]) == 0
    assert not [note for note in load(folder).notes if "not used" in note]


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_the_header_of_a_template_has_the_columns_of_its_kind(kind):
    there = header(kind, 6).split(",")
    assert set(ELSEWHERE[kind].columns) <= set(there)
    assert all(f"{prefix}1" in there for prefix in ELSEWHERE[kind].prefixes)


def test_a_template_overwrites_nothing_and_takes_the_robot_s_file_along(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(URDF)
    folder = tmp_path / "made"
    assert run(["new", str(folder), "--robot", str(tmp_path / "arm.urdf")]) == 0
    assert "fill in rows of q1,q2,q3," in capsys.readouterr().out
    assert contents(folder).keys() == {"dataset.toml", "samples.csv", "robot.urdf", "."}
    assert "exists and is not empty" in refused(capsys, "new", folder)
    assert "Best matches are motion" in refused(capsys, "new", tmp_path / "o", "--kind", "motoin")


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        '<robot name="a"><link name="${prefix}base"/></robot>',
        '<robot name="a"><link name="a"/><x f="$(find ur)/a"/></robot>',
    ],
)
def test_xacro_is_refused_with_the_command_that_expands_it(text, tmp_path, capsys):
    (tmp_path / "arm.urdf.xacro").write_text(text)
    said = refused(capsys, "new", tmp_path / "made", "--robot", tmp_path / "arm.urdf.xacro")
    assert "expand it: xacro arm.urdf.xacro > robot.urdf" in said
    folder = tmp_path / "folder"
    assert run(["new", str(folder), "-q"]) == 0
    (folder / "robot.urdf").write_text(text)
    (folder / "samples.csv").write_text("q1,x,y,z\n0,0,0,0\n")
    assert "expand it: xacro robot.urdf > robot.urdf" in refused(capsys, "check", folder)


@pytest.mark.parametrize("left", ["${x}", '<xacro:arm\n x="${x}"/>', "$(arg x) -\n- ${y}"])
def test_xacro_in_a_comment_makes_no_file_a_xacro(left, tmp_path):
    comment = f"<!-- {left} -->"
    text = URDF.replace("<link", f"{comment}\n<link", 2)
    assert text.count(comment) == 2
    (tmp_path / "arm.urdf").write_text(text)
    assert run(["new", str(tmp_path / "made"), "--robot", str(tmp_path / "arm.urdf"), "-q"]) == 0
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", '<link name="${x}"/></robot>'))
    assert run(["new", str(tmp_path / "no"), "--robot", str(tmp_path / "arm.urdf"), "-q"]) == 2


def mjcf(orientation: str, degrees: bool = True, head: str = "") -> str:
    """An arm of four joints, a slide among them, some off their body's origin, one with a ref."""
    rng, body, turn = np.random.default_rng(3), "", 1.0 if degrees else np.pi / 180.0
    for k in range(4):
        slide = k == 2
        span = "-0.3 0.4" if slide else f"{-70 * turn} {80 * turn}"
        ref = f'ref="{20 * turn}"' if k == 1 else ""
        axis = " ".join(map(str, rng.normal(size=3)))
        body += (
            f'<body name="b{k}" pos="0.1 {rng.uniform(-0.2, 0.2)} 0.2" {orientation}>'
            f'<joint name="j{k}" type="{"slide" if slide else "hinge"}" axis="{axis}" {ref}'
            f' pos="0.02 -0.01 0.03" range="{span}"/>'
            '<geom type="capsule" size="0.03" fromto="0 0 0 0.1 0 0.2"/>'
        )
    unit = "degree" if degrees else "radian"
    return (
        f'<mujoco model="arm"><compiler angle="{unit}"/>{head}<worldbody>{body}'
        f'<site name="tip" pos="0.01 0.02 0.1"/>{"</body>" * 4}</worldbody></mujoco>'
    )


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=lambda o: o.split("=")[0] or "none")
@pytest.mark.parametrize("degrees", [True, False], ids=["deg", "rad"])
def test_a_robot_of_an_mjcf_stands_and_weighs_as_in_mujoco(orientation, degrees):
    mujoco = pytest.importorskip("mujoco")
    if not degrees:
        orientation = orientation.replace("20 -50 70", "0.3 -0.9 1.2").replace("-2 40", "-2 0.7")
    text = mjcf(orientation, degrees, '<option gravity="0 1 -9"/>')
    model = mujoco.MjModel.from_xml_string(text)
    data, chain = mujoco.MjData(model), Robot.from_mjcf(text).chain("tip")
    np.testing.assert_allclose(chain.gravity, [0, 1, -9])
    assert chain.kinds == ("revolute", "revolute", "prismatic", "revolute")
    for q in np.random.default_rng(0).uniform(-0.3, 0.3, (5, 4)):
        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(chain.placement(q)[0, :3, 3], data.site_xpos[0], atol=1e-12)
        load_ = np.asarray(chain.gravity_torque(q, 0.0)).ravel()
        np.testing.assert_allclose(load_, data.qfrc_bias, atol=1e-9)
    np.testing.assert_allclose(
        np.column_stack([chain.lower, chain.upper]), model.jnt_range, atol=1e-12
    )


def test_a_base_that_floats_is_held_and_a_default_class_counts():
    text = (
        '<mujoco><compiler angle="radian"/><default><joint axis="0 1 0"/></default><worldbody>'
        '<body name="trunk" pos="0 0 1"><freejoint/><geom size="0.1" mass="3"/>'
        '<body name="leg" pos="0.2 0 0"><joint name="hip"/><geom size="0.05" mass="1"/>'
        "</body></body></worldbody></mujoco>"
    )
    robot = Robot.from_mjcf(text)
    assert robot.chain("leg").joint_names == ("hip",)
    assert robot.chain("leg").joints[0].axis == pytest.approx([0, 1, 0])


def test_a_recording_on_an_mjcf_is_loaded_and_stored(tmp_path):
    robot = Robot.from_mjcf(mjcf(""))
    q = np.random.default_rng(1).uniform(-0.2, 0.2, (40, 4))
    tips = robot.chain("tip").tips(q, [0, 0, 0.1])
    folder = tmp_path / "made"
    (tmp_path / "arm.xml").write_text(mjcf(""))
    assert run(["new", str(folder), "--robot", str(tmp_path / "arm.xml"), "-q"]) == 0
    rows = {f"q{k + 1}": q[:, k] for k in range(4)} | dict(zip("xyz", tips.T, strict=True))
    (folder / "samples.csv").write_text(csv_text(rows))
    text = (folder / "dataset.toml").read_text()
    (folder / "dataset.toml").write_text(
        text.replace('# tip_frame = "flange"', 'tip_frame = "tip"')
    )
    recording = load(folder)
    assert recording.robot.mjcf == mjcf("")
    again = restored(stored(recording), type(recording))
    np.testing.assert_array_equal(again.chain.placement(q), recording.chain.placement(q))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco><worldbody", "broken XML"),
        ("<robot/>", "<robot> found, <mujoco> expected"),
        ("<mujoco><include file='a.xml'/></mujoco>", "flatten it: python -c"),
        ("<mujoco><worldbody/></mujoco>", "no body found"),
        (
            "<mujoco><worldbody><body name='a'><geom size='1'/></body></worldbody></mujoco>",
            "no movable joint found",
        ),
        (mjcf('axisangle="0 0 0 3"'), "an axis and an angle expected"),
        (mjcf('quat="1 0 0"'), "quat='1 0 0', 4 finite numbers expected"),
        (mjcf('euler="a b c"'), "euler='a b c', 3 finite numbers expected"),
        (mjcf('euler="0 0 1e300"'), "euler='0 0 1e300', 3 finite numbers expected"),
    ],
)
def test_an_mjcf_that_is_none_is_refused_in_one_line(text, said):
    with pytest.raises(PlumblineError) as caught:
        Robot.from_mjcf(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pinocchio_still_differs_from_mujoco_where_it_is_mended(tmp_path):
    """Once this fails, the mending of that point can go."""
    (tmp_path / "a.xml").write_text(mjcf(ORIENTATIONS[3]))
    model = pin.buildModelFromMJCF(str(tmp_path / "a.xml"))
    far = pin.neutral(model)
    data = model.createData()
    pin.framesForwardKinematics(model, data, far)
    assert np.linalg.norm(data.oMf[model.getFrameId("tip")].translation) > 5.0  # a metre of arm
    assert model.upperPositionLimit[2] == pytest.approx(0.4 * np.pi / 180.0)
    assert model.upperPositionLimit[1] == pytest.approx(60.0 * np.pi / 180.0)
