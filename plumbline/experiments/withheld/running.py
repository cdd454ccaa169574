"""Running a set blind: every recording alone in a process that knows nothing else.

Each process gets a copy of one recording in a temporary folder, an environment without the
project's variables, and that folder to stand in. A verdict appears whole or not at all, so a run
that was interrupted goes on where it stopped.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import Any

from plumbline.errors import PlumblineError
from plumbline.experiments.withheld import sealing
from plumbline.experiments.withheld.sandbox import RECORDING, VERDICT
from plumbline.kinematics.files import write_whole
from plumbline.optim.core.progress import Progress
from plumbline.optim.recording.recording import hash_of

LARGEST_TRUTH = 5_000_000  # bytes; what is larger is not read to see whether it is a truth
PASSED = ("PATH", "LANG", "LC_ALL", "SYSTEMROOT", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
PROJECT = Path(__file__).resolve().parents[3]
PYTHON_PATH = (str(PROJECT),)
DIAGNOSING = ("plumbline/kinematics", "plumbline/optim")


@dataclass(frozen=True)
class Done:
    """What a run did: verdicts written now, and verdicts that were there."""

    written: int
    kept: int


def run_set(
    cases: Path, out: Path, *, jobs: int = 0, seed: int = 0, progress: Progress | None = None
) -> Done:
    """Diagnose a set blind, one verdict a file (PlumblineError: a truth is near, a seal broken)."""
    entries = entries_of(cases)
    refuse_truth(cases, {entry.truth for entry in entries if entry.truth})
    _check_out(cases, out, entries)
    sealing.make_folder(out)
    _sign(cases, out)
    waiting = [entry for entry in entries if not _is_done(entry, out, seed)]
    kept = len(entries) - len(waiting)
    workers = max(1, min(jobs or os.cpu_count() or 1, len(waiting)))
    with _blind_processes(workers if waiting else 0) as idle, ThreadPoolExecutor(workers) as pool:
        tasks = {pool.submit(_one, cases / e.case, e, out, seed, idle): e for e in waiting}
        try:
            for count, task in enumerate(as_completed(tasks), start=kept + 1):
                task.result()
                if progress:
                    progress(f"{count} of {len(entries)}", count / len(entries))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return Done(len(waiting), kept)


def _check_out(cases: Path, out: Path, entries: Sequence[sealing.Entry]) -> None:
    """Refuse a folder for the verdicts that holds what no run wrote, a truth above all."""
    try:
        within = out.resolve().is_relative_to(cases.resolve())
        begun = (out / sealing.RUN).exists()
        strange = [
            name
            for name in (sealing.PLAN, *(() if begun else (sealing.LEDGER,)))
            if (out / name).exists()
        ]
        if not begun:
            strange += [f"{e.case}.json" for e in entries if (out / f"{e.case}.json").exists()]
    except (OSError, RuntimeError, ValueError) as error:
        raise PlumblineError(f"{out}: no usable path ({type(error).__name__})") from None
    if within:
        raise PlumblineError(f"{out}: lies within the cases; name a folder elsewhere")
    if strange:
        raise PlumblineError(
            f"{out / strange[0]}: there already, and of no run: a truth? Name a new folder for the "
            "verdicts"
        )


def entries_of(cases: Path) -> list[sealing.Entry]:
    """What is to be run: the ledger's entries, checked, or all recordings of an unsealed set."""
    ledger, folders = sealing.read_ledger(cases), sealing.recordings_in(cases)
    if ledger is None:
        return [sealing.Entry(f.name, "", sealing.hash_of_recording(f)) for f in folders]
    stray = {f.name for f in folders} - set(ledger.by_case)
    if stray:
        raise PlumblineError(f"{cases / min(stray)}: not in the ledger; take it out or seal it")
    for entry in ledger.entries:
        sealing.check_seal(entry, recording=cases / entry.case)
    return list(ledger.entries)


def refuse_truth(cases: Path, sealed: set[str]) -> None:
    """Refuse to run where a truth lies within the cases or in a folder above them."""
    above = (path for parent in cases.resolve().parents for path in _json_in(parent))
    for path in (*sorted(cases.rglob("*.json")), *above):
        if _is_truth(path, sealed):
            raise PlumblineError(f"{path}: a truth within or above the cases; keep it apart")


def _json_in(folder: Path) -> list[Path]:
    try:
        return sorted(folder.glob("*.json"))
    except OSError:
        return []


def _is_truth(path: Path, sealed: set[str]) -> bool:
    try:
        if path.stat().st_size > LARGEST_TRUTH:
            return False
        if sealed and sealing.hash_of_file(path) in sealed:
            return True
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and isinstance(content.get("effects"), list)


def _sign(cases: Path, out: Path) -> None:
    ledger = cases / sealing.LEDGER
    sealed = sealing.hash_of_file(ledger) if ledger.is_file() else ""
    note = {"cases": str(cases.resolve()), "ledger": sealed, "code": code_hash()}
    kept = out / sealing.RUN
    if kept.is_file():
        before = read_note(out)
        if before.get("cases") != note["cases"]:
            raise PlumblineError(
                f"{out}: holds verdicts on {before.get('cases')}; use a new folder"
            )
        if before.get("code", note["code"]) != note["code"]:
            raise PlumblineError(f"{out}: holds verdicts of other code; use a new folder")
    kept.write_text(json.dumps(note, indent=1) + "\n", encoding="utf-8")
    if sealed:
        shutil.copyfile(ledger, out / sealing.LEDGER)


def read_note(verdicts: Path) -> dict[str, str]:
    """Which set verdicts are on, as their run noted, refused if damaged; empty without a note."""
    path = verdicts / sealing.RUN
    if not path.is_file():
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if not (isinstance(found, dict) and all(isinstance(word, str) for word in found.values())):
        raise PlumblineError(f"{path}: damaged; run the cases again into a new folder")
    return found


def code_hash() -> str:
    """SHA-256 of the code that diagnoses: a table's verdicts are all by the same."""
    files = sorted(f for name in DIAGNOSING for f in (PROJECT / name).rglob("*.py"))
    return hash_of(
        *(part for f in files for part in (str(f.relative_to(PROJECT)).encode(), f.read_bytes()))
    )


def _is_done(entry: sealing.Entry, out: Path, seed: int) -> bool:
    try:
        found = json.loads((out / f"{entry.case}.json").read_text(encoding="utf-8"))["withheld"]
        asked = (entry.recording, list(entry.without), seed)
        return asked == (found.get("recording"), found.get("without"), found.get("seed"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


@contextmanager
def _blind_processes(count: int) -> Iterator[SimpleQueue[subprocess.Popen[str]]]:
    """Processes that wait for tasks, started in a folder and an environment that tell nothing."""
    idle: SimpleQueue[subprocess.Popen[str]] = SimpleQueue()
    with ExitStack() as stack:
        home = stack.enter_context(tempfile.TemporaryDirectory(prefix="plumbline-blind-"))
        environment = {key: os.environ[key] for key in PASSED if key in os.environ}
        environment |= {"PYTHONPATH": os.pathsep.join(PYTHON_PATH), "HOME": home, "TMPDIR": home}
        alone = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LOKY_MAX_CPU_COUNT")
        environment |= dict.fromkeys(alone, "1")
        for _ in range(count):
            process = subprocess.Popen(
                [sys.executable, "-m", "plumbline.experiments.withheld.blind"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                cwd=home,
                env=environment,
                text=True,
                start_new_session=True,
            )
            stack.enter_context(process)
            stack.callback(_stop, process)
            idle.put(process)
        yield idle


def _stop(process: subprocess.Popen[str]) -> None:
    """End a blind process and the fork that may be at work for it."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
    except ProcessLookupError:
        return


def _one(
    recording: Path,
    entry: sealing.Entry,
    out: Path,
    seed: int,
    idle: SimpleQueue[subprocess.Popen[str]],
) -> None:
    """Hand one recording to a blind process and keep what it says."""
    process = idle.get()
    begun = perf_counter()
    try:
        with tempfile.TemporaryDirectory(prefix="plumbline-case-") as scratch:
            shutil.copytree(recording, Path(scratch) / RECORDING)
            verdict = _answer(process, Path(scratch), entry, seed)
    finally:
        idle.put(process)
    verdict["withheld"] = {
        "case": entry.case,
        "recording": entry.recording,
        "without": list(entry.without),
        "seed": seed,
        "seconds": round(perf_counter() - begun, 3),
        "kernel_wall": verdict.pop("kernel_wall", False),
    }
    write_whole(out / f"{entry.case}.json", json.dumps(verdict, indent=1) + "\n")


def _answer(
    process: subprocess.Popen[str], folder: Path, entry: sealing.Entry, seed: int
) -> dict[str, Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    task = {"folder": str(folder), "without": list(entry.without), "seed": seed}
    try:
        process.stdin.write(json.dumps(task) + "\n")
        process.stdin.flush()
        said = process.stdout.readline()
    except BrokenPipeError:
        said = ""
    if not said:
        raise PlumblineError(f"{entry.case}: the blind process has died; run again to go on")
    code, file = json.loads(said)["code"], folder / VERDICT
    if code or not file.is_file():
        return {"verdict": "failed", "reason": f"exit code {code}", "causes": [], "candidates": []}
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content
