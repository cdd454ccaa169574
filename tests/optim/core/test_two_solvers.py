"""Each method's problem solved by two solvers: the answer is the problem's, not the solver's."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import Nonlinear
from plumbline.optim.core.judged import judged
from plumbline.optim.core.solvers import Fatrop, Ipopt, LevenbergMarquardt, Slsqp, Sqp, TrustRegion
from plumbline.optim.dh_fit import DHOptions, Squares, fit_dh
from plumbline.optim.hand_eye.three_planes import Weights, solve_three_planes
from plumbline.optim.pointing import Aim, PointingOptions, plan_sweep
from plumbline.optim.pointing.postures import follow
from plumbline.optim.pointing.statement import IPOPT, SweepWeights, sweep_statement
from plumbline.optim.pointing.task import needle_task
from plumbline.optim.registration import Anisotropic, MarkerNoise
from tests.dh_sessions import recording, session
from tests.optim.capsule_mpc.test_capsule_mpc import GOAL, OBSTACLES, START, two
from tests.optim.hand_eye.test_hand_eye import singles, surveyed
from tests.optim.pointing.test_pointing import LESION, NEEDLE, PHANTOM, UR3, deg, placed
from tests.phantoms import registered

MM = 1e-3


@pytest.mark.parametrize("solver", [Ipopt(), TrustRegion(), Sqp(), Slsqp()])
def test_an_anisotropic_registration(solver):
    rng = np.random.default_rng(0)
    ct = rng.uniform(0.0, 0.1, (6, 3))
    robot = ct + np.array([0.3, 0.1, 0.0]) + rng.normal(0.0, 1e-3, (6, 3))
    noise = MarkerNoise.from_resolution(MM * np.array([5, 1, 1]), 0.1 * MM)
    one, two_ = (
        registered(Anisotropic(s), ct, robot, noise).T_RC for s in (LevenbergMarquardt(), solver)
    )
    np.testing.assert_allclose(one, two_, atol=1e-8)


@pytest.mark.parametrize("solver", [TrustRegion(), Ipopt(), Sqp(), Slsqp()])
def test_a_beam_from_three_planes(solver):
    _, _, readings = surveyed(1)
    start, weights = singles(readings), Weights(1.0, 1e-4)
    one = solve_three_planes(readings, start, weights, LevenbergMarquardt())
    two_ = solve_three_planes(readings, start, weights, solver)
    np.testing.assert_allclose(one.beam.r, two_.beam.r, atol=1e-6)
    np.testing.assert_allclose(one.beam.v, two_.beam.v, atol=1e-6)


def test_a_link_fit():
    given = recording(session(3))
    fits = [fit_dh(given, DHOptions(loss=Squares(), solver=s)) for s in (Ipopt(), TrustRegion())]
    np.testing.assert_allclose(fits[0].x, fits[1].x, atol=1e-6)
    assert all(fit.judged.converged for fit in fits)
    assert fits[0].solver == "Ipopt"


@pytest.fixture(scope="module")
def sweep():
    """A short sweep: its problem and where it starts."""
    aim = Aim(UR3, placed(), LESION, NEEDLE, PHANTOM)
    theta, beta = np.full(5, deg(35.0)), deg(np.linspace(260.0, 280.0, 5))
    task, rows = needle_task(UR3, NEEDLE.axis), aim.rows(theta, beta)
    arm = PointingOptions().bounded(task)
    track = follow(arm, rows).q[0]
    statement = sweep_statement(task, 5, SweepWeights())
    problem = statement.at(rows, np.ones(5, dtype=bool), arm.lower, arm.upper, 0.6)
    return problem, statement.start(track)


@pytest.mark.parametrize("solver", [Sqp(tolerance=1e-7), Slsqp()])
def test_a_pointing_sweep(sweep, solver):
    problem, start = sweep
    one, two_ = (s.solve(problem, start) for s in (IPOPT, solver))
    assert judged(one).converged
    assert judged(two_).violation < 1e-7
    assert two_.cost == pytest.approx(one.cost, abs=1e-8)
    np.testing.assert_allclose(one.x, two_.x, atol=2e-3)  # turning about the needle hardly costs


def test_a_sweep_is_planned_by_the_solver_that_is_chosen():
    aim = Aim(UR3, placed(), LESION, NEEDLE, PHANTOM)
    angles = (deg(35.0), deg(np.linspace(240.0, 300.0, 8)))
    one, two_ = (
        plan_sweep(aim, *angles, PointingOptions(solver=s)) for s in (IPOPT, Sqp(tolerance=1e-7))
    )
    assert one.is_safe
    assert two_.is_safe
    np.testing.assert_allclose(one.joints, two_.joints, atol=2e-3)
    with pytest.raises(PlumblineError, match=r"TrustRegion: .* constraints, 0 allowed; use Ipopt"):
        plan_sweep(aim, *angles, PointingOptions(solver=TrustRegion()))


@pytest.mark.parametrize("solver", ["fatrop", Fatrop(tolerance=5e-2), Sqp(tolerance=1e-4)])
def test_a_plan_of_two_instruments(solver):
    statement, path = two(), np.tile(START, (8, 1))
    stages = statement.stages(GOAL, OBSTACLES, np.zeros(6))
    one, two_ = (Nonlinear(s).ready(statement).plan(START, stages, path) for s in ("ipopt", solver))
    assert one.solved
    assert two_.solved
    np.testing.assert_allclose(one.x, two_.x, atol=0.05)  # [mm]
