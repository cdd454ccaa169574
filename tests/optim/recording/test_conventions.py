"""Order, sense and unit of what was measured are told by the model, and what helps is named."""

import numpy as np
import pytest

import plumbline
from plumbline.optim.recording.disagreement import zeros_by_mounting
from plumbline.optim.recording.loading import load_recording
from tests.recording_folders import (
    ROWS,
    complaint,
    scaled,
    swap,
    with_columns,
    with_text,
    write_folder,
)

QUATERNION = ("qw", "qx", "qy", "qz")


def said(folder):
    """The notes of a recording, as one text."""
    return "\n".join(load_recording(folder).notes)


def written(*order, sense=1):
    """A change of the order of quaternions (``"xyzw"``), and of the sense of their turns."""

    def change(table):
        signs = {name: 1 if name == "qw" else sense for name in QUATERNION}
        cells = [signs[f"q{k}"] * table[f"q{k}"] for k in order]
        return table | dict(zip(QUATERNION, cells, strict=True))

    return change


@pytest.mark.parametrize(
    ("order", "sense", "words"),
    [
        ("xyzw", 1, "like x, y, z, w: put w first"),
        ("wxyz", -1, "like inverse rotations"),
        ("xyzw", -1, "like x, y, z, w of inverse rotations"),
        ("wxzy", 1, "swap qy and qz"),
        ("wyxz", 1, "swap qx and qy"),
        ("wzyx", 1, "swap qx and qz"),
        ("wyzx", 1, "put x second"),
        ("wzxy", 1, "put z last"),
        ("zyxw", 1, "turn their order round"),
    ],
)
def test_the_convention_of_quaternions_is_named(tmp_path, order, sense, words):
    message = complaint(with_columns(tmp_path, written(*order, sense=sense), "pose"))
    assert "column 'qw'" in message
    assert words in message
    assert " -- or " not in message


def test_quaternions_as_they_should_be_pass(tmp_path):
    assert "miss the model" not in said(write_folder(tmp_path, "pose"))


def test_where_the_tips_tell_nothing_every_possible_convention_is_named(tmp_path):
    line = {name: np.linspace(0.0, 0.3 if name == "x" else 1e-6, ROWS) for name in "xyz"}
    change = written(*"wxyz", sense=-1)
    message = complaint(with_columns(tmp_path, lambda t: change(t) | line, "pose"))
    assert "inverse rotations" in message


@pytest.mark.parametrize("factor", [1 / 0.0254, 100.0, 1000.0])
@pytest.mark.parametrize("kind", ["tip_position", "pose"])
def test_the_unit_of_the_tips_is_told(tmp_path, kind, factor):
    message = complaint(with_columns(tmp_path, scaled(factor, *"xyz"), kind))
    words = {100.0: "centimetres: divide", 1000.0: "millimetres: divide"}
    assert words.get(factor, "inches: multiply by 0.0254") in message


@pytest.mark.parametrize("kind", ["tip_position", "pose"])
def test_a_device_that_stood_still_is_called_that(tmp_path, kind):
    message = complaint(with_columns(tmp_path, scaled(0.0, *"xyz"), kind))
    assert "the same tip in most rows" in message
    assert "degrees" not in message


def test_second_encoders_that_stood_still_are_called_that(tmp_path):
    still = scaled(0.0, *(f"m{j}" for j in range(1, 7)))
    assert "the encoders stood still" in complaint(with_columns(tmp_path, still, "joint_position"))


def test_a_second_encoder_alone_may_stand_still(tmp_path):
    load_recording(with_columns(tmp_path, scaled(0.0, "m2"), "joint_position"))


@pytest.mark.parametrize("kind", ["tip_position", "pose", "joint_position"])
def test_noise_that_no_device_has_is_noted(tmp_path, kind):
    folder = with_text(tmp_path, "dataset.toml", swap("1.0e-4", "1.0e-12"), kind)
    assert "noise_std: 1e-12" in said(folder)
    assert "less than any device reads" in said(folder)


@pytest.mark.parametrize(
    ("columns", "scale", "words"),
    [
        ("y", 100.0, "column 'y': found y in another unit"),
        ("xz", 1e3, "column 'x': found x and z in another unit"),
        ("z", 1.0 / 0.0254, "looks like inches"),
    ],
)
def test_a_column_in_a_unit_of_its_own_is_named(tmp_path, columns, scale, words):
    def change(table):
        return table | {c: scale * table[c] for c in columns}

    assert words in complaint(with_columns(tmp_path, change))


def swapped(one, two):
    return lambda table: table | {one: table[two], two: table[one]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (swapped("q2", "q3"), "with q2 and q3 swapped"),
        (swapped("q1", "q5"), "with q1 and q5 swapped"),
        (scaled(-1.0, "q1"), "with the sign of q1 turned"),
        (scaled(-1.0, "q4"), "with the sign of q4 turned"),
    ],
)
@pytest.mark.parametrize("kind", ["tip_position", "pose"])
def test_columns_that_were_mixed_up_are_noted_by_name(tmp_path, kind, change, words):
    assert words in said(with_columns(tmp_path, change, kind))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (scaled(-1.0, "m2"), "m2 runs against q2"),
        (lambda t: t | {"m2": t["m2"] + 2 * np.pi}, "m2 is +1 whole turns off q2"),
        (lambda t: t | {"q3": t["q3"] / 9, "m3": t["q3"] / 9 - 2 * np.pi / 1.1}, "m3 is -1"),
    ],
)
def test_an_encoder_that_is_turned_round_or_turns_off_is_noted(tmp_path, change, words):
    assert words in said(with_columns(tmp_path, change, "joint_position"))
    assert said(with_columns(tmp_path, lambda t: t, "joint_position")) == ""


@pytest.mark.parametrize("first", [-np.pi, 0.0], ids=["from -pi", "from 0"])
def test_an_encoder_tells_its_angle_to_a_turn(tmp_path, first):
    def wide(table):
        return table | {"q2": 2.0 * table["q2"], "m2": 2.0 * table["m2"]}

    def wrapped(table):
        return (own := wide(table)) | {"m2": (own["m2"] + 0.9 - first) % (2 * np.pi) + first}

    plain, turned = (
        load_recording(with_columns(tmp_path / change.__name__, change, "joint_position"))
        for change in (wide, wrapped)
    )
    assert np.ptp(turned.measured[:, 1] - plain.measured[:, 1]) < 1e-6
    assert "m2 is whole turns off q2 in" in " ".join(turned.notes)
    assert "whole turns off" not in " ".join(plain.notes)


def test_second_encoders_may_be_mounted_at_any_angle(tmp_path):
    settings = 'name = "b"\nobservation = "joint_position"\nnoise_std = 1e-4\n'
    settings += '[robot]\nbundled = "ur5"\n[fit]\nalways = ["joint_offset"]\n'
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (6, ROWS))
    with_columns(
        tmp_path,
        lambda t: t | {f"m{j}": t[f"q{j}"] + 2.5 - 0.7 * j + noise[j - 1] for j in range(1, 7)},
        "joint_position",
    )
    (tmp_path / "dataset.toml").write_text(settings)
    answer = plumbline.diagnose(load_recording(tmp_path))
    assert answer.verdict.verdict == "no-gap"
    assert answer.verdict.outside_probability < 0.05
    zeros = answer.verdict.nuisances
    assert abs(zeros["joint_offset 1 offset"].value - 1.8) < 1e-3


def of_second_encoders(folder, zero, error=lambda q: 0.0):
    """Readings of encoders whose third one has a zero, and of joint 2 an error of its angle."""
    noise = np.random.default_rng(0).normal(0.0, 2e-5, (6, ROWS))

    def read(table):
        m = {f"m{j}": table[f"q{j}"] + noise[j - 1] for j in range(1, 7)}
        return table | m | {"m3": m["m3"] + zero, "m2": m["m2"] + error(table["q2"])}

    with_columns(folder, read, "joint_position")
    settings = 'name = "b"\nobservation = "joint_position"\nnoise_std = 2e-5\n'
    (folder / "dataset.toml").write_text(settings + '[robot]\nbundled = "ur5"\n')
    return load_recording(folder)


@pytest.mark.parametrize(("zero", "by_mounting"), [(0.09, False), (-0.11, True)])
def test_a_zero_beyond_what_a_joint_errs_by_is_a_second_encoder_s_mounting(
    tmp_path, zero, by_mounting
):
    taken = zeros_by_mounting(of_second_encoders(tmp_path, zero))
    assert ("joint_offset" in taken.always) == by_mounting
    assert any("m3 by -0.11 rad" in note for note in taken.notes) == by_mounting


def test_encoders_mounted_at_any_angle_hide_no_cause(tmp_path):
    given = of_second_encoders(tmp_path, 0.29, lambda q: 1e-4 * np.sin(2.0 * q))
    verdict = plumbline.diagnose(given).verdict
    assert [c.label for c in verdict.causes] == ["transmission_ripple of joint 2"]
    assert verdict.gap.before < 1e-4
    assert any("not judged" in note for note in verdict.notes)


def test_another_robot_is_noted_by_name(tmp_path):
    folder = with_text(tmp_path, "dataset.toml", swap('"ur5"', '"vs060"'))
    assert "with the robot ur5: mend this; diagnose refuses it unless forced" in said(folder)


def test_rows_that_no_simple_set_up_mends_are_noted(tmp_path):
    rng = np.random.default_rng(0)
    anywhere = {f"q{j}": rng.uniform(-2.5, 2.5, ROWS) for j in range(1, 7)}
    folder = with_columns(tmp_path, lambda table: table | anywhere)
    assert "joint order, joint signs, robot, tip frame or unit wrong?" in said(folder)


@pytest.mark.parametrize("tool", ["[0.0, 0.0, 0.0]", "[0.3, -0.2, 0.1]"])
def test_a_tool_that_is_fitted_is_no_disagreement(tmp_path, tool):
    folder = with_text(tmp_path, "dataset.toml", swap("[0.01, 0.0, 0.12]", tool))
    assert "miss the model" not in said(folder)


# Postures


def repeated(count):
    """The first so many postures over and over."""

    def change(table):
        rows = np.arange(ROWS) % count
        kept = {k: v[rows] for k, v in table.items() if k[0] in "qm" or k in ("x", "y", "z")}
        return kept

    return change


@pytest.mark.parametrize(("kind", "few", "enough"), [("tip_position", 3, 4), ("pose", 2, 3)])
def test_repeats_are_no_postures(tmp_path, kind, few, enough):
    message = complaint(with_columns(tmp_path, repeated(few), kind))
    assert f"{few} distinct postures in {ROWS} rows to fit, expected at least {enough}" in message
    notes = said(with_columns(tmp_path, repeated(enough), kind))
    assert f"{enough} distinct postures are few" in notes
    assert "distinct postures" not in said(with_columns(tmp_path, repeated(3 * enough), kind))
