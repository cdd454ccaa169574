"""``plumbline register`` takes what 3D Slicer writes, and a comparison never refuses the whole."""

import json

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.slicer import points_table, read_tfm, tfm_text
from plumbline.optim.registration import METHODS
from plumbline.optim.registration.fiducials import Fiducials, Points
from tests.phantoms import (
    ALIKE,
    CT,
    LABELS,
    LESION,
    T_RC,
    mapped,
    readings,
    registered,
    save_fiducials,
)
from tests.refusals import refused
from tests.slicer_files import write_points

NOTHING = Points((), np.empty((0, 3)), np.empty((0, 3)))
FLIP = np.diag([-1.0, -1.0, 1.0])


def told(capsys, *arguments):
    """The JSON of ``plumbline register``."""
    code = run(["register", *map(str, arguments), "--json", "-"])
    out, err = capsys.readouterr()
    assert code == 0, err
    return json.loads(out)


def folder_of(place, ct, robot, **given):
    """A recording of markers alone."""
    labels = tuple(f"M{k}" for k in range(len(ct)))
    return save_fiducials(Fiducials("bench", Points(labels, ct, robot), NOTHING, **given), place)


@pytest.fixture(params=[".mrk.json", ".fcsv"])
def lists(tmp_path, request):
    """Points in CT, a target among them, and by the robot."""
    ct, robot = readings(range(5), ALIKE)
    both = points_table([*LABELS, "M"], np.vstack([ct, LESION]))
    return (
        write_points(tmp_path / f"ct{request.param}", both),
        write_points(tmp_path / f"robot{request.param}", points_table(LABELS[::-1], robot[::-1])),
    )


def test_two_lists_of_slicer_are_registered_by_their_labels(lists, capsys):
    found = told(capsys, *lists)
    assert np.allclose(found["T_RC"], T_RC, atol=0.02)
    assert [t["label"] for t in found["targets"]] == ["M"]
    assert found["noise"]["stated"] is False
    assert any("--robot-axes RAS" in note for note in found["notes"])


def test_noise_may_be_stated_beside_slicer_s_lists(lists, capsys):
    options = ("--ct-resolution", "0.005,0.001,0.001", "--robot-std", "0.0003")
    found = told(capsys, *lists, *options)
    assert found["noise"]["stated"] is True
    assert found["targets"][0]["semi_axes95"][0] > 2.7 * 5e-3 / np.sqrt(12)
    for text, words in (("5,1,1", "looks like mm"), ("a", "one length in m"), ("-1", "one length")):
        assert words in refused(capsys, "register", *lists, "--ct-resolution", text)
    assert "needs --ct-resolution" in refused(capsys, "register", *lists, "--robot-std", "0.001")


def test_either_axes_give_the_same_motion(lists, capsys, tmp_path):
    lps = told(capsys, *lists, "--tfm", tmp_path / "a.tfm")
    for ct, robot in (("RAS", "RAS"), ("LPS", "RAS"), ("RAS", "LPS")):
        axes = ("--ct-axes", ct, "--robot-axes", robot)
        found = told(capsys, *lists, *axes, "--tfm", tmp_path / "b.tfm", "--overwrite")
        R = np.array(found["T_RC"])[:3, :3]
        R = FLIP @ R if robot == "RAS" else R
        R = R @ FLIP if ct == "RAS" else R
        assert np.allclose(R, np.array(lps["T_RC"])[:3, :3], atol=1e-8)
        one, two = (read_tfm(tmp_path / f"{k}.tfm") for k in "ab")
        assert np.allclose(one, two, atol=1e-9)


def test_a_transform_found_elsewhere_is_judged_in_either_direction(lists, capsys, tmp_path):
    near = T_RC.copy()
    near[2, 3] += 5e-5
    for name, T in (("there", near), ("back", np.linalg.inv(near))):
        path = tmp_path / f"{name}.tfm"
        path.write_text(tfm_text(T))
        (line,) = told(capsys, *lists, path)["transforms"]
        assert line["inverted"] is (name == "back")
        assert line["fre"] < 2e-3
        assert line["apart"]["M"] < 2e-3
        assert line["within95"]["M"] is True
    assert run(["register", *map(str, lists), str(path)]) == 0
    assert "the file maps robot to CT" in capsys.readouterr().out


def test_a_recording_takes_more_targets_from_a_list(capsys, tmp_path):
    folder = folder_of(tmp_path / "bench", *readings(range(5), ALIKE), noise=ALIKE)
    extra = write_points(tmp_path / "more.mrk.json", points_table(["M"], LESION))
    (target,) = told(capsys, folder, extra)["targets"]
    assert np.allclose(target["robot"], mapped(LESION), atol=5e-3)
    again = write_points(tmp_path / "again.fcsv", points_table(["M0"], LESION))
    assert "point M0: found that label again" in refused(capsys, "register", folder, again)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["ct.mrk.json"], "or two lists of points"),
        (["ct.mrk.json", "ct.mrk.json", "ct.mrk.json"], "or two lists of points"),
        (["a.tfm"], "or two lists of points"),
        (["ct.mrk.json", "none.mrk.json"], "mend the path"),
        (["ct.mrk.json", "twice.fcsv"], "'A' twice"),
        (["ct.mrk.json", "stray.fcsv"], "no such label in CT"),
        (["ct.mrk.json", "two.fcsv"], "at least 3"),
        (["ct.mrk.json", "good.fcsv", "T.h5"], "T.h5: found"),
        (["ct.mrk.json", "good.fcsv", "bad.tfm"], "bad.tfm"),
        (["no-such-folder"], "no such folder"),
    ],
)
def test_files_that_make_no_registration_are_one_line(names, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_points(tmp_path / "ct.mrk.json", points_table(LABELS, CT))
    write_points(tmp_path / "good.fcsv", points_table(LABELS, mapped(CT)))
    write_points(tmp_path / "twice.fcsv", points_table(["A", "A", "B", "C"], CT[:4]))
    write_points(tmp_path / "stray.fcsv", points_table(["X", "A", "B", "C"], CT[:4]))
    write_points(tmp_path / "two.fcsv", points_table(["A", "B"], CT[:2]))
    (tmp_path / "T.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "bad.tfm").write_text("nothing")
    (tmp_path / "a.tfm").write_text(tfm_text(T_RC))
    assert words in refused(capsys, "register", *names)


def test_a_method_that_finds_nothing_is_a_line_and_no_refusal(tmp_path, capsys):
    # The first three markers, which the three-point frame rests on, are on one line.
    ct = np.vstack([CT[0], (CT[0] + CT[1]) / 2, CT[1:]])
    folder = folder_of(tmp_path / "bench", ct, mapped(ct), noise=ALIKE)
    found = told(capsys, folder)
    assert {line["method"] for line in found["methods"]} == set(METHODS)
    (line,) = [line for line in found["methods"] if line["refused"]]
    assert line["method"] == "three-point"
    assert "choose another triple" in line["refused"]
    assert run(["register", str(folder)]) == 0
    assert "three-point finds nothing" in capsys.readouterr().out
    assert "choose another triple" in refused(capsys, "register", folder, "--method", "three-point")


def test_thirty_good_markers_are_never_refused(tmp_path, capsys):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        ct = rng.uniform(-0.1, 0.1, (30, 3))
        robot = mapped(ct) + rng.normal(0, 3e-4, ct.shape)
        folder = folder_of(tmp_path / f"{seed}", ct, robot)
        assert not told(capsys, folder)["shifted"]


def test_the_robot_s_noise_alone_is_not_taken_for_all_of_it(tmp_path, capsys):
    folder = folder_of(tmp_path / "bench", *readings(range(5), ALIKE))
    toml = folder / "dataset.toml"
    toml.write_text(toml.read_text() + "\n[noise]\nrobot_std = 0.0001\n")
    found = told(capsys, folder)
    assert found["noise"]["stated"] is False
    assert any("not used without ct_resolution" in note for note in found["notes"])


def test_three_markers_without_noise_are_not_known_in_words_and_in_json(tmp_path, capsys):
    ct, robot = readings(range(3), ALIKE)
    target = Points(("M",), LESION[None], np.full((1, 3), np.nan))
    whole = Fiducials("bench", Points(LABELS[:3], ct, robot), target)
    folder = save_fiducials(whole, tmp_path / "bench")
    (found,) = told(capsys, folder)["targets"]
    assert found["semi_axes95"] is found["tre_rms"] is found["covariance"] is None
    assert "three markers cannot show how large the noise is" in found["unknown"]
    assert run(["register", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "M: not known" in said
    assert "good" not in said


@pytest.mark.parametrize("n", [30, 200])
def test_an_exchange_of_two_labels_among_many_is_seen(n):
    rng = np.random.default_rng(n)
    ct = rng.uniform(-0.1, 0.1, (n, 3))
    robot = mapped(ct)
    robot[[3, n - 1]] = robot[[n - 1, 3]]
    with pytest.raises(PlumblineError, match=f"CT's M{n} is the robot's M4"):
        registered(METHODS["kabsch"], ct, robot, ALIKE)


@pytest.mark.parametrize(("n", "bad"), [(5, 1), (7, 2), (12, 4), (30, 13), (120, 50)])
@pytest.mark.parametrize("noise", [ALIKE, None], ids=["stated", "unstated"])
def test_as_many_moved_markers_as_the_breakdown_point_allows_are_named(n, bad, noise):
    rng = np.random.default_rng(n)
    ct = rng.uniform(-0.1, 0.1, (n, 3))
    robot = mapped(ct + rng.normal(0, 4e-4, ct.shape)) + rng.normal(0, 3e-4, ct.shape)
    robot[:bad] += rng.uniform(0.02, 0.05, (bad, 3)) * rng.choice([-1.0, 1.0], (bad, 3))
    answer = registered(METHODS["robust"], ct, robot, noise)
    assert answer.shifted == tuple(f"M{k + 1}" for k in range(bad))
    assert np.linalg.norm(answer.map(LESION) - mapped(LESION)) < 4e-3


def test_no_two_causes_are_each_most_of_an_error(tmp_path, capsys):
    """A target far off, read in CT by noise that is none of the robot's."""
    rng = np.random.default_rng(3)
    ct = rng.normal(size=(20, 3)) * [0.03, 0.02, 0.01]
    noisy = ct + 3e-4 * rng.normal(size=ct.shape)
    target = Points(("t",), np.array([[0.06, 0.04, 0.04]]), np.full((1, 3), np.nan))
    markers = Points(tuple(f"M{k}" for k in range(20)), ct, noisy)
    place = save_fiducials(Fiducials("bench", markers, target), tmp_path / "f")
    (line,) = [t["trust"] for t in told(capsys, place)["targets"]]
    assert "most of it is how well the target itself is read in CT" in line
    assert "comes from the rotation over an arm" in line
    assert line.count("most of it") == 1


def test_what_registration_refuses_is_refused_by_check(tmp_path, capsys):
    """Markers on a line or mirrored are told before anything is made of them."""
    places = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.05, 0.08, 0], [0.02, 0.03, 0.09]])
    line = np.linspace(0.0, 0.2, 4)[:, None] * [1.0, 0.5, 0.2]
    for name, ct, robot, words in (
        ("line", line, line, "on one line within"),
        ("mirror", places * [1.0, 1.0, -1.0], places, "a mirror image"),
    ):
        points = Points(("A", "B", "C", "D"), ct, robot)
        none = Points((), np.empty((0, 3)), np.empty((0, 3)))
        place = save_fiducials(Fiducials(name, points, none), tmp_path / name)
        assert run(["check", str(place)]) == 2
        (told,) = capsys.readouterr().err.splitlines()
        assert words in told
        assert run(["register", str(place)]) == 2
        assert words in capsys.readouterr().err
