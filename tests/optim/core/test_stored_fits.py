"""Effects and fits are stored by names and numbers, and come back as they were."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import EFFECTS, Effect
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.optim.core.answer import restored, stored
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.measurement.storing import StoredFit
from tests.made_up_diagnosis import BENCH
from tests.optim.recording.test_set_up import room, told


def again(value, kind=None):
    """A value after a journey through JSON text."""
    return restored(json.loads(json.dumps(stored(value))), kind or type(value))


class Odd(Effect):
    """Somebody's own."""

    name = "odd"
    stage = JointOffset.stage
    words = "odd"
    reference = "nobody (2026)"

    def apply(self, state, *values):
        """Nothing."""
        return state


def test_every_variant_of_the_library_comes_back():
    scope = scope_of(plumbline.load(BENCH))
    variants = [v for effect in EFFECTS for v in effect.candidates(scope)]
    assert len({v.name for v in variants}) > 10
    assert [again(v, Effect) for v in variants] == variants


def test_an_own_effect_is_found_by_its_name_and_an_unknown_one_named():
    assert again(Odd(), Effect) == Odd()
    with pytest.raises(PlumblineError, match=r"effect 'joint_ofset' .* joint_offset.*; import"):
        restored(stored(JointOffset(2)) | {"name": "joint_ofset"}, Effect)


@pytest.mark.parametrize("kind", ["tip_position", "pose", "fixed_point", "joint_position"])
def test_a_fit_comes_back_with_its_curvature(kind):
    recording = told(room(kind, "bh7", off=np.zeros(5), seed=3))
    part = recording.select(np.arange(len(recording)) % 2 == 0)
    nuisance = None if kind == "fixed_point" else nuisances_of(part)
    weights = np.where(np.arange(len(recording)) % 5, 1.0, 0.0)
    effects = (JointOffset(2),)
    model = build_model(recording, effects, nuisance=nuisance, weights=weights, ridge=[0.3])
    solution = Solution(model.problem, model.start + 1e-3, 7, "stopped")
    fit = again(StoredFit.of(model, solution))
    _, found = fit.again(recording, effects)
    np.testing.assert_array_equal(found.gram.matrix, solution.gram.matrix)
    np.testing.assert_array_equal(found.gram.vector, solution.gram.vector)
    assert (found.iterations, found.message) == (7, "stopped")
    with pytest.raises(ValueError, match="unknowns"):
        replace(fit, x=fit.x[1:]).again(recording, effects)


def test_every_option_of_a_diagnosis_comes_back():
    asked = DiagnosisOptions(
        "rows", 3, ("backlash",), EFFECTS, LevenbergMarquardt(7), unlisted=0.4, force=True
    )
    assert again(asked) == asked
    assert set(stored(asked)) == {f.name for f in fields(DiagnosisOptions)}
