"""Laws of what the joint posterior is told as: the tree, what is named, and what is explained."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.experiments.reality.joint_effects import JointScale
from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale as ModelledScale
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.alternatives import Alternatives, GrossRow, Unlisted
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence
from plumbline.optim.diagnosis.findings import (
    Cause,
    Estimate,
    Outcome,
    Verdict,
)
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.meaning import (
    MEANING,
    NOISIER,
    NOT_SHOWN,
    NOTHING_FURTHER,
    ON_A_BOUND,
    ONLY_CONFOUNDED,
)
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.joint import Sampled
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.predict.held_out import evaluate
from plumbline.optim.diagnosis.prior import MOST_COMPARED_ROWS, PART_OF_UNLISTED
from plumbline.optim.diagnosis.verdict import explanation as explanation_module
from plumbline.optim.diagnosis.verdict import judge as judge_module
from plumbline.optim.diagnosis.verdict.explanation import Explanation, _told, explain
from plumbline.optim.diagnosis.verdict.judge import judge
from plumbline.optim.diagnosis.verdict.terms import _joined, of_many, terms_of, with_terms
from tests.explained import searched
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import faultless, recorded, with_fault

SCALE, OFFSET = ("joint_scale", 2), ("joint_offset", 2)
MECHANISMS = {
    ("joint", 2, "own angle", "joint_scale"): 0.6,
    ("joint", 2, "own angle", None): 0.3,
    ("joint", 2, "load", "joint_compliance"): 0.2,
    ("base", None, "time", "base_drift"): 0.04,
    ("tool", None, "payload", "payload"): 0.004,
    ("", None, "", None): 0.0,
}
PLACES = {("joint", 2): 0.97, ("base", None): 0.04, ("tool", None): 0.004, ("", None): 0.5}


def made(**given):
    """An explanation with invented probabilities."""
    probable = frozenset(key for key, p in given.get("probabilities", {}).items() if p >= 0.5)
    known = {"probabilities": {}, "sensitive": {}, "unlisted": 0.0, "named": probable}
    return Explanation(**{**known, "mechanisms": MECHANISMS, "places": PLACES, **given})


def test_what_blocks_agree_on_takes_the_place_of_what_all_rows_have_not_told():
    """Two ripples of one joint stay beside each other where all rows of many have told the one."""
    ripples = [("joint", 1, "own angle", f"{kind}_ripple") for kind in ("gear", "transmission")]
    mechanisms = [*ripples, ("joint", 2, "own angle", "joint_scale")]
    alt = SimpleNamespace(mechanisms=mechanisms, problem=SimpleNamespace(labels=[np.arange(3)]))
    first, second, other = (SelectedTerm(k, 1.0) for k in range(3))
    assert _joined(alt, [first, other], [second], long=False) == (other, second)
    assert _joined(alt, [first, other], [second], long=True) == (first, other, second)


def test_of_many_causes_a_long_recording_keeps_what_all_its_rows_have_told():
    """Of a short one all that is listed, confounded ones for the lacked; and what is named."""
    keys = [("gear_ripple", 1), ("joint_scale", 2), ("joint_offset", 3), ("joint_tilt", 4)]
    terms = [SelectedTerm(k, 1.0) for k in range(6)]
    lacked = Unlisted(None, np.arange(1))
    alt = SimpleNamespace(
        library=4,
        mechanisms=[("joint", k, "own angle", None) for k in range(6)],
        places=("joint 1", "joint 2", "joint 3", "joint 4"),
        problem=SimpleNamespace(labels=np.array([range(6), [0, 1, 2, 3, 2, 3]])),
        term=lambda index: lacked if index == 4 else None,
        listed=lambda state: tuple(t for t in state if t.index < 4),
    )
    found = {
        rows: of_many(
            SimpleNamespace(
                chosen=(terms[0], terms[2]),
                selection=SimpleNamespace(
                    candidates=[SimpleNamespace(key=key) for key in keys],
                    keys=lambda terms: frozenset(keys[t.index] for t in terms),
                ),
                pool=SimpleNamespace(model=SimpleNamespace(recording=range(rows))),
            ),
            alt, [terms[1], terms[4]], [terms[3], terms[1], terms[5]], frozenset({keys[3]}),
        )
        for rows in (MOST_COMPARED_ROWS, MOST_COMPARED_ROWS + 1)
    }  # fmt: skip
    assert found[MOST_COMPARED_ROWS] == (terms[1], terms[2], terms[3])
    assert found[MOST_COMPARED_ROWS + 1] == (terms[0], terms[2], terms[3])


# The tree


def test_the_tree_adds_up_level_by_level():
    tree = made().tree
    assert [(p["stage"], p["element"]) for p in tree] == [("joint", 2), ("base", None)]
    for place in tree:
        dependences = place["dependences"]
        total = sum(d["probability"] for d in dependences)
        assert total == pytest.approx(place["probability"])
        for d in dependences:
            assert sum(m["probability"] for m in d["mechanisms"]) == pytest.approx(d["probability"])
    assert [d["on"] for d in tree[0]["dependences"]] == ["own angle", "load"]
    assert [m["effect"] for m in tree[0]["dependences"][0]["mechanisms"]] == ["joint_scale", None]


# From marginals to names


def sampled(scale=0.6, offset=0.3, lacked=0.2, conditional=0.1, gross=0.7):
    """Two effects of joint 2, two unlisted mechanisms and a row that may be gross."""
    families = [
        Dependence(f"joint {j}'s error depends on it", "own angle", "joint", j, np.ones((1, 1, 1)))
        for j in (2, 3)
    ]
    at = [np.array([k]) for k in range(5)]
    terms = (
        Candidate(ModelledScale(joint=2), at[0], 0.0),
        Candidate(JointOffset(joint=2), at[1], 0.0),
        *(Unlisted(f, c) for f, c in zip(families, at[2:], strict=False)),
        GrossRow(7, at[4]),
    )
    mechanisms = (
        ("joint", 2, "own angle", "joint_scale"),
        ("joint", 2, "own angle", "joint_offset"),
        ("joint", 2, "own angle", None),
        ("joint", 3, "own angle", None),
        ("", None, "", None),
    )
    places = (("joint", 2), ("joint", 3), ("", None))
    words = ("", families[0].words, families[1].words)
    labels = np.array([[0, 1, 2, 3, 4], [0, 0, 0, 1, 2], [0, 0, 1, 2, 0], [0, 0, 1, 1, 0]])
    linear = Linear(np.eye(5), np.zeros(5), 1.0, 9.0)
    is_gross = np.arange(5) == 4
    lacking = np.array([isinstance(term, Unlisted) for term in terms])
    problem = JointProblem(linear, terms, NoisePrior(), np.zeros(5), is_gross, labels, lacking)
    marginals = (
        np.array([scale, offset, lacked, conditional, 0.0]),
        np.array([0.99, conditional, 0.0]),
        np.array([0.99, lacked, conditional]),
        np.array([0.99, lacked + conditional]),
    )
    tilted = np.array([[0.5 * scale, 0.2, 0.0, 0.0, 0.0], [0.9 * scale, 0.6, 0.0, 0.0, 0.0]])
    row = np.where(is_gross, gross, 0.0)
    states = ((2.0, (SelectedTerm(0, 1.0),)), (1.0, (SelectedTerm(0, 1.0), SelectedTerm(1, 3.0))))
    rows, asked = np.arange(9), lambda *_: np.ones(())
    return Alternatives(problem, mechanisms, places, words, 2, rows, asked, asked, rows), Sampled(
        marginals, row, states, tilted
    )


def test_marginals_are_told_by_name():
    told = _told(*sampled())
    assert told.probabilities == pytest.approx({SCALE: 0.6, OFFSET: 0.3})
    assert told.places["joint", 2] == 0.99
    assert told.unlisted == pytest.approx(0.3)


def test_sensitivity_holds_the_probability_itself():
    """Also where other prior odds, lower and higher, both make something else more probable."""
    told = _told(*sampled())
    assert told.sensitive[SCALE] == pytest.approx((0.3, 0.6))
    assert told.sensitive[OFFSET] == pytest.approx((0.2, 0.6))


@pytest.mark.parametrize(("moved", "part"), [(11.0, PART_OF_UNLISTED), (11.3, 0.0)])
def test_what_is_named_may_be_a_part_of_what_is_missing_unless_it_is_far_larger(moved, part):
    """As beside an unlisted mechanism that is told, which leaves nothing missing."""
    told = made(probabilities={SCALE: 0.9}, sensitive={SCALE: (0.8, 1.0)})
    doubted = told.doubted(1.0, 1.0, {SCALE: moved})
    assert doubted.probabilities[SCALE] == pytest.approx(0.9 * (1.0 - part))
    assert doubted.sensitive[SCALE] == pytest.approx((0.8 * (1.0 - part), 1.0 - part))
    assert told.doubted(0.0, 1.0, {SCALE: moved}).probabilities[SCALE] == 0.9
    known = replace(told, conditional=1.0).doubted(1.0, 1.0, {SCALE: moved})
    assert known.probabilities[SCALE] == pytest.approx(0.9)
    mechanism = next(m for m in told.mechanisms if m[3] == SCALE[0])
    assert doubted.mechanisms[mechanism] == pytest.approx(told.mechanisms[mechanism] * (1.0 - part))


def test_a_place_is_no_surer_than_what_is_named_there_where_that_may_be_a_part_of_more():
    """Nor less sure by more than that, or where nothing that is doubted is."""
    told = made(probabilities={SCALE: 0.6})
    doubted = told.doubted(1.0, 1.0, {SCALE: 1.0})
    lost = told.mechanisms["joint", 2, "own angle", "joint_scale"] * PART_OF_UNLISTED
    assert doubted.places["joint", 2] == pytest.approx(told.places["joint", 2] - lost)
    assert doubted.places["base", None] == told.places["base", None]
    alone = made(probabilities={SCALE: 0.97}, mechanisms=dict.fromkeys(told.mechanisms, 0.97))
    sure = alone.doubted(1.0, 1.0, {SCALE: 1.0}).places["joint", 2]
    assert sure == pytest.approx(0.97 * (1.0 - PART_OF_UNLISTED))
    assert made(probabilities={SCALE: 0.6}).doubted(0.0, 1.0, {SCALE: 1.0}).places == told.places


@pytest.mark.parametrize(
    ("probable", "lacking", "named"),
    [
        (0.9, 1.0, True),
        (0.83, 1.0, False),
        (0.83, 0.9, True),
        (0.4, 0.12, True),
        (0.4, 0.13, False),
    ],
)
def test_what_is_doubted_below_even_is_no_name(probable, lacking, named):
    """Nor is one of equals (.4) where it is no longer settled that one of them is at work."""
    told = made(probabilities={SCALE: probable}, named=frozenset({SCALE}))
    doubted = told.doubted(lacking, 1.0, {SCALE: 1.0})
    assert (SCALE in doubted.named) is named


@pytest.mark.parametrize(("lacked", "told"), [(0.35, False), (0.45, True)])
def test_what_an_unlisted_mechanism_depends_on_is_told_if_one_is_more_probable_than_not(
    lacked, told
):
    found = _told(*sampled(lacked=lacked))
    assert found.words == ("joint 2's error depends on it" if told else "")


def rivals(scale, offset, lacked, kind="own angle"):
    """One of two effects of joint 2 is at work, or something unlisted there; each by itself."""
    alt, found = sampled(scale=scale, offset=offset, lacked=lacked)
    other = ("joint", 2, kind, "joint_offset")
    alt = replace(alt, mechanisms=(alt.mechanisms[0], other, *alt.mechanisms[2:]))
    seen = {frozenset({k}): np.log(p) for k, p in enumerate((scale, offset, lacked))}
    return _told(alt, replace(found, seen=seen))


@pytest.mark.parametrize(("lacked", "named"), [(0.04, {SCALE}), (0.06, set())])
def test_of_equals_one_is_named_where_it_is_settled_that_one_is_at_work(lacked, named):
    """Neither is more probable than not; that one of the two is, or something unlisted, is."""
    assert rivals(0.52 - lacked, 0.48, lacked, kind="load").named == named


@pytest.mark.parametrize(("lacked", "named"), [(0.49, {SCALE}), (0.51, set())])
def test_of_equals_of_one_kind_one_is_named_where_one_is_more_probable_than_not(lacked, named):
    """As a play and a lag that is carried along, beside a little that may be neither."""
    assert rivals(0.6 - lacked / 2, 0.4 - lacked / 2, lacked).named == named


def test_unlisted_mechanisms_share_the_gap_by_what_they_move():
    alt, found = sampled()
    sides = np.array([0.0, 0.0, 3.0, 4.0, 0.0])
    linear = Linear(np.eye(5), sides, float(sides @ sides), 9.0)
    alt = replace(alt, problem=replace(alt.problem, linear=linear))
    both = ((1.0, tuple(SelectedTerm(k, 1.0) for k in (0, 2, 3, 4))),)
    told = _told(alt, replace(found, states=(*found.states, *both)))
    assert told.lacked_at == pytest.approx({("joint", 2): 9 / 25, ("joint", 3): 16 / 25})
    assert _told(alt, found).lacked_at == {}


def test_what_is_named_is_fitted_as_the_best_state_has_it():
    alt, found = sampled()
    candidates = alt.problem.candidates[:2]
    chosen = (SelectedTerm(1, 9.0),)
    selected = SimpleNamespace(selection=SimpleNamespace(candidates=candidates), chosen=chosen)

    def named(*keys):
        return [(t.index, t.scale) for t in terms_of(selected, alt, found, frozenset(keys))]

    assert named(SCALE) == [(0, 1.0)]
    assert named(SCALE, OFFSET) == [(0, 1.0), (1, 3.0)]
    assert named() == [(0, 1.0)]
    assert named(OFFSET) == [(0, 1.0), (1, 3.0)]


@pytest.mark.parametrize(("lacking", "fitted"), [(2, [(1, 9.0)]), (3, [])])
def test_what_the_library_lacks_is_fitted_by_what_the_search_took_for_it(lacking, fitted):
    """At its own place: else what is fitted, told of and left would be without it."""
    alt, found = sampled()
    found = replace(found, states=((3.0, (SelectedTerm(lacking, 1.0),)), *found.states))
    selection = SimpleNamespace(candidates=alt.problem.candidates[:2])
    selected = SimpleNamespace(selection=selection, chosen=(SelectedTerm(1, 9.0),))
    terms = terms_of(selected, alt, found, frozenset())
    assert [(t.index, t.scale) for t in terms] == fitted


# One recording


@pytest.fixture(scope="module")
def scaled(tmp_path_factory):
    """Joint 2's scale is off: the recording, where its search ends, and its diagnosis."""
    case = with_fault(faultless(rows=40, seed=5), JointScale(0.0, 2), gap=2.0)
    recording, _ = recorded(case, tmp_path_factory.mktemp("scaled"))
    library = FEW_EFFECTS.library
    return recording, searched(recording, library)[0], diagnose(recording, FEW_EFFECTS)


def test_a_place_is_as_probable_as_any_mechanism_there(scaled):
    _, selected, _ = scaled
    told = explain(selected, 0)
    for mechanism, p in told.mechanisms.items():
        assert told.places[mechanism[:2]] >= p - 1e-9
    assert told.places["joint", 2] > 0.99
    for key, p in told.probabilities.items():
        low, high = told.sensitive[key]
        assert low <= p <= high


def test_the_more_is_expected_to_be_unlisted_the_more_probable_it_is(scaled):
    _, selected, _ = scaled
    found = [explain(selected, 0, share) for share in (0.02, 0.2, 0.7)]
    assert sorted(f.unlisted for f in found) == [f.unlisted for f in found]
    assert found[-1].unlisted > 2.0 * found[0].unlisted
    assert found[0].probabilities[SCALE] >= found[-1].probabilities[SCALE]


def test_two_seeds_say_the_same(scaled):
    _, selected, _ = scaled
    one, two = (explain(selected, seed) for seed in (1, 2))
    assert one.unlisted == pytest.approx(two.unlisted, abs=0.02)
    assert one.probabilities[SCALE] == pytest.approx(two.probabilities[SCALE], abs=0.02)
    assert one.named == two.named == {SCALE}


def test_the_verdict_has_the_tree_and_the_prior_that_was_asked_for(scaled):
    _, _, diagnosis = scaled
    verdict = diagnosis.verdict
    assert verdict.unlisted_prior == 0.2
    assert (verdict.tree[0]["stage"], verdict.tree[0]["element"]) == ("joint", 2)
    again = Verdict.from_dict(verdict.to_dict()) if hasattr(Verdict, "from_dict") else verdict
    assert again.tree == verdict.tree


def test_a_model_without_a_cause_excludes_it_and_with_it_again_does_not(scaled):
    recording, selected, _ = scaled
    task, right = _task(recording)
    fewer = with_terms(selected, (), task, right)
    assert SCALE in fewer.excluded
    assert fewer.chosen == ()
    again = with_terms(fewer, selected.chosen, task, right)
    assert again.excluded == frozenset()
    assert again.best.cost == pytest.approx(selected.best.cost, rel=1e-3)


def _task(recording):
    """What is fitted again, and that no row is distrusted."""
    task = SimpleNamespace(recording=recording, refitting=DiagnosisOptions().solver)
    return task, np.zeros(len(recording), dtype=bool)


# Explained is earned


@pytest.fixture(scope="module")
def judged(scaled):
    """A verdict's parts, of which all allow it to be called explained."""
    recording, _, diagnosis = scaled
    selected = diagnosis.selected
    folds = np.arange(len(recording)) % 5
    seen = evaluate(recording, selected, folds, np.ones(len(recording), dtype=bool), "rows", 0)
    told = made(unlisted=0.05, probabilities={SCALE: 0.99}, sensitive={})
    noise = noise_of(recording, selected.best)
    floor = replace(noise, sigma=seen.rms_after / seen.per_point, source="given", ratio=1.0)
    return recording, selected, seen, told, floor


def kind(parts, **changed):
    """What the verdict is with some of its parts changed."""
    recording, selected, seen, told, noise = parts
    told = replace(told, **changed.pop("told", {}))
    noise = replace(noise, **changed.pop("noise", {}))
    return judge(recording, selected, seen, told, noise, EFFECTS, 0)


@pytest.mark.parametrize(("ratio", "part"), [(1.0, 0.0), (3.0, PART_OF_UNLISTED)])
def test_a_verdict_is_not_sure_of_a_cause_beside_which_as_much_is_missing(judged, ratio, part):
    [cause] = kind(judged, noise={"ratio": ratio}).causes
    assert cause.probability == pytest.approx(0.99 * (1.0 - part), abs=0.01)


def test_a_value_that_moves_from_state_to_state_is_known_less(judged):
    selected = judged[1]
    [term], [scale] = selected.chosen, [p.scale for p in selected.effects[-1].parameters]
    (still,) = kind(judged).causes[0].parameters.values()
    moved = {"spread": {term.index: np.array([3.0 * still.std / scale])}}
    (told,) = kind(judged, told=moved).causes[0].parameters.values()
    assert told.std == pytest.approx(np.sqrt(10.0) * still.std)


def test_a_gap_down_to_a_known_noise_is_explained(judged):
    assert kind(judged).verdict == Outcome.EXPLAINED


@pytest.mark.parametrize(("ratio", "earned"), [(1.1, True), (1.2, False)])
def test_explained_are_rows_left_out_to_a_seventh_above_their_noise(
    judged, monkeypatch, ratio, earned
):
    monkeypatch.setattr(judge_module, "by_chance", lambda *_: 1.0)
    sigma = judged[4].sigma / ratio
    assert (kind(judged, noise={"sigma": sigma}).verdict == Outcome.EXPLAINED) == earned


@pytest.mark.parametrize(("p", "earned"), [(0.15, True), (0.25, False)])
def test_explained_leaves_less_than_a_fifth_to_what_the_library_lacks(judged, p, earned):
    assert (kind(judged, told={"conditional": p}).verdict == Outcome.EXPLAINED) == earned


def test_probabilities_of_a_part_of_the_rows_say_so(judged):
    said = "probabilities and the tree are from 7 of"
    assert any(note.startswith(said) for note in kind(judged, told={"compared": 7}).notes)
    assert not any("the tree are from" in note for note in kind(judged).notes)


@pytest.mark.parametrize(("chance", "earned"), [(1.15, False), (1.3, True)])
def test_of_few_rows_explained_allows_for_what_chance_adds(judged, monkeypatch, chance, earned):
    monkeypatch.setattr(judge_module, "by_chance", lambda *_: chance)
    sigma = judged[4].sigma / 1.25
    assert (kind(judged, noise={"sigma": sigma}).verdict == Outcome.EXPLAINED) == earned


@pytest.mark.parametrize(("ratio", "earned"), [(1.0, False), (1.1, True)])
def test_rows_left_out_may_err_by_what_rows_fitted_do(judged, monkeypatch, ratio, earned):
    """Noise that is no more than chance above what is stated counts once, in the lack of fit."""
    monkeypatch.setattr(judge_module, "by_chance", lambda *_: 1.15)
    changed = {"sigma": judged[4].sigma / 1.2, "ratio": ratio}
    assert (kind(judged, noise=changed).verdict == Outcome.EXPLAINED) == earned


@pytest.mark.parametrize(
    ("p", "why"), [(0.4, "is too improbable to be named"), (0.6, "are foretold as well without")]
)
def test_what_a_search_chose_in_vain_is_told_with_the_reason(judged, p, why):
    recording, selected, *rest = judged
    parts = (recording, replace(selected, excluded=frozenset({OFFSET})), *rest)
    notes = kind(parts, told={"probabilities": {SCALE: 0.99, OFFSET: p}}).notes
    [said] = [note for note in notes if "search chose" in note]
    assert said.endswith(f"{why}: joint_offset of joint 2")


def test_what_may_be_at_work_instead_leaves_no_gap(judged):
    assert kind(judged, told={"unlisted": 0.4, "conditional": 0.05}).verdict == Outcome.EXPLAINED


def test_beside_what_is_named_is_told_apart_from_instead_of_it():
    """Of the states that hold what is named, those that hold what the library lacks too."""
    alt, found = sampled(scale=0.6, offset=0.3)
    both, one, other = frozenset({0, 2}), frozenset({0}), frozenset({2})
    logs = {both: np.log(0.1), one: np.log(0.5), other: np.log(0.4)}
    told = _told(alt, replace(found, seen=logs))
    assert told.conditional == pytest.approx(0.1 / 0.6)


def test_a_noise_larger_than_stated_is_told_as_that_and_is_not_known(judged):
    verdict = kind(judged, noise={"ratio": 1.5})
    assert (verdict.verdict, verdict.meaning) == (Outcome.PARTLY, NOISIER)
    assert verdict.outside_probability < 0.1
    assert any(note.startswith("noise larger than stated") for note in verdict.notes)
    assert kind(judged, told={"unlisted": 0.4, "conditional": 0.4}).meaning != NOISIER


@pytest.mark.parametrize(("low", "shown"), [(-0.01, False), (0.01, True)])
def test_a_cause_of_which_rows_left_out_show_nothing_is_said_to_be_of_the_others(
    judged, low, shown
):
    recording, selected, seen, told, noise = judged
    parts = recording, selected, replace(seen, interval=(low, 0.5)), told, noise
    verdict = kind(parts, told={"unlisted": 0.6, "conditional": 0.6})
    assert verdict.verdict == Outcome.PARTLY
    assert (verdict.meaning != NOT_SHOWN) == shown


def test_without_a_known_noise_nothing_further_was_found(judged):
    verdict = kind(judged, noise={"source": "fit"})
    assert verdict.verdict == Outcome.PARTLY
    assert verdict.meaning == NOTHING_FURTHER
    assert verdict.to_dict()["gap"]["noise_floor"] is None
    assert kind(judged).to_dict()["gap"]["noise_floor"] > 0.0


def test_a_parameter_at_its_bound_explains_nothing(judged, monkeypatch):
    stuck = Estimate(1.0, 0.1, "1", at_bound=True)
    cause = Cause("joint_scale", "joint", 2, probability=0.99, parameters={"gain": stuck})
    monkeypatch.setattr(judge_module, "causes_of", lambda *_: (cause,))
    assert kind(judged).verdict == Outcome.PARTLY
    assert kind(judged).meaning == ON_A_BOUND
    free = replace(cause, parameters={"gain": replace(stuck, at_bound=False)})
    monkeypatch.setattr(judge_module, "causes_of", lambda *_: (free,))
    assert kind(judged).verdict == Outcome.EXPLAINED


def test_fits_that_did_not_end_explain_nothing(judged, monkeypatch):
    for converged, earned in ((False, Outcome.PARTLY), (True, Outcome.EXPLAINED)):
        one = Judged("the fit", converged, 0.0, 0.0, ())
        monkeypatch.setattr(judge_module, "judgement_of", lambda *_, one=one: Judgement.of([one]))
        assert kind(judged).verdict == earned


@pytest.mark.parametrize(("apart", "said"), [(0.015, False), (0.03, True)])
def test_chains_that_differ_by_more_than_a_percent_or_two_are_told_of(judged, apart, said):
    notes = kind(judged, told={"apart": apart}).notes
    assert any("searches from different starts differ" in note for note in notes) == said


def test_what_is_not_more_probable_than_not_is_no_cause_but_may_be_confounded_with_one(judged):
    verdict = kind(judged, told={"probabilities": {SCALE: 0.4}, "named": frozenset()})
    assert verdict.causes == ()
    assert verdict.candidates[0].probability == 0.4
    assert any(
        "each too improbable to be named" in note and "joint_scale" in note
        for note in verdict.notes
    )
    assert not any("each too improbable to be named" in note for note in kind(judged).notes)


def test_confounded_terms_that_foretell_rows_are_not_called_no_explanation(judged):
    outside = kind(judged, told={"named": frozenset(), "unlisted": 0.9})
    assert outside.verdict == Outcome.OUTSIDE
    assert outside.meaning == ONLY_CONFOUNDED
    assert [(p.stage, p.element) for p in outside.where] == [("joint", 2)]
    nothing = replace(outside, gap=replace(outside.gap, shrink_ci95=(0.0, 0.0)))
    assert nothing.meaning == MEANING[Outcome.OUTSIDE]


def test_what_foretells_rows_is_a_gap_even_where_nothing_is_sure_of_it(judged):
    told = {"named": frozenset(), "probabilities": {SCALE: 0.4}}
    assert kind(judged, told=told).verdict == Outcome.OUTSIDE
    recording, selected, seen, *rest = judged
    chance = (recording, selected, replace(seen, interval=(-0.1, 0.3)), *rest)
    assert kind(chance, told=told).verdict == Outcome.NO_GAP


def test_a_gap_lies_at_the_places_of_all_that_may_do_the_same(judged):
    selected = judged[1]
    places = [(str(c.effect.stage), c.effect.element) for c in selected.selection.candidates]
    other = places.index(("joint", 3))
    states = ((np.log(0.6), selected.chosen), (np.log(0.4), (SelectedTerm(other, 1.0),)))
    told = {"named": frozenset({SCALE}), "states": states}
    equals = kind(judged, told={**told, "probabilities": {SCALE: 0.45}})
    found = {(p.stage, p.element): p.share for p in equals.where}
    assert found == pytest.approx({("joint", 2): 0.6, ("joint", 3): 0.4})
    sure = kind(judged, told={**told, "probabilities": {SCALE: 0.99}})
    assert [(p.stage, p.element) for p in sure.where] == [("joint", 2)]
    # What a sweep held is as good as any other, and no place of the fit alone has a share.
    swept = tuple((0.0, (SelectedTerm(other, 1.0),)) for _ in range(3))
    many = kind(judged, told={"swept": swept})
    assert [(p.stage, p.element) for p in many.where] == [("joint", 3)]


def test_where_a_model_is_open_errors_are_those_of_blocks(judged, monkeypatch):
    wide = np.full(judged[1].best.problem.size, 7.0)
    monkeypatch.setattr(judge_module, "block_errors", lambda selected, models: wide)
    (estimate,) = kind(judged, told={"unlisted": 0.9}).causes[0].parameters.values()
    assert estimate.std == 7.0
    (estimate,) = kind(judged, told={"one_by_one": True}).causes[0].parameters.values()
    assert estimate.std == 7.0
    (estimate,) = kind(judged).causes[0].parameters.values()
    assert estimate.std < 1.0


@pytest.mark.parametrize(("causes", "asked"), [(6, "sample"), (7, "best_near")])
def test_states_of_up_to_six_causes_are_looked_at_whole(scaled, monkeypatch, causes, asked):
    """Longer ones are climbed, and asked place by place."""

    class ReachedError(Exception):
        pass

    def reached(*_):
        raise ReachedError

    _, selected, _ = scaled
    monkeypatch.setattr(type(selected.selection), "keys", lambda *_: set(range(causes)))
    monkeypatch.setattr(explanation_module, asked, reached)
    with pytest.raises(ReachedError):
        explain(selected, 0)
