"""How long the rounds of the hand-eye go on, when they rest, and over what its errors reach."""

from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.experiments.reproduce import hand_eye_peers as baselines
from plumbline.kinematics.robot import Robot
from plumbline.optim.hand_eye import calibrate, design, reweighting, start
from plumbline.optim.hand_eye.calibrate import HandEyeOptions
from plumbline.optim.hand_eye.design import _ball
from plumbline.optim.hand_eye.readings import Frames
from plumbline.optim.hand_eye.reweighting import Variance, fit_variance, robust_fit
from plumbline.optim.hand_eye.shapes import _field, _shapes
from tests.ranging_scenes import CLEAN, surveyed, truth


@pytest.mark.parametrize(("step", "rounds"), [(0.75e-5, 1), (1.5e-5, 40)])
def test_robust_rounds_rest_at_a_hundred_thousandth_of_the_scale_or_end_at_forty(
    monkeypatch, step, rounds
):
    made = []
    monkeypatch.setattr(reweighting, "Mapped", lambda problem: problem)
    monkeypatch.setattr(reweighting, "rows_at", lambda *_: (np.ones(9), np.ones((9, 2))))
    monkeypatch.setattr(reweighting, "_step", lambda *_: made.append(1) or np.full(2, 3.0 * step))
    robust_fit(SimpleNamespace(scale=np.full(2, 3.0)), np.zeros(2))
    assert len(made) == rounds


@pytest.mark.parametrize(("change", "settled"), [(0.75e-3, True), (1.5e-3, False)])
def test_variances_rest_at_a_thousandth(change, settled):
    spreads = np.array([1.0, 1.0, 1.0])
    one, two = Variance(1.0), Variance(1.0 + change)
    assert reweighting._settled((one, spreads), (two, spreads)) is settled
    grown = spreads * np.sqrt(1.0 + change)
    assert reweighting._settled((one, spreads), (one, grown)) is settled


def test_likely_rounds_are_fifteen_about_each_of_three_points(monkeypatch):
    asked, turned = [], []
    turns = reweighting._turns

    def listen(*given):
        turned.append(1)
        return turns(*given)

    def never(squares, incidence):
        asked.append(1)
        return fit_variance(squares, incidence)

    monkeypatch.setattr(reweighting, "_turns", listen)
    monkeypatch.setattr(reweighting, "fit_variance", never)
    monkeypatch.setattr(reweighting, "_settled", lambda *_: False)
    monkeypatch.setattr(calibrate.constants, "GROSS_ROUNDS", 1)
    _, _, readings = surveyed(0)
    calibrate.calibrate(readings, HandEyeOptions(poses=0, shapes=0, arm=0))
    assert len(turned) == 3
    assert len(asked) == 3 * 15


def test_gross_readings_are_left_out_three_times(monkeypatch):
    left = []

    def one_more(fit, incidence, limit):
        found = np.zeros(len(incidence), dtype=bool)
        found[0] = len(left) < 9
        left.append(1)
        return found

    monkeypatch.setattr(calibrate, "_gross", one_more)
    _, _, readings = surveyed(0)
    found = calibrate.calibrate(readings, HandEyeOptions(poses=0, shapes=0, arm=0))
    assert len(left) == 3
    assert len(found.incidence) == len(found.readings) == len(readings) - 3


def test_a_variance_s_slope_takes_eight_rounds(monkeypatch):
    solved, solve = [], np.linalg.solve
    linalg = SimpleNamespace(solve=lambda *given: solved.append(1) or solve(*given))
    plain = {name: getattr(np, name) for name in dir(np) if not name.startswith("__")}
    monkeypatch.setattr(reweighting, "np", SimpleNamespace(**{**plain, "linalg": linalg}))
    incidence = np.linspace(0.0, 1.0, 30)
    fit_variance(1e-8 * (1.0 + incidence), incidence)
    assert len(solved) == 8


@pytest.mark.parametrize(("gain", "rounds"), [(0.97, 12), (0.985, 1)])
def test_a_start_is_refined_until_its_scatter_falls_by_less_than_two_in_a_hundred(
    monkeypatch, gain, rounds
):
    scatter, inner = [1.0], []
    readings = surveyed(0)[2]
    errors = np.linspace(0.0, 2.0, len(readings))

    def fitted(every, closer, beam):
        inner.append(len(closer))
        scatter.append(scatter[-1] * gain)
        return beam, scatter[-1], errors * scatter[-1]

    monkeypatch.setattr(start, "_fitted", fitted)
    start._refined(readings, (None, 1.0, errors))
    assert len(inner) == rounds
    assert set(inner) == {int(np.sum(errors <= 1.5))}


def test_the_starts_of_samples_take_twelve_rounds_and_four_are_kept(monkeypatch):
    rounds, fit = set(), start.robust_fit

    def listen(problem, first, asked):
        rounds.add(asked)
        return fit(problem, first, 2)

    monkeypatch.setattr(start, "robust_fit", listen)
    monkeypatch.setattr(start.constants, "TRIALS", 6)
    assert len(start._sampled(surveyed(0)[2])) == 4
    assert rounds == {12}


def leading(kernel, flat):
    """The largest eigenvalue of a kernel (N, N), the columns of ``flat`` projected out."""
    Q, _ = np.linalg.qr(flat)
    free = np.eye(len(kernel)) - Q @ Q.T
    return np.linalg.eigvalsh(free @ kernel @ free)[-1]


def test_a_board_s_shape_reaches_over_four_tenths_of_it():
    places = np.random.default_rng(0).uniform(-0.2, 0.2, (40, 2))
    squared = np.sum((places[:, None] - places[None]) ** 2, axis=2)
    kernel = np.exp(-squared / (2.0 * 0.4**2 * np.percentile(squared, 98.0)))
    wanted = leading(kernel, np.column_stack([np.ones(40), places]))
    assert np.sum(_shapes(places, 1) ** 2) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("still", ["R", "t"])
def test_an_arm_s_error_reaches_over_three_tenths_of_a_metre_and_of_a_radian(still):
    scene, _, readings = surveyed(0, CLEAN)
    readings = readings.on_plane(int(readings.planes[0]))
    one = getattr(readings, still)[:1]
    readings = type(readings)(**{**vars(readings), still: np.repeat(one, len(readings), axis=0)})
    frames = Frames.of(readings, truth(scene))
    points = truth(scene).points(readings.R, readings.t, readings.distance)
    gap = np.sum((readings.t[:, None] - readings.t) ** 2, axis=2) / 0.3**2
    turn = np.sum((readings.R[:, None] - readings.R) ** 2, axis=(2, 3)) / (2.0 * 0.3**2)
    places = (points - frames.c[0]) @ frames.B[0][:, :2]
    flat = np.column_stack([np.ones(len(readings)), places])
    found = np.sum(_field(readings, frames, points, 1) ** 2)
    assert found == pytest.approx(leading(np.exp(-(gap + turn) / 2.0), flat), rel=1e-6)


def test_a_posture_is_reached_in_twelve_steps_of_four_tenths_and_to_a_hundredth_millimetre(
    monkeypatch,
):
    chain = Robot.bundled("ur5").chain()
    near = np.array([[0.0, -1.2, 1.0, -1.0, -1.5, 0.0]])
    asked, rows = [], design.over_rows

    def listen(function, given):
        asked.append(given[0, :6].copy())
        return rows(function, given)

    monkeypatch.setattr(design, "over_rows", listen)
    far = chain.placement(near + 1.0)
    design.reach(chain, near, far)
    assert len(asked) == 12 + 1
    assert np.linalg.norm(asked[1] - asked[0]) == pytest.approx(0.4)
    monkeypatch.setattr(design.constants, "REACH_STEPS", 0)
    for off, arrived in ((0.75e-5, True), (1.5e-5, False)):
        goal = chain.placement(near)
        goal[0, 0, 3] += off
        assert design.reach(chain, near, goal)[1][0] == arrived


def test_four_hundred_poses_are_candidates(monkeypatch):
    drawn = []

    def listen(rng, count):
        drawn.append(count)
        return _ball(rng, count)

    monkeypatch.setattr(design, "_ball", listen)
    found = calibrate.calibrate(surveyed(0)[2], HandEyeOptions(poses=0, shapes=0, arm=0))
    design.candidates(found, np.random.default_rng(0))
    assert drawn == [400]


def test_scipy_s_losses_bend_at_a_tenth_of_a_millimetre(monkeypatch):
    scales, least_squares = [], baselines.scipy.optimize.least_squares

    def listen(*given, f_scale, **more):
        scales.append(f_scale)
        return least_squares(*given, f_scale=f_scale, max_nfev=2, **more)

    monkeypatch.setattr(baselines.scipy.optimize, "least_squares", listen)
    scene, _, readings = surveyed(0)
    baselines.scipy_direct(readings, truth(scene))
    assert scales == [1e-4]


def test_boards_take_sixteen_shapes_and_arms_forty_eight():
    assert (HandEyeOptions().shapes, HandEyeOptions().arm) == (16, 48)
