"""An unknown in a cause's place: confounded effects give way, true causes stay, noise is noise."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.reality.end_effects import NeedleSag, Respiration
from plumbline.experiments.reality.joint_effects import (
    JointCompliance,
    JointCoupling,
    JointOffset,
    Payload,
    TransmissionRipple,
)
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.hysteresis import lag_of_play
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.respiration import FASTEST, SLOWEST, TURNS
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.dependences import dependences
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.robust import noise_lever
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.recording.building import build_recording
from tests.benches import TOOL, bench, measured, readings
from tests.explained import told
from tests.few_effects import FEW_EFFECTS, only
from tests.simulated_cases import causes, faultless, recorded, with_fault

ZEROS = ("joint_offset", "joint_scale", "transmission_ripple")
COUPLED = only(*ZEROS, "joint_coupling", "coupled_play", "gear_ripple", "hysteresis")
DRAGGED = only(*ZEROS, "joint_coupling")
PLAY = only(*ZEROS, "backlash", "hysteresis", "friction")
SEEN = only("joint_offset", "joint_scale", "base_bump", "sensor_scale", "sensor_distortion")
BREATHS = only("joint_offset", "base_drift", "base_bump", "sensor_scale", "respiration")
TEETH = only(*ZEROS, "gear_ripple")
NEEDLES = only("joint_offset", "joint_compliance", "base_compliance", "needle_sag",
               "needle_bending", "payload", "tool_offset")  # fmt: skip
LOADED = only("joint_offset", "joint_compliance", "backlash", "joint_tilt", "hysteresis",
              "friction", "link_flex", "base_compliance", "payload", "needle_sag",
              "needle_bending")  # fmt: skip


def fitted(recording, effects=()):
    nuisance, weights = nuisances_of(recording), np.ones(len(recording))
    return fit(recording, effects, nuisance, weights, SOLVER, ridge=[0.01] * len(effects))


def test_effects_confounded_with_a_coupling_that_the_library_lacks_give_way(tmp_path):
    case = with_fault(faultless(rows=80, seed=12), JointCoupling(1.0, 3, 4), gap=2.5)
    recording, _ = recorded(case, tmp_path)
    near = ("coupled_play", "joint_tilt", "gear_ripple", "hysteresis", "payload", "link_flex")
    found = told(recording, only(*ZEROS, "joint_compliance", "backlash", *near).library)
    assert found.unlisted > 0.5
    assert "joint 3's error depends on" in found.words
    assert max(found.probabilities.values()) < 0.95


def test_a_true_cause_stays_given_any_family(tmp_path):
    case = with_fault(faultless(rows=60, seed=5), TransmissionRipple(0.0, 3, once=(1.0, 0.5)))
    recording, _ = recorded(case, tmp_path)
    found = told(recording, COUPLED.library)
    assert found.probabilities["transmission_ripple", 3] > 0.95
    assert found.places["joint", 3] > 0.99
    assert found.unlisted < 0.5


def test_a_drive_that_stiffens_is_a_compliant_drive_and_nothing_unknown(tmp_path):
    drive = JointCompliance(0.0, 2, stiffening=0.6)
    recording, _ = recorded(with_fault(faultless(rows=100, seed=6), drive), tmp_path)
    diagnosis = diagnose(recording, LOADED)
    assert causes(diagnosis) == [("joint_compliance", 2)]
    assert diagnosis.verdict.verdict == Outcome.EXPLAINED
    assert "fall" in {name.split()[-1] for name in diagnosis.verdict.causes[0].parameters}


def test_a_spring_that_is_softest_about_no_load_has_no_play_besides():
    """As of contacts: an odd power of the load below one is a compliance alone."""
    rng, chain = np.random.default_rng(3), Robot.bundled("ur5").chain()
    q = rng.uniform(-1.0, 1.0, (100, 6)) * [2.8, 1.2, 1.5, 2.5, 2.0, 3.0] + [0, -1.3, 0.8, 0, 0, 0]
    load = chain.gravity_torque.map(len(q))(q.T, np.zeros((1, len(q)))).full()[2]
    twist = np.sign(load) * (np.abs(load) / np.abs(load).max()) ** 0.5
    given = q - 1.5e-3 * np.outer(twist, np.eye(6)[2])
    T = chain.placement(given)
    tip = T[:, :3, 3] + T[:, :3, :3] @ TOOL + rng.normal(0.0, 5e-5, (len(q), 3))
    found = told(build_recording(
        observation="tip_position", robot="ur5", q=q, measured=tip, tool_offset=TOOL,
        noise_std=5e-5), LOADED.library)  # fmt: skip
    assert found.named == {("joint_compliance", 3)}
    assert found.unlisted < 0.5


def test_play_is_seated_by_friction_over_a_tenth_of_the_load_at_most_and_is_a_spring_beyond():
    scope = scope_of(bench("ur5", "tip_position"))
    most = max(map(abs, scope.span["load2"]))
    variants = [REGISTRY["backlash"](joint=2, by="load")]
    for _ in range(4):
        variants += [n for v in variants for n in v.neighbours(scope)]
    assert max(v.seat for v in variants) == pytest.approx(0.09 * most)
    wound = [v.windup for v in REGISTRY["joint_compliance"](joint=2).neighbours(scope)]
    assert max(wound) == pytest.approx(0.27 * most)
    assert min(filter(None, wound)) == pytest.approx(0.03 * most)


def test_a_needle_that_leans_still_sags(tmp_path):
    case = faultless(rows=100, seed=9)
    axis = case.scene.tool[0] / np.linalg.norm(case.scene.tool[0])
    aside = np.cross(axis, [0.3, -0.5, 0.8])
    leaning = axis + 0.08 * aside / np.linalg.norm(aside)
    needle = NeedleSag(0.0, tuple(leaning / np.linalg.norm(leaning)))
    found = told(recorded(with_fault(case, needle), tmp_path)[0], NEEDLES.library)
    assert found.named == {("needle_sag", None)}
    assert found.unlisted < 0.5


@pytest.mark.parametrize("along", [0, 2])
def test_a_needle_on_a_bracket_sags_along_an_axis_of_the_tip_frame(tmp_path, along):
    needle = NeedleSag(0.0, tuple(np.eye(3)[along].tolist()))
    recording, _ = recorded(with_fault(faultless(rows=100, seed=9), needle), tmp_path)
    found = told(recording, NEEDLES.library)
    assert found.named == {("needle_sag", None)}
    assert found.unlisted < 0.5


def test_a_joint_that_two_others_drag_tells_them_apart(tmp_path):
    """One cause with a gain for each: its sentence and its values name both."""
    faults = (JointCoupling(0.0, 3, 4), JointCoupling(0.0, 3, 5))
    recording, _ = recorded(with_fault(faultless(rows=100, seed=9), *faults), tmp_path)
    (cause,) = diagnose(recording, DRAGGED).causes
    assert set(cause.parameters) == {"gain, by 4", "gain, by 5"}
    assert {f"joint 3 is dragged along by joint {k}" for k in (4, 5)} == set(
        cause.words.split("; ")
    )


def test_a_breath_that_dwells_is_a_breath(tmp_path):
    case = faultless(rows=90, seed=10)
    breath = Respiration(0.0, (0.6, 0.0, 0.8), 4.2, 0.7, 3)
    recording, _ = recorded(with_fault(case, breath, gap=12.0), tmp_path)
    diagnosis = diagnose(recording, BREATHS)
    assert causes(diagnosis) == [("respiration", None)]
    assert len(diagnosis.effects) == 1  # not two breaths, one twice as fast
    assert diagnosis.verdict.noise.ratio < 1.2


def breathing(between, rows=200):
    """An arm over an hour whose target breathes, between two frequencies that are tried [step]."""
    rng = np.random.default_rng(0)
    robot, tool = Robot.bundled("ur5"), np.array([0.02, 0.05, 0.1])
    q = rng.uniform(-2.5, 2.5, (rows, 6))
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(6.0, 14.0, rows - 1))])
    tried = np.linspace(SLOWEST, FASTEST, int(TURNS * np.ptp(time)) + 1)
    turns = 2.0 * np.pi * (tried[1030] + between * (tried[1] - tried[0])) * time + 1.92
    breath = 1.6e-4 * np.cos(turns)[:, None] * np.array([0.76, -0.47, -0.45])
    return build_recording(
        observation="tip_position",
        robot=robot,
        q=q,
        measured=robot.chain("flange").tips(q, tool) + breath + rng.normal(0.0, 3e-5, (rows, 3)),
        tool_offset=tool,
        time=time,
        noise_std=3e-5,
    )


def test_a_breath_between_frequencies_that_are_tried_is_a_breath():
    """What a quarter of a step leaves of it had been nearly a breath, of no listed effect."""
    found = told(breathing(0.4), BREATHS.library)
    assert found.named == {("respiration", None)}
    assert found.probabilities["respiration", None] > 0.99


def test_wherever_in_its_play_the_first_row_rests_it_is_play():
    """One row in the middle of it had made an unlisted dependence on the way of it."""
    rests = 0.5
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.uniform(-0.4, 0.4, (110, 6)), axis=0) / 2.0
    direction = np.sign(np.diff(q, axis=0, prepend=q[:1] - 1e-3 * rng.choice([-1.0, 1.0], 6)))
    lag = 6e-4 * lag_of_play(q[:, 2], 6e-4, rests)
    recording = build_recording(
        observation="joint_position",
        robot=Robot.bundled("ur5"),
        q=q,
        measured=q + lag[:, None] * np.eye(6)[2] + rng.normal(0.0, 6e-5, q.shape),
        direction=direction,
        noise_std=6e-5,
    )
    found = told(recording, PLAY.library)
    [(effect, joint)] = found.named
    assert joint == 3
    assert effect in {"hysteresis", "backlash"}
    assert found.unlisted < 0.1


def test_a_heavy_payload_on_soft_drives_is_a_payload(tmp_path):
    payload = Payload(0.0, (9e3,) * 6)
    recording, _ = recorded(with_fault(faultless(rows=80, seed=13), payload), tmp_path)
    assert told(recording, LOADED.library).named == {("payload", None)}


def test_noise_that_differs_from_axis_to_axis_is_nothing_unknown():
    quiet = bench("ur5", "joint_position")
    rng = np.random.default_rng(3)
    sigma = 1e-4 * np.array([0.4, 0.4, 1.8, 0.6, 0.5, 0.7])
    noisy = quiet.measured + rng.normal(0.0, sigma, quiet.measured.shape)
    recording = replace(quiet, measured=noisy, noise_std=float(np.sqrt(np.mean(sigma**2))))
    assert told(recording, [JointScale]).unlisted < 0.5


def test_zeros_of_second_encoders_are_offsets_unless_the_recording_says_otherwise(tmp_path):
    case = faultless(rows=70, seed=15, observation="joint_position")
    recording, _ = recorded(with_fault(case, JointOffset(0.0, 4)), tmp_path)
    answer = diagnose(recording, FEW_EFFECTS)
    assert causes(answer) == [("joint_offset", 4)]
    assert any("or its mounting's" in note for note in answer.verdict.notes)
    mounted = replace(recording, always=("joint_offset",))
    assert diagnose(mounted, FEW_EFFECTS).verdict.verdict == Outcome.NO_GAP


@pytest.mark.parametrize("lever", [0.1, 0.9])
def test_the_noise_of_rotations_is_told_by_the_fit(lever):
    """Position noise of 0.1 mm and rotation noise of 0.1 mm over the lever."""
    recording = bench("ur5", "pose")
    rng = np.random.default_rng(1)
    y = recording.measured + 0.0
    y[:, :3] += rng.normal(0.0, 1e-4, (len(y), 3))
    half = rng.normal(0.0, 0.5e-4 / lever, (len(y), 3))
    w, v = y[:, 3:4].copy(), y[:, 4:].copy()
    y[:, 3:4] = w - (v * half).sum(axis=1, keepdims=True)
    y[:, 4:] = v + w * half + np.cross(v, half)
    y[:, 3:] /= np.linalg.norm(y[:, 3:], axis=1, keepdims=True)
    noisy = replace(recording, measured=y)
    _, best = fitted(noisy)
    assert noise_lever(best, noisy) == pytest.approx(lever, rel=0.25)


@pytest.mark.parametrize("observation", ["tip_position", "joint_position", "fixed_point"])
def test_ports_are_what_a_small_move_changes(observation):
    """Joint ports against central differences of the residual."""
    recording = bench("ur5", observation)
    model, best = fitted(recording)
    ports = Ports.about(model, best.x, np.arange(len(recording)))
    offset = REGISTRY["joint_offset"]
    for joint in (1, 3, 6):
        wide = build_model(recording, [offset(joint=joint)], nuisance=model.nuisance)
        moved = [Mapped(wide.problem).residuals(np.append(best.x, h)) for h in (-1e-5, 1e-5)]
        slope = (moved[1] - moved[0]) / 2e-5
        np.testing.assert_allclose(ports.joint[joint - 1], slope, atol=1e-7)


@pytest.mark.parametrize("observation", ["tip_position", "pose", "joint_position"])
def test_every_dependence_has_columns_words_and_one_share_a_question(observation):
    recording = bench("ur5", observation)
    model, best = fitted(recording)
    ports = Ports.about(model, best.x, np.arange(len(recording)))
    found = list(dependences(recording, ports))
    shares: dict[tuple[str, str, int | None], float] = {}
    for f in found:
        of = (f.on, f.stage, f.element)
        shares[of] = shares.get(of, 0.0) + np.exp(f.log_prior)
        assert f.words
        assert f.columns.shape[1:] == ports.target.shape
        assert np.isfinite(f.columns).all()
    for share in shares.values():
        assert share == pytest.approx(round(share))
        assert share > 0.5


def seen_by(gain, seed):
    """Tips (90, 3) by a device whose scale is off by a gain of the tips' place, at three sigma."""
    rng, chain = np.random.default_rng(seed), Robot.bundled("ur5").chain()
    q = readings(chain, 90, seed)
    tips = measured(chain, q, "tip_position")
    wrong = gain(tips)[:, None] * tips
    sigma = float(np.sqrt(np.mean(wrong**2))) / 3.0
    given = {"observation": "tip_position", "robot": "ur5", "q": q, "tool_offset": TOOL}
    tips = tips + wrong + rng.normal(0.0, sigma, tips.shape)
    return build_recording(**given, measured=tips, noise_std=sigma)


def test_a_scale_that_is_not_listed_is_no_distortion():
    """A growth of nothing beside a level of its own had been one, more than 95 % sure."""
    recording = seen_by(lambda tips: np.full(len(tips), 2e-4), 0)
    options = SEEN
    assert causes(diagnose(recording, options)) == [("sensor_scale", None)]
    found = told(recording, replace(options, without=("sensor_scale",)).effects)
    assert found.named == frozenset()
    assert found.unlisted > 0.5


def test_a_distortion_about_a_working_depth_is_one_cause():
    seed = 2

    def grows(tips):
        low, high = tips[:, 2].min(), tips[:, 2].max()
        return 5e-4 * (tips[:, 2] - low - (0.3 + 0.2 * seed) * (high - low))

    found = told(seen_by(grows, seed), SEEN.library)
    assert found.named == {("sensor_distortion", None)}
    assert found.probabilities["sensor_distortion", None] > 0.95


def test_play_that_only_a_velocity_tells_may_be_dry_friction():
    """Rows on the way but too far apart for friction, of which dry friction is one and the same."""
    q = bench("ur5", "tip_position").q
    velocity = np.random.default_rng(8).normal(0.0, 0.3, q.shape)
    behind = q.copy()
    behind[:, 2] -= 5e-4 * np.sign(velocity[:, 2])
    robot = Robot.bundled("ur5")
    tips = robot.chain().tips(behind, TOOL)
    noise = np.random.default_rng(9).normal(0.0, 1e-4, tips.shape)
    given = {"robot": robot, "q": q, "tool_offset": TOOL, "noise_std": 1e-4}
    recording = build_recording(
        observation="tip_position", measured=tips + noise, velocity=velocity, **given
    )
    [cause] = diagnose(recording, PLAY).causes
    assert (cause.effect, cause.element) == ("backlash", 3)
    assert ("friction", 3) in {(b.effect, b.element) for b in cause.confounded_with}


def test_teeth_that_are_no_sine_are_a_ripple_with_its_overtone():
    """A quarter of it at twice the order had been of no listed effect."""
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.5, 1.5, (120, 6))
    behind = q.copy()
    behind[:, 2] += 6e-4 * (np.sin(24 * q[:, 2]) + 0.25 * np.sin(48 * q[:, 2] + 1.0))
    robot = Robot.bundled("ur5")
    tips = robot.chain().tips(behind, TOOL) + rng.normal(0.0, 1e-4, (120, 3))
    given = {"robot": robot, "q": q, "tool_offset": TOOL, "noise_std": 1e-4}
    recording = build_recording(observation="tip_position", measured=tips, **given)
    answer = diagnose(recording, TEETH)
    assert causes(answer) == [("gear_ripple", 3)]
    assert answer.causes[0].variant == "orders 24 and 48"
    assert answer.outside_probability < 0.05
