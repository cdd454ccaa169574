"""Processes that do a list of tasks and end with the one that started them, however it ends.

What a process is asked is ended at once where the caller is interrupted; where the caller is
killed, and can end nothing, every process sees that its parent has changed and ends by itself.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from typing import TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")
LOOKS = 0.5  # [s] between two looks at the parent
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


def done_by(work: Callable[[Task], Found], tasks: Sequence[Task], jobs: int) -> Iterator[Found]:
    """What comes of each task, in the order in which they are done.

    ``work`` is a function of a module; jobs are processes at a time, -1 for one a core.
    """
    count = min(jobs if jobs > 0 else os.cpu_count() or 1, len(tasks))
    if count <= 1:
        yield from map(work, tasks)
        return
    from joblib.externals.loky import ProcessPoolExecutor

    pool = ProcessPoolExecutor(
        count, initializer=end_with, initargs=(os.getpid(),), env=ONE_THREAD, timeout=None
    )
    try:
        for task in as_completed([pool.submit(work, task) for task in tasks]):
            yield task.result()
    finally:
        # Nothing is at work any more, unless an error or an interrupt ended the loop.
        pool.shutdown(wait=True, kill_workers=True)


def end_with(parent: int) -> None:
    """End this process as soon as it is no longer that parent's child."""

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(LOOKS)
        os._exit(1)

    threading.Thread(target=look, daemon=True).start()
