"""Outputs are there whole or not at all, and what becomes of the words costs no file."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from plumbline.experiments.commands.app import run
from plumbline.kinematics import files
from plumbline.kinematics.files import write_whole
from plumbline.optim.diagnosis import diagnose as diagnose_module
from tests.experiments.commands.test_command_line import ROOT
from tests.made_up_diagnosis import BENCH, made_up
from tests.refusals import refused

# The command line of a process of its own, its diagnosis made up.
DIAGNOSE = """
from plumbline.experiments.commands.app import main
from plumbline.optim.diagnosis import diagnose as module
from tests.made_up_diagnosis import made_up
module.diagnose = lambda recording, *_, **options: made_up(recording)
from plumbline.experiments.report import writing
writing.report_html = lambda *_, **__: "<html>" + chr(0x2014) * 1000 + "</html>"
main()
"""
ASCII = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}


def shell(redirected: str, *arguments: object, code: str = DIAGNOSE, **environment: str):
    """A command in a shell, its standard output redirected."""
    words = " ".join(f"'{word}'" for word in (sys.executable, "-c", code, *arguments))
    given = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = ["bash", "-c", f"{words} {redirected}"]
    return subprocess.run(command, env=given, capture_output=True, timeout=120, check=False)


def files_of(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize(
    ("redirected", "environment", "code", "line"),
    [
        ("> /dev/full", ASCII, 2, "plumbline: standard output: cannot be written (No space left"),
        (">&-", {}, 0, ""),
        ("| head -c 1 > /dev/null; exit ${PIPESTATUS[0]}", {}, 1, ""),
    ],
    ids=["full", "closed", "unread"],
)
def test_files_are_written_whatever_becomes_of_the_words(
    tmp_path, redirected, environment, code, line
):
    """An encoding without dashes, a full disk and a closed pipe once ended the whole diagnosis."""
    out, page = tmp_path / "out.json", tmp_path / "page.html"
    done = shell(redirected, "diagnose", BENCH, "--json", out, "--report", page, **environment)
    said = done.stderr.decode()
    assert said.startswith(line)
    assert said.count("\n") == bool(line)
    assert done.returncode == code or (code == 1 and done.returncode == 0)
    assert json.loads(out.read_text())["verdict"] == "explained"
    assert page.read_text().rstrip().endswith("</html>")
    assert files_of(tmp_path) == {"out.json", "page.html"}


def test_json_that_goes_nowhere_is_no_success_and_costs_no_report(tmp_path):
    page = tmp_path / "page.html"
    done = shell("> /dev/full", "diagnose", BENCH, "--json", "-", "--report", page)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    assert page.exists()


def test_words_that_an_encoding_lacks_are_question_marks():
    done = shell("", "diagnose", BENCH, **ASCII)
    assert done.returncode == 0
    assert done.stderr == b""
    assert b"Explained" in done.stdout
    assert done.stdout.isascii()
    assert b"?" in done.stdout


def test_a_closed_descriptor_is_taken_by_no_file():
    """The next file opened would have its number, and words would go into that file."""
    code = "from plumbline.experiments.console.streams import guard; guard(); "
    code += 'raise SystemExit(open("/dev/null").fileno() < 3)'
    done = shell("0<&- 1>&- 2>&-", code=code)
    assert done.returncode == 0


def test_a_folder_whose_name_is_no_text_is_diagnosed(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(diagnose_module, "diagnose", lambda recording, *_, **__: made_up(recording))
    folder = tmp_path / os.fsdecode(b"bench-\xff")
    shutil.copytree(BENCH, folder)
    toml = (folder / "dataset.toml").read_text()
    (folder / "dataset.toml").write_text(toml.replace('name = "bench-ur5"', ""))
    out, page = tmp_path / "out.json", tmp_path / "page.html"
    assert run(["diagnose", str(folder), "--json", str(out), "--report", str(page)]) == 0
    assert "bench-?" in page.read_text()
    assert out.exists()
    assert capfd.readouterr().err == ""


def test_a_write_that_fails_keeps_what_was_there(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.write_text("before")

    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(out, "after")
    assert out.read_text() == "before"
    assert files_of(tmp_path) == {"out"}


def test_a_write_that_is_interrupted_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(files.Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "out", "after")
    assert files_of(tmp_path) == set()


def test_a_written_file_keeps_its_mode_and_a_link_stays_one(tmp_path):
    out, link = tmp_path / "out", tmp_path / "link"
    write_whole(out, "first")
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(out.stat().st_mode) == 0o666 & ~mask
    out.chmod(0o640)
    link.symlink_to(out)
    write_whole(link, b"second")
    assert link.is_symlink()
    assert out.read_text() == "second"
    assert stat.S_IMODE(out.stat().st_mode) == 0o640


def test_text_that_no_encoding_has_is_written_all_the_same(tmp_path):
    write_whole(tmp_path / "out", "a\udcffb")
    assert (tmp_path / "out").read_text() == "a?b"


def test_a_pipe_or_a_device_is_written_to_as_it_is(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_whole(tmp_path / "pipe", "words")
    reader.join(timeout=10)
    assert read == ["words"]
    assert (tmp_path / "pipe").is_fifo()
    write_whole(os.devnull, "words")
    assert Path(os.devnull).is_char_device()


def test_writers_of_one_file_leave_the_whole_of_one(tmp_path):
    """Two processes, or threads, that write the same output never mix."""
    texts, failed = [str(k) * 200_000 for k in range(4)], []

    def write(text: str) -> None:
        try:
            for _ in range(5):
                write_whole(tmp_path / "out", text)
        except OSError as error:
            failed.append(error)

    writers = [threading.Thread(target=write, args=(text,)) for text in texts]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        if (tmp_path / "out").exists():
            assert (tmp_path / "out").read_text() in texts
    assert (tmp_path / "out").read_text() in texts
    assert not failed
    assert files_of(tmp_path) == {"out"}


def test_an_input_is_never_written_over_by_way_of_a_second_name(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(diagnose_module, "diagnose", lambda recording, *_, **__: made_up(recording))
    folder = Path(shutil.copytree(BENCH, tmp_path / "bench"))
    before = (folder / "samples.csv").read_bytes()
    (tmp_path / "soft").symlink_to(folder / "samples.csv")
    os.link(folder / "samples.csv", tmp_path / "hard")
    assert "never written to" in refused(capsys, "diagnose", folder, "--json", tmp_path / "soft")
    assert (
        run(["diagnose", str(folder), "--quiet", "--json", str(tmp_path / "hard"), "--overwrite"])
        == 0
    )
    assert (folder / "samples.csv").read_bytes() == before


def test_a_file_of_the_user_s_stays_and_an_earlier_output_is_replaced(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(diagnose_module, "diagnose", lambda recording, *_, **__: made_up(recording))
    out = tmp_path / "out.json"
    out.touch()  # as a script's temporary file
    command = ["diagnose", str(BENCH), "--quiet", "--json", str(out)]
    assert [run(command), run(command)] == [0, 0]
    written = out.read_bytes()
    figures = json.loads(written)
    assert figures.pop("generator") == "plumbline"
    for own in (b"mine", json.dumps(figures).encode(), json.dumps({"of": [figures]}).encode()):
        out.write_bytes(own)
        assert run(command) == 2
        assert out.read_bytes() == own
        assert "add --overwrite" in capsys.readouterr().err
    assert run([*command, "--overwrite"]) == 0
    assert out.read_bytes() == written
    earlier = json.dumps(figures).encode() + b"\n \n"  # before there was the key
    for ours in (json.dumps(json.loads(written)).encode(), earlier):
        out.write_bytes(ours)
        assert run(command) == 0
        assert out.read_bytes() == written
    listed = ["list", "--quiet", "--json", str(out)]
    assert [run(listed), run(listed)] == [0, 0]  # a list has no keys


@pytest.mark.parametrize("name", ["/sys/out.json", "/proc/out.json", "n" * 300])
def test_a_place_that_takes_no_file_is_refused_before_anything_is_computed(
    tmp_path, monkeypatch, capsys, name
):
    calls: list[object] = []
    monkeypatch.setattr(
        diagnose_module, "diagnose", lambda recording, *_, **__: calls.append(recording)
    )
    monkeypatch.chdir(tmp_path)
    if not Path(name).parent.is_dir():
        pytest.skip("no such place here")
    assert "--json" in refused(capsys, "diagnose", BENCH, "--json", name)
    assert not calls
    assert files_of(tmp_path) == set()
