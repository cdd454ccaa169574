"""Laws of what was excluded: it may still be at work, and half of its probability is left."""

import numpy as np
import pytest

from plumbline.experiments.reality.joint_effects import JointScale
from plumbline.optim.diagnosis.design.explanations import explanations
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.outside import look_beyond
from plumbline.optim.diagnosis.posterior.search import SOLVER
from plumbline.optim.diagnosis.verdict import criticism
from plumbline.optim.diagnosis.verdict.exclusion import without_keys
from plumbline.optim.diagnosis.verdict.probabilities import probabilities_of
from tests.simulated_cases import faultless, recorded, with_fault

KEY = ("joint_scale", 2)


@pytest.fixture(scope="module")
def fewer(tmp_path_factory):
    """A true cause that was excluded, the unknown looked for as with it, and the verdict."""
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=1.0)
    diagnosis = diagnose(recorded(case, tmp_path_factory.mktemp("excluded"))[0])
    found = diagnosis.selected
    recording, noise = found.model.recording, found.pool.noise
    fewer = without_keys(found, {KEY}, recording, np.ones(len(recording)), SOLVER)
    return fewer, look_beyond(found, noise), diagnosis.verdict


def test_a_cause_that_was_excluded_keeps_at_most_half_and_its_rank(fewer):
    found, outside, _ = fewer
    p = probabilities_of(found, outside)
    assert max(p, key=lambda key: p[key]) == KEY
    assert 0.2 < p[KEY] <= 0.5


def test_the_next_experiment_counts_with_what_was_excluded(fewer):
    found, _, verdict = fewer
    listed = {e.keys: e.weight for e in explanations(found, verdict, most=200)}
    assert listed[frozenset({KEY})] <= listed[frozenset()]


@pytest.mark.parametrize(("probability", "spared"), [(0.89, False), (0.91, True)])
def test_rows_left_out_need_not_bear_out_a_lone_cause_that_is_nine_tenths_sure(
    probability, spared, monkeypatch, tmp_path
):
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=1.0)
    recording, _ = recorded(case, tmp_path)
    sought = diagnose(recording)
    monkeypatch.setattr(criticism, "probabilities_of", lambda found, outside: {KEY: probability})
    monkeypatch.setattr(criticism, "borne_out", lambda *_: False)
    # Without a lack of fit if it goes: that would keep it in any case.
    monkeypatch.setattr(criticism, "_beyond", lambda *_: 0.0)
    named = [(c.effect, c.element) for c in diagnose(recording).verdict.causes]
    assert [(c.effect, c.element) for c in sought.verdict.causes] == [KEY]
    assert named == ([KEY] if spared else [])
