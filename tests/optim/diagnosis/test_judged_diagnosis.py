"""A verdict says whether every fit behind it converged, wherever it is shown."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.report.diagnosis.page import in_words
from plumbline.experiments.report.page.words import print_page
from plumbline.experiments.report.writing import report_html
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.kinematics.effects.viscous_friction import ViscousFriction
from plumbline.optim.core.constants import STILL
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.diagnose import _idle, diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from tests.answer_contract import keeps_the_contract
from tests.optim.recording.test_set_up import room, told

ROWS = 40


class HalfWay(LevenbergMarquardt):
    """A solver that stops between its start and its end."""

    def solve(self, problem, start):
        found = super().solve(problem, start)
        return replace(found, x=0.5 * (found.x + start))


@pytest.fixture(scope="module")
def recording():
    """Zeros that are off by a tenth of a radian: one step does not get there."""
    return told(room("tip_position", "bh7", off=np.array([0.0, 0.0, 0.1, -0.1, 0.0]), seed=3))


@pytest.fixture(scope="module")
def cut_short(recording):
    """Every fit ends half way to where it goes."""
    return diagnose(recording, DiagnosisOptions(solver=HalfWay()))


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
        said = diagnosis.verdict.to_dict()["judged"]
        assert said["converged"] == diagnosis.verdict.judged.converged
        keys = {"fit", "converged", "stationarity", "violation", "at_bound", "limit"}
        assert all(set(one) == keys for one in said["fits"])


def test_text_card_and_report_say_what_has_not_converged(cut_short, run_out):
    for diagnosis, wanted in ((cut_short, True), (run_out, False)):
        out = io.StringIO()
        print_page(in_words(diagnosis), Console(file=out, width=400))
        shown = (out.getvalue(), diagnosis.card(), report_html(diagnosis, proof=False))
        assert all(("has not converged" in text) == wanted for text in shown)


def test_a_fit_to_another_recording_is_judged_as_well(run_out):
    other = told(room("tip_position", "bh7", off=np.array([0.0, 0.0, 0.1, -0.1, 0.0]), seed=4))
    assert run_out.transfer(other).judged.converged
    assert len(run_out.transfer(other).judged.fits) == 2


def test_a_verdict_keeps_the_contract_of_every_answer(run_out, tmp_path):
    keeps_the_contract(run_out.verdict, tmp_path)


@pytest.fixture(scope="module")
def stored(run_out, tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "answer.json"
    run_out.save(path)
    return plumbline.load(path)


def test_a_diagnosis_keeps_the_contract_of_every_answer(run_out, tmp_path):
    keeps_the_contract(run_out, tmp_path)


def test_a_stored_diagnosis_comes_back_with_its_fit(run_out, stored):
    assert stored.verdict == run_out.verdict
    assert stored.effects == run_out.effects
    assert stored.options == run_out.options
    np.testing.assert_array_equal(stored.solution.x, run_out.solution.x)
    np.testing.assert_allclose(
        stored.solution.gram.matrix, run_out.solution.gram.matrix, rtol=1e-12, atol=1e-12
    )
    other = told(room("tip_position", "bh7", off=np.array([0.0, 0.0, 0.1, -0.1, 0.0]), seed=4))
    assert stored.transfer(other) == run_out.transfer(other)


def test_a_verdict_s_fields_are_reached_from_the_diagnosis(run_out):
    for name in ("gap", "causes", "candidates", "where", "next", "notes", "headline", "judged"):
        assert getattr(run_out, name) == getattr(run_out.verdict, name)
    assert run_out.outside_probability == run_out.verdict.outside_probability


def test_a_stored_diagnosis_says_how_to_search_again(stored):
    with pytest.raises(PlumblineError, match=r"diagnose\(answer.recording, answer.options\)"):
        _ = stored.selected


@pytest.mark.parametrize(
    ("x", "idle"), [((0.3, 0.0, 0.0), [1]), ((0.3, 1e-8, 0.1), []), ((0.0, 0.0, 0.2), [])]
)
def test_a_form_that_comes_to_nothing_goes_where_another_of_its_cause_works(x, idle):
    """Two forms of one friction, and another that has no more of them."""
    forms = (CoulombFriction(1), CoulombFriction(1, creep=0.1), ViscousFriction(2))
    selected = SimpleNamespace(
        model=SimpleNamespace(
            terms=[SimpleNamespace(effect=e, columns=slice(k, k + 1)) for k, e in enumerate(forms)]
        ),
        best=SimpleNamespace(x=np.array(x), problem=SimpleNamespace(scale=np.full(3, 0.1))),
        selection=SimpleNamespace(candidates=[Candidate(e, np.array([0]), 0.0) for e in forms]),
        chosen=[SelectedTerm(k, 1.0) for k in range(3)],
    )
    assert [t.index for t in _idle(selected)] == idle
