"""The search answers with the model that it has fitted, whatever the selection does."""

import itertools

import numpy as np
import pytest

from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.optim.diagnosis.posterior import search as module
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import Task, search
from plumbline.optim.diagnosis.posterior.shortlists import nearby
from plumbline.optim.recording.loading import load_recording
from tests.benches import bench
from tests.made_up_diagnosis import BENCH

ANSWERS = {
    "settles in another order": [(3, 7), (7, 3)],
    "goes round": [(3, 7), (3,), (7, 3), (3,)],
    "ends where it began": [(3, 7), (), (3,)],
    "never settles": [(1,), (2,), (3,), (4,), (5,)],
}


@pytest.mark.parametrize("answers", ANSWERS.values(), ids=list(ANSWERS))
def test_the_terms_are_those_of_the_last_fit_in_its_order(answers, monkeypatch):
    turns = itertools.cycle(answers)
    monkeypatch.setattr(
        module, "select", lambda *_, **__: [SelectedTerm(k, 1.0) for k in next(turns)]
    )
    recording = load_recording(BENCH)
    folds = np.arange(len(recording)) % 5
    task = Task(recording, folds, NoisePrior.of(recording.noise_std))
    found = search(task, np.zeros(len(recording), dtype=bool))
    assert tuple(term.effect for term in found.model.terms) == found.effects
    assert found.best.problem is found.model.problem


def test_finer_variants_are_tried_of_twelve_of_a_dense_family_and_of_all_others():
    """Of more the UR10's grid takes 5 GB."""
    ripples = [GearRipple(joint=2, order=float(k)) for k in range(3, 17)]
    found = nearby([*ripples, Hysteresis(joint=3)], bench("ur5", "tip_position"))
    assert list(found) == [*ripples[:12], Hysteresis(joint=3)]
