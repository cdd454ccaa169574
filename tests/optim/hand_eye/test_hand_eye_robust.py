"""Wrong boards, readings far too long, beams that look anywhere, poses in another order."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.optim.hand_eye import start
from plumbline.optim.hand_eye.calibrate import calibrate
from plumbline.optim.hand_eye.constants import SUSPECT
from plumbline.optim.hand_eye.readings import least_median_plane, principal_plane
from plumbline.optim.hand_eye.start import OTHER_WAYS
from tests.ranging_scenes import (
    PAPER,
    facing,
    pose_lines,
    room_of,
    seen_from,
    spoilt,
    surveyed,
    truth,
)

FAR_OFF = 5e-3  # m: what no answer may be off


@pytest.mark.parametrize(
    ("seed", "boards", "share"), [(0, True, 0.03), (2, True, 0.15), (1, False, 0.15)]
)
def test_gross_rows_do_not_move_the_answer(seed, boards, share):
    scene, _, readings = surveyed(seed)
    bad, rows = spoilt(readings, share, np.random.default_rng([seed, 9]), boards=boards)
    found = calibrate(bad)
    assert np.linalg.norm(found.beam.r - scene.finder.r) < 1.5e-3
    assert len(np.intersect1d(found.gross, rows)) == len(rows)


def test_few_readings_with_gross_ones_are_no_fit_that_meets_as_many_as_it_has_unknowns():
    """14 unknowns meet 14 of 24 readings, whatever the beam: their median error is nothing."""
    scene, answers = room_of(0, PAPER), 0
    for seed in range(4):
        rng = np.random.default_rng([seed, 24])
        turned = np.stack([facing(scene, rng, lean=0.4) for _ in range(8)], axis=1)
        readings = seen_from(scene, turned, rng)
        bad = np.isin(np.arange(24), rng.choice(24, 3, replace=False))
        try:
            found = calibrate(replace(readings, distance=readings.distance + 0.02 * bad))
        except PlumblineError:
            continue
        answers += 1
        away = found.beam.r - scene.finder.r
        # Of three numbers told by seven readings beyond the unknowns: F is 14 once in 400.
        assert away @ np.linalg.solve(found.covariance[:3, :3], away) < 3 * 14.0
    assert answers > 1


@pytest.mark.parametrize("seed", range(3))
def test_one_board_with_readings_too_far_is_right_or_refused(seed):
    scene, _, readings = surveyed(seed)
    bad, _ = spoilt(readings.on_plane(2), 0.2, np.random.default_rng(seed))
    try:
        found = calibrate(bad)
    except PlumblineError:
        return
    assert np.linalg.norm(found.beam.r - scene.finder.r) < FAR_OFF


@pytest.mark.parametrize("angle", [60.0, 100.0, 180.0])
def test_the_beam_may_look_anywhere_on_the_flange(angle):
    """The flange's frame is a name: turned, it turns r and v and nothing else."""
    scene, _, readings = surveyed(1)
    turn = Rotation.from_rotvec(np.deg2rad(angle) * np.array([0.6, 0.8, 0.0])).as_matrix()
    found = calibrate(replace(readings, R=readings.R @ turn.T))
    plain = calibrate(readings)
    np.testing.assert_allclose(turn.T @ found.beam.r, plain.beam.r, atol=1e-5)
    np.testing.assert_allclose(turn.T @ found.beam.v, plain.beam.v, atol=1e-5)
    assert turn.T @ found.beam.v @ truth(scene).v > 0.999
    own = turn.T @ found.covariance[:3, :3] @ turn
    np.testing.assert_allclose(own, plain.covariance[:3, :3], atol=0.1 * own.max())


@pytest.mark.parametrize("words", [w for w in OTHER_WAYS if w.startswith(("qu", "or", "po"))])
def test_poses_written_another_way_are_refused_and_the_way_is_named(words):
    _, _, readings = surveyed(0)
    # Every other way undoes itself, or is undone by its converse.
    other = OTHER_WAYS[words](readings)
    if words.startswith("quaternions"):
        numbers = Rotation.from_matrix(readings.R).as_quat(scalar_first=False)
        R = Rotation.from_quat(numbers, scalar_first=True).as_matrix()
        other = replace(readings, R=R)
    with pytest.raises(PlumblineError) as caught:
        calibrate(other)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def without(readings, row, *, pose):
    """The readings of which a pose or a range was lost: what comes after stands a row earlier."""
    rest, count = np.delete(np.arange(len(readings)), row), len(readings) - 1
    kept = readings.select(rest if pose else np.arange(count))
    return replace(kept, distance=readings.distance[:-1] if pose else readings.distance[rest])


@pytest.mark.parametrize(
    ("at", "pose", "words"),
    [
        (0.1, False, "ranges a row earlier"),
        (0.3, True, "ranges a row later"),
        (0.48, True, "the first half alone"),
    ],
)
def test_a_reading_that_one_file_lost_is_named(at, pose, words):
    _, _, readings = surveyed(0)
    spoilt = without(readings, int(at * len(readings)), pose=pose)
    with pytest.raises(PlumblineError, match=words) as caught:
        calibrate(spoilt)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("each", "tells"), [(6, False), (8, False), (20, True)])
def test_a_half_of_few_readings_tells_nothing_by_itself(each, tells):
    """Of two planes and a beam there are eleven unknowns: 9, 12 and 30 readings."""
    _, _, readings = surveyed(0)
    few = readings.select(
        np.concatenate([np.flatnonzero(readings.plane == k)[:each] for k in readings.planes])
    )
    half = OTHER_WAYS[next(w for w in OTHER_WAYS if w.startswith("the first half"))](few)
    assert (len(half) < len(few)) is tells


def test_another_way_is_looked_for_beyond_the_suspicious_scatter_alone(monkeypatch):

    asked = []
    monkeypatch.setattr(start, "robust_start", lambda r, **_: asked.append(r) or (None, 1.0, None))
    start.refuse_misread(surveyed(0)[2], 0.99 * SUSPECT)
    assert not asked
    start.refuse_misread(surveyed(0)[2], 1.01 * SUSPECT)
    assert len(asked) == len(OTHER_WAYS)


def test_the_command_notices_quaternions_turned_round(tmp_path, capsys):
    _, _, readings = surveyed(0)
    (tmp_path / "samples.csv").write_text(pose_lines(readings, scalar_first=False))
    text = f'observation = "plane_range"\nnoise_std = {PAPER.noise}\n'
    (tmp_path / "dataset.toml").write_text(text)
    assert run(["handeye", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert "write the scalar first" in err
    assert err.count("\n") == 1


def test_a_plane_of_least_median_has_no_ear_for_two_fifths():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (100, 2)), rng.normal(0, 1e-4, 100)])
    points[:40] += rng.uniform(0.05, 0.5, (40, 3))
    assert abs(least_median_plane(points).normal[2]) > 0.99999
    assert abs(principal_plane(points).normal[2]) < 0.99
