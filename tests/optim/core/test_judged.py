"""A fit is judged from where it ended: by how far it would still move, and by what holds it."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.optim.core import judged as judging
from plumbline.optim.core.constants import STILL
from plumbline.optim.core.judged import Solution, judged, judged_by_gram, the_worst
from plumbline.optim.core.solvers import ALL, Ipopt, LevenbergMarquardt
from tests.optim.core.test_every_solver import calibration, linear, model_of

EACH = pytest.mark.parametrize("solver", ALL, ids=lambda s: type(s).__name__)


@pytest.fixture(scope="module")
def model():
    return model_of(calibration())


def noisy_line(correlation=0.0, rows=200, **given):
    """y = a x + b z with columns as alike as asked, and its least-squares answer."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(rows, 2))
    A[:, 1] = correlation * A[:, 0] + np.sqrt(1 - correlation**2) * A[:, 1]
    b = A @ [1.0, -2.0] + 0.01 * rng.normal(size=rows)
    return linear(A, b, **given), np.linalg.lstsq(A, b)[0]


@EACH
def test_a_fit_that_was_run_to_its_end_is_judged_converged(model, solver):
    found = judged(solver.solve(model.problem, model.start), "the calibration")
    assert found.converged, found
    assert found.stationarity < STILL / 10
    assert found.words.startswith("the calibration converged")


def test_a_fit_that_was_cut_short_is_called_that_whatever_the_solver_says(model):
    short = LevenbergMarquardt(max_iterations=1).solve(model.problem, model.start)
    found = judged(replace(short, message="converged"), "the calibration")
    assert not found.converged
    assert found.stationarity > STILL
    assert "the calibration has not converged" in found.words
    assert f"standard errors, {STILL:g} allowed; allow more iterations" in found.words


def test_a_solver_may_rest_where_the_unknowns_move_by_so_many_standard_errors_and_no_more(model):
    ends = {
        still: LevenbergMarquardt(tolerance=0.0, still=still).solve(model.problem, model.start)
        for still in (0.01, 1.0, 100.0)
    }
    steps = [end.iterations for end in ends.values()]
    assert steps == sorted(steps, reverse=True)
    assert steps[0] > steps[-1]
    for still, end in ends.items():
        assert judged(end).stationarity <= still


def test_what_a_solver_leaves_is_judged_by_the_normal_equations_where_it_ended(model):
    for steps in (0, 1, 5):
        end = LevenbergMarquardt(max_iterations=steps).solve(model.problem, model.start)
        there = end.mapped.gram(end.x)
        np.testing.assert_array_equal(end.gram.matrix, there.matrix)
        np.testing.assert_array_equal(end.gram.vector, there.vector)


@pytest.mark.parametrize("correlation", [0.0, 0.99, 0.999999])
def test_stationarity_is_how_many_standard_errors_are_left_to_go(correlation):
    """Also where one unknown at a time promises nothing: the two move together."""
    problem, best = noisy_line(correlation)
    solution = Solution(problem, best)
    sigma = np.sqrt(2 * solution.cost / (len(problem.rows) - 2))
    # One standard error along each of the two directions in which the fit is told.
    values, vectors = np.linalg.eigh(solution.gram.matrix)
    for value, vector in zip(values, vectors.T, strict=True):
        for steps in (0.5 * STILL, 3.0):
            off = Solution(problem, best + steps * sigma / np.sqrt(value) * vector)
            found = judged(off)
            assert found.stationarity == pytest.approx(steps, rel=0.03)
            assert found.converged == (steps < STILL)


def test_a_bound_that_holds_an_unknown_back_is_no_lack_of_convergence_and_is_named():
    problem, _ = noisy_line(lower=np.array([-9.0, -1.5]))
    found = judged(LevenbergMarquardt().solve(problem, [0.0, 0.0]))
    assert found.converged
    assert found.at_bound == ("x1",)
    assert "at a bound: x1" in found.words
    long = replace(found, at_bound=("creeping [speed=0.26599999999999996]",))
    assert "creeping [speed=0.266]" in long.words


def test_an_unknown_that_rests_on_a_bound_and_would_leave_it_has_not_converged():
    problem, _ = noisy_line(lower=np.array([-9.0, -2.5]))
    assert not judged(Solution(problem, np.array([1.0, -2.5]))).converged


def test_an_unknown_that_is_pinned_is_never_asked_to_move():
    problem, best = noisy_line()
    pinned = replace(problem, lower=np.array([-9.0, 5.0]), upper=np.array([9.0, 5.0]))
    solution = LevenbergMarquardt().solve(pinned, [0.0, 5.0])
    assert judged(solution).converged
    assert not np.allclose(solution.x, best)


def test_a_point_outside_of_its_bounds_is_not_feasible():
    problem, best = noisy_line()
    tight = replace(problem, upper=best - np.array([0.0, 1e-6]))
    found = judged(Solution(tight, best))
    assert not found.converged
    assert found.violation == pytest.approx(1e-6)
    assert "breaks a bound by 1e-06, 1e-08 allowed" in found.words


def test_a_constraint_that_holds_is_felt():
    problem, _ = noisy_line()
    held = replace(
        problem, constraints=problem.x[1], g_lower=np.array([-1.0]), g_upper=np.array([9.0])
    )
    assert judged(Ipopt().solve(held, [0.0, 0.0])).converged


def test_readings_without_noise_are_judged_too():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(30, 3))
    problem = linear(A, A @ [1.0, 2.0, 3.0])
    assert judged(LevenbergMarquardt().solve(problem, np.zeros(3))).converged
    assert not judged(Solution(problem, np.array([1.0, 2.0, 3.1]))).converged


def test_what_the_rows_do_not_tell_is_not_asked_to_move():
    A = np.column_stack([np.ones(20), np.ones(20)])
    problem = linear(A, np.linspace(0.0, 1.0, 20))
    assert judged(LevenbergMarquardt().solve(problem, np.zeros(2))).converged


@pytest.mark.parametrize(("apart", "asked"), [(1e-5, False), (1e-4, True)])
def test_a_direction_that_rows_tell_a_hundred_thousand_times_worse_is_not_asked_to_move(
    apart, asked
):
    """Columns apart by so much: half the square of it is the least curvature, of two."""
    a, b, noise = np.linalg.qr(np.random.default_rng(0).normal(size=(30, 3)))[0].T
    problem = linear(np.column_stack([a, a + apart * b]), noise)
    off = Solution(problem, np.array([-1.0, 1.0]) / apart)  # five standard errors
    assert judged(off).converged != asked


def test_a_point_that_is_no_number_has_not_converged():
    problem, _ = noisy_line()
    found = judged(Solution(problem, np.array([np.nan, 0.0])))
    assert not found.converged
    assert "no finite point" in found.words


def test_normal_equations_are_judged_as_the_solution_is(model):
    solution = LevenbergMarquardt(max_iterations=1).solve(model.problem, model.start)
    whole, equations = judged(solution), judged_by_gram(solution.gram)
    assert equations.stationarity == pytest.approx(whole.stationarity, rel=1e-9)


def test_the_worst_is_the_one_to_speak_of(model):
    problem, best = noisy_line()
    fine, off = judged(Solution(problem, best), "one"), judged(Solution(problem, best + 1), "two")
    lost = judged(Solution(problem, best * np.nan), "three")
    assert the_worst([fine, off]) is off
    assert the_worst([lost, off, fine]) is lost
    assert the_worst([]) is None


def test_a_limit_is_told_to_two_digits():
    found = judging.Judged("the fit", False, 10.0, 0.0, limit=0.988635)
    assert found.words.endswith("move by 10 standard errors, 0.99 allowed; allow more iterations")


def test_the_limit_is_a_tenth_of_a_standard_error():
    """A figure changes by half the square of it: 0.5 % of one equation's share."""
    assert STILL == 0.1
