"""Torques of an arm of six joints, its wrist a thousandth as heavy as its base: MuJoCo carries."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plumbline import build_motion, diagnose
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.progress import silent
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.motion import diagnose as diagnose_module
from plumbline.optim.diagnosis.motion.fit import fitted
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.diagnosis.options import DiagnosisOptions

STEP, EVERY, SECONDS, NOISE = 1e-3, 5, 6.0, 1e-4
AT = np.array([0.0, -0.9, 1.4, -0.5, 0.3, 0.0])  # [rad] about which it swings
# Of each link: place [m], axis, centre [m], mass [kg], inertias [kg m^2]; sizes are of a UR5.
LINKS = (
    ("0 0 .0892", "0 0 1", "0 -.005 0", 3.7, ".0102 .0102 .0067"),
    ("0 .1358 0", "0 1 0", ".2125 0 0", 8.393, ".0151 .2269 .2269"),
    (".425 -.1197 0", "0 1 0", ".1961 0 0", 2.33, ".0041 .0312 .0312"),
    (".3922 0 0", "0 1 0", "0 .093 0", 1.219, ".0026 .0022 .0026"),
    ("0 .093 0", "0 0 1", "0 0 .0946", 1.219, ".0026 .0026 .0022"),
    ("0 0 .0946", "0 1 0", "0 .05 0", 0.1879, ".00021 .00013 .00021"),
)


def files(integrator):
    """The same arm as URDF and as MJCF."""
    urdf, bodies, before = '<robot name="six"><link name="base"/>', "", "base"
    for k, (place, axis, centre, mass, inertia) in enumerate(LINKS):
        x, y, z = inertia.split()
        urdf += (
            f'<joint name="j{k}" type="revolute"><origin xyz="{place}"/><parent link="{before}"/>'
            f'<child link="l{k}"/><axis xyz="{axis}"/><limit lower="-6" upper="6" effort="500" '
            f'velocity="50"/></joint><link name="l{k}"><inertial><origin xyz="{centre}"/>'
            f'<mass value="{mass}"/><inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" '
            'iyz="0"/></inertial></link>'
        )
        bodies += (
            f'<body pos="{place}"><joint name="j{k}" axis="{axis}"/>'
            f'<inertial pos="{centre}" mass="{mass}" diaginertia="{inertia}"/>'
        )
        before = f"l{k}"
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(LINKS)))
    return urdf + "</robot>", (
        f'<mujoco><option timestep="{STEP}" integrator="{integrator}"/><worldbody>{bodies}'
        f"{'</body>' * len(LINKS)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def recorded(integrator="RK4", noise=NOISE, every=EVERY):
    """Torques that hold the arm near a path, as MuJoCo carries them out."""
    urdf, mjcf = files(integrator)
    model, n = mujoco.MjModel.from_xml_string(mjcf), len(LINKS)
    data, plan = mujoco.MjData(model), mujoco.MjData(model)
    rng = np.random.default_rng(100)
    size, turn = rng.uniform(0.2, 0.5, (n, 2)), rng.uniform(1.5, 4.0, (n, 2)) * [1.0, 2.2]
    phase, push = rng.uniform(0.0, 6.0, (n, 2)), np.zeros(n)
    data.qpos[:] = AT + (size * np.sin(phase)).sum(axis=1)
    told, seen = [], []
    for k in range(round(SECONDS / STEP)):
        if k % every == 0:
            angle = turn * k * STEP + phase
            error = AT + (size * np.sin(angle)).sum(axis=1) - data.qpos
            slower = (size * turn * np.cos(angle)).sum(axis=1) - data.qvel
            plan.qpos[:], plan.qvel[:] = data.qpos, data.qvel
            mujoco.mj_forward(model, plan)
            mujoco.mj_mulM(model, plan, push, 625.0 * error + 35.0 * slower)
            asked = push + plan.qfrc_bias
        told.append(asked.copy())
        seen.append(data.qpos.copy())
        data.ctrl[:] = asked
        mujoco.mj_step(model, data)
    q = np.array(seen) + np.random.default_rng(0).normal(0.0, noise, (len(seen), n))
    return build_motion(
        robot=Robot.from_urdf(urdf), time=STEP * np.arange(len(q))[::every],
        command=np.array(told)[::every], q=q[::every], kind="torque", noise_std=NOISE,
    )  # fmt: skip


@pytest.fixture(scope="module")
def as_told():
    return recorded()


def test_a_wrist_as_light_as_its_file_states_leaves_noise_alone(as_told):
    """Were it taken to be 1e-3 kg m^2 it would leave a hundred times as much."""
    signals = signals_of(as_told)
    for j in range(len(LINKS)):
        left = fitted(signals.windows(j, signals.training), (), np.empty(0))
        assert left.square**0.5 < 1.05 * NOISE
    assert signals.loads[1][:, -1].max() < 3e-4


def test_an_arm_of_six_joints_that_does_as_told_has_no_gap(as_told):
    verdict = diagnose(as_told).verdict
    assert verdict.verdict is Outcome.NO_GAP
    assert not verdict.causes


@pytest.mark.parametrize("every", [5, 10])
def test_rows_far_apart_leave_nothing_of_their_own(every):
    """Of rows 10 ms apart the mean of a step's ends would leave nine tenths of the noise."""
    signals = signals_of(recorded(noise=0.0, every=every))
    for j in range(len(LINKS)):
        left = fitted(signals.windows(j, signals.training), (), np.empty(0))
        assert left.square**0.5 < 0.03 * NOISE


def test_loads_of_a_log_of_minutes_are_worked_out_at_every_row():
    """On lines between every other row's a wrist would err by a seventh of the noise."""
    short, many = recorded(noise=0.0), 18
    rows = np.arange(many * len(short))
    long = replace(
        short, time=STEP * EVERY * rows, command=np.tile(short.command, (many, 1)),
        q=np.tile(short.q, (many, 1)), group=rows // len(short),
    )  # fmt: skip
    signals = signals_of(long)
    left = fitted(signals.windows(3, signals.training), (), np.empty(0))
    assert left.square**0.5 < 0.03 * NOISE


def test_a_simulator_that_turns_by_the_speed_its_step_began_with_has_no_gap():
    """Were Coriolis torques of the speed halfway, joint 4 would err by 1.6 times the noise."""
    found = diagnose(recorded("implicitfast"))
    assert found.verdict.verdict is Outcome.NO_GAP
    assert found.signals.behind == found.signals.recording.lead
    assert found.signals.behind == pytest.approx(STEP / 2, abs=STEP / 50)


def test_six_joints_that_lead_do_so_by_one_clock_whatever_was_taken_for_it(monkeypatch):
    """Implicit steps move places by the speed that they end with: all lead by half of one.

    Of drives alone, before a clock is thought of, a wrist has a largest torque. Were its neighbours
    to feel that, one clock would be 27 nats less probable than a delay each.
    """
    monkeypatch.setattr(diagnose_module, "MOVES", 1)
    log, options = recorded("implicitfast"), DiagnosisOptions()
    signals = diagnose_module._searched(log, options, silent).signals
    assert signals.recording.lead == pytest.approx(STEP / 2, abs=STEP / 5)


@pytest.mark.parametrize(("stated", "moved"), [(0.0, 1e-3), (5e-10, 1e-3), (2e-9, 2e-9)])
def test_torques_move_what_a_file_states_and_a_rotor_where_it_states_nothing(stated, moved):
    inertia = f'ixx="{stated}" iyy="{stated}" izz="{stated}" ixy="0" ixz="0" iyz="0"'
    body = f'<inertial><mass value="{stated}"/><inertia {inertia}/></inertial>'
    urdf = (
        '<robot name="r"><link name="b"/><joint name="a" type="revolute"><parent link="b"/>'
        '<child link="l"/><axis xyz="0 0 1"/><limit lower="-6" upper="6" effort="5" velocity="5"/>'
        f'</joint><link name="l">{body}</link></robot>'
    )
    t = np.arange(400) * 0.005
    q, command = 0.1 * np.sin(9 * t)[:, None], 1e-3 * np.sin(9 * t)[:, None]
    told = build_motion(
        robot=Robot.from_urdf(urdf), time=t, command=command, q=q, kind="torque", noise_std=1e-4
    )
    assert np.allclose(signals_of(told).loads[1], moved, rtol=1e-6, atol=0.0)
