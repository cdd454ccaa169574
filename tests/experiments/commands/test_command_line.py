"""A command ends with 0, or with 2 and one line; a recording's folder is never written into."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import app, run
from plumbline.experiments.commands.examples import EXAMPLES
from plumbline.kinematics.effects import EFFECTS, MOTION_EFFECTS
from plumbline.optim.diagnosis import diagnose as diagnose_module
from plumbline.optim.diagnosis.options import DiagnosisOptions
from tests.made_up_diagnosis import BENCH, made_up
from tests.recording_folders import write_folder
from tests.refusals import refused

ROOT = Path(__file__).resolve().parents[3]
CONTRACT = {
    "verdict", "gap", "where", "causes", "candidates", "outside_probability", "unobservable",
    "next",
}  # fmt: skip
GAP = {"unit", "before", "after", "noise_floor", "shrink", "shrink_ci95", "held_out"}
CAUSE = {
    "effect", "stage", "element", "probability", "parameters", "before", "after", "confounded_with",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The bundled recording, in a folder of its own."""
    return Path(shutil.copytree(BENCH, tmp_path / "bench"))


def test_the_shell_completes_names_of_effects():
    begun = "plumbline diagnose my-run --without transmission_"
    asked = {"_PLUMBLINE_COMPLETE": "complete_bash", "COMP_WORDS": begun, "COMP_CWORD": "4"}
    said = subprocess.run(
        [sys.executable, "-m", "plumbline"],
        env=os.environ | asked,
        capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    assert said.split() == ["transmission_ripple"]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[DiagnosisOptions]:
    """Diagnoses are made up; returns the options of every call."""
    calls: list[DiagnosisOptions] = []

    def diagnose(recording, options, *, progress=None):
        calls.append(options)
        return made_up(recording)

    monkeypatch.setattr(diagnose_module, "diagnose", diagnose)
    return calls


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Bytes and time of change of every file, and the folder's own."""
    files = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in sorted(folder.iterdir())}
    return files | {".": (b"", folder.stat().st_mtime_ns)}


def test_a_terminal_without_a_width_is_told_all_the_same(folder):
    said = subprocess.run(
        [sys.executable, "-m", "plumbline", "check", str(folder)],
        env=os.environ | {"COLUMNS": "0"}, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "tip_position" in said


def test_a_diagnosis_has_the_contract_s_keys(folder, quick, tmp_path, capsys):
    out = tmp_path / "verdict.json"
    assert run(["diagnose", str(folder), "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    assert set(found) >= CONTRACT
    assert set(found["gap"]) >= GAP
    assert set(found["causes"][0]) >= CAUSE
    assert set(found["where"][0]) == {"stage", "element", "share"}
    assert set(found["causes"][0]["parameters"]["compliance"]) >= {"value", "std", "unit"}
    assert ": Explained" in capsys.readouterr().out


def test_json_on_standard_output_is_alone_there(folder, quick, capsys):
    assert run(["diagnose", str(folder), "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["verdict"] == "explained"
    assert err == ""


def test_quiet_says_nothing(folder, quick, tmp_path, capsys):
    report = tmp_path / "report.html"
    assert run(["diagnose", str(folder), "--quiet", "--report", str(report)]) == 0
    assert capsys.readouterr() == ("", "")
    assert report.read_text().startswith("<!DOCTYPE html>")


def test_options_reach_the_diagnosis(folder, quick):
    options = ["--seed", "7", "--held-out", "workspace", "--without", "latency", "--force"]
    options += ["--unlisted", "0.05"]
    assert run(["diagnose", str(folder), "--quiet", *options]) == 0
    assert quick == [DiagnosisOptions("workspace", 7, ("latency",), unlisted=0.05, force=True)]


@pytest.mark.parametrize("share", ["0", "1", "1.5", "nan"])
def test_what_the_library_lacks_has_a_probability(share, folder, quick, capsys):
    message = refused(capsys, "diagnose", folder, "--unlisted", share)
    assert "--unlisted" in message
    assert "between 0 and 1" in message
    assert not quick


def test_an_unknown_effect_cannot_be_left_out(folder, quick, capsys):
    message = refused(capsys, "diagnose", folder, "--without", "backlsh")
    assert "'backlsh' not recognised. Best matches are backlash" in message
    assert not quick


def test_a_name_like_no_effect_s_gets_a_few_names_and_where_all_are(folder, quick, capsys):
    message = refused(capsys, "diagnose", folder, "--without", "foo")
    assert sum(effect.name in message for effect in EFFECTS) >= 3
    assert len(message) < 400
    assert "plumbline list --effects" in message
    part = refused(capsys, "diagnose", folder, "--without", "sag")
    assert "Best matches are needle_sag;" in part


def test_the_model_is_tried_on_another_recording(folder, quick, tmp_path, capsys):
    other = write_folder(tmp_path / "other")
    assert run(["diagnose", str(folder), "--also", str(other), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    told = {"recording", "rows", "unit", "before", "after", "notes", "refitted", "outside_range"}
    assert set(found["transfer"]) == told
    assert found["transfer"]["after"] == pytest.approx(found["gap"]["before"] / 2)
    assert run(["diagnose", str(folder), "--also", str(other)]) == 0
    assert "On bench (40 rows)" in capsys.readouterr().out


def test_another_robot_s_recording_cannot_try_the_model(folder, quick, tmp_path, capsys):
    other = write_folder(tmp_path / "other")
    toml = (other / "dataset.toml").read_text()
    assert 'bundled = "ur5"' in toml
    (other / "dataset.toml").write_text(toml.replace('bundled = "ur5"', 'bundled = "ur10"'))
    message = refused(capsys, "diagnose", folder, "--also", other)
    assert "robot ur10 with joints placed or turning otherwise, expected ur5" in message


def test_what_is_set_up_otherwise_cannot_try_the_model_unless_forced(
    folder, quick, tmp_path, capsys
):
    other = write_folder(tmp_path / "other")
    text = (other / "samples.csv").read_text()
    (other / "samples.csv").write_text(text.replace("q1,q2,q3", "q2,q1,q3"))
    message = refused(capsys, "diagnose", folder, "--also", other)
    assert "with q1 and q2 swapped; mend it, or take it as it is with --force" in message
    assert run(["diagnose", str(folder), "--also", str(other), "--force"]) == 0


def test_another_kind_of_recording_cannot_try_the_model(folder, quick, tmp_path, capsys):
    pose, slider = (write_folder(tmp_path / kind, kind) for kind in ("pose", "slider"))
    assert "observation pose, expected tip_position" in refused(
        capsys, "diagnose", folder, "--also", pose
    )
    assert "joints 3, expected 6" in refused(capsys, "diagnose", folder, "--also", slider)
    assert not quick


def test_a_recording_s_folder_is_never_written_into(folder, quick, tmp_path, capsys):
    before = contents(folder)
    outputs = ["--json", str(tmp_path / "a.json"), "--report", str(tmp_path / "a.html")]
    assert run(["diagnose", str(folder), *outputs]) == 0
    assert run(["check", str(folder)]) == 0
    capsys.readouterr()
    (tmp_path / "link").symlink_to(folder)
    other = write_folder(tmp_path / "other")
    for option in ("--json", "--report"):
        for place in (folder, tmp_path / "link", tmp_path / "other" / ".." / "bench"):
            line = refused(capsys, "diagnose", folder, option, place / "out")
            assert "never written to" in line
        refused(capsys, "diagnose", folder, "--also", other, option, other / "out")
    refused(capsys, "check", folder, "--json", folder / "samples.csv")
    assert contents(folder) == before
    assert not (other / "out").exists()


def test_outputs_are_refused_before_anything_is_computed(folder, quick, tmp_path, capsys):
    line = refused(capsys, "diagnose", folder, "--json", tmp_path / "nowhere" / "a.json")
    assert "make it first" in line
    assert "is a folder" in refused(capsys, "diagnose", folder, "--report", tmp_path)
    same = tmp_path / "same"
    assert "both name" in refused(capsys, "diagnose", folder, "--json", same, "--report", same)
    refused(capsys, "diagnose", folder, "--json", "a\0b")
    assert not quick


def test_only_json_goes_to_standard_output(folder, quick, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for command in (["diagnose", folder, "--report"], ["register", folder, "--tfm"],
                    ["next", folder, "--csv"]):  # fmt: skip
        assert "name a file" in refused(capsys, *command, "-")
    assert not quick
    assert not (tmp_path / "-").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["diagnose", "/no/such/folder"], "no such folder"),
        (["diagnose"], "Missing argument"),
        (["diagnose"], "try 'plumbline diagnose --help'"),
        (["withheld", "score", "--nonsense"], "try 'plumbline withheld score --help'"),
        (["frobnicate"], "try 'plumbline --help'"),
        (["diagnose", BENCH, "--held-out", "moon"], "--held-out"),
        (["diagnose", BENCH, "--seed", "x"], "--seed"),
        (["diagnose", BENCH, "--seed", "-1"], "--seed"),
        (["diagnose", BENCH, "--nonsense"], "--nonsense"),
        (["diagnose", BENCH, "extra"], "extra"),
        (["check", "/no/such/folder"], "no such folder"),
        (["check", "a\nb"], "no such folder"),
        (["fetch", "no-such-name"], "not recognised"),
        (["frobnicate"], "frobnicate"),
    ],
)
def test_a_bad_command_line_is_one_line(arguments, words, capsys):
    assert words in refused(capsys, *arguments)


def test_a_fault_of_the_recording_is_one_line_that_names_the_place(folder, capsys):
    text = (folder / "samples.csv").read_text().replace("-1.34001287", "abc", 1)
    (folder / "samples.csv").write_text(text)
    line = refused(capsys, "diagnose", folder)
    assert "samples.csv, row 2, column 'q1'" in line


def test_groups_that_are_not_there_cannot_be_left_out(quick, tmp_path, capsys):
    folder = write_folder(tmp_path / "plain")
    header, *rows = (folder / "samples.csv").read_text().splitlines()
    keep = [i for i, name in enumerate(header.split(",")) if name not in ("group", "held_out")]
    lines = [",".join(row.split(",")[i] for i in keep) for row in (header, *rows)]
    (folder / "samples.csv").write_text("\n".join(lines) + "\n")
    assert "group" in refused(capsys, "diagnose", folder, "--held-out", "groups")


def test_errors_of_the_data_are_one_line_wherever_they_arise(folder, monkeypatch, capsys):
    def fails(recording, options, *, progress=None):
        raise PlumblineError("two\nlines \x1b[31m")

    monkeypatch.setattr(diagnose_module, "diagnose", fails)
    assert "two lines ?[31m" in refused(capsys, "diagnose", folder)


def test_a_defect_of_ours_is_not_blamed_on_the_data(folder, monkeypatch):
    def fails(recording, options, *, progress=None):
        raise ValueError("a defect")

    monkeypatch.setattr(diagnose_module, "diagnose", fails)
    with pytest.raises(ValueError, match="a defect"):
        run(["diagnose", str(folder), "--quiet"])


def test_an_interrupt_is_one_line(folder, monkeypatch, capsys):
    def interrupted(recording, options, *, progress=None):
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnose_module, "diagnose", interrupted)
    assert run(["diagnose", str(folder)]) == 130
    assert capsys.readouterr() == ("", "plumbline: interrupted\n")


def test_a_file_that_cannot_be_written_is_one_line(folder, quick, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("no device that is always full")
    assert "cannot be written" in refused(capsys, "diagnose", folder, "--json", "/dev/full")


def test_check_describes_a_recording(folder, tmp_path, capsys):
    assert run(["check", str(folder)]) == 0
    assert "tip_position" in capsys.readouterr().out
    assert run(["check", str(folder), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rows"] == 90
    assert found["name"] == "bench-ur5"


ELSEWHERE = {
    "fiducials": (
        "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z\n"
        "a,marker,0,0,0,1,0,0\nb,marker,0.1,0,0,1.1,0,0\nc,marker,0,0.1,0,1,0.1,0\n"
        "t,target,0.05,0.05,0,,,\n",
        "plumbline register",
    ),
    "tracking": (
        "time,u1,x1\n" + "".join(f"{k / 50},0,0.{k % 9}\n" for k in range(60)),
        "plumbline diagnose",
    ),
    "plane_range": (
        "px,py,pz,qw,qx,qy,qz,range,plane,motion\n"
        + "".join(f"{k / 50},0,0.4,1,0,0,0,0.{k}5,1,1\n" for k in range(1, 10)),
        "plumbline handeye",
    ),
}


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_check_reads_what_other_commands_read_and_names_them(kind, tmp_path, capsys):
    samples, command = ELSEWHERE[kind]
    (tmp_path / "dataset.toml").write_text(f'observation = "{kind}"\n')
    (tmp_path / "samples.csv").write_text(samples)
    assert run(["check", str(tmp_path)]) == 0
    assert command in capsys.readouterr().out
    assert run(["check", str(tmp_path), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["observation"] == kind
    assert found["rows"] == samples.count("\n") - 1
    assert found["command"].startswith(command)
    (tmp_path / "samples.csv").write_text(samples.replace("0", "x"))
    assert "samples.csv, row" in refused(capsys, "check", tmp_path)


def test_list_names_the_public_recordings(capsys):
    assert run(["list"]) == 0
    assert "ur10-grid" in capsys.readouterr().out
    assert run(["list", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"ur10-grid", "kr300"} <= {source["name"] for source in found}
    assert run(["list", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_list_names_the_effects_and_what_they_need(capsys):
    assert run(["list", "--effects"]) == 0
    lines = capsys.readouterr().out.splitlines()
    known = [effect.name for effect in (*EFFECTS, *MOTION_EFFECTS)]
    assert [line.split()[0] for line in lines] == known
    assert max(map(len, lines)) < 160
    (backlash,) = [line for line in lines if line.startswith("backlash")]
    assert backlash.split()[1] == "joint"
    assert backlash.endswith("(needs direction or velocity or effort)")
    assert run(["list", "--effects", "--json", "-"]) == 0
    found = {effect["name"]: effect for effect in json.loads(capsys.readouterr().out)}
    assert found["link_thermal"]["one_of"] == ["temperature", "time"]
    assert found["friction"]["needs"] == "velocity, one motion"
    assert found["actuation_delay"]["observations"] == ["motion"]
    assert found["torque_limit"]["needs"] == "a motion of a robot with masses"
    assert run(["list", "--effects", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_fetch_says_where_it_wrote_and_under_which_licence(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("plumbline.experiments.sources.fetch", lambda name, to, progress: to / name)
    assert run(["fetch", "ur5-grid", "--to", str(tmp_path), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["name"], found["folder"]) == ("ur5-grid", str(tmp_path / "ur5-grid"))
    assert run(["fetch", "ur5-grid", "--to", str(tmp_path)]) == 0
    assert f"licence: {found['licence']}\nto cite: {found['citation']}\n" in capsys.readouterr().out


def test_without_a_command_the_help_is_shown(capsys):
    assert run([]) == 0
    assert "diagnose" in capsys.readouterr().out


HELP = "from plumbline.experiments.commands.app import run; run(['--help'])"
WORDS = "from plumbline.experiments.report.diagnosis.page import in_words"
HEAVY = {"casadi", "pinocchio", "numpy", "scipy", "pandas", "matplotlib", "pooch"}


@pytest.mark.parametrize(
    ("asked", "spared"),
    [
        (HELP, HEAVY),
        (
            "import plumbline; plumbline.diagnose, plumbline.load; " + WORDS,
            {"pandas", "matplotlib", "joblib"}
            | {
                f"scipy.{part}"
                for part in ("cluster", "interpolate", "optimize", "signal", "spatial", "stats")
            }
            | {"pinocchio", "coal"},
        ),
        ("import plumbline; plumbline.register, plumbline.hand_eye", {"pinocchio", "coal"}),
    ],
)
def test_what_is_not_needed_is_not_loaded(asked, spared):
    code = f"import sys; {asked}; sys.exit(' '.join(sorted({spared!r} & set(sys.modules))) or 0)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_module_runs_as_the_command_does(tmp_path):
    command = [sys.executable, "-m", "plumbline", "check", "/no/such/folder"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("plumbline: /no/such/folder: ")
    assert done.stderr.count("\n") == 1


def every_command(group, path=()):
    """Every command that takes arguments, by its words; those below ``withheld`` too."""
    for name, command in group.commands.items():
        below = getattr(command, "commands", None)
        yield from every_command(command, (*path, name)) if below else [((*path, name), command)]


EVERY = {" ".join(words): command for words, command in every_command(typer.main.get_command(app))}


@pytest.mark.parametrize("name", EVERY)
def test_every_command_has_examples_that_parse_and_its_help_shows_them(name, capsys):
    for example in EXAMPLES[name]:
        words, own = shlex.split(example)[1:], name.split()
        assert words[: len(own)] == own
        assert EVERY[name].make_context(name, words[len(own) :]).params
    assert run([*name.split(), "--help"]) == 0
    said = "".join(capsys.readouterr().out.split())
    assert all("".join(example.split()) in said for example in EXAMPLES[name])
    assert "[]" not in said  # brackets of a help text are no mark-up


@pytest.mark.parametrize("group", [[], ["withheld"]])
def test_the_help_of_a_group_shows_examples(group, capsys):
    assert run([*group, "--help"]) == 0
    said = capsys.readouterr().out
    assert said.index("Examples") < said.rindex(" ".join(["plumbline", *group]))


@pytest.mark.parametrize("name", EVERY)
def test_every_command_writes_json_and_can_be_quiet(name):
    options = {o for p in EVERY[name].params for o in p.opts}
    assert {"--json", "--quiet"} <= options
