"""A file that is none, has no end, or is built to take for ever is refused in one line, at once."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from plumbline.errors import PlumblineError, best_matches, listed
from plumbline.experiments.sweep.sweep import read_spec
from plumbline.kinematics.constants import MOST_ATTRIBUTES, MOST_JOINTS
from plumbline.kinematics.files import OddFileError, read_file
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording import table
from plumbline.optim.recording.constants import LARGEST_SETTINGS, MOST_PARTS
from plumbline.optim.recording.loading import LARGEST, load_recording
from plumbline.optim.recording.settings import read_settings
from tests.recording_folders import URDF, complaint, with_text, write_folder

FILES = ("dataset.toml", "samples.csv", "robot.urdf")
SECONDS = 5  # of processor that any refusal may take
STANDS = 60  # of time: on a busy machine it may have to wait


class HangError(Exception):
    """It took too long."""


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """A test that takes longer fails instead of standing still."""

    def stop(signum: int, frame: object) -> None:
        raise HangError

    kinds = (signal.SIGALRM, signal.SIGPROF)
    before = [signal.signal(kind, stop) for kind in kinds]
    signal.alarm(STANDS)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.alarm(0)
    for kind, handler in zip(kinds, before, strict=True):
        signal.signal(kind, handler)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def loop(path: Path) -> None:
    path.symlink_to(path)


def folder(path: Path) -> None:
    path.mkdir()


def huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**40)


def nowhere(path: Path) -> None:
    path.symlink_to(path.with_name("gone"))


ODD = {
    pipe: "a pipe", endless: "a device", folder: "a folder", huge: "MB are read",
    loop: "symbolic links", nowhere: "no such file",
}  # fmt: skip


@pytest.mark.parametrize("odd", ODD, ids=lambda odd: odd.__name__)
@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_none_is_refused_at_once(tmp_path, file, odd):
    write_folder(tmp_path, "slider")
    (tmp_path / file).unlink()
    odd(tmp_path / file)
    said = complaint(tmp_path)
    assert ODD[odd] in said or "inside the folder" in said
    assert file in said


@pytest.mark.parametrize("odd", ODD, ids=lambda odd: odd.__name__)
def test_a_spec_of_a_sweep_that_is_no_file_is_refused_at_once(tmp_path, odd):
    odd(tmp_path / "spec.toml")
    with pytest.raises(PlumblineError, match="a TOML file"):
        read_spec(tmp_path / "spec.toml")


@pytest.mark.parametrize("odd", [pipe, endless, huge], ids=lambda odd: odd.__name__)
def test_a_urdf_that_is_no_file_is_refused_at_once(tmp_path, odd):
    odd(tmp_path / "robot.urdf")
    with pytest.raises(PlumblineError, match="cannot be read"):
        Robot.from_urdf(tmp_path / "robot.urdf")


def test_a_file_of_exactly_the_largest_size_is_read(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 1000)
    assert read_file(path, 1000) == b"x" * 1000
    with pytest.raises(OddFileError, match="at most"):
        read_file(path, 999)


def test_a_file_that_says_nothing_of_its_size_is_read_up_to_the_largest():
    endless_text = Path("/proc/self/maps")  # regular, zero bytes long, and full
    if not endless_text.exists():
        pytest.skip("no such files here")
    assert endless_text.stat().st_size == 0
    assert read_file(endless_text)
    with pytest.raises(OddFileError, match="more than"):
        read_file(endless_text, 10)


def test_sizes_are_stated_and_enough():
    assert LARGEST == {"dataset.toml": 1_000_000, "samples.csv": 64_000_000}
    assert table.MOST_ROWS == 1_000_000
    assert table.MOST_COLUMNS == 10_000


@pytest.mark.parametrize(
    "text",
    [
        "[" + " " * 4000 + "x" * 4000, "[" * 50_000, "x = " + "[" * 50_000, "[ " * 20_000,
        "[" + "\t" * 100_000, '"' * 100_001, "x = {" * 20_000, "x = '''" + "'\n" * 50_000,
        ".".join("a" * 20_000) + " = 1", "x" * 500_000, "\\" * 100_000, "#" * 1_100_000,
        '"=".' + ".".join("a" * 20_000) + " = 1",
    ],
    ids=range(13),
)  # fmt: skip
def test_settings_are_read_in_time_that_grows_with_their_length(tmp_path, text):
    """Blanks after a bracket once took the cube of their number."""
    change = {"first": lambda t: text + "\n" + t, "last": lambda t: t + "\n" + text}
    for place in change.values():
        folder = with_text(tmp_path / str(len(os.listdir(tmp_path))), "dataset.toml", place)
        assert len(complaint(folder)) < 600


def test_blanks_after_a_bracket_hide_no_row(tmp_path):
    blanks = " " * 4000
    text = f'a = [{blanks}\n1]\n[{blanks}robot{blanks}]\n"tip_frame" = 3\nurdf.x = 1\n'
    settings = read_settings("dataset.toml", text.encode())
    robot = settings.section("robot")
    assert settings.where("robot") == "dataset.toml, row 3, robot"
    assert robot.where("tip_frame") == "dataset.toml, row 4, [robot] tip_frame"
    assert robot.where("urdf") == "dataset.toml, row 5, [robot] urdf"
    assert robot.where("tip") == "dataset.toml, [robot] tip"


def test_a_key_has_a_hundred_parts_at_most():
    read_settings("dataset.toml", (".".join("a" * MOST_PARTS) + " = 1").encode())
    with pytest.raises(PlumblineError, match="row 2: found a key of 101 parts"):
        read_settings("dataset.toml", ("\n" + ".".join("a" * (MOST_PARTS + 1)) + " = 1").encode())
    values = ", ".join(["0.5"] * 500)
    found = read_settings("dataset.toml", f'x = [{values}]\ny = "{"a." * 500} = 1"'.encode())
    assert len(found.values) == 2
    assert LARGEST_SETTINGS == 1_000_000


def chain_of(joints: int, kind: str = "revolute") -> str:
    """A URDF of so many joints, one after another."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    links = "".join(f'<link name="l{k}"/>' for k in range(joints + 1))
    return f'<robot name="long">{links}' + "".join(
        f'<joint name="j{k}" type="{"revolute" if k == 0 else kind}"><parent link="l{k}"/>'
        f'<child link="l{k + 1}"/><axis xyz="0 0 1"/>{limit}</joint>'
        for k in range(joints)
    ) + "</robot>"  # fmt: skip


@pytest.mark.parametrize("kind", ["revolute", "fixed"])
def test_a_robot_of_too_many_joints_is_refused_before_anything_walks_it(tmp_path, kind):
    """Of 5,000 joints, the reader's recursion ended the process."""
    folder = with_text(tmp_path, "robot.urdf", lambda t: chain_of(5000, kind), "slider")
    assert "5,000 joints, at most 500 expected" in complaint(folder)
    with pytest.raises(PlumblineError, match="at most 500"):
        Robot.from_urdf(chain_of(MOST_JOINTS + 1, kind))
    assert MOST_JOINTS == 500


def test_a_robot_of_as_many_joints_as_there_may_be_is_read():
    chain = Robot.from_urdf(chain_of(MOST_JOINTS)).chain()
    assert chain.n == MOST_JOINTS
    assert np.isfinite(chain.placement(np.zeros(chain.n))).all()


def test_a_table_of_too_many_links_is_refused(tmp_path):
    rows = "\n[[robot.dh]]\na = 0.1" * 5000
    folder = with_text(
        tmp_path, "dataset.toml", lambda t: t.replace('bundled = "ur5"', "").replace(
            "\n[tool]", f"{rows}\n[tool]"
        )
    )  # fmt: skip
    assert "5,000 DH rows, at most 500 expected" in complaint(folder)


ENTITIES = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
BOMB = f'<!DOCTYPE robot [<!ENTITY e0 "lol">{ENTITIES}]>'
XML = {
    "entities": lambda t: t.replace("<robot", f"{BOMB}<robot", 1).replace("slider", "&e9;"),
    "a file as an entity": lambda t: t.replace(
        "<robot", '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot', 1
    ).replace('<link name="base"/>', '<link name="base"/>&a;'),
    "attributes": lambda t: t.replace(
        '<link name="base"/>',
        '<link name="base" ' + " ".join(f'a{k}="1"' for k in range(100_000)) + "/>",
    ),
    "depth": lambda t: t.replace("</robot>", "<a>" * 100_000 + "</a>" * 100_000 + "</robot>"),
    "another encoding": lambda t: t.replace("?>", ' encoding="utf-16"?>'),
    "an unknown encoding": lambda t: t.replace("?>", ' encoding="klingon"?>'),
    "an encoding of several bytes": lambda t: t.replace("?>", ' encoding="big5"?>'),
    "a long name": lambda t: t.replace('<link name="tip"/>', f'<link name="{"t" * 100_000}"/>'),
    "a folder": lambda t: "file:///etc/passwd",
}  # fmt: skip


@pytest.mark.parametrize("name", XML)
def test_a_urdf_built_to_do_harm_is_refused_in_one_line(tmp_path, name):
    folder = with_text(tmp_path, "robot.urdf", XML[name], "slider")
    said = complaint(folder)
    assert len(said) < 600
    assert "root:" not in said
    assert MOST_ATTRIBUTES == 100


def test_a_table_of_too_many_columns_or_rows_is_refused(tmp_path, monkeypatch):
    wide = ",".join(f"c{k}" for k in range(1_000_000))
    assert "1,000,000 columns, expected at most 10,000" in complaint(
        with_text(tmp_path / "wide", "samples.csv", lambda t: wide + "\n" + t)
    )
    monkeypatch.setattr(table, "MOST_ROWS", 39)
    assert "more than 39 rows" in complaint(write_folder(tmp_path / "long"))
    monkeypatch.setattr(table, "MOST_ROWS", 40)
    assert len(load_recording(tmp_path / "long")) == 40


def test_many_columns_that_nothing_reads_are_a_few_notes(tmp_path):
    extra = [f"extra{k}" for k in range(320)] + ["x" * 5000]
    head, cells = ",".join(extra), ",".join("1" for _ in extra)

    def widened(text):
        first, *rows = text.rstrip("\n").split("\n")
        return "\n".join([f"{first},{head}", *(f"{row},{cells}" for row in rows)]) + "\n"

    notes = load_recording(with_text(tmp_path, "samples.csv", widened)).notes
    assert sum("extra" in note for note in notes) == 8
    assert "samples.csv: ... and 313 more columns are not used" in notes
    assert max(map(len, notes)) < 600


def test_half_a_number_at_the_end_of_a_file_is_refused():
    whole = b"q1,x\n0.5,0.123456\n0.6,0.654321\n0.7,0.246135"
    assert "was it cut short within '0.246135'?" in table.read_table("a.csv", whole).notes[0]
    assert table.read_table("a.csv", whole[:-3] + b"\n").notes == ()
    with pytest.raises(PlumblineError, match=r"a.csv, row 4: found '0.246' and no line end"):
        table.read_table("a.csv", whole[:-3])


def test_a_list_in_a_message_is_cut():
    assert listed(["a", "b"]) == "a, b"
    assert listed(range(8)) == "0, 1, 2, 3, 4, 5, 6, 7"
    assert listed(range(320)) == "0, 1, 2, 3, 4, 5, 6, 7 ... and 312 more"
    assert len(listed(["n" * 10_000] * 10_000)) < 500
    assert len(best_matches("nothing", (f"word{k}" for k in range(10_000)))) < 500
    assert "... and" in best_matches("+", (f"word{k}" for k in range(20)))


@pytest.mark.parametrize(
    "row", [{"m" * 50_000: 0.0}, {"k\ney": 0.0}, {"kind": "r" * 50_000}, {"kind": ["r"] * 50_000}]
)
def test_what_a_dh_row_holds_beside_its_keys_is_told_in_short(row):
    with pytest.raises(PlumblineError) as caught:
        Robot.from_dh([{"d": 0.1, "kind": "revolute"} | row])
    assert len(str(caught.value)) < 300
    assert str(caught.value).isprintable()


def test_names_of_any_length_are_compared_in_no_time():
    long = ["a" * 50_000 + str(k) for k in range(50)]
    assert len(best_matches("a" * 50_001, long)) < 600
    with pytest.raises(PlumblineError) as caught:
        Robot.from_urdf(URDF.replace('"tip"', f'"{"t" * 50_000}"')).chain("t" * 49_999)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "q", [np.zeros(5), np.zeros((3, 7)), np.zeros((2, 3, 6)), "x", [[1], [1, 2]], 0.0]
)
def test_a_posture_of_another_length_is_refused_in_one_line(q):
    chain = Robot.bundled("ur5").chain()
    for asked in (chain.placement, lambda q: chain.tips(q, np.zeros(3))):
        with pytest.raises(PlumblineError, match="expected N x 6 numbers") as caught:
            asked(q)
        assert len(str(caught.value).splitlines()) == 1
    assert chain.placement(np.zeros(6)).shape == (1, 4, 4)
    assert chain.placement(np.zeros((0, 6))).shape == (0, 4, 4)


def test_a_folder_whose_name_is_no_text_is_read_and_named(tmp_path):
    if sys.platform == "darwin":
        pytest.skip("no such names here")
    folder = write_folder(tmp_path / os.fsdecode(b"bench-\xff"))
    (folder / "dataset.toml").write_text(
        (folder / "dataset.toml").read_text().replace('name = "bench"\n', "")
    )
    recording = load_recording(folder)
    assert recording.name == "bench-?"
    assert recording.name.encode()
