"""A sweep diagnoses every combination of its options, once each, and says what they agree on."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from joblib import parallel_config, register_parallel_backend
from joblib.parallel import ThreadingBackend

from plumbline.errors import PlumblineError
from plumbline.experiments.commands import sweep as command
from plumbline.experiments.commands.app import run
from plumbline.experiments.console.workers import done_by
from plumbline.experiments.sweep.recorded import Case, part_of
from plumbline.experiments.sweep.spec import read_spec
from plumbline.experiments.sweep.sweep import keeping, key_of, sweep
from plumbline.optim.diagnosis import diagnose as diagnose_module
from plumbline.optim.recording.loading import load_recording
from tests.experiments.commands.test_command_line import ROOT
from tests.experiments.commands.test_in_one_line import one_line
from tests.made_up_diagnosis import BENCH, made_up
from tests.recording_folders import write_folder
from tests.refusals import refused

SPEC = """recording = "bench"
[vary]
seed = [0, 7]
held_out = ["rows", "workspace"]
without = [[], ["backlash", "latency"]]
rows = [30, 60]
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    """A spec beside the bundled recording."""
    shutil.copytree(BENCH, tmp_path / "bench")
    (tmp_path / "spec.toml").write_text(SPEC)
    return tmp_path / "spec.toml"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """Diagnoses are made up; returns rows and options of every call."""
    calls: list[tuple] = []

    def diagnose(recording, options):
        calls.append((recording, options))
        return made_up(recording)

    monkeypatch.setattr(diagnose_module, "diagnose", diagnose)
    return calls


def test_every_combination_is_diagnosed_once(spec, quick):
    found = sweep(read_spec(spec), jobs=1)
    assert len(quick) == len(found.outcomes) == 16
    asked = {(o.seed, o.held_out, len(o.effects), len(r)) for r, o in quick}
    full = max(length for _, _, length, _ in asked)
    assert asked == {
        (seed, kind, full - left, rows)
        for seed in (0, 7) for kind in ("rows", "workspace") for left in (0, 2)
        for rows in (30, 60)
    }  # fmt: skip
    assert found.varied == ("seed", "held_out", "without", "rows")
    assert found.agreement == "explained in 16 of 16; first joint_compliance of joint 2 in 16 of 16"
    one_line(found)


def test_rows_are_drawn_by_the_seed_and_held_out_rows_stay(tmp_path):
    recording = load_recording(BENCH)
    draws = [part_of(recording, Case(seed=seed, rows=30)).measured for seed in (1, 1, 2)]
    assert len(np.unique(draws[0], axis=0)) == 30
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])
    assert part_of(recording, Case()) is recording
    apart = load_recording(write_folder(tmp_path))
    part = part_of(apart, Case(rows=12))
    assert len(part) - 12 == part.held_out.sum() == apart.held_out.sum() > 0


class Counting(ThreadingBackend):
    """A backend that nobody's package brings, and what it was given."""

    given = 0
    supports_return_generator = True

    def submit(self, func, callback=None):
        Counting.given += 1
        return super().submit(func, callback)


def test_any_backend_that_joblib_knows_does_the_cases(spec, quick):
    register_parallel_backend("counting", Counting)
    alone = sweep(spec, jobs=1)
    with parallel_config(backend="counting", n_jobs=2):
        found = sweep(spec, jobs=None)
    assert Counting.given == len(found.outcomes) == len(quick) / 2
    assert [o.case for o in found.outcomes] == [o.case for o in alone.outcomes]
    assert found.outcomes == alone.outcomes


def test_options_that_do_not_fit_the_rows_are_told_in_the_table(spec, quick, capsys):
    spec.write_text(SPEC.replace('"workspace"', '"groups"').replace("rows = [30, 60]", ""))
    lines = (spec.parent / "bench" / "samples.csv").read_text().splitlines()
    keep = [k for k, name in enumerate(lines[0].split(",")) if name != "group"]
    text = "\n".join(",".join(line.split(",")[k] for k in keep) for line in lines)
    (spec.parent / "bench" / "samples.csv").write_text(text + "\n")
    assert run(["sweep", str(spec), "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    assert "refused: held out by groups: no column" in said
    assert "4 of 8" in said


def test_the_command_prints_and_writes_every_case(spec, quick, tmp_path, capsys):
    out = tmp_path / "out.csv"
    before = (tmp_path / "bench" / "samples.csv").read_bytes()
    assert run(["sweep", str(spec), "--jobs", "1", "--csv", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Explained in 16 of 16; first joint_compliance" in said
    rows = list(csv.DictReader(io.StringIO(out.read_text())))
    assert len(rows) == 16
    assert {row["without"] for row in rows} == {"", "backlash latency"}
    assert run(["sweep", str(spec), "--jobs", "1", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"seed", "held_out", "without", "rows", "verdict", "cause", "probability", "before",
            "after", "unit"} <= set(found["cases"][0])  # fmt: skip
    assert (tmp_path / "bench" / "samples.csv").read_bytes() == before


def test_processes_give_what_one_process_gives():
    assert sorted(done_by(math.sqrt, [4.0, 9.0, 16.0], 2)) == [2.0, 3.0, 4.0]


def test_cases_stand_in_their_order_whichever_is_done_first(spec, quick, monkeypatch):
    def backwards(work, tasks, jobs):
        return map(work, tasks[::-1])

    straight = sweep(read_spec(spec), jobs=1)
    monkeypatch.setattr("plumbline.experiments.sweep.sweep.done_by", backwards)
    assert sweep(read_spec(spec), jobs=2) == straight
    assert quick[0][1].seed == quick[-1][1].seed != quick[16][1].seed


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"bench"', '"nowhere"', "row 1, recording: found 'nowhere'"),
        ("recording", "folder", "row 1, folder"),
        ("seed", "seeds", "[vary] seeds: found the key 'seeds', expected seed, held_out"),
        ("[0, 7]", "[-1]", "row 3, [vary] seed"),
        ("[0, 7]", "[]", "row 3, [vary] seed"),
        ("[0, 7]", '"all"', "row 3, [vary] seed"),
        ('"workspace"', '"moon"', "row 4, [vary] held_out"),
        ('["backlash", "latency"]', '["backlsh"]', "best matches: backlash"),
        ('["backlash", "latency"]', '"backlash"', "row 5, [vary] without"),
        ("[30, 60]", "[0]", "row 6, [vary] rows"),
        ("[30, 60]", "[91]", "91 rows asked for, expected at most 90"),
        ("[30, 60]", "[3]", "3 rows to fit, expected at least 4"),
        ("[0, 7]", str(list(range(2000))), "2000 x 2 x 2 x 2 cases"),
        ("[vary]", "[vary", "broken TOML"),
    ],
)
def test_what_cannot_be_swept_is_one_line(spec, quick, capsys, old, new, words):
    assert old in SPEC
    spec.write_text(SPEC.replace(old, new, 1))
    assert words in refused(capsys, "sweep", spec, "--jobs", "1")
    assert not quick


def test_outputs_go_neither_into_the_recording_nor_over_the_spec(spec, quick, capsys):
    inside = spec.parent / "bench" / "out"
    for option in ("--json", "--csv"):
        assert "never written to" in refused(capsys, "sweep", spec, option, inside)
        assert "both name" in refused(capsys, "sweep", spec, option, spec)
    assert "name a file" in refused(capsys, "sweep", spec, "--csv", "-")
    assert "check the path" in refused(capsys, "sweep", "/no/such.toml")
    assert spec.read_text() == SPEC
    assert not quick


def test_a_spec_that_is_a_folder_is_refused(tmp_path):
    with pytest.raises(PlumblineError, match="a TOML file"):
        read_spec(tmp_path)


def interrupted_after(count, monkeypatch):
    """Diagnoses are made up, and the process is interrupted after so many."""
    calls: list[int] = []

    def diagnose(recording, options):
        if len(calls) == count:
            raise KeyboardInterrupt
        calls.append(options.seed)
        return made_up(recording)

    monkeypatch.setattr(diagnose_module, "diagnose", diagnose)
    return calls


def test_a_sweep_that_was_ended_goes_on_where_it_was(spec, monkeypatch, tmp_path, capsys):
    out = tmp_path / "out.csv"
    command = ["sweep", str(spec), "--jobs", "1", "--csv", str(out)]
    calls = interrupted_after(5, monkeypatch)
    assert run(command) == 130
    assert "interrupted" in capsys.readouterr().err
    # What is done can be read at once.
    assert len(list(csv.DictReader(io.StringIO(out.read_text())))) == 5
    kept = tmp_path / "out.csv.part"
    assert kept.read_text().count("\n") == 1 + 5
    # A line that was cut short, as a kill may leave it, is diagnosed again.
    lines = kept.read_text().splitlines()
    kept.write_text("\n".join(lines[:5]) + "\n" + lines[5][:40])
    calls = interrupted_after(1000, monkeypatch)
    assert run(command) == 0
    assert len(calls) == 16 - 4
    rows = list(csv.DictReader(io.StringIO(out.read_text())))
    options = [tuple(row[k] for k in ("seed", "held_out", "without", "rows")) for row in rows]
    assert len(set(options)) == len(options) == 16
    assert not kept.exists()
    # What one sweep in one go would have written.
    assert run([*command[:-1], str(tmp_path / "again.csv")]) == 0
    assert (tmp_path / "again.csv").read_text() == out.read_text()


def test_tables_as_they_stand_take_a_fiftieth_of_the_time(monkeypatch, tmp_path):
    now = [0.0]

    def as_csv(found):
        now[0] += 1.0
        return ""

    monkeypatch.setattr(command, "monotonic", lambda: now[0])
    monkeypatch.setattr(command, "as_csv", as_csv)
    tables = command.Tables(tmp_path / "t.csv", None)
    for _ in range(1490):  # cases of 0.1 s: written at the first one, then once in 50 s
        now[0] += 0.1
        tables.stand(lambda: None)
    assert now[0] == pytest.approx(149.0 + 3.0)


def test_cases_of_another_recording_or_code_are_left_alone(spec, quick, tmp_path, capsys):
    kept = tmp_path / "out.json.part"
    arguments = ("sweep", spec, "--jobs", "1", "--json", tmp_path / "out.json")
    for text, words in (
        ('{"recording": "abc", "code": "x"}\n', "cases of another recording"),
        ("not JSON\n", "no cases of a sweep"),
        ("[" * 100_000 + "\n", "no cases of a sweep"),
        ("3\n", "no cases of a sweep"),
    ):
        kept.write_text(text)
        said = refused(capsys, *arguments)
        assert words in said
        assert "delete it, or name another output" in said
        assert kept.read_text() == text
    kept.unlink()
    with keeping(kept, {"recording": load_recording(BENCH).sha256, "code": "old"}):
        assert "a sweep at work" in refused(capsys, *arguments)
    assert "cases of another code" in refused(capsys, *arguments)
    assert not quick
    kept.unlink()
    os.mkfifo(kept)
    assert "name another output" in refused(capsys, *arguments)


def test_a_kept_line_that_is_no_case_is_named(spec, quick, tmp_path, capsys):
    with keeping(tmp_path / "out.json.part", key_of(load_recording(BENCH))) as kept:
        kept.add({"seed": 1})
    arguments = ("sweep", spec, "--jobs", "1", "--json", tmp_path / "out.json")
    assert "row 2: found no case of a sweep" in refused(capsys, *arguments)


def test_a_case_that_is_asked_for_twice_is_diagnosed_once(spec, quick):
    spec.write_text('recording = "bench"\n[vary]\nseed = [3, 3, 3]\n')
    found = sweep(read_spec(spec), jobs=1)
    assert len(quick) == 1
    assert len(found.outcomes) == 3


def test_a_sweep_whose_every_case_is_refused_is_no_success(spec, quick, tmp_path, capsys):
    spec.write_text('recording = "bench"\n[vary]\nheld_out = ["groups"]\n')
    samples = spec.parent / "bench" / "samples.csv"
    samples.write_text(samples.read_text().replace("group", "batch"))
    out = tmp_path / "out.json"
    said = refused(capsys, "sweep", spec, "--jobs", "1", "--json", out)
    assert "all 1 cases were refused: held out by groups" in said
    assert json.loads(out.read_text())["cases"][0]["verdict"] == "refused"
    assert not (tmp_path / "out.json.part").exists()


SLOW = """
import time, sys, os
from plumbline.experiments.console.workers import done_by
def work(task):
    print("at work", os.getpid(), flush=True)
    time.sleep(600)
if __name__ == "__main__":
    list(done_by(work, [1, 2, 3], 2))
"""


@pytest.mark.parametrize("ended_by", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_process_outlives_the_one_that_started_it(tmp_path, ended_by):
    (tmp_path / "slow.py").write_text(SLOW)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    command = [sys.executable, "-c", "import slow; list(slow.done_by(slow.work, [1, 2, 3], 2))"]
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    workers = [int(process.stdout.readline().split()[-1]) for _ in range(2)]
    assert all(alive(worker) for worker in workers)
    until = time.monotonic() + 30
    while process.poll() is None and time.monotonic() < until:
        # Again, as a hand does: Python drops an interrupt that falls into a finaliser.
        process.send_signal(ended_by)
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=5)
    assert process.returncode is not None
    until = time.monotonic() + 20
    while any(alive(worker) for worker in workers) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(alive(worker) for worker in workers)
    process.stdout.close()


def alive(number):
    """Whether a process runs; one that has ended and is not yet waited for does not."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
