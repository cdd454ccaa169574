"""The simulator's arm and mechanisms against closed forms, one by one."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.reality.arm import (
    Array,
    forward,
    load_torque,
    point_torque,
    rotations,
)
from plumbline.experiments.reality.arms import ARMS, kr300, ur5
from plumbline.experiments.reality.body_effects import (
    BaseBump,
    BaseCompliance,
    BaseDrift,
    JointTilt,
    LinkFlex,
    LinkGeometry,
    LinkThermal,
    cantilever,
)
from plumbline.experiments.reality.draws import LIBRARY, ORDER, OUTSIDE, draw
from plumbline.experiments.reality.end_effects import (
    NeedleBending,
    NeedleSag,
    Respiration,
    SensorDistortion,
    SensorScale,
    ToolSlip,
)
from plumbline.experiments.reality.joint_effects import (
    Backlash,
    CoupledPlay,
    GearRipple,
    Hysteresis,
    JointCompliance,
    JointCoupling,
    JointOffset,
    JointScale,
    Latency,
    LoadedPlay,
    Payload,
    TransmissionRipple,
)
from plumbline.experiments.reality.outside_effects import (
    CrossRipple,
    LooseTool,
    MagneticSpot,
    StickSlip,
)
from plumbline.experiments.reality.recorder import moved_to, quaternions
from plumbline.experiments.reality.scene import Mechanism, Scene, measured
from plumbline.experiments.reality.session import lagged
from plumbline.kinematics.robot import Robot
from tests.simulated_cases import drawn_scene

EVERY = sorted(LIBRARY) + sorted(OUTSIDE)


def joint_error(scene: Scene, mechanism: Mechanism) -> Array:
    """What a mechanism adds to every joint."""
    return mechanism.body(scene).q - scene.q


# The arm


def test_an_outstretched_ur5_reaches_as_far_as_its_links_add_up() -> None:
    tip = forward(ur5(), np.zeros((1, 6)))[0, -1, :3, 3]
    np.testing.assert_allclose(tip, [-0.81725, -0.10915 - 0.0823, 0.089159 - 0.09465], atol=1e-12)


def test_turning_joint_1_turns_the_whole_arm() -> None:
    q = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    turned = q + np.array([0.7, 0, 0, 0, 0, 0])
    spin = rotations(np.array([0.0, 0.0, 0.7]))
    np.testing.assert_allclose(
        forward(ur5(), turned)[:, -1, :3, :3], spin @ forward(ur5(), q)[:, -1, :3, :3], atol=1e-12
    )


def potential(arm, q):
    """Potential energy (N,) [J] of the arm's weight."""
    frames = forward(arm, q)
    centres = frames[:, 1:, :3, 3] + np.einsum("nijk,ik->nij", frames[:, 1:, :3, :3], arm.com)
    return -np.einsum("i,nik,k->n", arm.mass, centres, arm.gravity)


@pytest.mark.parametrize("name", sorted(ARMS))
def test_load_torque_is_minus_the_gradient_of_potential_energy(name: str) -> None:
    arm = ARMS[name]()
    q = np.random.default_rng(2).uniform(arm.lower, arm.upper, (6, arm.joints))
    step = 1e-6 * np.eye(arm.joints)
    slope = [(potential(arm, q + e) - potential(arm, q - e)) / 2e-6 for e in step]
    torque = load_torque(arm, forward(arm, q))
    np.testing.assert_allclose(torque, -np.stack(slope, axis=1), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", sorted(ARMS))
def test_tip_torques_are_the_tip_jacobian_transposed(name: str) -> None:
    arm = ARMS[name]()
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper, (4, arm.joints))
    force = np.array([1.0, -2.0, 3.0])

    def height(at: Array) -> Array:
        return forward(arm, at)[:, -1, :3, 3] @ force

    step = 1e-6 * np.eye(arm.joints)
    slope = [(height(q + e) - height(q - e)) / 2e-6 for e in step]
    frames = forward(arm, q)
    torque = point_torque(arm, frames, frames[:, -1, :3, 3], force)
    np.testing.assert_allclose(torque, np.stack(slope, axis=1), atol=1e-7)


def test_the_kr300_stands_upright_under_its_own_gravity() -> None:
    """Its base axis points down: the upper arm, raised, is high against gravity."""
    arm = kr300()
    raised = forward(arm, np.array([[0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0]]))[0, 2, :3, 3]
    assert raised @ arm.gravity < -9.81 * (0.675 + 1.1)


@pytest.mark.parametrize("name", [n for n in sorted(ARMS) if ARMS[n]().bundled])
def test_a_bundled_name_means_the_same_arm_here_and_in_the_library(name: str) -> None:
    arm, robot = ARMS[name](), Robot.bundled(name)
    rows = robot.dh[: arm.joints]
    for key in ("d", "a", "alpha", "theta", "mass"):
        theirs = [getattr(row, key) for row in rows]
        np.testing.assert_allclose(getattr(arm, key), theirs, atol=1e-6, err_msg=key)
    np.testing.assert_allclose(arm.com, [row.com for row in rows], atol=1e-6)
    np.testing.assert_allclose(arm.gravity, robot.gravity, atol=0.02)
    assert arm.tip_frame in robot.tip_frames


def test_rotation_vectors_turn_by_their_length() -> None:
    spin = rotations(np.array([[0.0, 0.0, np.pi / 2], [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(spin[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(spin[1], np.eye(3), atol=0)


def test_quaternions_give_their_rotation_back() -> None:
    vector = np.random.default_rng(4).normal(size=(50, 3)) * 2.0
    q = quaternions(rotations(vector))
    w, v = q[:, :1], q[:, 1:]
    point = np.array([0.3, -1.0, 2.0])
    turned = point + 2 * np.cross(v, np.cross(v, point) + w * point)
    np.testing.assert_allclose(turned, rotations(vector) @ point, atol=1e-12)
    assert (w >= 0).all()


# The mechanisms, one by one


@pytest.mark.parametrize("name", EVERY)
def test_a_mechanism_of_no_strength_changes_nothing(name: str) -> None:
    scene = drawn_scene()
    off = draw(name, scene, np.random.default_rng(6)).sized(0.0)
    np.testing.assert_allclose(measured(scene, (off,)), measured(scene, ()), atol=1e-14)


@pytest.mark.parametrize("name", EVERY)
def test_every_mechanism_carries_its_own_name(name: str) -> None:
    mechanism = draw(name, drawn_scene(), np.random.default_rng(6))
    assert mechanism.effect == name
    assert name in ORDER


def test_an_offset_and_a_scale_act_on_their_joint_alone() -> None:
    scene = drawn_scene()
    offset, scale = (
        joint_error(scene, JointOffset(1e-3, 3)),
        joint_error(scene, JointScale(1e-3, 4)),
    )
    np.testing.assert_allclose(offset, np.eye(6)[2] * 1e-3 * np.ones((40, 1)), atol=1e-15)
    np.testing.assert_allclose(scale[:, 3], 1e-3 * scene.session.q[:, 3], atol=1e-15)
    assert not np.delete(scale, 3, axis=1).any()


def test_a_drive_stiffens_and_yields_in_the_sense_of_its_load() -> None:
    scene = drawn_scene()
    torque = load_torque(scene.arm, scene.frames())[:, 1]
    soft = joint_error(scene, JointCompliance(1e-5, 2, stiffening=0.0))[:, 1]
    stiff = joint_error(scene, JointCompliance(1e-5, 2, stiffening=0.25))[:, 1]
    np.testing.assert_allclose(soft, 1e-5 * torque, atol=1e-15)
    heavy = int(np.abs(torque).argmax())
    assert stiff[heavy] / soft[heavy] == pytest.approx(1 / 1.25)


def test_gravity_lets_a_yielding_arm_down() -> None:
    scene = drawn_scene()
    down = scene.arm.gravity / 9.81
    for mechanism in (JointCompliance(1e-5, 2), Payload(1.0, (2e4,) * 6), LinkFlex(1e-5, 2)):
        sunk = mechanism.body(scene).pose_in_world()[0] - scene.pose_in_world()[0]
        assert (sunk @ down).mean() > 0.0, mechanism.effect


def test_play_lags_behind_the_approach() -> None:
    scene = drawn_scene()
    error = joint_error(scene, Backlash(2e-4, 5))[:, 4]
    np.testing.assert_allclose(error, -1e-4 * scene.session.direction[:, 4], atol=1e-18)


def test_play_is_carried_along_the_path() -> None:
    scene = drawn_scene(rows=40)
    q = np.zeros((40, 6))
    q[:8, 0] = [0.0, 0.5, 1.0, 2.0, 1.5, 0.5, 0.0, 3.0]
    q[8:, 0] = 3.0
    true = Hysteresis(0.4, 1).body(moved_to(scene, q)).q[:8, 0]
    np.testing.assert_allclose(true, [0.0, 0.1, 0.6, 1.6, 1.6, 0.9, 0.4, 2.6], atol=1e-12)


def test_ripples_have_their_period() -> None:
    scene = drawn_scene()
    turn = np.eye(6)[1] * 2 * np.pi
    once = TransmissionRipple(1e-3, 2, once=(1.0, 0.4), twice=(0.8, 1.0))
    gear = GearRipple(1e-3, 2, order=12.5, phase=0.2)
    tooth = np.eye(6)[1] * 2 * np.pi / 12.5
    for ripple, period in ((once, turn), (gear, tooth)):
        here = joint_error(scene, ripple)
        there = joint_error(moved_to(scene, scene.session.q + period), ripple)
        np.testing.assert_allclose(here, there, atol=1e-12)
    first = joint_error(scene, TransmissionRipple(1e-3, 2, once=(1.0, 0.4)))[:, 1]
    np.testing.assert_allclose(first, 1e-3 * np.sin(scene.q[:, 1] + 0.4), atol=1e-12)


def test_a_ripple_reports_its_harmonics() -> None:
    scene = drawn_scene()
    ripple = TransmissionRipple(1e-3, 2, once=(0.9, 0.4), twice=(0.8, 1.0))
    p, q = ripple.parameters(), scene.q[:, 1]
    rebuilt = sum(p[f"sine_{k}"] * np.sin(k * q) + p[f"cosine_{k}"] * np.cos(k * q) for k in (1, 2))
    np.testing.assert_allclose(joint_error(scene, ripple)[:, 1], rebuilt, atol=1e-12)


def test_coupling_takes_the_source_joint_along() -> None:
    scene = drawn_scene()
    error = joint_error(scene, JointCoupling(1e-3, 3, source=4))[:, 2]
    np.testing.assert_allclose(error, 1e-3 * scene.session.q[:, 3], atol=1e-15)


def test_latency_looks_back_along_the_motion() -> None:
    scene = drawn_scene()
    np.testing.assert_allclose(
        joint_error(scene, Latency(0.01)), -0.01 * scene.session.velocity, atol=1e-15
    )


def test_a_longer_link_moves_the_tip_along_it() -> None:
    scene = drawn_scene()
    shift = LinkGeometry(1e-3, 2, (0.0, 1.0, 0.0)).body(scene).pose_in_world()[0]
    along = scene.frames()[:, 2, :3, 0]
    np.testing.assert_allclose(shift - scene.pose_in_world()[0], 1e-3 * along, atol=1e-12)


def test_warmth_lengthens_the_arm_but_not_the_tool() -> None:
    scene = drawn_scene()
    warm = LinkThermal(1e-4).body(scene)
    flange, grown = scene.frames()[:, -1, :3, 3], warm.frames()[:, -1, :3, 3]
    growth = 1.0 + 1e-4 * (scene.session.warmth - 20.0)
    np.testing.assert_allclose(grown, flange * growth[:, None], atol=1e-12)
    np.testing.assert_array_equal(warm.tool, scene.tool)


def test_a_cantilever_bends_as_the_textbook_has_it() -> None:
    link, none = np.array([[2.0, 0.0, 0.0]]), np.zeros((1, 3))
    down, about = np.array([[5.0, 0.0, -3.0]]), np.array([[0.0, 4.0, 0.0]])
    by_force = cantilever(link, down, none, none)[0]
    np.testing.assert_allclose(by_force, [0, 0, -3 * 8 / 3, 0, 3 * 4 / 2, 0], atol=1e-12)
    by_moment = cantilever(link, none, about, none)[0]
    np.testing.assert_allclose(by_moment, [0, 0, -4 * 4 / 2, 0, 4 * 2, 0], atol=1e-12)
    by_weight = cantilever(link, none, none, down)[0]
    np.testing.assert_allclose(by_weight, [0, 0, -3 * 8 / 8, 0, 3 * 4 / 6, 0], atol=1e-12)


def test_a_base_creeps_or_jumps_in_time() -> None:
    scene = drawn_scene()
    creep = BaseDrift(1e-3, (1.0, 0, 0, 0, 0, 0), rate=2.0).body(scene).base[:, 0]
    assert creep[0] == 0.0
    assert creep[-1] == pytest.approx(1e-3)
    assert (np.diff(creep) > 0).all()
    jump = BaseBump(1e-3, (0, 0, 1.0, 0, 0, 2.0), moment=0.4).body(scene).base
    np.testing.assert_array_equal(np.unique(jump[:, 2]), [0.0, 1e-3])
    np.testing.assert_allclose(jump[:, 5], 2.0 * jump[:, 2], atol=1e-18)
    assert (np.diff(jump[:, 2]) >= 0).all()


def test_a_base_tilts_towards_the_overhanging_arm() -> None:
    """The moment about the foot is the sum of the lever arms times the weights."""
    scene = drawn_scene()
    frames = scene.frames()
    centres = frames[:, 1:, :3, 3] + np.einsum("nijk,ik->nij", frames[:, 1:, :3, :3], scene.arm.com)
    weight = scene.arm.mass[:, None] * scene.arm.gravity
    moment = np.cross(centres, weight).sum(axis=1)
    tilt = BaseCompliance(1e-5, unequal=0.1).body(scene).base[:, 3:]
    np.testing.assert_allclose(tilt, 1e-5 * moment * [1.1, 0.9, 0.0], atol=1e-15)


def test_an_upright_needle_does_not_sag_and_a_level_one_sags_in_full() -> None:
    scene = drawn_scene()
    up = np.zeros((40, 6))
    turn = forward(scene.arm, up)[0, -1, :3, :3]
    level, upright = turn.T @ [1.0, 0.0, 0.0], turn.T @ [0.0, 0.0, 1.0]
    here = moved_to(scene, up)
    assert not NeedleSag(1e-3, tuple(upright)).body(here).sag.round(12).any()
    sag = NeedleSag(1e-3, tuple(level)).body(here).sag
    np.testing.assert_allclose(sag, np.tile([0.0, 0.0, -1e-3], (40, 1)), atol=1e-12)


def test_a_device_scales_and_distorts_as_stated() -> None:
    scene = drawn_scene()
    p = np.array([[0.3, 0.4, 2.0], [0.0, 0.0, 1.5]])
    np.testing.assert_allclose(SensorScale(1e-3).sense(p, scene.session), 1.001 * p)
    radial = SensorDistortion(0.1, "radial").sense(p, scene.session)
    np.testing.assert_allclose(radial, [[0.3 * 1.00625, 0.4 * 1.00625, 2.0], p[1]])
    depth = SensorDistortion(0.1, "depth").sense(p, scene.session)
    np.testing.assert_allclose(depth, p * [[1.2], [1.15]])


def test_breath_is_periodic_and_no_sine() -> None:
    scene = drawn_scene()
    time = np.arange(400) * 0.02
    session = replace(scene.session, time=time)
    breath = Respiration(1e-3, (0.0, 0.0, 1.0), period=4.0, power=2)
    z = breath.sense(np.zeros((400, 3)), session)[:, 2]
    np.testing.assert_allclose(z[:200], z[200:], atol=1e-12)
    assert np.ptp(z) == pytest.approx(1e-3)
    spectrum = np.abs(np.fft.rfft(z))
    assert spectrum[4] > 0.2 * spectrum[2] > 0.0


def test_a_tied_ripple_depends_on_both_joints() -> None:
    scene = drawn_scene()
    ripple = CrossRipple(1e-3, 3, other=5, order=4.0, mesh=2.0, phase=0.3)
    np.testing.assert_allclose(
        joint_error(scene, ripple)[:, 2],
        1e-3 * np.sin(4 * scene.q[:, 2] + 2 * scene.q[:, 4] + 0.3),
        atol=1e-15,
    )


def test_a_magnetic_spot_fades_with_distance() -> None:
    scene = drawn_scene()
    spot = MagneticSpot(1e-3, (0.0, 0.0, 1.0), 0.1, (1.0, 0.0, 0.0))
    p = np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 1.0], [0.0, 0.0, 3.0]])
    moved = (spot.sense(p, scene.session) - p)[:, 0]
    np.testing.assert_allclose(moved, [1e-3, 1e-3 * np.exp(-0.5), 0.0], atol=1e-12)


def test_a_sticking_joint_remembers_where_it_came_from() -> None:
    scene = drawn_scene()
    stick = StickSlip(1e-4, 2, seed=3)
    error = joint_error(scene, stick)[:, 1]
    assert np.abs(error).max() <= 2.0 * 1e-4 + 1e-15
    q = scene.session.q.copy()
    q[10, 1] += 4.0
    after = joint_error(moved_to(scene, q), stick)[:, 1]
    np.testing.assert_allclose(after[:10], error[:10], atol=1e-15)
    assert not np.allclose(after[11:], error[11:])


def test_a_re_seated_tool_moves_all_later_tips_alike_in_the_flange() -> None:
    scene = drawn_scene()
    slip = ToolSlip(2e-3, ((0.6, 0.0, 0.8),), (0.4,))
    moved = np.linalg.norm(measured(scene, (slip,)) - measured(scene, ()), axis=1)
    later = scene.session.progress >= 0.4
    np.testing.assert_allclose(moved, 2e-3 * later, atol=1e-15)
    by_group = ToolSlip(1e-3, ((1.0, 0.0, 0.0), (0.0, 2.0, 0.0)))
    moved = np.linalg.norm(measured(scene, (by_group,)) - measured(scene, ()), axis=1)
    group = scene.session.group
    np.testing.assert_allclose(moved[group == 2], 1e-3, atol=1e-15)
    np.testing.assert_allclose(moved[group == 3], 2e-3, atol=1e-15)
    assert not moved[group == 1].any()


def test_a_needle_gives_way_across_itself_only_and_turns_as_a_rod_does() -> None:
    scene = drawn_scene()
    force = np.tile([3.0, 0.0, 5.0], (scene.session.rows, 1))
    scene = replace(scene, session=replace(scene.session, force=force))
    bent = NeedleBending(1e-4, (0.0, 0.0, 1.0)).body(scene)
    np.testing.assert_allclose(bent.tool - scene.tool, np.tile([3e-4, 0.0, 0.0], (40, 1)))
    length = np.linalg.norm(scene.tool[0])
    np.testing.assert_allclose(bent.turn, np.tile([0.0, 4.5e-4 / length, 0.0], (40, 1)))


def test_a_bearing_leans_the_whole_outer_arm_about_its_own_centre() -> None:
    scene = drawn_scene()
    joint, size = 3, 1e-6
    frames = scene.frames()
    leaned = JointTilt(size, joint).body(scene).frames()
    np.testing.assert_allclose(leaned[:, :joint], frames[:, :joint], atol=1e-15)
    axis, origin = frames[:, joint - 1, :3, 2], frames[:, joint - 1, :3, 3]
    weight = scene.arm.mass[:, None] * scene.arm.gravity
    centre = frames[:, 1:, :3, 3] + np.einsum("nijk,ik->nij", frames[:, 1:, :3, :3], scene.arm.com)
    moment = np.cross(centre - origin[:, None], weight)[:, joint - 1 :].sum(axis=1)
    lean = size * (moment - axis * np.sum(axis * moment, axis=1, keepdims=True))
    far = frames[:, -1, :3, 3] - origin
    expected = np.einsum("nij,nj->ni", rotations(lean), far) + origin
    np.testing.assert_allclose(leaned[:, -1, :3, 3], expected, atol=1e-12)


def test_a_heavy_link_lies_on_the_side_that_its_load_pushes_it_to() -> None:
    scene = drawn_scene()
    torque = load_torque(scene.arm, scene.frames())[:, 1]
    error = joint_error(scene, LoadedPlay(1e-3, 2))[:, 1]
    clear = np.abs(torque) > 0.2 * np.abs(torque).max()
    np.testing.assert_allclose(error[clear], 5e-4 * np.sign(torque[clear]), rtol=1e-6)
    dragged = joint_error(scene, CoupledPlay(1e-3, 2, 5))
    np.testing.assert_allclose(dragged[:, 1], -5e-4 * scene.session.direction[:, 4])


def test_a_loose_tool_sits_elsewhere_on_three_readings_only() -> None:
    scene = drawn_scene()
    moved = measured(scene, (LooseTool(1e-3, (4, 9, 20), (0.0, 0.6, 0.8)),)) - measured(scene, ())
    length = np.linalg.norm(moved, axis=1)
    np.testing.assert_array_equal(np.flatnonzero(length > 1e-9), [4, 9, 20])
    np.testing.assert_allclose(length[[4, 9, 20]], 1e-3)


def test_a_thermometer_lags_by_its_time_constant() -> None:
    time = np.linspace(0.0, 1000.0, 4001)
    shown = lagged(time, time * 0.01, 60.0)
    assert time[-1] * 0.01 - shown[-1] == pytest.approx(0.6, rel=5e-3)
