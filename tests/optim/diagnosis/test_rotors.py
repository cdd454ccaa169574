"""Rotors of drives that a log moves gently: as large as makers' arms have them, and no link's."""

import numpy as np

from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.building import build_recording

STRETCHES, ROWS, STEP = 6, 26, 0.02  # half a second each, every three seconds
NOISE = np.array([2.5, 4.0, 2.0])  # N m
RIVALS = DiagnosisOptions(library=[e for e in EFFECTS if e.name in (
    "rotor_inertia", "link_inertia", "payload", "torque_scale", "coulomb_friction",
    "viscous_friction",
)])  # fmt: skip
DRY, VISCOUS = np.array([12.0, 12.0, 8.0]), np.array([20.0, 25.0, 6.0])  # N m, N m s/rad


def arm():
    links = [
        (0.18, 0.0, np.pi / 2, 7.4, [0.02, 0.0, 0.03]),
        (0.0, -0.61, 0.0, 13.0, [0.38, 0.0, 0.16]),
        (0.0, -0.57, 0.0, 4.0, [0.24, 0.0, 0.07]),
    ]
    names = ("d", "a", "alpha", "mass", "com")
    return Robot.from_dh([dict(zip(names, link, strict=True)) for link in links])


def recorded(seed, share):
    """Efforts of three joints that rub, and their rotors: such a share of the largest effort."""
    rng, robot = np.random.default_rng(seed), arm()
    time = (3.0 * np.arange(STRETCHES)[:, None] + STEP * np.arange(ROWS)).ravel()
    w, phase = 2 * np.pi * rng.uniform(0.05, 0.3, (3, 3)), rng.uniform(0, 6, (3, 3))
    angle = w * time[:, None, None] + phase
    waves = 0.5 * np.sin(angle), 0.5 * w * np.cos(angle), -0.5 * w**2 * np.sin(angle)
    q, v, a = (x.sum(axis=1) for x in waves)
    tau = tree_of(robot).dynamics.torques(q, v, a) + DRY * np.tanh(v / 0.02) + VISCOUS * v
    rotors = share * np.abs(tau).max(axis=0)
    read = tau + rotors * a + NOISE * rng.normal(size=tau.shape)
    recording = build_recording(
        observation="joint_torque", robot=robot, time=time, q=q, velocity=v, acceleration=a,
        measured=read, noise_by_joint=NOISE, group=np.repeat(np.arange(STRETCHES), ROWS),
    )  # fmt: skip
    return recording, rotors


def test_rotors_of_a_gently_moved_arm_are_found_and_blamed_on_no_link(monkeypatch):
    monkeypatch.setattr(prior, "LONG_MOVES", 200)  # what is asked is sure: time alone
    recording, rotors = recorded(seed=1, share=0.03)
    causes = {(c.effect, c.element): c for c in diagnose(recording, RIVALS).causes}
    for joint in (1, 2):
        inertia = causes["rotor_inertia", joint].parameters["inertia"]
        assert abs(inertia.value - rotors[joint - 1]) < 3.0 * inertia.std
    assert not {effect for effect, _ in causes} & {"link_inertia", "payload"}


def test_where_no_rotor_is_missing_none_is_named():
    recording, _ = recorded(seed=2, share=0.0)
    causes = {c.effect for c in diagnose(recording).causes}
    assert causes <= {"coulomb_friction", "viscous_friction"}
