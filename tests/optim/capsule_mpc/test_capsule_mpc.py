"""The control problem: its statement, what may be left out of it, and the solvers that agree."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.mpc.passes import passes
from plumbline.optim import capsule_mpc
from plumbline.optim.capsule_mpc import (
    BandedQp,
    Confidence,
    EndsInstrument,
    LibraryQp,
    Mode,
    Noise,
    Nonlinear,
    Obstacle,
    OneStep,
    RealTime,
    Safety,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.linearised import Linearised, norms
from plumbline.optim.capsule_mpc.plane_program import nearest_charts
from plumbline.optim.capsule_mpc.planning import shifted
from tests.in_mm import Controller

LEFT, RIGHT = TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0))
OBSTACLES = (
    Obstacle.sphere((0.0, 12.0, -70.0), 5.0, (0.0, -4.0, 0.0)),
    Obstacle((-60.0, 40.0, -100.0), (60.0, 40.0, -120.0), 4.0),
)
START = np.array([-30.0, 0.0, -120.0, 35.0, 0.0, -115.0])
GOAL = np.array([40.0, 10.0, -110.0, -40.0, 5.0, -120.0])
PLAIN = RealTime(compiled=False)


def two(**settings):
    """Two instruments, a rod and a sphere."""
    return Statement((LEFT, RIGHT), 1, Settings(**{"p": 8, **settings}), 1)


def drive(statement, planner, steps, start=START, goal=GOAL, obstacles=OBSTACLES):
    """States (K + 1, n) and plans along a loop on the exact model."""
    ready, x = planner.ready(statement), np.array(start)
    path = np.tile(x, (statement.settings.p, 1))
    states, plans, move = [x], [], np.zeros(len(x))
    for _ in range(steps):
        plan = ready.plan(x, statement.stages(goal, obstacles, move), path)
        move, x, path = plan.x[0] - x, plan.x[0].copy(), shifted(plan.x)
        states.append(x)
        plans.append(plan)
    return np.array(states), plans


def programs(steps=30, **settings):
    """Quadratic programs along a loop."""
    statement = two(**settings)
    linearised, solver = Linearised(statement, compiler=False), BandedQp()
    x, path, move = START.copy(), np.tile(START, (statement.settings.p, 1)), np.zeros(6)
    for _ in range(steps):
        qp = linearised.about(path, x, statement.stages(GOAL, OBSTACLES, move))
        qp = replace(qp, **{k: getattr(qp, k).copy() for k in ("H", "g", "G", "h")})
        yield qp, path
        found = solver.solve(qp, path)
        move, x, path = found.x[0] - x, found.x[0].copy(), shifted(found.x)


def gap(statement, x):
    """Least distance less its D [mm], obstacles as they are one step ahead."""
    stage = statement.stages(GOAL[: statement.goals], OBSTACLES)[0]
    return float(statement.clearances(x, stage).full().min())


def test_the_tip_s_shaft_passes_through_its_trocar():
    x = cs.SX.sym("x", 3)
    c = cs.DM(LEFT.constants)
    axis = LEFT.capsules(x, c)[0].axis
    ends = cs.Function("ends", [x], [axis.ends])(START[:3]).full().reshape(2, 3)
    way = (ends[0] - ends[1]) / (1e3 * LEFT.length)
    assert np.linalg.norm(way) == pytest.approx(1.0)
    assert np.linalg.norm(np.cross(LEFT.constants - ends[0], way)) < 1e-9


def test_both_states_of_an_instrument_have_the_same_clearances():
    rng = np.random.default_rng(0)
    ends = (
        EndsInstrument(trocar=LEFT.trocar),
        EndsInstrument(trocar=RIGHT.trocar),
    )
    by_tips, by_ends = two(), Statement(ends, 1, Settings(p=8), 1)
    for _ in range(20):
        tips = START + rng.normal(0, 15, 6)
        places = 1e-3 * tips.reshape(2, 3)
        both = 1e3 * np.concatenate([e.state(t) for e, t in zip(ends, places, strict=True)])
        stages = [s.stages(GOAL, OBSTACLES)[0] for s in (by_tips, by_ends)]
        gaps = [
            s.clearances(x, stage).full()
            for s, x, stage in zip((by_tips, by_ends), (tips, both), stages, strict=True)
        ]
        assert np.abs(gaps[0] - gaps[1]).max() < 1e-6
        held = cs.Function("h", list(by_ends.symbols), [by_ends.held])(both, both, stages[1])
        assert np.abs(held.full()).max() < 1e-6


@pytest.mark.parametrize("body", [LEFT, EndsInstrument()])
def test_no_point_of_a_shaft_moves_farther_than_its_reach(body):
    x, c, within = (cs.SX.sym(name, size) for name, size in (("x", body.size), ("c", 3), ("w", 6)))
    ends = body.capsules(x, c)[0].axis.ends
    axes = cs.Function("a", [x, c], [ends])
    reach = cs.Function("r", [x, c, within], [body.reach(x, c, within[: body.size])[0]])
    rng = np.random.default_rng(7)
    tightest = np.inf
    for _ in range(400):
        start = rng.uniform(-60, 60, body.size) - np.tile([0.0, 0.0, 90.0], body.size // 3)
        move = rng.normal(size=body.size) * 10.0 ** rng.uniform(-1, 2)
        moved = (axes(start + move, LEFT.constants) - axes(start, LEFT.constants)).full()
        most = np.resize(norms(move, body.groups), 6)
        bound = float(reach(start, LEFT.constants, most))
        farthest = np.linalg.norm(moved.reshape(2, 3), axis=1).max()
        assert farthest <= bound + 1e-9
        tightest = min(tightest, bound - farthest)
    assert tightest < 1.0


def test_a_row_is_left_out_only_if_its_worst_case_satisfies_it():
    statement = two()
    linearised, within = Linearised(statement, compiler=False), np.cumsum(statement.step, axis=0)
    stages = statement.stages(GOAL, OBSTACLES)
    rng = np.random.default_rng(8)
    near = 0
    for _ in range(20):
        x0 = START * [0.2, 1, 1, 0.2, 1, 1] + rng.normal(0, 6, 6)
        path = x0 + rng.normal(0, 3, (8, 6))
        whole = stages.copy()
        whole[:, -6:] = 1e4
        rows = linearised.about(path, x0, whole)
        G, h = rows.G.copy(), rows.h.copy()
        left_out = linearised.about(path, x0, stages).h < -1e8
        worst = G @ x0 - (norms(G, (3, 3)) * within[:, None])[:, :, ::3].sum(axis=2)
        assert (worst >= h - 1e-9)[left_out & (h > -1e8)].all()
        assert (worst <= h + 1e-9)[~left_out].all()
        near += int((~left_out).sum())
    assert near > 20


def test_leaving_out_rows_changes_no_solution():
    statement = two()
    for qp, path in list(programs(12))[::3]:
        whole = Linearised(statement, compiler=False)
        within = statement.stages(GOAL, OBSTACLES)
        within[:, -6:] = 1e4  # a reach so far that every row stays
        kept = whole.about(path, qp.x0, within)
        assert (kept.h > -1e8).sum() > (qp.h > -1e8).sum()
        kept = replace(kept, h=kept.h.copy())
        stages = statement.stages(GOAL, OBSTACLES)
        solver = BandedQp(tolerance=1e-8)
        again = whole.about(path, qp.x0, stages)
        sparse = solver.solve(again, path).x
        dense = whole.about(path, qp.x0, within)
        assert np.abs(solver.solve(dense, path).x - sparse).max() < 1e-4


@pytest.mark.parametrize("plugin", ["piqp", "hpipm"])
@pytest.mark.parametrize("smooth", [0.0, 700.0])
def test_a_library_finds_the_same_path(plugin, smooth):
    for qp, path in list(programs(16, smooth=smooth))[::5]:
        qp = qp.upright  # a library is given limits state by state
        ours = BandedQp(tolerance=1e-6).solve(qp, path)
        theirs = LibraryQp(plugin).solve(qp, path)
        assert theirs.solved
        assert np.abs(ours.x - theirs.x).max() < 2e-2


@pytest.mark.parametrize("weights", [{}, {"effort": 0.0, "smooth": 0.0}, {"effort": 3.0}])
def test_the_solution_satisfies_the_conditions_of_optimality(weights):
    for qp, path in list(programs(24, **weights))[::6]:
        found = BandedQp(tolerance=1e-6).solve(qp, path)
        moves = np.diff(found.x, axis=0, prepend=qp.x0[None])
        turned = np.matvec(qp.turn, moves)
        assert (np.abs(turned) <= qp.step + 1e-7).all()
        present = qp.h > -1e8
        values = np.einsum("kmn,kn->km", qp.G, found.x) + found.slack - qp.h
        assert values[present].min(initial=1.0) > -1e-6
        assert np.abs((values * found.multiplier)[present]).max(initial=0.0) < 1e-3
        pull = np.einsum("kij,kj->ki", qp.H, found.x) + qp.g
        pull -= np.einsum("kmn,km->kn", qp.G, found.multiplier)
        pull[:-1] = np.cumsum(pull[::-1], axis=0)[::-1][:-1]
        turns = np.diff(moves, axis=0, prepend=qp.move[None])
        pull += 2 * qp.effort * moves - 2 * qp.smooth * np.diff(turns, axis=0, append=0.0)
        # The gradient that is left from there on is a speed limit's, and vanishes with its room.
        assert np.abs(np.matvec(qp.turn, pull) * (qp.step - np.abs(turned))).max() < 1e-4


def test_an_impossible_program_gives_slack_and_not_an_error():
    *_, (qp, path) = programs(24)
    squeezed = replace(qp, h=np.where(qp.h > -1e8, qp.h + 50.0, qp.h))
    for solver in (BandedQp(), LibraryQp("piqp")):
        found = solver.solve(squeezed, path)
        assert found.solved
        assert found.slack.max() > 1.0


def test_numbers_that_are_none_are_refused():
    (qp, path), *_ = programs(1)
    broken = replace(qp, g=qp.g * np.nan)
    assert not BandedQp().solve(broken, path).solved
    assert not LibraryQp("piqp").solve(broken, path).solved


@pytest.mark.parametrize("which", ["h", "G"])
def test_a_row_that_is_no_number_is_refused_and_not_left_out(which):
    *_, (qp, path) = programs(24)
    values = getattr(qp, which).copy()
    stage, row = np.argwhere(qp.present)[0]
    values[stage, row] = np.nan
    broken = replace(qp, **{which: values})
    for solver in (BandedQp(), LibraryQp("piqp")):
        assert not solver.solve(broken, path).solved


@pytest.mark.parametrize(
    "planner", [PLAIN, RealTime(LibraryQp("piqp"), compiled=False), Nonlinear(), OneStep()]
)
@pytest.mark.parametrize("body", [LEFT, EndsInstrument()])
def test_one_body_alone_goes_straight_to_its_goal(planner, body):
    statement = Statement((body,), 0, Settings(p=4, effort=0.0, smooth=0.0))
    x = START[:3] if body == LEFT else np.array([-30.0, 0.0, -120.0, -30.0, 0.0, 130.0])
    step = np.full(body.size, 1.2 / np.sqrt(3.0))
    stages, path = statement.stages(x + 40.0, [], step), x + np.outer(np.arange(1, 5), step)
    plan = planner.ready(statement).plan(x, stages, path)
    assert plan.solved
    assert plan.x[0] - x == pytest.approx(step, rel=0.03)


def test_a_sphere_on_the_axis_is_left_across_the_shaft():
    statement = Statement((TipInstrument((0.0, 0.0, 0.0)),), 0, Settings(p=8), 1)
    x, ball = np.array([0.0, 0.0, -100.0]), Obstacle.sphere((0.0, 0.0, -70.0), 5.0)
    ready, path, move = PLAIN.ready(statement), np.tile(x, (8, 1)), np.zeros(3)
    for _ in range(24):
        plan = ready.plan(x, statement.stages(x, [ball], move), path)
        move, x, path = plan.x[0] - x, plan.x[0].copy(), shifted(plan.x)
    assert float(statement.clearances(x, statement.stages(x, [ball])[0])) > -0.2


def test_a_smooth_command_starts_from_the_last_one():
    """With nothing to gain, the plan goes on as it was, and fades."""
    statement = Statement((LEFT,), 0, Settings(p=10, smooth=1e9, effort=0.0))
    ready, x = PLAIN.ready(statement), START[:3]
    move = np.array([0.3, -0.2, 0.1])
    plan = ready.plan(x, statement.stages(x, [], move), np.tile(x, (10, 1)))
    assert plan.x[0] - x == pytest.approx(move, rel=1e-3)


@pytest.mark.parametrize("p", [3, 5, 10, 20])
def test_defaults_overshoot_by_little_whatever_the_horizon(p):
    statement = Statement((LEFT,), 0, Settings(p=p))
    goal = START[:3] + np.array([20.0, 0.0, 0.0])
    states, _ = drive(statement, PLAIN, 60, START[:3], goal, ())
    assert states[-1, 0] == pytest.approx(START[0] + 20.0, abs=0.01)
    assert states[:, 0].max() < START[0] + 20.5


def test_smooth_commands_jump_less():
    jumps = []
    for weights in ({"effort": 0.0, "smooth": 0.0}, {}):
        states, _ = drive(two(**weights), PLAIN, 60)
        jumps.append(float(np.square(np.diff(states, n=2, axis=0, prepend=START[None])).sum()))
    assert jumps[1] < jumps[0] / 3


def test_a_chart_is_a_frame_on_the_nearest_points():
    statement = two()
    rng, charts = np.random.default_rng(5), nearest_charts(statement)
    stage = statement.stages(GOAL, OBSTACLES)[0]
    for _ in range(30):
        frames = charts(START + rng.normal(0, 20, 6), stage).full().reshape(-1, 3, 3)
        assert np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12


@pytest.mark.parametrize("plugin", ["ipopt", "fatrop"])
def test_what_is_left_out_at_first_is_kept_in_the_end(plugin):
    shallow = TipInstrument(LEFT.trocar, depths=(0.015, 0.126))
    statement = Statement((shallow,), 1, Settings(p=8), 1)
    goal = np.array([-50.0, 70.0, -180.0])
    states, _ = drive(statement, Nonlinear(plugin), 60, START[:3], goal)
    depth = np.linalg.norm(states - LEFT.constants, axis=1)
    assert depth.max() == pytest.approx(126.0, abs=5e-3)
    assert min(gap(statement, x) for x in states) > -0.15
    # The way is blocked by the rod and by the depth: the test would mean nothing elsewhere.
    assert gap(statement, states[-1]) < 0.5


def test_a_start_from_the_last_multipliers_takes_fewer_iterations():
    statement, x = two(), START.copy()
    ready, path = Nonlinear().ready(statement), np.tile(START, (8, 1))
    warm, cold, move = [], [], np.zeros(6)
    for _ in range(20):
        stages = statement.stages(GOAL, OBSTACLES, move)
        cold.append(Nonlinear().ready(statement).plan(x, stages, path).iterations)
        plan = ready.plan(x, stages, path)
        warm.append(plan.iterations)
        move, x, path = plan.x[0] - x, plan.x[0].copy(), shifted(plan.x)
    assert np.mean(warm[1:]) < 0.6 * np.mean(cold[1:])


@pytest.mark.parametrize("planner", [PLAIN, Nonlinear(), Nonlinear("fatrop"), OneStep()])
def test_no_planner_comes_nearer_than_the_distance(planner):
    statement = two()
    states, plans = drive(statement, planner, 45)
    solved = np.mean([plan.solved for plan in plans])
    assert solved > (0.9 if planner == Nonlinear("fatrop") else 0.99)
    assert min(gap(statement, x) for x in states) > -0.15
    assert np.abs(states[-1] - GOAL).max() < np.abs(START - GOAL).max() / 2


@pytest.fixture(scope="module")
def in_real_time():
    """The states (K + 1, n) of the program in real time."""
    return drive(two(), PLAIN, 60)[0]


@pytest.mark.parametrize("plugin", ["ipopt", "fatrop"])
def test_the_real_time_path_costs_what_the_reference_costs(plugin, in_real_time):
    states, _ = drive(two(), Nonlinear(plugin), 60)
    costs = [float(((x - GOAL) ** 2).sum()) for x in (in_real_time, states)]
    # The program in real time bounds speeds by a box and leaves accelerations to what carries the
    # command out.
    assert costs[0] == pytest.approx(costs[1], rel=2e-2)


@pytest.mark.parametrize("planner", [PLAIN, Nonlinear(), OneStep()])
def test_speeds_stay_within_the_confidence(planner):
    statement = two(confidence=Confidence(0.8, 0.05, 0.3))
    states, plans = drive(statement, planner, 8)
    assert norms(np.diff(states, axis=0), (3, 3)).max() <= 0.8 * 60.0 * 0.02 + 1e-6
    exact = isinstance(planner, Nonlinear)
    for plan in plans if planner != OneStep() else ():
        along = norms(np.diff(plan.x, axis=0), (3, 3))[1:]
        assert (along <= (1.0 if exact else 3**0.5) * statement.step[2:] + 1e-6).all()


def test_planes_pass_in_parallel_where_the_scalar_collides():
    planes = passes("planes", PLAIN, 3, 0)
    scalar = passes("scalar", PLAIN, 3, 0)
    assert 2.0 - 1e-3 < planes.between <= planes.at_steps < 2.25
    assert planes.short == 0.0
    assert planes.arrived == 1.0
    assert scalar.at_steps < 1.9
    assert scalar.short > 0.05


def test_tightening_is_the_quantile_of_the_stated_noise():
    noise = Noise(measured=0.0001, step=5e-05, epsilon=0.01, feedback=2)
    rng = np.random.default_rng(3)
    steps = rng.normal(0, 0.05, (2, 200_000, 2))
    drawn = rng.normal(0, 0.1, (2, 200_000)) + steps.sum(axis=2)
    difference = drawn[0] - drawn[1]
    assert (difference > noise.tightening(5)[1, 0]).mean() == pytest.approx(0.01, rel=0.1)
    assert (drawn[0] > noise.tightening(5)[4, 1]).mean() == pytest.approx(0.01, rel=0.1)


def test_a_confidence_made_of_noise_keeps_the_speed_below_its_limit():
    alpha = Confidence.of_noise(5.0, 60.0, 0.02).along(3)
    rate = alpha[0] * 60.0 + np.random.default_rng(0).normal(0, 5.0, 200_000)
    assert (rate > 60.0).mean() == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Settings(form="triangles"), "expected one of planes, scalar"),
        (lambda: Settings(p=0), "p: found 0, expected at least 1"),
        (lambda: Confidence(0.5, 0.0, 0.9), "found least 0.9, expected at most first, 0.5"),
        (lambda: Statement((), 0), "found 0 bodies"),
        (lambda: two().stages(GOAL, OBSTACLES * 3), "at most 1 capsules and 1 spheres"),
        (lambda: two().stages(GOAL[:3], []), "found shape \\(3,\\), expected \\(6,\\)"),
        (lambda: Noise(bias=-0.001), "bias: found -0.001, expected 0 to 0.1"),
        (lambda: Noise(epsilon=0.7), "epsilon: found 0.7, expected more than 0 and at most 0.5"),
        (lambda: Safety(delay=-1), "delay: found -1, expected at least 0"),
        (lambda: Settings(effort=float("nan")), "effort: found nan"),
        (
            lambda: Statement((TipInstrument((0, 0, 0), v_max=0.0),), 0),
            "v_max: found 0, expected more than 0",
        ),
        (lambda: Nonlinear("snopt").ready(two()), "'snopt' is not in this CasADi"),
    ],
)
def test_a_fault_is_told_with_the_way_out(make, words):
    with pytest.raises(PlumblineError, match=words):
        make()


def test_an_instrument_by_both_ends_moves_like_one_by_its_tip():
    ends = (EndsInstrument(trocar=LEFT.trocar), EndsInstrument(trocar=RIGHT.trocar))
    statement = Statement(ends, 1, Settings(p=8), 1)
    own = Controller(statement, PLAIN, Safety(budget=5.0))
    tips = 1e-3 * START.reshape(2, 3)
    x = 1e3 * np.concatenate([e.state(t) for e, t in zip(ends, tips, strict=True)])
    held = cs.Function("h", list(statement.symbols), [statement.held])
    for _ in range(60):
        command = own.step(x, GOAL, OBSTACLES)
        assert command.mode is Mode.PLAN
        x = x + 0.02 * command.rate
        stage = statement.stages(GOAL, OBSTACLES)[0]
        assert np.abs(held(x, x, stage).full()).max() < 1e-3
        assert command.gap > -0.2
    assert np.linalg.norm(x[[0, 1, 2, 6, 7, 8]] - GOAL) < np.linalg.norm(START - GOAL) / 2


def test_what_is_asked_and_answered_is_in_si_units():
    """Two upright shafts 80 mm apart that part at 60 mm/s once they are up to speed."""
    far = Statement((LEFT, RIGHT), 0, Settings(p=2))
    start = np.array([-0.04, 0.0, -0.1, 0.04, 0.0, -0.1])
    goal = start + np.array([-0.02, 0.0, 0.0, 0.02, 0.0, 0.0])
    own, x = capsule_mpc.Controller(far, PLAIN, Safety(budget=5.0)), start
    first = own.step(x, goal)
    assert first.gap == pytest.approx(0.08 - 2 * 0.0025 - 0.002, abs=1e-9)
    assert np.abs(first.path[0] - start).max() < 0.06 * 0.02
    rates = [first.rate]
    for _ in range(6):
        x = x + 0.02 * rates[-1]
        rates.append(own.step(x, goal).rate)
    assert np.abs(rates[-1]).max() == pytest.approx(0.06, abs=1e-3)
    offset = capsule_mpc.Plant(offset=0.001)
    shifted_by = capsule_mpc.Controller(far, PLAIN, Safety(budget=5.0, plant=offset))
    np.testing.assert_allclose(shifted_by.step(start, goal).rate, first.rate - 0.001, atol=1e-9)
    guide = capsule_mpc.Guide(far)
    found = guide.reference(start.reshape(2, 3), goal.reshape(2, 3), [])
    np.testing.assert_allclose(found, goal.reshape(2, 3), atol=1e-12)
