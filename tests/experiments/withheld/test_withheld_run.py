"""The run is blind: a process can open its recording and nothing else; and a set, end to end."""

from __future__ import annotations

import ctypes
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.withheld.design import Design
from plumbline.experiments.withheld.making import make_set
from plumbline.experiments.withheld.running import DIAGNOSING, run_set
from plumbline.experiments.withheld.scoring import score_run
from tests.forks import Forks, forking
from tests.simulated_cases import made_elsewhere

ROOT = Path(__file__).resolve().parents[3]
DESIGN = Design(
    seed=11, level="clear", gap=(1.0, 4.0), rows=(30, 40), arms=("ur5", "vs060"), surgical=0.0
)
CASES = 4  # of the least seed whose first four are of all four kinds


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some cases of every kind, made and run; not to be changed."""
    root = tmp_path_factory.mktemp("ran")
    make_set(root / "cases", root / "truth", DESIGN, CASES)
    run_set(root / "cases", root / "verdicts", jobs=1)
    return root


def unusable(recording: Path) -> None:
    """Make a recording one that is refused at once, where its verdict is not what matters."""
    (recording / "samples.csv").write_text("q1,q2\n1,2\n")


@pytest.fixture(scope="module")
def forks() -> Iterator[Forks]:
    """A process that knows the walls and none of the library behind them."""
    with forking("from plumbline.experiments.withheld import sandbox") as forks:
        yield forks


@pytest.fixture
def confined(forks: Forks, tmp_path: Path) -> Callable[..., str]:
    """What a process says that was shut into a folder and then tries something."""
    own = tmp_path / "own"

    def said(code: str, before: str = "") -> str:
        own.mkdir(exist_ok=True)
        script = (
            "import os\nfrom pathlib import Path\n"
            f"from plumbline.experiments.withheld import sandbox\n{before}\n"
            f"os.chdir({str(own)!r})\nheld = sandbox.confine(Path({str(own)!r}))\n"
            f"try:\n    {code}\n    print('done')\n"
            "except PermissionError as error:\n    print('kept out', error)\n"
        )
        failed, words = forks.run(tmp_path / "script.py", script)
        assert not failed, words
        return words

    return said


@pytest.mark.parametrize(
    "attempt",
    [
        "open({secret!r}).read()",
        "Path({secret!r}).read_bytes()",
        "import os; os.listdir({folder!r})",
        "import os; os.open({secret!r}, os.O_RDONLY)",
        "open('../truth/case-0001.json').read()",
        "open('link').read()",
        "import os; os.rename({secret!r}, 'mine')",
        "import os; os.link({secret!r}, 'mine')",
        "import subprocess; subprocess.run(['cat', {secret!r}])",
        "import os; os.system('cat ' + {secret!r})",
        "import socket; socket.create_connection(('127.0.0.1', 9))",
        "open({folder!r} + '/more', 'w')",
    ],
)
def test_a_confined_process_cannot_reach_the_truth(
    confined: Callable[..., str], tmp_path: Path, attempt: str
) -> None:
    truth = tmp_path / "truth"
    truth.mkdir()
    (truth / "case-0001.json").write_text("secret")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "link").symlink_to(truth / "case-0001.json")
    code = attempt.format(secret=str(truth / "case-0001.json"), folder=str(truth))
    assert confined(code).startswith("kept out")


@pytest.mark.parametrize(
    "attempt",
    [
        "open({file!r}, 'w')",
        "open({file!r}, 'a')",
        "open({file!r}, 'r+')",
        "open({folder!r} + '/more', 'x')",
        "os.open({file!r}, os.O_RDWR)",
        "os.open({folder!r} + '/more', os.O_RDONLY | os.O_CREAT)",
        "os.truncate({file!r}, 0)",
        "os.remove({file!r})",
        "os.rename({file!r}, 'taken')",
        "os.rename('mine', {folder!r} + '/more')",
        "os.replace('mine', {file!r})",
        "os.link({file!r}, 'taken')",
        "os.link('mine', {folder!r} + '/more')",
        "os.symlink('mine', {folder!r} + '/more')",
        "os.mkdir({folder!r} + '/more')",
        "os.rmdir({folder!r} + '/empty')",
        "os.chmod({file!r}, 0o600)",
        "os.utime({file!r}, (0, 0))",
        "Path({file!r}).write_text('x')",
        "os.chdir({folder!r} + '/..'); os.listdir()",
    ],
)
def test_python_s_wall_alone_keeps_the_library_as_it_is(
    confined: Callable[..., str], tmp_path: Path, attempt: str
) -> None:
    """As on a kernel without Landlock; what may only be read is a folder made for this."""
    folder = tmp_path / "library"
    (folder / "empty").mkdir(parents=True)
    (folder / "file.py").write_text("as it is")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "mine").write_text("mine")
    before = (
        f"import os\nfolders = (*sandbox.library_folders(), Path({str(folder)!r}))\n"
        "sandbox.library_folders = lambda: folders\nsandbox._landlock = lambda *folders: False\n"
    )
    code = attempt.format(file=str(folder / "file.py"), folder=str(folder))
    assert confined(code, before).startswith("kept out a blind process must not")
    assert sorted(path.name for path in folder.iterdir()) == ["empty", "file.py"]
    assert confined(f"print(open({str(folder / 'file.py')!r}).read())", before) == (
        "as it is\ndone\n"
    )


def test_a_confined_process_can_use_its_folder_and_the_library(
    confined: Callable[..., str],
) -> None:
    code = "open('mine', 'w').write('x'); import plumbline.kinematics.robot as r; r; open('mine')"
    assert confined(code) == "done\n"
    tidy = (
        "import os; os.mkdir('sub'); open('a', 'x').close(); os.rename('a', 'b'); "
        "os.link('b', 'c'); os.symlink('b', 'd'); os.chmod('b', 0o600); open('d', 'r+').close(); "
        "os.truncate('c', 0); os.remove('c'); os.rmdir('sub'); print(sorted(os.listdir()))"
    )
    assert confined(tidy) == "['b', 'd', 'mine']\ndone\n"


def landlock_version() -> int:
    """What the kernel itself says of its Landlock, asked apart from the code under test."""
    return int(ctypes.CDLL(None).syscall(444, None, 0, 1))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the kernel's wall is Linux's")
def test_compiled_code_is_kept_out_as_well(confined: Callable[..., str], tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret")
    # A C library's open is seen by the kernel alone.
    code = f"import ctypes; print(held, ctypes.CDLL(None).open({str(secret).encode()!r}, 0))"
    words = confined(code).split()
    if landlock_version() < 1:
        assert words[0] == "False"
        pytest.skip("this kernel has no Landlock")
    assert words == ["True", "-1", "done"]


def test_the_blind_process_sees_neither_the_environment_nor_the_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A spy that starts with the process writes down what it was given."""
    made_elsewhere(tmp_path / "cases", tmp_path / "truth", 1, rows=(20, 20))
    unusable(tmp_path / "cases" / "case-0001")
    spy = tmp_path / "spy" / "sitecustomize.py"
    spy.parent.mkdir()
    seen = tmp_path / "seen.json"
    spy.write_text(
        "import json, os, sys\n"
        "told = json.dumps([dict(os.environ), os.getcwd(), sys.orig_argv])\n"
        f"open({str(seen)!r}, 'w').write(told)\n"
    )
    monkeypatch.setenv("PLUMBLINE_DATA", str(tmp_path / "truth"))
    monkeypatch.setenv("SECRET", str(tmp_path / "truth"))
    monkeypatch.setattr(
        "plumbline.experiments.withheld.running.PYTHON_PATH", (str(spy.parent), str(ROOT))
    )
    run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1)
    said = seen.read_text()
    assert "PLUMBLINE" not in said
    assert "SECRET" not in said
    assert str(tmp_path / "truth") not in said
    assert str(tmp_path / "cases") not in said


@pytest.mark.parametrize("place", ["cases/hidden.json", "cases/case-0001/notes.json", "notes.json"])
def test_a_truth_within_or_above_the_cases_is_refused(
    tmp_path: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made_elsewhere(tmp_path / "cases", tmp_path / "away" / "truth", 1, rows=(20, 20))
    (tmp_path / place).write_text(json.dumps({"effects": []}))
    out = tmp_path / "verdicts"
    assert run(["withheld", "run", str(tmp_path / "cases"), "--out", str(out)]) == 2
    assert "a truth within or above the cases" in capsys.readouterr().err
    assert not out.exists()


def test_a_recording_that_was_changed_or_is_a_link_is_not_run(tmp_path: Path) -> None:
    design = Design(seed=3, rows=(20, 20), arms=("ur5",))
    make_set(tmp_path / "cases", tmp_path / "truth", design, 1)
    recording = tmp_path / "cases" / "case-0001"
    link = recording / "notes.txt"
    link.symlink_to(tmp_path / "truth" / "case-0001.json")
    with pytest.raises(PlumblineError, match="is a link"):
        run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1)
    link.unlink()
    samples = recording / "samples.csv"
    samples.write_text(samples.read_text() + "\n")
    with pytest.raises(PlumblineError, match="changed after it was sealed"):
        run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1)


@pytest.mark.slow
def test_a_folder_made_elsewhere_is_sealed_run_and_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recordings under free names, truths with the least that they must say."""
    cases, truth = tmp_path / "cases", tmp_path / "truth"
    made_elsewhere(cases, tmp_path / "full", 1, gap=(3.0, 4.0), rows=(40, 40))
    truth.mkdir()
    (cases / "case-0001").rename(cases / "monday")
    full = json.loads((tmp_path / "full" / "case-0001.json").read_text())
    least = [{"effect": e["effect"], "element": e["element"]} for e in full["effects"]]
    (truth / "monday.json").write_text(json.dumps({"effects": least}))
    folders = [str(cases), "--truth", str(truth)]
    assert run(["withheld", "seal", *folders]) == 0
    assert run(["withheld", "run", str(cases), "--out", str(tmp_path / "v"), "--jobs", "1"]) == 0
    capsys.readouterr()
    arguments = [str(tmp_path / "v"), "--truth", str(truth), "--json", "-"]
    assert run(["withheld", "score", *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sealed"]
    assert found["cases"] == 1
    assert found["groups"][0]["figures"]["top1_effect"]["of"] == 1
    assert found["groups"][1]["name"] == "unstated"


def test_a_recording_that_cannot_be_used_gets_a_verdict_that_says_so(tmp_path: Path) -> None:
    made_elsewhere(tmp_path / "cases", tmp_path / "truth", 1, rows=(20, 20))
    unusable(tmp_path / "cases" / "case-0001")
    run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1)
    verdict = json.loads((tmp_path / "verdicts" / "case-0001.json").read_text())
    assert verdict["verdict"] == "refused"
    assert "samples.csv" in verdict["reason"]
    assert score_run(tmp_path / "verdicts", tmp_path / "truth").overall.share("unusable").count == 1


def test_a_process_that_breaks_down_gets_a_verdict_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A library whose diagnosis raises, found before the real one."""
    made_elsewhere(tmp_path / "cases", tmp_path / "truth", 2, rows=(20, 20))
    spy = tmp_path / "spy" / "sitecustomize.py"
    spy.parent.mkdir()
    spy.write_text(
        "import plumbline.optim.diagnosis.diagnose as d\n"
        "def broken(*args, **options):\n    raise RuntimeError('broken')\n"
        "d.diagnose = broken\n"
    )
    monkeypatch.setattr(
        "plumbline.experiments.withheld.running.PYTHON_PATH", (str(spy.parent), str(ROOT))
    )
    assert run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1).written == 2
    for path in (tmp_path / "verdicts").glob("case-*.json"):
        assert json.loads(path.read_text())["verdict"] == "failed"
    assert "RuntimeError: broken" in capfd.readouterr().err


# The small fixed set


@pytest.mark.slow
def test_the_fixed_set_is_diagnosed_blind(ran: Path) -> None:
    found = score_run(ran / "verdicts", ran / "truth")
    figures = found.overall.figures
    assert found.cases == CASES
    print({key: f"{share.count}/{share.of}" for key, share in figures.items()})
    top = figures["top1_element_or_confounded"]
    assert top.count == top.of
    assert figures["false_alarms"].count == 0
    assert figures["falsely_added_beyond_confounded"].count == 0
    assert figures["outside_hits"].count == figures["outside_hits"].of
    assert figures["outside_wrong_sure"].count == 0


@pytest.mark.slow
def test_what_has_a_verdict_is_not_run_again(ran: Path) -> None:
    verdicts = ran / "verdicts"
    times = {p.name: p.stat().st_mtime_ns for p in verdicts.glob("case-*.json")}
    done = run_set(ran / "cases", verdicts, jobs=1)
    assert (done.written, done.kept) == (0, CASES)
    assert times == {p.name: p.stat().st_mtime_ns for p in verdicts.glob("case-*.json")}
    first = verdicts / "case-0001.json"
    text = first.read_text()
    first.unlink()
    assert run_set(ran / "cases", verdicts, jobs=1).written == 1
    again, before = json.loads(first.read_text()), json.loads(text)
    for verdict in (again, before):
        verdict["withheld"].pop("seconds")
    assert again == before


@pytest.mark.slow
def test_a_verdict_says_what_it_was_made_from(ran: Path) -> None:
    verdict = json.loads((ran / "verdicts" / "case-0003.json").read_text())
    assert verdict["withheld"]["case"] == "case-0003"
    assert len(verdict["withheld"]["recording"]) == 64
    assert {"verdict", "gap", "causes", "candidates", "outside_probability"} <= set(verdict)
    assert not list((ran / "verdicts").glob("*.part"))


def test_verdicts_of_other_code_are_not_added_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in DIAGNOSING:
        (tmp_path / "code" / name).mkdir(parents=True)
    module = tmp_path / "code" / "plumbline" / "optim" / "evidence.py"
    module.write_text("ODDS = 0.5")
    monkeypatch.setattr("plumbline.experiments.withheld.running.PROJECT", tmp_path / "code")
    made_elsewhere(tmp_path / "cases", tmp_path / "truth", 1, rows=(20, 20))
    unusable(tmp_path / "cases" / "case-0001")
    for _ in range(2):
        run_set(tmp_path / "cases", tmp_path / "verdicts", jobs=1)
    module.write_text("ODDS = 0.7")
    with pytest.raises(PlumblineError, match="verdicts of other code; use a new folder"):
        run_set(tmp_path / "cases", tmp_path / "verdicts")
