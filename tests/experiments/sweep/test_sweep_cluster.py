"""A sweep on a cluster loses no case and doubles none, whichever worker ends."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.sweep import cluster
from plumbline.experiments.sweep.spec import read_spec
from plumbline.experiments.sweep.sweep import sweep
from plumbline.optim.diagnosis import diagnose as diagnose_module
from tests.experiments.commands.test_command_line import ROOT
from tests.made_up_diagnosis import BENCH, made_up

CASES = 24
SPEC = f'recording = "bench"\n[vary]\nseed = {list(range(CASES // 2))}\nrows = [30, 60]\n'
QUIET = pytest.mark.filterwarnings("ignore")  # what a cluster says of a worker that was killed


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    """A spec beside the bundled recording."""
    shutil.copytree(BENCH, tmp_path / "bench")
    (tmp_path / "spec.toml").write_text(SPEC)
    return tmp_path / "spec.toml"


@dataclass(frozen=True)
class Cluster:
    """A scheduler and its workers, each a process."""

    address: str
    workers: tuple[subprocess.Popen[bytes], ...]
    trace: Path  # a line a diagnosis


def started(stack: ExitStack, folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """A process of the cluster, ended with the test."""
    trace = str(folder / "trace")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PLUMBLINE_TRACE": trace}
    process = subprocess.Popen(
        [sys.executable, "-m", *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    stack.callback(process.wait, 20)
    stack.callback(process.kill)
    return process


@pytest.fixture
def two_workers(tmp_path: Path) -> Iterator[Cluster]:
    """A real scheduler and two workers whose diagnoses are made up."""
    distributed = pytest.importorskip("distributed")
    place = tmp_path / "cluster"
    place.mkdir()
    known = place / "scheduler.json"
    common = ("--scheduler-file", str(known))
    with ExitStack() as stack:
        listen = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
        started(stack, place, "distributed.cli.dask_scheduler", *common, *listen)
        until = time.monotonic() + 60
        while not known.is_file() and time.monotonic() < until:
            time.sleep(0.05)
        preload = ("--preload", str(ROOT / "tests" / "quick_worker.py"))
        options = (*common, "--no-nanny", "--nthreads", "1", "--no-dashboard", *preload)
        workers = tuple(
            started(stack, place, "distributed.cli.dask_worker", *options) for _ in range(2)
        )
        address = json.loads(known.read_text())["address"]
        with distributed.Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield Cluster(address, workers, place / "trace")


def killed_once_both_are_busy(at: Cluster) -> None:
    """End one worker with a quarter of the cases done and both at work."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        lines = at.trace.read_text().splitlines() if at.trace.is_file() else []
        if len(lines) > CASES // 4 and len({line.split()[0] for line in lines}) == 2:
            at.workers[0].kill()
            return
        time.sleep(0.01)


@QUIET
def test_a_worker_that_is_killed_midway_loses_no_case_and_doubles_none(
    spec: Path, two_workers: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 60.0)
    out = spec.parent / "out.parquet"
    watcher = threading.Thread(target=killed_once_both_are_busy, args=(two_workers,))
    watcher.start()
    command = ["sweep", str(spec), "--dask", two_workers.address, "--parquet", str(out), "--quiet"]
    assert run(command) == 0
    watcher.join()
    assert two_workers.workers[0].wait(20) == -signal.SIGKILL
    assert two_workers.workers[1].poll() is None
    traced = two_workers.trace.read_text().splitlines()
    assert {line.split()[0] for line in traced} == {str(w.pid) for w in two_workers.workers}
    table = pd.read_parquet(out)
    asked = [(seed, rows) for seed in range(CASES // 2) for rows in (30, 60)]
    assert list(zip(table["seed"], table["rows"], strict=True)) == asked
    assert set(table["verdict"]) == {"explained"}
    assert (table["causes"].str.count(";") == len(made_up_causes()) - 1).all()
    assert not out.with_name("out.parquet.part").exists()


def made_up_causes() -> list[str]:
    """Labels of the stand-in's causes."""
    from plumbline.optim.recording.loading import load_recording

    return [cause.label for cause in made_up(load_recording(BENCH)).verdict.causes]


KILLED = """
import os, pandas, signal, sys, time
from pathlib import Path
import tests.quick_worker
from plumbline.experiments.commands.app import run

spec, out = sys.argv[1:]
command = ["sweep", spec, "--jobs", "1", "--parquet", out, "--quiet"]
part = Path(out + ".part")
for least in (4, 9):
    child = os.fork()
    if child == 0:
        os._exit(run(command))
    while not part.is_file() or part.read_bytes().count(b"\\n") < 1 + least:
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert len(pandas.read_parquet(out)) > 0
sys.exit(run(command))
"""


def test_a_sweep_that_is_killed_twice_loses_no_case_and_doubles_none(spec: Path) -> None:
    out, trace = spec.parent / "out.parquet", spec.parent / "trace"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PLUMBLINE_TRACE": str(trace)}
    command = [sys.executable, "-c", KILLED, str(spec), str(out)]
    subprocess.run(command, env=environment, check=True, timeout=300)
    rows = pd.read_parquet(out)
    asked = list(zip(rows["seed"], rows["rows"], strict=True))
    assert asked == [(seed, rows) for seed in range(CASES // 2) for rows in (30, 60)]
    # What was kept is not diagnosed again: at most the case at hand when each kill came.
    assert CASES <= len(trace.read_text().splitlines()) <= CASES + 2
    assert not out.with_name("out.parquet.part").exists()


@QUIET
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://"])
def test_a_cluster_that_does_not_answer_is_told_in_one_line(
    spec: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with pytest.raises(PlumblineError, match="no scheduler that answers") as error:
        sweep(read_spec(spec), dask=address)
    assert "\n" not in str(error.value)


def test_without_dask_the_extra_is_named(spec: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(PlumblineError, match=r"pip install 'plumbline-robotics\[dask\]'"):
        sweep(read_spec(spec), dask="tcp://127.0.0.1:1")


def test_all_causes_are_in_every_table_and_none_is_cut(
    spec: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(diagnose_module, "diagnose", lambda recording, _: made_up(recording))
    spec.write_text('recording = "bench"\n[vary]\nseed = [0, 1]\n')
    out = spec.parent / "out.csv"
    assert run(["sweep", str(spec), "--jobs", "1", "--csv", str(out)]) == 0
    said = capsys.readouterr().out
    for label in made_up_causes():
        short = label.replace(" of joint ", " ").replace(" of link ", " ")
        assert said.count(short) >= 2, label
        assert out.read_text().count(f"{label} (") == 2, label


def test_shipped_files_come_out_as_they_went_in(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "robot.urdf").write_bytes(b"\x00<robot/>")
    (tmp_path / "dataset.toml").write_text("name = 'x'\n")
    folder = cluster.Shipped.of(tmp_path).unpacked()
    assert (folder / "deep" / "robot.urdf").read_bytes() == b"\x00<robot/>"
    assert cluster.Shipped.of(folder) == cluster.Shipped.of(tmp_path)
