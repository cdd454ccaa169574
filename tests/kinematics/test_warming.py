"""How fast a thermometer rises, read off the readings that it gave."""

import numpy as np
import pytest

from plumbline.kinematics.effects import link_thermal
from plumbline.kinematics.effects.link_thermal import slope_of

HOUR = 3600.0


def missed(t, constant, digit, rng=None):
    """Error of the slope of a warm-up by 4 K, as a share of it: by a digit, or noise if drawn."""
    risen, true = 4.0 * (1.0 - np.exp(-t / constant)), 4.0 / constant * np.exp(-t / constant)
    shown = np.round(risen / digit) * digit if rng is None else risen + rng.normal(0, digit, len(t))
    return float(np.sqrt(np.mean((slope_of(t, shown) - true) ** 2) / np.mean(true**2)))


@pytest.mark.parametrize(("digit", "share", "most"), [(0.1, 0.3, 0.22), (0.01, 0.05, 0.1)])
def test_a_coarse_thermometer_and_a_fast_warm_up_both_have_their_slope(digit, share, most):
    """A window three quarters as long misses the one, one half as long again the other."""
    draws = [np.sort(np.random.default_rng(s).uniform(0.0, HOUR, 100)) for s in range(20)]
    assert np.median([missed(t, share * HOUR, digit) for t in draws]) < most


def test_readings_taken_at_once_tell_no_slope():
    """Of five within a hundredth of a second noise of 10 mK would be a kelvin a second."""
    rng = np.random.default_rng(0)
    t = (np.linspace(0.0, HOUR, 12)[:, None] + 0.01 * np.arange(5)).ravel()
    assert missed(t, 0.3 * HOUR, 0.01, rng) < 1.01


def test_two_bursts_tell_a_slope_and_no_bend():
    """At either end there are two alone, and what noise says of a bend within one is no bend."""
    rng = np.random.default_rng(0)
    t = (np.linspace(0.0, HOUR, 20)[:, None] + np.arange(3)).ravel()
    assert missed(t, 0.3 * HOUR, 0.01, rng) < 0.1


def test_three_times_at_even_steps_tell_a_bend():
    """A parabola has its own slope at its ends, where a line has that further in."""
    t = np.linspace(0.0, 1.0, 36)  # at either end there are two more within the window
    assert np.allclose(slope_of(t, t**2), 2.0 * t, atol=1e-9)


def test_the_order_of_rows_and_the_unit_of_time_say_nothing():
    rng = np.random.default_rng(1)
    t = rng.uniform(0.0, HOUR, 50)
    shown = 20.0 + np.sin(t / HOUR)
    assert np.allclose(slope_of(t[::-1], shown[::-1])[::-1], slope_of(t, shown))
    assert np.allclose(slope_of(t / 60.0, shown), 60.0 * slope_of(t, shown))
    assert link_thermal.slope_of(np.zeros(3), np.arange(3.0)).tolist() == [0.0, 0.0, 0.0]
