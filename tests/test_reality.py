"""Laws of the simulator that withheld cases come from: physics in closed form, seeds, and gaps."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.reality import bench
from experiments.reality.__main__ import main
from experiments.reality.arm import (
    Array,
    forward,
    load_torque,
    point_torque,
    potential,
    rotations,
)
from experiments.reality.arms import ARMS, kr300, ur5
from experiments.reality.body_effects import (
    BaseBump,
    BaseCompliance,
    BaseDrift,
    LinkFlex,
    LinkGeometry,
    LinkThermal,
    NeedleSag,
    cantilever,
)
from experiments.reality.cases import Plan, draw_case, make_cases
from experiments.reality.draws import LIBRARY, ORDER, OUTSIDE, draw, offered, outside_offered
from experiments.reality.gap import frame_and_tool, gap, scaled, unabsorbed
from experiments.reality.joint_effects import (
    Backlash,
    GearRipple,
    Hysteresis,
    JointCompliance,
    JointCoupling,
    JointOffset,
    JointScale,
    Latency,
    Payload,
    TransmissionRipple,
)
from experiments.reality.outside_effects import CrossRipple, MagneticSpot, StickSlip, ToolSlip
from experiments.reality.recorder import moved_to, quaternions, simulate
from experiments.reality.scene import Mechanism, Scene, measured
from experiments.reality.sensor_effects import Respiration, SensorDistortion, SensorScale
from experiments.reality.session import lagged
from experiments.reality.twins import twins
from kinematics.robot import Robot

REALITY = Path(__file__).resolve().parents[1] / "experiments" / "reality"
EVERY = sorted(LIBRARY) + sorted(OUTSIDE)


def room(
    arm: str = "ur5", rows: int = 40, seed: int = 5, observation: str = "tip_position"
) -> Scene:
    """A scene in which nothing is wrong; the arm moves, so that every mechanism can show."""
    plan = Plan("none", rows=(rows, rows), arms=(arm,), moving=1.0, observation=observation)
    return draw_case(plan, "room", seed).scene


def joint_error(scene: Scene, mechanism: Mechanism) -> Array:
    """What a mechanism adds to every joint."""
    return mechanism.body(scene).q - scene.q


# The arm


def test_reality_shares_no_code_with_the_library() -> None:
    for path in sorted(REALITY.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name}: relative import"
                names = [node.module or ""]
            for name in names:
                assert name.split(".")[0] not in {"kinematics", "optim"}, f"{path.name}: {name}"


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
    scene = room()
    off = draw(name, scene, np.random.default_rng(6)).sized(0.0)
    np.testing.assert_allclose(measured(scene, (off,)), measured(scene, ()), atol=1e-14)


@pytest.mark.parametrize("name", EVERY)
def test_every_mechanism_carries_its_own_name(name: str) -> None:
    mechanism = draw(name, room(), np.random.default_rng(6))
    assert mechanism.effect == name
    assert name in ORDER


def test_an_offset_and_a_scale_act_on_their_joint_alone() -> None:
    scene = room()
    offset, scale = (
        joint_error(scene, JointOffset(1e-3, 3)),
        joint_error(scene, JointScale(1e-3, 4)),
    )
    np.testing.assert_allclose(offset, np.eye(6)[2] * 1e-3 * np.ones((40, 1)), atol=1e-15)
    np.testing.assert_allclose(scale[:, 3], 1e-3 * scene.session.q[:, 3], atol=1e-15)
    assert not np.delete(scale, 3, axis=1).any()


def test_a_drive_stiffens_and_yields_in_the_sense_of_its_load() -> None:
    scene = room()
    torque = load_torque(scene.arm, scene.frames())[:, 1]
    soft = joint_error(scene, JointCompliance(1e-5, 2, stiffening=0.0))[:, 1]
    stiff = joint_error(scene, JointCompliance(1e-5, 2, stiffening=0.25))[:, 1]
    np.testing.assert_allclose(soft, 1e-5 * torque, atol=1e-15)
    heavy = int(np.abs(torque).argmax())
    assert stiff[heavy] / soft[heavy] == pytest.approx(1 / 1.25)


def test_gravity_lets_a_yielding_arm_down() -> None:
    scene = room()
    down = scene.arm.gravity / 9.81
    for mechanism in (JointCompliance(1e-5, 2), Payload(1.0, (2e4,) * 6), LinkFlex(1e-5, 2)):
        sunk = mechanism.body(scene).pose_in_world()[0] - scene.pose_in_world()[0]
        assert (sunk @ down).mean() > 0.0, mechanism.effect


def test_play_lags_behind_the_approach() -> None:
    scene = room()
    error = joint_error(scene, Backlash(2e-4, 5))[:, 4]
    np.testing.assert_allclose(error, -1e-4 * scene.session.direction[:, 4], atol=1e-18)


def test_play_is_carried_along_the_path() -> None:
    scene = room(rows=40)
    q = np.zeros((40, 6))
    q[:8, 0] = [0.0, 0.5, 1.0, 2.0, 1.5, 0.5, 0.0, 3.0]
    q[8:, 0] = 3.0
    true = Hysteresis(0.4, 1).body(moved_to(scene, q)).q[:8, 0]
    np.testing.assert_allclose(true, [0.0, 0.1, 0.6, 1.6, 1.6, 0.9, 0.4, 2.6], atol=1e-12)


def test_ripples_have_their_period() -> None:
    scene = room()
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
    scene = room()
    ripple = TransmissionRipple(1e-3, 2, once=(0.9, 0.4), twice=(0.8, 1.0))
    p, q = ripple.parameters(), scene.q[:, 1]
    rebuilt = sum(p[f"sine_{k}"] * np.sin(k * q) + p[f"cosine_{k}"] * np.cos(k * q) for k in (1, 2))
    np.testing.assert_allclose(joint_error(scene, ripple)[:, 1], rebuilt, atol=1e-12)


def test_coupling_takes_the_source_joint_along() -> None:
    scene = room()
    error = joint_error(scene, JointCoupling(1e-3, 3, source=4))[:, 2]
    np.testing.assert_allclose(error, 1e-3 * scene.session.q[:, 3], atol=1e-15)


def test_latency_looks_back_along_the_motion() -> None:
    scene = room()
    np.testing.assert_allclose(
        joint_error(scene, Latency(0.01)), -0.01 * scene.session.velocity, atol=1e-15
    )


def test_a_longer_link_moves_the_tip_along_it() -> None:
    scene = room()
    shift = LinkGeometry(1e-3, 2, (0.0, 1.0, 0.0)).body(scene).pose_in_world()[0]
    along = scene.frames()[:, 2, :3, 0]
    np.testing.assert_allclose(shift - scene.pose_in_world()[0], 1e-3 * along, atol=1e-12)


def test_warmth_lengthens_the_arm_but_not_the_tool() -> None:
    scene = room()
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
    scene = room()
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
    scene = room()
    frames = scene.frames()
    centres = frames[:, 1:, :3, 3] + np.einsum("nijk,ik->nij", frames[:, 1:, :3, :3], scene.arm.com)
    weight = scene.arm.mass[:, None] * scene.arm.gravity
    moment = np.cross(centres, weight).sum(axis=1)
    tilt = BaseCompliance(1e-5, unequal=0.1).body(scene).base[:, 3:]
    np.testing.assert_allclose(tilt, 1e-5 * moment * [1.1, 0.9, 0.0], atol=1e-15)


def test_an_upright_needle_does_not_sag_and_a_level_one_sags_in_full() -> None:
    scene = room()
    up = np.zeros((40, 6))
    turn = forward(scene.arm, up)[0, -1, :3, :3]
    level, upright = turn.T @ [1.0, 0.0, 0.0], turn.T @ [0.0, 0.0, 1.0]
    here = moved_to(scene, up)
    assert not NeedleSag(1e-3, tuple(upright)).body(here).sag.round(12).any()
    sag = NeedleSag(1e-3, tuple(level)).body(here).sag
    np.testing.assert_allclose(sag, np.tile([0.0, 0.0, -1e-3], (40, 1)), atol=1e-12)


def test_a_device_scales_and_distorts_as_stated() -> None:
    scene = room()
    p = np.array([[0.3, 0.4, 2.0], [0.0, 0.0, 1.5]])
    np.testing.assert_allclose(SensorScale(1e-3).sense(p, scene.session), 1.001 * p)
    radial = SensorDistortion(0.1, "radial").sense(p, scene.session)
    np.testing.assert_allclose(radial, [[0.3 * 1.00625, 0.4 * 1.00625, 2.0], p[1]])
    depth = SensorDistortion(0.1, "depth").sense(p, scene.session)
    np.testing.assert_allclose(depth, p * [[1.2], [1.15]])


def test_breath_is_periodic_and_no_sine() -> None:
    scene = room()
    time = np.arange(400) * 0.02
    session = replace(scene.session, time=time)
    breath = Respiration(1e-3, (0.0, 0.0, 1.0), period=4.0, power=2)
    z = breath.sense(np.zeros((400, 3)), session)[:, 2]
    np.testing.assert_allclose(z[:200], z[200:], atol=1e-12)
    assert np.ptp(z) == pytest.approx(1e-3)
    spectrum = np.abs(np.fft.rfft(z))
    assert spectrum[4] > 0.2 * spectrum[2] > 0.0


def test_a_tied_ripple_depends_on_both_joints() -> None:
    scene = room()
    ripple = CrossRipple(1e-3, 3, other=5, order=4.0, mesh=2.0, phase=0.3)
    np.testing.assert_allclose(
        joint_error(scene, ripple)[:, 2],
        1e-3 * np.sin(4 * scene.q[:, 2] + 2 * scene.q[:, 4] + 0.3),
        atol=1e-15,
    )


def test_a_magnetic_spot_fades_with_distance() -> None:
    scene = room()
    spot = MagneticSpot(1e-3, (0.0, 0.0, 1.0), 0.1, (1.0, 0.0, 0.0))
    p = np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 1.0], [0.0, 0.0, 3.0]])
    moved = (spot.sense(p, scene.session) - p)[:, 0]
    np.testing.assert_allclose(moved, [1e-3, 1e-3 * np.exp(-0.5), 0.0], atol=1e-12)


def test_a_sticking_joint_remembers_where_it_came_from() -> None:
    scene = room()
    stick = StickSlip(1e-4, 2, seed=3)
    error = joint_error(scene, stick)[:, 1]
    assert np.abs(error).max() <= 2.0 * 1e-4 + 1e-15
    q = scene.session.q.copy()
    q[10, 1] += 4.0
    after = joint_error(moved_to(scene, q), stick)[:, 1]
    np.testing.assert_allclose(after[:10], error[:10], atol=1e-15)
    assert not np.allclose(after[11:], error[11:])


def test_a_tool_slips_on_three_readings_only() -> None:
    scene = room()
    moved = measured(scene, (ToolSlip(1e-3, (4, 9, 20), (0.0, 0.6, 0.8)),)) - measured(scene, ())
    length = np.linalg.norm(moved, axis=1)
    np.testing.assert_array_equal(np.flatnonzero(length > 1e-9), [4, 9, 20])
    np.testing.assert_allclose(length[[4, 9, 20]], 1e-3)


def test_a_thermometer_lags_by_its_time_constant() -> None:
    time = np.linspace(0.0, 1000.0, 4001)
    shown = lagged(time, time * 0.01, 60.0)
    assert time[-1] * 0.01 - shown[-1] == pytest.approx(0.6, rel=5e-3)


# The gap


def test_frame_and_tool_columns_are_derivatives_of_the_reading() -> None:
    scene = room(rows=12)
    columns = frame_and_tool(scene).reshape(-1, 3, 9)
    step = 1e-6
    for k in range(3):
        nudge = step * np.eye(3)[k]
        aside = replace(scene, tool=scene.tool + nudge).pose_in_device()[0]
        slope = (aside - scene.pose_in_device()[0]) / step
        np.testing.assert_allclose(columns[:, :, 6 + k], slope, atol=1e-8)
    turned = replace(scene, base=np.tile([0, 0, 0, 0, 0, step], (12, 1)))
    slope = (turned.pose_in_device()[0] - scene.pose_in_device()[0]) / step
    assert unabsorbed(slope, columns.reshape(-1, 9)) < 1e-5


def test_what_the_frame_or_the_tool_can_swallow_leaves_no_gap() -> None:
    scene = room()
    assert gap(scene, (JointOffset(1e-5, 1),), "tip_position") < 1e-9
    assert gap(scene, (JointOffset(1e-5, 6),), "tip_position") < 1e-9
    assert gap(scene, (JointOffset(1e-5, 3),), "tip_position") > 1e-6


@pytest.mark.parametrize("name", EVERY)
def test_a_scaled_mechanism_has_the_gap_asked_for(name: str) -> None:
    scene, rng = room("lbr", rows=50), np.random.default_rng(8)
    for _ in range(40):
        found = scaled(scene, draw(name, scene, rng), 1e-4, "tip_position")
        if found is not None:
            break
    assert found is not None
    assert gap(scene, (found,), "tip_position") == pytest.approx(1e-4, rel=1e-2)
    assert 0.0 < found.size <= found.limit


def test_a_gap_out_of_reach_is_refused() -> None:
    assert scaled(room(), JointOffset(0.0, 3), 1.0, "tip_position") is None
    assert scaled(room(), JointOffset(0.0, 1), 1e-3, "tip_position") is None


# The recordings


@pytest.mark.parametrize("observation", ["tip_position", "pose", "joint_position"])
def test_noise_has_the_size_stated(observation: str) -> None:
    plan = Plan("none", rows=(1500, 1500), observation=observation, arms=("ur5",), surgical=0.0)
    case = draw_case(plan, "case", 3)
    columns = simulate(case)[0].columns
    if observation == "joint_position":
        seen = np.stack([columns[f"m{i}"] for i in range(1, 7)], axis=1) - case.scene.q
    else:
        seen = np.stack([columns[k] for k in "xyz"], axis=1) - measured(case.scene, ())
    assert np.sqrt(np.mean(seen**2)) == pytest.approx(case.noise_std, rel=0.06)
    assert np.ptp(np.linalg.eigvalsh(np.cov(seen.T))) > 0.2 * case.noise_std**2


def test_a_tip_in_its_socket_stays_there() -> None:
    plan = Plan("single", observation="fixed_point", effects=("joint_compliance",), arms=("ur10",))
    case = draw_case(plan, "case", 11)
    columns = simulate(case)[0].columns
    q = np.stack([columns[f"q{i}"] for i in range(1, 7)], axis=1)
    scene = moved_to(case.scene, q)
    for mechanism in case.effects:
        scene = mechanism.body(scene)
    tip = scene.pose_in_world()[0]
    inner = [tip[columns["socket"] == k] for k in np.unique(columns["socket"])]
    spread = np.concatenate([p - p.mean(axis=0) for p in inner])
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(case.noise_std, rel=0.25)


@pytest.mark.parametrize("observation", ["tip_position", "pose", "fixed_point", "joint_position"])
@pytest.mark.parametrize("kind", ["single", "pair", "none", "outside"])
def test_the_gap_written_is_the_gap_asked_for(kind: str, observation: str, tmp_path: Path) -> None:
    out, truth = tmp_path / "out", tmp_path / "truth"
    plan = Plan(kind, gap=(2.0, 3.0), rows=(30, 40), observation=observation)
    names = make_cases(out, truth, count=3, seed=4, plan=plan)
    pool = outside_offered(observation) if kind == "outside" else offered(observation)
    for name in names:
        facts = json.loads((truth / f"{name}.json").read_text())
        assert len(facts["effects"]) == {"none": 0, "pair": 2}.get(kind, 1)
        for cause in facts["effects"]:
            assert cause["effect"] in pool
            assert 2.0 <= cause["gap_to_noise"] <= 3.0
        if kind in {"single", "outside"}:
            assert facts["gap_to_noise"] == pytest.approx(facts["effects"][0]["gap_to_noise"], 1e-2)


def test_seeds_reproduce_byte_for_byte(tmp_path: Path) -> None:
    def write(folder: str, seed: int) -> list[bytes]:
        out, truth = tmp_path / folder, tmp_path / f"{folder}-truth"
        make_cases(out, truth, count=4, seed=seed, kind="pair", rows=(30, 40), gross=0.02)
        files = sorted(p for f in (out, truth) for p in f.rglob("*") if p.is_file())
        return [p.read_bytes() for p in files]

    assert write("a", 1) == write("b", 1)
    assert write("a", 1) != write("c", 2)


def test_a_case_does_not_depend_on_those_before_it(tmp_path: Path) -> None:
    make_cases(tmp_path / "a", tmp_path / "at", count=3, seed=9, rows=(30, 40))
    make_cases(tmp_path / "b", tmp_path / "bt", count=1, seed=9, rows=(30, 40), first=3)
    third = Path("case-0003", "samples.csv")
    assert (tmp_path / "a" / third).read_bytes() == (tmp_path / "b" / third).read_bytes()


def test_columns_give_nothing_away(tmp_path: Path) -> None:
    """Standing still or moving, the header and the settings' keys are the same for all effects."""
    seen = set()
    for k, name in enumerate(sorted(set(LIBRARY) - {"latency"})):
        plan = Plan("single", rows=(40, 40), effects=(name,), arms=("lbr",), moving=0.0)
        folder = tmp_path / str(k)
        make_cases(folder, tmp_path / f"{k}-truth", count=1, seed=2, plan=plan)
        keys = [
            line.split("=")[0]
            for line in (folder / "case-0001" / "dataset.toml").read_text().splitlines()
        ]
        header = (folder / "case-0001" / "samples.csv").read_text().splitlines()[0]
        seen.add((tuple(keys), header))
        words = (folder / "case-0001" / "dataset.toml").read_text()
        assert name not in words
    assert len(seen) == 1


def test_a_moving_recording_has_velocities_whatever_is_wrong() -> None:
    for name in ("latency", "joint_offset"):
        plan = Plan("single", rows=(40, 40), effects=(name,), arms=("ur5",), moving=1.0)
        assert "velocity6" in simulate(draw_case(plan, "case", 2))[0].columns


def test_gross_errors_are_few_large_and_listed() -> None:
    plan = Plan("none", rows=(200, 200), gross=0.02, arms=("ur5",))
    for seed in range(20):
        case = draw_case(plan, "case", seed)
        recording, facts = simulate(case)
        seen = np.stack([recording.columns[k] for k in "xyz"], axis=1)
        far = np.linalg.norm(seen - measured(case.scene, ()), axis=1) > 7 * case.noise_std
        assert list(np.flatnonzero(far) + 1) == facts["gross_rows"]
        assert far.sum() <= 4


def test_masses_are_off_by_a_tenth_at_most_and_never_written() -> None:
    case = draw_case(Plan("none", arms=("lbr",)), "case", 1)
    ratio = case.scene.arm.mass / case.arm.mass
    assert (np.abs(ratio - 1) <= 0.1).all()
    assert np.ptp(ratio) > 0.01
    settings = simulate(case)[0].settings
    assert f"mass = {case.arm.mass[0]}" in settings


def test_a_surgical_space_is_a_box_of_two_to_four_tenths() -> None:
    for seed in range(4):
        case = draw_case(Plan("none", surgical=1.0), "case", seed)
        sides = np.ptp(case.scene.pose_in_world()[0], axis=0)
        assert (sides < 0.401).all()
        assert (sides > 0.1).any()


def test_the_truth_is_kept_apart(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="keep it apart"):
        make_cases(tmp_path, tmp_path / "truth", count=1, seed=0)


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'double' not recognised; known: single"):
        Plan("double")
    with pytest.raises(ValueError, match="Mechanism 'rust' not recognised; known: joint_offset"):
        draw("rust", room(), np.random.default_rng(0))


def test_the_command_writes_cases_and_exits_2_when_it_cannot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, truth = tmp_path / "out", tmp_path / "truth"
    options = ["--count", "2", "--kind", "outside", "--rows", "30", "40", "--unknown-noise"]
    assert main([str(out), str(truth), *options]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["case-0001", "case-0002"]
    assert "noise_std" not in (out / "case-0001" / "dataset.toml").read_text()
    assert main([str(out), str(out / "truth"), "--count", "1"]) == 2
    assert "keep it apart" in capsys.readouterr().err


def test_the_bench_recording_is_what_its_command_writes(tmp_path: Path) -> None:
    bench.main([str(tmp_path)])
    for name in ("dataset.toml", "samples.csv"):
        assert (tmp_path / name).read_bytes() == (bench.FOLDER / name).read_bytes()
    words = (bench.FOLDER / "dataset.toml").read_text()
    assert "ripple" not in words
    case = bench.bench_case()
    assert gap(case.scene, case.effects, "tip_position") == pytest.approx(3.0 * 8e-5, rel=1e-3)


# What nobody could tell


def wrong(
    effect: Mechanism, sigma: float = 1e-4, arm: str = "ur5"
) -> tuple[dict[str, object], ...]:
    """Twins of one effect at a gap of three sigma in a quiet room."""
    plan = Plan("none", rows=(60, 60), arms=(arm,), moving=0.0, surgical=0.0)
    case = draw_case(plan, "case", 7)
    found = scaled(case.scene, effect, 3.0 * sigma, "tip_position")
    assert found is not None
    return twins(replace(case, effects=(found,), noise_std=sigma, gap_to_noise=(3.0,)))


def test_lengths_along_parallel_axes_are_twins() -> None:
    """Joints 2, 3 and 4 of a UR5 are parallel: d of one is d of another."""
    listed = wrong(LinkGeometry(0.0, 2, (0.0, 0.0, 1.0)))
    assert not [t for t in listed if t["effect"] != "link_geometry"]
    plan = Plan("none", rows=(60, 60), arms=("ur5",), moving=0.0, surgical=0.0)
    scene = draw_case(plan, "case", 7).scene
    one, two = (measured(scene, (LinkGeometry(1e-4, i, (1.0, 0.0, 0.0)),)) for i in (2, 3))
    np.testing.assert_allclose(one, two, atol=1e-9)
    elements = {t["element"] for t in wrong(LinkGeometry(0.0, 2, (1.0, 0.0, 0.0)))}
    assert {3, 4} <= elements


def test_a_strong_ripple_has_no_twin_over_the_whole_range() -> None:
    assert not wrong(TransmissionRipple(0.0, 2, once=(1.0, 0.6), twice=(0.9, 2.0)))


def test_a_signal_below_the_noise_has_more_twins_than_one_above() -> None:
    plan = Plan("none", rows=(40, 40), arms=("ur5",), moving=0.0, surgical=0.0)
    case = draw_case(plan, "case", 7)
    counts = []
    for sigma in (1e-5, 1e-3):
        effect = scaled(case.scene, BaseCompliance(0.0), 1e-4, "tip_position")
        assert effect is not None
        listed = twins(replace(case, effects=(effect,), noise_std=sigma, gap_to_noise=(1.0,)))
        assert all(0.0 <= float(str(t["separation"])) < 9.0 for t in listed)
        counts.append(len(listed))
    assert counts[0] < counts[1]
