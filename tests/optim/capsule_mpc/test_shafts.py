"""Drives that turn a shaft about its trocar and slide it lag and rub along its axes."""

import numpy as np
import pytest

from plumbline import build_tracking
from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import EndsInstrument, Plant, Statement, TipInstrument
from plumbline.optim.capsule_mpc.identified import identified
from plumbline.optim.capsule_mpc.shafts import Shafts, along, back
from plumbline.optim.capsule_mpc.underway import Underway

TROCAR = np.array([-0.04, 0.0, 0.0])
STATEMENT = Statement((TipInstrument((-0.04, 0.0, 0.0)),), 0)
START = np.array([-0.012, -0.004, -0.112])
DT, FINE = 0.02, 0.001
LAG, DRY, LATE = np.array([0.02, 0.035, 0.06]), np.array([0.05, 0.04, 0.004]), 0.05


def tip(q):
    """Where a shaft is that was turned about x, then y, and slid in."""
    a, b, r = q
    return TROCAR + r * np.array([-np.sin(b), np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b)])


def slope(q):
    return np.column_stack([(tip(q + h) - tip(q - h)) / 2e-6 for h in 1e-6 * np.eye(3)])


class Turning:
    """Joints that lag and rub, each in its own way; rates of the tip are turned into theirs."""

    def __init__(self, dry=DRY):
        self.dry, w = dry, START - TROCAR
        r = np.linalg.norm(w)
        self.q, self.v = np.array([np.arctan2(w[1], -w[2]), np.arcsin(-w[0] / r), r]), np.zeros(3)
        self.queue = np.zeros((round(LATE / FINE), 3))

    def move(self, rate):
        for _ in range(round(DT / FINE)):
            now, self.queue = self.queue[-1], np.concatenate([rate[None], self.queue[:-1]])
            free = self.v + FINE / LAG * (np.linalg.solve(slope(self.q), now) - self.v)
            self.v = free - np.clip(free, -FINE / LAG * self.dry, FINE / LAG * self.dry)
            self.q = self.q + FINE * self.v
        return tip(self.q)


@pytest.fixture(scope="module")
def log():
    rng, reality = np.random.default_rng(0), Turning()
    t = np.arange(0.0, 16.0, DT)
    f, phase = rng.uniform(0.3, 1.5, (4, 3)), rng.uniform(0.0, 6.3, (4, 3))
    u = 0.015 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    x = np.array([START, *(reality.move(row) for row in u)])[:-1]
    return build_tracking(time=t, rate=u, x=x + 5e-5 * rng.standard_normal(x.shape))


@pytest.fixture(scope="module")
def found(log):
    return identified(Plant(delay=0.06, lag=0.03, dry=0.003), log, STATEMENT)


def test_frames_are_orthonormal_and_their_last_axis_is_the_shaft():
    bodies = [TipInstrument((0.0, 0.0, 0.0), inward=way) for way in np.eye(3).tolist()]
    tips = np.random.default_rng(0).uniform(0.02, 0.2, (50, 9))
    frames = Shafts(bodies, 1.0).frames(tips)
    assert np.abs(np.swapaxes(frames, -1, -2) @ frames - np.eye(3)).max() < 1e-12
    assert np.abs(np.linalg.det(frames) - 1.0).max() < 1e-12
    shafts = tips.reshape(50, 3, 3)
    e = shafts / np.linalg.norm(shafts, axis=-1, keepdims=True)
    assert np.abs(frames[..., 2] - e).max() < 1e-12
    assert np.abs(back(frames, along(frames, tips)) - tips).max() < 1e-12
    # The shortest turn: what is across both directions stays.
    straight = Shafts(bodies, 1.0).frames(np.eye(3).ravel())
    across = np.cross(np.eye(3), e)
    same = [
        along(f, across.reshape(50, 9)) for f in (frames, np.broadcast_to(straight, frames.shape))
    ]
    assert np.abs(same[0] - same[1]).max() < 1e-12


def test_a_log_tells_that_a_shaft_is_turned_and_slid(found):
    assert found.turned
    assert found.delay + found.lag == pytest.approx(LATE + LAG[[1, 0, 2]], abs=4e-3)
    depth = np.linalg.norm(START - TROCAR)
    assert found.dry == pytest.approx([depth * DRY[1], depth * DRY[0], DRY[2]], abs=6e-4)


def test_a_log_of_axes_that_slide_tells_that_nothing_is_turned(log):
    from tests.optim.capsule_mpc.test_identified import NEAR, TRUE, logged

    slid = logged(TRUE, seconds=8.0)
    moved = build_tracking(time=slid.time, rate=slid.command, x=slid.q + START)
    assert not identified(NEAR, moved, STATEMENT).turned


def way_off(turned):
    """By how much the way that is left is not what turned drives still go [mm]."""
    plant = Plant(delay=LATE, lag=LAG[[1, 0, 2]], turned=turned)
    reality, own, seen = Turning(np.zeros(3)), Underway(plant, STATEMENT), START
    phase = np.arange(3.0)
    for k in range(60):
        own.seen(1e3 * seen)
        seen = reality.move(own.sent(30.0 * np.sin(k * DT * np.array([5.0, 7.0, 6.0]) + phase)))
    own.seen(1e3 * seen)
    left = own.way()
    for _ in range(40):
        rest = reality.move(np.zeros(3))
    assert np.abs(left).max() > 1.0
    return np.abs(1e3 * (rest - seen) - left).max()


def test_the_way_that_is_left_is_what_turned_drives_still_go():
    assert way_off(True) < 0.05
    assert way_off(False) > 0.1


def test_a_path_is_led_along_each_axis_of_a_shaft_as_late_as_that_is():
    plant = Plant(delay=[0.04, 0.0, 0.02], turned=True)
    own = Underway(plant, STATEMENT)
    own.seen(1e3 * START)
    frame = Shafts(STATEMENT.bodies, 1e-3).frames(1e3 * START)
    ways = np.array([1.0, 10.0, 3.0])
    path = 1e3 * START + back(np.tile(frame, (20, 1, 1, 1)), np.arange(20.0)[:, None] * ways)
    led = own.then(path, 8)
    gone = along(np.tile(frame, (8, 1, 1, 1)), led - path[:8])
    np.testing.assert_allclose(gone, np.tile(ways * [2.0, 0.0, 1.0], (8, 1)), atol=1e-9)


def test_a_turned_plant_of_what_is_no_tip_through_a_trocar_is_refused():
    ends = Statement((EndsInstrument(),), 0)
    with pytest.raises(PlumblineError, match=r"turned: found 1 bodies that are no TipInstrument"):
        Underway(Plant(turned=True), ends)
