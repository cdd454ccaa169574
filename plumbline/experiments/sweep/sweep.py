"""Many cases, each on its own, on all cores or on a cluster: a grid, a random design, or both.

Each case may be kept as it is done, and a sweep that was ended goes on where it was: one line of
JSON each, whole or cut short by the end of the process, and one that was cut short is done again.
The first line says what the cases are of, the hash of the recording and of the code.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

from plumbline.errors import PlumblineError, fault
from plumbline.experiments.console.workers import done_by
from plumbline.experiments.sweep import recorded, simulated
from plumbline.experiments.sweep.outcome import Outcome, Sweep
from plumbline.experiments.sweep.spec import Spec, read_spec
from plumbline.experiments.withheld.running import code_hash
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.core.progress import Progress
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

SUFFIX = ".part"
LARGEST = 100_000_000  # [byte]: 10,000 cases of 1 kB, ten times


def sweep(
    spec: Spec | str | Path,
    *,
    jobs: int | None = -1,
    dask: str | None = None,
    keep: Path | None = None,
    stands: Callable[[Callable[[], Sweep]], None] | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Do every case, those aside that an earlier sweep has kept.

    Args:
        spec: The recording, or the reality and the method, and the cases; or its TOML file.
        jobs: Processes at a time; -1 for one a core. No process outlives this one. None for what
            `joblib.parallel_config` says: any backend that joblib knows, with its `n_jobs`.
        dask: Address of a Dask scheduler, whose workers take the cases instead.
        keep: A file that takes a line for each case as it is done, and is read first.
        stands: Called after each case with what gives the sweep as it stands, cases done alone.
        progress: Called with words and the share done.

    Raises:
        PlumblineError: The recording cannot be used, no case fits it, or the file to keep cases in
            is of another recording or other code.
    """
    spec = spec if isinstance(spec, Spec) else read_spec(Path(spec))
    recording = None if spec.recording is None else load_recording(spec.recording)
    if recording is not None:
        for case in spec.cases:
            recorded.part_of(recording, case)
    with ExitStack() as stack:
        key = {"reality": spec.name, "code": code_hash()} if not recording else key_of(recording)
        kept = None if keep is None else stack.enter_context(keeping(keep, key))
        found = _known(kept, spec.cases)
        waiting = [case for case in dict.fromkeys(spec.cases) if case not in found]
        left = len(waiting)
        options = [case.to_dict() for case in spec.cases]
        varied = tuple(k for k in options[0] if len({str(one[k]) for one in options}) > 1)

        def so_far() -> Sweep:
            done = tuple(found[case] for case in spec.cases if case in found)
            of = (spec.name, "") if recording is None else (recording.name, recording.sha256)
            return Sweep(*of, done, varied)

        if stands and found:
            stands(so_far)
        for outcome in _done(spec.recording, waiting, jobs, dask):
            if kept is not None:
                own, figures = outcome.case.to_dict(), dict(outcome.found)
                kept.add({"case": own, "found": figures, "reason": outcome.reason})
            found[outcome.case] = outcome
            left -= 1
            if stands:
                stands(so_far)
            if progress:
                share = 1.0 - left / len(spec.cases)
                progress(f"{len(spec.cases) - left} of {len(spec.cases)}", share)
    return so_far()


def _done(
    folder: Path | None, cases: list[Any], jobs: int | None, dask: str | None
) -> Iterator[Outcome]:
    work: Callable[[Any, Any], Outcome] = simulated.outcome_of
    if folder is not None:
        work = recorded.outcome_of
    if not cases or (dask is None and jobs is not None):
        return done_by(partial(work, folder), cases, jobs or -1)
    from plumbline.experiments.sweep.cluster import done_as_configured, done_on

    if dask is None:
        return done_as_configured(work, folder, cases)
    return done_on(dask, work, folder, cases)


def key_of(recording: Recording) -> dict[str, str]:
    """What kept cases must be of, to be taken for this recording's."""
    return {"recording": recording.sha256, "code": code_hash()}


def _known(kept: Kept | None, cases: Sequence[Any]) -> dict[Any, Outcome]:
    asked = {_key(case.to_dict()): case for case in cases}
    found: dict[Any, Outcome] = {}
    for number, line in enumerate(kept.lines if kept else (), start=2):
        try:
            case = asked.get(_key(line["case"]))
            if case is not None:
                found.setdefault(case, Outcome(case, dict(line["found"]), str(line["reason"])))
        except (KeyError, TypeError, ValueError):
            where = f"{kept.path if kept else ''}, row {number}"
            mend = "delete the file, or name another output"
            raise fault(where, "no case of a sweep", "one", mend) from None
    return found


def _key(options: Mapping[str, Any]) -> str:
    return json.dumps(options, sort_keys=True)


@dataclass(frozen=True)
class Kept:
    """A file of finished cases, held by this process alone."""

    path: Path  # where it lies
    file: IO[bytes]  # it, open at its end
    lines: tuple[dict[str, Any], ...]  # the cases that were in it

    def add(self, line: dict[str, Any]) -> None:
        """Keep one more case (PlumblineError: it cannot be written)."""
        try:
            self.file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
            self.file.flush()
        except OSError as error:
            raise _unusable(self.path, error) from None


@contextmanager
def keeping(path: Path, of: dict[str, str]) -> Iterator[Kept]:
    """The file of finished cases, new or of a like sweep (PlumblineError: another's, or held)."""
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK, 0o666)
    except OSError as error:
        raise _unusable(path, error) from None
    with open(number, "r+b", buffering=0) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            whole = read_file(path, LARGEST).rpartition(b"\n")
        except BlockingIOError:
            found, mend = "a sweep at work", "wait for it, or name another output"
            raise fault(str(path), found, "this one alone", mend) from None
        except OSError as error:
            raise _unusable(path, error) from None
        file.truncate(len(whole[0]) + len(whole[1]))  # without a line that was cut short
        lines = _understood(path, whole[0])
        if lines and lines[0] != of:
            odd = next((key for key in of if lines[0].get(key) != of[key]), "kind")
            mend = "delete it, or name another output"
            raise fault(str(path), f"cases of another {odd}", "this one's", mend)
        kept = Kept(path, file, tuple(lines[1:]))
        if not lines:
            kept.add(of)
        yield kept


def _understood(path: Path, whole: bytes) -> list[dict[str, Any]]:
    try:
        lines = [json.loads(line) for line in whole.split(b"\n") if line]
    except (ValueError, RecursionError):
        lines = [None]
    if not all(isinstance(line, dict) for line in lines):
        mend = "delete it, or name another output"
        raise fault(str(path), "no cases of a sweep", "one line of JSON each", mend)
    return lines


def _unusable(path: Path, error: OSError) -> PlumblineError:
    found = f"a file that cannot be used ({reason(error)})"
    return fault(str(path), found, "a place to keep cases", "name another output")
