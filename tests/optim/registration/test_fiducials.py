"""A recording of fiducials is read strictly, and registered by one command."""

import json

import numpy as np
import pandas as pd
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.slicer import read_tfm
from plumbline.optim.registration import METHODS
from plumbline.optim.registration.fiducials import Fiducials, Points, load_fiducials
from tests.phantoms import CT, LABELS, LESION, NOISE, labels, mapped, readings, save_fiducials

TARGETS = np.stack([LESION, LESION + np.array([0.0, 0.02, -0.024])])
SETTINGS = """name = "phantom"
observation = "fiducials"

[noise]
ct_resolution = [0.005, 0.001, 0.001]
robot_std = 0.0003
"""


def phantom(**given):
    """Markers A to E and two targets, one of which no one measured."""
    ct, robot = readings(range(5), NOISE)
    places = np.stack([mapped(TARGETS[0]), np.full(3, np.nan)])
    whole = {
        "name": "phantom",
        "markers": Points(LABELS, ct, robot),
        "targets": Points(("M", "L"), TARGETS, places),
        "noise": NOISE,
    }
    return Fiducials(**{**whole, **given})


@pytest.fixture
def folder(tmp_path):
    """A good recording."""
    place = save_fiducials(phantom(), tmp_path / "phantom")
    (place / "dataset.toml").write_text(SETTINGS)
    return place


def complaint(place):
    """The one line with which a folder is refused."""
    with pytest.raises(PlumblineError) as caught:
        load_fiducials(place)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def spoil(place, file, old, new):
    """Change a file, which must hold what is changed."""
    text = (place / file).read_text()
    assert old in text
    (place / file).write_text(text.replace(old, new, 1))
    return place


def test_a_folder_is_read(folder):
    found = load_fiducials(folder)
    assert found.name == "phantom"
    assert found.markers.labels == LABELS
    assert np.allclose(found.markers.ct, phantom().markers.ct, atol=1e-8)
    assert np.allclose(found.targets.robot[0], mapped(LESION))
    assert np.isnan(found.targets.robot[1]).all()
    assert np.allclose(found.noise.ct, NOISE.ct)
    assert np.allclose(found.noise.robot, 9e-8 * np.eye(3))
    assert np.allclose(np.diag(found.noise.ct), np.array([5e-3, 1e-3, 1e-3]) ** 2 / 12)
    assert len(found.sha256) == 64
    assert found.notes == ()


def test_what_is_saved_is_loaded_again(tmp_path):
    saved = phantom()
    found = load_fiducials(save_fiducials(saved, tmp_path / "again"))
    pd.testing.assert_frame_equal(found.table(), saved.table(), rtol=1e-7)
    assert np.allclose(found.noise.ct, NOISE.ct, rtol=1e-7)
    pd.testing.assert_frame_equal(Fiducials.from_table(saved.table()).table(), saved.table())


@pytest.mark.parametrize(
    ("old", "new", "known"),
    [
        ("[noise]\n", "", True),  # the same keys at the top
        ("robot_std = 0.0003", "robot_std = [1e-4, 2e-4, 3e-4]", True),
        ("ct_resolution = [0.005, 0.001, 0.001]", "ct_std = 0.001", True),
        ("[noise]\nct_resolution = [0.005, 0.001, 0.001]\nrobot_std = 0.0003\n", "", False),
    ],
)
def test_noise_may_be_stated_in_several_ways(folder, old, new, known):
    found = load_fiducials(spoil(folder, "dataset.toml", old, new))
    assert (found.noise is not None) is known


SAMPLES_FAULTS = {
    "role": ("A,marker", "A,merker", "row 2, column 'role': found 'merker'"),
    "label": ("B,marker", " ,marker", "row 3, column 'label': found an empty cell"),
    "doubled": ("B,marker", "A,marker", "row 3, column 'label': found 'A' again"),
    "column": ("robot_y", "robot_v", "row 1, column 'robot_y'"),
    "two markers": (None, "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
                    "A,marker,0,0,0,0,0,0\nB,marker,1,0,0,1,0,0\n", "found 2 rows of role marker"),
    "marker unmeasured": (None, "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
                          "A,marker,0,0,0,0,0,0\nB,marker,1,0,0,,,\n",
                          "row 3, column 'robot_x': found an empty cell"),
    "target half measured": (None, "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
                             "A,marker,0,0,0,0,0,0\nM,target,0,0,1,1,1,\nN,target,0,0,1,1,1,1\n",
                             "row 3, column 'robot_z': found an empty cell"),
    "mm": (None, "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
           "A,marker,0,0,0,0,0,0\nB,marker,100,0,0,0.1,0,0\nC,marker,0,100,0,0,0.1,0\n",
           "looks like mm: divide by 1000"),
    "target in mm": (None, "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
                     "A,marker,0,0,0,0,0,0\nB,marker,0.1,0,0,0.1,0,0\nC,marker,0,0.1,0,0,0.1,0\n"
                     "M,target,50,13,6,,,\n",
                     "row 5, column 'ct_x': found 50, 50 m from the others"),
    "words": (",0.", ",zero.", "expected a number"),
}  # fmt: skip


@pytest.mark.parametrize("name", SAMPLES_FAULTS)
def test_a_fault_in_the_samples_is_named_by_row_and_column(folder, name):
    old, new, words = SAMPLES_FAULTS[name]
    if old is None:
        (folder / "samples.csv").write_text(new)
    else:
        spoil(folder, "samples.csv", old, new)
    message = complaint(folder)
    assert message.startswith("samples.csv")
    assert words in message


def test_labels_that_differ_by_case_or_blanks_alone_are_told(folder):
    spoil(folder, "samples.csv", "B,marker", "a ,marker")
    said = "'A' and 'a' differ by case or blanks alone and are points of their own"
    assert [said in note for note in load_fiducials(folder).notes] == [True]


SETTINGS_FAULTS = {
    "kind": ('"fiducials"', '"tip_position"', "run: plumbline diagnose FOLDER"),
    "other kind": ('"fiducials"', '"tracking"', "run: plumbline diagnose FOLDER"),
    "misspelt": ('"fiducials"', '"fiducial"', "best matches: fiducials"),
    "no kind": ("observation", "observed", "found nothing"),
    "mm": ("[0.005", "[5.0", "row 5, [noise] ct_resolution: found [5.0, 0.001, 0.001], expected"),
    "negative": ("0.0003", "-0.0003", "row 6, [noise] robot_std: found -0.0003"),
    "two": ("[0.005, 0.001, 0.001]", "[0.005, 0.001]", "three finite numbers"),
    "word": ("0.0003", '"0.3 mm"', "without quotes"),
    "both": ("robot_std", "ct_std = 0.001\nrobot_std", "leave one of them out"),
    "exact": ("[0.005, 0.001, 0.001]\nrobot_std = 0.0003", "[0.005, 0.001, 0.0]",
              "write robot_std, too"),
}  # fmt: skip


@pytest.mark.parametrize("name", SETTINGS_FAULTS)
def test_a_fault_in_the_settings_is_named_by_row_and_key(folder, name):
    old, new, words = SETTINGS_FAULTS[name]
    message = complaint(spoil(folder, "dataset.toml", old, new))
    assert message.startswith("dataset.toml")
    assert words in message


def test_what_nothing_reads_is_noted(folder):
    spoil(folder, "dataset.toml", "robot_std", "robot_sdt = 1\nrobot_std")
    (note,) = load_fiducials(folder).notes
    assert "robot_sdt: not used (did you mean 'robot_std'?)" in note


def test_no_folder_is_refused(tmp_path):
    assert "no such folder" in complaint(tmp_path / "none")
    assert "no such file" in complaint(tmp_path)


def registered(capsys, *arguments):
    """The JSON of ``plumbline register``."""
    assert run(["register", *map(str, arguments), "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("name", METHODS)
def test_the_command_registers_by_every_method(folder, capsys, name):
    found = registered(capsys, folder, "--method", name)
    assert found["method"] == name
    assert found["methods"][0]["method"] == name
    assert {line["method"] for line in found["methods"]} == set(METHODS)
    first, second = found["targets"]
    assert first["label"] == "M"
    assert first["measured_error"] < 5 * first["tre_rms"]
    assert np.allclose(np.array(found["T_RC"])[:3, :3] @ LESION, mapped_part(found, LESION))
    assert second["measured_error"] is None
    assert second["semi_axes95"][0] > second["tre_rms"]
    assert "in 95 of 100 cases" in second["trust"]


def mapped_part(found, point):
    """A point of frame R less the translation."""
    T = np.array(found["T_RC"])
    return mapped(point, T) - T[:3, 3]


def test_the_command_says_it_in_words(folder, capsys):
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert run(["register", str(folder)]) == 0
    said = capsys.readouterr().out
    for words in ("T_RC", "FRE", "TRE", "M: fair; in 95 of 100 cases", "best triple", "kabsch"):
        assert words in said
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert run(["register", str(folder), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_the_command_names_a_marker_that_moved(folder, capsys):
    fiducials = load_fiducials(folder)
    robot = fiducials.markers.robot.copy()
    robot[2, 1] += 0.02
    moved = phantom(markers=Points(LABELS, fiducials.markers.ct, robot))
    place = save_fiducials(moved, folder.parent / "moved")
    found = registered(capsys, place, "--method", "robust")
    assert found["shifted"] == ["C"]
    assert any("marker C moved by" in note for note in found["notes"])
    assert registered(capsys, place)["shifted"] == ["C"]
    every = registered(capsys, place, "--method", "anisotropic")
    assert any("stated noise allows" in note for note in every["notes"])
    assert every["targets"][0]["trust"].startswith("M: doubtful")


def test_the_command_takes_a_triple(folder, capsys):
    found = registered(capsys, folder, "--method", "three-point", "--triple", "A, C, D")
    assert [m["label"] for m in found["markers"] if m["used"]] == ["A", "C", "D"]
    assert any("nearly on one line" in note for note in found["notes"])
    assert found["targets"][0]["trust"].startswith("M: poor")
    assert "rotation over an arm" in found["targets"][0]["trust"]


def test_the_command_writes_a_transform_for_slicer(folder, tmp_path, capsys):
    out = tmp_path / "T.tfm"
    found = registered(capsys, folder, "--tfm", out)
    assert np.allclose(read_tfm(out), found["T_RC"], atol=1e-12)
    found = registered(capsys, folder, "--tfm", out, "--overwrite", "--ct-axes", "RAS")
    assert np.allclose(read_tfm(out, "RAS"), found["T_RC"], atol=1e-12)


def test_without_targets_or_noise_the_command_says_what_is_missing(tmp_path, capsys):
    empty = Points((), np.empty((0, 3)), np.empty((0, 3)))
    place = save_fiducials(phantom(targets=empty, noise=None), tmp_path / "bare")
    assert run(["register", str(place), "--method", "robust"]) == 0
    said = capsys.readouterr().out
    assert "No target rows" in said
    assert "no noise was stated" in said
    assert "estimated" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--method", "kabsh"], "Best matches are kabsch"),
        (["--triple", "A,B,C"], "is for --method three-point"),
        (["--method", "three-point", "--triple", "A,B,X"], "three different markers of A, B"),
        (["--method", "three-point", "--triple", "A,B"], "such as A,B,C"),
        (["--tfm", "."], "is a folder"),
        (["--tfm", "a.json", "--json", "a.json"], "both name"),
        (["--ct-axes", "IJK"], "--ct-axes"),
    ],
)
def test_a_bad_command_line_is_one_line(folder, arguments, words, capsys, monkeypatch):
    monkeypatch.chdir(folder.parent)
    assert run(["register", str(folder), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1


def test_markers_that_give_no_frame_are_one_line_of_the_command(folder, capsys):
    ct, robot = readings(range(5), NOISE)
    ct[:, 2] *= -1
    place = save_fiducials(
        phantom(markers=Points(labels(range(5)), ct, robot)), folder.parent / "mirrored"
    )
    assert run(["register", str(place)]) == 2
    err = capsys.readouterr().err
    assert "mirror image" in err
    assert err.count("\n") == 1


def test_odd_names_do_not_break_the_page(tmp_path, capsys):
    names = ("[bold]A", "B\\", "C[/]", "D", "E")
    ct, robot = readings(range(5), NOISE)
    place = save_fiducials(phantom(markers=Points(names, ct, robot)), tmp_path / "odd")
    assert run(["register", str(place)]) == 0
    assert "[bold]A" in capsys.readouterr().out


def test_the_markers_of_the_paper_span_what_its_table_says():
    assert CT.shape == (5, 3)
    assert np.linalg.norm(CT[1] - CT[0]) == pytest.approx(0.1414, abs=1e-4)
