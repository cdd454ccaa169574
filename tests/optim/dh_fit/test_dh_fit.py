"""The bounded link fit: derivatives, invariances, one optimum for every solver, honest reports."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from scipy.optimize import minimize

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.tip_readings import Built, drawn_misfits, poses, rigid
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import (
    SOLVERS,
    DHOptions,
    Norms,
    Readings,
    Squares,
    Status,
    fit_dh,
    held_out,
)
from plumbline.optim.dh_fit.export import as_toml, as_urdf
from plumbline.optim.dh_fit.local import Space, local_and_global
from plumbline.optim.dh_fit.registration import Registered, spread_rows, steps_needed
from plumbline.optim.dh_fit.statement import Pass
from plumbline.optim.registration.fiducials import build_fiducials
from tests.dh_sessions import BH7, four, recording, session, simulated_recording, stated

PUBLISHED = DHOptions(frame="registration", parameters="all", hayati=False)
LOSSES = (Norms(), Squares())
EACH_LOSS = pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
EACH_FRAME = pytest.mark.parametrize("frame", ["registration", "joint"])


def perturbed(statement, rng, share=0.3):
    return statement.nominal + share * statement.delta.clip(max=0.05) * rng.normal(
        size=statement.size
    )


@EACH_LOSS
@EACH_FRAME
def test_gradient_and_matrix_agree_with_finite_differences(loss, frame):
    statement, readings = stated(session(), loss, frame=frame, hayati=True)
    rows, x = Pass(statement, readings), perturbed(statement, np.random.default_rng(0))
    sums, steps = rows.gram(x), 1e-6 * np.eye(statement.size)
    slope = [(rows.objective(x + h) - rows.objective(x - h)) / 2e-6 for h in steps]
    assert np.allclose(sums.vector, slope, rtol=0, atol=1e-6 * np.abs(slope).max())
    assert np.isclose(sums.square, 2.0 * rows.objective(x), rtol=1e-12)
    [(e, J)] = rows.jacobians(x)
    bends = [(loss.slopes(e + h) - loss.slopes(e - h)) / 2e-8 for h in 1e-8 * np.eye(3)]
    matrix = np.einsum("nip,jni,njq->pq", J, np.array(bends), J) / len(e)
    assert np.allclose(sums.matrix, matrix, rtol=0, atol=1e-5 * np.abs(matrix).max())


@EACH_LOSS
@EACH_FRAME
def test_half_the_square_of_the_residual_is_the_loss(loss, frame):
    statement, readings = stated(session(), loss, frame=frame)
    x = perturbed(statement, np.random.default_rng(1))
    problem = statement.problem(readings)
    residual = cs.Function("r", [problem.x, problem.row], [problem.residual])
    squares = [float(cs.sumsqr(residual(x, row))) / 2 for row in problem.rows]
    assert np.isclose(np.mean(squares), Pass(statement, readings).objective(x), rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_four_points_fix_the_least_squares_rigid_transform(seed):
    rng = np.random.default_rng(seed)
    camera = rng.normal(0.0, 0.2, (4, 3))
    R, t = rigid(rng.normal(size=(4, 3)), rng.normal(size=(4, 3)))
    robot = camera @ R.T + t + rng.normal(0.0, 1e-2, (4, 3))
    x = cs.SX.sym("x", 12)
    steps = steps_needed(robot, camera)
    found = Registered(cs.reshape(x, 3, 4), camera, steps, x)
    outputs = [found.value, found.slope, cs.jacobian(found.value, x)]
    results = cs.Function("g", [x], outputs)(robot.ravel())
    value, slope, traced = (part.full() for part in results)
    R_wanted, t_wanted = rigid(camera, robot)
    assert np.allclose(value[:9, 0].reshape(3, 3).T, R_wanted, rtol=0, atol=1e-12)
    assert np.allclose(value[9:, 0], t_wanted, rtol=0, atol=1e-12)
    assert np.allclose(slope, traced, rtol=0, atol=1e-9 * np.abs(traced).max())


def test_points_in_a_plane_or_mirrored_are_refused():
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
    readings = Readings(session().registration_q, flat)
    with pytest.raises(PlumblineError, match="fourth off their plane"):
        fit_dh(recording(session()), PUBLISHED, registration=readings)
    simulated = session()
    mirrored = Readings(simulated.registration_q, simulated.registration_tips * [1, 1, -1])
    with pytest.raises(PlumblineError, match="mirror image"):
        fit_dh(recording(simulated), PUBLISHED, registration=mirrored)
    with pytest.raises(PlumblineError, match="3 points not on a line"):
        spread_rows(np.pad(np.random.default_rng(0).normal(size=(30, 2)), ((0, 0), (0, 1))))


def identifiable(loss, frame):
    simulated = session(4)
    options = DHOptions(loss=loss, frame=frame)
    fit = fit_dh(recording(simulated), options, registration=four(simulated))
    return fit.statement, fit.readings


def published_at_its_bounds(loss, frame):
    return stated(session(3, tilts=False), loss, frame=frame, delta=(0.002, 0.006))


@pytest.mark.parametrize(
    ("problem", "loss", "frame"),
    [
        (identifiable, Norms(), "registration"),
        (identifiable, Squares(), "joint"),
        (published_at_its_bounds, Squares(), "registration"),
    ],
)
def test_every_solver_reaches_the_same_optimum(problem, loss, frame):
    statement, readings = problem(loss, frame)
    rows = Pass(statement, readings)
    found = {s.name: s.solve(statement.problem(readings), statement.nominal) for s in SOLVERS}
    values = {name: rows.objective(f.x) for name, f in found.items()}
    best = min(values.values())
    assert {name for name, value in values.items() if value > best * (1 + 1e-8)} == set()
    for f in found.values():
        assert (f.x >= statement.lower).all()
        assert (f.x <= statement.upper).all()
    if problem is published_at_its_bounds:
        x = found["gauss-newton"].x
        assert np.isclose(np.abs(x - statement.nominal), statement.delta, rtol=1e-6).any()


def test_slsqp_with_finite_differences_comes_no_lower():
    statement, readings = stated(session(3, tilts=False), Squares())
    rows, scale = Pass(statement, readings), statement.scale
    best = rows.objective(SOLVERS[0].solve(statement.problem(readings), statement.nominal).x)
    start, size = statement.nominal / scale, rows.objective(statement.nominal)
    box = list(zip(statement.lower / scale, statement.upper / scale, strict=True))
    options = {"maxiter": 1000, "ftol": 1e-12}
    found = minimize(
        lambda z: rows.objective(z * scale) / size, start, method="SLSQP", bounds=box,
        options=options,
    )  # fmt: skip
    assert best * (1 - 1e-9) < size * found.fun < 1.1 * best


def test_no_point_nearby_is_better():
    statement, readings = stated(session(5), Norms())
    rows = Pass(statement, readings)
    x = SOLVERS[0].solve(statement.problem(readings), statement.nominal).x
    best, rng = rows.objective(x), np.random.default_rng(0)
    for size in (1e-2, 1e-4, 1e-6):
        for _ in range(20):
            step = size * statement.delta * rng.normal(size=statement.size)
            near = np.clip(x + step, statement.lower, statement.upper)
            assert rows.objective(near) >= best * (1 - 1e-12)


@EACH_FRAME
def test_where_the_camera_stands_changes_nothing(frame):
    simulated, options = session(1), DHOptions(frame=frame)
    one = fit_dh(recording(simulated), options, registration=four(simulated))
    R, _ = rigid(*np.random.default_rng(4).normal(size=(2, 9, 3)))
    moved = replace(
        simulated,
        tips=simulated.tips @ R.T + [1.0, -2.0, 0.5],
        registration_tips=simulated.registration_tips @ R.T + [1.0, -2.0, 0.5],
    )
    two = fit_dh(recording(moved), options, registration=four(moved))
    assert np.isclose(one.objective, two.objective, rtol=1e-7)
    values = [[p.value or 0.0 for p in fit.parameters] for fit in (one, two)]
    assert np.allclose(*values, rtol=0, atol=1e-6)


def test_the_order_of_readings_changes_nothing():
    simulated = session(2)
    order = np.random.default_rng(0).permutation(len(simulated.q))
    one = fit_dh(recording(simulated))
    two = fit_dh(recording(replace(simulated, q=simulated.q[order], tips=simulated.tips[order])))
    assert np.isclose(one.objective, two.objective, rtol=1e-9)


def test_before_is_the_drawing_registered_on_the_four_points():
    simulated = session(6)
    fit = fit_dh(recording(simulated), PUBLISHED, registration=four(simulated))
    assert np.allclose(fit.nominal_misfits(), drawn_misfits(simulated), rtol=0, atol=1e-12)


def test_without_noise_the_arm_is_found_again():
    simulated = session(0, noise=0.0)
    fit = fit_dh(recording(simulated))
    q = poses(50, np.random.default_rng(0))
    camera = simulated.camera
    unseen = Readings(q, (simulated.built.tips(q) - camera.t) @ camera.R)
    assert fit.before.mean > 1e-3
    assert np.abs(fit.misfits(unseen)).max() < 1e-7


def test_standard_errors_hold():
    simulated = session(0, tilts=False, noise=1e-4)
    camera, rng, zs = simulated.camera, np.random.default_rng(0), []
    exact = (simulated.built.tips(simulated.q) - camera.t) @ camera.R
    for k in range(8):
        options = DHOptions(loss=LOSSES[k % 2], hayati=False)
        if k < 2:
            truth = fit_dh(recording(replace(simulated, tips=exact)), options)
        noisy = exact + rng.normal(0.0, camera.noise, exact.shape)
        fit = fit_dh(recording(replace(simulated, tips=noisy)), options)
        assert fit.statement.names == truth.statement.names
        links = [u.cell is not None for u in fit.statement.unknowns]
        zs.append(((fit.x - truth.x) / fit.std)[links])
    assert 0.8 < np.sqrt(np.mean(np.square(zs))) < 1.25


def test_a_parameter_at_its_bound_is_named_and_has_no_standard_error():
    simulated = session(4, noise=1e-5)
    fit = fit_dh(recording(simulated), DHOptions(delta_length=1e-4))
    resting = [p for p in fit.parameters if p.status == Status.AT_BOUND]
    assert resting
    assert fit.at_bound == tuple(p.name for p in resting)
    for parameter in resting:
        assert parameter.std is None
        side = "upper" if parameter.value > parameter.nominal else "lower"
        assert parameter.words == f"at its {side} bound"
        assert np.isclose(abs(parameter.value - parameter.nominal), 1e-4, rtol=1e-6)


def test_gross_errors_hurt_norms_less_than_squares():
    simulated = session(7)
    tips = simulated.tips.copy()
    tips[[3, 12, 20]] += [8e-3, -6e-3, 5e-3]
    spoilt = recording(replace(simulated, tips=tips))
    q, rng = poses(100, np.random.default_rng(1)), np.random.default_rng(2)
    unseen = Readings(q, simulated.visit(q, rng))
    norms, squares = (
        np.linalg.norm(fit_dh(spoilt, DHOptions(loss=loss)).misfits(unseen), axis=1).mean()
        for loss in LOSSES
    )
    assert norms < 0.6 * squares


def test_tilts_of_parallel_axes_reach_what_the_published_form_cannot():
    simulated = session(0, noise=2e-5)
    published = fit_dh(recording(simulated), PUBLISHED, registration=four(simulated))
    tilted = fit_dh(
        recording(simulated), DHOptions(frame="registration"), registration=four(simulated)
    )
    assert published.after.mean > 5e-4
    assert tilted.after.mean < 6e-5


@pytest.mark.parametrize("name", ["ur5", "kr300", "laparoscopic", "panda"])
def test_any_robot_is_fitted_exported_and_read_again(name):
    robot = Robot.from_urdf(PANDA) if name == "panda" else Robot.bundled(name)
    made = simulated_recording(robot, 80, np.random.default_rng(3))
    fit = fit_dh(made, DHOptions(delta_length=0.05, delta_angle=0.1))
    assert fit.before.rms > 1e-3
    assert fit.noise < 3e-5
    for exported in (as_urdf(fit), as_toml(fit)):
        assert exported.error < 1e-9
        assert exported.text


def test_rows_marked_as_held_out_are_not_fitted():
    simulated = session(8)
    spoilt, flags = simulated.tips.copy(), np.zeros(30, dtype=bool)
    flags[:3] = True
    spoilt[:3] += 1.0
    marked = fit_dh(recording(replace(simulated, tips=spoilt), held_out=flags))
    plain = fit_dh(recording(simulated).select(~flags))
    assert np.isclose(marked.objective, plain.objective, rtol=1e-12)


def test_a_row_left_out_does_not_move_its_own_prediction():
    simulated = session(9)
    fold = np.arange(30) % 3
    one = held_out(recording(simulated), None, fold)
    tips = simulated.tips.copy()
    tips[fold == 0] += [1e-3, 0.0, 0.0]
    two = held_out(recording(replace(simulated, tips=tips)), None, fold)
    R, other = (two.fitted - one.fitted)[fold == 0], (two.fitted - one.fitted)[fold == 1]
    assert np.allclose(np.linalg.norm(R, axis=1), 1e-3, rtol=1e-6)
    assert np.abs(other).max() > 1e-5


def test_a_local_fit_is_judged_inside_and_outside_of_its_space():
    simulated = session(10, readings=120, noise=5e-5)
    tips = Built.drawing().tips(simulated.q)
    space = Space.about(np.median(tips, axis=0), [0.2, 0.3, 0.2])
    found = local_and_global(recording(simulated), space, np.arange(120) % 4)
    assert np.array_equal(found.inside, space.holds(tips))
    nominal, local, everywhere = found.compared
    assert local.inside.rms < 0.2 * nominal.inside.rms
    assert local.outside.rms > local.inside.rms
    assert everywhere.outside.rms < local.outside.rms
    with pytest.raises(PlumblineError, match="tips in the space"):
        local_and_global(recording(simulated), Space.about([9, 9, 9], [1, 1, 1]), np.arange(120))


def test_faults_are_one_line_with_a_way_out():
    simulated = session()
    few = recording(simulated).select(np.arange(4))
    with pytest.raises(PlumblineError, match=r"4 readings for 12 parameters.*record more poses"):
        fit_dh(few)
    with pytest.raises(
        PlumblineError, match="frame: found 'no', expected one of joint, registration"
    ):
        DHOptions(frame="no")
    with pytest.raises(PlumblineError, match="delta_length"):
        DHOptions(delta_length=0.0)
    with pytest.raises(ValueError, match="smoothing"):
        Norms(0.0)
    encoders = replace(recording(simulated), observation="pose")
    with pytest.raises(PlumblineError, match="expected 'tip_position'"):
        fit_dh(encoders)
    with pytest.raises(PlumblineError, match="observation 'Fiducials', expected 'tip_position'"):
        fit_dh(build_fiducials(np.eye(3), np.eye(3)))


def test_the_bundled_arm_is_the_drawing_of_the_simulator():
    q = poses(20, np.random.default_rng(0))
    assert np.allclose(BH7.chain().placement(q)[:, :3, 3], Built.drawing().tips(q), atol=1e-12)


# A seven-joint arm in URDF: joints about z, turned by quarter turns, hand behind a fixed joint.
PANDA_JOINTS = (
    ("0 0 0.333", "0 0 0"), ("0 0 0", "-1.5708 0 0"), ("0 -0.316 0", "1.5708 0 0"),
    ("0.0825 0 0", "1.5708 0 0"), ("-0.0825 0.384 0", "-1.5708 0 0"), ("0 0 0", "1.5708 0 0"),
    ("0.088 0 0", "1.5708 0 0"),
)  # fmt: skip
PANDA = (
    '<robot name="panda"><link name="link0"/>'
    + "".join(
        f'<link name="arm{k}"/><joint name="j{k}" type="revolute">'
        f'<parent link="{"link0" if k == 1 else f"arm{k - 1}"}"/><child link="arm{k}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        '<limit lower="-2.8" upper="2.8" effort="1" velocity="1"/></joint>'
        for k, (xyz, rpy) in enumerate(PANDA_JOINTS, start=1)
    )
    + '<link name="hand"/><joint name="hand" type="fixed"><parent link="arm7"/>'
    '<child link="hand"/><origin xyz="0 0 0.107" rpy="0 0 -0.785"/></joint></robot>'
)
