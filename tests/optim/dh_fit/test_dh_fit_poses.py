"""What poses can tell, in words and numbers, and which poses tell most."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.tip_readings import LOWER, UPPER, poses
from plumbline.kinematics.link_table import link_table
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import DHOptions, Status, fit_dh
from plumbline.optim.dh_fit.identify import Why, identify, noise_free
from plumbline.optim.dh_fit.local import Space
from plumbline.optim.dh_fit.poses import DesignCriterion, reachable
from plumbline.optim.dh_fit.statement import Pass, frame_unknowns, link_unknowns, tool_unknowns
from tests.dh_sessions import BH7, four, recording, session

SPACE = Space.about([0.33, 0.0, -0.03], [0.30, 0.40, 0.25])


def known_of(robot, q, *, frame=(), tool=(0.0, 0.0, 0.0), fit_tool=False, hayati=True):
    table, point = link_table(robot, robot.chain()), np.array(tool)
    unknowns = [*frame, *(tool_unknowns(point) if fit_tool else [])]
    unknowns += link_unknowns(table, 0.01, 0.09, hayati=hayati)
    return identify(table, point, unknowns, q), table, point, unknowns


def test_coinciding_axes_move_together_and_it_is_said():
    known, *_ = known_of(BH7, poses(40, np.random.default_rng(0)), hayati=False)
    said = {held.name: held for held in known.held}
    heights = {"joint 1 d", "joint 2 d", "joint 3 d", "joint 4 d"}
    kept = heights - set(said)
    assert len(kept) == 1
    for name in heights - kept:
        (partner,) = said[name].partners
        assert partner[0] == next(iter(kept))
        assert np.isclose(partner[1], -1.0, rtol=1e-9)
        assert said[name].words == f"{name} and {next(iter(kept))} move together"
    assert {"joint 1 theta", "joint 2 theta"} & set(said)


def test_what_the_needle_s_turn_does_is_nothing():
    known, *_ = known_of(BH7, poses(40, np.random.default_rng(0)))
    (held,) = (held for held in known.held if held.name == "tip alpha")
    assert held.why == Why.NO_EFFECT
    assert "no effect" in held.words


@pytest.mark.parametrize("name", ["bh7", "ur5", "kr300"])
@pytest.mark.parametrize("free", [(), tuple(frame_unknowns())], ids=["known", "free"])
def test_the_null_space_changes_no_reading_and_the_rest_is_of_full_rank(name, free):
    robot = Robot.bundled(name)
    chain, rng = robot.chain(), np.random.default_rng(1)
    q = rng.uniform(np.maximum(chain.lower, -2), np.minimum(chain.upper, 2), (40, chain.n))
    known, table, point, unknowns = known_of(
        robot, q, frame=free, tool=(0.02, 0.03, 0.1), fit_tool=bool(free)
    )
    stated, readings = noise_free(table, point, unknowns, q, None)
    J = np.concatenate([J for _, J in Pass(stated, readings).jacobians(stated.nominal)])
    J = J.reshape(-1, stated.size)
    assert known.rank + len(known.held) == stated.size
    place = {name: k for k, name in enumerate(stated.names)}
    for held in known.held:
        column, step = J[:, place[held.name]].copy(), stated.scale[place[held.name]]
        for name, moves in held.partners:
            column += moves * J[:, place[name]]
        assert np.abs(column * step).max() < 1e-9
    scaled = J * stated.scale
    assert known.rank == np.linalg.matrix_rank(scaled, tol=1e-9 * np.linalg.norm(scaled))
    kept = np.linalg.svd(scaled[:, known.kept], compute_uv=False)
    assert kept[-1] > 1e-6 * kept[0]


def test_free_frame_and_tool_are_kept_before_any_link():
    robot = Robot.bundled("ur5")
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (40, 6))
    known, *_ = known_of(robot, q, frame=frame_unknowns(), tool=(0, 0, 0.1), fit_tool=True)
    assert {u.name for u in known.free} >= {"frame x", "frame rz", "tool x", "tool z"}
    said = {held.name: held.words for held in known.held}
    assert said["joint 1 d"] == "joint 1 d and frame z move together"
    assert said["joint 6 d"] == "joint 6 d and tool z move together"


def test_a_joint_that_never_turns_hides_its_own_parameters():
    q = np.random.default_rng(0).uniform(LOWER, UPPER, (60, 5))
    free, *_ = known_of(BH7, q)
    q[:, 4] = 0.3
    stuck, *_ = known_of(BH7, q)
    assert stuck.rank < free.rank


def test_with_noise_what_is_too_weak_is_held_and_said_so():
    known, *_ = known_of(BH7, poses(30, np.random.default_rng(0)))
    assert known.weighed(1e-5).kept == known.kept
    dull = known.weighed(5e-2)
    assert len(dull.kept) < len(known.kept)
    weak = [held for held in dull.held if held.why == Why.WEAK]
    assert weak
    assert all("too little" in held.words for held in weak)


@pytest.mark.parametrize("parameters", ["identifiable", "all"])
def test_nothing_is_reported_for_what_cannot_be_told(parameters):
    simulated = session()
    options = DHOptions(frame="registration", parameters=parameters, hayati=False)
    fit = fit_dh(recording(simulated), options, registration=four(simulated))
    silent = [p for p in fit.parameters if p.status == Status.NOT_IDENTIFIABLE]
    assert {"joint 1 d", "joint 2 d", "tip alpha"} <= {p.name for p in silent}
    assert all(p.value is None and p.std is None and p.words for p in silent)
    told = {q.parts[0][0]: q for q in fit.quantities}
    for p in (p for p in fit.parameters if p not in silent):
        assert (p.value is None) == (p.status == Status.IN_A_SUM)
        assert told[p.name].alone == (p.status == Status.IDENTIFIED)


def test_chosen_poses_beat_random_ones_at_what_they_were_chosen_for():
    among = reachable(BH7, SPACE, noise=2e-4, candidates=150, targets=20)
    rng = np.random.default_rng(0)
    blind = [among.random(10, rng) for _ in range(20)]
    widest, safest = (among.best(10, c) for c in DesignCriterion)
    assert widest.log_determinant > max(d.log_determinant for d in blind)
    assert safest.worst < min(d.worst for d in blind)
    assert safest.worst <= widest.worst * (1 + 1e-9)
    tips = BH7.chain().placement(safest.q)[:, :3, 3]
    assert SPACE.holds(tips).all()
    assert len(np.unique(safest.q, axis=0)) == 10


def test_the_best_of_few_candidates_is_found():
    among = reachable(BH7, SPACE, noise=2e-4, candidates=8, targets=4)
    pairs = [(i, j) for i in range(8) for j in range(i)]
    best = max(among.design(pair).log_determinant for pair in pairs)
    assert among.best(2).log_determinant > best - 0.5


def test_with_readings_enough_errors_at_targets_are_as_large_as_the_noise_has_it():
    fine, coarse = (
        reachable(BH7, SPACE, noise=noise, candidates=150, targets=20).design(np.arange(150))
        for noise in (1e-4, 2e-4)
    )
    assert coarse.worst == pytest.approx(2.0 * fine.worst, rel=1e-3)
    assert coarse.mean == pytest.approx(2.0 * fine.mean, rel=1e-3)


def test_before_any_reading_a_link_is_anywhere_within_its_bounds():
    known = reachable(BH7, SPACE, noise=1.0, candidates=10, targets=2).covariance([])
    assert np.diag(known).min() == pytest.approx(np.var(np.linspace(-1.0, 1.0, 10001)), rel=1e-3)


def test_a_space_out_of_reach_is_refused():
    with pytest.raises(PlumblineError, match="0 poses of bh7"):
        reachable(BH7, Space.about([5, 0, 0], [0.1, 0.1, 0.1]), noise=1e-4, candidates=10)
    with pytest.raises(PlumblineError, match="noise"):
        reachable(BH7, SPACE, noise=0.0)
    with pytest.raises(PlumblineError, match="lower corners"):
        Space(np.ones(3), np.zeros(3))
    with pytest.raises(PlumblineError, match="can be chosen"):
        reachable(BH7, SPACE, noise=1e-4, candidates=5, targets=2).best(6)
