"""What the search for a drive's causes takes, and that it misses nothing by it."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import casadi as cs
import numpy as np
import pytest
import scipy

from plumbline import build_motion, diagnose
from plumbline.experiments.reality import drives
from plumbline.kinematics.drive import Drive, Memory
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.law import Law
from plumbline.optim.core.progress import silent
from plumbline.optim.diagnosis.motion import diagnose as diagnose_module
from plumbline.optim.diagnosis.motion import fit, models, rollout, search
from plumbline.optim.diagnosis.motion.constants import ENOUGH, RACE, SEARCH_ITERATIONS, WAYS
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.diagnosis.motion.windows import Windows
from plumbline.optim.diagnosis.options import DiagnosisOptions
from tests.motions import arm, multisine, recorded


@pytest.mark.parametrize(
    ("most", "near", "cheap"), [(None, True, True), (1, False, True), (SEARCH_ITERATIONS, True, 0)]
)
def test_of_several_starts_the_best_after_a_few_steps_goes_on_alone(most, near, cheap, monkeypatch):
    """Every pair of a drive's effects: as near as whole fits from all starts, for less work."""
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=True))
    signals = signals_of(recorded([{"delay": 0.06, "lag": 0.1, "play": 0.02}, {}]))
    windows, seen, rolled = signals.windows(0, signals.starts), signals.seen(0), []
    own = fit.roll_out
    monkeypatch.setattr(fit, "roll_out", lambda *a, **k: rolled.append(1) or own(*a, **k))

    def left(race):
        monkeypatch.setattr(models, "RACE", race)
        rolled.clear()
        fitted = models.Models(windows, library, seen)
        first = frozenset({next(e for e in library if e.name == "servo_bandwidth")})
        for key in (first, *(first | {e} for e in library if e not in first)):
            fitted.fit(
                key, fitted.found[key & first] if key != first else fitted.found[frozenset()]
            )
        return np.array([f.square**0.5 for f in fitted.found.values()]), len(rolled)

    whole, all_of_it = left(SEARCH_ITERATIONS)
    best, some = left(RACE if most is None else most)
    assert (best < 1.05 * whole).all() == near, (best / whole).max()
    assert (some < 0.8 * all_of_it) == cheap, some / all_of_it


@pytest.mark.parametrize(
    ("alone", "both", "left"),
    [(1.025, 1.035, 2), (1.025, 1.045, 4), (1.015, 1.045, 3), (1.015, 1.035, 2)],
)
def test_effects_that_take_next_to_nothing_each_are_spared(alone, both, left):
    """Of the square that is left without: two that do each other's work go together."""
    signals = signals_of(recorded([{}, {}], seconds=12.0))
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=False))[:4]
    found = models.Models(signals.windows(0, signals.starts), library, signals.seen(0))
    needed, whole = set(library[:2]), frozenset(library)
    for n in range(len(library)):
        for key in map(frozenset, combinations(library, n)):
            square = {0: 1.0, 1: alone, 2: both}[2 - len(key - needed)] if key >= needed else 9.0
            found.found[key] = SimpleNamespace(square=square, effects=())
    found.found[whole] = SimpleNamespace(square=1.0, effects=())
    assert len(found.spared(whole)) == left
    assert found.spared(whole) >= needed


@pytest.mark.parametrize(("sigma", "found_together"), [(None, True), (0.1, True), (0.7, False)])
def test_two_effects_that_are_worth_little_alone_are_found_together_where_more_than_noise_is_left(
    sigma, found_together, monkeypatch
):
    """A third that is worth more than either had been in their place, and no exchange led on."""
    signals = signals_of(recorded([{}, {}], seconds=12.0))
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=False))[:4]
    found = models.Models(signals.windows(0, signals.starts), library, signals.seen(0))
    both, other = frozenset(library[:2]), library[2]
    for n in range(len(library) + 1):
        for key in map(frozenset, combinations(library, n)):
            square = 0.01 if key >= both else 0.5 if other in key else 1.0
            found.found[key] = SimpleNamespace(square=square, effects=())
    worth = {key: -np.log(fit.square) - 0.1 * len(key) for key, fit in found.found.items()}
    monkeypatch.setattr(models.Models, "time", 1.0)
    monkeypatch.setattr(found, "score", lambda key, _: worth[key])
    alone = found.settle(found.climb())
    assert alone == {other}
    assert found.from_pairs(alone, sigma) == (both if found_together else alone)


def test_what_a_coarser_clock_hides_is_found_where_more_than_noise_is_left():
    """Of a lag by small steps: it leads by half of one, as straight commands between rows lag."""
    h, lag, band = 1e-3, 0.05, 0.015
    t, u = multisine(24.0, 0.01, size=0.4, fastest=1.5)
    asked = np.column_stack([np.interp(np.arange(0.0, t[-1], h), t, x) for x in u.T])
    q, at = [], asked[0].copy()
    for c in asked:
        error = c - at
        error[0] -= np.clip(error[0], -band, band)
        at += h / lag * error
        q.append(at.copy())
    q = np.array(q)[::10] + np.random.default_rng(0).normal(0.0, 3e-4, (len(q[::10]), 2))
    r = build_motion(robot=arm(), time=t[: len(q)], command=u[: len(q)], q=q, noise_std=3e-4)
    answer = diagnose(r)
    assert answer.outside_probability < 0.5
    values = {(c.effect, c.element): c for c in answer.causes}
    assert {e for e, j in values if j == 2} == {"actuation_lag", "actuation_delay"}
    play = values["actuation_play", 1]
    assert play.probability == pytest.approx(0.5, abs=0.05)
    assert [b.effect for b in play.confounded_with] == ["actuation_deadband"]


NAMES = {e.name: e for e in MOTION_EFFECTS}
STIFF, DELAY, LAG, PLANS, FASTEST = (
    NAMES[n]() for n in ("servo_stiffness", "actuation_delay", "actuation_lag",
                         "acceleration_limit", "velocity_limit")
)  # fmt: skip
SLACK, STICK = NAMES["actuation_play"](), NAMES["actuation_play"](inside=True)
BAND, LESS = NAMES["actuation_deadband"](), NAMES["actuation_deadband"](less=True)
SAGS = NAMES["servo_stiffness"](inside=True)


@pytest.mark.parametrize(
    ("effects", "others"),
    [
        ((DELAY, SLACK), {STICK, BAND, LESS}),
        ((DELAY, STIFF, BAND), {SLACK, STICK, LESS, SAGS}),
        ((DELAY, SAGS), {STIFF}),
        ((LAG, SAGS), set()),
        ((FASTEST, STIFF), set()),
        ((PLANS, STICK), {SLACK, BAND, LESS}),
        ((LAG, STICK), {LESS}),
        ((LAG, LESS), {STICK}),
        ((LAG, SLACK), set()),
        ((LAG, BAND), set()),
        ((FASTEST, SLACK), set()),
        ((LAG, BAND, STICK), set()),
        ((DELAY,), set()),
    ],
)
def test_a_drive_is_fitted_once_and_counts_under_every_name_that_it_goes_by(effects, others):
    """What no motion tells apart shares its probability, whichever of it the search came upon."""
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=True))
    signals = signals_of(recorded([{"delay": 0.06, "play": 0.02}, {}]))
    fitted = models.Models(signals.windows(0, signals.starts), library, signals.seen(0))
    fitted.fit(frozenset(effects), fitted.found[frozenset()])
    own = {frozenset(effects), frozenset()}
    kept = {one for key in fitted.found.keys() - own for one in key - set(effects)}
    assert kept == others
    found = fitted.found[frozenset(effects)]
    for key in fitted.found.keys() - own:
        fit_of = fitted.found[key]
        again = fit.evaluated(fitted.windows, fit_of.effects, fit_of.theta)
        np.testing.assert_allclose(again.residual, found.residual, rtol=0, atol=1e-9)


def test_no_name_is_taken_where_commands_are_rates():
    assert not list(models.twins((SLACK,), Law.VELOCITY, (SLACK, BAND)))


@pytest.mark.parametrize("rough", [False, True])
def test_a_search_takes_a_way_s_slopes_to_one_side_and_a_verdict_to_both(rough, monkeypatch):
    signals = signals_of(recorded([{"delay": 0.06, "play": 0.02}, {}]))
    windows, rolled, own = signals.windows(0, signals.starts), [], rollout._passed
    effects, at = (DELAY, PLANS, LAG, SLACK), np.array([0.03, 8.0, 0.05, 0.01])
    fine = fit.evaluated(windows, effects, at).J
    monkeypatch.setattr(rollout, "_passed", lambda *a: rolled.append(a[3]) or own(*a))
    J = fit.evaluated(windows, effects, at, rough=rough).J
    assert rolled == [(2, 3), *[()] * (2 if rough else 4)]  # of delay and limit
    left = np.linalg.norm(J - fine, axis=(0, 1)) / np.linalg.norm(fine, axis=(0, 1))
    assert (left < 0.15).all()
    assert (left.max() > 0) == rough
    rolled.clear()
    fit.fitted(windows, effects, at, 1 if rough else 0)
    assert rolled[: 4 if rough else 6] == [(2, 3), *[()] * (2 if rough else 4), ()]


def test_a_planned_way_is_rolled_out_once_for_all_that_is_tried_behind_it(monkeypatch):
    signals = signals_of(recorded([{"delay": 0.06, "play": 0.02}, {}]))
    windows, planned, own = signals.windows(0, signals.starts), [], rollout._plan
    monkeypatch.setattr(rollout, "_plan", lambda *a: planned.append(1) or own(*a))
    for play in (0.01, 0.02, 0.03):
        fit.evaluated(windows, (PLANS, SLACK), np.array([8.0, play]), slopes=False)
        fit.evaluated(windows, (PLANS, LAG), np.array([8.0, play]), slopes=False)
    assert len(planned) == 1
    for steepest in np.linspace(4.0, 7.0, 2 * WAYS):
        fit.evaluated(windows, (PLANS, SLACK), np.array([steepest, 0.02]), slopes=False)
    assert len(windows.ways) == WAYS  # so that memory does not grow with the search


@pytest.mark.parametrize("told", [False, True])
def test_what_is_behind_a_planned_way_does_as_the_whole_drive_does(told):
    """By the drive's own steps, one sample after the other, no way apart."""
    effects = (NAMES["actuation_gain"](), LAG, SLACK, NAMES["velocity_limit"](told=told), PLANS)
    values, u, dt = np.array([1.1, 0.04, 0.02, 0.4, 3.0]), np.sin(np.arange(120) / 9.0), 0.02
    zeros = np.zeros(120)
    windows = Windows(
        Law.POSITION, dt, 0.0, 0.0, u, zeros.astype(int), *[zeros] * 4, zeros + 1.0,
        np.array([0]), 119, 0,
    )  # fmt: skip
    there = fit.evaluated(windows, effects, values, slopes=False).residual[0]
    state, rest = cs.SX.sym("state", 8), map(cs.SX, (0, 1, 0, 0, 1))
    drive = Drive(Law.POSITION, cs.SX(dt), cs.SX.sym("u"), *rest)
    command = drive.command
    for effect, value in zip(effects, values, strict=True):
        drive = effect.apply(drive, value)
    after = drive.step(Memory(*cs.vertsplit(state)))
    step = cs.Function("step", [state, command], [cs.vertcat(*vars(after).values()), after.output])
    now, expected = np.array([u[0], 0, (u[1] - u[0]) / dt, 0, u[0], u[0], 0, 0]), []
    for sample in u[1:]:
        now, q = step(now, sample)
        expected.append(float(q))
    np.testing.assert_allclose(there, expected, rtol=0, atol=1e-12)


def test_neighbours_of_a_drive_are_those_of_every_form_that_it_goes_by():
    """From a delay and a dead band that is play, a lag and play were two exchanges away."""
    signals = signals_of(recorded([{"lag": 0.05, "play": 0.01}, {}], seconds=20.0))
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=False))
    found = models.Models(signals.windows(0, signals.starts), library, signals.seen(0))

    plain = {e.name.removeprefix("actuation_"): e for e in library if not e.variant}

    def key(*names):
        return frozenset(plain[name] for name in names)

    less = next(e for e in library if e.name == "actuation_deadband" and e.variant)
    here = key("delay") | {less}
    found.fit(here, found.found[frozenset()])
    assert key("lag", "play") in found.around(here)
    assert key("delay", "lag", "play") in found.with_one_more(here)
    assert here not in found.around(here)


def test_a_form_that_is_worse_alone_may_come_with_another_effect():
    """With a lag, a dead band that lets large rates whole hid one that does not and a delay."""
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.RATE, masses=False))
    delay, lag, whole, less = (
        next(e for e in library if e.name == f"actuation_{name}" and bool(e.variant) == varies)
        for name, varies in (("delay", 0), ("lag", 0), ("deadband", 0), ("deadband", 1))
    )
    signals = signals_of(recorded([{"lag": 0.05}, {}], seconds=20.0))
    found = models.Models(signals.windows(0, signals.starts), library, signals.seen(0))
    found.fit(here := frozenset((lag, whole)), found.found[frozenset()])
    assert frozenset((lag, less, delay)) in found.in_another_form(here)


def test_a_search_goes_on_from_what_all_windows_alone_have_shown():
    """Of a saturated motor effects were spared that no search on fewer windows had tried."""
    signals = signals_of(recorded([{"gain": 0.1, "lag": 0.05}, {}], seconds=20.0))
    library = tuple(e for c in MOTION_EFFECTS for e in c.candidates(Law.POSITION, masses=False))
    starts, seen = signals.starts, signals.seen(0)
    few, whole = (
        models.Models(signals.windows(0, at), library, seen) for at in (starts[:1], starts)
    )
    both = frozenset(e for e in library if e.name in ("actuation_gain", "actuation_lag"))
    whole.fit(both, whole.found[frozenset()])
    assert whole.again(few, frozenset()) >= both
    assert both in few.found


def test_commands_that_run_otherwise_between_rows_are_searched_from_what_was_found(monkeypatch):
    """Of the same motion, the same drive: a search from nothing had been made twice."""
    r = recorded([{"lag": 0.05, "play": 0.01}, {}], seconds=20.0)
    climbed, own = [], models.Models.climb
    monkeypatch.setattr(models.Models, "climb", lambda self, *a: climbed.append(1) or own(self, *a))
    _, begun = diagnose_module._begun(DiagnosisOptions(), silent, signals_of(r))
    assert len(climbed) == 2
    other = signals_of(replace(r, law=Law.SMOOTH))
    _, anew = diagnose_module._begun(DiagnosisOptions(), silent, other, begun)
    assert len(climbed) == 2
    assert [models.names_of(one.key) for one in anew] == [models.names_of(b.key) for b in begun]


def test_what_stands_in_a_cause_s_place_is_told_in_one_order():
    """Sets of names are in another order in every process."""
    others = frozenset(effect.name for effect in MOTION_EFFECTS)
    told = search._instead("a cause", {"a cause": None}, [(others, 0.5)])
    assert list(told) == sorted(others)


def planned(seconds, **wrong):
    """Signals of a drive that plans its ways and does what is wrong besides."""
    rng = np.random.default_rng(0)
    t, u = multisine(seconds, fastest=2.0)
    q = drives.follow(t, u[:, 0], np.zeros(len(t)), drives.Wrong(**wrong), rng)
    q = np.column_stack([q + rng.normal(0.0, 3e-3, len(t)), u[:, 1]])
    return signals_of(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=3e-3))


def test_what_contends_with_a_planned_way_is_fitted_to_the_end():
    """A search's fits of it end early: a servo of second order went before the lag that it was."""
    signals = planned(40.0, steepest=2.0, lag=0.025)
    swings = next(e for e in MOTION_EFFECTS if e.name == "servo_bandwidth")()
    found = models.Models(
        signals.windows(0, signals.starts), (DELAY, PLANS, LAG, swings), signals.seen(0)
    )
    listed, other = frozenset((PLANS, LAG)), frozenset((PLANS, swings))
    for key, values in ((listed, (2.0, 0.027)), (other, (2.0, 0.08))):
        effects = tuple(e for e in found.library if e in key)
        found.keep(fit.evaluated(found.windows, effects, np.array(values)))
    before = found.score(listed, found.time)
    found.finished(other)
    assert found.score(listed, found.time) > before + 2.0  # nats
    for key in (listed, other):
        done = found.found[key]
        again = fit.fitted(found.windows, done.effects, done.theta)
        assert again.square > (1 - ENOUGH) * done.square


@pytest.mark.parametrize(("plans", "better"), [(True, True), (True, False), (False, True)])
def test_a_fit_of_a_planned_way_goes_on_from_a_better_one_than_it_began_from(plans, better):
    """A delay beside a way not yet as it is was 90 ms for 77, and a servo of second order told."""
    signals = planned(30.0, steepest=2.0, delay=0.077)
    found = models.Models(signals.windows(0, signals.starts), (DELAY, PLANS, LAG), signals.seen(0))
    way = PLANS if plans else LAG
    effects = tuple(e for e in found.library if e in (DELAY, way))
    key, poor = frozenset(effects), np.array([0.09, 2.1 if plans else 0.01])
    found.keep(stuck := fit.evaluated(found.windows, effects, poor))
    found.began[key] = stuck.square
    alone = fit.evaluated(found.windows, (way,), np.array([2.0 if plans else 0.08]))
    alone = replace(alone, residual=alone.residual * (0.01 if better else 1e3))
    found.fit(key, alone)
    assert (found.found[key].square < 0.9 * stuck.square) == (plans and better)


def test_a_value_is_as_uncertain_as_the_forms_that_its_rows_leave_open_make_it():
    """A lag beside a delay is another than beside a servo of second order, and either may be.

    Under noise that wanders values had been 20 of their standard errors off, where the second form
    was chosen.
    """
    rng = np.random.default_rng(5)
    t, u = drives.commands(rng)
    t, u = t[t < 40.0], u[t < 40.0]
    late = drives.follow(t, u[:, 0], 0.0 * t, drives.Wrong(delay=0.06, lag=0.1), rng)
    white = rng.normal(0.0, 1.5e-3, (len(t), 2))
    wanders = scipy.signal.lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], white, axis=0)
    q = np.column_stack([late, u[:, 1]]) + wanders
    first = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=1.5e-3)).joints[0]
    assert {e.name for e in first.fit.effects} == {"actuation_delay", "actuation_lag"}
    assert first.probability["servo_bandwidth"] > 0.05
    alone = np.sqrt(np.diag(first.fit.covariance(first.effective)))
    assert (first.std > 5 * alone).all(), (first.std, alone)
    assert (first.std > 0.02).all()  # [s]: a servo of second order has half the lag
