"""Logs that repeat a reading while joints are under way."""

import numpy as np
import pytest

from plumbline import build_motion
from plumbline.errors import PlumblineError
from plumbline.optim.recording import constants
from tests.motions import arm, multisine, servo

TICK = 1.5e-3  # [rad] of a hobby servo's encoder


def logged(kept=None, tick=TICK, seconds=30.0):
    """Two joints' log, of whose readings these rows (N,) alone were taken anew."""
    t, u = multisine(seconds)
    q = np.column_stack([servo(t, u[:, j], lag=0.05, play=0.01) for j in (0, 1)])
    q = np.round(q / tick) * tick
    last = np.arange(len(t)) if kept is None else np.maximum.accumulate(kept * np.arange(len(t)))
    return build_motion(robot=arm(), time=t, command=u, q=q[last])


@pytest.mark.parametrize("every", [2, 3, 10])
def test_readings_at_a_lower_rate_than_commands_are_refused(every):
    with pytest.raises(PlumblineError, match="rows repeat all readings as joints move"):
        logged(np.arange(1500) % every == 0)


@pytest.mark.parametrize("share", [0.05, 0.25])
def test_readings_that_are_lost_now_and_then_pass_up_to_one_in_ten(share):
    kept = np.random.default_rng(0).random(1500) > share
    if share < constants.REPEATED:
        logged(kept)
    else:
        with pytest.raises(PlumblineError, match="delete the rows that bring no new reading"):
            logged(kept)


def stopping():
    """A joint that stops at once, stands while its command goes on, and sets off slowly."""
    return stepping(np.tile([*np.arange(4, 17, 3), *np.zeros(20)], 12))


def stepping(steps):
    """Two joints that move by so many ticks from row to row (N,), by one at first."""
    steps[1] = 1
    q = TICK * np.column_stack([np.cumsum(steps), np.cumsum(steps)])
    t = 0.02 * np.arange(len(q))
    u = np.linspace(q[0], q[-1], len(q))
    return build_motion(robot=arm(), time=t, command=u * [1.0, 0.99], q=q)


@pytest.mark.parametrize(
    ("constant", "value", "log"),
    [
        ("REPEATED", 0.02, lambda: logged(np.random.default_rng(0).random(1500) > 0.05)),
        ("UNDER_WAY", 0.5, lambda: logged(tick=0.02)),
        ("EVEN", 10.0, stopping),
        ("FEW", 0, lambda: stepping(np.array([1, 1, *[4, 4, 0, 4, 4] * 2, *[1] * 60]))),
    ],
)
def test_what_a_coarse_encoder_and_a_joint_that_sticks_repeat_is_a_reading(
    constant, value, log, monkeypatch
):
    log()
    monkeypatch.setattr(constants, constant, value)
    with pytest.raises(PlumblineError, match="rows repeat all readings"):
        log()
