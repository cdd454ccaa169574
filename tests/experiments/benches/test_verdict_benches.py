"""The benches of verdicts see what they are for: held against stand-ins that are right or wrong."""

from __future__ import annotations

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.benches import ar1, consistency, simulation_based
from plumbline.experiments.benches.asking import probability_of, thinned
from plumbline.experiments.benches.consistency import Heard, compared, halves, rms, tables
from plumbline.experiments.benches.simulation_based import BINS, Truth, histogram
from plumbline.experiments.console.measured import plain
from plumbline.optim.recording.recording import Recording
from tests.benches import bench


def a_verdict(word: str = "explained", *causes: dict, **more: object) -> dict:
    """A verdict's JSON by hand."""
    return {"verdict": word, "causes": list(causes), "outside_probability": 0.0, **more}


def a_cause(effect: str, element: int | None, p: float = 0.99, **values: tuple) -> dict:
    """A cause by hand; parameters are value and standard error [rad]."""
    stated = {k: {"value": v, "std": s, "unit": "rad"} for k, (v, s) in values.items()}
    return {"effect": effect, "element": element, "probability": p, "parameters": stated}


# The same robot again


ARM = bench("ur5", "tip_position")


def heard(name: str, *causes: dict, **more: object) -> Heard:
    """A recording and what was said of it."""
    return Heard(name, ARM, a_verdict("explained", *causes, **more))


def test_z_is_the_difference_over_its_stated_error() -> None:
    one = heard("a", a_cause("joint_offset", 2, offset=(1e-3, 3e-5)))
    other = heard("b", a_cause("joint_offset", 2, offset=(1.1e-3, 4e-5)))
    pair = compared(one, other)
    assert [s["parameter"] for s in pair.shared] == ["joint_offset 2 offset [rad]"]
    assert rms(pair.z) == pytest.approx(2.0)
    assert pair.gone == []
    both = tables((pair, compared(one, one)))
    assert both["RMS z of all"] == pytest.approx(2.0 / np.sqrt(2.0))


def test_other_variants_elements_and_parameters_without_error_are_not_shared() -> None:
    stated = a_cause("joint_offset", 2, offset=(1e-3, 3e-5))
    for other in (
        a_cause("joint_offset", 3, offset=(1e-3, 3e-5)),
        {**stated, "variant": "another"},
        a_cause("joint_offset", 2, other=(1e-3, 3e-5)),
    ):
        assert compared(heard("a", stated), heard("b", other)).z == []
    bare = a_cause("joint_offset", 2, offset=(1e-3, 0.0))
    assert compared(heard("a", bare), heard("b", bare)).shared == []


def test_a_cause_comes_and_goes_where_the_other_recording_could_show_it() -> None:
    sure = heard("a", a_cause("joint_offset", 2))
    assert [(g["cause"], g["sure in"], g["tied"]) for g in compared(heard("b"), sure).gone] == [
        ("joint_offset 2", "a", False)
    ]
    blind = heard("b", unobservable=[{"effect": "joint_offset", "element": 2}])
    listed = heard("b", candidates=[a_cause("joint_offset", 2, 0.06)])
    half_sure = heard("a", a_cause("joint_offset", 2, 0.94))
    for one, other in ((sure, blind), (sure, listed), (half_sure, heard("b"))):
        assert compared(one, other).gone == []
    without_time = Heard("b", bench("ur5", "tip_position", columns=()), a_verdict())
    assert compared(heard("a", a_cause("base_drift", None)), without_time).gone == []
    assert len(compared(heard("a", a_cause("base_drift", None)), heard("b")).gone) == 1


def test_what_the_other_cannot_tell_apart_is_a_tie() -> None:
    rival = a_cause("base_compliance", None) | {
        "confounded_with": [{"effect": "joint_compliance", "element": 2}]
    }
    pair = compared(heard("a", a_cause("joint_compliance", 2)), heard("b", rival))
    found = tables((pair,))["the same robot recorded again"]
    assert [g["tied"] for g in pair.gone] == [True, False]  # the other way round it says nothing
    assert found[["come and go", "tied"]].to_numpy().tolist() == [[1, 1]]


def test_halves_and_thinned_rows_are_parts_in_order() -> None:
    first, second = halves(ARM)
    np.testing.assert_array_equal(np.vstack([first.q, second.q]), ARM.q)
    assert thinned(ARM, 0) is ARM
    few = thinned(ARM, 10).q
    assert len(few) == 10
    np.testing.assert_array_equal(few[[0, -1]], ARM.q[[0, -1]])


def test_every_two_recordings_and_both_halves_of_a_long_one_are_compared() -> None:
    long = bench("ur5", "joint_position", q=np.tile(ARM.q, (5, 1)))
    asked: list[int] = []

    def ask(recording: Recording) -> dict:
        asked.append(len(recording))
        return a_verdict()

    pairs = consistency.pairs_of({"a": ARM, "b": long, "c": ARM}, ask, rows=100)
    assert [(p.one, p.other) for p in pairs] == [
        ("a", "b"), ("a", "c"), ("b", "c"), ("b, first half", "b, second half")
    ]  # fmt: skip
    assert asked == [60, 100, 60, 100, 100]


def test_a_robot_that_is_not_known_is_refused_in_one_line() -> None:
    with pytest.raises(PlumblineError, match="best matches: ur10"):
        consistency.measured(("ur1",), lambda _: a_verdict(), 0)


def test_the_largest_probability_of_a_cause_counts() -> None:
    listed = [a_cause("latency", None, 0.1), a_cause("latency", None, 0.3)]
    assert probability_of(a_verdict(candidates=listed), ("latency", None)) == 0.3
    assert probability_of(a_verdict(), ("latency", None)) == 0.0


# Noise that is not white


def scatter(recording: Recording) -> float:
    """Mean square of the residual of a rigid fit, tool included, over the stated noise."""
    T = recording.chain.placement(recording.q)
    rows = len(recording)
    turned, fixed = T[:, :3, :3], np.tile(np.eye(3), (rows, 1, 1))
    # measured = t + R (p + R_tip tool): linear in t, R and R tool's nine products.
    place = np.einsum("nk,ij->nijk", T[:, :3, 3], np.eye(3)).reshape(rows, 3, 9)
    tool = np.einsum("nkl,ij->nijkl", turned, np.eye(3)).reshape(rows, 3, 27)
    columns = np.concatenate([fixed, place, tool], axis=2).reshape(3 * rows, -1)
    seen = recording.measured.ravel()
    left = seen - columns @ np.linalg.lstsq(columns, seen, rcond=1e-9)[0]
    free = seen.size - np.linalg.matrix_rank(columns)
    return float(left @ left / free / recording.noise_std**2)


@pytest.mark.parametrize("name", ar1.NOISES)
def test_noise_has_the_size_stated_and_its_own_correlation(name: str) -> None:
    rows, step = 4000, ar1.REPEATS
    rng = np.random.default_rng(3)
    noise = {"drift": ar1.wander, "readings": ar1.shared}.get(name, ar1.white)(rows, rng)
    assert np.mean(noise**2) == pytest.approx(1.0, rel=0.15)
    neighbours = float(np.mean(noise[1:] * noise[:-1]))
    share = {"drift": 0.9, "readings": 0.9 * (step - 1) / step}.get(name, 0.0)
    assert neighbours == pytest.approx(share, abs=0.1)


def test_postures_and_copies_are_repeated_and_the_rest_is_the_simulator_s() -> None:
    case = ar1.clean(0, 0, rows=(20, 20))
    rng = np.random.default_rng(0)
    copies = ar1.NOISES["copies"](case, rng)
    assert len(copies) == 20 * ar1.REPEATS
    assert len(np.unique(copies.measured, axis=0)) == 20
    readings = ar1.NOISES["readings"](case, rng)
    assert len(np.unique(readings.q, axis=0)) <= 20 // ar1.REPEATS
    assert len(np.unique(readings.measured, axis=0)) == 20
    assert (np.diff(readings.time) > 0.0).all()
    plain = ar1.NOISES["white"](case, rng)
    assert plain.noise_std == case.noise_std
    assert 0.4 < scatter(plain) < 1.8
    larger, same = (
        ar1.NOISES["understated"](case, np.random.default_rng(1)),
        np.random.default_rng(1),
    )
    assert scatter(larger) == pytest.approx(2.25 * scatter(ar1.NOISES["white"](case, same)))


def test_one_that_says_nothing_is_never_wrong_and_one_that_counts_rows_is() -> None:
    quiet = ar1.found(lambda _: a_verdict("no-gap"), 3, 1)
    table, otherwise = quiet.values()
    assert [share.count for share in table["told of a gap"]] == [0] * len(ar1.NOISES)
    assert otherwise.count == 0
    loud = a_verdict("explained", a_cause("base_drift", None, 0.96))
    said = ar1.told("drift", lambda _: loud, 2, 1)
    wrong, sure = "told of a gap", "more than 95 % sure"
    assert (said[wrong].count, said[sure].count) == (2, 2)
    said = ar1.told("drift", lambda _: a_verdict("partly-explained"), 2, 1)
    assert (said[wrong].count, said[sure].count) == (2, 0)

    def by_rows(recording: Recording) -> dict:
        p = 1.0 - np.exp(-len(recording) / 100.0)
        return a_verdict("explained", a_cause("base_drift", None, p))

    def by_postures(recording: Recording) -> dict:
        return a_verdict(
            "explained", a_cause("base_drift", None, len(np.unique(recording.q)) / 1e4)
        )

    assert ar1.otherwise(by_rows, 2, 1).count == 2
    assert ar1.otherwise(by_postures, 2, 1).count == 0


@pytest.mark.parametrize(("p", "different"), [(0.81, False), (0.79, True)])
def test_another_probability_is_another_answer_from_a_tenth_on(p: float, different: bool) -> None:
    one = a_verdict("explained", a_cause("latency", None, 0.9))
    assert ar1.unlike(one, a_verdict("explained", a_cause("latency", None, p))) == different
    assert ar1.unlike(one, a_verdict("partly-explained", a_cause("latency", None, 0.9)))
    assert ar1.unlike(one, a_verdict())


# Ranks


def test_nineteen_of_twenty_uniform_histograms_lie_within_the_band() -> None:
    rng = np.random.default_rng(4)
    inside = [histogram("u", list(rng.random(300))).inside for _ in range(400)]
    assert 0.92 < np.mean(inside) < 0.98


def test_ranks_that_crowd_are_outside() -> None:
    rng = np.random.default_rng(5)
    for crowded in (rng.beta(3, 3, 300), rng.beta(0.5, 0.5, 300), rng.beta(2, 1, 300)):
        assert not histogram("u", list(crowded)).inside
    assert histogram("u", []).inside
    assert sum(histogram("u", [0.0, 1.0]).counts) == 2


def ranks_of(claimed: float, seed: int = 6, count: int = 400) -> list[float]:
    """Ranks of a number with error 1 stated with an error of so much."""
    rng, found = np.random.default_rng(seed), []
    for value in rng.normal(0.0, 5.0, count):
        truth = Truth(("joint_offset", 2), "", (("offset", float(value)),))
        seen = (value + rng.normal(), claimed)
        verdict = a_verdict("explained", a_cause("joint_offset", 2, offset=seen))
        rank = simulation_based.rank_of_parameter(truth, verdict, rng)
        assert rank is not None
        found.append(rank)
    return found


@pytest.mark.parametrize(("claimed", "inside"), [(1.0, True), (0.5, False), (2.0, False)])
def test_errors_that_are_too_small_or_too_large_are_seen(claimed: float, inside: bool) -> None:
    assert histogram("parameters", ranks_of(claimed)).inside == inside


@pytest.mark.parametrize(("off", "inside"), [(0.0, True), (0.25, False), (-0.25, False)])
def test_probabilities_that_are_off_are_seen(off: float, inside: bool) -> None:
    rng, found = np.random.default_rng(7), []
    for p in rng.uniform(0.3, 0.7, 1000):
        there = rng.random() < p + off
        truth = Truth(("latency", None) if there else None)
        verdict = a_verdict("explained", a_cause("latency", None, float(p)))
        found.append(simulation_based.rank_of_probability(truth, verdict, rng))
    assert histogram("probabilities", found).inside == inside


def test_what_is_not_named_or_hardly_stated_has_no_rank() -> None:
    rng = np.random.default_rng(8)
    truth = Truth(("joint_offset", 2), "", (("offset", 1e-3),))
    other = a_verdict("explained", a_cause("joint_offset", 3, 0.04, offset=(1e-3, 1e-5)))
    assert simulation_based.rank_of_parameter(truth, other, rng) is None
    assert simulation_based.rank_of_probability(truth, other, rng) is None


def test_a_drawn_cause_moves_the_readings_as_its_effect_does() -> None:
    truths = {}
    for number in range(12):
        recording, truth = simulation_based.case_of(number, 2)
        truths[number] = truth
        if truth.key is None:
            assert 0.5 < scatter(recording) < 1.6
    assert {truth.key is None for truth in truths.values()} == {True, False}
    again = simulation_based.case_of(0, 2)
    np.testing.assert_array_equal(again[0].measured, simulation_based.case_of(0, 2)[0].measured)


def test_every_case_is_ranked_and_shown() -> None:
    found = simulation_based.found(lambda _: a_verdict("no-gap"), 3, 2)
    table = found["ranks"]
    assert list(table) == ["rank from", "parameters", "probabilities"]
    assert len(table) == BINS
    assert table[["parameters", "probabilities"]].to_numpy().sum() == 0
    assert plain(found["band of 95 %"])[0]["inside"] is True
