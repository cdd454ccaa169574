"""What further constants decide: wide priors, spectra, levers, axes, simulated cases."""

from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.optim.diagnosis.calibrate import check
from plumbline.optim.diagnosis.calibrate.simulation import Fault
from plumbline.optim.diagnosis.design import next_experiment
from plumbline.optim.diagnosis.design.course import Course, _cooled
from plumbline.optim.diagnosis.design.future_rows import FutureRows, _within_reach
from plumbline.optim.diagnosis.design.rows import Design, DesignOptions
from plumbline.optim.diagnosis.discrepancy import dependence
from plumbline.optim.diagnosis.discrepancy.alternatives import _shared_shift, spread_of_noise
from plumbline.optim.diagnosis.discrepancy.torque_dependences import _thinned_path
from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior import correlation, robust, search, slots
from plumbline.optim.diagnosis.posterior import selection as selecting
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, Scores
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SOLVER, ridge_of
from plumbline.optim.diagnosis.posterior.selection import SelectionProblem
from plumbline.optim.diagnosis.posterior.spectrum import _filled, _joints_with_spectra
from plumbline.optim.diagnosis.predict.shrink import blocks_of_rows
from plumbline.optim.diagnosis.verdict.confounding import unobservable
from plumbline.optim.diagnosis.verdict.explanation import Explanation
from plumbline.optim.diagnosis.verdict.judge import _is_earned
from plumbline.optim.diagnosis.verdict.tree import tree_of
from tests.benches import bench
from tests.designs import selection

N, SIGMA = 60, 0.1
KEY = ("backlash", 1)


def test_what_is_always_fitted_is_held_back_by_a_thousandth_of_what_the_rows_say():
    """Of an effect that the rows tell to its usual size, by its prior's precision."""
    asked = selection(np.ones((N, 1)), np.zeros(N), SIGMA)
    [ridge] = ridge_of(asked, [], [None])
    assert 0.0005 < ridge**2 / asked.variance([]) < 0.002


@pytest.mark.parametrize(("count", "joints"), [(2, ()), (3, (2,))])
def test_three_orders_of_one_joint_make_a_spectrum(count, joints):
    effects = [GearRipple(joint=2, order=float(n)) for n in range(3, 3 + count)]
    assert _joints_with_spectra(effects) == joints


@pytest.mark.parametrize(("ratio", "lever"), [(3.0, 3.0), (1e3, 10.0), (1e-3, 0.1)])
def test_a_lever_of_noises_changes_by_no_more_than_a_decade(ratio, lever, monkeypatch):
    monkeypatch.setattr(robust, "rotation_lever", lambda _: 1.0)
    residuals = np.hstack([np.full((N, 3), ratio), np.ones((N, 3))])
    solution = SimpleNamespace(
        x=None,
        mapped=SimpleNamespace(residuals=lambda _: residuals),
        problem=SimpleNamespace(weights=np.ones(N)),
    )
    assert robust.noise_lever(solution, None) == pytest.approx(lever, rel=0.4)


@pytest.mark.parametrize(("left", "seen"), [(0.6e-7, False), (1.6e-7, True)])
def test_an_effect_of_which_nuisances_leave_nothing_but_rounding_cannot_be_seen(left, seen):
    asked = selection(np.sqrt(left) * np.ones((N, 1)) / np.sqrt(N), np.zeros(N), 1e-9)
    whole = selection(np.ones((N, 1)) / np.sqrt(N), np.zeros(N), 1e-9).linear
    model = SimpleNamespace(terms=[])
    pool = SimpleNamespace(whole=whole, candidates=asked.candidates, model=model, always=0)
    assert bool(unobservable(pool, asked, [], None, 1e-9, ())) != seen


def test_an_axis_without_noise_counts_as_a_fifth_as_noisy_as_all():
    target = np.ones((N, 3)) * [0.0, 1.0, 1.0]
    base, gross = np.zeros((0, N, 3)), np.zeros(N, dtype=bool)
    pool = SimpleNamespace(noise=NoisePrior(1e-9), columns=lambda _: np.arange(0))
    live = np.ones(target.shape, dtype=bool)
    ports = SimpleNamespace(target=target, base=base, gross=gross, live=live)
    assert 0.18 < spread_of_noise(pool, (), ports)[0] < 0.28


def test_a_rest_as_long_as_the_recording_cools_to_a_twentieth():
    recording = SimpleNamespace(temperature=np.array([20.0, 30.0]), time=np.array([0.0, 60.0]))
    assert 0.03 < (_cooled(recording, 30.0, 60.0) - 20.0) / 10.0 < 0.08


@pytest.mark.parametrize(("stated", "least"), [(0.0, 1e-8), (1e-20, 1e-12)])
def test_no_fit_is_finer_than_ten_nanometres_nor_a_stated_noise_than_rounding(stated, least):
    known = NoisePrior(stated, 100.0 if stated else 0.0)
    assert 0.6 * least < np.sqrt(known.variance(0.0, 10)) < 1.6 * least


@pytest.mark.parametrize(("gain", "asked"), [(4.0, 0.0), (6.0, 0.5)])
def test_a_correlation_of_rows_must_win_by_five_in_log_odds(gain, asked, monkeypatch):
    left = np.zeros((N, 3))
    price = 0.5 * np.log(left.size)  # of one number more
    likely = {0.5: gain + price}
    monkeypatch.setattr(correlation, "postures", lambda _: np.arange(N))
    monkeypatch.setattr(correlation, "_wandering", lambda *given: likely.get(given[-1], 0.0))
    (wander, *_), _ = correlation.correlation_of(
        left, SimpleNamespace(wander=0.0, alike=0.0, jitter=0.0, scatter=None), NoisePrior()
    )
    assert wander == asked


@pytest.mark.parametrize(("gross", "shifts"), [(1, 0), (2, 1), (3, 1)])
def test_two_rows_that_may_be_gross_may_share_a_shift_of_the_tool(gross, shifts):
    ports = SimpleNamespace(
        gross=np.arange(N) < gross, shift=np.zeros((3, N, 3)), body=np.ones((6, N, 3))
    )
    found = _shared_shift(np.broadcast_to(np.eye(3), (N, 3, 3)), ports)
    assert len(found) == shifts


def test_a_spectrum_has_the_whole_orders_up_to_some_forty():
    high = GearRipple(joint=2, order=120.0)
    filled = _filled([high, GearRipple(joint=2, order=7.3)], [2])
    assert high in filled
    assert 30 < max(e.order for e in filled if e is not high) < 60
    assert all(e.order == round(e.order) for e in filled)


def test_an_unknown_shift_is_about_a_third_of_a_millimetre_and_takes_few_columns():
    found = dependence.acting("", "", "joint", 1, np.ones((1, N)), np.ones((1, N, 3)))
    assert 2e-4 < np.abs(found.columns).max() < 5e-4
    many = np.random.default_rng(0).normal(size=(40, N, 3))
    assert 10 < len(dependence.leading(many)) < 20


def told(**given):
    return Explanation(
        **({"probabilities": {}, "sensitive": {}, "mechanisms": {}, "places": {}} | given)
    )


@pytest.mark.parametrize(("unlisted", "is_open"), [(0.15, False), (0.25, True)])
def test_a_model_is_open_where_something_unlisted_is_no_less_probable_than_before(
    unlisted, is_open
):
    assert told(unlisted=unlisted).is_open == is_open


def test_a_place_is_told_from_two_per_cent_on():
    places = {("joint", 1): 0.03, ("joint", 2): 0.013}
    assert [found["element"] for found in tree_of(places, {})] == [1]


@pytest.mark.parametrize(("p", "first"), [(0.992, 2), (0.975, 1)])
def test_of_places_as_probable_to_what_chains_repeat_the_one_that_moves_more_comes_first(p, first):
    places, moved = {("joint", 1): 0.995, ("joint", 2): p}, {("joint", 1): 1.0, ("joint", 2): 4.0}
    assert tree_of(places, {}, moved)[0]["element"] == first


def test_of_mechanisms_as_probable_the_one_that_was_given_first_comes_first():
    at = ("actuation", 1, "history")
    both = {(*at, "actuation_play"): 0.5, (*at, "actuation_deadband"): 0.5 + 1e-12}
    [place] = tree_of({at[:2]: 1.0}, both)
    told = [m["effect"] for m in place["dependences"][0]["mechanisms"]]
    assert told == ["actuation_play", "actuation_deadband"]


def test_what_mechanisms_lack_of_their_place_is_of_none_of_the_library():
    """A name that is only 60 % sure, at a place that is sure, leaves 40 % to something unlisted."""
    at = ("joint", 2)
    [place] = tree_of({at: 1.0}, {(*at, "own angle", "gear_ripple"): 0.6})
    [on] = place["dependences"]
    told = {m["effect"]: (m["probability"], m["inclusion"]) for m in on["mechanisms"]}
    assert told == {"gear_ripple": pytest.approx((0.6, 0.6)), None: pytest.approx((0.4, 0.4))}
    assert on["probability"] == pytest.approx(1.0)


@pytest.mark.parametrize(("after", "earned"), [(1.1, True), (1.22, False)])
def test_a_gap_is_explained_down_to_a_seventh_above_the_noise(after, earned):
    gap = SimpleNamespace(is_far=False, after=after, noise_floor=1.0)
    assert _is_earned(gap, (), SimpleNamespace(converged=True), 1.0) == earned


# Simulation-based calibration


class Drawn:
    """A setting that notes how large the faults are that are asked for."""

    ratios: ClassVar[list[float]] = []

    def __init__(self, *_):
        self.sigma = 1.0

    def draw(self, ratio, rng, taken=frozenset()):
        self.ratios.append(ratio)
        effect = SimpleNamespace(name="backlash", element=len(taken) + 1)
        return Fault((effect,), np.zeros(1))

    def recorded(self, fault, errors):
        return fault


def simulated(monkeypatch, gap, causes, cases=400):
    """Faults of simulated cases, of a verdict with this gap over the noise and so many causes."""
    monkeypatch.setattr(check, "Setting", Drawn)
    residuals = SimpleNamespace(residuals=lambda _: np.zeros((4, 3)))
    monkeypatch.setattr(check, "Mapped", lambda _: residuals)
    Drawn.ratios = []
    verdict = SimpleNamespace(
        gap=Gap("m", float(np.hypot(gap, 1.0)), 1.0, 1.0, 0.0, (0.0, 1.0)),
        causes=[None] * causes,
        noise=NoiseLevel(1.0, "given", 1.0),
    )
    problem = SimpleNamespace(weights=np.ones(4))
    selected = SimpleNamespace(model=SimpleNamespace(recording=None, problem=problem))
    diagnosis = SimpleNamespace(
        verdict=verdict, selected=selected, options=DiagnosisOptions(),
        solution=SimpleNamespace(x=None),
    )  # fmt: skip
    counts = [len(fault.keys) for _, fault in check._simulated(diagnosis, cases)]
    return counts, np.array(Drawn.ratios)


def test_of_simulated_cases_a_quarter_is_well_and_gaps_are_half_to_twice_the_one_found(monkeypatch):
    counts, ratios = simulated(monkeypatch, 4.0, 1)
    assert 0.18 < np.mean(np.array(counts) == 0) < 0.32
    assert 1.9 < ratios.min() < 2.3
    assert 7.0 < ratios.max() < 8.1


def test_a_simulated_case_has_as_many_causes_as_were_named_but_few(monkeypatch):
    assert max(simulated(monkeypatch, 4.0, 2, 40)[0]) == 2
    assert 2 < max(simulated(monkeypatch, 4.0, 9, 40)[0]) < 5


def test_a_simulated_gap_is_never_fainter_than_a_third_of_the_noise(monkeypatch):
    _, ratios = simulated(monkeypatch, 1e-6, 1)
    assert ratios == pytest.approx(np.full(len(ratios), 0.35), rel=0.3)


def test_a_probability_of_a_few_per_cent_is_a_statement_and_one_per_cent_is_none(monkeypatch):
    candidates = [
        SimpleNamespace(effect="backlash", element=k, probability=p)
        for k, p in enumerate((0.013, 0.03))
    ]
    verdict = SimpleNamespace(candidates=candidates, causes=[])
    monkeypatch.setattr(check, "diagnose", lambda *_: SimpleNamespace(verdict=verdict))
    stated = check._tried(None, Fault(), DiagnosisOptions()).stated
    assert list(stated) == [("backlash", 1)]


# The next experiment


@pytest.mark.parametrize(("left", "said"), [(0.4, "record more of them"), (0.6, "not even")])
def test_rows_are_hopeless_if_many_of_them_leave_half_of_the_doubt(left, said, monkeypatch):
    monkeypatch.setattr(next_experiment, "_if_lead", lambda *_: np.array([0.0, left * 0.3]))
    rivals = SimpleNamespace(leading=0, probabilities=np.array([0.7, 0.3]), labels=("one", "two"))
    design = SimpleNamespace(
        contest=SimpleNamespace(rivals=rivals),
        options=DesignOptions(),
        random_grams=lambda *_: np.zeros((1, 1, 1, 1)),
    )
    [note], _ = next_experiment._untold(design, SimpleNamespace(information=np.zeros((2, 2))))
    assert said in note


@pytest.mark.parametrize(("share", "settled"), [(0.93, False), (0.97, True)])
def test_from_one_in_twenty_on_there_is_something_to_separate(share, settled, monkeypatch):
    two = [SimpleNamespace(probability=p, label=str(p)) for p in (share, 1.0 - share)]
    for name, found in (("explanations", two), ("_beyond", ()), ("_missing_columns", ())):
        monkeypatch.setattr(next_experiment, name, lambda *_, found=found: found)
    pool = SimpleNamespace(of=lambda *_: SimpleNamespace(pool=()))
    monkeypatch.setattr(next_experiment, "Design", pool)
    monkeypatch.setattr(next_experiment, "contest", lambda *_: None)
    monkeypatch.setattr(next_experiment, "_written", lambda *_: None)
    selection = SimpleNamespace(keys=lambda _: ())
    model = SimpleNamespace(recording=SimpleNamespace(chain=None))
    selected = SimpleNamespace(model=model, selection=selection, chosen=())
    [note] = next_experiment.next_experiment(selected, None).notes
    assert note.startswith("nothing to separate") == settled


@pytest.mark.parametrize(("beyond", "near"), [(0.9e-6, True), (1.1e-6, False)])
def test_tips_keep_to_the_box_of_those_seen(beyond, near):
    """Below it there may be a table."""
    seen = SimpleNamespace(
        kind=SimpleNamespace(device=True), q=np.array([[0.0], [1.0]]), tips=lambda q, _: q
    )
    recording = SimpleNamespace(kind=seen.kind, q=seen.q, chain=seen, tool_offset=None)
    wide = np.array([-9.0]), np.array([9.0])
    assert _within_reach(recording, np.array([[1.0 + beyond]]), *wide, seen=True)[0] == near


@pytest.mark.parametrize(("adds", "rests"), [(1.1, False), (1.3, True)])
def test_a_row_rests_before_it_only_if_that_adds_a_fifth(adds, rests):
    """Of gains beyond that of no row at all, which may be other than nought."""
    course = SimpleNamespace(rows_next=lambda row: row)
    design = SimpleNamespace(
        options=SimpleNamespace(criterion=lambda *_: np.array([5.0, 5.0 + adds, 6.0])),
        jacobians=lambda _: [np.eye(3)],
    )
    row = FutureRows(np.zeros((1, 6)), wait=np.array([60.0]))
    found, _ = Design._rested(design, course, None, row, np.eye(3))
    assert (found.wait[0] > 0.0) == rests


# Rounds of what hangs on its own answer, and ties


@pytest.mark.parametrize(("more", "best"), [(0.7e-6, 0), (1.5e-6, 1)])
def test_what_is_chosen_stays_unless_another_is_better_by_more_than_rounding(
    more, best, monkeypatch
):
    asked = selection(np.eye(N)[:, :2], np.zeros(N), SIGMA)
    scores = Scores(np.array([5.0, 5.0 + more]), np.ones(2))
    log_odds = scores.log_bayes
    monkeypatch.setattr(SelectionProblem, "odds", lambda *_: (log_odds, scores))
    assert [t.index for t in slots.asked_again(asked, [SelectedTerm(0, 1.0)])] == [best]


def test_a_model_that_never_settles_is_asked_again_four_times(monkeypatch):
    asked, seen = selection(np.eye(N)[:, :2], np.zeros(N), SIGMA), []

    def other(_, chosen):
        seen.append(chosen)
        return [SelectedTerm(1 - chosen[0].index, 1.0)]

    monkeypatch.setattr(slots, "asked_again", other)
    monkeypatch.setattr(slots, "extended", lambda _, chosen: chosen)
    monkeypatch.setattr(selecting, "extended", lambda *_: [SelectedTerm(0, 1.0)])
    selecting.select(asked, thorough=False)
    assert len(seen) == 4


# What a long recording costs


def still(rows):
    """A recording of so many rows in one place."""
    return bench("ur5", "tip_position").select(np.zeros(rows, dtype=int))


@pytest.mark.parametrize(("rows", "part"), [(3000, 3000), (6000, 3000)])
def test_a_recording_of_more_than_a_few_thousand_rows_is_searched_in_part(rows, part, monkeypatch):
    """All of three thousand, and every second row of twice as many."""
    searched = []

    def stop(task, *_, **__):
        searched.append(len(task.recording))
        raise StopIteration

    monkeypatch.setattr(search, "_from_nothing", stop)
    folds = np.arange(rows) % 5
    task = search.Task(still(rows), folds, NoisePrior(), (), (), SOLVER)
    with pytest.raises(StopIteration):
        search.find_causes(task, lambda *_: None)
    assert searched == [part]
    assert (task.refitting is SOLVER) == (part == rows)


def test_a_thinned_way_keeps_turning_points_of_a_hundred_turns_to_a_two_hundredth():
    turns, rows = 100, 40_000
    phase = 2.0 * np.pi * (turns * np.arange(rows) / rows + 0.013)
    way = replace(still(rows), q=np.sin(phase)[:, None] * np.ones(6))
    q, place = _thinned_path(way.select([5, rows - 5]))
    thinned = q[np.setdiff1d(np.arange(len(q)), place), 0]
    peaks = thinned[1:-1][(thinned[1:-1] > thinned[:-2]) & (thinned[1:-1] > thinned[2:])]
    assert len(peaks) == turns
    assert peaks.min() > 0.995
    assert len(q) < 5000


@pytest.mark.parametrize(("turn", "kept"), [(3000, True), (5000, False)])
def test_rows_to_come_follow_some_minutes_of_the_last_rows_and_no_more(turn, kept):
    """A turn so many rows before the end."""
    path = still(9000)
    q = path.q + 0.01 * (np.arange(9000) == 9000 - turn)[:, None]
    recorded = Course(SimpleNamespace(recording=replace(path, q=q))).recorded()
    assert (np.ptp(recorded.q[:, 0]) > 0.0) == kept
    assert (recorded.q[-1] == q[-1]).all()


@pytest.mark.parametrize(("rows", "own"), [(3000, True), (5000, False)])
def test_each_of_a_few_thousand_rows_is_drawn_alone_and_more_share_their_draws(rows, own):
    blocks = blocks_of_rows(np.zeros(rows, dtype=int), separate=True)
    assert (len(np.unique(blocks)) == rows) == own
