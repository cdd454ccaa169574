"""One law of physics for every effect, worked out apart: in closed form or with Pinocchio."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from plumbline.kinematics.effects import REGISTRY, Scope
from plumbline.kinematics.effects.joint_tilt import SOFTER, _softness
from plumbline.kinematics.effects.link_thermal import (
    LinkAheadOfShown,
    LinkWarmerThanShown,
    LinkWarmUp,
    slope_of,
)
from plumbline.kinematics.effects.payload import Payload
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot
from plumbline.optim.measurement.observation import scope_of
from tests.benches import R_DEVICE_BASE, T_DEVICE_BASE, TOOL, bench, readings, residuals

ARMS = ("ur5", "kr300", "laparoscopic", "seven")
G = 9.81
EXACT = 1e-13


def predicted(recording, effect, *values):
    """What the device reads with the effect in the model (N, m)."""
    ideal = recording.measured if recording.observation != "pose" else recording.measured[:, :3]
    return residuals(recording, [effect], values)[:, : ideal.shape[1]] + ideal


def encoders(recording, effect, *values):
    """Link-side joint coordinates with the effect in the model (N, n)."""
    zeros = recording.measured - recording.q
    return predicted(recording, effect, *values) - zeros


def in_base(places):
    """Places in the base frame of device readings (N, 3)."""
    return R_DEVICE_BASE.inv().apply(places - T_DEVICE_BASE)


def to_device(places):
    """Device readings of places in the base frame (N, 3)."""
    return R_DEVICE_BASE.apply(places) + T_DEVICE_BASE


def tip_poses(chain, Q):
    """Pinocchio's ``T_base_tip`` (N, 4, 4)."""
    data, poses = chain.model.createData(), []
    frame = next(k for k, f in enumerate(chain.model.frames) if f.name == chain.tip_frame)
    for q in Q:
        pin.framesForwardKinematics(chain.model, data, chain.configuration(q))
        poses.append(data.oMf[frame].homogeneous)
    return np.array(poses)


def tips(chain, Q):
    """Pinocchio's tool tips in the base frame (N, 3)."""
    T = tip_poses(chain, Q)
    return T[:, :3, :3] @ TOOL + T[:, :3, 3]


def gravity_torques(chain, Q, payload):
    """Pinocchio's gravity torques (N, n) with point masses (N,) hung on the tip frame."""
    torques = []
    place = pin.SE3(chain.T_last_tip)
    for q, mass in zip(Q, payload, strict=True):
        model = pin.Model(chain.model)
        lump = pin.Inertia(float(mass), np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(chain.n, lump, place)
        tau = pin.computeGeneralizedGravity(model, model.createData(), chain.configuration(q))
        torques.append(tau)
    return np.array(torques)


def moved(recording, Q):
    """Device readings with the joints at Q instead (N, 3)."""
    return to_device(tips(recording.chain, Q))


def column(n, joint, values):
    """Zeros but for one joint's column (N, n)."""
    out = np.zeros((len(values), n))
    out[:, joint - 1] = values
    return out


# Joints


@pytest.mark.parametrize("arm", ARMS)
def test_an_ideal_model_reads_what_pinocchio_says(arm):
    recording = bench(arm, "tip_position")
    np.testing.assert_allclose(
        residuals(recording) + recording.measured, moved(recording, recording.q), atol=EXACT
    )


@pytest.mark.parametrize("arm", ARMS)
def test_a_joint_offset_turns_or_shifts_its_joint(arm):
    recording = bench(arm, "tip_position")
    for joint in range(1, recording.chain.n + 1):
        Q = recording.q + column(recording.chain.n, joint, np.full(len(recording), 0.02))
        effect = REGISTRY["joint_offset"](joint=joint)
        np.testing.assert_allclose(
            predicted(recording, effect, 0.02), moved(recording, Q), atol=EXACT
        )


@pytest.mark.parametrize("arm", ARMS)
def test_a_joint_scale_stretches_its_joint_s_travel(arm):
    recording = bench(arm, "tip_position")
    for joint in range(1, recording.chain.n + 1):
        Q = recording.q + column(recording.chain.n, joint, 0.01 * recording.q[:, joint - 1])
        effect = REGISTRY["joint_scale"](joint=joint)
        np.testing.assert_allclose(
            predicted(recording, effect, 0.01), moved(recording, Q), atol=EXACT
        )


def test_a_joint_coupling_adds_a_share_of_the_other_joint_s_travel():
    recording = bench("laparoscopic", "tip_position")
    for joint, by in ((5, 4), (1, 7), (7, 2)):
        Q = recording.q + column(7, joint, -0.02 * recording.q[:, by - 1])
        effect = REGISTRY["joint_coupling"](joint=joint, by=by)
        np.testing.assert_allclose(
            predicted(recording, effect, -0.02), moved(recording, Q), atol=EXACT
        )


@pytest.mark.parametrize("arm", ARMS)
def test_a_joint_compliance_is_a_twist_by_pinocchio_s_gravity_torque(arm):
    recording = bench(arm, "joint_position")
    tau = gravity_torques(recording.chain, recording.q, recording.payload)
    assert np.abs(tau).max() > 1.0
    for joint in range(1, recording.chain.n + 1):
        effect = REGISTRY["joint_compliance"](joint=joint)
        expected = recording.q - column(recording.chain.n, joint, 3e-6 * tau[:, joint - 1])
        np.testing.assert_allclose(encoders(recording, effect, 3e-6), expected, atol=EXACT)


def test_a_compliant_horizontal_arm_sinks():
    """The sign: an arm stretched level goes down, whichever way its axis counts."""
    for turn in (np.pi / 2, -np.pi / 2):
        base = {"alpha": turn}
        robot = Robot.from_dh([base, {"a": 1.0, "mass": 5.0}])
        q = np.zeros((12, 2))
        q[:, 0] = np.linspace(-3, 3, 12)
        recording = bench(robot, "tip_position", q=q, columns=[])
        effect = REGISTRY["joint_compliance"](joint=2)
        sunk = in_base(predicted(recording, effect, 1e-4)) - tips(recording.chain, q)
        lever = 1.0 + TOOL[0]
        np.testing.assert_allclose(sunk[:, 2], -1e-4 * 5.0 * G * lever, rtol=1e-2)
        laden = REGISTRY["joint_compliance"](joint=2, laden=True)
        more = in_base(predicted(recording, laden, 0.0, 3e-5)) - tips(recording.chain, q)
        middle = 1.0 + TOOL[0] / 2  # of the tool, where its mass hangs
        np.testing.assert_allclose(more[:, 2], -3e-5 * G * middle * lever, rtol=1e-2)


def test_a_joint_compliance_by_effort_is_a_twist_by_the_measured_effort():
    recording = bench("ur5", "joint_position")
    effect = REGISTRY["joint_compliance"](joint=3, effort=True)
    expected = recording.q - column(6, 3, 2e-5 * recording.effort[:, 2])
    np.testing.assert_allclose(encoders(recording, effect, 2e-5), expected, atol=EXACT)


def test_backlash_parts_the_two_sides_of_an_approach_by_exactly_its_play():
    q = np.repeat(readings(Robot.bundled("ur5").chain(), 20), 3, axis=0)
    side = np.tile([1.0, -1.0, 0.0], 20)
    direction = np.tile(side[:, None], (1, 6))
    recording = bench("ur5", "joint_position", q=q, columns=[], direction=direction)
    for joint in (1, 4):
        seen = encoders(recording, REGISTRY["backlash"](joint=joint), 0.004)
        np.testing.assert_allclose(
            seen[1::3] - seen[::3], column(6, joint, [0.004] * 20), atol=EXACT
        )
        np.testing.assert_allclose((seen[1::3] + seen[::3]) / 2, q[::3], atol=EXACT)
        np.testing.assert_allclose(seen[2::3], q[::3], atol=EXACT)
        assert (seen[::3, joint - 1] < q[::3, joint - 1]).all(), "it stops short from below"


def test_without_a_recorded_side_backlash_follows_the_velocity_s_sign():
    recording = bench("ur5", "joint_position", columns=["velocity"])
    effect = REGISTRY["backlash"](joint=2, by="velocity")
    expected = recording.q - column(6, 2, 0.002 * np.sign(recording.velocity[:, 1]))
    np.testing.assert_allclose(encoders(recording, effect, 0.004), expected, atol=EXACT)


@pytest.mark.parametrize("arm", ARMS)
def test_a_heavy_link_rests_on_the_flank_that_pinocchio_s_gravity_torque_chooses(arm):
    recording = bench(arm, "joint_position", columns=["payload"])
    tau = gravity_torques(recording.chain, recording.q, recording.payload)
    scope = scope_of(recording)
    hard = REGISTRY["backlash"].candidates(scope)
    soft = [near for effect in hard for near in effect.neighbours(scope)]
    assert len(soft) == 5 * len(hard)
    largest = np.abs(tau[:, hard[0].joint - 1]).max()
    np.testing.assert_allclose(soft[2].seat, 0.03 * largest)  # some per cent of a rated torque
    for effect in (*hard, *soft):
        assert effect.by == "load"
        j = effect.joint
        assert tau[:, j - 1].min() < 0.0 < tau[:, j - 1].max()
        load = tau[:, j - 1]
        side = np.tanh(load / effect.seat) if effect.seat else np.sign(load)
        expected = recording.q - column(recording.chain.n, j, 0.002 * side)
        np.testing.assert_allclose(encoders(recording, effect, 0.004), expected, atol=EXACT)


def test_play_by_effort_rests_on_the_side_of_the_measured_effort():
    recording = bench("ur5", "joint_position", columns=["effort"])
    effect = REGISTRY["backlash"](joint=2, by="effort")
    expected = recording.q - column(6, 2, 0.002 * np.sign(recording.effort[:, 1]))
    np.testing.assert_allclose(encoders(recording, effect, 0.004), expected, atol=EXACT)


def test_the_load_tells_no_side_where_it_never_changes_its_own():
    """An arm that hangs to one side of a level axis: its play is an offset of its zero."""
    robot = Robot.from_dh([{"alpha": np.pi / 2}, {"a": 1.0, "mass": 5.0}])
    q = np.column_stack([np.linspace(-3, 3, 20), np.linspace(-1.2, 1.2, 20)])
    recording = bench(robot, "tip_position", q=q, columns=[])
    assert not REGISTRY["backlash"].candidates(scope_of(recording))
    both = bench(robot, "tip_position", q=2.0 * q, columns=[])
    found = REGISTRY["backlash"].candidates(scope_of(both))
    assert [(e.joint, e.by) for e in found] == [(2, "load")]


def test_coupled_play_shows_the_other_joint_s_side():
    recording = bench("laparoscopic", "joint_position")
    effect = REGISTRY["coupled_play"](joint=7, other=5)
    expected = recording.q - column(7, 7, 0.002 * recording.direction[:, 4])
    np.testing.assert_allclose(encoders(recording, effect, 0.004), expected, atol=EXACT)
    slide = recording.chain.kinds.index("prismatic") + 1
    dragged = REGISTRY["coupled_play"](joint=slide, other=1)
    found = REGISTRY["coupled_play"].candidates(scope_of(recording))
    assert sorted((e.joint, e.other) for e in found) == [
        (i, j) for i in range(1, 8) for j in range(1, 8) if j != i
    ]
    assert dragged.unit_of(dragged.parameters[0], recording.chain) == "m"


def test_a_gain_between_a_slide_and_a_joint_that_turns_is_no_ratio():
    chain = bench("laparoscopic", "joint_position").chain
    slide = chain.kinds.index("prismatic") + 1
    pairs = {(slide, 1): "m/rad", (1, slide): "rad/m", (1, 2): "1"}
    for (joint, by), unit in pairs.items():
        effect = REGISTRY["joint_coupling"](joint=joint, by=by)
        assert effect.unit_of(effect.parameters[0], chain) == unit


def triangle(steps):
    """A triangle wave of unit amplitude from 0: up, down, up again; and its turning points."""
    legs = [np.linspace(0, 1, steps), np.linspace(1, -1, 2 * steps), np.linspace(-1, 1, 2 * steps)]
    return np.concatenate(legs), legs


@pytest.mark.parametrize("steps", [20, 57])
def test_hysteresis_is_the_play_operator_on_a_triangle_wave(steps):
    """Rigid play of width w, leg by leg: the link waits until the motor has crossed w."""
    wave, legs = triangle(steps)
    w, amplitude = 0.2, 1.0
    rise, fall, again = legs
    play = np.concatenate(
        [
            np.maximum(0.0, rise - w / 2),
            np.minimum(amplitude - w / 2, fall + w / 2),
            np.maximum(-amplitude + w / 2, again - w / 2),
        ]
    )
    q = readings(Robot.bundled("ur5").chain(), len(wave))
    q[:, 2] = wave
    recording = bench("ur5", "joint_position", q=q, columns=[])
    effect = REGISTRY["hysteresis"](joint=3, width=w)
    seen = encoders(recording, effect, 0.02)
    np.testing.assert_allclose(seen[:, 2], wave + 0.02 * (play - wave) / w, atol=EXACT)
    np.testing.assert_allclose(np.delete(seen - q, 2, axis=1), 0.0, atol=EXACT)


def test_hysteresis_may_begin_with_its_play_taken_up():
    """The link that the way to the first row has left behind waits for no more."""
    effect = REGISTRY["hysteresis"](joint=1, width=0.1, start=-0.5)
    (lag,) = effect.derive({"q": np.linspace(0.0, 1.0, 9)[:, None]}).values()
    np.testing.assert_allclose(lag, -0.5, atol=1e-12)
    rows = {"q": np.zeros((2, 1)), "direction": -np.ones((2, 1))}
    np.testing.assert_allclose(*effect.derive(rows).values(), -0.5, err_msg="too short a way")
    said, none = replace(effect, start=None), replace(effect, start=0.0)
    np.testing.assert_allclose(*said.derive(rows).values(), 0.5, err_msg="as the rows say")
    np.testing.assert_allclose(*none.derive(rows).values(), 0.0, err_msg="none of it yet")
    tried = {e.start for e in said.neighbours(scope_of(bench("ur5", "tip_position")))}
    assert {-0.5, -0.25, 0.0, 0.25, 0.5} <= tried


def test_hysteresis_does_not_depend_on_how_fast_the_path_is_run():
    wave, _ = triangle(40)
    effect = REGISTRY["hysteresis"](joint=1, width=0.1)
    rows = {"q": wave[:, None]}
    (slow,) = effect.derive({"q": np.repeat(wave, 3)[:, None]}).values()
    (fast,) = effect.derive(rows).values()
    np.testing.assert_array_equal(slow[::3], fast)
    assert fast.min() == pytest.approx(-0.5)
    assert fast.max() == pytest.approx(0.5)


@pytest.mark.parametrize(("name", "order"), [("transmission_ripple", 2), ("gear_ripple", 100.5)])
def test_a_ripple_is_a_sine_of_the_joint_s_angle(name, order):
    recording = bench("ur5", "joint_position")
    effect = REGISTRY[name](joint=4, order=order)
    q = recording.q[:, 3]
    wave = 3e-4 * np.sin(order * q) - 4e-4 * np.cos(order * q)
    expected = recording.q + column(6, 4, wave)
    np.testing.assert_allclose(encoders(recording, effect, 3e-4, -4e-4), expected, atol=EXACT)
    tip = bench("ur5", "tip_position")
    np.testing.assert_allclose(
        predicted(tip, effect, 3e-4, -4e-4), moved(tip, expected), atol=EXACT
    )


def test_a_ripple_returns_after_a_turn_over_its_order():
    q = readings(Robot.bundled("ur5").chain(), 40)
    turned = q.copy()
    turned[:, 1] += 2 * np.pi / 32
    effect = REGISTRY["gear_ripple"](joint=2, order=32.0)
    errors = [
        encoders(bench("ur5", "joint_position", q=Q, columns=[]), effect, 1e-3, 5e-4) - Q
        for Q in (q, turned)
    ]
    np.testing.assert_allclose(errors[0], errors[1], atol=1e-12)
    assert np.abs(errors[0]).max() == pytest.approx(np.hypot(1e-3, 5e-4), rel=0.02)


def test_a_screw_s_ripple_is_a_sine_of_the_way_that_is_the_same_a_lead_further():
    recording = bench("laparoscopic", "joint_position")
    q = recording.q[:, 6]
    effect = REGISTRY["screw_ripple"](joint=7, order=2 * np.pi / 5e-3)
    wave = 3e-5 * np.sin(2 * np.pi * q / 5e-3) - 4e-5 * np.cos(2 * np.pi * q / 5e-3)
    expected = recording.q + column(7, 7, wave)
    np.testing.assert_allclose(encoders(recording, effect, 3e-5, -4e-5), expected, atol=EXACT)
    lead = column(7, 7, np.full(len(q), 5e-3))
    further = replace(recording, q=recording.q + lead, measured=recording.measured + lead)
    found = encoders(further, effect, 3e-5, -4e-5) - further.q
    np.testing.assert_allclose(found, expected - recording.q, atol=1e-12)


# Time and load


def test_a_latency_reads_the_joints_as_they_were():
    """At constant velocity: exactly the posture of a moment before."""
    q0, v = np.array([0.3, -1.0, 1.2, 0.4, 0.8, -0.5]), np.array([0.1, 0.2, -0.1, 0.3, 0.0, -0.2])
    t = np.linspace(0.0, 3.0, 30)
    q = q0 + t[:, None] * v
    recording = bench("ur5", "tip_position", q=q, columns=[], velocity=np.tile(v, (30, 1)))
    earlier = q0 + (t[:, None] - 0.12) * v
    np.testing.assert_allclose(
        predicted(recording, REGISTRY["latency"](), 0.12), moved(recording, earlier), atol=EXACT
    )


def test_friction_winds_up_against_the_motion_and_more_where_the_joint_creeps():
    """The Stribeck curve over the stiffness: at rest nothing, creeping most, then rising again."""
    speeds = np.array([0.0, 1e-9, -1e-9, 0.05, 0.5, -0.5, 1.0])
    velocity = np.zeros((len(speeds), 6))
    velocity[:, 2] = speeds
    q = np.linspace(-0.5, 0.5, len(speeds))[:, None] * np.ones(6)
    recording = bench("ur5", "joint_position", q=q, columns=[], velocity=velocity)
    friction = REGISTRY["friction"](joint=3, speed=0.05)
    lag = encoders(recording, friction, 1e-3, 5e-4, 2e-4) - q
    wound = [0.0, 1.5e-3, -1.5e-3, 1e-3 + 5e-4 / np.e + 1e-5, 1.1e-3, -1.1e-3, 1.2e-3]
    np.testing.assert_allclose(lag[:, 2], -np.array(wound), atol=1e-12)
    assert not np.delete(lag, 2, axis=1).any()


@pytest.mark.parametrize("arm", ARMS)
def test_a_payload_twists_the_turning_drives_by_the_torque_it_adds(arm):
    recording = bench(arm, "joint_position", columns=[])
    empty, laden = (
        gravity_torques(recording.chain, recording.q, np.full(len(recording), mass))
        for mass in (0.0, 7.0)
    )
    turning = [kind == "revolute" for kind in recording.chain.kinds]
    expected = recording.q - 2e-5 * (laden - empty) * turning
    np.testing.assert_allclose(
        encoders(recording, REGISTRY["payload"](), 7.0), expected, atol=EXACT
    )


@pytest.mark.parametrize("name", ["ur3", "bh7", "kr300"])
def test_a_payload_is_looked_for_in_drives_that_are_made_for_their_arm(name):
    chain = Robot.bundled(name).chain()
    usual = Payload.candidates(Scope(chain, "tip_position", frozenset(), {}, 10))[0]
    turning = [kind == "revolute" for kind in chain.kinds]
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (50, chain.n))
    most = max(chain.typical_load(j) for j in range(1, chain.n + 1))
    assert usual.compliance * most == pytest.approx(2e-3, rel=0.05)
    # By Pinocchio: no posture asks more of a drive than the arm stretched out level.
    assert np.abs(gravity_torques(chain, q, np.zeros(50)) * turning).max() < 2.0 * most


@pytest.mark.parametrize("name", ["joint_compliance", "joint_tilt", "link_flex", "base_compliance"])
def test_what_yields_is_made_for_its_load(name):
    """A wrist's link may bend a hundred times as far under a newton as an upper arm."""
    usual = []
    for robot in ("ur10", "kr300", "ur3"):
        chain = Robot.bundled(robot).chain()
        found = REGISTRY[name].candidates(Scope(chain, "tip_position", frozenset(), {}, 10))
        usual += [e.parameters[0].scale * chain.typical_load(e.element or 1) for e in found]
    assert len(usual) >= 6
    np.testing.assert_allclose(usual, usual[0])


def moments(chain, Q, payload):
    """Pinocchio's moments (N, n, 3) of gravity on every joint's bearing, in the joint's frame."""
    model, zero, found = chain.model, np.zeros(chain.model.nv), []
    place = pin.SE3(chain.T_last_tip)
    for q, mass in zip(Q, payload, strict=True):
        laden = pin.Model(model)
        lump = pin.Inertia(float(mass), np.zeros(3), np.zeros((3, 3)))
        laden.appendBodyToJoint(chain.n, lump, place)
        data = laden.createData()
        pin.rnea(laden, data, chain.configuration(q), zero, zero)
        found.append([-data.f[j + 1].angular for j in range(chain.n)])
    return np.array(found)


@pytest.mark.parametrize("arm", ARMS)
def test_a_bearing_tilts_by_pinocchio_s_moment_across_its_axis(arm):
    recording = bench(arm, "tip_position")
    chain, c = recording.chain, 2e-6
    every = moments(chain, recording.q, recording.payload)
    found = REGISTRY["joint_tilt"].candidates(scope_of(recording))
    for effect in (e for e in found if e.alike):
        j = effect.joint
        axis, expected = chain.joints[j - 1].axis, []
        data = chain.model.createData()
        for k, q in enumerate(recording.q):
            pin.forwardKinematics(chain.model, data, chain.configuration(q))
            own = every[k, j - 1] - axis * (axis @ every[k, j - 1])
            T_joint = data.oMi[j].homogeneous
            tilt = homogeneous(expm(np.cross(c * own, np.eye(3)).T), np.zeros(3))
            tip = T_joint @ tilt @ np.linalg.inv(T_joint) @ tip_poses(chain, [q])[0]
            expected.append(tip[:3, :3] @ TOOL + tip[:3, 3])
        seen = predicted(recording, effect, c)
        np.testing.assert_allclose(seen, to_device(np.array(expected)), atol=EXACT)


@pytest.mark.parametrize("arm", ARMS)
def test_an_uneven_housing_tilts_by_a_tensor_that_does_not_turn_with_the_joint(arm):
    recording = bench(arm, "tip_position")
    chain, values = recording.chain, (2e-6, 1e-6, 0.0)
    every = moments(chain, recording.q, recording.payload)
    [alike, *_] = REGISTRY["joint_tilt"].candidates(scope_of(recording))
    effect, j = replace(alike, alike=False), alike.joint
    axis, expected = chain.joints[j - 1].axis, []
    first = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.stack([first - axis * axis[np.argmin(np.abs(axis))], np.cross(axis, first)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for k, q in enumerate(recording.q):
        still = np.where(np.arange(chain.n) == j - 1, 0.0, q)  # the housing: the joint not turned
        turned = expm(np.cross(q[j - 1] * axis, np.eye(3)).T)
        moment = across @ turned @ every[k, j - 1]
        C = sum(
            c * (np.eye(2) + 0.3 * np.array([[np.cos(a), np.sin(a)], [np.sin(a), -np.cos(a)]]))
            for c, a in zip(values, np.deg2rad([0.0, 120.0, 240.0]), strict=True)
        )
        lean = across.T @ C @ moment
        data = chain.model.createData()
        pin.forwardKinematics(chain.model, data, chain.configuration(still))
        housing = data.oMi[j].homogeneous
        tilt = homogeneous(expm(np.cross(lean, np.eye(3)).T), np.zeros(3))
        tip = housing @ tilt @ np.linalg.inv(housing) @ tip_poses(chain, [q])[0]
        expected.append(tip[:3, :3] @ TOOL + tip[:3, 3])
    seen = predicted(recording, effect, *values)
    np.testing.assert_allclose(seen, to_device(np.array(expected)), atol=EXACT)
    same = predicted(recording, effect, *[2e-6 / 3] * 3)
    np.testing.assert_allclose(same, predicted(recording, alike, 2e-6), atol=EXACT)


@pytest.mark.parametrize("c", [(1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (1.0, 3.0, 0.5), (1.0, 1.0, 1.0)])
def test_no_housing_is_soft_about_one_direction_alone(c):
    """That would be the compliance of the drive before it, where axes meet at a right angle."""
    tensor = np.array(cs.evalf(_softness([cs.SX(v) for v in c])))
    softest, stiffest = np.linalg.eigvalsh(tensor)[::-1]
    np.testing.assert_allclose(tensor.trace() / 2, sum(c))
    assert softest / stiffest <= 1.3 / 0.7 + 1e-12
    if np.count_nonzero(c) == 1:
        assert softest / stiffest == pytest.approx(1.3 / 0.7)


def test_a_level_arm_on_an_upright_second_bearing_sinks():
    """An axis along gravity feels m g L across it, so that the tip sinks by c m g L (L + tool)."""
    robot = Robot.from_dh([{"alpha": 0.0, "d": 0.5}, {"a": 0.8, "mass": 6.0}])
    q = readings(robot.chain(), 14)
    recording = bench(robot, "tip_position", q=q, columns=[])
    effect, uneven = REGISTRY["joint_tilt"].candidates(scope_of(recording))
    assert effect.joint == 2, "the first axis stands upright: its tilt is the mounting's"
    sunk = in_base(predicted(recording, effect, 1e-6)) - tips(recording.chain, q)
    centre = recording.chain.joints[1].com[0]
    expected = -1e-6 * 6.0 * G * centre * (0.8 + TOOL[0])
    np.testing.assert_allclose(sunk[:, 2], expected, rtol=1e-4)
    [laden, _] = effect.neighbours(scope_of(recording))
    more = in_base(predicted(recording, laden, 0.0, 2e-6)) - tips(recording.chain, q)
    tip = np.array([0.8, 0.0]) + TOOL[:2]
    middle = tip - TOOL[:2] / 2  # of the tool, where its mass hangs
    np.testing.assert_allclose(more[:, 2], -2e-6 * G * (middle @ tip), rtol=1e-4)
    assert not uneven.alike, "an even housing bends the link for good, as its twist would"
    rocked = in_base(predicted(recording, uneven, 1e-6, 0.0, 0.0)) - tips(recording.chain, q)
    assert np.ptp(rocked[:, 2]) == pytest.approx(2 * SOFTER * np.abs(sunk[:, 2]).mean(), rel=0.1)


def test_an_upright_first_bearing_tilts_as_its_mounting_does():
    recording = bench("ur5", "tip_position")
    bearing = residuals(recording, [REGISTRY["joint_tilt"](joint=1)], [1e-6])
    mounting = residuals(recording, [REGISTRY["base_compliance"](alike=True)], [1e-6])
    moved = np.abs(bearing - residuals(recording)).max()
    assert moved > 1e-5
    np.testing.assert_allclose(bearing, mounting, atol=1e-3 * moved)


# Links


def with_wrong_link(rows, link, d, a, alpha, beta, q):
    """The arm's tip (4, 4) by plain multiplication of DH rows, one of them wrong."""
    T = np.eye(4)
    for number, (row, angle) in enumerate(zip(rows, q, strict=True), start=1):
        wrong = np.array([d, a, alpha, beta]) * (number == link)
        turn = Rotation.from_rotvec([0, 0, row.theta + angle * (row.kind == "revolute")])
        height = row.d + wrong[0] + angle * (row.kind == "prismatic")
        twist = Rotation.from_rotvec([row.alpha + wrong[2], 0, 0]).as_matrix()
        tilt = Rotation.from_rotvec([0, wrong[3], 0]).as_matrix()
        T = T @ homogeneous(turn.as_matrix(), [0, 0, height])
        T = T @ homogeneous(twist @ tilt, [row.a + wrong[1], 0, 0])
    return T


@pytest.mark.parametrize("arm", ["ur5", "kr300", "vs060", "laparoscopic"])
def test_a_wrong_link_is_the_same_arm_with_another_dh_row(arm):
    """What is told is added to the row as it stands, whichever way the table counts its normal."""
    robot = Robot.bundled(arm)
    recording = bench(robot, "tip_position", q=readings(robot.chain(), 30))
    rows = robot.dh
    for link in range(1, recording.chain.n):
        row = rows[link - 1]
        parallel = abs(np.sin(row.alpha)) < 1e-9
        values = [0.003, 0.002, 0.004, *([0.005] if parallel else [])]
        effect = REGISTRY["link_geometry"](link=link, parallel=parallel)
        wrong = (0.003, 0.002, 0.004, 0.005 * parallel)
        T = np.array([with_wrong_link(rows, link, *wrong, q) for q in recording.q])
        expected = to_device(T[:, :3, :3] @ TOOL + T[:, :3, 3])
        np.testing.assert_allclose(
            predicted(recording, effect, *values), expected, atol=EXACT, err_msg=str(effect)
        )


def test_beta_is_there_between_parallel_axes_alone():
    recording = bench("ur5", "tip_position")
    found = REGISTRY["link_geometry"].candidates(scope_of(recording))
    assert [effect.link for effect in found if effect.parallel] == [2, 3]
    assert [len(effect.parameters) for effect in found] == [3, 4, 4, 3, 3]


def test_a_warm_straight_chain_grows_in_proportion():
    """Three level links of 1.2 m in all, 10 degrees above 20 degC at 1.2e-5 per kelvin."""
    robot = Robot.from_dh([{"a": 0.5}, {"a": 0.4}, {"a": 0.3}])
    q = np.zeros((12, 3))
    q[:, 0] = np.linspace(-3, 3, 12)
    temperature = np.linspace(20.0, 30.0, 12)
    recording = bench(robot, "tip_position", q=q, columns=[], temperature=temperature)
    effect = REGISTRY["link_thermal"](reference_temperature=20.0)
    reach = np.linalg.norm(in_base(predicted(recording, effect, 1.2e-5))[:, :2], axis=1)
    grown = 1.2 * (1 + 1.2e-5 * (temperature - 20.0))
    np.testing.assert_allclose(reach, np.hypot(grown + TOOL[0], TOOL[1]), atol=EXACT)


def test_a_warm_arm_keeps_its_shape():
    """Every length alike: the flange's place is scaled about the base; the tool is not."""
    recording = bench("kr300", "tip_position")
    T = tip_poses(recording.chain, recording.q)
    effect = REGISTRY["link_thermal"](reference_temperature=18.0)
    growth = 1 + 2e-5 * (recording.temperature - 18.0)
    expected = to_device(growth[:, None] * T[:, :3, 3] + T[:, :3, :3] @ TOOL)
    np.testing.assert_allclose(predicted(recording, effect, 2e-5), expected, atol=EXACT)


def test_a_warm_up_is_of_first_order():
    recording = bench("ur5", "tip_position", columns=["time"])
    T = tip_poses(recording.chain, recording.q)
    effect = LinkWarmUp(time_constant=30.0, start=0.0)
    growth = 1 + 1e-3 * (1 - np.exp(-recording.time / 30.0))
    expected = to_device(growth[:, None] * T[:, :3, 3] + T[:, :3, :3] @ TOOL)
    np.testing.assert_allclose(predicted(recording, effect, 1e-3), expected, atol=EXACT)


def test_what_settles_is_looked_for_at_every_pace():
    """Between the time constants that are tried none is further off than a sixth of itself."""
    scope = scope_of(bench("ur5", "tip_position", columns=["time"]))
    span = float(np.ptp(scope.span["time"]))
    for kind in (REGISTRY["base_drift"], LinkWarmUp):
        tried = [e for e in kind.candidates(scope) if getattr(e, "rate", 1.0) > 0.0]
        every = {*tried, *(n for e in tried for n in e.neighbours(scope))}
        known = {getattr(e, "time_constant", None) or 1.0 / e.rate for e in every}
        logs = np.log(np.array(sorted(known)) / span)
        assert logs[0] < np.log(0.03)
        assert logs[-1] > np.log(2.0)
        assert np.diff(logs).max() < np.log(1.35)


def test_links_may_be_warmer_than_a_thermometer_shows():
    recording = bench("ur5", "tip_position")
    warmer = LinkWarmerThanShown(time_constant=30.0, start=0.0)
    growth = LinkWarmUp(time_constant=30.0, start=0.0)
    own = predicted(recording, growth, 1e-3) - recording.measured
    shown = predicted(recording, REGISTRY["link_thermal"](), 2e-5) - recording.measured
    both = predicted(recording, warmer, 1e-3, 2e-5) - recording.measured
    np.testing.assert_allclose(both, own + shown, atol=1e-12)


def test_a_thermometer_may_show_late_what_the_links_are_at():
    """Of a first-order lag tau the links are at T + tau dT/dt."""
    recording = bench("ur5", "tip_position")
    slope = slope_of(recording.time, recording.temperature)
    T = tip_poses(recording.chain, recording.q)
    links = recording.temperature + 90.0 * slope - 20.0
    expected = to_device((1 + 2e-5 * links)[:, None] * T[:, :3, 3] + T[:, :3, :3] @ TOOL)
    found = predicted(recording, LinkAheadOfShown(), 2e-5, 90.0 * 2e-5)
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_a_slope_is_told_through_a_thermometers_digits():
    time = np.sort(np.random.default_rng(0).uniform(0.0, 1500.0, 300))
    links = 10.0 * (1.0 - np.exp(-time / 600.0))
    slope = slope_of(time, np.round(links, 1))
    inner = (time > 100.0) & (time < 1400.0)
    np.testing.assert_allclose(slope[inner], np.exp(-time[inner] / 600.0) / 60.0, atol=2e-3)
    np.testing.assert_array_equal(slope_of(np.full(5, 3.0), np.arange(5.0)), np.zeros(5))
    back = slope_of(time[::-1], np.round(links, 1)[::-1])
    np.testing.assert_allclose(back, slope[::-1], atol=1e-12)


L, LOAD, KAPPA = 0.8, 12.0, 4e-5


def cantilever(own=0.0, load=0.0, ahead=0.0):
    """Deflection down [m] and slope [rad] of a level beam, as the model has them.

    Args:
        own: Mass of the beam [kg].
        load: Mass that it carries [kg].
        ahead: How far beyond the beam's end the load sits [m].
    """
    beam = {"a": L, "mass": own, "com": [-L / 2, 0.0, 0.0]}
    robot = Robot.from_dh([beam, {"mass": load, "com": [ahead, 0.0, 0.0]}])
    q = np.zeros((14, 2))
    q[:, 0] = np.linspace(-3, 3, 14)
    recording = bench(robot, "pose", q=q, columns=[])
    flat = tips(recording.chain, q)
    effect = REGISTRY["link_flex"](link=1)
    residual = residuals(recording, [effect], [KAPPA])
    shift = R_DEVICE_BASE.inv().apply(residual[:, :3])
    slope = np.arcsin(np.linalg.norm(residual[:, 3:], axis=1) / 0.3)
    turn = np.array([Rotation.from_rotvec([0, 0, angle]).as_matrix() for angle in q[:, 0]])
    end = np.einsum("kji,kj->ki", turn, shift)  # in the beam's own axes
    bent = Rotation.from_rotvec([0, slope[0], 0]).apply(TOOL) - TOOL
    np.testing.assert_allclose(np.ptp(slope), 0.0, atol=1e-12)
    np.testing.assert_allclose(end - bent, np.tile([0, 0, (end - bent)[0, 2]], (14, 1)), atol=1e-12)
    assert np.linalg.norm(flat[:, :2], axis=1).min() > 0.5
    return -(end - bent)[0, 2], slope[0]


def test_a_level_link_sags_as_an_end_loaded_cantilever():
    """F L^3 / (3 E I) and F L^2 / (2 E I)."""
    sag, slope = cantilever(load=LOAD)
    assert sag == pytest.approx(KAPPA * LOAD * G * L**3 / 3, rel=1e-9)
    assert slope == pytest.approx(KAPPA * LOAD * G * L**2 / 2, rel=1e-9)


def test_a_level_link_sags_under_its_own_weight_as_a_uniform_beam():
    """W L^3 / (8 E I) and W L^2 / (6 E I)."""
    sag, slope = cantilever(own=LOAD)
    assert sag == pytest.approx(KAPPA * LOAD * G * L**3 / 8, rel=1e-9)
    assert slope == pytest.approx(KAPPA * LOAD * G * L**2 / 6, rel=1e-9)


def test_a_load_beyond_the_link_s_end_bends_it_by_its_moment_too():
    """M L^2 / (2 E I) and M L / (E I) besides."""
    sag, slope = cantilever(load=LOAD, ahead=0.25)
    moment = LOAD * G * 0.25
    assert sag == pytest.approx(KAPPA * (LOAD * G * L**3 / 3 + moment * L**2 / 2), rel=1e-9)
    assert slope == pytest.approx(KAPPA * (LOAD * G * L**2 / 2 + moment * L), rel=1e-9)


def test_a_beam_s_equation_integrates_to_the_same_line():
    """E I y'' = M(x), twice summed up over a fine grid: distributed and end load together."""
    x = np.linspace(0.0, L, 200_001)
    own, load, ahead = 3.0, 8.0, 0.1
    moment = load * G * (L + ahead - x) + own * G / L * (L - x) ** 2 / 2
    step = x[1] - x[0]
    slope = np.concatenate([[0.0], np.cumsum((moment[1:] + moment[:-1]) / 2) * step]) * KAPPA
    line = np.sum((slope[1:] + slope[:-1]) / 2) * step
    found = cantilever(own=own, load=load, ahead=ahead)
    assert found == pytest.approx((line, slope[-1]), rel=1e-8)


def test_an_upright_link_does_not_bend_under_a_load_above_it():
    robot = Robot.from_dh([{"d": 0.8, "mass": 4.0}, {"mass": 9.0, "d": 0.2}])
    q = readings(robot.chain(), 14)
    recording = bench(robot, "tip_position", q=q, columns=[])
    same = residuals(recording, [REGISTRY["link_flex"](link=1)], [1e-3])
    np.testing.assert_allclose(same, residuals(recording), atol=1e-14)


# Tool


@pytest.mark.parametrize("arm", ARMS)
def test_a_tool_offset_moves_the_tip_in_the_tip_s_frame(arm):
    recording = bench(arm, "tip_position")
    T = tip_poses(recording.chain, recording.q)
    wrong = np.array([0.001, -0.002, 0.003])
    expected = to_device(T[:, :3, :3] @ (TOOL + wrong) + T[:, :3, 3])
    np.testing.assert_allclose(
        predicted(recording, REGISTRY["tool_offset"](), *wrong), expected, atol=EXACT
    )


def test_a_needle_sags_with_the_sine_of_its_slant():
    """Down by s sin^2, and square to its axis by s sin: s if level, nothing if upright."""
    recording = bench("ur5", "tip_position")
    axis = (0.6, 0.0, 0.8)
    shift = in_base(predicted(recording, REGISTRY["needle_sag"](axis=axis), 2e-3)) - tips(
        recording.chain, recording.q
    )
    needle = tip_poses(recording.chain, recording.q)[:, :3, :3] @ axis
    slant = np.arccos(needle[:, 2])
    np.testing.assert_allclose(np.linalg.norm(shift, axis=1), 2e-3 * np.sin(slant), atol=EXACT)
    np.testing.assert_allclose(np.sum(shift * needle, axis=1), 0.0, atol=EXACT)
    np.testing.assert_allclose(shift[:, 2], -2e-3 * np.sin(slant) ** 2, atol=EXACT)


def test_a_needle_bends_under_a_tip_force_as_a_cantilever():
    """c F across the needle and 3 c F / (2 L) of turn, nothing along it: F L^3 / (3 E I)."""
    recording = bench("ur5", "pose")
    [effect] = REGISTRY["needle_bending"].candidates(scope_of(recording))
    u = TOOL / np.linalg.norm(TOOL)
    length, kappa = np.linalg.norm(TOOL), 0.5  # 1 / (E I)
    across = recording.force - np.outer(recording.force @ u, u)
    R = tip_poses(recording.chain, recording.q)[:, :3, :3]
    bent = np.einsum("nij,nj->ni", R, kappa * length**3 / 3 * across)
    seen = predicted(recording, effect, kappa * length**3 / 3)
    shift = in_base(seen) - tips(recording.chain, recording.q)
    np.testing.assert_allclose(shift, bent, atol=1e-12)
    turned = residuals(recording, [effect], [kappa * length**3 / 3])[:, 3:]
    slope = np.linalg.norm(kappa * length**2 / 2 * across, axis=1)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 0.3 * np.sin(slope), rtol=1e-9)


def test_a_re_seated_tool_steps_in_the_tip_s_frame():
    recording = bench("kr300", "tip_position")
    wrong = np.array([1e-3, -5e-4, 2e-3])
    T = tip_poses(recording.chain, recording.q)
    effect = REGISTRY["tool_slip"](moment=41.0)
    later = np.outer(recording.time > 41.0, wrong)
    expected = np.einsum("nij,nj->ni", T[:, :3, :3], TOOL + later) + T[:, :3, 3]
    np.testing.assert_allclose(
        predicted(recording, effect, *wrong), to_device(expected), atol=EXACT
    )


def test_a_tool_re_seated_by_group_has_a_place_for_each_group_but_the_first():
    recording = bench("ur5", "tip_position", columns=["group"])
    [effect] = REGISTRY["tool_slip"].candidates(scope_of(recording))
    assert [p.name for p in effect.parameters] == [f"{c} of {g}" for g in (2, 3) for c in "xyz"]
    places = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, -1e-3], [0.0, 5e-4, 2e-3]])
    T = tip_poses(recording.chain, recording.q)
    tool = TOOL + places[recording.group - 1]
    expected = np.einsum("nij,nj->ni", T[:, :3, :3], tool) + T[:, :3, 3]
    np.testing.assert_allclose(
        predicted(recording, effect, *places[1:].ravel()), to_device(expected), atol=EXACT
    )


@pytest.mark.parametrize(("slant", "sag"), [(0.0, 0.0), (np.pi / 2, 2e-3), (np.pi, 0.0)])
def test_a_needle_sags_fully_when_level_and_not_at_all_when_upright(slant, sag):
    robot = Robot.from_dh([{}, {"alpha": slant, "a": 0.4}])
    q = readings(robot.chain(), 14)
    recording = bench(robot, "tip_position", q=q, columns=[])
    shift = in_base(predicted(recording, REGISTRY["needle_sag"](), 2e-3)) - tips(recording.chain, q)
    np.testing.assert_allclose(shift, np.tile([0.0, 0.0, -sag], (14, 1)), atol=EXACT)


# Base


TWIST = np.array([1e-3, -2e-3, 5e-4, 3e-3, -1e-3, 2e-3])


def shaken(recording, shares):
    """Device readings after shares (N,) of the twist have moved the base."""
    turned = [
        expm(np.cross(share * TWIST[3:], np.eye(3)).T) @ tip + share * TWIST[:3]
        for share, tip in zip(shares, tips(recording.chain, recording.q), strict=True)
    ]
    return to_device(np.array(turned))


def test_a_drift_goes_evenly_with_time():
    recording = bench("ur5", "tip_position")
    effect = REGISTRY["base_drift"](start=0.0, end=90.0)
    expected = shaken(recording, recording.time / 90.0)
    np.testing.assert_allclose(predicted(recording, effect, *TWIST), expected, atol=EXACT)


def test_a_settling_drift_slows_down():
    recording = bench("ur5", "tip_position")
    effect = REGISTRY["base_drift"](start=0.0, end=90.0, rate=1 / 30.0)
    expected = shaken(recording, (1 - np.exp(-recording.time / 30.0)) / (1 - np.exp(-3.0)))
    np.testing.assert_allclose(predicted(recording, effect, *TWIST), expected, atol=EXACT)


def test_a_bump_is_a_step():
    recording = bench("kr300", "tip_position")
    effect = REGISTRY["base_bump"](moment=41.0)
    later = recording.time > 41.0
    assert 10 < later.sum() < 50
    expected = shaken(recording, later.astype(float))
    np.testing.assert_allclose(predicted(recording, effect, *TWIST), expected, atol=EXACT)


def test_a_motion_without_a_turn_shifts_all_tips_alike():
    recording = bench("ur5", "tip_position")
    effect = REGISTRY["base_bump"](moment=-1.0, turning=False)
    shift = predicted(recording, effect, *TWIST[:3]) - recording.measured
    np.testing.assert_allclose(shift, np.tile(R_DEVICE_BASE.apply(TWIST[:3]), (60, 1)), atol=EXACT)


@pytest.mark.parametrize("arm", ["ur5", "kr300", "laparoscopic"])
@pytest.mark.parametrize("alike", [True, False])
def test_a_soft_base_tilts_by_the_moment_of_the_arm_s_centre_of_mass(arm, alike):
    recording = bench(arm, "tip_position")
    chain, data = recording.chain, recording.chain.model.createData()
    mass = sum(inertia.mass for inertia in list(chain.model.inertias)[1:])
    compliance = np.array([2e-7, 2e-7 if alike else 5e-7, 0.0])
    T, expected = tip_poses(chain, recording.q), []
    for k, q in enumerate(recording.q):
        com = pin.centerOfMass(chain.model, data, chain.configuration(q))
        moment = np.cross(com, mass * chain.gravity)
        moment += np.cross(T[k, :3, 3], recording.payload[k] * chain.gravity)
        tilt = expm(np.cross(compliance * moment, np.eye(3)).T)
        expected.append(tilt @ (T[k, :3, :3] @ TOOL + T[k, :3, 3]))
    values = compliance[:1] if alike else compliance[:2]
    effect = REGISTRY["base_compliance"](alike=alike)
    np.testing.assert_allclose(
        predicted(recording, effect, *values), to_device(np.array(expected)), atol=EXACT
    )


def test_a_soft_base_lowers_an_arm_that_leans_out():
    recording = bench("ur5", "tip_position", columns=[])
    T = tip_poses(recording.chain, recording.q)
    sunk = in_base(predicted(recording, REGISTRY["base_compliance"](), 1e-6)) - tips(
        recording.chain, recording.q
    )
    out = np.linalg.norm(T[:, :2, 3], axis=1) > 0.5
    assert out.sum() > 5
    assert (sunk[out, 2] < 0).all()


# Sensor


def test_a_sensor_scale_stretches_the_device_s_axes():
    recording = bench("ur5", "tip_position")
    alike, apart = (REGISTRY["sensor_scale"](alike=alike) for alike in (True, False))
    y = recording.measured
    np.testing.assert_allclose(predicted(recording, alike, 1e-3), 1.001 * y, atol=EXACT)
    gains = np.array([1e-3, -2e-3, 3e-3])
    np.testing.assert_allclose(predicted(recording, apart, *gains), (1 + gains) * y, atol=EXACT)


def test_a_radial_distortion_grows_with_the_square_of_the_angle_off_the_axis():
    """A point keeps its bearing and depth; its image moves out by k rho^3 (Brown 1966).

    Where it is the distance from the axis that counts, a point itself moves out by k r^3.
    """
    recording = bench("ur5", "tip_position")
    effect = REGISTRY["sensor_distortion"](kind="radial")
    y, seen = recording.measured, predicted(recording, effect, 0.05)
    image, moved_image = y[:, :2] / y[:, 2:], seen[:, :2] / seen[:, 2:]
    rho = np.linalg.norm(image, axis=1)
    np.testing.assert_allclose(np.linalg.norm(moved_image, axis=1), rho + 0.05 * rho**3, atol=EXACT)
    np.testing.assert_allclose(np.arctan2(*moved_image.T), np.arctan2(*image.T), atol=1e-12)
    np.testing.assert_allclose(seen[:, 2], y[:, 2], atol=EXACT)
    across = predicted(recording, REGISTRY["sensor_distortion"](kind="across"), 0.05)
    r = np.linalg.norm(y[:, :2], axis=1)
    np.testing.assert_allclose(np.linalg.norm(across[:, :2], axis=1), r + 0.05 * r**3, atol=EXACT)
    np.testing.assert_allclose(across[:, 2], y[:, 2], atol=EXACT)


def test_a_distortion_is_tried_all_over_the_field_to_a_fortieth_of_it_and_no_finer():
    """Places, and their neighbours by halves and quarters: more would cost and tell no more."""
    effect, field = REGISTRY["sensor_distortion"], (1.0, 3.0)
    scope = SimpleNamespace(span={"depth": field, "range": field})
    first = [e for e in effect.forms(scope) if e.kind == "depth"]
    tried = np.unique([e.right_at for one in first for e in (one, *one.neighbours(scope))])
    inner = np.linspace(1.4, 2.6, 1000)
    missed = np.abs(inner[:, None] - tried).min(axis=1).max() / np.ptp(field)
    assert 1 / 50 < missed < 1 / 42


def test_a_distortion_by_range_or_depth_keeps_the_bearing():
    """And is none where the device was calibrated: here at a metre."""
    recording = bench("ur5", "tip_position")
    y = recording.measured
    distance = np.linalg.norm(y, axis=1)
    for kind, gain in (("range", distance**2), ("depth", y[:, 2])):
        effect = REGISTRY["sensor_distortion"](kind=kind, right_at=1.0)
        seen = predicted(recording, effect, 1e-3)
        np.testing.assert_allclose(seen, (1 + 1e-3 * (gain - 1))[:, None] * y, atol=EXACT)


def test_respiration_is_a_sine_that_averages_out():
    rows, f = 120, 0.25
    q = readings(Robot.bundled("ur5").chain(), rows)
    time = np.arange(rows) * 0.1  # three breaths
    recording = bench("ur5", "tip_position", q=q, columns=[], time=time)
    a, b = np.array([1e-3, 0.0, 2e-3]), np.array([0.0, 5e-4, -1e-3])
    effect = REGISTRY["respiration"](frequency=f)
    shift = predicted(recording, effect, *a, *b) - recording.measured
    phase = 2 * np.pi * f * time[:, None]
    np.testing.assert_allclose(shift, a * np.sin(phase) + b * np.cos(phase), atol=EXACT)
    np.testing.assert_allclose(shift.mean(axis=0), 0.0, atol=EXACT)
    np.testing.assert_allclose(shift[:40], shift[40:80], atol=EXACT)


def test_a_breath_that_dwells_is_of_as_many_harmonics_as_its_cosine_s_square_has_powers():
    """cos^6 of half a breath (Seppenwoolde et al. 2002), less its mean: three sines."""
    time = np.sort(np.random.default_rng(0).uniform(0.0, 60.0, 120))
    q = readings(Robot.bundled("ur5").chain(), len(time))
    recording = bench("ur5", "tip_position", q=q, columns=[], time=time)
    plain, way = REGISTRY["respiration"](frequency=0.25), np.array([2e-3, -1e-3, 3e-3])
    known = {e.harmonics for e in plain.neighbours(scope_of(recording))}
    assert known == {1, 2, 3}
    expected = np.outer(10 / 32 - np.cos(np.pi * 0.25 * time) ** 6, way)
    none = np.zeros(3)
    shares = [v for k in (15, 6, 1) for v in (*none, *(-way * k / 32))]
    found = predicted(recording, replace(plain, harmonics=3), *shares) - recording.measured
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_every_effect_has_a_law_that_fails_when_it_is_half_as_strong_again():
    here = Path(__file__)
    files = (here, here.with_name("test_torques.py"), here.with_name("test_parts_physics.py"))
    options = ("-p", "tests.damaged_effects", "-p", "no:cacheprovider", "--tb=no", "-rN")
    told = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-k", "not half_as_strong", *files],
        cwd=here.parents[2], capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    noticed = next(line for line in told.splitlines() if line.startswith("noticed: "))
    assert set(noticed.split()[1:]) == set(REGISTRY)
