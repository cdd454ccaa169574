"""Laws of couplings that are known: mimic joints of a URDF, and what a joint adds to another."""

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.set_up import refuse_wrong_set_up
from tests.random_trees import Tree

FOLLOWS = '<mimic joint="{}" multiplier="-0.5" offset="0.1"/>'


def folder(tmp_path, *, mimic=None, extra=""):
    """A folder of a robot of three joints, the third of which may follow the first."""
    text = Tree(3, ("revolute",) * 3).urdf()
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (20, 3))
    names = [part.split('"')[0] for part in text.split('<joint name="')[1:]]
    moving = [n for n in names if f'<joint name="{n}" type="fixed"' not in text]
    if mimic:
        at = text.index(f'<joint name="{moving[2]}"')
        end = text.index("</joint>", at)
        text = text[:end] + FOLLOWS.format(moving[0]) + text[end:]
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "dataset.toml").write_text(
        f'observation = "tip_position"\n[robot]\nurdf = "robot.urdf"\n{extra}\n'
        "[tool]\noffset = [0, 0, 0.1]\n",
        encoding="utf-8",
    )
    shown = q[:, :2] if mimic else q
    measured = rng.uniform(-0.3, 0.3, (20, 3))
    header = ",".join([f"q{k + 1}" for k in range(shown.shape[1])] + ["x", "y", "z"])
    table = np.hstack([shown, measured])
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header=header, comments="")
    return tmp_path, q


def test_a_joint_that_mimics_another_needs_no_column(tmp_path):
    place, q = folder(tmp_path, mimic=True)
    read = load_recording(place)
    np.testing.assert_allclose(read.q[:, :2], q[:, :2], atol=1e-12)
    np.testing.assert_allclose(read.q[:, 2], 0.1 - 0.5 * q[:, 0], atol=1e-12)


def test_a_known_coupling_is_added_to_the_reading(tmp_path):
    place, q = folder(tmp_path, extra="couplings = [[2, 1, -0.4]]")
    read = load_recording(place)
    np.testing.assert_allclose(read.q[:, 1], q[:, 1] - 0.4 * q[:, 0], atol=1e-12)
    np.testing.assert_allclose(read.q[:, [0, 2]], q[:, [0, 2]], atol=1e-12)
    assert not [note for note in read.notes if "couplings" in note]


@pytest.mark.parametrize("wrong", ["[[2, 2, 1.0]]", "[[2, 7, 1.0]]", "[[2, 1]]", '"all"'])
def test_a_coupling_that_is_none_is_refused(tmp_path, wrong):
    place, _ = folder(tmp_path, extra=f"couplings = {wrong}")
    with pytest.raises(PlumblineError, match="couplings"):
        load_recording(place)


TWO_ARMS = """<robot name="two"><link name="base"/>{}</robot>"""
ARM = """
<joint name="{0}lift" type="revolute"><parent link="base"/><child link="{0}1"/>
<origin xyz="0 {1} 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
</joint>
<link name="{0}1"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}bar" type="revolute"><parent link="{0}1"/><child link="{0}2"/>
<origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
<mimic joint="{0}lift" multiplier="-0.8"/></joint>
<link name="{0}2"><inertial><origin xyz="0.1 0 0.1"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}turn" type="revolute"><parent link="{0}2"/><child link="{0}3"/>
<origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
</joint>
<link name="{0}3"/>"""
LINKED = Robot.from_urdf(TWO_ARMS.format(ARM.format("left", 0.2) + ARM.format("right", -0.2)))


def linked(q):
    """Readings (N, 3) of one arm, of those of its two drives (N, 2)."""
    return np.column_stack([q[:, 0], -0.8 * q[:, 0], q[:, 1]])


def driven(tmp_path, q, tips=None):
    """The folder of the left arm, with columns of its two drives (N, 2) alone."""
    (tmp_path / "robot.urdf").write_text(LINKED.urdf, encoding="utf-8")
    (tmp_path / "dataset.toml").write_text(
        'observation = "tip_position"\n[robot]\nurdf = "robot.urdf"\ntip_frame = "left3"\n'
        "[tool]\noffset = [0.1, 0, 0.1]\n",
        encoding="utf-8",
    )
    tips = LINKED.chain("left3").tips(linked(q), [0.1, 0.0, 0.1]) if tips is None else tips
    table = np.hstack([q, tips])
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header="q1,q2,x,y,z", comments="")
    return tmp_path


def test_which_joint_is_which_column_is_told_where_the_chain_counts_more_of_them(tmp_path):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    read = load_recording(driven(tmp_path, q))
    assert "joints are counted along the chain: joint 2 with q1, 3 with q2" in read.notes


def test_a_fault_names_the_column_of_the_file_and_not_the_joint_s_number(tmp_path):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    for value, words in ((np.nan, "row 6, column 'q2': found 'nan'"), (70.0, "column 'q2'")):
        broken = q.copy()
        broken[4, 1] = value
        tips = np.zeros((20, 3)) + np.arange(20)[:, None] * [0.01, -0.01, 0.02]
        with pytest.raises(PlumblineError, match=words):
            load_recording(driven(tmp_path, broken, tips))


def test_a_turned_sign_and_a_joint_at_rest_are_told_of_the_column_of_the_file(tmp_path):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    tips = LINKED.chain("left3").tips(linked(q), [0.1, 0.0, 0.1])
    turned = load_recording(driven(tmp_path, q * [1, -1], tips))
    assert any("with the sign of q2 turned" in note for note in turned.notes)
    with pytest.raises(PlumblineError, match="with the sign of q2 turned"):
        refuse_wrong_set_up(turned)
    still = load_recording(driven(tmp_path, q * [0, 1]))
    assert any("samples.csv: q1 never moves" in note for note in still.notes)


@pytest.mark.parametrize("arm", ["left", "right"])
def test_one_arm_of_two_needs_columns_of_its_own_drives_alone(tmp_path, arm):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    (tmp_path / "robot.urdf").write_text(LINKED.urdf, encoding="utf-8")
    (tmp_path / "dataset.toml").write_text(
        f'observation = "tip_position"\n[robot]\nurdf = "robot.urdf"\ntip_frame = "{arm}3"\n'
        "[tool]\noffset = [0.1, 0, 0.1]\n",
        encoding="utf-8",
    )
    table = np.hstack([q, LINKED.chain(f"{arm}3").tips(linked(q), [0.1, 0.0, 0.1])])
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header="q1,q2,x,y,z", comments="")
    np.testing.assert_allclose(load_recording(tmp_path).q, linked(q), atol=1e-12)


def state_of(q):
    """What the symbols of the left arm are worth, and its state at these readings."""
    chain, row = LINKED.chain("left3"), cs.SX.sym("q", 3)
    state = State.ideal(chain, {"q": row}, cs.SX(3, 1))
    return lambda expression: cs.Function("f", [row], [expression])(q).full().ravel(), state


def test_what_moves_a_joint_moves_what_follows_it():
    """A drive whose zero is off moves the whole linkage, not its own joint alone."""
    q = linked(np.array([[0.3, -0.5]]))[0]
    worth, state = state_of(q)
    off = JointOffset(joint=1).apply(state, cs.SX(2e-3))
    np.testing.assert_allclose(worth(off.q), q + 2e-3 * np.array([1.0, -0.8, 0.0]), atol=1e-15)
    off = JointOffset(joint=3).apply(state, cs.SX(2e-3))
    np.testing.assert_allclose(worth(off.q), q + 2e-3 * np.eye(3)[2], atol=1e-15)


def test_a_drive_bears_what_weighs_on_all_that_it_moves():
    """Its torque is the slope of the potential along the linkage."""
    drives = np.array([0.3, -0.5])
    worth, state = state_of(linked(drives[None])[0])
    chain = LINKED.chain("left3")

    def potential(by):
        frames = pin_frames(chain, linked(drives[None] + [by, 0.0])[0])
        return -chain.gravity[2] * sum(
            joint.mass * (T @ [*joint.com, 1.0])[2]
            for joint, T in zip(chain.joints, frames, strict=True)
        )

    slope = (potential(1e-6) - potential(-1e-6)) / 2e-6
    assert worth(state.nominal.load)[0] == pytest.approx(slope, rel=1e-6)


def pin_frames(chain, q):
    """Placements (n, 4, 4) of the joints, by Pinocchio."""
    data = chain.model.createData()
    pin.forwardKinematics(chain.model, data, q)
    return [data.oMi[k + 1].homogeneous for k in range(chain.n)]
