"""How late rates act is learnt as the loop runs; until it is known, distances are wider."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.mpc.closed_loop import noise_for, run, statement_of
from plumbline.experiments.reality.instruments import Mismatch
from plumbline.experiments.reality.instruments import Plant as Reality
from plumbline.experiments.reality.mpc_scenarios import STATED, draw
from plumbline.optim import capsule_mpc
from plumbline.optim.capsule_mpc import (
    Noise,
    Obstacle,
    OneStep,
    Plant,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.underway import Underway
from tests.in_mm import Controller

BODIES = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
STATEMENT = Statement(BODIES, 0, Settings(p=2, noise=Noise(measured=0.0001, step=3e-05)))
START = np.array([-30.0, 0.0, -120.0, 30.0, 0.0, -110.0])
DT = 0.02


def moved(mismatch, told=None, seed=0, rest=0):
    """What is known after some steps; where the tips were to come to rest, truly and as thought."""
    rng = np.random.default_rng(seed)
    reality = Reality(START.reshape(2, 3), mismatch, DT, 20, rng)
    own, thought = Underway(told or Plant(), STATEMENT), []
    t = DT * np.arange(60)[:, None]
    rates = 25.0 * np.sin(rng.uniform(2.0, 6.0, 6) * t) * np.minimum(1.0, t / 0.1)
    for rate in [*rates, *np.zeros((rest, 6))]:
        seen = reality.measure().ravel()
        own.seen(seen)
        waiting = np.sum([q.ravel() for q in reality.queue], axis=0) if reality.queue else 0.0
        rest = reality.tips.ravel() + DT / 20 * waiting + mismatch.lag * reality.speed.ravel()
        thought.append((rest - seen - own.way(), own.stray(seen)))
        own.sent(rate)
        reality.move(rate.reshape(2, 3))
    return own, thought


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.06, 0.1, 0.15])
@pytest.mark.parametrize("gain", [0.0, 0.2])
def test_a_delay_that_nobody_told_is_learnt_to_milliseconds(delay, gain):
    own, _ = moved(Mismatch(0.1, 0.03, gain=gain, delay=delay))
    np.testing.assert_allclose(own.later, delay, atol=6e-3)


@pytest.mark.parametrize("told", [0.03, 0.06, 0.12])
def test_a_delay_that_was_told_wrong_is_put_right_from_either_side(told):
    own, _ = moved(Mismatch(0.1, 0.03, delay=0.06), told=Plant(delay=told))
    np.testing.assert_allclose(own.late, 0.06, atol=6e-3)
    assert bool(own.said()) == (told != 0.06)


@pytest.mark.parametrize(
    "wrong", [{"delay": 0.06}, {"delay": 0.15}, {"lag": 0.06}, {"delay": 0.02}]
)
def test_where_it_comes_to_rest_is_never_farther_off_than_what_is_still_possible(wrong):
    for seed in range(10):
        _, thought = moved(Mismatch(0.1, 0.03, **wrong), seed=seed)
        for off, stray in thought:
            assert np.abs(off).max() < stray + 5 * 0.1 + 0.3


def test_before_anything_is_seen_all_that_was_sent_may_still_come():
    own = Underway(Plant(), STATEMENT)
    own.seen(START)
    for _ in range(4):
        own.sent(np.array([30.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert own.stray(START) == pytest.approx(4 * DT * 30.0)
    assert np.abs(own.way()).max() == 0.0


def test_at_rest_nothing_is_learnt_and_nothing_lost():
    soon, late = (moved(Mismatch(0.1, 0.0, delay=0.06), rest=rest)[0] for rest in (20, 500))
    np.testing.assert_allclose(late.later, soon.later, atol=1e-4)
    np.testing.assert_allclose(late._count, soon._count, rtol=0.1)


@pytest.mark.parametrize("wrong", [{"delay": 0.06}, {"delay": 0.1}, {"delay": 0.15}, {"lag": 0.08}])
def test_a_plant_that_is_late_and_does_not_say_so_touches_nothing(wrong):
    """Shafts that cross near their trocars; before, they met by up to 4 mm."""
    scenario = draw("shallow", 900_003, replace(STATED, **wrong))
    statement = statement_of(scenario, Settings(p=5, noise=noise_for(STATED, 60.0)))
    own = capsule_mpc.Controller(statement, OneStep(compiled=False), Safety(budget=9.0))
    found = run(scenario, own, most=120)
    assert found.clearance > 2.0
    assert found.events["late"] > 50


@pytest.mark.parametrize("known", [0, 5])
def test_what_swings_past_a_late_plant_is_no_wider_for_it(known):
    """At 900 mm/s a sphere would be 90 mm on, 100 ms later; it swings by 30 and is never there."""
    statement = Statement(BODIES, 1, Settings(p=5))
    own = Controller(statement, OneStep(compiled=False), Safety(budget=9.0, delay=known))
    for k in range(60):
        angle = 30.0 * DT * k
        place = (30.0 * np.sin(angle), 60.0, -110.0)
        ball = Obstacle.sphere(place, 4.0, (900.0 * np.cos(angle), 0.0, 0.0))
        own.step(START, START, [ball])
    (capsule,) = own._believed
    assert np.abs([capsule.a[0], capsule.b[0]]).max() < 31.0
    assert own._known == [ball]


@pytest.mark.parametrize(("share", "found"), [(0.09, False), (0.13, True)])
def test_what_friction_may_hold_is_no_reading_that_repeats_itself(share, found):
    """A tenth of the largest speed, at which 2 mm more are sent within 2 s."""
    own, rate = Underway(Plant(), STATEMENT), np.zeros(6)
    rate[0] = share * 60.0
    for _ in range(120):
        own.seen(START)
        own.sent(rate)
    assert bool(own.unseen()) == found


@pytest.mark.parametrize("frozen", [5, 20])
@pytest.mark.parametrize("bodies", [slice(0, 6), slice(3, 6)])
def test_a_reading_that_repeats_itself_stops_the_motion_until_it_changes(frozen, bodies):
    """Which had let two shafts through each other without a word."""
    own = Controller(STATEMENT, OneStep(compiled=False), Safety(9.0))
    goals, tips = np.array([40.0, 15.0, -110.0, -40.0, -5.0, -120.0]), START.copy()
    way, kept = 0.0, tips
    for k in range(frozen + 60):
        kept = tips.copy() if k <= frozen else kept
        seen = tips.copy()
        seen[bodies] = kept[bodies]
        command = own.step(seen, goals)
        tips = tips + DT * command.rate
        way += DT * np.linalg.norm(command.rate[3:]) * (k > frozen)
    assert command.mode.value == "stop"
    assert not command.rate.any()
    assert {"bad-measurement", "stopped"} <= {t.value for t in command.troubles()}
    # d_s, the lateness that was still possible, and the stop.
    assert way < 2.0 + 60.0 * 0.2 + 4.0
    for _ in range(200):
        command = own.step(tips, goals)
        tips = tips + DT * command.rate
    assert not command.events
    np.testing.assert_allclose(tips, goals, atol=0.1)


def test_a_distance_that_is_kept_is_what_may_be_sent_unseen():
    for safe in (0.001, 0.004):
        settings = replace(STATEMENT.settings, safe=safe)
        own, steps = Underway(Plant(), Statement(BODIES, 0, settings)), 0
        while not own.unseen():
            own.seen(START)
            own.sent(np.array([60.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
            steps += 1
        assert 54.0 * DT * (steps - 1) == pytest.approx(1e3 * safe + 60.0 * 0.2, abs=2.4)


def sagging(by):
    """Lateness (60, 2) as it is learnt, of tips that sag by so much as the loop begins [mm]."""
    rng, own, found = np.random.default_rng(1), Underway(Plant(), STATEMENT), []
    reality = Reality(START.reshape(2, 3), Mismatch(0.1, delay=0.05, lag=0.02), DT, 20, rng)
    rates = 25.0 * np.sin(rng.uniform(2.0, 6.0, 6) * DT * np.arange(60)[:, None])
    for k, rate in enumerate(rates):
        sags = by * (1.0 - np.exp(-DT * k / 0.05)) * np.array([0, 0, -1, 0, 0, -1])
        own.seen(reality.measure().ravel() + sags)
        own.sent(rate)
        reality.move(rate.reshape(2, 3))
        found.append(own.later.copy())
    return np.array(found)


def test_a_load_that_comes_on_tells_of_no_lateness():
    """Arms that sagged by 2.3 mm as the loop began were thought 15 ms later for four seconds."""
    still, sagged = (sagging(by)[15:] for by in (0.0, 5.0))
    assert np.abs(sagged - still).max() < 0.03


@pytest.mark.parametrize("turned", [False, True])
def test_what_lags_follows_a_path_in_time_and_cuts_no_corner(turned):
    """Led by its lag alone it came too near the middle of a wave by 0.3 mm of 9."""
    lag, t = 0.1, DT * np.arange(400)
    waves = np.sin(np.array([2.0, 2.5, 1.8, 2.2, 1.5, 2.4]) * t[:, None])
    way, fades = START + 9.0 * waves * np.array([1, 1, 0, 1, 1, 0]), np.exp(-DT / lag)
    own, off = Underway(Plant(delay=0.03, lag=lag, turned=turned), STATEMENT), []
    tips = before = way[0]
    for k in range(300):
        own.seen(way[k])
        rest = own.then(way[k + 1 :], 3)[0]
        behind = lag / DT * (rest - before)  # of what comes to rest at places along a line
        tips, before = rest - behind + (tips - before + behind) * fades, rest
        off.append(tips - [np.interp(t[k + 1] + 0.03, t, g) for g in way.T])
    assert np.abs(off[50:]).max() < 0.05


def test_a_path_that_leaps_is_led_no_further_than_a_tip_may_go():
    own = Underway(Plant(lag=0.1), STATEMENT)
    path = START + np.repeat([0.0, 30.0], 5)[:, None] * np.eye(6)[0]
    ahead = own.then(path, 10) - path
    assert np.abs(ahead).max() == pytest.approx(0.1 * 60.0)
