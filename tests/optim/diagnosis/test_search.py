"""The search answers with the model that it has fitted, whatever the selection does."""

import itertools

import numpy as np
import pytest

from plumbline.optim.diagnosis.posterior import search as module
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import Task, search
from plumbline.optim.recording.loading import load_recording
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
