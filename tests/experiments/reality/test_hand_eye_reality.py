"""The scene with the range finder keeps its own geometry, and what its plan promises."""

import numpy as np
import pinocchio as pin
import pytest

from plumbline.experiments.reality.arm import forward
from plumbline.experiments.reality.ranging.aim import inverse
from plumbline.experiments.reality.ranging.finder import Finder, draw_bumps, spoil
from plumbline.experiments.reality.ranging.phantoms import BLOCK, block, draw_head, hit, scan_head
from plumbline.experiments.reality.ranging.scene import (
    Instrument,
    draw_scene,
    joint_scatter,
    measure,
    patches,
    true_flange,
)
from plumbline.kinematics.robot import Robot
from tests.ranging_scenes import CLEAN, planned, room_of, surveyed


def test_the_arm_stands_where_pinocchio_says():
    scene, programme = planned()
    model = Robot.bundled("vs060").model
    data, frame = model.createData(), model.getFrameId("flange")
    mine = forward(scene.arm, programme.q[:20])[:, -1]
    for q, T in zip(programme.q[:20], mine, strict=True):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-12)


def test_every_posture_found_brings_the_flange_to_its_pose():
    scene, programme = planned()
    T = forward(scene.arm, programme.q[:30])[:, -1]
    q, good = inverse(scene.arm, T)
    for branch in range(8):
        reached = forward(scene.arm, q[:, branch])[:, -1]
        np.testing.assert_allclose(reached[good[:, branch]], T[good[:, branch]], atol=1e-9)
    wrapped = (programme.q[:30] - np.swapaxes(q, 0, 1) + np.pi) % (2 * np.pi) - np.pi
    assert (np.abs(wrapped).max(axis=2).min(axis=0) < 1e-7).all()


def test_a_clean_reading_ends_on_its_board():
    scene, survey, _ = surveyed(0, CLEAN)
    origins, beams = scene.finder.beams(forward(scene.arm, survey.q)[:, -1])
    ends = origins + survey.distance[:, None] * beams
    for k, board in enumerate(scene.boards, start=1):
        gaps = (ends[survey.plane == k] - board.centre) @ board.normal
        assert np.abs(gaps).max() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_the_plan_keeps_range_and_incidence_and_reaches_every_patch(seed):
    scene, programme = planned(seed)
    assert len(programme.q) == 180
    assert ((programme.q >= scene.arm.lower) & (programme.q <= scene.arm.upper)).all()
    origins, beams = scene.finder.beams(forward(scene.arm, programme.q)[:, -1])
    for k, board in enumerate(scene.boards, start=1):
        rows = programme.plane == k
        distance, normal, met = board.hit(origins[rows], beams[rows])
        assert met.all()
        assert scene.finder.reaches(distance).all()
        # The plan knows the drawing only; the real finder leans by up to 0.06 rad more.
        angle = np.arccos(-np.sum(normal * beams[rows], axis=1))
        assert angle.max() < scene.instrument.tilt + 0.065
        places = (origins[rows] + distance[:, None] * beams[rows] - board.centre) @ board.axes
        for motion in range(1, 5):
            found = places[programme.motion[rows] == motion, :2]
            gaps = np.linalg.norm(found[:, None] - patches()[None], axis=2)
            assert (np.argmin(gaps, axis=1) == np.arange(15)).all()
    still = programme.motion < 4
    for k in range(1, 4):
        for motion in range(1, 4):
            rows = still & (programme.plane == k) & (programme.motion == motion)
            R = forward(scene.arm, programme.q[rows])[:, -1, :3, :3]
            assert np.abs(R - R[0]).max() < 1e-9


def test_the_flange_scatters_as_its_maker_says():
    scene = room_of(0, Instrument(repeatability=2e-5))
    q = np.tile(planned()[1].q[:1], (20_000, 1))
    found = true_flange(scene, q, np.random.default_rng(0))[:, :3, 3]
    assert np.sqrt(found.var(axis=0).mean()) == pytest.approx(2e-5, rel=0.03)
    assert joint_scatter(forward(scene.arm, q[:1]), 0.0)[0] == 0.0


def test_slanted_beams_are_noisier_and_biased():
    finder = Finder(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    rng, many = np.random.default_rng(1), np.full(40_000, 0.5)
    straight = finder.read(many, np.ones(40_000), rng) - 0.5
    slanted = finder.read(many, np.full(40_000, np.cos(0.5)), rng) - 0.5
    assert straight.std() == pytest.approx(finder.noise, rel=0.03)
    wide = np.hypot(finder.noise, finder.grain * finder.spot * np.tan(0.5))
    assert slanted.std() == pytest.approx(wide, rel=0.03)
    assert slanted.mean() == pytest.approx(
        finder.skew * finder.spot * (1 / np.cos(0.5) - 1), rel=0.1
    )


def test_gross_readings_are_as_many_and_as_large_as_asked():
    readings, rows = spoil(np.full(200, 0.4), 0.1, np.random.default_rng(2))
    off = np.abs(readings - 0.4)
    assert len(rows) == 20
    assert (np.flatnonzero(off) == rows).all()
    assert (off[rows] >= 2e-3).all()
    assert (off[rows] <= 3e-2).all()


def test_a_board_departs_from_its_plane_as_asked():
    scene = draw_scene(np.random.default_rng(3), Instrument(flatness=4e-4))
    x, y = np.meshgrid(*2 * [np.linspace(-0.9, 0.9, 30)])
    places = np.column_stack([x.ravel(), y.ravel()]) * scene.boards[0].half
    for board in scene.boards:
        h = board.height(places)
        A = np.column_stack([places, np.ones(len(places))])
        left = h - A @ np.linalg.lstsq(A, h, rcond=None)[0]
        assert np.sqrt(np.mean(left**2)) == pytest.approx(4e-4, rel=0.1)
    assert draw_bumps(1e-3, np.random.default_rng(0)).shape == (len(scene.boards[0].bumps),)


def test_a_beam_that_misses_is_an_error():
    scene, programme = planned()
    with pytest.raises(ValueError, match="miss"):
        measure(scene, programme.q[:15], np.full(15, 2), np.random.default_rng(0))


def test_a_scan_of_the_head_lies_on_the_head():
    scene = room_of(0, CLEAN)
    rng = np.random.default_rng(4)
    head = draw_head(rng, points=2000)
    scan, _, _ = scan_head(scene, head, rng, count=60)
    assert len(scan.q) > 40
    origins, beams = scene.finder.beams(forward(scene.arm, scan.q)[:, -1])
    distance, cosine, met = hit(head, origins, beams)
    assert met.all()
    assert (cosine > np.cos(0.6)).all()
    np.testing.assert_allclose(scan.distance, distance, atol=1e-7)


def test_the_block_has_its_sizes():
    scene = room_of(0, CLEAN)
    scan = block(scene, np.random.default_rng(5), (9, 9))
    origins, beams = scene.finder.beams(forward(scene.arm, scan.q)[:, -1])
    ends = origins + scan.distance[:, None] * beams
    assert set(scan.part) == {0, 1, 2}
    spans = [np.sort(np.linalg.svd(ends[scan.part == k] - ends[scan.part == k].mean(0))[1])[::-1]
             for k in range(3)]  # fmt: skip
    assert all(s[2] < 1e-6 for s in spans)
    ratios = sorted(round(s[0] / s[1], 1) for s in spans)
    wanted = sorted(round(a / b, 1) for a, b in ((BLOCK[0], BLOCK[1]), (BLOCK[1], BLOCK[2]),
                                                (BLOCK[0], BLOCK[2])))  # fmt: skip
    np.testing.assert_allclose(ratios, wanted, atol=0.15)
