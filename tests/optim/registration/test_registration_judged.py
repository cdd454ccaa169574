"""A fit of markers that has not converged says so, and predicts no error."""

from dataclasses import asdict

import numpy as np
import pytest

from plumbline.optim.core.constants import STILL
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.registration import METHODS, Anisotropic, Kabsch, Robust, least_squares
from plumbline.optim.registration.words import trust
from tests.phantoms import ALIKE, CT, FIVE, LESION, NOISE, mapped, readings, registered

ITERATED = (Anisotropic(), Robust(), Anisotropic(LevenbergMarquardt()))


@pytest.mark.parametrize("method", ITERATED, ids=str)
@pytest.mark.parametrize("noise", [NOISE, ALIKE, None], ids=["slices", "alike", "unstated"])
def test_a_fit_that_converged_is_judged_so(method, noise):
    for seed in range(5):
        answer = registered(
            method, *readings(FIVE, NOISE if noise is NOISE else ALIKE, seed), noise
        )
        (fit,) = answer.judged.fits
        assert answer.judged.converged
        assert fit.stationarity < STILL / 10
        assert not answer.unknown


def test_exact_markers_are_judged_without_a_division_by_zero():
    for method in ITERATED:
        assert registered(method, CT, mapped(CT), NOISE).judged.converged


def stopped_at_the_start(monkeypatch):
    monkeypatch.setattr(least_squares.constants, "STEPS", 0)
    least_squares.best_fit.cache_clear()


@pytest.mark.parametrize("method", [Anisotropic(), Robust()], ids=str)
def test_a_fit_that_was_stopped_says_so_and_predicts_nothing(method, monkeypatch):
    stopped_at_the_start(monkeypatch)
    answer = registered(method, *readings(FIVE, NOISE, 3), NOISE)
    assert not answer.judged.converged
    assert answer.judged.fits[0].stationarity > STILL
    assert any("the fit of the markers has not converged" in note for note in answer.notes)
    error = answer.tre(LESION, None)
    assert np.isinf(error.semi_axes()).all()
    said = trust(answer, error, "M")
    assert said.startswith("M: not known; the fit of the markers has not converged")
    assert "allow more iterations" in said


def test_a_solver_that_was_stopped_is_judged_by_the_statement():
    stopped = Anisotropic(LevenbergMarquardt(max_iterations=0))
    assert not registered(stopped, *readings(FIVE, NOISE, 3), NOISE).judged.converged


def test_a_closed_form_has_nothing_to_judge():
    for name in ("three-point", "kabsch", "best-triple"):
        assert registered(METHODS[name], *readings(FIVE), ALIKE).judged.fits == ()
    content = asdict(registered(Kabsch(), *readings(FIVE), ALIKE).judged)
    assert content == {"converged": True, "fits": ()}
