"""Laws of sealing, and of scoring by hand: hashes hold, counts and intervals are what they say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, norm

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.reality.draws import LIBRARY
from plumbline.experiments.report.page.page import page_html
from plumbline.experiments.withheld.answer import (
    ScoredCase,
    StatedCause,
    StatedVerdict,
    read_answer,
)
from plumbline.experiments.withheld.calibration import calibration
from plumbline.experiments.withheld.design import Design, draw_plan
from plumbline.experiments.withheld.making import _one_of, make_set
from plumbline.experiments.withheld.measures import names_dependence
from plumbline.experiments.withheld.picture import page
from plumbline.experiments.withheld.scoring import error_words, median, score, score_run
from plumbline.experiments.withheld.sealing import LEDGER, read_ledger, seal_folder
from plumbline.experiments.withheld.truth import Sort, Truth, read_truth
from plumbline.optim.core.quantities import Median, Share
from tests.simulated_cases import contents

QUICK = Design(seed=5, kind="mixed", gap=(2.0, 4.0), rows=(20, 24), arms=("ur5",))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of three cases, as it was made; not to be changed."""
    root = tmp_path_factory.mktemp("made")
    make_set(root / "cases", root / "truth", QUICK, 3)
    return root


@pytest.fixture
def own(made: Path, tmp_path: Path) -> Path:
    """A copy of that set, with verdicts that are right about every case."""
    for name, content in contents(made).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    answer_all(tmp_path)
    return tmp_path


def answer_all(root: Path) -> None:
    """Verdicts that name exactly what the truth says."""
    verdicts = root / "verdicts"
    verdicts.mkdir()
    ledger = read_ledger(root / "cases")
    assert ledger is not None
    (verdicts / LEDGER).write_bytes((root / "cases" / LEDGER).read_bytes())
    note = {"cases": str(root / "cases"), "ledger": ledger.sha256}
    (verdicts / "run.json").write_text(json.dumps(note))
    for entry in ledger.entries:
        effects = json.loads((root / "truth" / f"{entry.case}.json").read_text())["effects"]
        causes = [{**effect, "probability": 0.99} for effect in effects]
        verdict = {"verdict": "explained" if causes else "no-gap", "causes": causes}
        verdict["withheld"] = {"recording": entry.recording, "without": list(entry.without)}
        (verdicts / f"{entry.case}.json").write_text(json.dumps(verdict))


# Making


def test_the_same_seed_gives_the_same_cases_byte_for_byte(made: Path, tmp_path: Path) -> None:
    make_set(tmp_path / "cases", tmp_path / "truth", QUICK, 3)
    assert contents(tmp_path) == contents(made)


def test_a_set_can_be_continued_and_is_then_the_same(made: Path, tmp_path: Path) -> None:
    for count in (1, 3):
        make_set(tmp_path / "cases", tmp_path / "truth", QUICK, count)
    assert contents(tmp_path) == contents(made)


def test_two_sets_are_never_mixed(own: Path) -> None:
    with pytest.raises(PlumblineError, match="another design or seed"):
        make_set(own / "cases", own / "truth", Design(seed=6), 1)


def test_a_continued_set_is_checked(own: Path) -> None:
    samples = own / "cases" / "case-0002" / "samples.csv"
    samples.write_text(samples.read_text().replace("1", "2", 1))
    with pytest.raises(PlumblineError, match="changed after it was sealed"):
        make_set(own / "cases", own / "truth", QUICK, 3)


def test_the_ledger_is_written_before_truth_and_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = []

    def note(path: Path, text: str) -> None:
        order.append((path.name, sorted(contents(tmp_path))))
        with path.open("a") as file:
            file.write(text)

    monkeypatch.setattr(
        "plumbline.experiments.withheld.sealing.append", lambda p, t: _made(p) or note(p, t)
    )

    def _made(path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)

    make_set(tmp_path / "cases", tmp_path / "truth", QUICK, 1)
    assert [name for name, _ in order] == [LEDGER, LEDGER]
    assert not [name for name in order[1][1] if "case-0001" in name]


def test_the_ledger_and_the_folders_tell_nothing_of_the_truth(made: Path) -> None:
    said = (made / "cases" / LEDGER).read_text() + " ".join(contents(made / "cases"))
    for path in (made / "truth").glob("case-*.json"):
        facts = json.loads(path.read_text())
        assert facts["kind"] not in said
        assert str(facts["seed"]) not in said
        assert not [e for e in facts["effects"] if e["effect"] in said]


def test_half_of_the_cases_of_a_left_out_effect_do_not_have_it() -> None:
    design = Design(seed=3, leave_out=("each",))
    draws = [draw_plan(design, number) for number in range(600)]
    has = [draw.without[0] in draw.plan.effects for draw in draws]
    assert 0.42 < np.mean(has) < 0.58
    for draw, present in zip(draws, has, strict=True):
        if present:
            assert draw.plan.effects == draw.without
        else:  # an empty list would mean all of them, where it is drawn from at all
            assert draw.plan.effects or draw.plan.kind in {"none", "outside"}
            assert draw.without[0] not in draw.plan.effects


def test_each_effect_that_can_be_left_out_is_left_out_in_turn() -> None:
    design = Design(seed=3, leave_out=("each",))
    turns = [draw_plan(design, number).without for number in range(2 * len(LIBRARY))]
    assert sorted(turns) == sorted((name,) for name in LIBRARY for _ in range(2))
    assert turns[: len(LIBRARY)] == turns[len(LIBRARY) :]


def test_of_two_causes_one_can_be_left_out_and_the_other_is_known(tmp_path: Path) -> None:
    design = replace(QUICK, kind="pair", leave_out=("one",))
    ledger = make_set(tmp_path / "cases", tmp_path / "truth", design, 3)
    for entry in ledger.entries:
        truth = read_truth(tmp_path / "truth" / f"{entry.case}.json", entry.without)
        assert truth.sort is Sort.PARTLY
        assert len(truth.known) == len(truth.unknown) == 1


def test_either_of_two_causes_may_be_the_one_that_is_left_out() -> None:
    facts = {"effects": [{"effect": "latency"}, {"effect": "payload"}]}
    found = [_one_of(facts, np.random.default_rng(seed))[0] for seed in range(200)]
    assert 70 < found.count("latency") < 130
    assert found.count("payload") == 200 - found.count("latency")


def test_one_of_the_causes_is_left_out_of_pairs_only() -> None:
    with pytest.raises(PlumblineError, match="--leave-out one: of two causes, alone; expected"):
        Design(seed=1, leave_out=("one",))
    with pytest.raises(PlumblineError, match="expected --kind pair"):
        Design(seed=1, kind="pair", leave_out=("one", "backlash"))


def test_unknown_words_and_ranges_are_refused() -> None:
    with pytest.raises(PlumblineError, match="--level 'hard' not recognised; known: faint"):
        Design(seed=1, level="hard")
    with pytest.raises(PlumblineError, match="--rows 10 5: expected 20 <= LOW <= HIGH"):
        Design(seed=1, rows=(10, 5))


# Seals


def test_right_verdicts_score_full_marks(own: Path) -> None:
    found = score_run(own / "verdicts", own / "truth")
    assert found.sealed
    assert found.overall.share("unusable").count == 0
    assert found.overall.share("falsely_added").count == 0
    known = found.overall.share("top1_element")
    assert known.count == known.of


@pytest.mark.parametrize("changed", ["truth/case-0002.json", "cases/case-0002/samples.csv"])
def test_what_was_changed_after_sealing_is_refused(
    own: Path, changed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = own / changed
    path.write_bytes(path.read_bytes() + b"\n")
    assert run(["withheld", "score", str(own / "verdicts"), "--truth", str(own / "truth")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "was changed after it was sealed" in err
    assert err.count("\n") == 1


def test_a_ledger_that_was_changed_with_the_truth_is_refused(own: Path) -> None:
    path = own / "truth" / "case-0002.json"
    path.write_bytes(path.read_bytes() + b"\n")
    for name in ("cases", "truth", "verdicts"):
        (own / name / LEDGER).unlink()
    seal_folder(own / "cases", own / "truth")
    with pytest.raises(PlumblineError, match="not the ledger that the run was sealed with"):
        score_run(own / "verdicts", own / "truth")


def test_a_ledger_that_differs_from_the_truth_s_is_refused(own: Path) -> None:
    ledger = own / "truth" / LEDGER
    ledger.write_text("".join(ledger.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(PlumblineError, match="differs from that of the run"):
        score_run(own / "verdicts", own / "truth")


def test_a_verdict_on_another_recording_or_library_is_refused(own: Path) -> None:
    path = own / "verdicts" / "case-0001.json"
    verdict = json.loads(path.read_text())
    for key, value, words in (
        ("recording", "0" * 64, "another recording"),
        ("without", ["backlash"], "another library"),
    ):
        other = {**verdict, "withheld": {**verdict["withheld"], key: value}}
        path.write_text(json.dumps(other))
        with pytest.raises(PlumblineError, match=words):
            score_run(own / "verdicts", own / "truth")


def test_missing_verdicts_are_not_passed_over(own: Path) -> None:
    (own / "verdicts" / "case-0003.json").unlink()
    with pytest.raises(PlumblineError, match="1 cases have no verdict, case-0003 first"):
        score_run(own / "verdicts", own / "truth")
    assert score_run(own / "verdicts", own / "truth", partial=True).missing == 1


def test_a_set_without_a_ledger_is_scored_but_said_to_be_unsealed(own: Path) -> None:
    for path in (*own.glob(f"*/{LEDGER}"), own / "verdicts" / "run.json"):
        path.unlink()
    assert not score_run(own / "verdicts", own / "truth").sealed


@pytest.mark.parametrize(
    "truth",
    [
        b"{bad",
        b'{"effects": "\xe9"}',
        b'{"effects": ["joint_offset"]}',
        b'{"effects": [{"effect": "joint_offset", "element": 3.5}]}',
        b'{"effects": [{"effect": "joint_offset", "element": true}]}',
        b'{"effects": [{"effect": "Joint-Offset", "element": 3}]}',
    ],
)
def test_a_truth_that_cannot_be_understood_is_refused_before_it_is_sealed(
    own: Path, truth: bytes
) -> None:
    """Once it is sealed it cannot be mended; a name spelt otherwise would count as unknown."""
    for path in (*own.glob(f"*/{LEDGER}"), own / "verdicts" / "run.json"):
        path.unlink()
    (own / "truth" / "case-0002.json").write_bytes(truth)
    with pytest.raises(PlumblineError, match="case-0002"):
        seal_folder(own / "cases", own / "truth")
    assert read_ledger(own / "cases") is None


def test_a_file_of_other_bytes_beside_the_truth_is_left_alone(own: Path) -> None:
    for path in (*own.glob(f"*/{LEDGER}"), own / "verdicts" / "run.json"):
        path.unlink()
    (own / "truth" / "notes.json").write_bytes(b"\xff\xfe caf\xe9")
    assert score_run(own / "verdicts", own / "truth").cases == 3


def test_figures_written_as_words_are_read_as_numbers(own: Path) -> None:
    path = own / "verdicts" / "case-0001.json"
    verdict = json.loads(path.read_text())
    path.write_text(json.dumps({**verdict, "gap": {"before": "1e-3", "after": "1e-4"}}))
    answer = read_answer(path)
    assert (answer.before, answer.after) == (1e-3, 1e-4)


@pytest.mark.parametrize("place", ["cases/truth", "cases", "."])
def test_truth_and_cases_are_kept_apart(tmp_path: Path, place: str) -> None:
    with pytest.raises(PlumblineError, match="keep them apart"):
        make_set(tmp_path / "cases", tmp_path / place, QUICK, 1)


# The truth


def truth_of(tmp_path: Path, without: tuple[str, ...] = (), **content: object) -> Truth:
    """A truth file, written and read."""
    path = tmp_path / "case.json"
    path.write_text(json.dumps(content))
    return read_truth(path, without)


def test_a_truth_needs_no_more_than_its_effects(tmp_path: Path) -> None:
    found = truth_of(tmp_path, effects=[{"effect": "backlash", "element": 2}])
    assert found.sort is Sort.SINGLE
    assert found.causes == (("backlash", 2),)
    assert truth_of(tmp_path, effects=[]).sort is Sort.NONE
    assert truth_of(tmp_path, effects=[{"effect": "magnetic_spot"}]).sort is Sort.OUTSIDE


def test_an_effect_taken_out_of_the_library_is_outside(tmp_path: Path) -> None:
    effects = [{"effect": "backlash", "element": 2}, {"effect": "joint_scale", "element": 1}]
    assert truth_of(tmp_path, ("backlash",), effects=effects[:1]).sort is Sort.OUTSIDE
    assert truth_of(tmp_path, ("backlash",), effects=effects).sort is Sort.PARTLY
    assert truth_of(tmp_path, ("latency",), effects=effects).sort is Sort.SEVERAL


@pytest.mark.parametrize("content", ["[]", "{}", '{"effects": [1]}', "no json", '{"effects": 3}'])
def test_a_file_that_is_no_truth_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "case.json"
    path.write_text(content)
    with pytest.raises(PlumblineError, match="no truth; expected"):
        read_truth(path)


# Counting


def judged(
    true: list[tuple[str, int | None]],
    named: list[tuple[str, int | None, float]],
    verdict: str = "explained",
    confounded: tuple = (),
    unknown: tuple = (),
    **more: object,
) -> ScoredCase:
    """A case by hand."""
    causes = tuple(StatedCause((effect, element), p) for effect, element, p in named)
    truth = Truth(
        "c", tuple(true), unknown, frozenset(confounded), "clear", 80, "tip_position", 1e-4
    )
    return ScoredCase(truth, StatedVerdict("c", verdict, causes, causes, **more))


PLAY, SCALE, LATE, SPOT = ("backlash", 2), ("joint_scale", 1), ("latency", None), ("spot", None)
ALIKE = (SCALE, ("joint_offset", 1))
BY_HAND = [
    judged([PLAY], [("backlash", 2, 0.99)], before=4e-4, after=1.8e-4),
    judged([PLAY], [("backlash", 3, 0.97)], before=4e-4, after=3e-4),
    judged([SCALE], [("joint_offset", 1, 0.6)], confounded=(ALIKE,)),
    judged([SCALE, LATE], [("latency", None, 0.98), ("payload", None, 0.7)]),
    judged([SCALE, LATE], [("latency", None, 0.98), ("joint_scale", 1, 0.9)]),
    judged([], [], "no-gap"),
    judged([], [("backlash", 1, 0.8)]),
    judged([SPOT], [], "outside-library", unknown=(SPOT,)),
    judged([SPOT], [("payload", None, 0.99)], unknown=(SPOT,)),
    judged([("link_flex", 2)], [("link_flex", 2, 0.9)], "partly-explained"),
]


@pytest.mark.parametrize(
    ("key", "count", "of"),
    [
        ("top1_effect", 5, 6),
        ("top1_effect_or_confounded", 6, 6),
        ("top1_element", 4, 6),
        ("top1_element_or_confounded", 5, 6),
        ("all_found", 3, 6),
        ("all_found_or_confounded", 4, 6),
        ("pair_found", 1, 2),
        ("falsely_added", 4, 9),
        ("falsely_added_beyond_confounded", 3, 9),
        ("sure_right", 3, 5),
        ("false_alarms", 1, 2),
        ("missed", 0, 8),
        ("outside_hits", 1, 2),
        ("outside_wrong_sure", 1, 2),
        ("false_outside", 1, 8),
        ("at_noise_floor", 1, 2),
    ],
)
def test_figures_are_those_counted_by_hand(key: str, count: int, of: int) -> None:
    share = score(BY_HAND).overall.share(key)
    assert (share.count, share.of) == (count, of)


def test_what_is_left_is_held_against_the_noise_of_these_very_readings() -> None:
    case = judged([PLAY], [("backlash", 2, 0.99)], before=4e-4, after=1.8e-4)
    noisy, quiet = (replace(case, truth=replace(case.truth, noise_rms=s)) for s in (9.5e-5, 9.4e-5))
    share = score([noisy, quiet]).overall.share("at_own_noise")
    assert (share.count, share.of) == (1, 2)  # 1.1 root 3 sigma: 1.81e-4 and 1.79e-4 m
    assert score([noisy, quiet]).overall.share("at_own_noise_untimed") == share
    bumped = judged([("base_bump", None)], [("base_bump", None, 0.99)], before=4e-4, after=1.8e-4)
    bumped = replace(bumped, truth=replace(bumped.truth, noise_rms=1e-4))
    assert score([bumped]).overall.share("at_own_noise").of == 1
    assert score([bumped]).overall.share("at_own_noise_untimed").of == 0
    assert score(BY_HAND).overall.share("at_own_noise").of == 0


def test_beside_an_unknown_the_known_cause_must_be_named_and_the_unknown_flagged() -> None:
    both, known = [SCALE, SPOT], {"unknown": (SPOT,), "confounded": (ALIKE,)}
    cases = [
        judged(both, [("joint_scale", 1, 0.8)], "partly-explained", **known),
        judged(both, [("joint_offset", 1, 0.8)], "partly-explained", **known),  # confounded
        judged(both, [("payload", None, 0.8)], "partly-explained", **known),
        judged(both, [], "outside-library", **known),
        judged(both, [("joint_scale", 1, 0.8)], "explained", **known),
        judged([SPOT], [], "outside-library", unknown=(SPOT,)),
    ]
    found = score(cases).overall
    assert (found.share("partly_found").count, found.share("partly_found").of) == (3, 5)
    assert (found.share("partly_flagged").count, found.share("partly_flagged").of) == (4, 5)


def test_the_order_and_the_names_of_cases_change_nothing() -> None:
    assert score(BY_HAND[::-1]).overall == score(BY_HAND).overall


def test_relabelling_effects_of_truth_and_answer_alike_changes_nothing() -> None:
    new = {"backlash": "latency", "latency": "link_flex", "link_flex": "backlash"}

    def named(key: tuple) -> tuple:
        return (new.get(key[0], key[0]), key[1])

    def relabelled(case: ScoredCase) -> ScoredCase:
        t, a = case.truth, case.answer
        alike = frozenset((named(x), named(y)) for x, y in t.confounded)
        causes = tuple(StatedCause(named(s.key), s.probability) for s in a.causes)
        truth = replace(t, causes=tuple(map(named, t.causes)), confounded=alike)
        return ScoredCase(truth, replace(a, causes=causes, candidates=causes))

    assert score([relabelled(c) for c in BY_HAND]).overall == score(BY_HAND).overall


def test_a_cause_named_twice_is_right_once() -> None:
    pair = (("backlash", 2), ("hysteresis", 2))
    case = judged([pair[0]], [("backlash", 2, 0.9), ("hysteresis", 2, 0.9)], confounded=(pair,))
    assert case.found_or_confounded == 1
    assert score([case]).overall.share("falsely_added_beyond_confounded").count == 1


def test_matching_finds_as_many_as_can_be() -> None:
    a, b, c = ("backlash", 1), ("hysteresis", 1), ("payload", None)
    case = judged([a, b], [(*a, 0.9), (*c, 0.9)], confounded=((b, a), (a, c)))
    assert case.found_or_confounded == 2


def test_shrink_reached_is_what_the_formula_says() -> None:
    floor = 1e-4 * np.sqrt(3)
    found = score(BY_HAND[:1]).overall.shrink
    assert found.value == pytest.approx((4e-4 - 1.8e-4) / (4e-4 - floor))


@pytest.mark.parametrize(
    ("probability", "sure", "stated"), [(0.951, 1, 2), (0.95, 0, 2), (0.05, 0, 2), (0.049, 0, 1)]
)
def test_sure_is_above_19_of_20_and_1_of_20_is_worth_counting(
    probability: float, sure: int, stated: int
) -> None:
    case = judged([PLAY], [("backlash", 2, probability), ("payload", None, 0.5)])
    found = score([case])
    assert found.overall.share("sure_right").of == sure
    assert found.candidates.statements == stated


def test_what_is_within_a_twentieth_of_the_noise_is_no_gap_to_remove() -> None:
    floor = 1e-4 * np.sqrt(3)
    for before, of in ((1.06 * floor, 1), (1.04 * floor, 0)):
        case = judged([PLAY], [("backlash", 2, 0.99)], before=before, after=floor)
        assert score([case]).overall.shrink.of == of


@pytest.mark.parametrize(
    ("gap", "level"), [(0.69, "faint"), (0.71, "slight"), (0.99, "slight"), (1.01, "clear")]
)
def test_a_case_is_as_hard_as_its_weakest_cause(tmp_path: Path, gap: float, level: str) -> None:
    gaps = [gap, 3.0]
    effects = [{"effect": "backlash", "element": k, "gap_to_noise": g} for k, g in enumerate(gaps)]
    assert truth_of(tmp_path, effects=effects).level == level


def test_a_mechanism_without_a_name_flags_where_it_is_likelier_than_not() -> None:
    flags = [StatedVerdict("c", "explained", (), unlisted=p).flags_outside for p in (0.49, 0.51)]
    assert flags == [False, True]
    assert StatedVerdict("c", "explained", (), outside=0.51).flags_outside


def test_what_an_unknown_effect_depends_on_is_recognised() -> None:
    said = StatedVerdict(
        "c", "outside-library", (), outside_words="joint 2's error depends on joint 5's angle"
    )
    assert names_dependence(("q2", "q5"), said)
    assert names_dependence(("history of q2",), said)
    assert not names_dependence(("q3",), said)
    place = StatedVerdict("c", "outside-library", (), outside_words="the place of the tip, locally")
    assert names_dependence(("position",), place)
    assert not names_dependence(("q2",), place)


# Intervals and probabilities


@pytest.mark.parametrize(("count", "of"), [(0, 10), (7, 10), (95, 100), (3, 3)])
def test_at_the_ends_of_a_share_s_interval_the_score_test_just_rejects(count: int, of: int) -> None:
    share = Share.count_of(count, of)
    for p in (share.low, share.high):
        score = abs(count / of - p) - norm.ppf(0.975) * np.sqrt(p * (1 - p) / of)
        assert score == pytest.approx(0.0, abs=1e-9)
    assert share.low <= share.value <= share.high


def test_a_median_s_interval_holds_it_nineteen_times_of_twenty() -> None:
    rng = np.random.default_rng(1)
    found = [Median.of_values(rng.normal(size=41)) for _ in range(800)]
    held = np.mean([m.low <= 0.0 <= m.high for m in found])
    assert 0.93 < held < 0.985


@pytest.mark.parametrize("n", range(1, 13))
def test_a_median_has_an_interval_only_where_its_values_can_hold_it(n: int) -> None:
    found = Median.of_values(range(n))
    assert found.value == pytest.approx((n - 1) / 2)
    if n < 6:
        assert 1 - 2 * binom.cdf(0, n, 0.5) < 0.95  # not even from the least to the greatest
        assert found.low is found.high is None
        assert median(found) == f"{50 * (n - 1)}"
    else:
        below = round(found.low)  # values left out at either end
        assert found.high == n - 1 - below
        assert 1 - 2 * binom.cdf(below, n, 0.5) >= 0.95 > 1 - 2 * binom.cdf(below + 1, n, 0.5)
        assert f" ({100 * below}-{100 * (n - 1 - below)})" in median(found)


def test_a_median_of_nothing_is_none() -> None:
    assert Median.of_values([]) == Median(0, None, None, None)
    assert median(Median.of_values([])) == ""


def said(rng: np.random.Generator, cases: int, shift: float) -> list[list[tuple[float, bool]]]:
    """Statements three a case, right with their own probability plus a shift."""
    p = rng.uniform(0.2, 0.8, (cases, 3))
    right = rng.random((cases, 3)) < p + shift
    return [list(zip(a.tolist(), b.tolist(), strict=True)) for a, b in zip(p, right, strict=True)]


def test_perfect_probabilities_have_no_calibration_error_in_the_limit() -> None:
    rng = np.random.default_rng(2)
    errors = [calibration(said(rng, n, 0.0)).ece for n in (30, 3000)]
    assert errors[1] < 0.02
    assert errors[1] < 0.3 * errors[0]


def test_of_few_statements_an_error_is_expected_though_each_is_as_often_right_as_it_says() -> None:
    """Which is told beside it: of 15 it is what draws of them have, of 9,000 next to nothing."""
    rng = np.random.default_rng(4)
    found = [calibration(said(rng, 5, 0.0)) for _ in range(100)]
    assert np.mean([f.chance for f in found]) == pytest.approx(
        np.mean([f.ece for f in found]), rel=0.1
    )
    assert np.mean([f.chance for f in found]) > 0.1
    assert calibration(said(rng, 3000, 0.1)).chance < 0.02
    assert f"15 statements ({found[0].chance:.3f} by chance)" in error_words("named", found[0])


def test_probabilities_that_are_off_by_a_tenth_have_that_error() -> None:
    found = calibration(said(np.random.default_rng(3), 3000, 0.1))
    assert found.ece == pytest.approx(0.1, abs=0.02)
    assert found.low < 0.1 < found.high
    assert [round(b.right.value - b.stated, 1) for b in found.curve] == [0.1] * len(found.curve)


def test_a_calibration_error_counted_by_hand() -> None:
    found = calibration([[(0.95, True), (0.92, False)], [(0.12, False)]])
    assert found.ece == pytest.approx((abs(1 - 1.87) + 0.12) / 3)
    assert calibration([[], []]).ece is None


# The picture


def test_the_page_stands_alone_and_says_all() -> None:
    text = page_html(page(score(BY_HAND)))
    assert "http" not in text.replace("http://www.w3.org", "")
    assert "10 withheld cases" in text
    assert "66.7 (30-90)" in text  # top-1 effect and element, 4 of 6
    pair = [case for case in BY_HAND if len(case.truth.causes) == 2]
    assert "no case of at most one cause" in page_html(page(score(pair)))
