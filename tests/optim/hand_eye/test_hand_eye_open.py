"""Motions that leave the beam open: an open direction has infinite variance, and is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.optim.core.problem import Problem
from plumbline.optim.hand_eye.calibrate import calibrate
from plumbline.optim.hand_eye.constants import ONE_AXIS, ONE_TURN
from plumbline.optim.hand_eye.observability import turn_words
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.hand_eye.reweighting import marginal_covariance
from plumbline.optim.hand_eye.single_plane import slope
from tests.ranging_scenes import PAPER, facing, planned, seen_from, surveyed, turned

COUNT = 40


def turns_about(axis, rng, size=0.4):
    return rng.uniform(-size, size, (COUNT, 1)) * np.asarray(axis, dtype=float)


def readings_of_turns(seed, turns, noise=5e-5):
    scene, _ = planned(seed % 3)
    rng = np.random.default_rng([seed, 77])
    return scene, seen_from(scene, turned(facing(scene, rng), turns), rng, noise)


@pytest.mark.parametrize("seed", range(2))
def test_one_commanded_orientation_a_board_is_refused(seed):
    _, readings = readings_of_turns(seed, np.zeros((COUNT, 3)))
    words = "leave open r altogether .infinite standard error.*on each plane all orientations agree"
    with pytest.raises(PlumblineError, match=words) as caught:
        calibrate(readings)
    assert "turn it by 10 deg or more about two axes on every plane" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_finder_that_repeats_itself_is_refused_and_not_computed_with():
    """Ranges that are all one number have no slope, and what has none has no direction."""
    readings = surveyed(0)[2]
    stuck = replace(readings, distance=np.full(len(readings), 0.3))
    with pytest.raises(PlumblineError, match=r"the range stays at 0\.3 m while the flange moves"):
        slope(next(g for g in stuck.on_plane(1).motions() if g.is_translation))
    with pytest.raises(PlumblineError):
        calibrate(stuck)


@pytest.mark.parametrize(("seed", "turn"), [(0, 0.0), (1, 0.5)], ids=["none", "one axis"])
def test_an_open_beam_is_said_and_never_blamed_on_columns_or_quaternions(seed, turn):
    """Boards square to the beam, bowed a little: a start ends anywhere, with scatter of 5 cm."""
    rng = np.random.default_rng([seed, 5])
    way, rotations = np.array([0.05, -0.1, 0.99]), Rotation.random(3, random_state=rng)
    way /= np.linalg.norm(way)
    parts = []
    for k in range(3):
        board = rotations[k]
        to_board = Rotation.align_vectors(-board.apply([0.0, 0.0, 1.0])[None], way[None])[0]
        R = to_board * Rotation.from_rotvec(turn * rng.uniform(-1.0, 1.0, (60, 1)) * way)
        spots = board.apply(np.column_stack([0.12 * rng.normal(size=(60, 2)), np.zeros(60)]))
        stand = rng.uniform(0.1, 0.3, 60)
        t = spots - R.apply([0.03, -0.05, 0.08]) - stand[:, None] * R.apply(way)
        read = stand + 3e-4 * (board.inv().apply(spots)[:, 0] / 0.1) ** 2
        parts.append((R.as_matrix(), t, read, np.full(60, k)))
    readings = Readings.from_arrays(*(np.concatenate(one) for one in zip(*parts, strict=True)))
    with pytest.raises(PlumblineError, match=r"leave open r.*on each plane"):
        calibrate(readings)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0.6, 0.0, 0.8)])
def test_turning_about_one_axis_is_refused_and_the_axis_named(axis):
    rng = np.random.default_rng(1)
    _, readings = readings_of_turns(1, turns_about(axis, rng))
    named = ", ".join(f"{x:.2f}" for x in axis)
    with pytest.raises(PlumblineError, match=rf"turns about \({named}\) of its own frame alone"):
        calibrate(readings)


@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_no_noise_makes_an_open_direction_seen(noise):
    _, readings = readings_of_turns(2, np.zeros((COUNT, 3)), noise)
    with pytest.raises(PlumblineError, match="leave open r"):
        calibrate(readings)


def test_turns_of_a_tenth_of_a_degree_are_refused_or_honest():
    """What is left of them is answered with an error as large as it is."""
    ratios, rng = [], np.random.default_rng(0)
    for seed in range(10):
        turns = turns_about((0, 1, 0), rng) + rng.normal(0.0, 1.7e-3, (COUNT, 3))
        scene, readings = readings_of_turns(seed, turns)
        try:
            found = calibrate(readings)
        except PlumblineError:
            continue
        gap = found.beam.r - scene.finder.r
        ratios.append(gap @ np.linalg.solve(found.covariance[:3, :3], gap) / 3.0)
        assert found.std[:3].max() > 1e-3
    assert len(ratios) >= 3
    assert np.median(ratios) < 2.0


def test_rows_that_say_nothing_leave_an_unbounded_variance():
    """A column without rows, and one that a nuisance takes up whole."""
    rng = np.random.default_rng(0)
    J = rng.normal(size=(30, 8))
    J[:, 1] = 0.0
    J[:, 4] = J[:, 5:] @ [1.0, -2.0, 0.5]
    problem = Problem.__new__(Problem)
    object.__setattr__(problem, "scale", np.ones(8))
    std = np.sqrt(np.diag(marginal_covariance(problem, J, np.ones(30))))
    assert (std[[1, 4]] > 1e9).all()
    assert (std[[0, 2, 3]] < 1.0).all()


def test_a_marginal_covariance_is_the_whole_one_s_corner():
    rng = np.random.default_rng(1)
    J, w, scale = rng.normal(size=(40, 9)), rng.uniform(0.5, 2.0, 40), rng.uniform(0.1, 3.0, 9)
    problem = Problem.__new__(Problem)
    object.__setattr__(problem, "scale", scale)
    whole = np.linalg.inv((J * w[:, None]).T @ J)
    np.testing.assert_allclose(marginal_covariance(problem, J, w), whole[:5, :5], rtol=1e-9)


def test_words_on_turns_change_at_their_limits():
    rng = np.random.default_rng(2)
    even = np.sqrt(3.0) * rng.choice([-1.0, 1.0], (COUNT, 1))
    for size, found in ((0.9 * ONE_TURN, True), (1.1 * ONE_TURN, False)):
        turns = even / np.sqrt(3.0) * [[size, 0, 0]]
        turns[0] = 0.0
        _, readings = readings_of_turns(0, turns)
        assert ("all orientations agree" in turn_words(readings)) is found
    for share, found in ((0.8 * ONE_AXIS, True), (1.3 * ONE_AXIS, False)):
        turns = rng.choice([-1.0, 1.0], (COUNT, 2)) * [[0.4, 0.4 * share]]
        turns = np.column_stack([turns, np.zeros(COUNT)])
        turns[0] = 0.0
        _, readings = readings_of_turns(0, turns)
        assert ("alone" in turn_words(readings)) is found


def test_the_command_ends_with_one_line_and_2(tmp_path, capsys):
    _, readings = readings_of_turns(0, np.zeros((COUNT, 3)))
    write_poses(tmp_path, readings)
    assert run(["handeye", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "leave open r altogether" in err


def write_poses(folder, readings):
    from tests.ranging_scenes import pose_lines

    (folder / "samples.csv").write_text(pose_lines(readings), encoding="utf-8")
    text = f'observation = "plane_range"\nnoise_std = {PAPER.noise}\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")


def boards_met(seed, tilt, stand):
    """Boards square to each other, met at tilts up to one [rad] from stand-offs of a range [m]."""
    rng = np.random.default_rng([seed, 9])
    way, start = np.array([0.05, -0.1, 0.99]) / 0.9963, np.array([0.03, -0.02, 0.08])
    normals = np.repeat(np.eye(3), 20, axis=0)
    beam = Rotation.from_rotvec(tilt * rng.uniform(-1.0, 1.0, normals.shape)).apply(-normals)
    R = Rotation.concatenate([Rotation.align_vectors(b[None], way[None])[0] for b in beam])
    R = Rotation.from_rotvec(beam * rng.uniform(-3.0, 3.0, (60, 1))) * R
    spots = 0.1 * rng.normal(size=(60, 3)) * (1.0 - normals)
    d = rng.uniform(*stand, 60)
    t = spots - R.apply(start + d[:, None] * way)
    noise = 5e-5 * rng.normal(size=60)
    return Readings.from_arrays(R.as_matrix(), t, d + noise, np.repeat(np.arange(3), 20))


@pytest.mark.parametrize("seed", range(3))
def test_one_stand_off_is_told_by_its_span_and_other_ranges_are_asked_for(seed):
    with pytest.raises(PlumblineError, match=r"ranges span 0\.\d+ mm.*vary the stand-off"):
        calibrate(boards_met(seed, 0.7, (0.4, 0.4001)))
    unseen = calibrate(boards_met(seed, 0.7, (0.38, 0.42))).seen.unseen
    assert any("r across" in line and "ranges span 3" in line for line in unseen)


def test_boards_met_squarely_are_told_by_their_incidence_and_tilts_are_asked_for():
    unseen = calibrate(boards_met(0, 0.06, (0.1, 0.7))).seen.unseen
    assert any("r across" in line and "0 to 5 deg" in line for line in unseen)
    assert all("tilt the flange" in line for line in unseen if "across" in line)
