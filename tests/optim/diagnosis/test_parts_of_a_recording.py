"""Laws of parts: what rows kept back, thinned or repeated must not change."""

from dataclasses import replace

import numpy as np
import pytest

import plumbline.optim.diagnosis.posterior.search as search_module
from plumbline.errors import PlumblineError
from plumbline.experiments.reality.body_effects import BaseBump as RealBump
from plumbline.experiments.reality.joint_effects import Backlash as RealBacklash
from plumbline.experiments.reality.joint_effects import JointOffset as RealOffset
from plumbline.experiments.reality.joint_effects import TransmissionRipple as RealRipple
from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.link_geometry import LinkGeometry
from plumbline.kinematics.effects.sensor_scale import SensorScale
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import _lever_unknown, diagnose
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.search import SOLVER, on_all_rows
from plumbline.optim.diagnosis.predict.folds import kind_of_folds
from plumbline.optim.diagnosis.predict.shrink import shrink_interval
from plumbline.optim.diagnosis.prior import MANY_ROWS
from plumbline.optim.measurement.observation import build_model, rows_of, scope_of
from tests.explained import searched
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import faultless, recorded, with_fault

SMALL = (JointOffset, JointScale)


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """Joint 3's zero is off; nobody has kept any row back."""
    case = with_fault(faultless(rows=60, seed=5), RealOffset(1e-3, 3))
    return recorded(case, tmp_path_factory.mktemp("bent"))[0]


def every_third(recording):
    return np.arange(len(recording)) % 3 == 0


# Rows kept back


def test_a_part_without_rows_kept_back_is_diagnosed_like_any_other(bent):
    kept = every_third(bent)
    part = replace(bent, held_out=kept).select(~kept)
    assert part.held_out is None
    plain = bent.select(~kept)
    zeros = DiagnosisOptions(library=(JointOffset,))
    assert diagnose(part, zeros).verdict == diagnose(plain, zeros).verdict


def test_rows_that_frame_and_tool_go_through_tell_nothing_and_are_refused(bent):
    with pytest.raises(PlumblineError, match="found 9 readings in 3 rows to fit, expected more"):
        diagnose(bent.select(range(3)))


def test_the_interval_knows_only_the_rows_it_is_given():
    rng = np.random.default_rng(1)
    before, after = rng.normal(size=(20, 3)), rng.normal(0.0, 0.7, (20, 3))
    alone = shrink_interval(before, after, np.arange(20) // 4, 0)
    assert shrink_interval(before, after, 16 + np.arange(20) // 4, 0) == alone
    assert alone[1] < 0.6


@pytest.mark.parametrize(
    ("observation", "kept_back"),
    [("tip_position", False), ("pose", True), ("fixed_point", True), ("joint_position", False)],
)
def test_the_staircase_ends_at_the_gap(observation, kept_back, tmp_path):
    case = faultless(rows=90, seed=3, observation=observation)
    recording, _ = recorded(
        with_fault(case, RealRipple(1e-4, 3, once=(1.0, 0.5)), gap=6.0), tmp_path
    )
    if kept_back:
        recording = replace(recording, held_out=every_third(recording))
    found = diagnose(recording, DiagnosisOptions(library=(*SMALL, *ripples()))).verdict
    assert found.causes
    assert found.staircase[-1].gap == pytest.approx(found.gap.after, rel=1e-9)
    assert {cause.after for cause in found.causes} == {found.gap.after}


def touched(folder, rows=90):
    """Sockets visited in turn, by an arm whose joint 3 has an eccentric wheel."""
    case = faultless(rows=rows, seed=3, observation="fixed_point")
    recording, _ = recorded(with_fault(case, RealRipple(1e-4, 3, once=(1.0, 0.5)), gap=6.0), folder)
    order = np.argsort(recording.socket, kind="stable")
    ranks = np.empty(rows, dtype=int)
    for k in np.unique(recording.socket):
        mine = order[recording.socket[order] == k]
        ranks[mine] = np.arange(len(mine))
    return recording.select(np.lexsort((recording.socket, ranks)))


def test_a_socket_that_was_kept_back_counts_in_every_figure(tmp_path):
    """Nothing else tells where it is: its own rows do, in the gap and in the staircase alike."""
    recording = touched(tmp_path)
    last = np.unique(recording.socket)[-1]
    recording = replace(recording, held_out=recording.socket == last)
    found = diagnose(recording, DiagnosisOptions(library=(*SMALL, *ripples()))).verdict
    assert [c.effect for c in found.causes] == ["transmission_ripple"]
    assert 0.0 < found.gap.after < found.gap.before
    for figures in (found.staircase[-1].gap, found.causes[0].after):
        assert figures == pytest.approx(found.gap.after, rel=0.05)
    assert found.causes[0].before == pytest.approx(found.gap.before, rel=0.05)


def test_a_long_recording_that_visits_sockets_in_turn_is_searched_in_part(tmp_path, monkeypatch):
    """Every second row would be every second socket."""
    recording = touched(tmp_path)
    recording = recording.select(np.isin(recording.socket, np.unique(recording.socket)[:2]))
    assert (recording.socket[2:20] == recording.socket[:18]).all()
    assert recording.socket[0] != recording.socket[1]
    monkeypatch.setattr(search_module, "MANY_ROWS", len(recording) - 10)
    found = diagnose(recording, DiagnosisOptions(library=(*SMALL, *ripples()))).verdict
    assert [(c.effect, c.element) for c in found.causes] == [("transmission_ripple", 3)]


@pytest.mark.parametrize("step", [3, 6, 40])
def test_a_part_of_the_rows_visits_every_socket(step, tmp_path):
    recording = touched(tmp_path).select(np.arange(75))
    assert recording.socket[:6].tolist() == [1, 2, 3, 1, 2, 3]
    folds = np.arange(len(recording)) % 5
    part = search_module.Task(recording, folds, NoisePrior(), (), (), SOLVER).part(step)
    assert set(part.recording.socket) == set(recording.socket)
    assert len(part.recording) < len(recording)
    kept = [np.flatnonzero((recording.q == q).all(axis=1))[0] for q in part.recording.q]
    np.testing.assert_array_equal(part.folds, folds[kept])


def test_a_known_distance_counts_as_much_as_all_visits_not_as_those_of_a_part(tmp_path):
    whole = replace(touched(tmp_path, rows=50), socket_distance=0.1, socket_pairs=((1, 2),))
    part = whole.select(np.arange(0, len(whole), 2))
    assert {1, 2} <= set(part.socket.tolist())
    found, _ = searched(part, SMALL)
    model, solution = on_all_rows(found, whole, np.ones(len(whole)))
    own = build_model(whole)
    [resumed], [fresh] = (
        Mapped(problem).shared(own.started(solution.by_name)[: problem.size])[0]
        for problem in (build_model(whole, nuisance=model.nuisance).problem, own.problem)
    )
    assert resumed == pytest.approx(fresh)
    assert abs(fresh) > 0.0


def test_a_stated_distance_of_sockets_that_is_wrong_is_blamed_and_not_the_links(tmp_path):
    touching = recorded(faultless(rows=60, seed=3, observation="fixed_point"), tmp_path)[0]
    told, _ = searched(touching, (*SMALL, SensorScale))
    assert SensorScale not in {type(c.effect) for c in told.pool.candidates}
    place = told.best.by_name
    one, two = (np.array([place[f"socket {k} {c}"] for c in "xyz"]) for k in (1, 2))
    far = 1.01 * float(np.linalg.norm(one - two))
    stated = replace(touching, socket_distance=far, socket_pairs=((1, 2),))
    found = diagnose(stated, DiagnosisOptions(library=(*SMALL, LinkGeometry, SensorScale))).verdict
    assert [cause.effect for cause in found.causes] == ["sensor_scale"]
    assert found.causes[0].parameters["x"].value == pytest.approx(0.01, rel=0.2)
    assert "sockets" in found.causes[0].variant


@pytest.mark.parametrize(("off", "gross"), [(20e-3, True), (0.8e-3, False)])
def test_a_gross_row_that_was_kept_back_is_named_and_what_is_merely_missed_counts(off, gross, bent):
    measured = bent.measured.copy()
    measured[30] += off
    spoilt = replace(bent, measured=measured, held_out=every_third(bent))
    found = diagnose(spoilt, DiagnosisOptions(library=SMALL)).verdict
    assert (32 in found.distrusted_rows) == gross
    assert (found.gap.after < 1.5 * found.gap.noise_floor) == gross


def ripples():
    return tuple(e for e in EFFECTS if e.name == "transmission_ripple")


def test_a_group_that_holds_nearly_all_rows_is_not_left_out(bent):
    lopsided = replace(bent, group=(np.arange(len(bent)) == 0).astype(np.int64))
    assert kind_of_folds(lopsided, "auto") == "rows"
    assert diagnose(lopsided, DiagnosisOptions(library=SMALL)).verdict.gap.held_out_by == "rows"


def test_a_verdict_whose_rows_left_out_are_far_off_is_not_explained(bent):
    lopsided = replace(bent, group=(np.arange(len(bent)) == 0).astype(np.int64))
    verdict = diagnose(lopsided, DiagnosisOptions(library=SMALL, held_out="groups")).verdict
    assert verdict.gap.after > 2 * verdict.gap.noise_floor
    assert verdict.verdict != "explained"
    assert any("times their noise" in note for note in verdict.notes)


def test_a_bump_in_one_stretch_is_foretold_by_rows_in_between(tmp_path):
    """Nothing in other stretches foretells it, so rows in between are left out."""
    knock = RealBump(0.0, (1.0, 0.4, 0.2, 0.0, 0.0, 0.0), moment=0.5)
    case = with_fault(faultless(rows=60, seed=5), knock, gap=8.0)
    recording, _ = recorded(case, tmp_path)
    verdict = diagnose(recording, FEW_EFFECTS).verdict
    assert [c.effect for c in verdict.causes] == ["base_bump"]
    assert verdict.verdict == Outcome.EXPLAINED
    assert verdict.gap.held_out_by == "rows"
    assert verdict.gap.after < 1.15 * verdict.gap.noise_floor
    assert verdict.outside_probability < 0.2


def test_poses_learn_their_rotation_s_noise_however_many_they_are(tmp_path):
    poses, _ = recorded(faultless(rows=40, seed=3, observation="pose"), tmp_path)
    many = poses.select(np.zeros(MANY_ROWS + 1, dtype=int))
    assert [_lever_unknown(r) for r in (poses, many)] == [True, True]
    stated = replace(many, noise_std=1e-4, noise_std_rotation=1e-3)
    assert not _lever_unknown(stated)


# Rows on a path


def wave(count=120):
    """Joint angles (N, 6) that go to and fro, so that play lags."""
    t = np.linspace(0.0, 6 * np.pi, count)[:, None]
    return np.sin(t + np.arange(6)) * np.linspace(1.0, 0.3, count)[:, None]


def test_a_path_does_not_depend_on_which_of_its_rows_are_looked_at(bent):
    path = replace(bent.select(np.zeros(120, dtype=int)), q=wave())
    play = Hysteresis(joint=2, width=0.2)
    whole = rows_of(path, [play])
    for chosen in (np.arange(0, 120, 7), np.arange(40, 80)):
        np.testing.assert_array_equal(rows_of(path.select(chosen), [play]), whole[chosen])
    twice = path.select(np.arange(0, 120, 2)).select(np.arange(5, 50))
    np.testing.assert_array_equal(rows_of(twice, [play]), whole[10:100:2])


def test_rows_whose_angles_were_changed_are_a_path_of_their_own(bent):
    path = replace(bent.select(np.zeros(120, dtype=int)), q=wave())
    moved = replace(path.select(np.arange(0, 120, 3)), q=wave(40))
    alone = replace(bent.select(np.zeros(40, dtype=int)), q=wave(40))
    play = [Hysteresis(joint=2, width=0.2)]
    np.testing.assert_array_equal(rows_of(moved, play)[:, -1], rows_of(alone, play)[:, -1])


def test_thinning_a_motion_does_not_make_it_stand_still(bent):
    fine = replace(bent.select(np.zeros(2000, dtype=int)), q=wave(2000))
    assert scope_of(fine).moving
    assert scope_of(fine.select(np.arange(0, 2000, 40))).moving


# Readings that repeat one another


def from_both_sides(seed, tmp_path, **context):
    """Twenty postures three times each from both sides, with play in joint 2; noise not stated."""
    rng = np.random.default_rng(seed)
    case = faultless(rows=120, seed=seed)
    session = case.scene.session
    posture = np.repeat(np.arange(20), 6)
    side = np.tile([1.0, 1.0, 1.0, -1.0, -1.0, -1.0], 20)[:, None] * np.ones((1, 6))
    q = session.q[posture]
    order = rng.permutation(120)
    session = replace(session, q=q[order], direction=side[order])
    case = replace(case, scene=replace(case.scene, session=session, q=q[order]))
    case = with_fault(case, RealBacklash(1e-3, 2), gap=8.0)
    return case, replace(recorded(case, tmp_path)[0], noise_std=None)


def test_what_a_side_of_approach_does_is_no_noise(tmp_path):
    case, recording = from_both_sides(4, tmp_path)
    noise = diagnose(recording, DiagnosisOptions(library=(*SMALL, Backlash))).verdict.noise
    assert noise.source == "repeats"
    assert noise.repeats >= 80
    assert noise.sigma == pytest.approx(case.noise_std, rel=0.15)


def test_both_sides_of_an_approach_are_no_repeats_even_where_nothing_explains_them(tmp_path):
    case, recording = from_both_sides(4, tmp_path)
    noise = diagnose(recording, DiagnosisOptions(library=SMALL)).verdict.noise
    assert noise.source == "repeats"
    assert noise.sigma == pytest.approx(case.noise_std, rel=0.15)
    assert noise.ratio > 2.0


def test_repeats_never_count_for_more_than_the_fit_leaves(tmp_path):
    _, recording = from_both_sides(4, tmp_path)
    blind = replace(recording, direction=None)
    found = diagnose(blind, DiagnosisOptions(library=(*SMALL, Backlash)))
    assert found.verdict.noise.ratio > 0.8
