"""Any chain is a table of links, and a table is a chain again: Pinocchio is the judge."""

import tomllib
from dataclasses import replace

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics import constants
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.link_export import NAME, dh_toml, standard_rows, urdf_text
from plumbline.kinematics.link_table import link_table, row_matrix
from plumbline.kinematics.robot import Robot, bundled_names
from tests.random_trees import Tree

TREES = [Tree.drawn(seed, 5, 0.3) for seed in range(8)]
ROBOTS = [*bundled_names(), *TREES]
EACH = pytest.mark.parametrize("source", ROBOTS, ids=lambda s: s if isinstance(s, str) else s.seed)
POINT = np.array([0.1, -0.2, 0.3])
ALMOST_PARALLEL = """
<robot name="almost">
<link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="a"/>
<axis xyz="0 0 1"/></joint>
<joint name="j2" type="continuous"><parent link="a"/><child link="b"/>
<origin xyz="0.4 0.1 0.05" rpy="3.673e-6 1e-6 0.3"/><axis xyz="0 0 -1"/></joint>
<joint name="j3" type="continuous"><parent link="b"/><child link="c"/>
<origin xyz="0.3 0 0" rpy="1.5708 0 0"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def robot_of(source):
    return Robot.bundled(source) if isinstance(source, str) else Robot.from_urdf(source.urdf())


def by_pinocchio(robot, tip, q):
    """Placements (N, 4, 4) of a tip frame, joint by joint of its chain."""
    chain = robot.chain(tip)
    data, frame = chain.model.createData(), chain.model.getFrameId(tip)
    found = []
    for posture in q:
        pin.framesForwardKinematics(chain.model, data, chain.configuration(posture))
        found.append(data.oMf[frame].homogeneous)
    return np.array(found)


def moved(table, rng, size=1e-2):
    """The table with every parameter off, tilts where axes are parallel."""
    values = table.values + rng.normal(0.0, size, table.values.shape)
    tilted = [row.parallel for row in table.rows]
    values[:, 4] = np.where(tilted, values[:, 4], table.values[:, 4])
    return table.with_values(values)


def as_chain(table):
    *placements, last = table.placements()
    pairs = zip(table.chain.joints, placements, strict=True)
    joints = tuple(replace(joint, T_parent_joint=T) for joint, T in pairs)
    return replace(table.chain, joints=joints, T_last_tip=last)


@EACH
def test_the_links_of_a_chain_put_its_tip_where_pinocchio_does(source):
    robot = robot_of(source)
    chain = robot.chain()
    table = link_table(robot, chain)
    values, q = cs.SX.sym("v", len(table.rows), 5), cs.SX.sym("q", chain.n)
    tip = cs.Function("tip", [values, q], [cs.densify(table.tip(values, q, cs.SX(POINT)))])
    postures = np.random.default_rng(1).uniform(-2.0, 2.0, (10, chain.n))
    T = by_pinocchio(robot, chain.tip_frame, postures)
    there = over_rows(tip, postures, table.values.T)[0][:, 0]
    assert np.allclose(there, T[:, :3, :3] @ POINT + T[:, :3, 3], rtol=0, atol=1e-12)


@EACH
def test_a_changed_table_is_exported_and_read_again_by_pinocchio(source):
    robot, rng = robot_of(source), np.random.default_rng(2)
    table = moved(link_table(robot, robot.chain()), rng)
    q = rng.uniform(-2.0, 2.0, (6, table.chain.n))
    wanted = as_chain(table).placement(q)
    assert np.abs(wanted - table.chain.placement(q)).max() > 1e-3
    rows = tomllib.loads(dh_toml(table, name="x", source="y"))
    from_rows = Robot.from_dh(rows["dh"], tip_frame=rows["tip_frame"])
    assert np.abs(by_pinocchio(from_rows, rows["tip_frame"], q) - wanted).max() < 1e-9
    from_urdf = Robot.from_urdf(urdf_text(table, robot))
    tip = NAME if NAME in from_urdf.tip_frames else table.chain.tip_frame
    assert np.abs(by_pinocchio(from_urdf, tip, q) - wanted).max() < 1e-9


def test_an_unchanged_urdf_keeps_its_numbers_to_the_letter():
    tree = TREES[0]
    robot = Robot.from_urdf(tree.urdf())
    written = urdf_text(link_table(robot, robot.chain()), robot)
    for line in tree.urdf().splitlines():
        origin = line.partition("<origin ")[2].partition("/>")[0]
        assert origin.strip() in written


@EACH
def test_masses_come_along_as_far_as_they_can(source):
    robot = robot_of(source)
    chain = robot.chain()
    table = link_table(robot, chain)
    rows = Robot.from_dh(standard_rows(table), gravity=robot.gravity)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, chain.n)
    ours, theirs = (c.gravity_torque(q, 0.0).full() for c in (rows.chain(), chain))
    assert np.allclose(ours, theirs, rtol=0, atol=1e-9)


def test_nearly_parallel_axes_get_a_tilt_and_no_huge_offset():
    robot = Robot.from_urdf(ALMOST_PARALLEL)
    table = link_table(robot, robot.chain())
    assert table.rows[0].parallel
    assert np.abs(table.values).max() < 4.0
    assert 0.0 < abs(table.values[0, 4]) < 1e-5


def test_a_tilt_is_two_standard_rows():
    table = link_table(Robot.bundled("ur5"), Robot.bundled("ur5").chain())
    values = table.values
    values[1, 4] = 0.01
    tilted = table.with_values(values)
    rows = standard_rows(tilted)
    assert len(rows) == len(table.rows) + 1
    product = rows[1].before() * rows[1].after() * rows[2].before() * rows[2].after()
    back = pin.SE3(pin.utils.rotate("z", -np.pi / 2), np.zeros(3))
    assert np.allclose((product * back).homogeneous, row_matrix(tilted.rows[1]), atol=1e-15)


def test_a_chain_that_is_not_a_number_is_refused():
    robot = Robot.bundled("ur5")
    chain = robot.chain()
    broken = replace(chain.joints[2], T_parent_joint=np.full((4, 4), np.nan))
    joints = (*chain.joints[:2], broken, *chain.joints[3:])
    with pytest.raises(PlumblineError, match="check the axes"):
        link_table(robot, replace(chain, joints=joints))


@pytest.mark.parametrize("count", [1, 7, 8, 9, 23])
def test_rows_are_the_same_however_many_go_at_once(count, monkeypatch):
    x, row = cs.SX.sym("x", 2), cs.SX.sym("row", 3)
    function = cs.Function("f", [x, row], [cs.dot(x, row[:2]) * row, row.T])
    rows, shared = np.random.default_rng(count).normal(size=(count, 3)), np.array([0.3, -2.0])
    numbers = function.nnz_in() + function.nnz_out()
    monkeypatch.setattr(constants, "BLOCK_NUMBERS", 8 * numbers)
    product, same = over_rows(function, rows, shared)
    np.testing.assert_allclose(product[:, 0], (rows[:, :2] @ shared)[:, None] * rows)
    np.testing.assert_array_equal(same[:, :, 0], rows)
