"""Laws of distrust: gross errors are named row by row, and what a cause explains is kept."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.experiments.reality.body_effects import BaseBump
from plumbline.experiments.reality.joint_effects import JointCompliance, JointOffset
from plumbline.experiments.reality.outside_effects import LooseTool
from plumbline.kinematics.effects.joint_offset import JointOffset as OwnOffset
from plumbline.optim.diagnosis.diagnose import diagnose, task_of, usable
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.robust import distrusted_by_fit, distrusted_rows
from plumbline.optim.diagnosis.posterior.search import _about_nothing
from plumbline.optim.diagnosis.verdict.explanation import explain
from tests.explained import searched
from tests.few_effects import only
from tests.simulated_cases import faultless, recorded, with_fault

# What could be taken for rows that are gross, and for the causes beside them.
BESIDE = only("joint_offset", "joint_scale", "joint_compliance", "base_bump", "tool_slip")
ZEROS = DiagnosisOptions(library=(OwnOffset,))


def planted(case, share, seed):
    return replace(case, gross_share=share, seed=seed)


def test_gross_errors_are_named_row_by_row(tmp_path):
    seed = 2
    recording, facts = recorded(planted(faultless(rows=70, seed=seed), 0.05, seed), tmp_path)
    diagnosis = diagnose(recording, BESIDE)
    assert len(facts["gross_rows"]) == 4
    assert list(diagnosis.verdict.distrusted_rows) == facts["gross_rows"]
    assert diagnosis.verdict.verdict == Outcome.NO_GAP
    assert diagnosis.verdict.outside_depends_on == ""  # they owe nothing to each other: no slip
    np.testing.assert_array_equal(np.flatnonzero(~diagnosis.trusted) + 2, facts["gross_rows"])


def test_gross_errors_do_not_hide_a_cause_nor_enter_its_figures(tmp_path):
    """Of the whole library: with a few effects two of four rows would be left for a cause."""
    seed = 4
    case = with_fault(faultless(rows=70, seed=seed), JointCompliance(0.0, 2))
    recording, facts = recorded(planted(case, 0.06, seed), tmp_path)
    verdict = diagnose(recording).verdict
    assert list(verdict.distrusted_rows) == facts["gross_rows"]
    assert [(c.effect, c.element) for c in verdict.causes] == [("joint_compliance", 2)]
    assert verdict.gap.after < 1.25 * verdict.gap.noise_floor


def test_a_real_effect_on_few_rows_is_not_distrusted(tmp_path):
    """The base is knocked shortly before the end: six rows of seventy are off, by a real cause."""
    bump = BaseBump(0.0, (1.0, -0.6, 0.8, 0.5, 1.0, 0.7), moment=0.92)
    case = with_fault(faultless(rows=70, seed=4), bump)
    recording, _ = recorded(case, tmp_path)
    assert (case.scene.session.progress >= 0.92).sum() == 6
    selected, bad = searched(recording, BESIDE.library)
    assert not bad.any()
    assert explain(selected, 0).named == {("base_bump", None)}


def test_a_clean_recording_distrusts_no_row(tmp_path):
    recording, _ = recorded(with_fault(faultless(rows=60, seed=5), JointOffset(0.0, 3)), tmp_path)
    assert not searched(recording, BESIDE.library)[1].any()


def test_three_rows_with_one_shift_of_the_tool_are_outside_of_the_library(tmp_path):
    slip = LooseTool(0.0, rows=(9, 27, 44), direction=(0.6, 0.0, 0.8))
    recording, _ = recorded(with_fault(faultless(rows=60, seed=6), slip, gap=2.5), tmp_path)
    verdict = diagnose(recording, BESIDE).verdict
    assert verdict.verdict == Outcome.OUTSIDE
    assert not verdict.causes
    assert verdict.outside_depends_on == "rows 11, 29, 46: one shift of the tool explains them"
    assert verdict.distrusted_rows == (11, 29, 46)
    assert [(p.stage, p.share) for p in verdict.where] == [("tool", 1.0)]


def test_rows_off_by_a_hundred_times_the_noise_leave_the_noise_of_the_others_as_it_is(tmp_path):
    """A motion capture of 2 mm that took one marker for the next, 0.19 m away, in two rows."""
    recording, _ = recorded(faultless(rows=36, seed=1), tmp_path)
    measured = recording.measured + np.random.default_rng(1).normal(0.0, 2e-3, (36, 3))
    plain = diagnose(replace(recording, noise_std=None, measured=measured), ZEROS).verdict
    measured[4] += 0.19 * np.array([0.6, -0.5, 0.62])
    measured[20] += 0.19 * np.array([-0.3, 0.9, 0.3])
    spoilt = diagnose(replace(recording, noise_std=None, measured=measured), ZEROS).verdict
    assert spoilt.distrusted_rows == (6, 22)
    assert spoilt.noise.sigma == pytest.approx(plain.noise.sigma, rel=0.1)


def test_many_rows_are_judged_by_the_median_of_all():
    rng = np.random.default_rng(8)
    residuals = rng.normal(0.0, 1e-4, (5000, 3))
    rows = np.arange(17, 5000, 7)
    residuals[rows] += 1.5e-3
    np.testing.assert_array_equal(np.flatnonzero(distrusted_by_fit(residuals)), rows)
    np.testing.assert_array_equal(np.flatnonzero(distrusted_by_fit(1e3 * residuals)), rows)


def test_more_than_a_fifth_of_the_rows_are_never_distrusted():
    residuals = np.random.default_rng(9).normal(0.0, 1e-4, (400, 3))
    residuals[::4] *= 50.0
    assert not distrusted_by_fit(residuals).any()


@pytest.mark.parametrize(("columns", "seed"), [(slice(0, 3), 3), (slice(3, 6), 4)])
def test_a_pose_may_be_wrong_in_place_alone_or_in_its_turn(columns, seed, tmp_path):
    """With one prior for both, two wrong places cost less as one shift of the tool: told at .97."""
    recording, _ = recorded(faultless(rows=60, seed=seed, observation="pose"), tmp_path)
    rng = np.random.default_rng(seed)
    push = np.zeros((2, 6))
    push[:, columns] = rng.normal(size=(2, 6))[:, columns]
    push *= np.array([[48.0], [39.0]]) / np.linalg.norm(push, axis=1, keepdims=True)
    selected, bad = searched(spoilt(recording, [20, 45], push), BESIDE.library)
    found = explain(selected, 0)
    assert not found.named
    assert found.unlisted < 0.1
    assert list(np.flatnonzero(bad)) == [20, 45]


def spoilt(recording, rows, push):
    """Poses at some rows off by so many standard deviations of place, and 0.1 mrad (R, 6)."""
    measured = recording.measured.copy()
    measured[rows, :3] += recording.noise_std * push[:, :3]
    turned = Rotation.from_rotvec(1e-4 * push[:, 3:])
    read = Rotation.from_quat(measured[rows, 3:], scalar_first=True)
    measured[rows, 3:] = (turned * read).as_quat(scalar_first=True)
    return replace(recording, measured=measured)


@pytest.mark.parametrize("gross", [(), (7,), (7, 31)])
def test_copies_of_rows_are_gross_only_where_what_they_copy_is(gross, tmp_path):
    """Twenty rows stand in the file twice, each time on another path: each counts as half a row."""
    recording, _ = recorded(faultless(rows=60, seed=5), tmp_path)
    measured = recording.measured.copy()
    measured[list(gross)] += 0.01  # [m]
    again = np.append(np.arange(60), np.arange(20))
    copies = replace(recording, measured=measured).select(again)
    rows = usable(replace(copies, whole=None, place=None), force=True)
    assert rows.alike == 1.0
    found = distrusted_rows(_about_nothing(task_of(rows, DiagnosisOptions())))
    assert set(again[found]) == set(gross)
    assert found.sum() == np.isin(again, gross).sum()
