"""plane_range recordings: what is read, what is refused in one line, what the command answers."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.reality.ranging.scene import calibration, marks
from plumbline.experiments.reality.ranging.writing import write_survey
from plumbline.experiments.reproduce.hand_eye_trials import readings_of
from plumbline.optim.core.judged import Solution
from plumbline.optim.hand_eye.answer import HandEye, hand_eye
from plumbline.optim.hand_eye.calibrate import HandEyeOptions, calibrate
from plumbline.optim.hand_eye.design import next_poses
from plumbline.optim.hand_eye.recording import load_ranges
from plumbline.optim.hand_eye.single_plane import slope
from tests.answer_contract import keeps_the_contract
from tests.ranging_scenes import PAPER, planned, room_of, surveyed, truth
from tests.recording_folders import cell

GROSS = (5, 40, 77, 120, 160)


@pytest.fixture(scope="module")
def made():
    """A scene, a survey with five gross readings, and marks."""
    scene, survey, _ = surveyed(3)
    distance = survey.distance.copy()
    distance[list(GROSS)] += 8e-3
    survey = type(survey)(
        survey.q, distance, survey.plane, survey.motion, survey.patch, np.array(GROSS)
    )
    return scene, survey, marks(scene, np.random.default_rng(1))[0]


@pytest.fixture
def folder(made, tmp_path):
    return write_survey(tmp_path / "bench", *made)


def rewritten(folder, change, file="samples.csv"):
    path = folder / file
    old = path.read_text()
    assert change(old) != old
    path.write_text(change(old))
    return folder


def column(name, convert):
    """A change of every cell of a column."""

    def change(csv):
        head, *rows = csv.strip().split("\n")
        k = head.split(",").index(name)
        for i, row in enumerate(rows):
            cells = row.split(",")
            cells[k] = convert(cells[k])
            rows[i] = ",".join(cells)
        return "\n".join([head, *rows]) + "\n"

    return change


def test_a_recording_comes_back_as_it_was(made, folder):
    _, survey, _ = made
    found = load_ranges(folder)
    assert found.name == "bench"
    assert len(found.readings) == 180
    np.testing.assert_allclose(found.readings.distance, survey.distance, rtol=1e-8)
    np.testing.assert_allclose(found.readings.R, readings_of(survey).R, atol=1e-8)
    assert found.readings.row[0] == 2
    assert found.noise_std == PAPER.noise
    assert len(found.marks.distance) == 50
    assert found.notes == ()


def test_poses_say_the_same_as_joints(made, folder, tmp_path):
    poses = load_ranges(write_survey(tmp_path / "poses", *made, poses=True))
    assert poses.chain is None
    np.testing.assert_allclose(poses.readings.R, load_ranges(folder).readings.R, atol=1e-7)
    one, two = calibrate(poses.readings).beam, calibrate(load_ranges(folder).readings).beam
    np.testing.assert_allclose(one.r, two.r, atol=1e-5)


def test_planes_and_motions_may_have_names(folder):
    words = {"1": "floor", "2": "front", "3": "side"}
    rewritten(folder, column("plane", words.get))
    rewritten(folder, column("motion", lambda c: "turning" if c == "4" else f"shift{c}"))
    found = load_ranges(folder)
    assert found.labels == ("floor", "front", "side")
    assert {b.label for b in hand_eye(found, HandEyeOptions(poses=0)).boards} == set(words.values())


def test_the_answer_names_the_gross_rows_and_holds_the_truth(made, folder):
    scene, _, _ = made
    found = hand_eye(load_ranges(folder), HandEyeOptions(poses=2))
    assert set(np.array(GROSS) + 2) <= set(found.calibration.gross)
    assert len(found.calibration.gross) <= len(GROSS) + 2
    beam, std = found.calibration.beam, found.calibration.std
    assert (np.abs(beam.r - truth(scene).r) < 4 * std[:3]).all()
    assert (np.abs(beam.v - truth(scene).v) < 4 * std[3:] + 1e-6).all()
    assert found.repeatability < 0.4e-3
    assert len(found.next) == 2


def test_held_out_readings_stay_out(made, folder):
    lines = (folder / "samples.csv").read_text().strip().split("\n")
    marked = [
        f"{line},{'held_out' if k == 0 else int(k % 10 == 1)}" for k, line in enumerate(lines)
    ]
    (folder / "samples.csv").write_text("\n".join(marked) + "\n")
    found = load_ranges(folder)
    assert len(found.readings) == 162
    assert hand_eye(found, HandEyeOptions(poses=0)).held_out < 5e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (cell(17, "range", "abc"), "samples.csv, row 17, column 'range': found 'abc'"),
        (cell(17, "range", "nan"), "row 17, column 'range'"),
        (cell(9, "range", "-0.2"), "row 9, column 'range': found -0.2, expected a range above 0"),
        (cell(9, "q3", ""), "row 9, column 'q3': found an empty cell"),
        (cell(9, "plane", "1.5"), "row 9, column 'plane': found 1.5, expected a whole number"),
        (cell(9, "plane", ""), "row 9, column 'plane'"),
        (column("range", lambda c: str(1e3 * float(c))), "looks like millimetres"),
        (column("q2", lambda c: str(57.3 * float(c))), "looks like degrees"),
        (lambda csv: csv.replace("range,", "rnge,", 1), "column 'range': found no such column"),
        (lambda csv: csv.replace("motion", "movement", 1), "column 'motion'"),
        (lambda csv: "\n".join(csv.split("\n")[:6]) + "\n", "5 readings, at least 8 expected"),
        (cell(190, "mark", "77"), "mark 77 in 1 reading"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(folder, change, words):
    with pytest.raises(PlumblineError) as caught:
        load_ranges(rewritten(folder, change))
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace("plane_range", "tip_position"), "plumbline diagnose"),
        (lambda t: t.replace('observation = "plane_range"\n', ""), "found nothing"),
        (lambda t: t.replace("vs060", "vs61"), "not recognised"),
        (lambda t: t.replace("5e-05", "50"), "noise_std"),
    ],
)
def test_settings_that_are_wrong_are_named(folder, change, words):
    with pytest.raises(PlumblineError, match=words):
        load_ranges(rewritten(folder, change, "dataset.toml"))


def test_poses_that_are_none_are_named(made, tmp_path):
    folder = write_survey(tmp_path / "poses", *made, poses=True)
    with pytest.raises(PlumblineError, match="row 5, column 'qw': found a quaternion of length"):
        load_ranges(rewritten(folder, cell(5, "qw", "2")))
    folder = write_survey(tmp_path / "far", *made, poses=True)
    with pytest.raises(PlumblineError, match="looks like millimetres"):
        load_ranges(rewritten(folder, column("px", lambda c: str(1e3 * float(c)))))
    folder = write_survey(tmp_path / "none", *made, poses=True)
    with pytest.raises(PlumblineError, match="column 'py': found no such column"):
        load_ranges(rewritten(folder, lambda csv: csv.replace("py,", "my,", 1)))
    with pytest.raises(PlumblineError, match="no flange pose"):
        load_ranges(
            rewritten(folder, lambda csv: csv.replace("px,my,pz,qw,qx,qy,qz", "a,b,c,d,e,f,g"))
        )


# The command


def test_the_command_answers_in_words(folder, capsys):
    assert run(["handeye", str(folder), "--next", "2"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for words in (
        "180 readings on 3 planes", "r_x", "repeatability on marks", "What to measure next",
        "an offset of the range", *(str(row + 2) for row in GROSS),
    ):  # fmt: skip
        assert words in out


def test_the_command_s_json_is_complete(folder, tmp_path, capsys):
    out = tmp_path / "answer.json"
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    assert run(["handeye", str(folder), "--json", str(out), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    found = json.loads(out.read_text())
    assert set(found) >= {"r", "v", "repeatability", "planes", "gross", "unseen", "next", "notes"}
    assert len(found["r"]["value"]) == len(found["r"]["std"]) == 3
    assert found["r"]["unit"] == "m"
    assert found["repeatability"]["measured"] is True
    assert len(found["planes"]) == 3
    assert found["observability"]["rank"] == 5
    assert found["judged"]["converged"] is True
    assert len(found["next"]) == 5
    assert len(found["next"][0]["q"]) == 6
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_json_on_standard_output_is_alone_there(folder, capsys):
    assert run(["handeye", str(folder), "--json", "-", "--next", "0"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == 180


@pytest.mark.parametrize("number", [1])
def test_degenerate_motions_end_with_one_line(tmp_path, capsys, number):
    scene, programme = room_of(0), planned(0)[1]
    survey = calibration(scene, np.random.default_rng(0), programme)
    rows = (survey.plane == number) & (survey.motion == 1)
    one = type(survey)(
        survey.q[rows], survey.distance[rows], survey.plane[rows], survey.motion[rows],
        survey.patch[rows], survey.gross[:0],
    )  # fmt: skip
    folder = write_survey(tmp_path / "still", scene, one)
    assert run(["handeye", str(folder)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "no rotation" in err
    assert err.count("\n") == 1


def test_a_recording_of_ranges_is_sent_from_the_postures_to_its_own_commands(folder, capsys):
    assert run(["next", str(folder)]) == 2
    assert "plumbline handeye FOLDER" in capsys.readouterr().err
    assert run(["dhfit", str(folder)]) == 2
    assert "plumbline diagnose FOLDER" in capsys.readouterr().err


def with_column(name, value):
    """A change that adds a column of one value, or sets one that is there."""

    def change(csv):
        if name in csv.split("\n")[0].split(","):
            return column(name, lambda _: value)(csv)
        head, *rows = csv.strip().split("\n")
        return "\n".join([f"{head},{name}", *(f"{row},{value}" for row in rows)]) + "\n"

    return change


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("held_out", "1", "found 0 rows to fit (180 are held out, 50 are aimed at marks)"),
        ("mark", "1", "found 0 rows to fit (0 are held out, 230 are aimed at marks)"),
        ("held_out", "-1", "row 2, column 'held_out': found -1, expected 0 or 1"),
        ("mark", "-1", "row 2, column 'mark': found -1"),
    ],
)
def test_rows_left_aside_are_told_apart_and_counted(folder, name, value, words):
    with pytest.raises(PlumblineError) as caught:
        load_ranges(rewritten(folder, with_column(name, value)))
    assert words in str(caught.value)


@pytest.mark.parametrize("alike", [(), ("motion",), ("plane",), ("plane", "motion")])
def test_two_poses_read_ten_times_calibrate_nothing(folder, alike):
    head, *rows = (folder / "samples.csv").read_text().strip().split("\n")
    (folder / "samples.csv").write_text("\n".join([head, *(rows[0], rows[150]) * 10]) + "\n")
    for name in alike:
        rewritten(folder, column(name, lambda _: "1"))
    with pytest.raises(PlumblineError):
        hand_eye(load_ranges(folder), HandEyeOptions(poses=0))


def test_repeated_poses_of_a_motion_are_counted_once(made):
    readings = readings_of(made[1])
    with pytest.raises(PlumblineError, match="2 distinct poses in 8 readings"):
        slope(readings.select(np.array([0, 1] * 4)))


def test_noise_far_above_the_scatter_is_noted(folder):
    rewritten(
        folder, lambda text: text.replace("noise_std = ", "noise_std = 0.09 # "), "dataset.toml"
    )
    assert any("the finder states 90 mm" in note for note in hand_eye(load_ranges(folder)).notes)


@pytest.mark.parametrize(("kind", "command"), [("fiducials", "register"), ("tracking", "diagnose")])
def test_a_recording_of_another_command_is_sent_there(folder, kind, command):
    rewritten(folder, lambda text: text.replace("plane_range", kind), "dataset.toml")
    with pytest.raises(PlumblineError, match=f"run: plumbline .*{command}"):
        load_ranges(folder)


@dataclass(frozen=True)
class GivesUp:
    """A solver that stops a scale short of where it should."""

    bounds = rows = True
    constraints = objective = False

    def solve(self, problem, start):
        return Solution(problem, np.asarray(start) + problem.scale)


def test_a_fit_that_has_not_converged_is_said(folder):
    assert hand_eye(load_ranges(folder), HandEyeOptions(poses=0)).calibration.judged.converged
    short = hand_eye(load_ranges(folder), HandEyeOptions(poses=0, solver=GivesUp()))
    assert short.to_dict()["judged"]["converged"] is False
    assert any("the fit of the beam has not converged" in note for note in short.notes)


def test_an_answer_keeps_the_contract_and_comes_back_with_its_calibration(folder, tmp_path):
    found = plumbline.hand_eye(folder, HandEyeOptions(poses=1))
    keeps_the_contract(found, tmp_path)
    again = plumbline.load(tmp_path / "answer.json")
    assert type(again) is HandEye
    one, two = found.calibration, again.calibration
    np.testing.assert_array_equal(one.heights(), two.heights())
    assert one.solution.cost == two.solution.cost
    np.testing.assert_allclose(two.solution.gram.vector, one.solution.gram.vector, atol=1e-9)
    assert next_poses(two, 1)[0].point_std == next_poses(one, 1)[0].point_std


def test_what_a_recording_states_of_slanted_beams_is_taken_unless_an_option_says_otherwise(folder):
    stated = rewritten(folder, lambda s: "incidence_bias_std = 1e-4\n" + s, "dataset.toml")
    assert plumbline.hand_eye(stated, HandEyeOptions(poses=0, gross=5.0)).calibration.bias == 1e-4
    assert plumbline.hand_eye(stated, HandEyeOptions(poses=0, bias=0.0)).calibration.bias == 0.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"shapes": -1}, "shapes: found -1"),
        ({"arm": -2}, "arm: found -2"),
        ({"poses": 51}, "expected 0 to 50"),
        ({"seed": -1}, "seed: found -1"),
        ({"gross": 0.0}, "gross: found 0, expected more than 0"),
        ({"gross": float("inf")}, "gross: found inf"),
        ({"bias": 0.1}, "bias: found 0.1, expected at least 0 and less than"),
        ({"bias": float("nan")}, "bias: found nan"),
    ],
)
def test_an_option_out_of_its_range_is_refused_in_one_line(given, words):
    with pytest.raises(PlumblineError, match=words) as caught:
        HandEyeOptions(**given)
    assert "\n" not in str(caught.value)
