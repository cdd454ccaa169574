"""Many cases, each on its own, on all cores or on a cluster: a grid, a random design, or both.

Each case may be kept as it is done, and a sweep that was ended goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from plumbline.errors import fault
from plumbline.experiments.console.workers import done_by
from plumbline.experiments.sweep import recorded, simulated
from plumbline.experiments.sweep.cases import Kept, keeping
from plumbline.experiments.sweep.outcome import Outcome, Sweep
from plumbline.experiments.sweep.spec import Spec, read_spec
from plumbline.experiments.withheld.running import code_hash
from plumbline.optim.core.progress import Progress
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording


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

        def so_far() -> Sweep:
            done = tuple(found[case] for case in spec.cases if case in found)
            of = (spec.name, "") if recording is None else (recording.name, recording.sha256)
            return Sweep(*of, done, _varied(spec.cases))

        if stands and found:
            stands(so_far)
        for outcome in _done(spec.recording, waiting, jobs, dask):
            if kept is not None:
                kept.add(_line(outcome))
            found[outcome.case] = outcome
            left -= 1
            if stands:
                stands(so_far)
            if progress:
                share = 1.0 - left / len(spec.cases)
                progress(f"{len(spec.cases) - left} of {len(spec.cases)}", share)
    return so_far()


def _varied(cases: Sequence[Any]) -> tuple[str, ...]:
    """Options of which there is more than one value."""
    options = [case.to_dict() for case in cases]
    return tuple(k for k in options[0] if len({str(option[k]) for option in options}) > 1)


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


def _line(outcome: Outcome) -> dict[str, Any]:
    return {
        "case": outcome.case.to_dict(), "found": dict(outcome.found), "reason": outcome.reason,
    }  # fmt: skip


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
