"""Motions, from a file to a verdict: what a drive does is found, told and foretold."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal

from plumbline import Verdict, diagnose, load
from plumbline.errors import PlumblineError
from plumbline.experiments.reality.drives import Wrong, follow
from plumbline.experiments.report.diagnosis.motion import transfer_of
from plumbline.kinematics.effects import MOTION_EFFECTS, MotionEffect
from plumbline.kinematics.effects.acceleration_limit import AccelerationLimit
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.constants import STILL
from plumbline.optim.diagnosis.findings import NoiseLevel, Outcome
from plumbline.optim.diagnosis.motion import diagnose as motion_module
from plumbline.optim.diagnosis.motion.constants import WIDE
from plumbline.optim.diagnosis.motion.fit import (
    JointFit,
    correlation_time,
    evaluated,
    fitted,
    square_time,
    to_go,
)
from plumbline.optim.diagnosis.motion.models import Models
from plumbline.optim.diagnosis.motion.recording import (
    build_motion,
    load_motion,
)
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.search import _weights, _with_parts, errors_of
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.diagnosis.motion.units import sizes_of, slides
from plumbline.optim.diagnosis.motion.unlisted import FunctionRivals, UnlistedFunction, own_past
from plumbline.optim.diagnosis.motion.verdict import _outside_of
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.loading import load_recording
from tests.answer_contract import contradicts_nothing, keeps_the_contract
from tests.motions import FINE, arm, multisine, recorded, servo

LAWS = tuple(Law)
DH = """
[[robot.dh]]
d = 0.3
alpha = 1.5707963
[[robot.dh]]
a = 0.4
"""


@pytest.fixture(scope="module")
def found():
    """A delay, a lag and play at joint 1; nothing at joint 2."""
    return diagnose(recorded([{"delay": 0.03, "lag": 0.05, "play": 0.01}, {}], seconds=20))


def windows_of(law, joint=1, rows=400):
    """Windows of a joint under a law, its commands in that law's unit."""
    size = 0.1 if law == Law.HELD_SERVO else 0.5  # whose steps are within its dead band
    t, u = multisine(rows * 0.02, size=size, fastest=0.5)
    gains = {"kp": 20.0, "kd": 1.5} if law.known else {}
    kind = "position" if law.known else str(law)
    q = np.cumsum(0.02 * u, axis=0) if law in (Law.VELOCITY, Law.RATE) else u
    recording = build_motion(robot=arm(), time=t, command=u, q=0.9 * q, kind=kind, **gains)
    signals = signals_of(replace(recording, law=law))
    return signals.windows(joint, signals.starts), signals.seen(joint)


def forms(law):
    return [e for c in MOTION_EFFECTS for e in c.candidates(law, masses=True)]


@pytest.mark.parametrize("law", LAWS)
def test_a_null_effect_changes_nothing(law):
    windows, _ = windows_of(law)
    ideal, _ = roll_out(windows, (), np.empty(0))
    for effect in forms(law):
        null = np.array([effect.parameter.null])
        np.testing.assert_allclose(roll_out(windows, (effect,), null)[0], ideal, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_every_parameter_matters_and_its_derivative_is_that_of_finite_differences(law):
    windows, seen = windows_of(law)
    for effect in forms(law):
        value = np.array([0.6 * effect.starts(seen)[0]])
        step = WIDE * value[0] if effect.plans else 1e-7 * max(abs(value[0]), 0.1)
        _, J = roll_out(windows, (effect,), value)
        ahead, behind = (roll_out(windows, (effect,), value + s)[0] for s in (step, -step))
        slope = (ahead - behind) / (2 * step)
        assert np.abs(slope).max() > 1e-9, effect
        wrong = np.abs(slope - J[..., 0]) > 1e-4 * np.abs(slope).max()
        assert wrong.mean() < 0.03, effect  # but where a corner lies within the step


def test_ideal_tracking_is_the_command_itself():
    windows, _ = windows_of(Law.POSITION)
    np.testing.assert_array_equal(
        roll_out(windows, (), np.empty(0))[0], windows.command[windows.samples]
    )


def test_what_is_wrong_is_named_at_its_joint_with_its_size(found):
    causes = {(c.effect, c.element): c for c in found.verdict.causes}
    assert set(causes) == {(e, 1) for e in ("actuation_delay", "actuation_lag", "actuation_play")}
    truth = {"actuation_delay": 0.03, "actuation_lag": 0.05, "actuation_play": 0.01}
    for (name, _), cause in causes.items():
        (estimate,) = cause.parameters.values()
        # Small steps hold a command, and lead by half of one.
        leads = 0.5 * 0.02 / FINE if name == "actuation_delay" else 0.0
        assert abs(estimate.value + leads - truth[name]) < 4 * estimate.std, name
        assert cause.stage == "actuation"
        assert cause.probability > 0.9
        assert cause.before > cause.after


def test_what_is_stored_of_a_drive_is_in_the_library_s_order(found):
    """Not in that of a set's hashes, which differ from run to run."""
    names = list(dict.fromkeys(effect.name for effect in MOTION_EFFECTS))
    for joint in found.joints:
        assert list(joint.probability) == [name for name in names if name in joint.probability]


def test_the_verdict_is_that_of_any_recording(found, tmp_path):
    verdict = found.verdict
    assert verdict.verdict == Outcome.EXPLAINED
    assert verdict.gap.after < 1.1 * verdict.noise.sigma
    assert verdict.gap.held_out_by == "time"
    assert verdict.outside_probability < 0.2
    assert sum(place.share for place in verdict.where) == pytest.approx(1.0)
    assert verdict.judged.converged
    assert json.loads(json.dumps(found.to_dict()))["joints"][0]["element"] == 1
    verdict.save(tmp_path / "verdict.json")
    assert load(tmp_path / "verdict.json") == Verdict.load(tmp_path / "verdict.json") == verdict
    assert "actuation_play of drive 1" in found.card()


def test_an_answer_keeps_the_contract_and_comes_back_with_its_drives(found, tmp_path):
    keeps_the_contract(found, tmp_path)
    again = load(tmp_path / "answer.json")
    assert again.options == found.options
    np.testing.assert_array_equal(again.recording.q, found.recording.q)
    for number, fit in found.fits.items():
        assert again.fits[number].effects == fit.effects
        np.testing.assert_allclose(again.fits[number].residual, fit.residual, atol=1e-12)
    other = recorded([{"delay": 0.03}, {}], seed=6, seconds=10)
    np.testing.assert_allclose(again.transfer(other), found.transfer(other), rtol=1e-9)


def test_its_pictures_have_names(found):
    assert found.pictures == ("traces", "bode", "where", "staircase", "ranking")
    assert found.plot("traces").key == "traces"
    with pytest.raises(PlumblineError, match="not one of a MotionDiagnosis"):
        found.plot("joints")


def test_measured_gain_and_phase_are_those_of_the_drive_with_its_causes(found):
    upper, lower = found.plot("bode").figures[0].axes
    for axes, close in ((upper, 0.01), (lower, 1.0)):
        _, measured, model = (line.get_ydata() for line in axes.lines)
        assert len(measured) > 4
        assert np.abs(measured - model).max() < close


def test_a_delay_turns_the_phase_by_its_time_and_leaves_the_gain():
    u = np.random.default_rng(0).normal(size=6000)
    frequency, transfer, told = transfer_of(u[3:], u[:-3], 0.02)
    frequency, transfer = frequency[told], transfer[told]
    low = frequency < 5.0
    assert low.sum() > 20
    turned = np.degrees(np.unwrap(np.angle(transfer)))
    np.testing.assert_allclose(turned[low], -360 * 0.06 * frequency[low], atol=3.0)
    np.testing.assert_allclose(np.abs(transfer[low]), 1.0, atol=0.05)


def adds_up(tree):
    for place in tree:
        branches = place["dependences"]
        assert sum(b["probability"] for b in branches) == pytest.approx(place["probability"])
        for branch in branches:
            leaves = [m["probability"] for m in branch["mechanisms"]]
            assert sum(leaves) == pytest.approx(branch["probability"])


def test_the_tree_goes_from_drive_to_dependence_to_mechanism_and_adds_up(found):
    tree = found.verdict.tree
    adds_up(tree)
    (first, *_) = tree
    assert (first["stage"], first["element"]) == ("actuation", 1)
    assert first["probability"] > 0.99
    leaves = {m["effect"]: b["on"] for b in first["dependences"] for m in b["mechanisms"]}
    assert leaves["actuation_delay"] == leaves["actuation_lag"] == "time"
    assert leaves["actuation_play"] == "direction"


def test_what_nobody_has_listed_is_in_the_tree_without_a_name(monkeypatch):
    priors, own = [], motion_module.search
    monkeypatch.setattr(motion_module, "search", lambda *a: priors.append(a[1]) or own(*a))
    recording = recorded([{}, {}], seed=3, seconds=20)
    odd = np.array(recording.q)
    odd[:, 0] += 0.003 * np.sin(9.0 * odd[:, 0])  # a wave over its own angle
    changed = build_motion(
        robot=arm(), time=recording.time, command=recording.command, q=odd, noise_std=2e-4
    )
    verdict = diagnose(changed, DiagnosisOptions(unlisted=0.1)).verdict
    adds_up(verdict.tree)
    assert verdict.unlisted_prior == 0.1
    assert priors == pytest.approx([1 - 0.9**0.5] * 2)  # of two joints alike
    first = verdict.tree[0]
    assert first["element"] == 1
    assert first["dependences"][0]["on"] in ("own angle", "command")
    assert None in [m["effect"] for m in first["dependences"][0]["mechanisms"]]


@pytest.mark.parametrize(
    "drag", [lambda q, v: 0.03 * q, lambda q, v: 0.01 * v, lambda q, v: 0.05 * q**2]
)
def test_a_joint_that_another_one_drags_goes_by_that_one_s_motion(drag):
    """Loads go by the other's angle, too: without such a rival this was a servo that gives way."""
    recording = recorded([{"delay": 0.03}, {}], seed=3, seconds=8)
    dragged = np.array(recording.q)
    q = dragged[:, 0] - dragged[:, 0].mean()
    dragged[:, 1] += drag(q, np.gradient(recording.command[:, 0], recording.time))
    changed = build_motion(
        robot=arm(), time=recording.time, command=recording.command, q=dragged, noise_std=2e-4
    )
    verdict = diagnose(changed).verdict
    assert verdict.outside_depends_on == "another joint's motion of joint 2"
    assert [c.effect for c in verdict.causes if c.element == 1] == ["actuation_delay"]
    sure = [c for c in verdict.causes if c.element == 2 and c.probability > 0.9]
    assert {c.effect for c in sure} <= {"actuation_offset"}


def test_a_model_holds_on_another_motion(found):
    other = recorded([{"delay": 0.03, "lag": 0.05, "play": 0.01}, {}], seed=5, seconds=10)
    before, after = found.transfer(other)
    assert before[0] > 0.03
    assert after[0] < 3e-4


def test_nothing_wrong_is_no_gap():
    verdict = diagnose(recorded([{}, {}], seed=3)).verdict
    assert verdict.verdict == Outcome.NO_GAP
    assert verdict.causes == ()


def test_readings_between_which_the_even_clock_falls_have_less_noise():
    """Stamps that jitter by a third of a step: what is left is set beside the noise of averages."""
    t = np.arange(1000) * 0.02
    rng = np.random.default_rng(5)
    stamps = t + rng.uniform(-6e-3, 6e-3, len(t))
    u = np.sin(2.0 * stamps)[:, None] * [1.0, 0.5]
    q = u + rng.normal(0.0, 1e-3, u.shape)
    verdict = diagnose(
        build_motion(robot=arm(), time=stamps, command=u, q=q, noise_std=1e-3)
    ).verdict
    assert verdict.verdict == Outcome.NO_GAP
    assert verdict.noise.sigma < 0.95e-3
    assert verdict.gap.after == pytest.approx(verdict.noise.sigma, rel=0.05)


def test_rows_that_a_log_has_lost_are_no_mechanism():
    r = recorded([{"delay": 0.04}, {"play": 0.01}], seconds=20.0, noise=3e-4, seed=7001)
    kept = np.random.default_rng(7).random(len(r)) > 0.1
    less = build_motion(
        robot=arm(), time=r.time[kept], command=r.command[kept], q=r.q[kept], noise_std=3e-4
    )
    d = diagnose(less)
    assert d.verdict.outside_probability < 0.05
    assert (d.verdict.causes[0].effect, d.verdict.causes[0].element) == ("actuation_delay", 1)
    assert {c.element for c in d.causes[1:]} == {2}


def test_without_a_known_noise_nothing_is_explained():
    recording = recorded([{"delay": 0.03}, {}], seed=3, seconds=8)
    unknown = build_motion(
        robot=arm(), time=recording.time, command=recording.command, q=recording.q
    )
    verdict = diagnose(unknown).verdict
    assert verdict.verdict == Outcome.PARTLY
    assert [(c.effect, c.element) for c in verdict.causes] == [("actuation_delay", 1)]
    assert verdict.to_dict()["gap"]["noise_floor"] is None


def test_a_motion_that_a_simulator_wrote_without_noise_lacks_nothing():
    """What is left is rounded digits: beside a late joint 1 nothing is unlisted."""
    verdict = diagnose(
        recorded([{"delay": 0.03}, {}], seed=3, seconds=20, noise=0.0, state=False)
    ).verdict
    assert [(c.effect, c.element) for c in verdict.causes] == [("actuation_delay", 1)]
    assert verdict.verdict == Outcome.PARTLY  # since no noise is stated
    assert verdict.outside_probability < 0.2


def test_a_noise_of_a_motion_that_is_stated_too_large_is_said_to_be():
    recording = recorded([{"delay": 0.03}, {}], seed=3, seconds=20)
    assert "noise smaller" not in " ".join(diagnose(recording).verdict.notes)
    coarse = diagnose(replace(recording, noise_std=2e-3)).verdict
    assert "a reading is left, 0.095 times noise_std, which hides" in " ".join(coarse.notes)


def test_a_limit_that_one_window_reached_is_named_and_what_was_left_out_said_as_it_is():
    """No other window tells of it: what earns its probability is neither outside nor no gap."""
    t, u = multisine(60.0, size=0.2, fastest=0.3)
    u[:, 0] += np.where((t > 31.0) & (t < 33.0), 0.5 * np.sin(2 * np.pi * (t - 31.0)), 0.0)
    rng = np.random.default_rng(1)
    way = follow(t, u[:, 0], 0 * t, Wrong(steepest=6.0), rng)
    q = np.column_stack([way, u[:, 1]]) + rng.normal(0.0, 0.15, u.shape)
    verdict = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=0.15)).verdict
    assert [(c.effect, c.element) for c in verdict.causes] == [("acceleration_limit", 1)]
    assert verdict.causes[0].probability > 0.9
    assert verdict.gap.shrink_ci95[0] < 0.0
    assert verdict.verdict == Outcome.PARTLY
    assert "rows that were left out do not show" in verdict.meaning
    contradicts_nothing(verdict)


def test_an_effect_that_is_left_out_is_not_named():
    options = DiagnosisOptions(without=["actuation_play"])
    verdict = diagnose(recorded([{"play": 0.01}, {}], seed=2, seconds=10), options).verdict
    assert "actuation_play" not in {c.effect for c in verdict.candidates}


def test_a_speed_that_is_never_exceeded_is_a_velocity_limit():
    verdict = diagnose(recorded([{"limit": 0.6, "lag": 0.03}, {}], seed=4, seconds=5)).verdict
    causes = {(c.effect, c.element): c for c in verdict.causes}
    assert causes["velocity_limit", 1].parameters["fastest"].value == pytest.approx(0.6, rel=0.02)


def test_commands_that_are_limited_before_a_lag_are_no_slower_servo():
    t, u = multisine(20.0)
    told = servo(t, u[:, 0], limit=0.5)
    q = np.column_stack([servo(t, told, lag=0.05), u[:, 1]])
    q += np.random.default_rng(0).normal(0.0, 2e-3, q.shape)
    answer = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=2e-3))
    found = {c.effect: [p.value for p in c.parameters.values()] for c in answer.causes}
    assert found.keys() == {"velocity_limit", "actuation_lag"}
    assert found["velocity_limit"] == pytest.approx([0.5], rel=0.01)
    assert found["actuation_lag"] == pytest.approx([0.05], rel=0.03)
    assert answer.verdict.verdict == Outcome.EXPLAINED
    assert "of what the drive is told" in {c.variant for c in answer.causes}


def test_a_planned_fit_at_its_least_is_converged_and_one_moved_off_is_not():
    t, u = multisine(30.0, fastest=2.0)
    rng = np.random.default_rng(0)
    q = follow(t, u[:, 0], 0 * t, Wrong(delay=0.02, steepest=4.0), rng)[:, None]
    q = np.hstack([q, u[:, 1:]]) + rng.normal(0.0, 5e-4, u.shape)
    signals = signals_of(build_motion(robot=arm(), time=t, command=u, q=q))
    windows, effects = signals.windows(0, signals.starts), (ActuationDelay(), AccelerationLimit())
    starts = [np.array([0.02, 4.0]) * share for share in (0.98, 0.99, 1.0, 1.01, 1.02)]
    fit = min((fitted(windows, effects, s) for s in starts), key=lambda fit: fit.square)
    effective = fit.residual.size / correlation_time(fit.residual)
    assert to_go(windows, fit, effective) <= STILL
    for off in (0.03, -0.03):
        moved = evaluated(windows, effects, fit.theta * [1.0, 1.0 + off])
        assert to_go(windows, moved, effective) > STILL


def test_a_planned_way_s_derivatives_are_worked_out_where_a_step_is_taken_alone(monkeypatch):
    windows, _ = windows_of(Law.POSITION)
    effects, found = (ActuationDelay(), AccelerationLimit()), []

    def watched(*given, slopes=True, rough=False):
        fit = evaluated(*given, slopes=slopes, rough=rough)
        found.append((slopes, fit.square, fit.J.shape[2]))
        return fit

    monkeypatch.setattr("plumbline.optim.diagnosis.motion.fit.evaluated", watched)
    fitted(windows, effects, np.array([0.02, 4.0]))
    tried = [square for slopes, square, _ in found if not slopes]
    taken = [square for slopes, square, _ in found if slopes]
    assert {(slopes, count) for slopes, _, count in found} == {(True, 2), (False, 0)}
    assert len(taken) == 1 + len(set(taken) & set(tried))
    assert taken == sorted(taken, reverse=True)


def test_a_servo_that_plans_its_way_has_an_acceleration_limit_however_it_began():
    """It began at rest where its command moved; of two joints one plans, and the other lags."""
    t, u = multisine(24.0)
    rng = np.random.default_rng(0)
    wrong = Wrong(steepest=0.6), Wrong(lag=0.05)
    q = np.column_stack([follow(t, u[:, j], 0 * t, w, rng) for j, w in enumerate(wrong)])
    noise = float(np.std(q[:, 0] - u[:, 0])) / 60
    q += rng.normal(0.0, noise, q.shape)
    answer = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=noise))
    causes = {(c.effect, c.element): c for c in answer.causes}
    assert causes.keys() == {("acceleration_limit", 1), ("actuation_lag", 2)}
    found = causes["acceleration_limit", 1]
    assert found.probability > 0.95
    assert found.parameters["steepest"].value == pytest.approx(0.6, rel=0.01)
    assert answer.verdict.gap.after < 1.15 * noise
    assert answer.verdict.judged.converged


@pytest.mark.parametrize(("name", "share"), [("acceleration_limit", 0.005), ("actuation_lag", 0.0)])
def test_what_a_planned_way_s_steps_leave_is_no_mechanism(name, share):
    windows, seen = windows_of(Law.POSITION)
    effects = tuple(e for e in forms(Law.POSITION) if e.name == name)
    models = Models(windows, effects, seen)
    ideal = np.sqrt(models.found[frozenset()].square)
    floor = models.floor(evaluated(windows, effects, np.array([1.0])), 1e-4)
    assert floor == pytest.approx(np.hypot(1e-4, share * ideal))


def test_a_faster_clock_makes_no_more_evidence():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(40, 200))
    assert correlation_time(white) == pytest.approx(1.0, abs=0.2)
    assert correlation_time(np.repeat(white, 5, axis=1)) == pytest.approx(5.0, rel=0.2)


def test_what_repeats_itself_makes_no_less_evidence():
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(40, 200)) + 0.5 * rng.normal(size=(40, 1))
    wave = np.sin(2 * np.pi * (np.arange(200) / 80 + rng.random((40, 1))))
    assert correlation_time(flat + 0.5 * wave) < 0.75 * correlation_time(flat)


def test_more_than_a_stated_noise_is_something_unlisted_and_a_cause_may_be_a_part_of_it():
    """By the odds of its variance against what an explained gap may leave, 1.15 of the noise."""
    windows, seen = windows_of(Law.POSITION)
    models = Models(windows, (), seen)
    none: frozenset[MotionEffect] = frozenset()
    left = np.sqrt(models.found[none].square)
    lack = models.lacking(none, 2.0, left / 1.15 / 1.2)
    count = models.found[none].residual.size / 2.0
    assert lack.gain == pytest.approx(count / 2 * (1.44 - 1 - np.log(1.44)))
    assert lack.share == pytest.approx(1 - 1 / 1.44)
    for sigma in (None, 1.1 * left):
        assert models.lacking(none, 2.0, sigma).gain == 0.0
    beside = dict(_with_parts({"small": 1.0, "large": 4.0}, 1.0, "time", 0.0))
    whole, rest = ({"small", "large", "?time"}, {"large", "?time"})
    assert {n: np.exp(w) for n, w in beside.items()} == pytest.approx(
        {frozenset(whole): 0.6, frozenset(rest): 0.4}
    )
    assert _with_parts({"large": 4.0}, 1.0, "time", 0.5) == [(frozenset({"large", "?time"}), 0.5)]


def test_what_is_within_the_stated_noise_is_no_mechanism_whatever_its_form():
    """A gain is a function of the command; so are, where a joint rests, an encoder's steps."""
    windows, _ = windows_of(Law.POSITION)
    fit = evaluated(windows, (), np.empty(0))
    for stated, told in ((0.0, True), (0.5, True), (1.0, False), (2.0, False)):
        shares = {
            u.on: u.share
            for u in FunctionRivals(windows, fit, 100.0, 0.0, stated * fit.square).conditional()
        }
        assert shares["command"] == pytest.approx(1 - max(stated, 1e-3) if told else 0.0, abs=1e-2)


@pytest.mark.parametrize("wear", [0.0, 0.5])
def test_what_one_motion_says_of_a_cause_holds_on_another_within_its_error(wear):
    """Play that is wider elsewhere has wider errors; of any other, they are near the noise's."""
    effects = (ActuationDelay(), ActuationPlay())
    said = []
    for middle in (-0.3, 0.3):
        t, u = multisine(60.0)
        u = 0.7 * u + middle
        q = np.column_stack([servo(t, x, delay=0.03, play=0.01, wear=wear) for x in u.T])
        q += np.random.default_rng(3).normal(0.0, 1e-3, q.shape)
        signals = signals_of(build_motion(robot=arm(), time=t, command=u, q=q))
        windows = signals.windows(0, signals.starts)
        fit = fitted(windows, effects, np.array([0.02, 0.008]))
        errors = errors_of(Models(windows, effects, signals.seen(0)), fit, 0.05, 1e-3)
        own = fit.covariance(fit.residual.size / correlation_time(fit.residual))
        said.append((fit.theta[1], errors[1], own[1, 1] ** 0.5))
    (one, error, of_noise), (two, other, of_noise_too) = said
    apart = abs(one - two)
    assert apart < 2 * np.hypot(error, other)
    if wear:
        assert apart > 10 * np.hypot(of_noise, of_noise_too)
    else:
        assert error < 2 * of_noise


@pytest.mark.parametrize("told", [0.0, 1e3])
def test_a_parameter_that_rows_do_not_tell_is_known_as_well_as_beforehand(told):
    """Nothing in the readings goes with it: its prior is left, and no matrix is singular."""
    effects = (ActuationDelay(), ActuationPlay())
    J = np.zeros((4, 50, 2))
    J[:, :, 0] = told * np.sin(np.arange(50))
    r = np.random.default_rng(0).normal(0.0, 1e-3, (4, 50))
    fit = JointFit(effects, np.array([0.02, 0.008]), r, J, np.ones(2))
    std = np.sqrt(np.diag(fit.covariance(200.0)))
    assert std[1] == pytest.approx(fit.scales[1])
    if told:
        assert std[0] == pytest.approx(1e-3 / np.linalg.norm(J[:, :, 0]), rel=0.2)
    else:
        assert std[0] == pytest.approx(fit.scales[0])


def test_what_has_a_memory_is_as_large_as_what_neighbours_share_not_as_what_they_foretell():
    rng = np.random.default_rng(0)
    saw = (np.arange(500) % 40 - 19.5) * 0.05  # of a joint that sticks and slips
    r = rng.normal(size=(40, 500)) + saw
    nothing = np.empty((0,))
    fit = JointFit((), nothing, r, np.empty((40, 500, 0)), nothing)
    found = own_past(SimpleNamespace(dt=0.01), fit, 1.0)
    kept = np.mean(saw[2:] * saw[:-2]) / fit.square
    assert found.share == pytest.approx(kept, abs=0.01)
    assert found.gain > 20.0
    assert own_past(SimpleNamespace(dt=0.01), fit, 1.2).share < 0.0  # all of it is noise


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_a_variance_is_known_as_well_as_it_scatters_under_noise_of_any_memory(memory):
    white = np.random.default_rng(0).normal(size=(200, 20, 600))
    every = scipy.signal.lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white)[:, :, 200:]
    scatter = np.var(np.mean(every**2, axis=(1, 2))) * every[0].size / 2
    times = [square_time(r) for r in every]
    assert np.mean(times) == pytest.approx(scatter, rel=0.25)  # 2.5 standard errors
    assert np.mean(times) == pytest.approx((1 + memory**2) / (1 - memory**2), rel=0.03)


@pytest.mark.parametrize(("slow", "stated", "told"), [(0.5, 1.0, True), (0.5, 1.12, False)])
def test_a_slow_rest_below_white_noise_has_a_memory_where_both_exceed_what_is_stated(
    slow, stated, told
):
    rng = np.random.default_rng(0)
    rest = scipy.signal.lfilter([np.sqrt(1 - 0.99**2)], [1.0, -0.99], rng.normal(size=(10, 900)))
    r = (rng.normal(size=rest.shape) + slow * rest)[:, 400:]
    nothing = np.empty((0,))
    fit = JointFit((), nothing, r, np.empty((*r.shape, 0)), nothing)
    found = own_past(SimpleNamespace(dt=0.01), fit, stated)
    assert (found.gain > 10.0) == told
    assert found.gain < 2.0 or told


@pytest.mark.parametrize(("gain", "hidden"), [(2.9, False), (3.1, True)])
def test_what_a_function_tells_by_chance_alone_hides_no_memory(gain, hidden, monkeypatch):
    t, u = multisine(24.0)
    white = np.random.default_rng(0).normal(size=(2, *u.shape))
    rest = scipy.signal.lfilter([np.sqrt(1 - 0.99**2)], [1.0, -0.99], white[1], axis=0)
    q = u + 2e-3 * (white[0] + 0.6 * rest)
    signals = signals_of(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=2e-3))
    models = Models(signals.windows(0, signals.training), forms(Law.POSITION), signals.seen(0))
    one = UnlistedFunction("angle", gain, 0.06)
    monkeypatch.setattr(FunctionRivals, "conditional", lambda self: (one,))
    weights = _weights(models, frozenset(), models.time, 0.2, signals.sigma)
    names = {name for names, _ in weights for name in names}
    assert "?angle" in names
    assert ("?its own past" in names) != hidden


def test_a_joint_that_sticks_and_slips_is_flagged_and_nothing_else_is_sure():
    t, u = multisine(15.0)
    rng = np.random.default_rng(1)
    q = np.column_stack([follow(t, u[:, 0], 0 * t, Wrong(breakaway=0.02), rng), u[:, 1]])
    q += rng.normal(0.0, 4e-3, q.shape)
    verdict = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=4e-3)).verdict
    assert verdict.outside_probability > 0.95
    alike = ("actuation_play", "actuation_deadband")  # which it resembles, and each the other
    found = {(c.effect, c.element): c.probability for c in verdict.candidates}
    play, band = (found[name, 1] for name in alike)
    assert play == pytest.approx(band, abs=1e-6)  # beside what is unlisted, too
    assert 0.4 < play + band < 0.95


@pytest.mark.parametrize(("share", "told"), [(0.25, False), (0.35, True)])
@pytest.mark.parametrize("source", ["fit", "given"])
def test_without_a_known_noise_what_neighbours_share_is_unlisted(share, told, source):
    white = np.random.default_rng(0).normal(size=(1, 200_000))
    r = scipy.signal.lfilter([1.0], [1.0, -share], white)
    joint = SimpleNamespace(mechanisms={}, outside=0.1, fit=SimpleNamespace(square=1.0, residual=r))
    p, words = _outside_of(joint, NoiseLevel(1.0, source, 1.0))
    if told and source == "fit":
        assert words == "its own past"
        assert p == pytest.approx(1 - 0.3 / 0.35 * 0.5, abs=0.01)
    else:
        assert (p, words) == (0.1, "")


def test_what_is_held_out_is_never_fitted():
    recording = recorded([{"lag": 0.05}, {}], seconds=20)
    held = np.arange(len(recording)) > 600
    q = np.array(recording.q)
    q[held] += 0.05  # another world after the cut
    changed = build_motion(
        robot=arm(), time=recording.time, command=recording.command, q=q, held_out=held
    )
    verdict = diagnose(changed).verdict
    causes = {(c.effect, c.element) for c in verdict.causes}
    assert ("actuation_lag", 1) in causes
    assert "actuation_offset" not in {effect for effect, _ in causes}
    assert verdict.gap.after > 0.04


def test_rows_held_out_all_count_where_their_run_goes_on_and_no_fit_sees_one():
    recording = recorded([{"lag": 0.05}, {}], seconds=40)
    held = (np.arange(len(recording)) > 700) & (np.arange(len(recording)) < 1400)
    signals = signals_of(replace(recording, held_out=held))
    windows, known = (signals.windows(0, signals.starts[signals.folds == k]) for k in (0, -1))
    counted, steps = windows.samples.ravel(), windows.length - windows.settle
    np.testing.assert_array_equal(counted, 701 + np.arange(len(counted)))
    assert len(counted) > held.sum() - steps
    for begin, many in zip(*known.passes[:2], strict=True):
        assert not signals.held[begin : begin + many + 1].any()


@pytest.mark.parametrize(("size", "told"), [(8.0, False), (13.0, True)])
def test_a_single_reading_that_leaps_away_and_back_is_gross_and_a_step_is_none(size, told):
    clean = recorded([{}, {}], seconds=20, dt=0.01, fastest=0.2)
    t, u, q = clean.time, clean.command, clean.q.copy()
    usual = np.abs(q[1:-1] - (q[:-2] + q[2:]) / 2)[:, 0].mean()
    q[700:, 0] += 300 * usual  # which is no leap: it does not come back
    q[400, 0] = (q[399, 0] + q[401, 0]) / 2 + size * usual
    found = build_motion(robot=arm(), time=t, command=u, q=q)
    line = (q[399, 0] + q[401, 0]) / 2
    note = "joint 1 leaps away and back in 1 row, taken for gross errors: 402"
    assert found.notes == (note,) * told
    assert found.q[400, 0] == pytest.approx(line if told else q[400, 0], abs=1e-15)
    np.testing.assert_array_equal(np.delete(found.q, 400, axis=0), np.delete(q, 400, axis=0))


def test_groups_are_left_out_together():
    parts = [recorded([{"lag": 0.05}, {}], seconds=20, seed=k) for k in range(3)]
    joined = build_motion(
        robot=arm(),
        time=np.concatenate([p.time for p in parts]),
        command=np.concatenate([p.command for p in parts]),
        q=np.concatenate([p.q for p in parts]),
        group=np.repeat([0, 1, 2], [len(p) for p in parts]),
    )
    signals = signals_of(joined)
    assert len(np.unique(signals.first)) == 3
    assert signals.held_out_by == "groups"
    assert set(signals.folds) == {0, 1, 2}


def written(folder, settings="", header="time,u1,u2,q1,q2", rows=None):
    """A folder of a motion."""
    t, u = multisine(4.0)
    rows = np.column_stack([t, u, u]) if rows is None else rows
    folder.mkdir(exist_ok=True)
    (folder / "dataset.toml").write_text(f'observation = "motion"\n{settings}{DH}')
    np.savetxt(folder / "samples.csv", rows, delimiter=",", header=header, comments="")
    return folder


def test_a_folder_is_read_as_it_is_written(tmp_path):
    r = load(
        written(tmp_path / "m", '[motion]\ncommand = "position"\nkp = [20.0, 10.0]\nkd = 1.5\n')
    )
    assert (r.law, r.n, len(r)) == (Law.SERVO, 2, 200)
    np.testing.assert_array_equal(r.kp, [20.0, 10.0])
    np.testing.assert_array_equal(r.kd, [1.5, 1.5])


@pytest.mark.parametrize("settings", ["noise_std = 2e-4\n", "[motion]\nnoise_std = 2e-4\n"])
def test_a_noise_is_read_where_that_of_efforts_is_stated_too(tmp_path, settings):
    r = load_motion(written(tmp_path / "m", settings))
    assert r.noise_std == 2e-4
    assert not any("noise_std" in note for note in r.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"settings": '[motion]\ncommand = "pose"\n'}, "dataset.toml, row 3, .*one of position"),
        ({"settings": "[motion]\nkp = [1.0]\n"}, "a number, or 2 of them"),
        ({"header": "time,v1,v2,q1,q2"}, "no such column.*'u1'"),
        ({"header": "t,u1,u2,q1,q2"}, "a column 'time'"),
        ({"rows": np.zeros((200, 5))}, "row 3, column 'time'.*ascending times"),
        ({"rows": np.ones((9, 5))}, "9 rows.*at least 50"),
        (
            {"rows": np.column_stack([np.arange(200.0), 90 * np.ones((200, 4))])},
            "column 'q1'.*positions up to 90.*degrees",
        ),
        (
            {"rows": np.arange(200.0)[:, None] * [1.0, 0.0, 9.0, 0.01, 0.01]},
            "column 'u2'.*positions up to 1791.*degrees",
        ),
        (
            {
                "settings": '[motion]\ncommand = "rate"\n',
                "rows": np.arange(200.0)[:, None] * [1.0, 0.0, 9.0, 0.01, 0.01],
            },
            "column 'u2'.*commands up to 1791, expected at most 1000 rad/s",
        ),
    ],
)
def test_a_fault_is_told_in_one_line_with_its_place(tmp_path, change, words):
    with pytest.raises(PlumblineError, match=words) as told:
        load_motion(written(tmp_path / "m", **change))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(("of_u", "of_q", "column"), [(1.0, 57.3, "q1"), (57.3, 1.0, "u1")])
def test_degrees_beside_radians_are_refused_however_small(of_u, of_q, column):
    t, u = multisine(10.0, 0.02)
    with pytest.raises(
        PlumblineError, match=f"{column}.* 57.3 times .*divide by 57.3 if in degrees"
    ):
        build_motion(robot=arm(), time=t, command=of_u * 0.05 * u, q=of_q * 0.05 * u)
    build_motion(
        robot=arm(), time=t, command=0.05 * u, q=0.05 * u / 20
    )  # a drive that hardly moves


def test_a_motion_is_no_recording_of_rows(tmp_path):
    with pytest.raises(PlumblineError, match="run: plumbline diagnose FOLDER"):
        load_recording(written(tmp_path / "m"))


def test_samples_of_one_motion_are_not_left_out_one_by_one():
    with pytest.raises(PlumblineError, match="samples of one motion foretell each other"):
        diagnose(recorded([{}, {}], seconds=10), DiagnosisOptions(held_out="rows"))


def test_the_fit_of_an_ideal_drive_is_its_residual():
    recording = recorded([{}, {}], seconds=10)
    signals = signals_of(recording)
    windows = signals.windows(0, signals.starts)
    fit = evaluated(windows, (), np.empty(0))
    assert fit.square**0.5 == pytest.approx(2e-4, rel=0.1)


def test_a_radian_of_a_tracked_axis_is_a_decimetre_and_of_a_joint_that_turns_itself():
    axes, turning = ([{"kind": kind}] for kind in ("prismatic", "revolute"))
    given = [slides(Robot.from_dh(rows), (0,)) for rows in (axes, turning)]
    assert sizes_of(given[0]) == pytest.approx([0.1], rel=0.3)
    assert list(sizes_of(given[1])) == [1.0]
