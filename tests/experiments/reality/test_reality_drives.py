"""The simulator of drives does what it says, and its sealed cases can be diagnosed."""

import numpy as np
import pytest
from scipy.signal import lsim

from plumbline.experiments.reality import drives
from plumbline.experiments.reality.drives import INSIDE, OUTSIDE, Plane, Wrong, commands, follow
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.withheld.design import Design
from plumbline.experiments.withheld.making import make_set
from plumbline.experiments.withheld.running import run_set
from plumbline.experiments.withheld.scoring import score_run
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.robot import Robot


def moved(**wrong):
    """Commands (N,) of a joint and where it goes (N,)."""
    t, u = commands(np.random.default_rng(0))
    t, u = t[:2000], u[:2000, 0]
    load = np.cos(u)
    return t, u, load, follow(t, u, load, Wrong(**wrong), np.random.default_rng(0))


def test_a_drive_with_nothing_wrong_is_where_it_was_told_to_be():
    _, u, _, q = moved()
    np.testing.assert_allclose(q, u, atol=1e-12)


def test_each_thing_that_is_wrong_is_its_closed_form():
    t, u, load, q = moved(delay=0.03)
    np.testing.assert_allclose(q, np.interp(t - 0.03, t, u), atol=1e-12)
    _, u, load, q = moved(gain=0.1, offset=0.02, compliance=0.01)
    np.testing.assert_allclose(q, 1.1 * u + 0.02 - 0.01 * load, atol=1e-12)
    _, u, _, q = moved(play=0.01)
    assert np.abs(q - u).max() == pytest.approx(0.01)
    t, u, _, q = moved(fastest=0.1)
    assert np.abs(np.diff(q)).max() == pytest.approx(0.1 * (t[1] - t[0]))
    _, u, _, q = moved(deadband=0.02)
    assert np.abs(q - u).max() == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize(
    "wrong", [{"bandwidth": 4.0}, {"ringing": 3.0}, {"bandwidth": 2.0, "lag": 0.05}]
)
def test_a_loop_of_second_order_is_neither_early_nor_late(wrong):
    t, u, _, q = moved(**wrong)
    f, damping = (wrong["ringing"], 0.25) if "ringing" in wrong else (wrong["bandwidth"], 1.0)
    pace = 2.0 * np.pi * f
    loop = np.polymul([wrong.get("lag", 0.0), 1.0], [1.0, 2.0 * damping * pace, pace**2])
    exact = u[0] + lsim(([pace**2], np.trim_zeros(loop, "f")), u - u[0], t)[1]
    assert np.std(q - exact) < 1e-3 * np.std(q - u)


@pytest.mark.parametrize(
    "wrong",
    [{"steepest": 2.0}, {"deadband": 0.02}, {"deadband": 0.02, "lag": 0.05},
     {"deadband": 0.02, "bandwidth": 2.0}, {"fastest": 0.4, "bandwidth": 2.0}],
)  # fmt: skip
def test_finer_steps_change_next_to_nothing(wrong, monkeypatch):
    _, u, _, q = moved(**wrong)
    monkeypatch.setattr(drives, "FINE", 100)
    *_, exact = moved(**wrong)
    assert np.std(q - exact) < 5e-3 * np.std(exact - u)


def test_a_loop_s_dead_band_lets_small_errors_stand_and_its_shaft_goes_no_faster():
    t, u, _, q = moved(deadband=0.02, bandwidth=3.0)
    still = np.abs(np.diff(q)) < 1e-6
    assert 0.01 < np.abs(q - u)[1:][still].max() < 0.021
    t, u, _, q = moved(fastest=0.1, bandwidth=3.0)
    assert np.abs(np.diff(q)).max() == pytest.approx(0.1 * (t[1] - t[0]))


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_nobody_lists_makes_a_gap(name):
    field, depends = OUTSIDE[name]
    _, u, _, q = moved(**{field: Ranges("drive").one(field, np.random.default_rng(1))})
    assert np.sqrt(np.mean((q - u) ** 2)) > 1e-3
    assert depends


def test_what_is_drawn_by_name_is_listed_and_the_rest_is_not():
    listed = {effect.name for effect in MOTION_EFFECTS}
    assert set(INSIDE) <= listed
    assert not set(OUTSIDE) & listed


def test_the_arm_s_gravity_is_that_of_pinocchio():
    plane = Plane((0.4, 0.3), (2.0, 1.0))
    rows = [
        {"a": a, "mass": m, "com": [-a / 2, 0.0, 0.0]}
        for a, m in zip(plane.length, plane.mass, strict=True)
    ]
    robot = Robot.from_dh(rows, gravity=[0.0, -9.81, 0.0])
    q = np.random.default_rng(0).uniform(-2, 2, (5, 2))
    zero = np.zeros_like(q)
    np.testing.assert_allclose(plane.load(q), robot.dynamics().torques(q, zero, zero), atol=1e-12)


def test_a_sealed_case_of_a_drive_is_made_run_and_scored(tmp_path):
    cases, truth, out = (tmp_path / name for name in ("cases", "truth", "out"))
    design = Design(seed=3, kind="single", effects=("actuation_offset",), simulator="motion")
    make_set(cases, truth, design, 1)
    run_set(cases, out, jobs=1)
    score = score_run(out, truth)
    assert score.cases == 1
    assert score.confusion[0].truth == score.confusion[0].answer
