"""The search answers with the model that it has fitted, whatever the selection does."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior import search as module
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import Task, search
from plumbline.optim.diagnosis.posterior.shortlists import nearby
from plumbline.optim.diagnosis.verdict import settled as settling
from plumbline.optim.recording.loading import load_recording
from tests.benches import bench
from tests.few_effects import FEW_EFFECTS
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
    task = Task(recording, folds, NoisePrior.of(recording.noise_std), library=FEW_EFFECTS.library)
    found = search(task, np.zeros(len(recording), dtype=bool))
    assert tuple(term.effect for term in found.model.terms) == found.effects
    assert found.best.problem is found.model.problem


@pytest.mark.parametrize(("rows", "long"), [(3_999, False), (4_000, True)])
def test_four_thousand_rows_are_searched_in_part_first_fitted_briefly_and_linearised_once(
    rows, long, monkeypatch
):
    """A UR10's 11,911 rows took 96 s and 2.1 GB otherwise, and the same verdict."""
    recording = load_recording(BENCH).select(np.zeros(rows, dtype=int))
    task = Task(recording, np.zeros(rows, dtype=int), NoisePrior.of(recording.noise_std))
    assert (task.refitting is module.BRIEF) == long
    parts, told = (
        [],
        SimpleNamespace(
            theirs=(), better=0.0, terms=(), named=frozenset(), compared=0, one_by_one=True
        ),
    )
    monkeypatch.setattr(module, "_from_nothing", lambda *_, **how: parts.append(how) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        module.find_causes(task, lambda *_: None)
    assert parts == [{"looks": 0} if long else {}]
    asked = []
    wrong = iter([100.0, 40.0, 10.0, 1.0])
    monkeypatch.setattr(settling, "explain", lambda *_: asked.append(1) or told)
    for place, name in ((settling, "with_terms"), (settling.search, "about_its_fit")):
        monkeypatch.setattr(place, name, lambda about, *_, **__: about)
    monkeypatch.setattr(settling, "worth_while", lambda *_: ())
    monkeypatch.setattr(settling.search, "foretold_wrongly", lambda _: next(wrong))
    settling.settled(task, None, None, 0, 0.2)
    assert len(asked) == (1 if long else 4)


def test_what_folds_say_apart_is_worked_out_once_it_is_asked_for():
    """Of twenty rows of nine joints all folds' matrices take a third of the memory."""
    recording = load_recording(BENCH)
    folds = np.arange(len(recording)) % 5
    task = Task(recording, folds, NoisePrior.of(recording.noise_std))
    pool = search(task, np.zeros(len(recording), dtype=bool), rounds=1).pool
    assert "grams" not in vars(pool)
    total = sum(pool.grams, start=pool.shared)
    apart = Linear.about(total, pool.x, pool.model.problem.scale)
    np.testing.assert_allclose(pool.whole.G, apart.G, atol=1e-12 * np.abs(apart.G).max())
    assert (pool.whole.tt, pool.whole.n) == pytest.approx((apart.tt, apart.n))


def test_finer_variants_are_tried_of_twelve_of_a_dense_family_and_of_all_others():
    """Of more the UR10's grid takes 5 GB."""
    ripples = [GearRipple(joint=2, order=float(k)) for k in range(3, 17)]
    found = nearby([*ripples, Hysteresis(joint=3)], bench("ur5", "tip_position"))
    assert list(found) == [*ripples[:12], Hysteresis(joint=3)]
