"""A verdict says whether every fit behind it converged, wherever it is shown."""

import io
import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from plumbline.experiments.report.diagnosis.card import card
from plumbline.experiments.report.diagnosis.html import html_report
from plumbline.experiments.report.diagnosis.text import print_verdict
from plumbline.optim.core.judged import STILL
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from tests.answer_contract import keeps_the_contract
from tests.test_set_up import room, told

ROWS = 40


@pytest.fixture(scope="module")
def recording():
    """Zeros that are off by a tenth of a radian: one step does not get there."""
    return told(room("tip_position", "bh7", off=np.array([0.0, 0.0, 0.1, -0.1, 0.0]), seed=3))


@pytest.fixture(scope="module")
def cut_short(recording):
    return diagnose(recording, DiagnosisOptions(solver=LevenbergMarquardt(max_iterations=1)))


@pytest.fixture(scope="module")
def run_out(recording):
    return diagnose(recording)


def test_fits_that_were_run_to_their_end_are_said_to_have_converged(run_out):
    judged = run_out.verdict.judged
    assert judged.converged
    assert [one.fit.split(" without fold")[0] for one in judged.fits] == [
        "the fit without causes",
        "the fit with the causes",
        "the fit",
    ]
    assert all(one.stationarity <= STILL and one.violation == 0.0 for one in judged.fits)
    assert run_out.verdict.warnings == ()


def test_one_step_alone_does_not_go_unnoticed(cut_short):
    judged = cut_short.verdict.judged
    assert not judged.converged
    assert max(one.stationarity for one in judged.fits) > STILL


def test_the_json_has_the_figures_of_every_fit(cut_short, run_out):
    for diagnosis in (cut_short, run_out):
        said = json.loads(diagnosis.verdict.to_json())["judged"]
        assert said["converged"] == diagnosis.verdict.judged.converged
        keys = {"fit", "converged", "stationarity", "violation", "at_bound"}
        assert all(set(one) == keys for one in said["fits"])


def test_text_card_and_report_say_what_has_not_converged(cut_short, run_out):
    for diagnosis, wanted in ((cut_short, True), (run_out, False)):
        out = io.StringIO()
        print_verdict(diagnosis.verdict, Console(file=out, width=400))
        shown = (out.getvalue(), card(diagnosis.verdict), html_report(diagnosis))
        assert all(("has not converged" in text) == wanted for text in shown)


def test_a_fit_to_another_recording_is_judged_as_well(run_out):
    other = told(room("tip_position", "bh7", off=np.array([0.0, 0.0, 0.1, -0.1, 0.0]), seed=4))
    assert run_out.transfer(other).judged.converged
    assert len(run_out.transfer(other).judged.fits) == 2


def test_a_verdict_keeps_the_contract_of_every_answer(run_out, tmp_path):
    keeps_the_contract(run_out.verdict, tmp_path)


def test_a_diagnosis_is_stored_as_its_verdict_and_brought_back_equal(run_out, tmp_path):
    path = tmp_path / "verdict.json"
    run_out.save(path)
    assert Verdict.load(path) == run_out.verdict
    assert run_out.card() == run_out.verdict.card()
    assert run_out.judged == run_out.verdict.judged
    assert run_out.to_dict() == run_out.verdict.to_dict()
    assert isinstance(run_out.plot(), Figure)
