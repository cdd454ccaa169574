"""Laws of a recording: what is good loads as written, from a folder and from arrays alike."""

import dataclasses
import re

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.loading import load_recording
from tests.recording_folders import (
    KINDS,
    ROWS,
    SETTINGS,
    TOOL,
    cell,
    columns,
    poses,
    postures,
    scaled,
    slider_columns,
    swap,
    with_columns,
    with_text,
    write_folder,
)

UR5 = Robot.bundled("ur5")


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_folder_loads_without_a_note(tmp_path, kind):
    """But for which joint is which column, where the chain is a part of the robot."""
    recording = load_recording(write_folder(tmp_path, kind))
    part = "joints are counted along the chain: joint 1 with q2, 2 with q3, 3 with q4"
    assert recording.notes == ((part,) if kind == "slider" else ())
    assert len(recording) == ROWS
    assert recording.measured.shape == (ROWS, {"pose": 7, "fixed_point": 0, "joint_position": 6}
                                        .get(kind, 3))  # fmt: skip


def test_every_column_arrives_where_it_belongs(tmp_path):
    recording = load_recording(write_folder(tmp_path))
    table = columns()
    written = np.column_stack([table[name] for name in ("q1", "q6", "x", "z")])
    read = np.column_stack([recording.q[:, [0, 5]], recording.measured[:, [0, 2]]])
    np.testing.assert_allclose(read, written, atol=1e-8)
    np.testing.assert_array_equal(recording.direction[:, 2], table["direction3"])
    np.testing.assert_array_equal(recording.time, table["time"])
    np.testing.assert_array_equal(recording.group, table["group"])
    np.testing.assert_array_equal(recording.held_out, table["held_out"] == 1)
    np.testing.assert_array_equal(recording.tool_offset, TOOL)
    assert recording.noise_std == 1e-4
    assert recording.always == ("frame", "tool")


def test_joints_off_the_chain_are_left_out(tmp_path):
    recording = load_recording(write_folder(tmp_path, "slider"))
    assert recording.chain.joint_names == ("shoulder", "insertion", "roll")
    names = [str(name) for name in recording.robot.model.names][1:]
    table = slider_columns()
    expected = [table[f"q{names.index(name) + 1}"] for name in recording.chain.joint_names]
    np.testing.assert_allclose(recording.q, np.column_stack(expected), atol=1e-8)


def test_a_folder_is_never_written_to(tmp_path):
    folder = write_folder(tmp_path / "r", "slider")
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*")}
    load_recording(folder)
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*")} == before


def test_line_ends_byte_order_marks_and_blank_lines_change_nothing(tmp_path):
    plain = load_recording(write_folder(tmp_path))
    for file in ("samples.csv", "dataset.toml"):
        text = (tmp_path / file).read_text() + "\n"
        (tmp_path / file).write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    other = load_recording(tmp_path)
    np.testing.assert_array_equal(plain.q, other.q)
    np.testing.assert_array_equal(plain.measured, other.measured)


def test_any_changed_byte_changes_the_hash(tmp_path):
    hashes = {load_recording(write_folder(tmp_path / kind, kind)).sha256 for kind in KINDS}
    urdf = with_text(tmp_path / "u", "robot.urdf", swap("0.4", "0.5"), "slider")
    hashes.add(load_recording(urdf).sha256)
    note = with_text(tmp_path / "t", "dataset.toml", lambda text: "# note\n" + text)
    hashes.add(load_recording(note).sha256)
    assert len(hashes) == len(KINDS) + 2


def test_dh_rows_are_the_bundled_robot(tmp_path):
    rows = [
        "[[robot.dh]]\n" + "".join(f"{k} = {getattr(row, k)!r}\n" for k in ("d", "a", "alpha"))
        for row in UR5.dh
    ]
    settings = SETTINGS.replace('bundled = "ur5"\n', "").replace("flange", "probe")
    write_folder(tmp_path)
    (tmp_path / "dataset.toml").write_text(settings + "\n" + "\n".join(rows))
    recording = load_recording(tmp_path)
    assert recording.tip_frame == "probe"
    ours, theirs = recording.chain.placement(recording.q), UR5.chain().placement(recording.q)
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_gravity_of_the_settings_is_the_robots(tmp_path):
    folder = with_text(tmp_path, "dataset.toml", swap("-9.81]", "9.81]"))
    assert load_recording(folder).robot.gravity[2] == 9.81
    assert load_recording(folder).chain.gravity[2] == 9.81


@pytest.mark.parametrize("listed", [True, False])
def test_joints_without_a_second_encoder_are_nan(tmp_path, listed):
    def change(table):
        return {k: v for k, v in table.items() if k not in ("m4", "m5")} | {"m6": table["m6"]}

    with_columns(tmp_path, change, "joint_position")
    text = (tmp_path / "samples.csv").read_text()
    for row in range(2, ROWS + 2):
        text = cell(row, "m6", "")(text)
    (tmp_path / "samples.csv").write_text(text)
    if listed:
        settings = (tmp_path / "dataset.toml").read_text()
        (tmp_path / "dataset.toml").write_text("measured_joints = [1, 3]\n" + settings)
    recording = load_recording(tmp_path)
    kept = (0, 2) if listed else (0, 1, 2)
    assert recording.measured_joints == kept
    assert np.isfinite(recording.measured).all(axis=0).nonzero()[0].tolist() == list(kept)


def test_quaternions_are_normalised(tmp_path):
    folder = with_columns(tmp_path, scaled(1.0005, "qw", "qx", "qy", "qz"), "pose")
    norms = np.linalg.norm(load_recording(folder).measured[:, 3:], axis=1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-14)


def test_a_distance_without_pairs_pairs_the_sockets_and_says_so(tmp_path):
    write_folder(tmp_path, "fixed_point")
    with (tmp_path / "dataset.toml").open("a") as file:
        file.write("[sockets]\ndistance = 0.05\n")
    recording = load_recording(tmp_path)
    assert recording.socket_pairs == ((0, 1), (2, 3))
    assert "pairs [0, 1], [2, 3]" in " ".join(recording.notes)
    with (tmp_path / "dataset.toml").open("a") as file:
        file.write("pairs = [[1, 2]]\n")
    assert load_recording(tmp_path).socket_pairs == ((1, 2),)
    assert load_recording(tmp_path).notes == ()


def test_time_may_start_anew_with_a_group(tmp_path):
    folder = with_columns(tmp_path, lambda t: t | {"time": np.arange(ROWS) % 10.0})
    assert "starts anew" in " ".join(load_recording(folder).notes)


def test_a_robot_that_disagrees_with_its_model_is_no_fault(tmp_path):
    def change(table):
        rng = np.random.default_rng(7)
        return table | {name: rng.permutation(table[name]) for name in "xyz"}

    assert len(load_recording(with_columns(tmp_path, change))) == ROWS


def test_a_gross_error_is_no_fault(tmp_path):
    folder = with_text(tmp_path, "samples.csv", cell(7, "x", "3.0"))
    assert load_recording(folder).measured[5, 0] == 3.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t | {"temprature": t["time"]}, "'temprature' is not used (did you mean 'temp"),
        (lambda t: t | {"x": np.repeat(t["x"][::2], 2)} | {f"q{j}": np.repeat(t[f"q{j}"][::2], 2)
         for j in range(1, 7)} | {c: np.repeat(t[c][::2], 2) for c in "yz"}, "20 rows repeat"),
        (lambda t: t | {"q6": np.full(ROWS, 0.3)}, "q6 never moves: what errs with"),
        (lambda t: t | {"temperature": np.full(ROWS, 71.0)}, "Fahrenheit?"),
        (lambda t: t | {"held_out": np.zeros(ROWS)}, "held_out marks no row"),
        (lambda t: t | {"held_out": np.arange(ROWS) % 4 == 0}, "partly held out"),
        (lambda t: t | {f"direction{j}": np.zeros(ROWS) for j in range(1, 7)}, "direction is 0"),
    ],
)  # fmt: skip
def test_what_is_odd_is_noted(tmp_path, change, words):
    assert words in " ".join(load_recording(with_columns(tmp_path, change)).notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("noise_std", "noise_sdt", "row 3, noise_sdt: not used (did you mean 'noise_std'?)"),
        ("tip_frame", "tip_farme", "[robot] tip_farme: not used (did you mean 'tip_frame'?)"),
        ("1.0e-4", "0.1", "row 3, noise_std: 0.1 m is coarse"),
        ("-9.81", "-1.62", "row 8, [robot] gravity: 1.62 m/s^2 is not the earth's"),
        ("[tool]\noffset = [0.01, 0.0, 0.12]\n", "", "no [tool] offset, taken as [0, 0, 0]"),
        ('"frame", "tool"', '"frame", "frame"', "'frame' is named twice"),
    ],
)
def test_odd_settings_are_noted(tmp_path, old, new, words):
    assert words in " ".join(
        load_recording(with_text(tmp_path, "dataset.toml", swap(old, new))).notes
    )


def test_a_joint_slightly_beyond_its_limit_is_noted(tmp_path):
    folder = with_text(tmp_path, "robot.urdf", swap('upper="0.25"', 'upper="0.20"'), "slider")
    assert "outside of the joint's limits 0 to 0.2" in " ".join(load_recording(folder).notes)


def arrays(**changes):
    q = postures()
    given = {"observation": "tip_position", "robot": UR5, "q": q, "measured": poses(UR5, q)[0]}
    return build_recording(**(given | {"tool_offset": TOOL} | changes))


def test_arrays_and_a_folder_make_the_same_recording(tmp_path):
    ours, theirs = arrays(noise_std=1e-4), load_recording(write_folder(tmp_path))
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-8)
    np.testing.assert_allclose(ours.measured, theirs.measured, atol=1e-8)
    assert (ours.tip_frame, ours.always) == (theirs.tip_frame, theirs.always)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": postures()[:, :5]}, "q: found shape (40, 5), expected (N, 6)"),
        ({"q": np.degrees(postures())}, "looks like degrees"),
        ({"measured": None}, "measured: found nothing"),
        ({"measured": np.full((ROWS, 3), np.nan)}, "row 0 (from 0), column 'measured1'"),
        ({"q": [["a"] * 6]}, "values that are no numbers"),
        ({"time": [1.0]}, "time: found shape (1,), expected (40,)"),
        ({"temprature": 3.0}, "best matches: temperature"),
        ({"observation": "tip"}, "best matches: motion, tip_position"),
        ({"tip_frame": "flang"}, "Best matches are flange"),
        ({"noise_std": "much"}, "noise_std"),
        ({"noise_std": float("nan")}, "noise_std"),
        ({"always": "frames"}, "best matches: frame"),
        ({"tool_offset": [0.0, 1.0]}, "tool_offset"),
        ({"held_out": np.full(ROWS, 3)}, "expected 0 or 1"),
        ({"observation": "fixed_point"}, "column 'socket': found nothing"),
    ],
)
def test_arrays_meet_the_same_checks(changes, words):
    with pytest.raises(PlumblineError, match=re.escape(words)) as caught:
        arrays(**changes)
    assert len(str(caught.value).splitlines()) == 1


def test_a_recording_cannot_be_changed(tmp_path):
    q = postures()
    recording = arrays(q=q)
    q[0, 0] = 9.0
    assert recording.q[0, 0] != 9.0
    with pytest.raises(ValueError, match="read-only"):
        recording.q[0, 0] = 9.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        recording.name = "other"


def test_select_keeps_rows_together(tmp_path):
    recording = load_recording(write_folder(tmp_path))
    mask = recording.group == 2
    part = recording.select(mask)
    assert len(part) == mask.sum() == 10
    for name in ("q", "measured", "time", "temperature", "direction", "group"):
        np.testing.assert_array_equal(getattr(part, name), getattr(recording, name)[mask])
    np.testing.assert_array_equal(part.tool_offset, recording.tool_offset)
    np.testing.assert_array_equal(recording.select([3, 1]).q, recording.q[[3, 1]])
    assert len(recording.select([])) == 0


@pytest.mark.parametrize("rows", [np.ones(3, dtype=bool), [99], [[0]], [0.5]])
def test_select_refuses_what_is_no_row(rows):
    with pytest.raises(PlumblineError, match="select"):
        arrays().select(rows)


def test_the_display_shows_no_markup_of_the_file(tmp_path):
    folder = with_text(tmp_path, "dataset.toml", swap('"bench"', '"<script>"'))
    recording = load_recording(folder)
    assert "<script>" not in recording._repr_html_()
    assert "&lt;script&gt;" in recording._repr_html_()
    assert "40, 10 held out, 4 groups" in recording.describe()
    assert "time, temperature, direction" in recording.describe()


def test_a_bundled_robot_may_be_given_by_its_name():
    arrays = {"observation": "joint_position", "q": np.eye(6)[:5], "measured": np.eye(6)[:5]}
    recording = build_recording(robot="ur5", **arrays)
    assert recording.robot.name == Robot.bundled("ur5").name
    with pytest.raises(PlumblineError, match="ur55"):
        build_recording(robot="ur55", **arrays)
