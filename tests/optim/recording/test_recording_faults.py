"""What is no recording is refused in one line: where, what was found and expected, the way out."""

import re

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.loading import load_recording
from tests.recording_folders import (
    ROWS,
    cell,
    complaint,
    poses,
    postures,
    scaled,
    swap,
    with_columns,
    with_text,
    write_folder,
)

UR5 = Robot.bundled("ur5")

SAMPLES_FAULTS = {
    "nan": (cell(5, "q3", "nan"), "row 5, column 'q3'", "finite number"),
    "inf": (cell(5, "x", "-inf"), "row 5, column 'x'", "finite number"),
    "overflow": (cell(5, "x", "1e400"), "row 5, column 'x'", "finite number"),
    "huge": (cell(5, "x", "1e15"), "row 5, column 'x'", "SI units"),
    "text": (cell(6, "y", "abc"), "row 6, column 'y'", "found 'abc', expected a number"),
    "underscore": (cell(6, "y", "1_0"), "row 6, column 'y'", "found '1_0'"),
    "typographic minus": (cell(6, "y", "\u22120.5"), "row 6, column 'y'", "typographic minus"),
    "empty cell": (cell(41, "z", ""), "row 41, column 'z'", "an empty cell"),
    "quoted decimal comma": (cell(9, "z", '"0,12"'), "row 9, column 'z'", "decimal commas"),
    "decimal commas": (lambda t: t.replace(".", ","), "row 2", "decimal commas"),
    "a comment": (lambda t: "# made by me\n" + t, "row 1", "delete that line"),
    "semicolons": (lambda t: t.replace(",", ";"), "row 1", "semicolons"),
    "tabs": (lambda t: t.replace(",", "\t"), "row 1", "tabs"),
    "ragged": (cell(12, "q4", "1,2"), "row 12", "expected 19 as in the header"),
    "comma at the end": (swap(",0\n", ",0,\n"), "row 2", "delete the comma at the end"),
    "cut short": (lambda t: t[:-30], "row 41", "cut short"),
    "endless cell": (cell(9, "y", "1" * 200_000), "row 9", "a cell of more than 131072"),
    "broken quote": (cell(41, "held_out", '"0'), "row 41", "broken CSV"),
    "no header": (lambda t: t.split("\n", 1)[1], "row 1", "put a header line on top"),
    "header only": (lambda t: t.split("\n")[0] + "\n", "row 2", "no rows below the header"),
    "empty": (lambda t: "", "samples.csv", "an empty file"),
    "blank": (lambda t: "\n\n", "samples.csv", "an empty file"),
    "missing column": (swap(",z,", ",Z,"), "row 1, column 'z'", "nearest: Z"),
    "missing joint": (swap("q3", "p3"), "row 1, column 'q3'", "no such column"),
    "no joints": (lambda t: re.sub(r"\bq(\d)", r"axis_\1", t, count=6), "column 'q1'", "add it"),
    "joints from 0": (swap("q6", "q0"), "column 'q0'", "count them from 1"),
    "doubled column": (swap("temperature", "x"), "row 1, column 'x'", "2 columns of that name"),
    "part of a context": (swap("direction4", "side4"), "column 'direction4'", "no such column"),
    "time backwards": (cell(9, "time", "3"), "row 9, column 'time'", "found 3 s after 12 s"),
    "direction": (cell(9, "direction2", "2"), "row 9, column 'direction2'", "-1, 0 or 1"),
    "group": (cell(9, "group", "1.5"), "row 9, column 'group'", "whole number"),
    "held_out": (cell(9, "held_out", "2"), "row 9, column 'held_out'", "0 or 1"),
    "held_out true": (cell(9, "held_out", "True"), "row 9, column 'held_out'", "1 for true"),
    "temperature": (cell(9, "temperature", "-273"), "row 9, column 'temperature'", "degC"),
    "extreme joint": (cell(9, "q2", "90"), "row 9, column 'q2'", "mend or delete the row"),
    "extreme tip": (cell(9, "y", "812"), "row 9, column 'y'", "mend or delete the row"),
}  # fmt: skip


@pytest.mark.parametrize("name", SAMPLES_FAULTS)
def test_a_fault_in_the_samples_is_named_by_row_and_column(tmp_path, name):
    change, where, words = SAMPLES_FAULTS[name]
    message = complaint(with_text(tmp_path, "samples.csv", change))
    assert message.startswith("samples.csv")
    assert where in message
    assert words in message


def test_an_error_carries_file_row_column_value_limit_and_remedy(tmp_path):
    folder = with_text(tmp_path, "samples.csv", cell(9, "q2", "abc"))
    with pytest.raises(PlumblineError) as caught:
        load_recording(folder)
    error = caught.value
    assert (error.file, error.row, error.column) == ("samples.csv", 9, "q2")
    assert error.value == "'abc'"
    assert error.limit == "a number"
    assert error.remedy
    parts = (error.file, "row 9", "'q2'", error.value, error.limit, error.remedy)
    assert all(str(part) in str(error) for part in parts)


def test_an_error_of_the_settings_carries_its_row_and_key(tmp_path):
    folder = with_text(tmp_path, "dataset.toml", lambda text: text + "\nnoise_std = = 3\n")
    with pytest.raises(PlumblineError) as caught:
        load_recording(folder)
    assert caught.value.file == "dataset.toml"
    assert caught.value.row is not None


def few(count):
    return lambda table: {name: values[:count] for name, values in table.items()}


COLUMN_FAULTS = {
    "degrees": ("tip_position", scaled(180 / np.pi, *(f"q{j}" for j in range(1, 7))),
                "'q1'", "looks like degrees"),
    "small degrees": ("tip_position",
                      lambda t: t | {f"q{j}": t[f"q{j}"] * 4 for j in range(1, 7)} | dict(
                          zip("xyz", poses(UR5, np.radians(4 * postures()))[0].T, strict=True)),
                      "'q1'", "looks like degrees"),
    "degrees of second encoders": ("joint_position",
                                   scaled(180 / np.pi, *(f"m{j}" for j in range(1, 7))),
                                   "'m1'", "looks like degrees"),
    "degrees and a slide": ("slider", scaled(180 / np.pi, "q1", "q2", "q3", "q4"),
                               "column 'q", "degrees"),
    "millimetres": ("tip_position", scaled(1e3, *"xyz"), "samples.csv, row", "divide by 1000"),
    "centimetres": ("pose", scaled(1e2, *"xyz"), "samples.csv, row", "divide by 100"),
    "kilometres": ("tip_position", scaled(1e-3, *"xyz"), "samples.csv, row", "multiply positions"),
    "kelvin": ("tip_position", lambda t: t | {"temperature": t["temperature"] + 273.15},
               "row 2, column 'temperature'", "kelvin: subtract 273.15"),
    "payload": ("tip_position", lambda t: t | {"payload": t["time"] - 8},
                "row 2, column 'payload'", "0 to 5000 kg"),
    "too few rows": ("tip_position", few(3), "found 3 rows", "at least 4"),
    "too few poses": ("pose", few(2), "found 2 rows", "at least 3"),
    "too few in sockets": ("fixed_point", few(4), "found", "socket"),
    "too few kept": ("tip_position", lambda t: t | {"held_out": np.arange(ROWS) > 2},
                     "found 3 rows to fit (37 are held out)", "hold fewer rows out"),
    "none kept": ("tip_position", lambda t: t | {"held_out": np.ones(ROWS)},
                  "column 'held_out': found every row held out", "delete the column"),
    "one posture": ("tip_position", lambda t: {k: np.full(ROWS, v[0]) for k, v in t.items()},
                    "one posture in every row", "other postures"),
    "five joints": ("tip_position", lambda t: {k: v for k, v in t.items() if k != "q6"},
                    "found 5 joint columns, expected q1..q6", "add columns"),
    "seven joints": ("tip_position", lambda t: t | {"q7": t["q6"]},
                     "found 7 joint columns", "delete columns"),
    "two of four joints": ("slider", lambda t: {k: v for k, v in t.items() if k not in
                                                ("q3", "q4")},
                           "q1..q3 for shoulder, insertion, roll, or q1..q4", "add columns"),
    "not unit": ("pose", scaled(1.01, "qw", "qx", "qy", "qz"), "row 2, column 'qw'",
                 "norm 1.01"),
    "zero quaternion": ("pose", scaled(0.0, "qw", "qx", "qy", "qz"), "row 2", "norm 0"),
    "w last": ("pose", lambda t: t | {"qw": t["qx"], "qx": t["qy"], "qy": t["qz"], "qz": t["qw"]},
               "column 'qw'", "put w first"),
    "no socket": ("fixed_point", lambda t: {k: v for k, v in t.items() if k != "socket"},
                  "row 1, column 'socket'", "no such column"),
    "half a socket": ("fixed_point", lambda t: t | {"socket": t["socket"] + 0.5},
                      "row 2, column 'socket'", "whole number"),
    "a socket once": ("fixed_point", lambda t: t | {"socket": np.arange(ROWS) == 7},
                      "row 9, column 'socket'", "socket 1 in a single row"),
    "no second encoder": ("joint_position", lambda t: {k: v for k, v in t.items() if k[0] != "m"},
                          "row 1, column 'm1'", "no such column"),
}  # fmt: skip


@pytest.mark.parametrize("name", COLUMN_FAULTS)
def test_columns_that_cannot_be_are_refused(tmp_path, name):
    kind, change, where, words = COLUMN_FAULTS[name]
    message = complaint(with_columns(tmp_path, change, kind))
    assert message.startswith("samples.csv")
    assert where in message
    assert words in message


def test_a_slide_in_millimetres_is_refused(tmp_path):
    write_folder(tmp_path, "slider")
    recording = load_recording(tmp_path)
    slide = [str(n) for n in recording.robot.model.names].index("insertion")
    folder = with_columns(tmp_path, scaled(1e3, f"q{slide}"), "slider")
    message = complaint(folder)
    assert "looks like millimetres: divide by 1000" in message
    assert "up to 0.25 m" in message


SETTINGS_FAULTS = {
    "no equals sign": ("noise_std =", "noise_std", "row 3", "broken TOML"),
    "bad date": ('"bench"', "2020-13-45", "row 1", "broken TOML"),
    "unknown observation": ("tip_position", "tip_postion", "row 2, observation", "tip_position"),
    "number for a word": ('"tip_position"', "3", "row 2, observation", "a word in quotes"),
    "no observation": ("observation", "observed", "observation", "found nothing"),
    "word for a number": ("1.0e-4", '"0.1 mm"', "row 3, noise_std", "without quotes"),
    "nan": ("1.0e-4", "nan", "row 3, noise_std", "a finite number"),
    "flag for a number": ("1.0e-4", "true", "row 3, noise_std", "a finite number"),
    "integer beyond floats": ("1.0e-4", "9" * 400, "row 3, noise_std", "a finite number"),
    "integer beyond digits": ("1.0e-4", "9" * 5000, "row", "broken TOML"),
    "no noise": ("1.0e-4", "0.0", "row 3, noise_std", "leave it out"),
    "negative noise": ("1.0e-4", "-1e-4", "row 3, noise_std", "leave it out"),
    "noise in mm": ("1.0e-4", "100.0", "row 3, noise_std", "between 0 and"),
    "two robots": ("gravity", 'urdf = "robot.urdf"\ngravity', "[robot]", "urdf and bundled"),
    "no robot": ('bundled = "ur5"\n', "", "dataset.toml", "no robot"),
    "no robot table": ("[robot]", "[rotob]", "dataset.toml", "no [robot]"),
    "robot as a word": ("[robot]\nbundled", "robot = 1\n[other]\nbundled", "robot", "a table"),
    "unknown robot": ('"ur5"', '"ur6"', "row 6, [robot] bundled", "ur5"),
    "unknown tip": ('"flange"', '"flnge"', "row 7, [robot] tip_frame", "Best matches are flange"),
    "gravity of two": ("[0.0, 0.0, -9.81]", "[0.0, -9.81]", "row 8, [robot] gravity", "three"),
    "gravity in mm": ("-9.81", "-9810.0", "row 8, [robot] gravity", "divide by 1000"),
    "tool in mm": ("[0.01, 0.0, 0.12]", "[10, 0, 120]", "row 11, [tool] offset", "mm: divide"),
    "tool of words": ("[0.01, 0.0, 0.12]", '["a", 0, 1]', "row 11, [tool] offset", "three finite"),
    "unknown effect": ('"tool"]', '"joint_ofset"]', "row 14, [fit] always", "joint_offset"),
    "always a word": ('["frame", "tool"]', '"frame"', "row 14, [fit] always", "a list of words"),
    "missing urdf": ('bundled = "ur5"', 'urdf = "arm.urdf"', "arm.urdf", "dataset.toml, samples"),
    "urdf outside": ('bundled = "ur5"', 'urdf = "../a.urdf"', "row 6, [robot] urdf", "inside"),
    "urdf absolute": ('bundled = "ur5"', 'urdf = "/a.urdf"', "row 6, [robot] urdf", "inside"),
    "urdf a zero": ('bundled = "ur5"', 'urdf = "a\\u0000"', "row 6, [robot] urdf", "inside"),
    "urdf a folder": ('bundled = "ur5"', 'urdf = "."', ".", "cannot be read"),
    "urdf too long": ('bundled = "ur5"', f'urdf = "{"a" * 300}"', "aaa", "cannot be read"),
    "dh a number": ('bundled = "ur5"', "dh = 3", "row 6, [robot] dh", "[[robot.dh]]"),
    "dh of numbers": ('bundled = "ur5"', "dh = [1, 2]", "row 6, [robot] dh", "[[robot.dh]]"),
    "dh empty": ('bundled = "ur5"', "dh = []", "row 6, [robot] dh", "none of which moves"),
    "dh a typo": ('bundled = "ur5"', "dh = [{aa = 1.0}]", "row 6, [robot] dh", "'aa'"),
    "dh in degrees": ('bundled = "ur5"', "dh = [{alpha = 90}]", "row 6, [robot] dh", "degrees"),
}  # fmt: skip


@pytest.mark.parametrize("name", SETTINGS_FAULTS)
def test_a_fault_in_the_settings_is_named_by_row_and_key(tmp_path, name):
    old, new, where, words = SETTINGS_FAULTS[name]
    message = complaint(with_text(tmp_path, "dataset.toml", swap(old, new)))
    assert where in message
    assert words in message


def test_dh_rows_in_millimetres_are_refused(tmp_path):
    rows = "dh = [" + "{d = 425.0}, " * 6 + "]"
    folder = with_text(tmp_path, "dataset.toml", swap('bundled = "ur5"', rows))
    assert "a reach of 2550 m" in complaint(folder)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("distance", "50.0", "looks like mm: divide by 1000"),
        ("distance", "0.0", "more than 0 m"),
        ("distance", "inf", "a finite number"),
        ("pairs", "[[0, 1, 2]]", "pairs of sockets"),
        ("pairs", "3", "pairs of sockets"),
        ("pairs", "[[0, 9]]", "two different sockets of 0, 1, 2, 3"),
        ("pairs", "[[1, 1]]", "two different sockets"),
    ],
)
def test_sockets_that_cannot_be_are_refused(tmp_path, key, value, words):
    write_folder(tmp_path, "fixed_point")
    with (tmp_path / "dataset.toml").open("a") as file:
        file.write(f"[sockets]\n{key} = {value}\n")
    message = complaint(tmp_path)
    assert f"dataset.toml, row 16, [sockets] {key}" in message
    assert words in message


@pytest.mark.parametrize("value", ["[0, 1]", "[7]", "[1, 1]", "[1.5]", '"all"'])
def test_measured_joints_are_numbers_of_joints(tmp_path, value):
    change = swap("observation", f"measured_joints = {value}\nobservation")
    folder = with_text(tmp_path, "dataset.toml", change, "joint_position")
    assert "dataset.toml, row 2, measured_joints" in complaint(folder)


BROKEN_PICTURE = (
    '<link name="tip"><visual><geometry><sphere radius="x"/></geometry></visual></link>'
)


def weighing(mass, xyz="0 0 0", ixx="1"):
    """A change that gives the last link a weight."""
    inertia = f'<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    weight = f'<inertial><origin xyz="{xyz}"/><mass value="{mass}"/>{inertia}</inertial>'
    return swap('<link name="tip"/>', f'<link name="tip">{weight}</link>')


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        (lambda text: text[: len(text) // 2], "robot.urdf, row 14", "broken XML"),
        (swap("</joint>", "</jiont>"), "robot.urdf, row 11", "mismatched tag"),
        (lambda text: "<arm/>", "robot.urdf, row 1", "expected <robot>"),
        (lambda text: '<robot name="a"><link name="b"/></robot>', "urdf", "no movable joint"),
        (lambda text: "\x00" + text, "robot.urdf, row 1", "a zero byte"),
        (swap('type="prismatic"', 'type="slide"'), "joint 'insertion'", "found type 'slide'"),
        (swap('type="prismatic"', 'type="floating"'), "insertion", "6 degrees of freedom"),
        (swap('<child link="slide"/>', '<child link="slied"/>'), "'insertion'", "child 'slied'"),
        (swap('<child link="slide"/>', '<child link="arm"/>'), "link 'arm'", "a tree"),
        (swap('<link name="tip"/>', '<link name="arm"/>'), "<link>", "a second link 'arm'"),
        (swap('<link name="tip"/>', '<link name="tip"/><link name="b"/>'), "urdf", "join all"),
        (
            swap(' velocity="1"', ""),
            "joint 'shoulder'",
            "<limit velocity=''>, expected 1 finite number;",
        ),
        (lambda text: re.sub("<limit.*?/>", "", text), "joint 'shoulder'", "found no <limit>"),
        (swap('xyz="0.3 0 0"', 'xyz="0.3 0"'), "joint 'insertion'", "3 finite numbers"),
        (swap('xyz="0.3 0 0"', 'xyz="nan 0 0"'), "joint 'insertion'", "3 finite numbers"),
        (swap('lower="0.0"', 'lower="1.0"'), "joint 'insertion', <limit>", "lower 1 above upper"),
        (weighing("nan"), "link 'tip', <inertial>", "1 finite number"),
        (weighing("x"), "link 'tip', <inertial>", "<mass value='x'>"),
        (weighing("-1"), "link 'tip', <inertial>", "found a mass of -1 kg, expected 0 kg or more"),
        (weighing("1", "nan 0 0"), "link 'tip', <inertial>", "3 finite numbers"),
        (weighing("1", ixx="inf"), "link 'tip', <inertial>", "<inertia ixx='inf'>"),
        (swap("<limit", '<dynamics damping="x"/><limit'), "robot.urdf", "not a readable URDF"),
    ],
)
def test_a_broken_urdf_is_refused_and_nothing_else_is_printed(
    tmp_path, capfd, change, where, words
):
    message = complaint(with_text(tmp_path, "robot.urdf", change, "slider"))
    assert where in message
    assert words in message
    assert capfd.readouterr() == ("", "")


def test_a_picture_that_nothing_looks_at_prints_nothing(tmp_path, capfd):
    change = swap('<link name="tip"/>', BROKEN_PICTURE)
    assert load_recording(with_text(tmp_path, "robot.urdf", change, "slider")).chain.n == 3
    assert capfd.readouterr() == ("", "")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    folder = write_folder(tmp_path / "r", "slider")
    (folder / "robot.urdf").rename(tmp_path / "robot.urdf")
    (folder / "robot.urdf").symlink_to(tmp_path / "robot.urdf")
    message = complaint(folder)
    assert "a path inside the folder" in message
    assert message.count("dataset.toml") == 1  # where it stands is said once


@pytest.mark.parametrize("name", ["no/such", "a\0b", "a" * 5000])
def test_a_missing_folder_is_named(tmp_path, name):
    assert "no such folder" in complaint(f"{tmp_path}/{name}")


@pytest.mark.parametrize("file", ["samples.csv", "dataset.toml"])
def test_a_missing_file_is_named_with_what_is_there(tmp_path, file):
    write_folder(tmp_path)
    (tmp_path / file).unlink()
    message = complaint(tmp_path)
    assert message.startswith(f"{file}: found no such file")
    (tmp_path / file).mkdir()
    assert "cannot be read" in complaint(tmp_path)


@pytest.mark.parametrize("file", ["samples.csv", "dataset.toml"])
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: data[:60] + b"\0" + data[60:], "zero byte"),
        (lambda data: data.decode().encode("utf-16"), "UTF-16"),
        (lambda data: b"# caf\xe9\n" + data, "row 1: found byte 0xe9, expected UTF-8"),
    ],
)
def test_what_is_not_utf8_text_is_refused(tmp_path, file, spoil, words):
    write_folder(tmp_path)
    path = tmp_path / file
    path.write_bytes(spoil(path.read_bytes()))
    assert words in complaint(tmp_path)


@pytest.mark.parametrize(
    ("observation", "header", "missing", "command"),
    [
        ("plane_range", "range,plane,motion", "plane", "plumbline handeye"),
        (
            "fiducials",
            "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z",
            "ct_y",
            "plumbline register",
        ),
        ("tracking", "time,u1,x1", "u1", "plumbline diagnose"),
    ],
)
def test_an_observation_of_another_command_is_sent_there(
    tmp_path, observation, header, missing, command
):
    write_folder(tmp_path, observation)
    row = ",".join("1" for _ in header.split(","))
    (tmp_path / "samples.csv").write_text(f"{header}\n{row}\n")
    message = complaint(tmp_path)
    assert "whose rows are read apart" in message
    assert command in message
    (tmp_path / "samples.csv").write_text(f"{header.replace(missing, 'other')}\n{row}\n")
    assert f"row 1, column {missing!r}" in complaint(tmp_path)


def test_names_of_effects_come_from_the_library_or_the_caller(tmp_path):
    folder = with_text(tmp_path, "dataset.toml", swap('"tool"]', '"tool", "backlash"]'))
    assert load_recording(folder).always == ("frame", "tool", "backlash")
    assert "'backlash'" in complaint(folder, known_effects=["other"])
