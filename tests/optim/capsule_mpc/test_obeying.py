"""An axis that does not go where it is sent stops the motion; one that rubs or lags does not."""

import numpy as np
import pytest

from plumbline.experiments.reality.instruments import Mismatch
from plumbline.experiments.reality.instruments import Plant as Reality
from plumbline.optim.capsule_mpc import (
    Noise,
    OneStep,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.obeying import Obeying
from tests.in_mm import Controller

BODIES = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
STATEMENT = Statement(BODIES, 0, Settings(p=4, noise=Noise(measured=0.00005)))
START = np.array([-30.0, 0.0, -120.0, 35.0, 0.0, -115.0])
GOAL = np.array([40.0, 15.0, -110.0, -40.0, -5.0, -120.0])
DT = 0.02


def looped(read, steps=150, turn=1.0, goal=GOAL, mismatch=None):
    """Commands, and true tips (T, 6) before each, where ``read`` says what is seen at a step."""
    reality = Reality(
        START.reshape(2, 3), mismatch or Mismatch(0.05), DT, 4, np.random.default_rng(0)
    )
    own, commands, tips = Controller(STATEMENT, OneStep(compiled=False), Safety(9.0)), [], []
    for k in range(steps):
        tips.append(reality.tips.ravel().copy())
        commands.append(own.step(read(k, reality.measure().ravel(), tips), goal))
        reality.move((commands[-1].rate * turn).reshape(2, 3))
    return commands, np.array(tips)


def something_else(begin, end, bodies, rng):
    """What is seen where a tracker follows a thing that stands, but for noise, for some steps."""

    def read(k, seen, tips):
        if begin < k < end:
            stands = tips[begin] + rng.normal(0.0, 0.05, 6)
            seen[bodies] = stands[bodies]
        return seen

    return read


@pytest.mark.parametrize("bodies", [slice(0, 6), slice(3, 6)])
@pytest.mark.parametrize("begin", [3, 20])
def test_a_tracker_that_follows_what_stands_stops_the_motion(bodies, begin):
    """No reading was the last to the last bit: a tip went on for 157 mm without a word."""
    rng = np.random.default_rng(1)
    commands, tips = looped(something_else(begin, 999, bodies, rng))
    assert commands[-1].mode.value == "stop"
    assert not commands[-1].rate.any()
    (event, *_) = commands[-1].events
    assert event.trouble.value == "bad-measurement"
    assert "or another thing is seen; stopped" in event.words
    ways = np.linalg.norm(np.diff(tips[begin:], axis=0), axis=1).sum()
    assert ways < 50.0 * len(tips[0]) / 6 + 10.0


def test_a_drive_that_is_turned_round_stops_the_motion():
    turn = np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    commands, tips = looped(lambda k, seen, tips: seen, turn=turn)
    assert commands[-1].mode.value == "stop"
    assert np.abs(tips - START)[:, 0].max() < 20.0
    assert "instrument 1: sent" in commands[-1].events[0].words


def test_motion_goes_on_where_what_was_sent_is_seen_again():
    rng = np.random.default_rng(1)
    commands, tips = looped(something_else(20, 80, slice(0, 3), rng), steps=260)
    assert commands[79].mode.value == "stop"
    assert commands[-1].events == ()
    np.testing.assert_allclose(tips[-1], GOAL, atol=0.3)


@pytest.mark.parametrize("by", [-30.0, 30.0])
def test_a_reading_that_leaps_for_less_than_a_tenth_of_a_second_stops_while_it_is_off(by):
    def read(k, seen, tips):
        return seen + by * (40 <= k < 44) * np.eye(6)[0]

    commands, tips = looped(read, steps=260)
    stopped = [k for k, c in enumerate(commands) if c.mode.value == "stop"]
    assert stopped == ([40, 41, 42, 43] if by < 0 else [])
    np.testing.assert_allclose(tips[-1], GOAL, atol=0.3)


@pytest.mark.parametrize(
    "wrong", [{"gain": 0.4}, {"deadband": 8.0}, {"delay": 0.1, "lag": 0.08}, {"across": 0.2}]
)
def test_a_drive_that_is_only_bad_is_obedient(wrong):
    commands, _ = looped(lambda k, seen, tips: seen, mismatch=Mismatch(0.05, **wrong))
    assert not any(c.mode.value == "stop" for c in commands)


def found(share, speed=60.0, steps=50, looks=None):
    """Whether the first axis, which does a share of its rate, is found not to obey, and when."""
    own, sent, read = Obeying(STATEMENT, 0.0), 0.0, np.zeros(6)
    for k in range(steps):
        now = np.zeros((1, 6))
        now[0, 0] = sent
        own.look(read if looks is None else looks(k, read), now, k)
        if own.astray:
            return k * DT
        sent, read = sent + DT * speed, read + DT * speed * share * np.eye(6)[0]
    return None


@pytest.mark.parametrize(("share", "astray"), [(0.4, True), (0.48, False), (-1.0, True)])
def test_half_of_the_way_beyond_what_friction_may_hold_is_obeyed(share, astray):
    assert bool(found(share)) == astray


@pytest.mark.parametrize(("speed", "astray"), [(9.5, False), (11.5, True)])
def test_what_friction_holds_for_a_second_is_2_mm_of_half_the_way(speed, astray):
    """The largest speed is 60 mm/s: over a second 6 mm of it are friction's, and 2 of the rest."""
    assert bool(found(0.0, speed, 400)) == astray


def test_two_looks_a_tenth_of_a_second_apart_are_believed_and_one_is_not():
    assert found(0.0) == pytest.approx(0.18, abs=0.021)


def test_an_axis_is_astray_until_it_is_seen_where_it_was_sent():
    own = Obeying(STATEMENT, 0.0)
    for k in range(30):
        own.look(np.zeros(6), np.full((1, 6), 1.2 * k), k)
    assert sorted(own.astray) == [0, 1, 2, 3, 4, 5]
    own.look(np.full(6, 30.0), np.full((1, 6), 36.0), 40)
    assert not own.astray
