"""What an analysis hands back says what it is in one line, whatever it carries."""

import dataclasses

import numpy as np
import pytest

from plumbline.kinematics.robot import Robot
from plumbline.optim.capsule_mpc.events import Command, Event, Mode, Trouble
from plumbline.optim.capsule_mpc.planning import Plan
from plumbline.optim.dh_fit import fit_dh
from plumbline.optim.diagnosis.calibrate.check import CalibrationCheck, SimulatedCase
from plumbline.optim.diagnosis.design.next_experiment import Forecast, NextExperiment
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Cause, Estimate, Outcome
from plumbline.optim.hand_eye.answer import HandEye
from plumbline.optim.hand_eye.calibrate import calibrate
from plumbline.optim.pointing import Aim, Needle, safe_angle_map
from plumbline.optim.pointing.sweep import Sweep
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.registration import MarkerNoise, ThreePoint
from tests.made_up_diagnosis import BENCH, made_up
from tests.phantoms import registered
from tests.ranging_scenes import CLEAN, surveyed

MOST = 300  # characters


def one_line(thing):
    """Its ``repr``, which is one line of bounded length that says what kind of thing it is."""
    text = repr(thing)
    assert text.startswith(f"<{type(thing).__name__}")
    assert text.endswith(">")
    assert len(text) < MOST, f"{type(thing).__name__}: {len(text)} characters"
    assert text.isprintable()
    return text


@pytest.fixture(scope="module")
def diagnosis():
    return diagnose(load_recording(BENCH))


def test_a_diagnosis_is_one_line_that_names_its_causes(diagnosis):
    said = one_line(diagnosis)
    assert said.startswith("<Diagnosis of bench-ur5: explained; transmission_ripple of joint 2 (")
    assert said.endswith("mm -> 0.131 mm>")
    assert str(diagnosis) == said
    assert one_line(diagnosis.verdict).removeprefix("<Verdict on") in said.removeprefix(
        "<Diagnosis of"
    )
    first = diagnosis.verdict.causes[0]
    percent = f"{100 * first.probability:.0f}"
    assert one_line(first) == f"<Cause: transmission_ripple of joint 2, {percent} %>"


def test_what_a_diagnosis_rests_on_is_one_line_each(diagnosis):
    assert "transmission_ripple 2" in one_line(diagnosis.selected)
    said = one_line(diagnosis.recording)
    assert said == "<Recording 'bench-ur5': tip_position, 90 rows, ur5 to 'flange'>"
    assert "6 joints" in one_line(diagnosis.recording.robot)
    assert "6 joints" in one_line(diagnosis.recording.chain)
    one_line(diagnosis.solution)
    one_line(diagnosis.solution.problem)
    assert len(repr(diagnosis.transfer(diagnosis.recording))) < MOST


def test_many_causes_and_long_names_stay_on_one_line():
    verdict = made_up().verdict
    assert all(cause.label in one_line(verdict) for cause in verdict.causes)
    estimates = {f"order {k} sine": Estimate(1e-4, 1e-6, "rad") for k in range(100)}
    cause = Cause("a" * 40, "joint", 12, probability=0.9, parameters=estimates)
    long = dataclasses.replace(verdict, causes=(cause,) * 30, recording="n" * 500)
    assert "and 27 more" in one_line(long)
    one_line(cause)


def test_a_verdict_without_causes_names_none():
    verdict = dataclasses.replace(made_up().verdict, verdict=Outcome.NO_GAP, causes=())
    assert one_line(verdict).startswith("<Verdict on bench-ur5: no-gap; 0.")


def test_what_follows_from_a_diagnosis_is_one_line():
    verdict = made_up().verdict
    trial = SimulatedCase(frozenset({("backlash", 2)}), (("backlash", 2),), {("backlash", 2): 0.9})
    assert "60 simulated cases" in one_line(CalibrationCheck(verdict, (trial,) * 60))
    labels, forecast = tuple(f"cause {k}" for k in range(40)), Forecast("cause 0", 0.5, 0.97)
    some = NextExperiment((), labels, (1.0,) * 40, forecast, ("note",) * 40)
    assert "cause 0: 50 % -> 97 %" in one_line(some)
    one_line(dataclasses.replace(some, forecast=None))


def test_a_fit_of_links_is_one_line():
    assert "90 rows" in one_line(fit_dh(load_recording(BENCH)))


def test_a_calibrated_beam_is_one_line():
    _, _, readings = surveyed(0, CLEAN)
    found = calibrate(readings)
    assert "readings on 3 planes, 0 gross" in one_line(found)
    empty = np.empty(0)
    one_line(HandEye("n" * 90, 90, found, (), empty, None, 0.0, None, (), ("note",) * 50))


def test_a_registration_and_its_sweeps_are_one_line():
    ct = np.array([(0.01, 0.02, 0.147), (0.11, 0.12, 0.147), (0.06, -0.01, 0.08)])
    shift = np.array([0.4, 0.0, 0.4])
    found = registered(
        ThreePoint(),
        ct,
        ct + shift,
        MarkerNoise.from_resolution(1e-3 * np.ones(3), 1e-4),
        list("ABC"),
    )
    assert "3 of 3 markers" in one_line(found)
    aim = Aim(Robot.bundled("ur3").chain(), found.T_RC, np.zeros(3), Needle(0.2, 0.1))
    one_line(aim)
    angles = safe_angle_map(aim, [0.2], [0.0, 1.0])
    assert one_line(angles).startswith("<AngleMap of 2 angles: ")
    many = np.full(500, 1e-5)
    path = np.zeros((500, 6))
    status = (angles.status[0, 0],) * 500
    sweep = Sweep(
        aim, many, many, path, status, ("",) * 500, many, many, many, many, many, "solved", 7
    )
    assert "500 angles" in one_line(sweep)


def test_a_command_to_instruments_is_one_line():
    plan = Plan(np.zeros((40, 36)), True, 0.0, 7, "Solve_Succeeded")
    events = tuple(Event(trouble, "words " * 20) for trouble in (Trouble.SLACK,) * 30)
    command = Command(np.zeros(36), Mode.PLAN, events, 2e-3, 0.0, 1e-3, plan)
    assert one_line(command) == "<Command: plan, gap 2 mm, slack>"
    assert one_line(plan) == "<Plan: 40 steps ahead, solved, slack 0 mm; Solve_Succeeded>"
