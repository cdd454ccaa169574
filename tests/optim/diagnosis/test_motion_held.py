"""Commands of position that stand for several rows of a log: a controller slower than that."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from plumbline import build_motion, diagnose
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion.clock import stood
from plumbline.optim.diagnosis.motion.diagnose import _between_rows
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.signals import signals_of
from tests.motions import arm, multisine

FINE = 2e-4  # s
NAMES = {e.name.removeprefix("actuation_"): e for e in MOTION_EFFECTS}


def stairs(seconds, stands):
    """Fine times (N,), commands (N, 2) that a controller holds for so long."""
    t, u = multisine(seconds, stands, fastest=1.2)
    many = round(stands / FINE)
    return FINE * np.arange(len(t) * many), np.repeat(u, many, axis=0)


def lagging(u, lag, late=0.0):
    """What lags behind what stands from a fine sample to the next, exactly."""
    n, stays = round(late / FINE), np.exp(-FINE / lag)
    told = np.concatenate([np.full(n + 1, u[0]), u])[: len(u)]
    return lfilter([1 - stays], [1.0, -stays], told, zi=[stays * u[0]])[0]


@pytest.mark.parametrize(("row", "stands", "seconds"), [(0.01, 0.04, 12.0), (0.005, 0.015, 24.0)])
def test_commands_that_stand_for_several_rows_are_held_and_blamed_on_no_drive(row, stands, seconds):
    """A log of 200 Hz is thinned: from row to row a jump was half of its sample late or early."""
    every, lag, late, noise = round(row / FINE), 0.05, 0.03, 2e-4
    t, u = stairs(seconds, stands)
    q = np.column_stack([lagging(u[:, 0], lag, late), lagging(u[:, 1], lag)])
    q += np.random.default_rng(0).normal(0.0, noise, q.shape)
    answer = diagnose(build_motion(robot=arm(), time=t[::every], command=u[::every], q=q[::every],
                                   noise_std=noise))  # fmt: skip
    values = {(c.effect, c.element): next(iter(c.parameters.values())) for c in answer.causes}
    assert set(values) == {
        ("actuation_delay", 1), ("actuation_lag", 1), ("actuation_lag", 2)
    }  # fmt: skip
    for (effect, _), value in values.items():
        true = late if effect == "actuation_delay" else lag
        assert value.value == pytest.approx(true, abs=1e-4)
    assert answer.outside_probability < 0.05
    assert any("stand until the next row" in note for note in answer.verdict.notes)


FORMS = [
    ([("lag", {})], [0.05]),
    ([("delay", {}), ("lag", {})], [0.013, 0.05]),
    ([("lag", {}), ("play", {})], [0.05, 0.01]),
    ([("lag", {}), ("play", {"inside": True})], [0.05, 0.01]),
    ([("lag", {}), ("velocity_limit", {})], [0.05, 0.8]),
    ([("lag", {}), ("servo_bandwidth", {})], [0.05, 0.2]),
    ([("servo_bandwidth", {})], [0.2]),
    ([("lag", {}), ("servo_stiffness", {"inside": True})], [0.05, 0.01]),
    ([("acceleration_limit", {})], [5.0]),
]


@pytest.mark.parametrize(("kinds", "values"), FORMS)
def test_a_drive_goes_to_what_is_held_as_it_goes_along_the_same_by_small_steps(kinds, values):
    row, stands = 0.01, 0.04
    t, u = stairs(16.0, stands)
    every, q = round(row / FINE), np.column_stack([lagging(x, 0.05) for x in u.T])
    effects = tuple(NAMES[name](**form) for name, form in kinds)

    def rolled(signals):
        starts = signals.starts[:1]
        windows = replace(signals.windows(0, starts), start=np.zeros(1, np.int64))
        still = np.sin(windows.dt * np.arange(len(windows.load)))
        windows = replace(windows, load=still, posture=windows.command, q=windows.command,
                          speed=np.zeros(len(windows.q)))  # fmt: skip
        return windows, roll_out(windows, effects, np.array(values))

    def made(step, kind):
        return build_motion(robot=arm(), time=t[::step], command=u[::step], q=q[::step], kind=kind)

    held, (coarse, slopes) = rolled(signals_of(made(every, "held_position")))
    fine, (exact, _) = rolled(signals_of(made(1, "position"), most=round(5.0 / FINE)))
    at = np.isin(fine.samples[0], held.samples[0] * every)
    assert at.sum() == coarse.shape[1]
    off = np.abs(coarse[0] - exact[0, at]).max()
    moved = np.ptp(exact)
    assert off < 5e-3 * moved, off / moved
    if kinds[0][0] != "acceleration_limit":
        for k, value in enumerate(values):
            ahead = np.array(values)
            ahead[k] += 1e-6 * value
            by = (roll_out(held, effects, ahead, slopes=False)[0] - coarse) / (1e-6 * value)
            assert np.median(np.abs(by - slopes[..., k])) < 1e-3 * np.abs(by).max()


def test_of_a_thinned_clock_what_stood_is_the_mean_over_each_of_its_samples():
    t = 0.005 * np.arange(8)
    u = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 3.0, 3.0])[:, None]
    even = 0.01 * np.arange(4)
    assert stood(t, u, even, 0.01)[:, 0] == pytest.approx([0.0, 0.5, 1.0, 3.0])
    assert stood(t, u, t, 0.005)[:, 0] == pytest.approx(u[:, 0])


@pytest.mark.parametrize(
    ("law", "stands", "other"),
    [
        ("position", 3, Law.HELD),
        ("position", 2, Law.HELD),
        ("position", 1, Law.SMOOTH),
        ("smooth_position", 3, None),
        ("held_position", 3, None),
        ("rate", 3, None),
    ],
)
def test_what_stands_for_rows_may_be_held_and_what_changes_with_each_smooth(law, stands, other):
    t, u = multisine(12.0, 0.02)
    u = np.repeat(u[::stands], stands, axis=0)[: len(t)]
    u[300:400] = u[300]  # all stand still a while: neither
    made = build_motion(robot=arm(), time=t, command=u, q=u)
    assert _between_rows(replace(made, law=Law(law))) == other
