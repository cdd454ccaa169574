"""Where nothing in a drive switches, its filters are its steps."""

from dataclasses import replace
from itertools import combinations

import casadi as cs
import numpy as np
import pytest

from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion import rollout
from plumbline.optim.diagnosis.motion.filtered import filtered, filters_of
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.windows import Windows

LINES = {  # what makes a line of a drive; the lag and the bandwidth aside these make no filter
    law: {"actuation_gain", "actuation_offset", "actuation_delay", "actuation_lag"}
    for law in (Law.POSITION, Law.SMOOTH, Law.VELOCITY, Law.RATE)
}
for place in (Law.POSITION, Law.SMOOTH):  # where what is behind a planned way is one, too
    LINES[place] |= {"servo_stiffness", "acceleration_limit"}


def windows(law):
    """Two runs, three blocks of windows of different lengths, commands that turn corners."""
    rng = np.random.default_rng(1)
    N = 900
    u, load = rng.normal(size=(2, N)).cumsum(axis=1) / 20
    first = np.repeat([0, 500], [500, 400])
    start = np.array([60, 100, 140, 300, 560, 600, 780])
    q, speed = u + 0.01, np.gradient(u) / 0.02
    inertia = np.full(N, 0.3)
    return Windows(law, 0.02, 0.0, 0.0, u, first, q, q, speed, load, inertia, start, 40, 7)


def together(law):
    """Every three of the effects of a drive, in their plain forms."""
    every = [e for c in MOTION_EFFECTS for e in c.candidates(law, masses=True) if not e.variant]
    return [some for n in range(4) for some in combinations(every, n)]


@pytest.mark.parametrize("law", LINES)
def test_filters_are_the_steps_that_they_stand_for(law, monkeypatch):
    w = windows(law)
    for effects in together(law):
        filters = rollout._filters(w.drive, effects, tuple(range(len(effects))))
        assert (filters is not None) == ({e.name for e in effects} <= LINES[law]), effects
        if filters is None:
            continue
        theta = np.array([0.3 * e.parameter.scale for e in effects])
        got = roll_out(w, effects, theta)
        with monkeypatch.context() as patched:
            patched.setattr(rollout, "_filters", lambda *_: None)
            stepped = roll_out(w, effects, theta)
        for a, b in zip(got, stepped, strict=True):
            assert a.shape == b.shape
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * max(np.abs(b).max(initial=1), 1))


@pytest.mark.parametrize("law", [Law.SERVO, Law.TORQUE])
def test_what_has_inertia_is_rolled_out_step_by_step(law):
    assert rollout._filters(law, (), ()) is None


def test_a_loop_and_what_is_no_line_are_no_filters():
    s, d, f = cs.SX.sym("s", 2), cs.SX.sym("d"), cs.SX.sym("f")
    loop = cs.Function("step", [s, d, f], [cs.vertcat(s[1] + d, f * s[0])])
    assert filters_of(loop, [0]) is None
    bent = cs.Function("step", [s, d, f], [cs.vertcat(cs.fmax(s[0], d), s[1])])
    assert filters_of(bent, [0]) is None
    assert filters_of(bent, [1]) is None  # the whole step is asked for


def test_each_filter_begins_anew_with_its_roll_out():
    s, d, f = cs.SX.sym("s", 2), cs.SX.sym("d"), cs.SX.sym("f")
    step = cs.Function("step", [s, d, f], [cs.vertcat(f * s[0] + d, s[0] - s[1] + 2)])
    state, data = np.array([[1.0, 0.5], [-3.0, 2.0]]), np.arange(6.0).reshape(2, 3)
    found = filtered(filters_of(step, [1, 0]), state, [data], np.array([0.5]))
    for r in range(2):
        now = state[r]
        for k in range(3):
            now = np.asarray(step(now, data[r, k], 0.5)).ravel()
            np.testing.assert_allclose(found[r, k], now[::-1], rtol=1e-14)


def test_windows_of_one_recording_are_those_of_more_where_runs_end(monkeypatch):
    w = windows(Law.POSITION)
    alone = [roll_out(replace(w, start=w.start[k : k + 1]), (), np.empty(0))[0] for k in (0, 6)]
    whole = roll_out(w, (), np.empty(0))[0]
    np.testing.assert_allclose(np.concatenate(alone), whole[[0, 6]], atol=1e-14)
