"""Laws of what was struck out: it stays in the question, and half of its probability is left."""

import numpy as np
import pytest

import plumbline.optim.diagnosis.verdict.trials as trials
from plumbline.experiments.reality.joint_effects import JointScale
from plumbline.optim.diagnosis.design.explanations import explanations
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.outside import look_beyond
from plumbline.optim.diagnosis.posterior.search import SOLVER
from plumbline.optim.diagnosis.verdict.judge import probabilities_of
from plumbline.optim.diagnosis.verdict.veto import without_keys
from tests.simulated_cases import faultless, recorded, with_fault

KEY = ("joint_scale", 2)


@pytest.fixture(scope="module")
def struck(tmp_path_factory):
    """A true cause that was struck out, the unknown looked for as with it, and the verdict."""
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=1.0)
    diagnosis = diagnose(recorded(case, tmp_path_factory.mktemp("struck"))[0])
    found = diagnosis.found
    recording, noise = found.model.recording, found.pool.noise
    fewer = without_keys(found, {KEY}, recording, np.ones(len(recording)), SOLVER)
    return fewer, look_beyond(found, noise), diagnosis.verdict


def test_a_cause_that_was_struck_out_keeps_at_most_half_and_its_rank(struck):
    found, outside, _ = struck
    p = probabilities_of(found, outside)
    assert max(p, key=lambda key: p[key]) == KEY
    assert 0.2 < p[KEY] <= 0.5


def test_the_next_experiment_counts_with_what_was_struck_out(struck):
    found, _, verdict = struck
    listed = {e.keys: e.weight for e in explanations(found, verdict, most=200)}
    assert listed[frozenset({KEY})] <= listed[frozenset()]


@pytest.mark.parametrize(("probability", "spared"), [(0.89, False), (0.91, True)])
def test_rows_left_out_need_not_bear_out_a_lone_cause_that_is_nine_tenths_sure(
    probability, spared, monkeypatch, tmp_path
):
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=1.0)
    recording, _ = recorded(case, tmp_path)
    sought = diagnose(recording)
    monkeypatch.setattr(trials, "probabilities_of", lambda found, outside: {KEY: probability})
    monkeypatch.setattr(trials, "borne_out", lambda *_: False)
    # Without a riddle that is left if it goes: that would keep it in any case.
    monkeypatch.setattr(trials, "_beyond", lambda *_: 0.0)
    named = [(c.effect, c.element) for c in diagnose(recording).verdict.causes]
    assert [(c.effect, c.element) for c in sought.verdict.causes] == [KEY]
    assert named == ([KEY] if spared else [])
