"""Time and memory of a diagnosis are told; SciPy with finite differences ends where our fits do."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares

from plumbline.experiments.benches.central import Cost, recorded
from plumbline.experiments.console.measured import plain, printed
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.loading import load_recording
from tests.made_up_diagnosis import BENCH


@pytest.mark.parametrize(
    "effect",
    [
        REGISTRY["joint_offset"](joint=3),
        REGISTRY["joint_compliance"](joint=2),
        REGISTRY["link_geometry"](link=2),
    ],
    ids=lambda effect: effect.name,
)
def test_a_fit_by_finite_differences_ends_where_ours_does(effect):
    recording = load_recording(BENCH)
    model = build_model(recording, [effect], nuisance=nuisances_of(recording))
    problem, mapped = model.problem, Mapped(model.problem)
    found = least_squares(
        lambda x: np.concatenate([mapped.residuals(x).ravel(), mapped.shared(x)[0]]), model.start,
        bounds=(problem.lower, problem.upper), x_scale=problem.scale, ftol=1e-10, xtol=1e-10,
        gtol=1e-10,
    )  # fmt: skip
    _, ours = fit(recording, [effect], nuisances_of(recording), np.ones(len(recording)), SOLVER)
    assert found.cost == pytest.approx(ours.cost, rel=1e-5)


def test_a_bench_recording_has_the_rows_that_it_was_asked_for():
    recording = recorded(40, "joint_offset")
    assert (len(recording), recording.chain.n) == (40, 6)


def test_what_was_measured_is_printed_and_plain_data():
    first, then = Cost(100, 1.5, 1.9, 250.0, "no-gap"), Cost(1000, 6, 7, 300, "explained: a", 4)
    table = pd.DataFrame([first, then])
    said = printed("diagnosis", table)
    for words in ("diagnosis", "ratio", "1.5", "300", "explained: a"):
        assert words in said
    assert plain(table)[0] == vars(first)  # what is not known is none
    assert json.loads(json.dumps(plain({"diagnosis": table}), allow_nan=False))
    assert printed("share", 0.5) == "share: 0.5"
