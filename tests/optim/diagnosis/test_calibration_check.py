"""Simulated recordings are what they claim, and stated probabilities are held to account."""

import json
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import expit, logit

from plumbline.experiments.commands.app import run
from plumbline.experiments.reality.joint_effects import JointScale
from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale as Scale
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.calibrate import check
from plumbline.optim.diagnosis.calibrate.check import (
    CalibrationCheck,
    Recalibration,
    SimulatedCase,
    check_calibration,
    histogram,
    ranks,
    threshold,
)
from plumbline.optim.diagnosis.calibrate.simulation import Fault, Setting
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Estimate
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.diagnosis.prior import OFFSET_WIDTH, SLOPE_WIDTH
from plumbline.optim.measurement.nuisance import nuisances_of
from tests.simulated_cases import causes, faultless, recorded, with_fault

KINDS = ("tip_position", "pose", "fixed_point", "joint_position")


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    """One diagnosed recording for every kind of observation."""
    found = {}
    for kind in KINDS:
        case = faultless(rows=40, seed=6, observation=kind)
        recording, _ = recorded(case, tmp_path_factory.mktemp(kind))
        found[kind] = diagnose(recording, DiagnosisOptions(library=(Scale,)))
    return found


def setting_of(diagnosis, library=EFFECTS):
    found = diagnosis.selected
    return Setting(found.model.recording, found, diagnosis.verdict.noise.sigma, library)


def errors_of(setting, seed=0):
    width = {"pose": 6, "joint_position": len(setting.recording.measured_joints)}
    shape = (len(setting.recording), width.get(setting.recording.observation, 3))
    return np.random.default_rng(seed).normal(0.0, setting.sigma, shape)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("faulty", [False, True])
def test_a_simulated_recording_leaves_at_its_fault_the_errors_and_nothing_else(
    settings, kind, faulty
):
    setting = setting_of(settings[kind])
    fault = setting.draw(3.0, np.random.default_rng(1)) if faulty else Fault()
    errors = errors_of(setting)
    simulated = replace(setting, recording=setting.recorded(fault, errors))
    model, x = simulated.model(fault)
    left = Mapped(model.problem).residuals(x)
    assert len(fault.effects) == faulty
    assert left == pytest.approx(errors, abs=2e-3 * setting.sigma)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ratio", [0.5, 3.0])
def test_the_gap_that_frame_and_tool_leave_is_the_one_asked_for(settings, kind, ratio):
    setting = setting_of(settings[kind], (JointCoupling,))
    fault = setting.draw(ratio, np.random.default_rng(2))
    recording = setting.recorded(fault, 0.0 * errors_of(setting))
    _, nominal = fit(
        recording,
        setting.selected.fixed,
        nuisances_of(recording),
        np.ones(len(recording)),
        SOLVER,
    )
    residuals = nominal.mapped.residuals(nominal.x)
    assert np.sqrt(np.mean(residuals**2)) == pytest.approx(ratio * setting.sigma, rel=0.05)


def test_parameters_that_are_drawn_lie_within_their_bounds_and_no_cause_is_drawn_twice(settings):
    setting = setting_of(settings["tip_position"])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        first = setting.draw(1.0, rng)
        second = setting.draw(1.0, rng, first.keys)
        assert not first.keys & second.keys
        for fault in (first, second):
            for effect in fault.effects:
                for p, value in zip(effect.parameters, fault.values, strict=True):
                    assert p.lower <= value <= p.upper


def test_what_cannot_be_so_large_is_not_simulated(settings):
    setting = setting_of(settings["tip_position"], (JointCoupling,))
    assert setting.draw(1e6, np.random.default_rng(0)).keys == frozenset()


def test_statements_that_hold_as_often_as_they_say_are_left_alone():
    rng = np.random.default_rng(3)
    stated = rng.uniform(0.05, 0.95, 4000)
    line = Recalibration.of(stated, rng.random(4000) < stated)
    assert line(0.8) == pytest.approx(0.8, abs=0.03)
    assert line(0.2) == pytest.approx(0.2, abs=0.03)


def test_too_sure_becomes_less_sure_and_order_is_kept():
    rng = np.random.default_rng(4)
    stated = np.full(200, 0.97)
    line = Recalibration.of(stated, rng.random(200) < 0.7)
    assert line(0.97) == pytest.approx(0.7, abs=0.07)
    told = [line(p) for p in (0.1, 0.5, 0.9, 0.99)]
    assert told == sorted(told)


@pytest.mark.parametrize("count", [5, 60, 2000])
def test_the_line_is_where_its_cost_is_flat(count):
    rng = np.random.default_rng(2)
    stated = rng.uniform(0.001, 0.999, count)
    right = rng.random(count) < stated**1.5
    line = Recalibration.of(stated, right)
    odds, signs = logit(stated), np.where(right, 1.0, -1.0)
    misses = signs * expit(-signs * (line.slope * odds + line.offset))
    of_slope = (line.slope - 1.0) / SLOPE_WIDTH**2 - misses @ odds
    of_offset = line.offset / OFFSET_WIDTH**2 - misses.sum()
    assert np.hypot(of_slope, of_offset) < 1e-11


def test_few_statements_change_little_and_none_change_nothing():
    assert Recalibration.of([], [])(0.7) == 0.7
    assert Recalibration.of([0.9], [True])(0.9) == pytest.approx(0.9, abs=0.03)


def test_a_calibration_check_counts_what_it_saw_and_touches_probabilities_alone(tmp_path):
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=3.0)
    recording, _ = recorded(case, tmp_path)
    before = {k: v.copy() for k, v in vars(recording).items() if isinstance(v, np.ndarray)}
    diagnosis = diagnose(recording, DiagnosisOptions(library=(Scale, JointOffset)))
    told = []
    found = check_calibration(
        diagnosis, 3, jobs=1, progress=lambda words, share: told.append(share)
    )
    assert told[-1] == 1.0
    assert told == sorted(told)
    assert found.first_right.of + found.false_alarms.of == 3
    assert found.first_right.count >= found.first_right.of - 1
    assert found.named_right.of == sum(len(t.named) for t in found.cases)
    after = replace(diagnosis, verdict=found.recalibrated)
    assert causes(after) == causes(diagnosis)
    assert after.verdict.gap == diagnosis.verdict.gap
    assert "checked on 3 simulated cases" in after.verdict.notes[-1]
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(recording, name), values)
    again = check_calibration(diagnosis, 3, jobs=1)
    assert again.cases == found.cases
    assert json.dumps(found.to_dict(), allow_nan=False)
    assert found.truth_set is None
    assert "too few with a cause" in found.words
    assert len(found.ranks) == 10
    assert 0 < sum(found.ranks) <= 3
    sure = [replace(t, stated=dict.fromkeys(t.stated, 1.0)) for t in found.cases if t.truth]
    strict = replace(found, cases=tuple(10 * sure))  # from 1 on, which no cause of ours reaches
    assert strict.threshold == 1.0
    assert set(strict.truth_set) >= {cause.label for cause in diagnosis.verdict.causes} != set()


def simulated(diagnosis, cases, monkeypatch):
    """Gaps that were asked for (by cause), and errors, of simulated cases that nobody diagnoses."""
    asked, errors, nothing = {}, [], SimulatedCase(frozenset(), (), {})
    monkeypatch.setattr(
        Setting,
        "draw",
        lambda _, ratio, rng, taken: asked.setdefault(rng, []).append(ratio) or Fault(),
    )
    monkeypatch.setattr(Setting, "recorded", lambda _, fault, own: errors.append(own))
    monkeypatch.setattr(check, "_tried", lambda *_: nothing)
    check_calibration(diagnosis, cases, jobs=1)
    return np.array(list(asked.values())), np.array(errors)


def test_causes_of_a_simulated_case_have_together_a_gap_like_the_one_found(settings, monkeypatch):
    """What frame and tool leave beyond the noise, of which two causes have half of the square."""
    diagnosis = settings["tip_position"]
    gap = replace(diagnosis.verdict.gap, before=2e-3, noise_floor=1e-3)
    verdict = replace(diagnosis.verdict, gap=gap, causes=(None, None))
    ratios, _ = simulated(replace(diagnosis, verdict=verdict), 400, monkeypatch)
    of_found = np.log(ratios / np.sqrt(3.0 / 2.0)) / np.log(prior.GAP_SPREAD)
    assert np.abs(of_found).max() <= 1.0
    assert np.mean(of_found) == pytest.approx(0.0, abs=0.1)
    assert ratios.shape == (pytest.approx(300, abs=30), 2)


def test_gross_rows_of_a_recording_are_as_gross_in_cases_like_it(settings, monkeypatch):
    diagnosis = settings["tip_position"]
    model = diagnosis.selected.model
    gross = np.arange(len(model.recording)) == 7
    problem = replace(model.problem, weights=np.where(gross, 0.0, 1.0))
    x = diagnosis.solution.x
    like = SimpleNamespace(
        options=diagnosis.options,
        verdict=diagnosis.verdict,
        solution=SimpleNamespace(x=x),
        selected=SimpleNamespace(model=SimpleNamespace(recording=model.recording, problem=problem)),
    )
    _, errors = simulated(like, 50, monkeypatch)
    left = Mapped(model.problem).residuals(x)
    assert (errors[:, 7] == left[7]).all()
    assert np.std(errors[:, ~gross]) == pytest.approx(diagnosis.verdict.noise.sigma, rel=0.05)


def test_a_set_holds_the_truth_where_it_holds_every_cause_of_it(settings):
    both = frozenset({("joint_scale", 1), ("joint_offset", 2)})
    stated = {("joint_scale", 1): 0.9, ("joint_offset", 2): 0.3}
    verdict = settings["tip_position"].verdict
    for told, least in ((stated, 0.3), ({("joint_scale", 1): 0.9}, 0.0)):
        cases = (SimulatedCase(both, (), told),) * 10
        assert CalibrationCheck(verdict, cases).threshold == least


def test_the_set_holds_the_truth_in_nine_of_ten_cases_alike():
    rng = np.random.default_rng(7)
    held = []
    for _ in range(400):
        scores = rng.beta(4.0, 1.0, 30)
        held.append(scores[-1] >= threshold(scores[:-1]))
    assert np.mean(held) == pytest.approx(0.9, abs=0.035)
    assert threshold([0.5] * 8) is None
    assert threshold([0.0, *[0.9] * 8]) == 0.0


def test_ranks_of_true_values_are_even_where_stated_errors_are_right(settings):
    rng = np.random.default_rng(8)
    fault = Fault((JointCoupling(2),), np.array([1e-3]))
    (name,) = (p.name for p in fault.effects[0].parameters)
    told = []
    for off in rng.normal(0.0, 1e-4, 2000):
        stated = Estimate(1e-3 + off, 1e-4, "1", False, "")
        named = SimpleNamespace(effect="joint_coupling", element=2, parameters={name: stated})
        told += ranks([named], fault)
    counts = histogram(told)
    assert len(counts) == 10
    assert np.ptp(counts) < 80
    assert ranks([], fault) == ()


def test_a_calibration_check_of_no_cases_is_refused(settings):
    with pytest.raises(ValueError, match="cases 0: at least 1"):
        check_calibration(settings["tip_position"], 0)


def test_the_command_checks_calibration_and_says_so(tmp_path, capsys):
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=3.0)
    recorded(case, tmp_path)
    folder = tmp_path / case.name
    without = [w for e in EFFECTS if e is not Scale for w in ("--without", e.name)]
    assert run(["diagnose", str(folder), "--rehearse", "2", "--json", "-", *without]) == 0
    verdict = json.loads(capsys.readouterr().out)
    assert verdict["calibration"]["cases"] == 2
    assert verdict["calibration"]["first_right"]["of"] <= 2


def test_a_recording_can_be_sent_to_another_process(settings):
    for diagnosis in settings.values():
        sent = pickle.loads(pickle.dumps(diagnosis.recording))
        T = sent.chain.placement(sent.q)
        np.testing.assert_array_equal(T, diagnosis.recording.chain.placement(sent.q))


def test_what_was_certain_counts_as_a_million_to_one():
    """A line of half the slope makes a thousand to one of it, on either side."""
    worth = Recalibration(0.5, 0.0)
    assert 1.0 - worth(1.0) == pytest.approx(1e-3, rel=0.2)
    assert worth(0.0) == pytest.approx(1e-3, rel=0.2)
