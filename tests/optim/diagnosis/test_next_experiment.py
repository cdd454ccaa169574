"""Laws of the next experiment: what its rows separate, where they lie, what is forecast of them."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from plumbline.experiments.commands.app import run
from plumbline.experiments.commands.next import in_new_groups, table_to_fill, told_apart
from plumbline.experiments.reality import Plan, draw_case, simulate, write
from plumbline.experiments.reality.cases import OBSERVATIONS
from plumbline.experiments.reality.recorder import extended, read_on
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.design.course import Course
from plumbline.optim.diagnosis.design.explanations import LeadingExplanation, contest, explanations
from plumbline.optim.diagnosis.design.future_rows import (
    LIMITS,
    RECORDED,
    changed_in_one,
    draw_rows,
    joint_range,
)
from plumbline.optim.diagnosis.design.next_experiment import (
    NextExperiment,
    Suggestion,
    _still,
    next_experiment,
)
from plumbline.optim.diagnosis.design.rows import Design, DesignOptions
from plumbline.optim.diagnosis.design.separation import (
    Beliefs,
    Rivals,
    at_random,
    divergences,
    expected_probabilities,
    resolution,
)
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Blame
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import MANY_CAUSES
from plumbline.optim.recording.loading import load_recording
from tests.few_effects import FEW_EFFECTS
from tests.made_up_diagnosis import BENCH
from tests.recording_folders import KINDS, columns, csv_text, slider_columns, write_folder

WEAK = Plan(gap=(0.3, 0.7), rows=(25, 50))
QUICK = DesignOptions(count=6, pool=200, glance=100, rivals=4, compare=False)
CRITERIA = {"resolution": resolution, "at_random": partial(at_random, 3)}


def random_rivals(count=3, size=4, seed=0):
    """Rivals with covariances of full rank, but for one unknown that each lacks."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(count, size, size))
    keep = np.ones((count, size))
    keep[np.arange(count), np.arange(count) % size] = 0.0
    C = np.einsum("ipq,irq,ip,ir->ipr", roots, roots, keep, keep)
    p = rng.dirichlet(np.ones(count))
    labels = tuple(f"rival {i}" for i in range(count))
    return Rivals(labels, p, rng.normal(size=(count, size)) * keep, C)


def gaussian(rivals, i, J):
    """Mean and covariance of all readings of some rows (N, m, P) under one rival."""
    flat = J.reshape(-1, J.shape[-1])
    return flat @ rivals.means[i], flat @ rivals.covariances[i] @ flat.T + np.eye(len(flat))


def divergence_of(one, two):
    """Kullback-Leibler divergence of Gaussians, straight from the formula."""
    (a, A), (b, B) = one, two
    inverse, size = np.linalg.inv(B), np.linalg.slogdet(B)[1] - np.linalg.slogdet(A)[1]
    return 0.5 * (np.trace(inverse @ A) - len(a) + (b - a) @ inverse @ (b - a) + size)


def gathered(rivals, J):
    """Beliefs after some rows (N, m, P)."""
    beliefs = Beliefs.of(rivals)
    for row in J:
        beliefs = beliefs.after(row)
    return beliefs


# Criteria, against brute force


def test_divergences_of_rows_one_after_another_are_those_of_all_together():
    rivals, J = random_rivals(), np.random.default_rng(1).normal(size=(4, 2, 4))
    beliefs = gathered(rivals, J)
    laws = [gaussian(rivals, i, J) for i in range(3)]
    expected = [[divergence_of(one, two) for two in laws] for one in laws]
    np.testing.assert_allclose(beliefs.information, expected, rtol=1e-9, atol=1e-9)


def test_what_a_row_adds_is_the_difference_that_it_makes():
    rivals, J = random_rivals(), np.random.default_rng(2).normal(size=(6, 2, 4))
    beliefs = gathered(rivals, J[:3])
    added = divergences(beliefs, J[3:])
    for k in range(3):
        after = beliefs.after(J[3 + k]).information - beliefs.information
        np.testing.assert_allclose(added[..., k], after, rtol=1e-9, atol=1e-12)


def box_hill(rivals, J):
    """Divergence of every pair, weighted by both probabilities, row by row, from the formula."""
    p, pairs = rivals.probabilities, list(np.ndindex(3, 3))
    for row in J:
        laws = [gaussian(rivals, i, row[None]) for i in range(3)]
        yield sum(p[i] * p[j] * divergence_of(laws[i], laws[j]) for i, j in pairs)


def test_the_bounded_form_is_box_hill_where_little_is_told_and_never_beats_all_doubt():
    rivals, J = random_rivals(), np.random.default_rng(4).normal(size=(20, 2, 4))
    beliefs = Beliefs.of(rivals)
    faint = 1e-3 * J
    expected = list(box_hill(rivals, faint))
    np.testing.assert_allclose(resolution(beliefs, faint), expected, rtol=1e-3)
    p = rivals.probabilities
    assert (resolution(beliefs, 1e3 * J) <= -(p @ np.log(p)) + 1e-9).all()


@pytest.mark.parametrize("criterion", CRITERIA.values(), ids=CRITERIA)
def test_relabelling_the_rivals_changes_nothing(criterion):
    rivals, J = random_rivals(), np.random.default_rng(7).normal(size=(6, 2, 4))
    order = [2, 0, 1]
    other = Rivals(
        tuple(rivals.labels[i] for i in order),
        rivals.probabilities[order],
        rivals.means[order],
        rivals.covariances[order],
    )
    one, two = (criterion(gathered(r, J[:2]), J[2:]) for r in (rivals, other))
    np.testing.assert_allclose(one, two, rtol=1e-9)


@pytest.mark.parametrize("criterion", CRITERIA.values(), ids=CRITERIA)
def test_another_basis_of_the_unknowns_changes_nothing(criterion):
    rivals, J = random_rivals(), np.random.default_rng(8).normal(size=(6, 2, 4))
    T = np.random.default_rng(9).normal(size=(4, 4))
    back = np.linalg.inv(T)
    other = replace(
        rivals,
        means=rivals.means @ T.T,
        covariances=T @ rivals.covariances @ T.T,
    )
    one = criterion(gathered(rivals, J[:2]), J[2:])
    two = criterion(gathered(other, J[:2] @ back), J[2:] @ back)
    np.testing.assert_allclose(one, two, rtol=1e-6)


# The forecast


def test_the_forecast_is_bayes_rule_on_drawn_readings():
    rivals, J = random_rivals(), 0.5 * np.random.default_rng(10).normal(size=(3, 2, 4))
    gram = sum(row.T @ row for row in J)
    found = expected_probabilities(rivals, gram, draws=20_000)
    rng, laws = np.random.default_rng(11), [gaussian(rivals, i, J) for i in range(3)]
    for i, (mean, C) in enumerate(laws):
        y = rng.multivariate_normal(mean, C, 20_000)
        logs = [np.log(rivals.probabilities[j]) + log_density(y, *laws[j]) for j in range(3)]
        weights = np.exp(np.array(logs) - np.max(logs, axis=0))
        np.testing.assert_allclose(
            found[i], (weights / weights.sum(axis=0)).mean(axis=1), atol=0.01
        )


def log_density(y, mean, C):
    """Log density (D,) of readings, but for a constant."""
    left = y - mean
    square = np.einsum("da,ab,db->d", left, np.linalg.inv(C), left)
    return -0.5 * (square + np.linalg.slogdet(C)[1])


def test_the_expected_probabilities_average_to_those_before():
    rivals, J = random_rivals(), np.random.default_rng(12).normal(size=(3, 2, 4))
    found = expected_probabilities(rivals, sum(r.T @ r for r in J), draws=20_000)
    np.testing.assert_allclose(rivals.probabilities @ found, rivals.probabilities, atol=0.01)


def test_rows_that_tell_nothing_change_no_probability():
    rivals = random_rivals()
    found = expected_probabilities(rivals, np.zeros((4, 4)))
    np.testing.assert_allclose(found, np.tile(rivals.probabilities, (3, 1)), rtol=1e-12)


# Designed rows on recordings


def recorded(plan, seed, folder):
    """A recording of a simulated case."""
    write(folder / "case", simulate(draw_case(plan, "case", seed))[0])
    return load_recording(folder / "case")


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    """A diagnosis that leaves much open: play, path, clock and temperature among the rivals."""
    return diagnose(recorded(WEAK, 4, tmp_path_factory.mktemp("weak")))


@pytest.fixture(scope="module")
def rivals_of_weak(weak):
    return contest(weak.selected, explanations(weak.selected, 4))


def greedy(criterion, rivals, J, count):
    """Divergence that rows of a pool (N, m, P) reach, chosen one after another."""
    beliefs, free = Beliefs.of(rivals), np.ones(len(J), dtype=bool)
    for _ in range(count):
        best = int(np.argmax(np.where(free, criterion(beliefs, J), -np.inf)))
        beliefs, free[best] = beliefs.after(J[best]), False
    return beliefs.information[0, 1]


def test_designed_rows_separate_two_rivals_that_random_rows_do_not():
    """One row in fifty sees where they differ; what both are unsure of, every row sees."""
    rng = np.random.default_rng(13)
    J = rng.normal(size=(400, 2, 5))
    J[:, :, 0] = np.where(np.arange(400) % 50 == 0, 1.0, 0.0)[:, None]
    means, C = np.zeros((2, 5)), np.tile(np.diag([0.0, 1.0, 1.0, 1.0, 1.0]), (2, 1, 1))
    means[1, 0] = 2.0
    rivals = Rivals(("none", "one"), np.array([0.6, 0.4]), means, C)
    random = [greedy(partial(at_random, seed), rivals, J, 8) for seed in range(20)]
    assert greedy(resolution, rivals, J, 8) > 6.0
    assert np.median(random) < 0.1


def test_designed_rows_of_a_recording_tell_more_than_random_ones(weak):
    """Rows chosen for a fine ripple stand at its crests."""
    selection = weak.selected.selection
    fine = [c.effect.name for c in selection.candidates].index("gear_ripple")
    both = ((), (SelectedTerm(fine, 1.0),))
    pair = contest(weak.selected, tuple(LeadingExplanation.of(selection, one, 0.5) for one in both))
    p, rivals = pair.model.problem, pair.rivals
    tilt = next(k for k, name in enumerate(p.names) if name.startswith("gear_ripple"))
    means, C = np.zeros((2, p.size)), np.tile(rivals.covariances[0], (2, 1, 1))
    means[1, tilt] = 1.0
    made = Rivals(("none", "tilt"), np.array([0.5, 0.5]), means, C)
    told = {}
    for criterion in (resolution, *(partial(at_random, seed) for seed in range(12))):
        chosen = Design.of(replace(pair, rivals=made), replace(QUICK, criterion=criterion))
        told[criterion] = chosen.choose().beliefs.information[1, 0]
    by_chance = np.mean([told[c] for c in told if c is not resolution])
    assert told[resolution] > 1.5 * by_chance


@pytest.mark.parametrize("within", [RECORDED, LIMITS])
def test_rows_lie_within_the_joints_range(weak, within):
    rows = draw_rows(weak.recording, 300, 0, within=within)
    lower, upper = joint_range(weak.recording, within)
    assert len(rows) == 300
    assert ((rows.q >= lower) & (rows.q <= upper)).all()
    assert set(np.unique(rows.direction)) == {-1.0, 1.0}
    chain = weak.recording.chain
    inside = (weak.recording.q >= chain.lower) & (weak.recording.q <= chain.upper)
    if inside.all():
        assert ((rows.q >= chain.lower) & (rows.q <= chain.upper)).all()


@pytest.mark.parametrize("which", range(5))
def test_a_row_is_changed_in_one_joint_or_one_side_at_a_time(weak, which):
    recording = weak.recording
    row = draw_rows(recording, 5, 3).select([which])
    others = changed_in_one(recording, row, [which])
    assert len(others) > 10
    joints, sides = others.q != row.q, others.direction != row.direction
    assert (joints.sum(axis=1) + sides.sum(axis=1) == 1).all()
    assert sides.any(axis=0).all(), "every joint's side is turned round"
    assert (others.velocity == np.where(sides, -row.velocity, row.velocity)).all()
    np.testing.assert_array_equal(others.wait, np.repeat(row.wait, len(others)))
    lower, upper = joint_range(recording, RECORDED)
    assert ((others.q >= lower) & (others.q <= upper)).all()
    assert not tips_outside(recording, others)


def test_a_row_that_was_exchanged_is_worth_more_than_what_it_was_drawn_as(rivals_of_weak):
    worth = []
    for exchanges in (0, 1, 6):
        design = Design.of(rivals_of_weak, replace(QUICK, count=1, exchanges=exchanges))
        beliefs = Beliefs.of(rivals_of_weak.rivals)
        J = design.jacobians(Course(rivals_of_weak.model).rows_next(design.choose().rows))
        worth.append(float(design.options.criterion(beliefs, J)[0]))
    assert worth[0] < worth[1] < worth[2]


def test_tips_stay_where_the_device_has_seen_them(weak):
    assert not tips_outside(weak.recording, draw_rows(weak.recording, 300, 0))


def tips_outside(recording, rows):
    """How many rows have a tip out of the box that it has been in."""
    tips, known = (
        (T[:, :3, :3] @ recording.tool_offset + T[:, :3, 3])
        for T in map(recording.chain.placement, (rows.q, recording.q))
    )
    inside = (tips > known.min(axis=0) - 1.1e-6) & (tips < known.max(axis=0) + 1.1e-6)
    return int((~inside.all(axis=1)).sum())


def test_the_same_seed_gives_the_same_rows(weak):
    one, two = (next_experiment(weak.selected, weak.verdict, QUICK) for _ in range(2))
    assert one == two
    other = next_experiment(weak.selected, weak.verdict, replace(QUICK, seed=1))
    assert other.rows != one.rows


def test_rows_are_no_copies_of_each_other(weak):
    found = next_experiment(weak.selected, weak.verdict, QUICK)
    assert len({row.pose for row in found.rows}) == QUICK.count


def test_no_group_holds_all_rows(weak):
    found = next_experiment(weak.selected, weak.verdict, QUICK)
    groups = {row.group for row in found.rows}
    assert groups <= set(weak.recording.group.tolist())
    assert len(groups) == min(QUICK.count, len(np.unique(weak.recording.group)))


def test_designed_rows_are_forecast_to_beat_random_ones(weak):
    options = replace(QUICK, count=12, compare=True)
    forecast = next_experiment(weak.selected, weak.verdict, options).forecast
    assert forecast.before < forecast.random < forecast.after
    assert forecast.random_rows is None or forecast.random_rows > 12
    assert forecast.leading in forecast.words


def test_rests_together_are_no_longer_than_allowed(weak, rivals_of_weak, monkeypatch):
    monkeypatch.setattr(Course, "is_timed", True)
    chosen = Design.of(rivals_of_weak, replace(QUICK, patience=0.4)).choose()
    assert chosen.rows.wait.sum() <= 0.4 * np.ptp(weak.recording.time) + 1e-6


def test_nobody_rests_where_time_tells_nothing(rivals_of_weak, monkeypatch):
    """The rivals know of no clock: a rest would be time lost."""
    monkeypatch.setattr(Course, "is_timed", True)
    timed = [t for t in rivals_of_weak.model.terms if {"time", "temperature"} & set(t.effect.needs)]
    chosen = Design.of(rivals_of_weak, QUICK).choose()
    assert not timed
    assert not chosen.rows.wait.any()


def test_a_row_after_another_reads_as_it_would_in_the_whole_recording(rivals_of_weak):
    course = Course(rivals_of_weak.model)
    rows = draw_rows(rivals_of_weak.model.recording, 5, 1)
    together = course.rows_in_order(rows)
    at_once = course.rows_next(rows)
    for k in range(5):
        np.testing.assert_allclose(course.rows_next(rows.select([k]))[0], at_once[k], atol=1e-12)
    for k in range(5):
        alone = course.rows_next(rows.select([k]))
        np.testing.assert_allclose(alone[0], together[k], rtol=1e-12, atol=1e-12)
        course = course.then(rows.select([k]))


def test_derivatives_of_rows_to_come_are_those_of_the_residual(rivals_of_weak):
    model = rivals_of_weak.model
    design = Design.of(rivals_of_weak, replace(QUICK, pool=10))
    rows = Course(model).rows_next(design.pool)
    J, mapped = design.jacobians(rows), model.problem.on(rows)
    for k, step in enumerate(1e-3 * model.problem.scale):
        shift = step * np.eye(len(model.start))[k]
        ahead, behind = (Mapped(mapped).residuals(model.start + s * shift) for s in (1, -1))
        slope = (ahead - behind) / 2e-3 / rivals_of_weak.sigma
        np.testing.assert_allclose(J[:, :, k], slope, rtol=2e-3, atol=1e-2 * np.abs(J).max() * 1e-3)


def test_where_nothing_is_open_there_are_no_rows_but_a_sentence(weak):
    alone = next_experiment(weak.selected, weak.verdict, replace(QUICK, rivals=1))
    assert alone.rows == ()
    assert alone.forecast is None
    assert "nothing to separate" in alone.notes[0]


def test_an_explanation_is_as_probable_as_all_states_with_its_causes(weak):
    """Its best state speaks for it; what is less probable than one in a hundred is not told."""
    candidates = weak.selected.selection.candidates
    keys = [c.key for c in candidates]
    one = next(i for i, key in enumerate(keys) if keys.count(key) > 1)
    other = keys.index(keys[one], one + 1)
    third = next(i for i, key in enumerate(keys) if key != keys[one])
    logs = np.log([0.4, 0.3, 0.295, 0.005])
    terms = (
        (),
        (SelectedTerm(one, 1.0),),
        (SelectedTerm(other, 2.0),),
        (SelectedTerm(third, 1.0),),
    )
    made = replace(weak.selected, states=tuple(zip(logs.tolist(), terms, strict=True)))
    found = explanations(made)
    assert [e.terms for e in found] == [terms[1], ()]
    assert [e.probability for e in found] == pytest.approx([0.595, 0.4])


def test_of_very_many_causes_no_others_are_weighed_and_one_note_says_so(weak):
    keys = {c.key: i for i, c in enumerate(weak.selected.selection.candidates)}
    many = tuple(SelectedTerm(i, 1.0) for i in list(keys.values())[: MANY_CAUSES + 1])
    found = next_experiment(replace(weak.selected, chosen=many, states=()), weak.verdict, QUICK)
    assert found.rows == ()
    assert "more than 6 causes" in found.notes[0]


def test_an_effect_of_the_users_own_is_called_by_its_stage(weak):
    class OwnScale(JointScale):
        """An effect that the package's library does not have."""

        name = "own_scale"

    again = diagnose(weak.selected.model.recording, DiagnosisOptions(library=(OwnScale,)))
    labels = {e.label for e in explanations(again.selected, 30)}
    assert any(label.startswith("own_scale of joint ") for label in labels)


def test_a_column_that_is_missing_is_asked_for(weak):
    found = next_experiment(weak.selected, blind_to_latency(weak.verdict), QUICK)
    assert any("velocity1" in note and "latency" in note for note in found.notes)


def test_without_sides_or_speeds_the_side_of_approach_is_asked_for(weak):
    model = weak.selected.model
    bare = replace(model.recording, direction=None, velocity=None)
    found = replace(weak.selected, model=replace(model, recording=bare))
    notes = next_experiment(found, weak.verdict, replace(QUICK, rivals=1)).notes
    assert any("which way each joint came last" in note and "backlash" in note for note in notes)


def test_of_columns_that_would_do_the_first_is_asked_for_once(weak):
    bare = replace(weak.selected.model.recording, direction=None, velocity=None)
    found = replace(weak.selected, model=replace(weak.selected.model, recording=bare))
    blame = Blame("backlash", "joint", None, "needs the column direction, or velocity")
    verdict = replace(weak.verdict, unobservable=(blame,))
    notes = next_experiment(found, verdict, replace(QUICK, rivals=1)).notes
    assert len([note for note in notes if "backlash" in note]) == 1


def test_columns_are_asked_for_by_the_names_that_a_file_has(weak):
    why = "needs the column force"
    blames = [Blame(name, "tool", None, why) for name in ("one", "two", "three")]
    verdict = replace(weak.verdict, unobservable=tuple(blames))
    notes = next_experiment(weak.selected, verdict, replace(QUICK, rivals=1)).notes
    assert any("(force_x, force_y, force_z): without it one, two and three" in n for n in notes)


def test_rows_that_would_tell_nothing_are_not_proposed(weak, monkeypatch):
    def untold(design, _):
        return ("not even many",), list(range(1, len(design.contest.rivals.labels)))

    assert next_experiment(weak.selected, weak.verdict, QUICK).rows
    monkeypatch.setattr(f"{next_experiment.__module__}._untold", untold)
    found = next_experiment(weak.selected, weak.verdict, QUICK)
    assert not found.rows
    assert found.forecast is None
    assert found.notes[0] == "not even many"


def test_a_joint_that_stood_still_is_to_be_moved(weak):
    q = weak.recording.q.copy()
    assert _still(weak.recording) == ()
    q[:, [1, 4]] = 0.3
    [note] = _still(replace(weak.recording, q=q))
    assert note.startswith("move joints 2 and 5, too (--within limits)")


def test_what_lies_outside_of_the_library_is_said_to_need_rows_of_its_own(weak):
    verdict = replace(weak.verdict, outside_probability=0.97, outside_depends_on="joint 3")
    notes = next_experiment(weak.selected, verdict, replace(QUICK, rivals=1)).notes
    assert any("outside of the library" in note and "vary joint 3 alone" in note for note in notes)


def blind_to_latency(verdict):
    """The verdict of a recording without velocities."""
    return replace(
        verdict, unobservable=(Blame("latency", "sensor", None, "needs the column velocity"),)
    )


def test_the_verdict_names_rows_where_it_is_in_doubt(weak):
    assert len(weak.verdict.next) == 12
    assert {"pose", "direction", "separates"} <= set(weak.verdict.next[0])
    json.dumps(weak.verdict.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("bad", "message"), [({"count": 0}, "count 0"), ({"count": 9, "pool": 8}, "pool 8")]
)
def test_options_that_make_no_sense_are_refused(bad, message):
    with pytest.raises(ValueError, match=message):
        DesignOptions(**bad)


@pytest.mark.parametrize("observation", ["pose", "fixed_point", "joint_position"])
def test_every_kind_of_observation_gets_rows(observation, tmp_path):
    plan = replace(WEAK, observation=observation, gap=(0.4, 0.8))
    diagnosis = diagnose(recorded(plan, 3, tmp_path), FEW_EFFECTS)
    candidates = explanations(diagnosis.selected, 3)
    chosen = Design.of(contest(diagnosis.selected, candidates), QUICK).choose()
    assert len(chosen.rows) == QUICK.count
    assert np.isfinite(chosen.gram).all()
    assert (chosen.rows.socket is not None) == (observation == "fixed_point")


# The simulator that reads on


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_reading_on_leaves_the_first_rows_as_they_were(observation):
    case = draw_case(Plan(observation=observation, rows=(20, 30), gross=0.1), "case", 5)
    q = case.scene.session.q[:4]
    sockets = None if case.sockets is None else case.sockets[:4]
    longer = read_on(case, extended(case, q, wait=np.full(4, 60.0), sockets=sockets))
    for name, values in simulate(case)[0].columns.items():
        assert len(longer.columns[name]) == case.rows + 4
        np.testing.assert_array_equal(longer.columns[name][: case.rows], values)


def test_every_reading_of_the_same_rows_has_noise_of_its_own():
    case = draw_case(Plan(rows=(20, 30), surgical=0.0), "case", 5)
    more = extended(case, case.scene.session.q[:4])
    first, same, again = (read_on(case, more, k).columns["x"] for k in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    np.testing.assert_array_equal(first[: case.rows], again[: case.rows])
    noise = np.abs(first - again)[case.rows :]
    assert np.all(noise > 0.0)
    assert np.all(noise < 20.0 * case.noise_std)


def test_a_fault_stays_the_same_whatever_is_read_next():
    """A drive stiffens with the largest load of the session, not with that of rows to come."""
    plan = Plan(effects=("joint_compliance",), rows=(20, 30), surgical=0.0, moving=0.0)
    case = replace(draw_case(plan, "case", 3), noise_std=1e-15)
    elsewhere = np.random.default_rng(0).uniform(-3.0, 3.0, (40, case.arm.joints))
    q = np.concatenate([elsewhere, case.scene.session.q])
    tables = read_on(case, extended(case, q)).columns
    tips = np.stack([tables[c] for c in "xyz"], axis=1)
    np.testing.assert_allclose(tips[-case.rows :], tips[: case.rows], atol=1e-12)


# The command


@pytest.fixture
def quick_rows(monkeypatch, weak):
    """A diagnosis is at hand."""
    from plumbline.optim.diagnosis import diagnose as diagnosis_module

    monkeypatch.setattr(diagnosis_module, "diagnose", lambda *_, **__: weak)


@pytest.fixture
def folder(tmp_path):
    return Path(shutil.copytree(BENCH, tmp_path / "bench"))


def test_the_command_prints_rows_and_writes_a_table_to_fill(quick_rows, tmp_path, capsys):
    recorded(WEAK, 4, tmp_path)
    folder = tmp_path / "case"
    out, table = tmp_path / "next.json", tmp_path / "next.csv"
    words = ["next", str(folder), "--count", "3", "--json", str(out), "--csv", str(table)]
    before = sorted(p.name for p in folder.iterdir())
    assert run(words) == 0
    found = json.loads(out.read_text())
    assert len(found["rows"]) == 3
    assert found["explanations"][0]["probability"] > 0.0
    lines = [line.split(",") for line in table.read_text().splitlines()]
    assert len(lines) == 4
    assert len({len(line) for line in lines}) == 1
    pose = [float(v) for v, c in zip(lines[1], lines[0], strict=True) if c[0] == "q" and v]
    assert pose == pytest.approx(found["rows"][0]["pose"])
    assert lines[1][lines[0].index("x")] == ""
    assert "Rows to record next" in capsys.readouterr().out
    assert sorted(p.name for p in folder.iterdir()) == before


def filled(rows, old):
    """Rows of a table to fill, with what the first rows measured in the cells left empty."""
    pairs = zip(rows, old[: len(rows)], strict=True)
    return [[cell or kept for cell, kept in zip(row, before, strict=True)] for row, before in pairs]


@pytest.mark.parametrize("order", ["as written", "turned round"])
@pytest.mark.parametrize("kind", [*KINDS, "untimed"])
def test_a_filled_table_below_the_rows_that_are_there_passes_check(kind, order, tmp_path):
    """Whatever the order of the columns, with groups, times, held-out rows and columns not read."""
    source = "tip_position" if kind == "untimed" else kind
    place = write_folder(tmp_path / "recording", source)
    table = slider_columns() if kind == "slider" else columns(source)
    bare = {} if kind == "untimed" else {"remark": np.ones(len(table["q1"]))}
    table = {k: v for k, v in (table | bare).items() if kind != "untimed" or k != "time"}
    if order == "turned round":
        table = dict(reversed(table.items()))
    samples = place / "samples.csv"
    samples.write_text(csv_text(table))
    recording = load_recording(place)
    n, last = recording.chain.n, 0 if recording.group is None else int(recording.group.max())
    rows = tuple(
        Suggestion(
            pose=tuple(recording.q[k] + 0.01),
            direction=None if recording.direction is None else (1,) * n,
            velocity=None,
            wait=None if recording.time is None else 5.0 * (k == 1),
            payload=None,
            socket=None if recording.socket is None else int(recording.socket[k]),
            separates=("a", "b"),
            group=None if recording.group is None else int(recording.group[10 * (k % 2)]),
        )
        for k in range(3)
    )
    found = NextExperiment(rows, ("a", "b"), (0.5, 0.5), None, ())
    text = table_to_fill(place, recording, in_new_groups(recording, found))
    header, *planned = [line.split(",") for line in text.splitlines()]
    old = [line.split(",") for line in samples.read_text().splitlines()]
    assert header == old[0]
    more = filled(planned, old[1:])
    samples.write_text(samples.read_text() + "".join(",".join(row) + "\n" for row in more))
    assert run(["check", str(place)]) == 0
    longer = load_recording(place)
    np.testing.assert_allclose(longer.q[-3:], [row.pose for row in rows], rtol=1e-8)
    if recording.group is not None:
        assert longer.group[-3:].tolist() == [last + 1, last + 2, last + 1]
        assert not longer.held_out[-3:].any()
    if recording.time is not None:
        assert (longer.time[-3:] - recording.time[-1]).tolist() == [2.0, 9.0, 11.0]
    empty = {name for name, cell in zip(header, planned[0], strict=True) if not cell}
    assert empty >= {"x", "y", "z"} & set(header)
    assert not empty & {"time", "held_out", "group", "socket", "direction1"}


def test_without_rows_no_table_is_written_and_one_line_says_so(
    folder, quick_rows, weak, tmp_path, capsys, monkeypatch
):
    from plumbline.optim.diagnosis.design import next_experiment as module

    nothing = NextExperiment((), ("a",), (1.0,), None, ("nothing to separate",))
    monkeypatch.setattr(module, "next_experiment", lambda *given: nothing)
    table = tmp_path / "next.csv"
    assert run(["next", str(folder), "--csv", str(table), "--json", "-"]) == 0
    assert not table.exists()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "no rows to propose" in said


def test_a_quiet_command_says_nothing(folder, quick_rows, capsys):
    assert run(["next", str(folder), "--quiet", "--count", "2"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("option", ["--csv", "--json"])
def test_nothing_is_written_into_the_recording(folder, option, capsys):
    assert run(["next", str(folder), option, str(folder / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "never written" in said


def test_a_folder_that_is_no_recording_ends_with_one_line(tmp_path, capsys):
    assert run(["next", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_explanations_say_once_what_they_share():
    ripple, sag = "transmission_ripple of joint 2", "needle_sag"
    assert told_apart([ripple, f"{sag} and {ripple}"]) == ([ripple], ["nothing more", f"+ {sag}"])
    assert told_apart([ripple, sag]) == ([], [ripple, sag])
    assert told_apart([f"{sag} and {ripple}"]) == ([], [f"{sag} and {ripple}"])
    many = " and ".join(f"backlash of joint {k}" for k in range(1, 8))
    shared, labels = told_apart([sag, many])
    assert shared == []
    assert labels[1].endswith("joint 3 and 4 more")
