"""Scans from the command line: a block's angles, a head on its CT surface, what is refused."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.reality.ranging.phantoms import block, draw_head, scan_head
from plumbline.experiments.reality.ranging.writing import write_survey
from plumbline.experiments.reproduce.hand_eye_trials import chain
from plumbline.optim.hand_eye.accuracy import moved
from plumbline.optim.hand_eye.constants import SURFACE_POINTS
from plumbline.optim.hand_eye.scan import _Face, _own_variance
from plumbline.optim.hand_eye.scan_recording import beam_from_json, load_scan, sampled
from plumbline.optim.hand_eye.surface import Surface, judge, register_surface
from plumbline.optim.triangles import triangles_of
from tests.answer_contract import keeps_the_contract
from tests.ranging_scenes import CLEAN, room_of, surveyed, truth, write_block, write_head


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The JSON of a calibration."""
    place = tmp_path_factory.mktemp("calibrated")
    scene, survey, _ = surveyed(0)
    write_survey(place / "boards", scene, survey)
    out = place / "handeye.json"
    options = ["--next", "0", "--quiet", "--json", str(out)]
    assert run(["handeye", str(place / "boards"), *options]) == 0
    return out


@pytest.fixture
def block_folder(tmp_path):
    scene = room_of(0)
    return write_block(tmp_path / "block", scene, block(scene, np.random.default_rng(5)))


@pytest.fixture(scope="module")
def head_made():
    scene, rng = room_of(0), np.random.default_rng(8)
    head = draw_head(rng, points=8000)
    return scene, head, *scan_head(scene, head, rng, count=400)


@pytest.fixture
def head_folder(head_made, tmp_path):
    scene, head, scan, here, there = head_made
    return write_head(tmp_path / "head", scene, scan, head, (here, there))


def answered(folder, beam, *more):
    out = folder.parent / "out.json"
    assert run(["scan", str(folder), "--beam", str(beam), "--json", str(out), *more]) == 0
    return json.loads(out.read_text())


def test_a_block_has_its_angles_within_the_paper_s(block_folder, calibrated):
    found = answered(block_folder, calibrated)["angles"]
    assert [a["faces"] for a in found] == [["1", "2"], ["1", "3"], ["2", "3"]]
    for angle in found:
        assert abs(angle["value"] - 90.0) < 0.4
        assert abs(angle["value"] - 90.0) < 4.0 * angle["std"]
        assert 0.0 < angle["std"] < 0.4


def test_a_head_is_laid_on_its_ct_surface(head_folder, head_made, calibrated):
    _, head, *_ = head_made
    found = answered(head_folder, calibrated)["surface"]
    assert found["distance"] < 0.5e-3
    wanted = head.targets @ np.linalg.inv(head.T_ct)[:3, :3].T + np.linalg.inv(head.T_ct)[:3, 3]
    wanted = wanted @ head.T[:3, :3].T + head.T[:3, 3]
    gaps = np.array([t["base"] for t in found["targets"]]) - wanted
    stds = np.array([t["std"] for t in found["targets"]])
    assert len(stds) == 13
    assert np.linalg.norm(gaps, axis=1).max() < 2e-3
    assert (np.linalg.norm(gaps, axis=1) < 3.0 * stds).all()


def test_words_and_report_say_the_same(block_folder, calibrated, tmp_path, capsys):
    page = tmp_path / "report.html"
    assert run(["scan", str(block_folder), "--beam", str(calibrated), "--report", str(page)]) == 0
    out = capsys.readouterr().out
    assert "Angles between faces" in out
    figures = re.findall(r"\d\.\d+ mm", out.split("left over of the faces")[1])
    assert len(figures) == 3
    assert all(figure in page.read_text() for figure in figures)
    assert "<svg" in page.read_text()
    assert "http" not in page.read_text().replace("http://www.w3.org", "")


def test_stated_errors_of_angles_are_those_of_repeated_draws():
    rng = np.random.default_rng(0)
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    places = np.column_stack([rng.uniform(-0.04, 0.04, (25, 2)), np.zeros(25)])
    found, stated = [], []
    for _ in range(400):
        faces = [
            _Face.of((places + [[0, 0, 1]] * rng.normal(0, 1e-4, (25, 1))) @ R)
            for R in (np.eye(3), turn)
        ]
        found.append(np.arcsin(faces[0].normal @ faces[1].normal * np.sign(faces[0].normal[2])
                               * np.sign(faces[1].normal[1])))  # fmt: skip
        stated.append(_own_variance(*faces))
    assert np.std(found) == pytest.approx(np.sqrt(np.mean(stated)), rel=0.12)


def test_the_beam_s_error_is_part_of_an_angle_s(block_folder, calibrated, tmp_path):
    content = json.loads(calibrated.read_text())
    worse = tmp_path / "worse.json"
    content["covariance"] = (400.0 * np.array(content["covariance"])).tolist()
    worse.write_text(json.dumps(content))
    near, far = (answered(block_folder, beam)["angles"] for beam in (calibrated, worse))
    assert all(b["std"] > 1.5 * a["std"] for a, b in zip(near, far, strict=True))


def test_the_beam_may_stand_in_the_settings(block_folder, calibrated):
    scene = room_of(0)
    beam = f"[beam]\nr = {scene.finder.r.tolist()}\nv = {scene.finder.v.tolist()}\n"
    path = block_folder / "dataset.toml"
    path.write_text(path.read_text() + "\n" + beam)
    out = block_folder.parent / "own.json"
    assert run(["scan", str(block_folder), "--json", str(out), "--quiet"]) == 0
    angles = [a["value"] for a in json.loads(out.read_text())["angles"]]
    np.testing.assert_allclose(angles, 90.0, atol=0.3)


def test_a_flat_surface_fixes_nothing_and_is_refused(head_made, tmp_path, calibrated, capsys):
    """A scan of a board, laid on that board: it may slide and spin."""
    scene, survey, _ = surveyed(0, CLEAN)
    rows = survey.plane == 1
    from plumbline.experiments.reality.ranging.phantoms import Scan

    scan = Scan(survey.q[rows], survey.distance[rows], np.zeros(int(rows.sum()), dtype=np.int64))
    folder = write_block(tmp_path / "flat", scene, scan)
    text = (folder / "samples.csv").read_text().replace(",face\n", ",patch\n", 1)
    (folder / "samples.csv").write_text(text)
    spots = np.random.default_rng(0).uniform(-0.15, 0.15, (4000, 2))
    points = scene.boards[0].at(spots)
    lines = ["x,y,z", *(",".join(f"{x:.6f}" for x in p) for p in points)]
    (folder / "surface.csv").write_text("\n".join(lines) + "\n")
    assert run(["scan", str(folder), "--beam", str(calibrated)]) == 2
    err = capsys.readouterr().err
    assert "leaves the scan open: its normals show nothing of" in err
    assert err.count("a slide along") == 2
    assert err.count("a turn about") == 1
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: (f / "samples.csv").write_text("range\n0.3\n"), "no flange pose"),
        (lambda f: _replaced(f, "dataset.toml", "surface_scan", "plane_range"), "run: plumbline"),
        (lambda f: _replaced(f, "samples.csv", ",face\n", ",side\n"), "neither faces"),
        (lambda f: (f / "surface.csv").write_text("x,y,z\n1,2,3\n"), "1 points, expected 100"),
        (lambda f: (f / "surface.stl").write_bytes(b"solid nothing"), "give an STL"),
        (lambda f: (f / "surface.stl").write_bytes(stl(1e3)), "surface_unit"),
        (lambda f: (f / "landmarks.csv").write_text("a,b\n1,2\n"), "column 'base_x'"),
    ],
)  # fmt: skip
def test_what_is_no_scan_is_named_in_one_line(block_folder, change, words):
    change(block_folder)
    with pytest.raises(PlumblineError) as caught:
        load_scan(block_folder)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def _replaced(folder, file, old, new):
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))


def stl(size):
    """A tetrahedron as a binary STL."""
    corners = size * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = [corners[[0, 2, 1]], corners[[0, 1, 3]], corners[[0, 3, 2]], corners[[1, 2, 3]]]
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    data = np.zeros(4, kind)
    data["corners"] = faces
    return bytes(80) + (4).to_bytes(4, "little") + data.tobytes()


def corners_of(path, data):
    path.write_bytes(data)
    corners, faces = triangles_of(path, 10_000)
    return corners[faces]


def test_a_binary_stl_and_a_text_one_are_the_same_surface(tmp_path):
    binary = corners_of(tmp_path / "binary.stl", stl(0.1))
    facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
    facets = ["".join(f"vertex {a} {b} {c}\n" for a, b, c in three) for three in binary]
    text = f"solid x\n{''.join(map(facet.format, facets))}endsolid x\n"
    np.testing.assert_allclose(corners_of(tmp_path / "text.stl", text.encode()), binary)
    points = sampled(binary)
    assert len(points) == SURFACE_POINTS
    # Even over the area: the slanted face is sqrt(3) / (3 + sqrt(3)) of it.
    slanted = np.abs(points.sum(axis=1) - 0.1) < 1e-6
    assert slanted.mean() == pytest.approx(np.sqrt(3) / (3 + np.sqrt(3)), abs=0.01)


def test_without_a_beam_the_way_to_one_is_said(block_folder, capsys):
    assert run(["scan", str(block_folder)]) == 2
    assert "run: plumbline handeye" in capsys.readouterr().err


def test_a_file_that_is_no_calibration_is_named(block_folder, tmp_path, capsys):
    (tmp_path / "x.json").write_text("{}")
    assert run(["scan", str(block_folder), "--beam", str(tmp_path / "x.json")]) == 2
    assert "found no calibration" in capsys.readouterr().err


def test_check_knows_the_kind(block_folder, capsys):
    assert run(["check", str(block_folder)]) == 0
    assert "plumbline scan" in capsys.readouterr().out


def test_a_gross_reading_of_a_face_is_left_out(block_folder, calibrated):
    before = answered(block_folder, calibrated)
    path = block_folder / "samples.csv"
    head, *rows = path.read_text().strip().split("\n")
    k = head.split(",").index("range")
    cells = rows[3].split(",")
    cells[k] = str(float(cells[k]) + 0.02)
    rows[3] = ",".join(cells)
    path.write_text("\n".join([head, *rows]) + "\n")
    after = answered(block_folder, calibrated)
    assert [face["left_out"] for face in after["faces"]] == [1, 0, 0]
    assert [face["left_out"] for face in before["faces"]] == [0, 0, 0]
    for one, two in zip(before["angles"], after["angles"], strict=True):
        assert abs(one["value"] - two["value"]) < 0.15


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "absent", "binary", "nested", "list"])
def test_a_beam_is_read_from_a_regular_file_or_refused_in_one_line(kind, tmp_path):
    path = Path("/dev/zero") if kind == "device" else tmp_path / "beam.json"
    contents = {"binary": b"\xff\x00" * 99, "nested": b"[" * 200_000, "list": b"[1, 2]"}
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind in contents:
        path.write_bytes(contents[kind])
    with pytest.raises(PlumblineError, match="found no calibration") as caught:
        beam_from_json(path)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("made", ["block_folder", "head_folder"])
def test_an_answer_keeps_the_contract(made, calibrated, tmp_path, request):
    folder = request.getfixturevalue(made)
    given = plumbline.ScanOptions(*beam_from_json(calibrated))
    found = plumbline.scan(folder, given)
    assert found.judged.converged
    assert len(found.judged.fits) == (made == "head_folder")
    keeps_the_contract(found, tmp_path)
    assert plumbline.load(tmp_path / "answer.json").recording.sha256 == found.recording.sha256


def test_a_scan_that_is_moved_off_its_surface_is_judged_so(head_folder, calibrated):
    recording = load_scan(head_folder)
    beam, _ = beam_from_json(calibrated)
    points = beam.points(recording.R, recording.t, recording.distance)
    fit = register_surface(points, recording.surface, recording.landmarks)
    placed = moved(fit.T, points)
    surface = Surface.of(recording.surface)
    assert fit.judged == judge(placed, surface)
    assert fit.judged.converged
    assert fit.judged.stationarity < 1e-3
    assert not judge(placed + np.array([0.0, 0.0, 1e-4]), surface).converged


@pytest.mark.parametrize("seed", range(3))
def test_a_curved_surface_draws_no_target_aside(seed):
    """Planes through single points put the targets of such heads 0.3 to 1.9 mm off."""
    rng = np.random.default_rng(100 + seed)
    scene, head = surveyed(seed, CLEAN)[0], draw_head(rng, points=8000)
    scan, here, there = scan_head(scene, head, rng, count=400)
    T = chain().placement(scan.q)
    points = truth(scene).points(T[:, :3, :3], T[:, :3, 3], scan.distance)
    fit = register_surface(points, head.surface, (here, there))
    wanted = moved(head.T @ np.linalg.inv(head.T_ct), head.targets)
    gaps = np.linalg.norm(moved(np.linalg.inv(fit.T), head.targets) - wanted, axis=1)
    assert gaps.mean() < 0.15e-3
    assert fit.judged.stationarity < 1e-4


def test_a_beam_is_a_calibration_s_a_plain_one_or_the_recording_s(block_folder, tmp_path):
    room, survey, _ = surveyed(0)
    answer = plumbline.hand_eye(
        write_survey(tmp_path / "boards", room, survey), plumbline.HandEyeOptions(poses=0)
    )
    by_answer = plumbline.scan(block_folder, plumbline.ScanOptions(answer))
    exact = plumbline.scan(block_folder, plumbline.ScanOptions(answer.calibration.beam))
    assert [a.angle for a in exact.angles] == [a.angle for a in by_answer.angles]
    assert all(e.std < a.std for e, a in zip(exact.angles, by_answer.angles, strict=True))
    with pytest.raises(PlumblineError, match="no beam"):
        plumbline.scan(block_folder)
