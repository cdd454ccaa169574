"""Speeds that readings tell: none of them is their noise."""

import numpy as np
import pytest

from plumbline import build_motion, diagnose
from plumbline.experiments.reality.drives import Wrong, follow
from plumbline.optim.diagnosis.motion.signals import signals_of
from tests.motions import arm, multisine, recorded


def speeds(noise):
    return signals_of(recorded([{"lag": 0.2}, {}], noise=noise)).speed


@pytest.mark.parametrize("noise", [3e-4, 0.03, 0.3])
def test_of_speeds_no_more_is_noise_than_they_differ_from_their_commands(noise):
    """Joint 1 lags, by 0.5 rad/s; joint 2 goes as it is told, whatever its readings say."""
    known, measured = speeds(1e-9), 6.5 * noise  # [rad/s] of noise, as a cubic of 0.3 s has it
    off = np.std(speeds(noise) - known, axis=0)
    assert off[1] < 0.2 * measured
    assert off[0] < min(1.1 * measured, 0.8)
    assert off[0] > 0.8 * measured or measured > 0.2


def test_speeds_of_what_is_not_told_places_are_as_measured():
    made = recorded([{"lag": 0.2}, {}])
    rates = np.gradient(made.q, made.time, axis=0)
    told = {"robot": arm(), "time": made.time, "q": made.q, "kind": "rate"}
    some, more = (
        signals_of(build_motion(command=share * rates, **told)).speed for share in (0.9, 1.1)
    )
    np.testing.assert_array_equal(some, more)


def test_a_planned_way_is_one_under_noise_as_large_as_what_it_does():
    """By how fast noise says that it begins, it would go on for seconds."""
    t, u = multisine(40.0, fastest=0.7)
    rng = np.random.default_rng(0)
    way = follow(t, u[:, 0], 0 * t, Wrong(steepest=0.6), rng)
    noise = float(np.std(way - u[:, 0])) / 1.2
    q = np.column_stack([way, u[:, 1]]) + rng.normal(0.0, noise, u.shape)
    answer = diagnose(build_motion(robot=arm(), time=t, command=u, q=q, noise_std=noise))
    assert [(c.effect, c.element) for c in answer.causes] == [("acceleration_limit", 1)]
    found = answer.causes[0]
    assert found.probability > 0.95
    assert found.parameters["steepest"].value == pytest.approx(0.6, rel=0.1)
