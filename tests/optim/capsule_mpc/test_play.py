"""A play that is known is crossed where the motion turns, so that the tip does what was meant."""

import numpy as np
import pytest

from plumbline import build_tracking, diagnose
from plumbline.optim.capsule_mpc import (
    Plant,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.underway import Underway
from tests.in_mm import Controller

BODIES = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
STATEMENT = Statement(BODIES, 0, Settings(p=8))
MIDDLE = np.array([-30.0, 0.0, -110.0, 30.0, 0.0, -115.0])
DT, HALF = 0.02, 0.4  # [s], [mm]


class Loose:
    """Drives that hold their rates, and tips that stay behind them by up to half a play."""

    def __init__(self, half=HALF):
        self.half, self.drive, self.tips = half, MIDDLE.copy(), MIDDLE.copy()

    def move(self, rate):
        """Carry out a rate (6,) [mm/s]."""
        self.drive = self.drive + DT * rate
        self.tips = np.clip(self.tips, self.drive - self.half, self.drive + self.half)


def way(t):
    """Where both tips should be (T, 6)."""
    return MIDDLE + 7.0 * np.sin(
        np.array([1.3, 0.9, 1.7, 1.1, 1.6, 0.8]) * np.atleast_1d(t)[:, None]
    )


def off(told, planner):
    """RMS distance of a tip from a path on a plant with play [mm]."""
    reality, found = Loose(), []
    own = Controller(STATEMENT, planner, Safety(9.0, plant=told))
    for k in range(150):
        found.append(reality.tips - way(DT * k)[0])
        ahead = way(DT * (k + 1 + np.arange(20)))
        reality.move(own.step(reality.tips, ahead).rate)
    return np.sqrt(np.mean(np.array(found)[40:] ** 2) * 3)


def test_told_of_its_play_a_horizon_follows_nearly_as_if_there_were_none():
    planner = RealTime(compiled=False)
    told, untold = off(Plant(play=1e-3 * HALF), planner), off(Plant(), planner)
    assert untold > 0.2
    assert told < 0.25 * untold


def test_what_is_sent_crosses_the_play_where_the_motion_turns():
    reality, own = Loose(), Underway(Plant(play=1e-3 * HALF), STATEMENT)
    blind, meant, worst = Loose(), MIDDLE.copy(), np.zeros(2)
    for k in range(300):
        rate = 20.0 * np.cos(np.linspace(1.0, 2.0, 6) * DT * k)
        meant = meant + DT * rate
        reality.move(1e3 * own.sent(rate))
        blind.move(rate)
        if k > 20:
            both = (reality.tips - meant, blind.tips - meant)
            worst = np.maximum(worst, [np.abs(v - np.median(v)).max() for v in both])
    assert worst[0] < 0.25 * worst[1]


def test_nothing_is_sent_at_rest_and_a_tenth_of_the_play_crosses_it():
    plant, rest = Plant(play=1e-3), np.zeros(1)
    assert not Underway(Plant(play=1e-3), STATEMENT).sent(np.zeros(6)).any()
    assert plant.taken_up(rest, np.array([4e-4])) == pytest.approx(4e-4)
    assert plant.taken_up(np.array([0.9e-4]), rest) == pytest.approx(0.9e-3)
    assert plant.taken_up(np.array([1.1e-4]), rest) == pytest.approx(1e-3)
    assert plant.taken_up(np.array([-2.1e-4]), np.array([1e-3])) == pytest.approx(-1e-3)
    assert Plant(play=1e-3).bias(0.06, 0.6) == pytest.approx(1e-3)


def test_a_play_that_is_not_there_moves_a_tip_no_faster_than_it_may_be():
    """In one tick a play of 3 mm had been 150 mm/s."""
    own, crossed = Underway(Plant(play=[3e-3] * 6), STATEMENT), np.zeros(6)
    for k in range(60):
        rate = np.array([58.0, 10.0, 0.0, -3.0, 20.0, 30.0]) * (1 if k < 20 else -1)
        sent = 1e3 * own.sent(rate)
        assert np.linalg.norm(sent.reshape(2, 3), axis=1).max() < 60.0 + 1e-9
        crossed += DT * (sent - rate)
        if k in (19, 59):  # all the same it is crossed
            way = np.sign(rate[3:]) * 3.0
            np.testing.assert_allclose(crossed[3:], way, atol=1e-9)


@pytest.mark.parametrize("dry", [0.003, 0.012])
def test_friction_that_is_not_there_moves_a_tip_no_faster_than_it_may_be(dry):
    """A tip sent at its limit had the friction on top: 60 mm/s became 81."""
    sent, rubbed = [], []
    own = Underway(Plant(dry=dry), STATEMENT)
    way = np.array([0.03, -0.04, 0.033, 0.01, 0.0, 0.0])  # [m/s], of a tip at its limit and a slow
    for share in (0.2, 0.8, 1.0):
        meant = 1e3 * share * way
        rate = own.sent(meant)
        rubs = dry * np.sign(way)
        assert np.linalg.norm(rate.reshape(-1, 3), axis=1).max() < 0.06 * (1 + 1e-9)
        sent.append(rate)
        rubbed.append(rate - rubs)
    np.testing.assert_allclose(rubbed[0], 0.2 * way, atol=1e-12)  # a slow one is carried out whole
    np.testing.assert_allclose(np.cross(rubbed[2][:3], way[:3]), 0.0, atol=1e-12)  # straight on
    np.testing.assert_allclose(rubbed[2][3:], way[3:], atol=1e-12)  # and the other is not slowed
    done = 1e3 * DT * np.sum(rubbed, axis=0)  # [mm]
    np.testing.assert_allclose(own._sent, done, atol=1e-9)  # and nothing else is counted on


def test_a_play_is_read_off_a_diagnosis():
    rng, t = np.random.default_rng(0), DT * np.arange(600)
    rate = 15.0 * np.sin(2 * np.pi * rng.uniform(0.1, 1.5, 4) * t[:, None] + rng.uniform(0, 6, 4))
    rate, reality, seen = rate.sum(axis=1), Loose(), []
    for row in rate:
        seen.append(reality.tips[0] + rng.normal(0.0, 0.03))
        reality.move(np.full(6, row))
    answer = diagnose(
        build_tracking(time=t, rate=1e-3 * rate[:, None], x=1e-3 * np.array(seen)[:, None])
    )
    assert Plant.of(answer).play == pytest.approx(1e-3 * HALF, rel=0.1)
