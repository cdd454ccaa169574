"""The three-marker paper made again: its points, its order of triples, and honest bookkeeping."""

import json

import numpy as np
import pytest

from plumbline.experiments.commands.app import run as command
from plumbline.experiments.reproduce import registration
from plumbline.experiments.reproduce.registration_pointing import ANGLES, pointed, widest_arc
from plumbline.experiments.reproduce.registration_trial import (
    LESIONS,
    MARKERS,
    PITCH,
    PUBLISHED,
    Trial,
    axis_tilt,
    least_squares_once,
    published_errors,
    published_frame,
    three_point_once,
)
from plumbline.optim.pointing import Status
from plumbline.optim.registration import Kabsch, ThreePoint, condition_of

DRAWS = 1000


@pytest.fixture(scope="module")
def found():
    """The reproduction with fewer draws."""
    return registration.run(1, draws=DRAWS)


def test_the_published_points_are_made_again_to_six_hundredths_of_a_millimetre(found):
    assert found.figures["tip_error"]["value"] <= 0.06
    assert found.figures["top_error"]["value"] <= 0.06
    assert found.figures["lesion_error"]["value"] <= 0.06


def test_a_published_point_that_were_elsewhere_would_be_noticed(monkeypatch):
    moved = PUBLISHED + np.array([(0, 0, 0), (0, 0, 0), (0, 0, 1e-3)])
    monkeypatch.setattr("plumbline.experiments.reproduce.registration_trial.PUBLISHED", moved)
    assert max(published_errors(published_frame())) > 2e-4


def test_the_frame_turns_ct_upside_down_and_nothing_else():
    T = published_frame()
    np.testing.assert_allclose(T[2, :3], [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert abs(np.degrees(axis_tilt())) < 0.01


def test_the_published_sines_of_the_triples_are_those_of_table_1():
    points = {name: MARKERS[name] for name in MARKERS}
    sine = {t: condition_of(np.array([points[name] for name in t])).sine for t in ("ABC", "ACD")}
    assert sine["ABC"] == pytest.approx(0.987, abs=5e-4)
    assert sine["ACD"] == pytest.approx(0.165, abs=5e-4)


def test_a_b_c_stays_within_three_millimetres_and_a_c_d_is_worst(found):
    errors = {k: v["value"] for k, v in found.figures["localisation_error"].items()}
    triples = {name: value for name, value in errors.items() if len(name) == 5}
    assert len(triples) == 10
    assert triples["A-B-C"] < 3.0
    assert max(triples, key=triples.get) == "A-C-D"


def test_five_markers_are_best_among_least_squares(found):
    errors = {k: v["value"] for k, v in found.figures["localisation_error"].items()}
    plain = {k: v for k, v in errors.items() if k.startswith("least squares")}
    assert len(plain) == 3
    assert min(plain, key=plain.get) == "least squares A-B-C-D-E"


def test_predicted_regions_hold_what_they_promise(found):
    coverage = found.figures["tre_coverage"]
    assert 0.92 <= coverage["value"] <= 0.975  # of 1000 draws
    assert set(coverage["by_set"]) == set(found.figures["localisation_error"])


def test_the_tool_centre_point_stays_on_the_lesion(found):
    assert found.figures["rcm_error"]["value"] <= 0.01
    assert set(found.figures["rcm_error"]["by_arm"]) == {"ur3", "ur5"}


def test_time_is_told_for_every_number_of_markers(found):
    ratios = found.figures["time_ratio"]
    assert len(ratios) == 3
    assert all(r["value"] > 0 and r["batch"] > 0 and "paper" in r for r in ratios.values())


def test_what_is_timed_one_by_one_finds_what_the_library_finds():
    trial = Trial.drawn(published_frame(), 5, np.random.default_rng(0), normal=False)
    for names, once, method in (
        ("BCD", three_point_once, ThreePoint()),
        ("ABC", least_squares_once, Kabsch()),
        ("ABCDE", least_squares_once, Kabsch()),
    ):
        singly = [once(c, r) for c, r in zip(*trial.chosen(names), strict=True)]
        np.testing.assert_allclose(singly, trial.found(method, names), atol=1e-12)


def test_the_budget_adds_up(found):
    parts = {name: f["value"] for name, f in found.figures["budget"].items()}
    phantom = [parts[name] for name in ("calculation", "control", "needle")]
    assert parts["total, phantom"] == pytest.approx(np.linalg.norm(phantom))
    assert parts["total"] == pytest.approx(np.hypot(parts["total, phantom"], parts["breathing"]))
    assert found.figures["calculation_error"]["paper"] == 1.43


def test_notes_say_that_tables_are_lost_and_what_is_assumed(found):
    said = " ".join(found.notes)
    for words in ("lost", "simulated", "assumed", "out of reach", "does not hold"):
        assert words in said


def test_without_noise_every_triple_is_exact():
    T = published_frame()
    still = Trial.drawn(T, 3, np.random.default_rng(0), normal=False)
    points = np.array(list(MARKERS.values()))
    exact = Trial(
        T, 0 * still.ct + points, points @ T[:3, :3].T + T[:3, 3] + 0 * still.robot, 0 * still.own
    )
    for names, method in (("ABC", ThreePoint()), ("CDE", ThreePoint()), ("ABCDE", Kabsch())):
        found = exact.found(method, names)
        assert max(np.abs(exact.errors(found, lesion)).max() for lesion in LESIONS) < 1e-12
        assert exact.calculation_errors(found).max() < 1e-12


def test_draws_have_the_stated_resolutions_and_follow_the_seed():
    T, points = published_frame(), np.array(list(MARKERS.values()))
    for normal in (False, True):
        one, two = (Trial.drawn(T, 4000, np.random.default_rng(3), normal=normal) for _ in "ab")
        np.testing.assert_array_equal(one.ct, two.ct)
        std = (one.ct - points).std(axis=(0, 1))
        np.testing.assert_allclose(std, PITCH / np.sqrt(12.0), rtol=0.03)
    uniform = Trial.drawn(T, 100, np.random.default_rng(3), normal=False)
    assert (np.abs(uniform.ct - points) <= PITCH / 2).all()


def test_the_widest_arc_is_safe_and_unbroken():
    p = pointed("ur3", published_frame(), repeats=1)
    theta, beta = widest_arc(p.found)
    assert len(beta) == ANGLES
    ring = p.found.safe[np.flatnonzero(p.found.theta == theta)[0]]
    step = p.found.beta[1] - p.found.beta[0]
    turns = np.round(beta[[0, -1]] / step).astype(int) % len(ring)
    assert ring[turns].all()
    assert p.sweep.is_safe
    assert p.published.status == (Status.REACH,)


def test_the_command_prints_figures_for_machines(found, monkeypatch, tmp_path):
    monkeypatch.setattr(registration, "run", lambda seed, progress: found)
    target = tmp_path / "out.json"
    assert command(["reproduce", "registration", "--json", str(target)]) == 0
    figures = json.loads(target.read_text())
    keys = {"tip_error", "top_error", "rcm_error", "localisation_error", "tre_coverage"}
    assert keys | {"time_ratio", "source"} <= set(figures)
