"""A sweep diagnoses every combination of its options, once each, and says what they agree on."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.__main__ import run
from experiments.sweep import Case, part_of, read_spec, sweep
from optim.diagnosis import diagnose as diagnose_module
from optim.faults import RecordingError
from optim.loading import load_recording
from tests.made_up_diagnosis import BENCH, made_up
from tests.recording_folders import write_folder
from tests.test_command_line import refused
from tests.test_in_one_line import one_line

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

    def diagnose(recording, **options):
        calls.append((recording, options))
        return made_up(recording)

    monkeypatch.setattr(diagnose_module, "diagnose", diagnose)
    return calls


def test_every_combination_is_diagnosed_once(spec, quick):
    found = sweep(read_spec(spec), jobs=1)
    assert len(quick) == len(found.outcomes) == 16
    asked = {(o["seed"], o["held_out_by"], len(o["library"]), len(r)) for r, o in quick}
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


def test_processes_give_what_one_process_gives(spec):
    spec.write_text('recording = "bench"\n[vary]\nseed = [3]\nrows = [12]\n')
    one, two = (sweep(read_spec(spec), jobs=jobs) for jobs in (1, 2))
    assert one == two


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"bench"', '"nowhere"', "row 1, recording: found 'nowhere'"),
        ("recording", "folder", "row 1, folder"),
        ("seed", "seeds", "[vary] seeds: found 'seeds', expected seed, held_out"),
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
    with pytest.raises(RecordingError, match="a TOML file"):
        read_spec(tmp_path)
