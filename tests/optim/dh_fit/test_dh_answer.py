"""A link fit keeps the contract of every answer; what is stored comes back without a solve."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.robot import Robot
from plumbline.optim.core.answer import restored, stored
from plumbline.optim.core.solvers import Ipopt, TrustRegion
from plumbline.optim.dh_fit import BY_NAME, DHFit, DHOptions, Norms, Squares, fit_dh
from plumbline.optim.dh_fit.solvers import GaussNewton
from tests.answer_contract import keeps_the_contract, same
from tests.dh_sessions import four, recording, session, simulated_recording
from tests.optim.dh_fit.test_dh_fit import PANDA, PUBLISHED


def test_a_fit_keeps_the_contract(tmp_path):
    keeps_the_contract(fit_dh(recording(session(3), name="<arm>")), tmp_path)


def test_a_registered_fit_at_its_bounds_keeps_it(tmp_path):
    simulated = session(3, tilts=False)
    narrow = replace(PUBLISHED, delta_length=0.002, delta_angle=0.006)
    fit = fit_dh(recording(simulated), narrow, registration=four(simulated))
    assert fit.resting.any()
    keeps_the_contract(fit, tmp_path)


def test_what_is_stored_comes_back_without_a_solve(tmp_path, monkeypatch):
    made = simulated_recording(Robot.from_urdf(PANDA), 60, np.random.default_rng(0))
    fit = fit_dh(made, DHOptions(loss=Squares(), delta_length=0.05))
    fit.save(tmp_path / "fit.json")
    monkeypatch.setattr(GaussNewton, "solve", None)
    again = DHFit.load(tmp_path / "fit.json")
    same(again.to_dict(), fit.to_dict())
    np.testing.assert_array_equal(again.x, fit.x)
    np.testing.assert_allclose(again.misfits(), fit.misfits(), rtol=0, atol=1e-14)
    assert again.recording.sha256 == fit.recording.sha256


@pytest.mark.parametrize(
    "solver", [*BY_NAME.values(), TrustRegion(7), Ipopt(further=(("mu_strategy", "adaptive"),))]
)
def test_options_come_back_as_they_were(solver, tmp_path):
    options = DHOptions(loss=Norms(2e-6), solver=solver, frame="registration")
    assert restored(stored(options), DHOptions) == options
