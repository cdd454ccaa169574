"""The contract that every solver keeps, and a solution's judgement of itself."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.core import mapped as mapping
from plumbline.optim.core.judged import Solution, judged
from plumbline.optim.core.mapped import Gram, Mapped, less_foretold
from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solvers import (
    ALL,
    Fatrop,
    Ipopt,
    LevenbergMarquardt,
    Slsqp,
    Sqp,
    TrustRegion,
)
from plumbline.optim.core.solvers.programme import compiled
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.building import build_recording

OFFSETS = np.array([0.004, -0.006, 0.003, 0.007])
JOINTS = (2, 3, 4, 5)
TOOL = np.array([0.02, -0.03, 0.15])
T_DEVICE_BASE = np.array([1.0, 2.0, 0.5])
NOISE = 2e-4
SOLVERS = [*ALL, Slsqp(), Ipopt(exact_hessian=True)]
EACH = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: f"{type(s).__name__}")
UNCONSTRAINED = [s for s in SOLVERS if not s.constraints]
ABLE = [s for s in SOLVERS if s.constraints]
EACH_ABLE = pytest.mark.parametrize("solver", ABLE, ids=lambda s: type(s).__name__)


def calibration(rows=60, seed=0, noise=NOISE, observation="tip_position", **given):
    """A UR5 whose zeros are off, simulated by Pinocchio; measured by a device somewhere else."""
    rng = np.random.default_rng(seed)
    robot = Robot.bundled("ur5")
    q = rng.uniform(-2.5, 2.5, (rows, 6))
    wrong = np.zeros(6)
    wrong[np.array(JOINTS) - 1] = OFFSETS
    data, frame = robot.model.createData(), robot.model.getFrameId("flange")
    tips = []
    for posture in q + wrong:
        pin.framesForwardKinematics(robot.model, data, posture)
        tips.append(data.oMf[frame].act(TOOL))
    places = Rotation.from_euler("xyz", [0.5, 0.2, -1.0]).apply(tips) + T_DEVICE_BASE
    return build_recording(
        observation=observation,
        robot=robot,
        q=q,
        measured=places + rng.normal(0, noise, places.shape),
        tool_offset=TOOL,
        **given,
    )


def model_of(recording):
    return build_model(recording, [REGISTRY["joint_offset"](joint=j) for j in JOINTS])


@pytest.fixture(scope="module")
def model():
    return model_of(calibration())


def linear(A, b, *, lower=-np.inf, upper=np.inf, **given):
    """min |A x - b|^2 / 2 as a problem of one number a row."""
    size = A.shape[1]
    x, row = cs.SX.sym("x", size), cs.SX.sym("row", size + 1)
    return Problem(
        x=x,
        names=tuple(f"x{k}" for k in range(size)),
        lower=np.broadcast_to(np.asarray(lower, float), size).copy(),
        upper=np.broadcast_to(np.asarray(upper, float), size).copy(),
        scale=np.ones(size),
        residual=cs.dot(x, row[:-1]) - row[-1],
        row=row,
        rows=np.column_stack([A, b]),
        **{"weights": np.ones(len(A)), **given},
    )


def random_system(seed, rows=30, size=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, size)), rng.normal(size=rows)


# The same optimum


@EACH
def test_every_solver_finds_the_same_optimum(model, solver):
    best = LevenbergMarquardt(tolerance=1e-15).solve(model.problem, model.start)
    found = solver.solve(model.problem, model.start)
    assert found.problem is model.problem
    assert found.cost == pytest.approx(best.cost, rel=1e-8)
    np.testing.assert_allclose(found.x, best.x, atol=1e-6)
    assert found.is_optimal(), found.stationarity()
    assert found.iterations >= 1
    assert found.message
    sigma = np.sqrt(2 * found.cost / (60 * 3 - model.problem.size))
    assert sigma == pytest.approx(NOISE, rel=0.15)


@EACH
def test_every_solver_recovers_what_pinocchio_simulated(solver):
    model = model_of(calibration(rows=30, noise=0.0))
    found = solver.solve(model.problem, model.start)
    np.testing.assert_allclose(found.x[model.fixed :], OFFSETS, atol=1e-7)
    assert np.sqrt(2 * found.cost / 30) < 1e-7


@EACH
def test_the_truth_lies_within_the_stated_errors(model, solver):
    found = solver.solve(model.problem, model.start)
    std = found.std(NOISE)[model.fixed :]
    assert (np.abs(found.x[model.fixed :] - OFFSETS) < 4 * std).all()
    assert (std < 5e-4).all()


def valley(bend=10.0, rows=40):
    """Rosenbrock's (1960): residuals bend (y - x^2) and 1 - x, told by many rows."""
    x, row = cs.SX.sym("x", 2), cs.SX.sym("row", 2)
    turn = np.linspace(0.0, np.pi, rows)
    return Problem(
        x=x,
        names=("along", "across"),
        lower=np.full(2, -np.inf),
        upper=np.full(2, np.inf),
        scale=np.ones(2),
        residual=row[0] * bend * (x[1] - x[0] ** 2) + row[1] * (1.0 - x[0]),
        row=row,
        rows=np.column_stack([np.cos(turn), np.sin(turn)]),
        weights=np.ones(rows),
    )


@pytest.mark.parametrize(("bend", "most"), [(10.0, 30), (100.0, 75), (1000.0, 150)])
def test_a_valley_that_bends_is_followed_in_few_steps(bend, most):
    """Without the turn they are 53, 236 and 1,128; what rounding leaves makes 100 to 200 of 120."""
    starts = [(-1.2, 1.0 + k * 1e-9) for k in range(-3, 4)]
    found = [LevenbergMarquardt(500).solve(valley(bend), start) for start in starts]
    np.testing.assert_allclose([one.x for one in found], np.ones((7, 2)), atol=1e-9)
    assert np.median([one.iterations for one in found]) <= most


@pytest.mark.parametrize(("start", "turns"), [(0.53, False), (0.49, True)])
def test_steps_turn_once_one_has_kept_less_than_half_of_its_promise(monkeypatch, start, turns):
    """Of x^2 = 1 Newton's first step leaves (1 - x^2) / (4 x^2) of the residual: 0.64 or 0.79."""
    asked = []
    ask = Mapped.curvature_along
    monkeypatch.setattr(Mapped, "curvature_along", lambda *of: asked.append(of) or ask(*of))
    x, row = cs.SX.sym("x"), cs.SX.sym("row")
    problem = replace(
        linear(np.ones((1, 1)), np.ones(1)), x=x, row=row, residual=x**2 - row, rows=np.ones((1, 1))
    )
    found = LevenbergMarquardt().solve(problem, [start])
    np.testing.assert_allclose(found.x, 1.0, atol=1e-9)
    assert bool(asked) is turns


def test_the_curvature_along_a_step_is_that_of_casadi(model):
    """The first rows of it by the Hessian of each residual, weighted and whitened."""
    p = replace(model.problem, weights=np.linspace(0.5, 2.0, 60), follows=np.full(60, 0.4))
    x, step = model.start + 0.01, np.linspace(-1e-3, 1e-3, p.size)
    t = cs.SX.sym("t")
    line = cs.substitute(p.residual, p.x, cs.DM(x) + t * cs.DM(step))
    twice = cs.Function("twice", [t, p.row], [cs.jacobian(cs.jacobian(line, t), t)])
    bent = np.array([twice(0.0, row).full().ravel() for row in p.rows])
    white = less_foretold(np.sqrt(p.weights)[:, None] * bent, np.zeros((1, 3)), p.follows)
    J = np.concatenate([J for _, _, J in Mapped(p).whitened(x)])
    expected = np.einsum("nmp,nm->p", J, white)
    found = Mapped(p).curvature_along(x, step)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * abs(expected).max())


@EACH
def test_a_start_outside_of_the_bounds_is_clipped(model, solver):
    own = np.arange(model.problem.size) >= model.fixed
    bounds = zip((-0.8, 0.8), (model.problem.lower, model.problem.upper), strict=True)
    lower, upper = (np.where(own, by, bound) for by, bound in bounds)
    problem = replace(model.problem, lower=lower, upper=upper)
    found = solver.solve(problem, model.start + 3.0 * own)
    assert found.primal_violation() == 0.0
    assert found.cost == pytest.approx(solver.solve(problem, model.start).cost, rel=1e-8)


# Bounds


def bounded(model):
    """The calibration with two offsets' truth out of bounds."""
    upper, lower = model.problem.upper.copy(), model.problem.lower.copy()
    upper[model.fixed + 3] = 0.002
    lower[model.fixed + 1] = -0.001
    return replace(model.problem, upper=upper, lower=lower)


@EACH
def test_active_bounds_are_kept_and_named(model, solver):
    problem = bounded(model)
    best = LevenbergMarquardt(tolerance=1e-15).solve(problem, model.start)
    free = LevenbergMarquardt().solve(model.problem, model.start)
    found = solver.solve(problem, model.start)
    assert found.cost == pytest.approx(best.cost, rel=1e-8)
    assert found.cost > 1.5 * free.cost
    assert found.primal_violation() == 0.0
    assert found.at_bound() == ("joint_offset 3 offset", "joint_offset 5 offset")
    assert found.is_optimal(), found.stationarity()
    assert not Solution(problem, free.x).is_optimal()
    assert Solution(problem, free.x).primal_violation() == pytest.approx(
        max(free.x[model.fixed + 3] - 0.002, -0.001 - free.x[model.fixed + 1])
    )


@EACH
@pytest.mark.parametrize("seed", range(6))
def test_a_bounded_linear_problem_is_solved_as_scipy_does(solver, seed):
    A, b = random_system(seed)
    problem = linear(A, b, lower=-0.1, upper=0.05)
    expected = lsq_linear(A, b, (-0.1, 0.05), method="bvls", tol=1e-14)
    found = solver.solve(problem, np.zeros(4))
    assert expected.active_mask.any()
    assert found.cost == pytest.approx(expected.cost, rel=1e-8)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6)
    assert found.is_optimal()


@EACH
def test_bounds_may_fix_an_unknown(solver):
    A, b = random_system(7)
    problem = linear(A, b, lower=[-9, 0.3, -9, -9], upper=[9, 0.3, 9, 9])
    found = solver.solve(problem, np.zeros(4))
    rest = np.linalg.lstsq(A[:, [0, 2, 3]], b - 0.3 * A[:, 1])[0]
    np.testing.assert_allclose(found.x, [rest[0], 0.3, *rest[1:]], atol=1e-6)
    assert found.is_optimal()


@EACH
def test_a_start_on_the_wrong_bound_is_left(solver):
    A, b = random_system(3)
    best = np.linalg.lstsq(A, b)[0]
    corner = np.where(best > 0, -5.0, 5.0)
    problem = linear(A, b, lower=-5.0, upper=5.0)
    np.testing.assert_allclose(solver.solve(problem, corner).x, best, atol=1e-6)


# Weights and shared residuals


@EACH
def test_a_weight_of_zero_removes_a_row(model, solver):
    weights = np.ones(60)
    weights[40:] = 0.0
    part = model.problem.on(model.problem.rows[:40])
    spoilt = model.problem.rows.copy()
    spoilt[40:] += 3.0
    silent = model.problem.on(spoilt, weights)
    expected, found = (solver.solve(p, model.start) for p in (part, silent))
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6)
    assert found.cost == pytest.approx(expected.cost, rel=1e-8)


@EACH
def test_a_weight_of_two_counts_a_row_twice(solver):
    A, b = random_system(5)
    weights = np.where(np.arange(30) < 10, 2.0, 1.0)
    twice = linear(np.vstack([A, A[:10]]), np.concatenate([b, b[:10]]))
    expected = solver.solve(twice, np.zeros(4))
    found = solver.solve(linear(A, b, weights=weights), np.zeros(4))
    np.testing.assert_allclose(found.x, expected.x, atol=1e-7)
    assert found.cost == pytest.approx(expected.cost, rel=1e-10)


@EACH
def test_shared_residuals_count_once(solver):
    A, b = random_system(6)
    problem = linear(A, b)
    problem = replace(problem, shared=5.0 * (cs.sum1(problem.x) - 1.0))
    found = solver.solve(problem, np.zeros(4))
    stacked = np.vstack([A, 5.0 * np.ones(4)])
    expected = np.linalg.lstsq(stacked, np.append(b, 5.0))[0]
    np.testing.assert_allclose(found.x, expected, atol=1e-6)
    assert found.cost == pytest.approx(np.sum((stacked @ expected - np.append(b, 5.0)) ** 2) / 2)
    assert found.is_optimal()


@EACH
def test_a_known_distance_between_sockets_makes_the_scale_known(solver):
    """Without it a tip that rests in sockets says nothing of the arm's size; all solvers agree."""
    recording = calibration(rows=60)
    rng = np.random.default_rng(9)
    socket = np.repeat([0, 1], 30)
    q = recording.q.copy()
    q[:, 0] = np.where(socket == 0, 0.4, 1.2) + rng.normal(0, 1e-4, 60)
    q[:, 1:3] = [-1.0, 1.2]
    resting = build_recording(
        observation="fixed_point",
        robot=recording.robot,
        q=q,
        tool_offset=np.zeros(3),
        socket=socket,
        socket_distance=0.3,
        always=("frame",),
    )
    model = build_model(resting)
    assert model.problem.shared.numel() == 1
    best = LevenbergMarquardt(tolerance=1e-15).solve(model.problem, model.start)
    found = solver.solve(model.problem, model.start)
    assert found.cost == pytest.approx(best.cost, rel=1e-8)
    assert found.is_optimal()
    without = solver.solve(replace(model.problem, shared=cs.SX(0, 1)), model.start)
    gaps = [np.linalg.norm(x.reshape(2, 3)[0] - x.reshape(2, 3)[1]) for x in (found.x, without.x)]
    assert abs(gaps[0] - 0.3) < 0.6 * abs(gaps[1] - 0.3)


# An objective that is no square


def flat(objective, size=2, **given):
    """min f(x) and nothing else."""
    x = cs.SX.sym("x", size)
    bound = np.full(size, np.inf)
    names = tuple(f"x{k}" for k in range(size))
    stated = {"lower": -bound, "upper": bound, "scale": np.ones(size), "objective": objective(x)}
    return Problem(x=x, names=names, **{**stated, **{k: v(x) for k, v in given.items()}})


def rosenbrock(x):
    return 1e2 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2


@EACH_ABLE
def test_an_objective_alone_is_made_least(solver):
    found = solver.solve(flat(rosenbrock), np.array([-1.2, 1.0]))
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-5)
    assert found.cost == pytest.approx(0.0, abs=1e-9)
    assert judged(found).violation == 0.0


@EACH_ABLE
def test_an_objective_beside_rows_pulls_by_its_slope(solver):
    A, b = random_system(15)
    c = np.array([3.0, -2.0, 0.0, 1.0])
    problem = linear(A, b)
    found = solver.solve(replace(problem, objective=cs.dot(c, problem.x)), np.zeros(4))
    best = np.linalg.solve(A.T @ A, A.T @ b - c)
    np.testing.assert_allclose(found.x, best, atol=1e-6)
    assert found.cost == pytest.approx(np.sum((A @ best - b) ** 2) / 2 + c @ best)
    assert found.is_optimal(1e-7)
    assert judged(found).converged
    assert not judged(Solution(found.problem, found.x + 1e-3)).converged


@EACH_ABLE
def test_an_objective_keeps_to_bounds_and_constraints(solver):
    """Nearest to (-1, -3) on a disc, x above 0: (0, -1)."""
    problem = flat(
        lambda x: cs.sumsqr(x + cs.DM([1.0, 3.0])) / 2,
        lower=lambda _: np.array([0.0, -9.0]),
        constraints=cs.sumsqr,
        g_lower=lambda _: np.array([-np.inf]),
        g_upper=lambda _: np.ones(1),
    )
    found = solver.solve(problem, np.array([0.5, 0.5]))
    np.testing.assert_allclose(found.x, [0.0, -1.0], atol=1e-6)
    assert judged(found).converged, judged(found)
    assert judged(replace(found, multipliers=None)).converged
    assert judged(found).unit != "standard errors"
    assert not judged(replace(found, x=np.array([0.6, -0.8]))).converged
    assert judged(replace(found, x=np.array([0.0, -1.1]))).violation == pytest.approx(0.21)


def test_the_gradient_and_hessian_of_an_objective_are_exact():
    A, b = random_system(16, size=2)
    problem = linear(A, b)
    mapped = Mapped(replace(problem, objective=rosenbrock(problem.x)))
    x, h = np.array([0.3, -0.2]), 1e-5
    slope = [(mapped.cost(x + e) - mapped.cost(x - e)) / (2 * h) for e in h * np.eye(2)]
    np.testing.assert_allclose(mapped.gradient(x), slope, rtol=1e-7)
    rows = [(mapped.gradient(x + e) - mapped.gradient(x - e)) / (2 * h) for e in h * np.eye(2)]
    np.testing.assert_allclose(mapped.gram(x).matrix + mapped.bend(x), rows, rtol=1e-6)


def test_data_of_an_objective_are_numbers_of_one_statement():
    x, aim = cs.SX.sym("x", 2), cs.SX.sym("aim", 2)
    given = {"names": ("a", "b"), "scale": np.ones(2), "objective": cs.sumsqr(x - aim)}
    wide = np.full(2, 9.0)
    stated = Problem(x=x, lower=-wide, upper=wide, given=aim, data=np.zeros(2), **given)
    for place in ([1.0, 2.0], [-3.0, 0.5]):
        for solver in ABLE:
            found = solver.solve(replace(stated, data=np.array(place)), np.zeros(2))
            np.testing.assert_allclose(found.x, place, atol=1e-6)
    assert compiled(Ipopt(), stated) is compiled(Ipopt(), replace(stated, data=np.ones(2)))


@pytest.mark.parametrize("solver", UNCONSTRAINED, ids=lambda s: type(s).__name__)
def test_a_solver_refuses_the_objective_that_it_would_ignore(solver):
    words = f"^{type(solver).__name__}: 1 objective, 0 allowed; use Ipopt$"
    with pytest.raises(PlumblineError, match=words):
        solver.solve(flat(rosenbrock), np.zeros(2))


def test_fatrop_refuses_the_rows_that_it_would_ignore():
    with pytest.raises(PlumblineError, match=r"^Fatrop: 30 rows, 0 allowed; use Ipopt$"):
        Fatrop().solve(linear(*random_system(0)), np.zeros(4))


@pytest.mark.parametrize("solver", [*SOLVERS, Fatrop()], ids=lambda s: type(s).__name__)
def test_every_solver_declares_what_it_takes(solver):
    for part in ("bounds", "constraints", "objective", "rows"):
        assert isinstance(getattr(type(solver), part), bool)


def test_an_objective_is_one_number():
    with pytest.raises(ValueError, match=r"objective: shape \(2, 1\), one number expected"):
        flat(lambda x: x)


# Constraints


def constrained(A, b, *, low, high, **given):
    """The linear problem with low <= sum x <= high."""
    problem = linear(A, b, **given)
    return replace(
        problem,
        constraints=cs.sum1(problem.x),
        g_lower=np.array([low]),
        g_upper=np.array([high]),
    )


def test_some_solvers_take_constraints_and_some_do_not():
    assert [type(s) for s in UNCONSTRAINED] == [LevenbergMarquardt, TrustRegion]
    assert {type(s) for s in ABLE} == {Ipopt, Slsqp, Sqp}


@pytest.mark.parametrize("solver", UNCONSTRAINED, ids=lambda s: type(s).__name__)
def test_a_solver_refuses_the_constraints_that_it_would_ignore(solver):
    problem = constrained(*random_system(0), low=1.0, high=1.0)
    with pytest.raises(PlumblineError) as error:
        solver.solve(problem, np.zeros(4))
    name = type(solver).__name__
    assert str(error.value) == f"{name}: 1 constraints, 0 allowed; use Ipopt"


@EACH_ABLE
def test_an_equality_is_kept_and_its_optimum_is_recognised(solver):
    A, b = random_system(1)
    problem = constrained(A, b, low=1.0, high=1.0)
    found = solver.solve(problem, np.zeros(4))
    kkt = np.block([[A.T @ A, np.ones((4, 1))], [np.ones((1, 4)), np.zeros((1, 1))]])
    expected = np.linalg.solve(kkt, np.append(A.T @ b, 1.0))[:4]
    np.testing.assert_allclose(found.x, expected, atol=1e-7)
    assert found.is_optimal()
    along = np.array([1.0, -1.0, 0.0, 0.0])
    assert not Solution(problem, found.x + 1e-2 * along).is_optimal()
    across = Solution(problem, found.x + 1e-2)
    assert across.primal_violation() == pytest.approx(0.04)
    assert not across.is_optimal()


@EACH_ABLE
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_inequality_pushes_one_way_only(solver, sign):
    """At the edge of the allowed half, the free optimum beyond it: optimal. Before it: not."""
    A, b = random_system(2)
    A, b = sign * A, b
    free = np.linalg.lstsq(A, b)[0].sum()
    binding = solver.solve(constrained(A, b, low=free + 0.5, high=np.inf), np.zeros(4))
    assert binding.is_optimal()
    assert binding.x.sum() == pytest.approx(free + 0.5, abs=1e-6)
    turned = constrained(A, b, low=-np.inf, high=free + 0.5)
    assert not Solution(turned, binding.x).is_optimal()
    slack = solver.solve(turned, np.zeros(4))
    assert slack.is_optimal()
    assert slack.x.sum() == pytest.approx(free, abs=1e-6)


@EACH_ABLE
def test_bounds_and_constraints_are_kept_together(solver):
    A, b = random_system(4)
    problem = constrained(A, b, low=0.25, high=0.25, lower=-0.1, upper=0.1)
    found = solver.solve(problem, np.zeros(4))
    assert found.is_optimal()
    assert found.at_bound()
    assert found.x.sum() == pytest.approx(0.25)


def test_a_curved_constraint_is_met_with_the_exact_hessian():
    """The nearest point of a circle: on the ray from its centre."""
    problem = linear(np.eye(2), np.array([3.0, 4.0]))
    circle = replace(
        problem,
        constraints=cs.sumsqr(problem.x),
        g_lower=np.array([-np.inf]),
        g_upper=np.array([1.0]),
    )
    for solver in ABLE:
        found = solver.solve(circle, np.array([0.1, 0.0]))
        np.testing.assert_allclose(found.x, [0.6, 0.8], atol=1e-6)
        assert found.is_optimal(1e-7)


# A solution's judgement


def test_no_perturbed_point_is_optimal(model):
    found = LevenbergMarquardt().solve(model.problem, model.start)
    std = found.std(NOISE)
    for k in range(model.problem.size):
        for sign in (-1, 1):
            x = found.x.copy()
            x[k] += sign * 0.1 * std[k]
            worse = Solution(model.problem, x)
            assert worse.cost > found.cost
            assert worse.stationarity() > 1e-6
            assert not worse.is_optimal()


def test_stationarity_is_the_drop_that_the_best_single_step_brings():
    A, b = random_system(8)
    x = np.array([0.3, -0.2, 0.1, 0.5])
    problem = linear(A, b)
    cost = np.sum((A @ x - b) ** 2) / 2
    drops = []
    for column in A.T:
        step = -column @ (A @ x - b) / (column @ column)
        drops.append(cost - np.sum((A @ x + step * column - b) ** 2) / 2)
    assert Solution(problem, x).stationarity() == pytest.approx(max(drops) / cost, rel=1e-12)


def test_a_bound_nearby_promises_only_what_lies_before_it():
    problem = linear(np.eye(2), np.array([5.0, 0.0]), lower=-1.0, upper=1.0)
    at = Solution(problem, np.array([1.0, 0.0]))
    almost = Solution(problem, np.array([1.0 - 1e-9, 0.0]))
    inside = Solution(problem, np.array([0.5, 0.0]))
    assert at.stationarity() == 0.0
    assert almost.is_optimal()
    assert almost.at_bound() == ("x0",)
    assert inside.stationarity() == pytest.approx((4.5**2 - 4.0**2) / 4.5**2)
    assert inside.at_bound() == ()


def test_pushing_off_a_bound_is_not_excused():
    problem = linear(np.eye(2), np.array([5.0, 0.0]), lower=-1.0, upper=1.0)
    assert not Solution(problem, np.array([-1.0, 0.0])).is_optimal()


def test_primal_violation_is_in_the_unknowns_own_units():
    problem = linear(*random_system(0), lower=-1.0, upper=1.0)
    assert Solution(problem, np.array([0.0, 1.5, -1.2, 0.0])).primal_violation() == 0.5
    assert Solution(problem, np.zeros(4)).primal_violation() == 0.0


def test_standard_errors_are_those_of_linear_regression():
    A, b = random_system(11)
    solution = Solution(linear(A, b), np.zeros(4))
    expected = 0.3 * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    np.testing.assert_allclose(solution.std(0.3), expected, rtol=1e-10)


def test_what_cannot_be_told_apart_has_no_standard_error():
    A, b = random_system(12)
    A[:, 2] = A[:, 0]
    std = Solution(linear(A, b), np.zeros(4)).std(1.0)
    assert np.isinf(std[[0, 2]]).all()
    assert np.isfinite(std[[1, 3]]).all()
    alone = np.linalg.inv(A[:, [0, 1, 3]].T @ A[:, [0, 1, 3]])
    np.testing.assert_allclose(std[[1, 3]], np.sqrt(np.diag(alone))[1:], rtol=1e-6)


@EACH
def test_an_unobservable_unknown_does_not_stop_a_solver(solver):
    A, b = random_system(13)
    A[:, 3] = 0.0
    found = solver.solve(linear(A, b, lower=-2.0, upper=2.0), np.full(4, 0.5))
    expected = np.linalg.lstsq(A[:, :3], b)[0]
    np.testing.assert_allclose(found.x[:3], expected, atol=1e-6)
    assert np.isfinite(found.x[3])


@EACH
def test_nothing_to_fit_is_left_where_it_is(solver):
    """All weights zero: every point is as good as any other."""
    A, b = random_system(14)
    found = solver.solve(linear(A, b, weights=np.zeros(30)), np.full(4, 0.5))
    np.testing.assert_allclose(found.x, 0.5, atol=1e-6)
    assert found.cost == 0.0
    assert found.is_optimal()


# Mapped functions


def dense(model, x):
    """Residuals (3 N,) and Jacobian (3 N, P), row by row without any mapping."""
    p = model.problem
    row = cs.Function("row", [p.x, p.row], [p.residual, cs.densify(cs.jacobian(p.residual, p.x))])
    parts = [row(x, values) for values in p.rows]
    return (np.vstack([v.full() for v in column]) for column in zip(*parts, strict=True))


def test_a_gram_is_that_of_the_dense_jacobian(model):
    x = model.start + 1e-3
    r, J = dense(model, x)
    gram = Mapped(model.problem).gram(x)
    np.testing.assert_allclose(gram.matrix, J.T @ J, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(gram.vector, (J.T @ r).ravel(), rtol=1e-10, atol=1e-12)
    assert gram.square == pytest.approx(float(np.sum(r**2)), rel=1e-12)
    assert gram.count == 180
    assert Mapped(model.problem).cost(x) == pytest.approx(gram.square / 2, rel=1e-12)


def test_grams_of_groups_add_up_and_come_apart(model):
    rng = np.random.default_rng(0)
    weights, groups = rng.uniform(0, 2, 60), rng.integers(0, 4, 60)
    mapped = Mapped(model.problem.on(model.problem.rows, weights))
    parts = mapped.grams(model.start, groups)
    whole = mapped.gram(model.start)
    total = sum(parts, start=Gram.empty(model.problem.size))
    assert len(parts) == 4
    for name in ("matrix", "vector", "square", "count"):
        np.testing.assert_allclose(
            getattr(total, name), getattr(whole, name), rtol=1e-10, atol=1e-12
        )
    without = whole - parts[2]
    kept = groups != 2
    alone = Mapped(model.problem.on(model.problem.rows[kept], weights[kept])).gram(model.start)
    np.testing.assert_allclose(without.matrix, alone.matrix, rtol=1e-9, atol=1e-12)
    assert without.square == pytest.approx(alone.square)
    assert without.count == pytest.approx(3 * weights[kept].sum())


@pytest.mark.parametrize("numbers", [1, 100, 1000, 2500])
def test_chunks_change_nothing(model, monkeypatch, numbers):
    x = model.start + 1e-3
    mapped = Mapped(model.problem)
    whole, residual = mapped.gram(x), mapped.residuals(x)
    monkeypatch.setattr(mapping, "CHUNK_NUMBERS", numbers)
    chunks = [part for part, _, _ in mapped.jacobians(x)]
    assert len(chunks) > 1
    assert np.array_equal(np.concatenate([np.arange(60)[c] for c in chunks]), np.arange(60))
    np.testing.assert_array_equal(mapped.residuals(x), residual)
    gram = mapped.gram(x)
    np.testing.assert_allclose(gram.matrix, whole.matrix, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(gram.vector, whole.vector, rtol=1e-11, atol=1e-13)
    found = LevenbergMarquardt().solve(model.problem, model.start)
    assert found.is_optimal()


def test_memory_is_bounded_by_the_chunk_and_not_by_the_rows(model, monkeypatch):
    rows = np.tile(model.problem.rows, (400, 1))[:20_000]
    many = model.problem.on(rows)
    monkeypatch.setattr(mapping, "CHUNK_NUMBERS", 100_000)
    sizes = [J.size for _, _, J in Mapped(many).jacobians(model.start)]
    assert len(sizes) > 5
    assert max(sizes) <= 100_000
    assert sum(sizes) == 20_000 * 3 * model.problem.size


@pytest.mark.parametrize("solver", ALL, ids=lambda s: type(s).__name__)
def test_twenty_thousand_rows_are_solved(model, solver):
    """Every posture 333 times: the same optimum, 333 times the cost."""
    rows = np.tile(model.problem.rows, (333, 1))
    found = solver.solve(model.problem.on(rows), model.start)
    few = LevenbergMarquardt().solve(model.problem, model.start)
    assert found.cost == pytest.approx(333 * few.cost, rel=1e-7)
    np.testing.assert_allclose(found.x, few.x, atol=1e-6)


def test_no_rows_at_all_cost_nothing(model):
    nobody = Mapped(model.problem.on(model.problem.rows[:0]))
    assert nobody.residuals(model.start).shape == (0, 3)
    assert nobody.cost(model.start) == 0.0
    np.testing.assert_array_equal(nobody.gram(model.start).matrix, 0.0)
