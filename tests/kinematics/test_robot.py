"""A robot's symbolic chain against Pinocchio, and the words of a robot that cannot be built."""

import os
from pathlib import Path

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.kinematics.dh import DHRow, rows_table
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot, bundled_names
from tests.random_trees import Tree

POSTURES = 1000
AGREES = 1e-10
DATA = os.environ.get("PLUMBLINE_DATA")
URDFS = sorted(Path(DATA).glob("mukca_panda/urdf/*.urdf")) if DATA else []
TREES = {
    "6 revolute": Tree(1, ("revolute",) * 6),
    "7 continuous": Tree(2, ("continuous",) * 7),
    "7 revolute": Tree(3, ("revolute",) * 7),
    "gantry": Tree(4, ("prismatic", "prismatic", "prismatic", "fixed", "revolute")),
    "scara": Tree(5, ("revolute", "fixed", "continuous", "prismatic", "continuous", "fixed")),
    "bush": Tree.drawn(6, 10, branching=0.6),
    "two arms": Tree.drawn(16, 14, branching=0.3),
    "stick": Tree(8, ("continuous", "fixed", "fixed")),
    **{f"drawn {seed}": Tree.drawn(seed, 8, branching=0.4) for seed in range(20, 24)},
}


def postures(chain, count=POSTURES, seed=0):
    """Readings over the joint ranges, at most a turn and a half either way (count, n)."""
    lower, upper = np.maximum(chain.lower, -3 * np.pi), np.minimum(chain.upper, 3 * np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def numbers(model, chain):
    """Numbers of the chain's joints in a model that may have more of them."""
    return [model.getJointId(name) for name in chain.joint_names]


def whole_configuration(model, chain, q):
    """Configuration of the whole model: the chain at q (n,), all other joints at neutral."""
    values = pin.neutral(model)
    for number, angle in zip(numbers(model, chain), q, strict=True):
        joint = model.joints[number]
        circle = (np.cos(angle), np.sin(angle))
        values[joint.idx_q : joint.idx_q + joint.nq] = circle if joint.nq == 2 else angle
    return values


def link_id(model, tip):
    """Number of the frame of a link of that name."""
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    return next(k for k, f in enumerate(model.frames) if f.name == tip and f.type in kinds)


def oracle(robot, chain, tip, Q):
    """Pinocchio's placements (N, 4, 4), Jacobians (N, 6, n) and gravity torques (N, n)."""
    model = pin.Model(robot.model)
    model.gravity.linear = robot.gravity
    data, frame = model.createData(), link_id(model, tip)
    columns = [model.joints[k].idx_v for k in numbers(model, chain)]
    T, J, tau = (np.empty((len(Q), *shape)) for shape in ((4, 4), (6, chain.n), (chain.n,)))
    for k, q in enumerate(Q):
        values = whole_configuration(model, chain, q)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J[k] = pin.computeFrameJacobian(model, data, values, frame, world).reshape(6, -1)[
            :, columns
        ]
        T[k] = pin.updateFramePlacement(model, data, frame).homogeneous
        tau[k] = pin.computeGeneralizedGravity(model, data, values)[columns]
    return T, J, tau


def symbolic_jacobians(chain, Q):
    """The tip's Jacobians (N, 6, n) in the base's axes, by CasADi: linear, then angular."""
    q = cs.SX.sym("q", chain.n)
    T = chain.forward(q)
    turning = [
        cs.vertcat(W[2, 1], W[0, 2], W[1, 0])
        for W in (cs.jacobian(cs.vec(T.R), q[k]).reshape((3, 3)) @ T.R.T for k in range(chain.n))
    ]
    J = cs.densify(cs.vertcat(cs.jacobian(T.t, q), cs.horzcat(*turning)))
    values = cs.Function("J", [q], [J]).map(len(Q))(Q.T).full()
    return values.reshape(6, len(Q), chain.n).transpose(1, 0, 2)


def torques(chain, Q, payload=0.0):
    """Gravity torques (N, n) of the symbolic chain."""
    return chain.gravity_torque.map(len(Q))(Q.T, payload).full().T


def agree(robot, tip=None, count=POSTURES):
    """Hold a chain of a robot against the whole robot in Pinocchio."""
    chain = robot.chain(tip)
    Q = postures(chain, count)
    T, J, tau = oracle(robot, chain, chain.tip_frame, Q)
    np.testing.assert_allclose(chain.placement(Q), T, rtol=0, atol=AGREES)
    tips = (T @ [0.03, -0.02, 0.2, 1.0])[:, :3]
    np.testing.assert_allclose(chain.tips(Q, [0.03, -0.02, 0.2]), tips, rtol=0, atol=AGREES)
    np.testing.assert_allclose(symbolic_jacobians(chain, Q), J, rtol=0, atol=AGREES)
    np.testing.assert_allclose(torques(chain, Q), tau, rtol=0, atol=AGREES)
    assert np.abs(J).max() > 0.1


@pytest.mark.parametrize("name", bundled_names())
def test_a_bundled_robot_agrees_with_pinocchio(name):
    robot = Robot.bundled(name)
    assert robot.chain().has_masses
    agree(robot)


@pytest.mark.parametrize("name", TREES)
def test_a_random_tree_agrees_with_pinocchio(name):
    robot = Robot.from_urdf(TREES[name].urdf())
    first, *others = TREES[name].tips
    agree(robot, first)
    for tip in others:
        agree(robot, tip, count=50)


def test_the_random_trees_are_of_every_kind():
    robots = [Robot.from_urdf(tree.urdf()) for tree in TREES.values()]
    chains = [r.chain(tip) for r, t in zip(robots, TREES.values(), strict=True) for tip in t.tips]
    assert {chain.n for chain in chains} >= {1, 4, 6, 7}
    assert any("prismatic" in chain.kinds for chain in chains)
    assert any(np.isinf(chain.upper).any() for chain in chains)
    assert sum(len(tree.tips) > 1 for tree in TREES.values()) >= 3
    assert any(chain.n < r.model.njoints - 1 for chain in chains for r in robots)


@pytest.mark.skipif(not URDFS, reason="PLUMBLINE_DATA does not name a folder with the URDFs")
@pytest.mark.parametrize("stem", ["panda", "iiwa14", "gen3lite"])
def test_a_vendor_s_urdf_agrees_with_pinocchio(stem):
    robot = Robot.from_urdf(next(path for path in URDFS if path.stem == stem))
    assert robot.chain().n == (6 if stem == "gen3lite" else 7)
    agree(robot)
    links = [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY]
    for tip in set(robot.tip_frames) & set(links):
        agree(robot, tip, count=20)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), joints=st.integers(1, 9), branching=st.floats(0.0, 1.0))
def test_any_tree_agrees_with_pinocchio(seed, joints, branching):
    tree = Tree.drawn(seed, joints, branching)
    robot = Robot.from_urdf(tree.urdf())
    for tip in tree.tips:
        chain = robot.chain(tip)
        Q = postures(chain, 10)
        T, _, tau = oracle(robot, chain, tip, Q)
        np.testing.assert_allclose(chain.placement(Q), T, rtol=0, atol=AGREES)
        np.testing.assert_allclose(torques(chain, Q), tau, rtol=0, atol=AGREES)


def test_a_chain_carries_its_own_pinocchio_model():
    robot = Robot.from_urdf(TREES["two arms"].urdf())
    for tip in TREES["two arms"].tips:
        chain = robot.chain(tip)
        data, frame = chain.model.createData(), link_id(chain.model, tip)
        for q in postures(chain, 20):
            pin.framesForwardKinematics(chain.model, data, chain.configuration(q))
            T = data.oMf[frame].homogeneous
            np.testing.assert_allclose(chain.placement(q)[0], T, rtol=0, atol=AGREES)


@pytest.mark.parametrize("tree", [TREES["bush"], TREES["two arms"], TREES["drawn 21"]], ids=str)
def test_the_order_and_names_of_joints_in_a_file_do_not_matter(tree):
    rng = np.random.default_rng(0)
    lines = 2 * len(tree.kinds) + 1
    shuffled = tree.urdf(tuple(rng.permutation(lines)))
    renamed = tree.urdf(prefix="a")
    for tip in tree.tips:
        chain = Robot.from_urdf(tree.urdf()).chain(tip)
        Q = postures(chain, 50)
        for text in (shuffled, renamed):
            other = Robot.from_urdf(text).chain(tip)
            np.testing.assert_allclose(other.placement(Q), chain.placement(Q), atol=1e-12)
            np.testing.assert_allclose(torques(other, Q), torques(chain, Q), atol=1e-10)


def test_joints_come_base_first():
    tree = TREES["two arms"]
    for tip in tree.tips:
        link, path = int(tip.removeprefix("link")), []
        while link > 0:
            path = [f"joint{link}"] * (tree.kinds[link - 1] != "fixed") + path
            link = tree.parents[link - 1]
        assert list(Robot.from_urdf(tree.urdf()).chain(tip).joint_names) == path


def mounted(text, root, T):
    """The same URDF bolted onto a pedestal: a fixed joint before its root."""
    place = " ".join(map(str, T[:3, 3]))
    turn = " ".join(map(str, Rotation.from_matrix(T[:3, :3]).as_euler("xyz")))
    joint = (
        '<link name="floor"/><joint name="bolts" type="fixed"><parent link="floor"/>'
        f'<child link="{root}"/><origin xyz="{place}" rpy="{turn}"/></joint>'
    )
    return text.replace("</robot>", joint + "</robot>")


def test_a_pedestal_moves_the_tip_and_turns_gravity():
    T = homogeneous(Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix(), [1.0, -0.5, 0.3])
    text = TREES["7 revolute"].urdf()
    plain = Robot.from_urdf(text)
    pedestal = Robot.from_urdf(mounted(text, "link0", T)).chain("link7")
    tilted = plain.with_gravity(T[:3, :3].T @ plain.gravity).chain("link7")
    Q = postures(pedestal, 100)
    np.testing.assert_allclose(pedestal.placement(Q), T @ tilted.placement(Q), atol=1e-12)
    np.testing.assert_allclose(torques(pedestal, Q), torques(tilted, Q), atol=1e-10)


def test_gravity_is_a_chain_s_own():
    robot = Robot.bundled("ur5")
    upright = robot.chain()
    sideways = robot.with_gravity([9.81, 0.0, 0.0]).chain()
    np.testing.assert_array_equal(upright.model.gravity.linear, [0.0, 0.0, -9.81])
    np.testing.assert_array_equal(sideways.model.gravity.linear, [9.81, 0.0, 0.0])


def test_gravity_torque_turns_with_gravity_s_sign():
    robot = Robot.bundled("kr300")
    chain, hanging = robot.chain(), robot.with_gravity(-robot.gravity).chain()
    Q = postures(chain, 20)
    np.testing.assert_allclose(torques(hanging, Q), -torques(chain, Q), atol=1e-10)


@pytest.mark.parametrize("name", bundled_names())
def test_a_payload_s_torque_is_its_weight_through_the_jacobian(name):
    """Virtual work: tau = -J^T m g."""
    chain = Robot.bundled(name).chain()
    Q = postures(chain, 50)
    added = torques(chain, Q, 3.0) - torques(chain, Q)
    expected = -3.0 * np.einsum("kin,i->kn", symbolic_jacobians(chain, Q)[:, :3], chain.gravity)
    np.testing.assert_allclose(added, expected, atol=1e-10)


@pytest.mark.parametrize("name", bundled_names())
def test_no_posture_reaches_beyond_the_reach(name):
    chain = Robot.bundled(name).chain()
    far = np.linalg.norm(chain.placement(postures(chain))[:, :3, 3], axis=1)
    assert 0.3 * chain.reach < far.max() <= chain.reach + 1e-12


@pytest.mark.parametrize("name", bundled_names())
def test_a_chain_to_a_frame_on_the_way_agrees_with_pinocchio(name):
    robot = Robot.bundled(name)
    whole = robot.chain()
    for k in range(1, whole.n):
        part = robot.chain(f"link{k}")
        assert part.joint_names == whole.joint_names[:k]
        agree(robot, f"link{k}", count=20)


def random_rows(seed, fixed=True):
    """Random DH rows; with fixed ones first, in the midst and last."""
    rng = np.random.default_rng(seed)
    kinds = ["revolute", "prismatic", "revolute", "revolute", "prismatic"]
    if fixed:
        kinds = ["fixed", *kinds[:3], "fixed", "fixed", *kinds[3:], "fixed"]
    return [
        {
            "d": rng.normal(0, 0.3),
            "a": rng.normal(0, 0.3),
            "alpha": rng.uniform(0.2, 2.9) * rng.choice([-1, 1]),
            "theta": rng.uniform(-3, 3),
            "kind": kind,
            "mass": rng.uniform(0, 4),
            "com": list(rng.normal(0, 0.1, 3)),
        }
        for kind in kinds
    ]


def multiplied(rows, q):
    """T_base_i of every row (rows, 4, 4), from SciPy's rotations."""
    readings, T, frames = iter(q), np.eye(4), []
    for row in rows:
        reading = 0.0 if row["kind"] == "fixed" else next(readings)
        angle = row["theta"] + reading * (row["kind"] == "revolute")
        height = row["d"] + reading * (row["kind"] == "prismatic")
        turn = homogeneous(Rotation.from_rotvec([0, 0, angle]).as_matrix(), [0, 0, height])
        twist = homogeneous(
            Rotation.from_rotvec([row["alpha"], 0, 0]).as_matrix(), [row["a"], 0, 0]
        )
        T = T @ turn @ twist
        frames.append(T)
    return np.array(frames)


@pytest.mark.parametrize("seed", range(5))
def test_dh_rows_multiply_to_the_chain_with_fixed_rows_anywhere(seed):
    rows = random_rows(seed)
    robot = Robot.from_dh(rows)
    chain = robot.chain()
    assert chain.kinds == ("revolute", "prismatic", "revolute", "revolute", "prismatic")
    for q in np.random.default_rng(seed).normal(0, 1, (20, 5)):
        expected = multiplied(rows, q)[-1]
        np.testing.assert_allclose(chain.placement(q)[0], expected, atol=1e-12)
    agree(robot, count=50)


def test_dh_rows_carry_their_masses_at_their_centres():
    """Weight of a swinging lump: tau = m g * lever, by hand."""
    row = {"a": 0.5, "alpha": np.pi / 2, "mass": 2.0, "com": [-0.1, 0.0, 0.0]}
    robot = Robot.from_dh([{"alpha": np.pi / 2, "mass": 7.0}, row])
    tau = torques(robot.chain(), np.array([[0.3, 0.7]]))[0]
    np.testing.assert_allclose(tau, [0.0, 2.0 * 9.81 * 0.4 * np.cos(0.7)], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_link_frames_are_those_of_denavit_and_hartenberg(seed):
    """The sense of the common normal, which the axes alone do not tell, is the rows'."""
    rows = random_rows(seed, fixed=False)
    chain = Robot.from_dh(rows).chain()
    for k, (row, T) in enumerate(zip(rows, chain.link_frames(), strict=True)):
        if k == len(rows) - 1:
            break
        twist = Rotation.from_rotvec([row["alpha"], 0, 0]).as_matrix()
        expected = homogeneous(twist, [row["a"], 0, row["d"]])
        np.testing.assert_allclose(T, expected, atol=1e-12)
    np.testing.assert_array_equal(chain.link_frames()[-1], chain.T_last_tip)


def test_a_link_frame_does_not_ask_where_on_its_axis_the_next_joint_sits():
    rows = random_rows(9, fixed=False)
    slid = [rows[0], {"d": 0.4, "kind": "fixed"}, *rows[1:]]
    frames, others = (Robot.from_dh(table).chain().link_frames() for table in (rows, slid))
    np.testing.assert_allclose(others[0], frames[0], atol=1e-12)


def test_link_frames_of_parallel_axes_pass_through_the_next_joint():
    chain = Robot.bundled("ur5").chain()
    T = chain.link_frames()[1]
    np.testing.assert_allclose(T[:3, 3], chain.joints[2].T_parent_joint[:3, 3], atol=1e-15)
    np.testing.assert_allclose(np.abs(T[:3, :3]), np.eye(3), atol=1e-15)


@pytest.mark.parametrize("tilt", [1e-7, 1e-5, 1e-3, 0.02])
def test_link_frames_of_axes_all_but_parallel_are_those_of_parallel_ones(tilt):
    """Tilted towards each other they meet metres or kilometres away."""
    rows = [{"a": 0.4, "alpha": alpha} for alpha in (np.pi / 2, 0.0, np.pi / 2, 0.0)]
    straight = Robot.from_dh(rows).chain()
    towards = [{"kind": "fixed", "theta": np.pi / 2, "alpha": tilt}]
    back = [{"kind": "fixed", "theta": -np.pi / 2}]
    tilted = Robot.from_dh([*rows[:2], *towards, *back, *rows[2:]]).chain()
    T, T_tilted = straight.link_frames()[1], tilted.link_frames()[1]
    np.testing.assert_allclose(T_tilted, T, atol=2 * tilt)
    np.testing.assert_allclose(T_tilted[:3, :3] @ T_tilted[:3, :3].T, np.eye(3), atol=1e-12)


def test_link_frames_of_coincident_axes_are_still_frames():
    for T in Robot.bundled("bh7").chain().link_frames():
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_table_of_dh_rows_keeps_the_published_order():
    table = rows_table([DHRow(d=1.0, a=2.0, alpha=3.0, theta=4.0)])
    np.testing.assert_array_equal(table, [[1.0, 2.0, 3.0, 4.0]])


LINKS = '<link name="base"/><link name="arm"/><link name="camera"/>'
HINGE = (
    '<joint name="{name}" type="{kind}"><parent link="base"/><child link="arm"/>'
    '<axis xyz="{axis}"/></joint>'
)
EYE = '<joint name="eye" type="fixed"><parent link="{}"/><child link="camera"/></joint>'


def one_joint(kind="continuous", axis="0 0 1", name="hinge", eye="base"):
    hinge = HINGE.format(kind=kind, axis=axis, name=name)
    return f'<robot name="x">{LINKS}{hinge}{EYE.format(eye)}</robot>'


def test_the_tip_meant_by_default_is_one_that_moves():
    robot = Robot.from_urdf(one_joint())
    assert robot.default_tip == "arm"
    assert robot.tip_frames == ("arm",)


@pytest.mark.parametrize("name", ["arm", "camera"])
def test_a_joint_may_be_called_like_a_link(name):
    text = one_joint(eye="arm").replace('joint name="eye"', f'joint name="{name}"')
    chain = Robot.from_urdf(text).chain(name)
    assert chain.joint_names == ("hinge",)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: Robot.bundled("ur55"),
            "Robot 'ur55' not recognised. Best matches are ur5, ur3, ur10",
        ),
        (
            lambda: Robot.bundled("ur5").chain("flang"),
            "Tip frame 'flang' not recognised. Best matches are flange, link5, link4",
        ),
        (
            lambda: Robot.from_urdf(one_joint()).chain("camera"),
            "Tip frame 'camera' not recognised. Best matches are arm",
        ),
        (
            lambda: Robot.from_urdf("/nowhere/arm.urdf"),
            "arm.urdf: URDF cannot be read (No such file or directory)",
        ),
        (
            lambda: Robot.from_urdf("<robot"),
            "URDF text: not a readable URDF (The XML stream does not contain a valid URDF model.); "
            "check it with check_urdf",
        ),
        (
            lambda: Robot.from_urdf(one_joint("fixed")),
            "URDF text: no movable joint found, at least 1 expected",
        ),
        (
            lambda: Robot.from_urdf(one_joint("floating")).chain("arm"),
            "Joint 'hinge': 6 degrees of freedom, 1 expected (revolute or prismatic)",
        ),
        (
            lambda: Robot.from_urdf(one_joint(axis="0 0 0")).chain("arm"),
            "Joint 'hinge': its axis is 0 0 0; give it a direction",
        ),
        (
            lambda: Robot.from_dh([]),
            "dh: 0 DH rows, none of which moves; add a joint",
        ),
        (
            lambda: Robot.from_dh([{"a": 1.0, "kind": "fixed"}], name="stone"),
            "stone: 1 DH rows, none of which moves; add a joint",
        ),
        (
            lambda: Robot.from_dh([{}, {}], tip_frame="link1"),
            "dh: tip frame 'link1' is a link's name too; change it",
        ),
        (
            lambda: Robot.from_dh([{}, {"r": 1.0}]),
            "DH row 2: key 'r' not recognised; known: d, a, alpha, theta, kind, lower, upper, "
            "mass, com",
        ),
        (
            lambda: Robot.from_dh([{"kind": "hinge"}]),
            "DH row 1: kind 'hinge' must be one of revolute, prismatic, fixed",
        ),
        (
            lambda: Robot.from_dh([{"d": "long"}]),
            "DH row 1: d = 'long' must be a finite number",
        ),
        (
            lambda: Robot.from_dh([{"a": True}]),
            "DH row 1: a = True must be a finite number",
        ),
        (
            lambda: Robot.from_dh([{"alpha": float("inf")}]),
            "DH row 1: alpha = inf must be a finite number",
        ),
        (
            lambda: Robot.from_dh([{"lower": float("nan")}]),
            "DH row 1: lower = nan must be a finite number",
        ),
        (
            lambda: Robot.from_dh([{"lower": 1.0, "upper": -1.0}]),
            "DH row 1: lower = 1.0 exceeds upper = -1.0; swap them",
        ),
        (
            lambda: Robot.from_dh([{"com": [0.0, 1.0]}]),
            "DH row 1: com = [0.0, 1.0] must be three finite numbers [m]",
        ),
        (
            lambda: Robot.from_dh([{"com": "here"}]),
            "DH row 1: com = 'here' must be three finite numbers [m]",
        ),
        (
            lambda: Robot.from_dh([{"com": [0.0, 1e300, 0.0]}]),
            "DH row 1: com = [0.0, 1e+300, 0.0] must be three finite numbers [m]",
        ),
    ],
)
def test_a_robot_that_cannot_be_built_says_why(build, words):
    with pytest.raises(PlumblineError) as error:
        build()
    assert str(error.value) == words


def test_a_urdf_is_read_where_nothing_may_be_written(monkeypatch):
    """As by a process that is shut in, which may not open the null device to be quiet."""

    def refused(path, *more):
        raise PermissionError(path)

    monkeypatch.setattr(os, "open", refused)
    monkeypatch.setattr(Path, "open", refused)
    text = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
    text += '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    assert Robot.from_urdf(text).model.nq == 2


def test_a_limit_may_be_infinite():
    chain = Robot.from_dh([{"lower": -np.inf, "upper": np.inf}]).chain()
    assert np.isinf([chain.lower, chain.upper]).all()


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"d": 10**400}, "d = 1000000000"),
        ({"upper": 10**400}, "upper = 1000000000"),
        ({"a": float("inf")}, "a = inf must be a finite number"),
        ({"lower": float("nan")}, "lower = nan must be a finite number"),
        ({"com": [0, 0, 10**400]}, "com = "),
        ({"mass": -1.0}, "mass = -1.0 kg is below zero"),
    ],
)
def test_a_number_that_cannot_be_is_refused_in_a_short_line(row, words):
    with pytest.raises(PlumblineError) as caught:
        Robot.from_dh([row])
    assert words in str(caught.value)
    assert len(str(caught.value)) < 150


def test_a_joint_may_have_no_limits():
    assert Robot.from_dh([{"lower": float("-inf"), "upper": float("inf")}]).chain().n == 1
