"""Independent parts of one piece of work, side by side on the cores that this process may use.

Each further core has a copy of this process (``fork``), which knows all that was worked out before
and sends back what comes of its parts. Where a process cannot be copied or share a lock, from any
but the main thread, and in what is itself a part of something larger, all is done in turn.
"""

import multiprocessing
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from contextvars import ContextVar
from typing import Any, TypeVar

_others: ContextVar[bool] = ContextVar("others", default=False)  # whether others are at work
Part = TypeVar("Part")
Found = TypeVar("Found")


def cores() -> int:
    """How many there are for this process: no more than ``LOKY_MAX_CPU_COUNT``, where it is set."""
    copied = sys.platform == "linux" and multiprocessing.parent_process() is None
    alone = threading.current_thread() is threading.main_thread() and not _others.get()
    if not (copied and alone and _shares_locks()):
        return 1
    from joblib import cpu_count

    return int(cpu_count())


def _shares_locks() -> bool:
    """Whether processes may: not where the system's shared memory is shut off."""
    try:
        multiprocessing.get_context("fork").Lock()
    except (ImportError, OSError):
        return False
    return True


def side_by_side(
    work: Callable[[Part], Found],
    parts: Sequence[Part],
    tell: Callable[[int], None] = lambda part: None,
) -> list[Found]:
    """What comes of each part, in their order, whoever did it.

    Args:
        work: What is done with a part; whatever else it changes is lost.
        parts: The parts, each taken by whoever is free.
        tell: Called with the number of a part that is begun here.
    """
    count = min(cores(), len(parts))
    if count < 2:
        return [_told(work, part, k, tell) for k, part in enumerate(parts)]
    fork: Any = multiprocessing.get_context("fork")  # its types differ by platform
    turn, copies, ends = fork.Value("q", 0), [], []
    before = _others.set(True)
    try:
        for _ in range(count - 1):
            here, there = fork.Pipe(duplex=False)
            ends.append(here)
            with there, suppress(OSError):  # where there may be no more: whoever is there does all
                copies.append(_copy(fork, there, work, parts, turn))
        found = {k: _told(work, parts[k], k, tell) for k in _taken(turn, len(parts))}
        for end in ends:
            with suppress(EOFError):  # of a copy that was killed: its parts are done here
                found.update(_received(end))
    finally:
        _others.reset(before)
        for copy in copies:
            copy.terminate()
            copy.join()
    return [found[k] if k in found else work(part) for k, part in enumerate(parts)]


def _copy(fork: Any, end: Any, *given: Any) -> Any:
    """A copy of this process at work on what is given."""
    copy = fork.Process(target=_send, args=(end, *given), daemon=True)
    with warnings.catch_warnings():  # from 3.12 on of other threads, which hold nothing of ours
        warnings.simplefilter("ignore", DeprecationWarning)
        copy.start()
    return copy


def _told(
    work: Callable[[Part], Found], part: Part, number: int, tell: Callable[[int], None]
) -> Found:
    tell(number)
    return work(part)


def _taken(turn: Any, count: int) -> Iterator[int]:
    """Numbers of parts that nobody has taken yet."""
    while True:
        with turn.get_lock():
            mine, turn.value = turn.value, turn.value + 1
        if mine >= count:
            return
        yield mine


def _send(end: Any, work: Callable[[Part], Found], parts: Sequence[Part], turn: Any) -> None:
    """Do what is left of the parts, and send it or the error that it ended with."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is ended by the process that it is of
    try:
        end.send({k: work(parts[k]) for k in _taken(turn, len(parts))})
    except Exception as error:
        end.send(error)


def _received(end: Any) -> dict[int, Any]:
    sent = end.recv()
    if isinstance(sent, Exception):
        raise sent
    return dict(sent)
