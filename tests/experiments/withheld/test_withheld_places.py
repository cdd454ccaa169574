"""A set never writes over what it did not write, and a path that cannot be is one line."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.withheld.design import Design
from plumbline.experiments.withheld.making import make_set
from plumbline.experiments.withheld.running import read_note, refuse_truth, run_set
from plumbline.experiments.withheld.sealing import LEDGER, append, head
from tests.refusals import refused
from tests.simulated_cases import contents

QUICK = Design(seed=5, kind="single", gap=(2.0, 4.0), rows=(20, 24), arms=("ur5",))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of one case; not to be changed."""
    root = tmp_path_factory.mktemp("made")
    make_set(root / "cases", root / "truth", QUICK, 1)
    return root


@pytest.fixture
def own(made: Path, tmp_path: Path) -> Path:
    """A copy of that set, and a plain file beside it."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    (tmp_path / "file").write_text("mine")
    return tmp_path


@pytest.fixture
def verdicts(own: Path) -> Path:
    """A folder that a run has begun."""
    note = {"cases": str((own / "cases").resolve()), "ledger": ""}
    (own / "verdicts").mkdir()
    (own / "verdicts" / "run.json").write_text(json.dumps(note))
    return own / "verdicts"


# Paths


@pytest.mark.parametrize("name", ["file", "file/below", "a\0b"])
def test_a_path_that_cannot_be_a_folder_is_one_line(own: Path, name: str, capsys) -> None:
    cases, bad, before = own / "cases", own / name, contents(own)
    for command in (
        ["make", own / "new", "--truth", bad],
        ["make", bad, "--truth", own / "new"],
        ["run", cases, "--out", bad],
        ["bench", bad, "--count", "1", "--only", "single"],
    ):
        refused(capsys, "withheld", *command)
    assert contents(own) == before


def test_nothing_is_written_beside_the_cases_before_the_truth_has_a_place(own: Path) -> None:
    with pytest.raises(PlumblineError, match="name another place"):
        make_set(own / "new", own / "file" / "truth", QUICK, 1)
    assert not (own / "new").exists()
    with pytest.raises(PlumblineError, match="name another place"):
        append(own / "file" / LEDGER, head(""))


def test_without_a_command_the_help_is_shown(capsys) -> None:
    from plumbline.experiments.commands.app import run

    assert run(["withheld"]) == 0
    out, err = capsys.readouterr()
    assert "score" in out
    assert err == ""


# Names


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arms": ("foo",)}, "--arm 'foo' not recognised; known: ur3"),
        ({"effects": ("backlash", "foo")}, "--effect 'foo' not recognised; known: joint_offset"),
        ({"effects": ("link_flex",), "simulator": "mujoco"}, "--effect 'link_flex' not recognised"),
        ({"arms": ("bh7",), "simulator": "mujoco"}, "--arm 'bh7' not recognised"),
        ({"kind": "pair", "simulator": "mujoco"}, "--simulator mujoco: draws one cause"),
        ({"kind": "pair", "effects": ("backlash",)}, "name another --effect"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_a_ledger_is_begun(change, words) -> None:
    with pytest.raises(PlumblineError) as caught:
        replace(QUICK, **change)
    assert words in str(caught.value)


# Overwriting


def test_verdicts_are_never_written_over_a_truth(own: Path) -> None:
    before = contents(own)
    with pytest.raises(PlumblineError, match=r"plan\.json: there already"):
        run_set(own / "cases", own / "truth")
    (own / "truth" / "plan.json").rename(own / "plan")
    with pytest.raises(PlumblineError, match=r"ledger\.jsonl: there already"):
        run_set(own / "cases", own / "truth")
    (own / "truth" / LEDGER).rename(own / "ledger")
    with pytest.raises(PlumblineError, match=r"case-0001\.json: there already"):
        run_set(own / "cases", own / "truth")
    assert contents(own / "truth") == {"case-0001.json": before["truth/case-0001.json"]}


@pytest.mark.parametrize("gone", [(), (LEDGER,), (LEDGER, "plan.json")])
def test_two_sets_never_share_a_truth_folder(own: Path, gone: tuple[str, ...]) -> None:
    for name in gone:
        (own / "truth" / name).unlink()
    before = contents(own)
    with pytest.raises(PlumblineError, match="truth of another set"):
        make_set(own / "others", own / "truth", replace(QUICK, seed=6), 1)
    assert contents(own) == before


def test_a_set_goes_on_where_it_was_cut_off(own: Path) -> None:
    whole = contents(own)
    for gone in (("truth/ledger.jsonl",), ("truth/plan.json", "truth/ledger.jsonl"), ()):
        for name in gone:
            (own / name).unlink()
        (own / "truth" / "case-0001.json").unlink(missing_ok=True)
        (own / "cases" / "case-0001" / "samples.csv").unlink()
        make_set(own / "cases", own / "truth", QUICK, 1)
        assert contents(own) == whole


@pytest.mark.parametrize("begun", [False, True])
def test_a_folder_in_a_recording_s_place_is_not_deleted(own: Path, *, begun: bool) -> None:
    cases = own / "cases" if begun else own / "new"
    (cases / "case-0001").mkdir(parents=True, exist_ok=True)
    (cases / "case-0001" / "notes.txt").write_text("mine")
    (cases / "case-0001" / "samples.csv").unlink(missing_ok=True)
    with pytest.raises(PlumblineError, match=r"notes\.txt: not of this set"):
        make_set(cases, own / ("truth" if begun else "away"), QUICK, 1)
    assert (cases / "case-0001" / "notes.txt").read_text() == "mine"


def test_no_output_goes_into_the_folders_of_a_set(own: Path, verdicts: Path, capsys) -> None:
    before, cases, truth = contents(own), own / "cases", own / "truth"
    recording, fact = cases / "case-0001" / "samples.csv", truth / "case-0001.json"
    verdict = verdicts / "run.json"
    for command in (
        ["make", cases, "--truth", truth, "--json", recording],
        ["make", cases, "--truth", truth, "--json", fact],
        ["seal", cases, "--truth", truth, "--json", fact],
        ["run", cases, "--out", verdicts, "--json", recording],
        ["run", cases, "--out", verdicts, "--json", verdict],
        ["score", verdicts, "--truth", truth, "--json", fact],
        ["score", verdicts, "--truth", truth, "--report", fact],
        ["score", verdicts, "--truth", truth, "--report", verdict],
    ):
        assert "never written to" in refused(capsys, "withheld", *command)
    assert contents(own) == before


def test_the_page_of_a_score_is_a_file(own: Path, verdicts: Path, capsys) -> None:
    command = ["withheld", "score", verdicts, "--truth", own / "truth", "--report"]
    assert "name a file" in refused(capsys, *command, "-")


# Damage


@pytest.mark.parametrize("text", ["{", "[1]", "[" * 200_000, '{"cases": 1}', "\xff"])
def test_a_damaged_note_of_a_run_is_one_line(verdicts: Path, text: str, capsys) -> None:
    (verdicts / "run.json").write_text(text, encoding="latin-1")
    root = verdicts.parent
    with pytest.raises(PlumblineError, match="damaged"):
        read_note(verdicts)
    for command in (["run", root / "cases", "--out", verdicts],
                    ["score", verdicts, "--truth", root / "truth"]):  # fmt: skip
        assert "damaged" in refused(capsys, "withheld", *command)


def test_deeply_nested_text_near_the_cases_is_no_truth(own: Path) -> None:
    (own / "deep.json").write_text("[" * 200_000)
    refuse_truth(own / "cases", set())
