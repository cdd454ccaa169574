"""A plant is fitted to its log, from what was diagnosed axis by axis: with what axes take of each
other, and with a dead band's edge."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline import build_tracking
from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import Plant, Statement, TipInstrument
from plumbline.optim.capsule_mpc.identified import advanced, drawn, identified
from plumbline.optim.capsule_mpc.underway import Underway

DT, FINE = 0.02, 0.001
ACROSS = np.array([[0.0, 0.02, -0.015], [-0.02, 0.0, 0.01], [0.015, 0.0, 0.0]])
TRUE = Plant(
    delay=[0.05, 0.06, 0.055], lag=[0.04, 0.05, 0.06], gain=[0.03, -0.05, 0.0], across=ACROSS,
    band=[0.004, 0.0, 0.0], dry=[0.0, 0.006, 0.0], play=[0.0, 0.0, 2e-4],
)  # fmt: skip
NEAR = Plant(
    delay=0.06, lag=0.045, band=[0.002, 0.0, 0.0], dry=[0.0, 0.005, 0.0], play=[0.0, 0.0, 1e-4]
)


def logged(plant, seconds=20.0, noise=5e-5, seed=0, group=None):
    """A log of a plant, a millisecond at a time."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, DT)
    f, phase = rng.uniform(0.1, 2.0, (4, 3)), rng.uniform(0.0, 6.3, (4, 3))
    u = 0.015 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    values = {k: np.broadcast_to(v, 3) for k, v in vars(plant).items() if k != "across"}
    own = np.diag(1.0 + values["gain"]) + plant.across
    asked = np.repeat(u, round(DT / FINE), axis=0) @ own.T + values["offset"]
    late, axes = np.round(values["delay"] / FINE).astype(int), np.arange(3)
    motor, tip, v, found = np.zeros(3), np.zeros(3), np.zeros(3), []
    for k in range(len(asked)):
        if k % round(DT / FINE) == 0:
            found.append(tip)
        m = np.where(k >= late, asked[np.maximum(k - late, 0), axes], 0.0)
        m = np.where(np.abs(m) < values["band"], 0.0, m)
        free = v + FINE / values["lag"] * (m - v)
        rubs = FINE / values["lag"] * values["dry"]
        v = free - np.clip(free, -rubs, rubs)
        motor = motor + FINE * v
        tip = np.clip(tip, motor - values["play"], motor + values["play"])
    x = np.array(found) + noise * rng.standard_normal((len(t), 3))
    return build_tracking(time=t, rate=u, x=x, group=group)


@pytest.fixture(scope="module")
def log():
    """Of the true plant; nobody changes it."""
    return logged(TRUE)


@pytest.fixture(scope="module")
def found(log):
    return identified(NEAR, log)


@pytest.mark.parametrize(
    ("field", "off"),
    [
        ("delay", 2e-3), ("lag", 4e-3), ("gain", 6e-3), ("across", 3e-3), ("band", 2e-4),
        ("dry", 3e-4), ("play", 6e-5),
    ],
)  # fmt: skip
def test_a_log_tells_what_axes_take_of_each_other_and_where_a_dead_band_ends(found, field, off):
    # Of play behind a lag it tells how late both are together.
    axes = slice(2) if field in ("delay", "lag") else slice(None)
    apart = np.abs(getattr(found, field) - np.asarray(getattr(TRUE, field)))
    assert apart[axes].max() < off
    assert np.abs(found.delay + found.lag - np.add(TRUE.delay, TRUE.lag)).max() < 2e-3


def test_friction_that_stops_a_position_loop_short_is_told_as_it_is():
    """As play before a lag it was told for 0.02 to 0.08 mm more, by position servos in MuJoCo."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 20.0, DT)
    late, lag, short = 0.06, np.array([0.03, 0.04, 0.05]), np.array([2e-4, 3e-4, 4e-4])
    f, phase = rng.uniform(0.1, 2.0, (4, 3)), rng.uniform(0.0, 6.3, (4, 3))
    u = 0.015 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    behind, place, found = np.zeros(3), np.zeros(3), [np.zeros(3)] * (1 + round(late / DT))
    for rate in u:
        for _ in range(50):
            v = np.sign(behind) * np.maximum(np.abs(behind) - short, 0.0) / lag
            behind, place = behind + DT / 50 * (rate - v), place + DT / 50 * v
        found.append(place)
    x = np.array(found)[: len(t)] + 5e-5 * rng.standard_normal((len(t), 3))
    told = identified(Plant(delay=0.05, lag=0.05, play=3e-4), build_tracking(time=t, rate=u, x=x))
    assert np.abs(told.play - short).max() < 1.5e-5
    assert np.abs(told.delay - late).max() < 1e-3
    assert np.abs(told.lag - lag).max() < 1.5e-3


def test_what_follows_a_drive_goes_as_in_small_steps():
    rng, n = np.random.default_rng(0), 500
    play = rng.uniform(0.0, 1e-3, n) * (rng.random(n) > 0.1)
    behind, rate = rng.normal(0.0, 1e-3, n), rng.normal(0.0, 0.03, n)
    behind[::7], behind[1::7], rate[::11] = play[::7], 0.0, 0.0
    lag, d, gone = rng.uniform(2e-3, 0.08, n), behind.copy(), np.zeros(n)
    for _ in range(4000):
        v = np.sign(d) * np.maximum(np.abs(d) - play, 0.0) / lag
        d, gone = d + 5e-6 * (rate - v), gone + 5e-6 * v
    way, after = drawn(behind, rate, play, lag, 0.02)
    np.testing.assert_allclose(way, gone, atol=1e-6)
    np.testing.assert_allclose(after, d, atol=1e-6)


def test_a_plant_that_is_as_told_stays_so_and_gets_no_dead_band():
    told = Plant(delay=0.05, lag=0.04)
    found = identified(told, logged(replace(told, across=np.zeros((3, 3))), seed=1))
    assert not found.band.any()
    assert np.abs(found.across).max() < 3e-3
    assert np.abs(found.delay + found.lag - 0.09).max() < 2e-3
    assert max(found.dry.max(), found.play.max()) == 0.0


def test_a_dead_band_and_a_rate_at_rest_that_no_diagnosis_saw_are_found():
    none = np.zeros((3, 3))
    true = Plant(delay=0.05, lag=0.04, band=[8e-3, 0, 0], offset=[0, 8e-4, 0], across=none)
    found = identified(Plant(delay=0.05, lag=0.04), logged(true))
    assert found.band == pytest.approx([8e-3, 0.0, 0.0], abs=3e-4)
    assert found.offset == pytest.approx([0.0, 8e-4, 0.0], abs=1e-4)


def test_a_short_log_leaves_what_axes_take_of_each_other_near_none():
    told = Plant(delay=0.05, lag=0.04)
    log = logged(replace(told, across=np.zeros((3, 3))), seconds=1.6, noise=1e-3, seed=1)
    assert np.abs(identified(told, log).across).max() < 0.05


def test_friction_that_was_diagnosed_is_not_told_for_play(found):
    assert (found.play[:2] == 0.0).all()
    assert (found.dry[[0, 2]] == 0.0).all()


def test_axes_that_always_move_together_take_nothing_of_each_other():
    log = logged(replace(TRUE, across=np.zeros((3, 3))))
    together = build_tracking(time=log.time, rate=log.command[:, [0, 0]], x=log.q[:, [0, 0]])
    found = identified(Plant(delay=0.05, lag=0.04, band=0.004), together)
    assert np.abs(found.across).max() < 0.03
    assert found.gain + found.across.sum(axis=1) == pytest.approx([0.03, 0.03], abs=6e-3)


def test_readings_that_leap_and_rows_held_out_tell_nothing(found, log):
    x, held = log.q.copy(), np.zeros(len(log.q), dtype=int)
    x[::50] += 0.01
    x[500:600], held[500:600] = 0.3, 1
    off = identified(NEAR, build_tracking(time=log.time, rate=log.command, x=x, held_out=held))
    assert np.abs(off.across - found.across).max() < 5e-3
    assert np.abs(off.delay - found.delay).max() < 3e-3


def test_motions_are_rolled_out_each_by_itself(found, log):
    group = np.repeat([0, 1], 500)
    x = log.q + np.where(group == 1, 0.02, 0.0)[:, None]
    apart = identified(NEAR, replace(log, q=x, group=group))
    assert np.abs(apart.across - found.across).max() < 4e-3


def test_a_log_that_is_too_short_tells_no_more_than_its_diagnosis():
    log = logged(TRUE, seconds=1.0)
    short = replace(log, group=np.arange(len(log.time)) // 25)
    assert identified(NEAR, short) is NEAR


def test_what_rubs_comes_to_rest_and_stays():
    v, lag, dry = np.array([0.01]), np.array([0.05]), np.array([0.004])
    way, speed = advanced(v, np.array([0.003]), dry, lag, 1.0)
    assert speed == 0.0
    steps = v.copy(), 0.0
    for _ in range(100_000):
        steps = steps[0] + 1e-5 / 0.05 * (0.003 - 0.004 - steps[0]), steps[1] + 1e-5 * steps[0]
        if steps[0] <= 0:
            break
    assert way == pytest.approx(steps[1], rel=1e-3)
    assert advanced(np.zeros(1), np.array([0.003]), dry, lag, 1.0)[0] == 0.0
    turned = advanced(v, np.array([-0.01]), dry, lag, 10.0)[1]
    assert turned == pytest.approx(-0.006, rel=1e-6)


def test_shares_of_other_axes_that_outweigh_the_own_are_refused():
    with pytest.raises(PlumblineError, match=r"across: found 0.1 beyond .* expected less"):
        Plant(gain=-0.5, across=np.array([[0.0, 0.6], [0.1, 0.0]]))
    with pytest.raises(PlumblineError, match=r"plant across: found shape \(2, 2\)"):
        Underway(Plant(across=np.zeros((2, 2))), Statement((TipInstrument((0.0, 0.0, 0.0)),), 0))
