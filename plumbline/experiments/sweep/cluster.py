"""A list of tasks on one recording, done by a Dask cluster's or a joblib backend's workers.

The recording's files travel with the task, as the workers may share no disk with this process. A
task whose worker ends is given to another by the scheduler; what comes of it comes once.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from joblib import Parallel, delayed

from plumbline.errors import PlumblineError, fault
from plumbline.experiments.withheld.running import code_hash

if TYPE_CHECKING:
    from distributed import Client

Task = TypeVar("Task")
Found = TypeVar("Found")
PATIENCE = 10.0  # [s] for a scheduler to answer and for its first worker to appear
INSTALL = "pip install 'plumbline-robotics[dask]'"


@dataclass(frozen=True)
class Shipped:
    """The files of a recording's folder, to be written down again where they are needed."""

    files: tuple[tuple[str, bytes], ...]  # path within the folder, content

    @classmethod
    def of(cls, folder: Path | None) -> Shipped:
        """All files of a folder; none of no folder."""
        if folder is None:
            return cls(())
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return cls(tuple((p.relative_to(folder).as_posix(), p.read_bytes()) for p in paths))

    def unpacked(self) -> Path:
        """A folder with these files; one a process, gone with it."""
        return _unpacked(self)


@cache
def _unpacked(shipped: Shipped) -> Path:
    folder = Path(tempfile.mkdtemp(prefix="plumbline-sweep-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for name, content in shipped.files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def _worked(work: Callable[[Path, Task], Found], shipped: Shipped, task: Task) -> Found:
    return work(shipped.unpacked(), task)


def done_as_configured(
    work: Callable[[Path, Task], Found], folder: Path | None, tasks: Sequence[Task]
) -> Iterator[Found]:
    """What comes of each task, as by `done_on`, by the backend of `joblib.parallel_config`."""
    shipped, each = Shipped.of(folder), delayed(_worked)
    asked = (each(work, shipped, task) for task in tasks)
    yield from Parallel(return_as="generator_unordered")(asked)


def done_on(
    address: str, work: Callable[[Path, Task], Found], folder: Path | None, tasks: Sequence[Task]
) -> Iterator[Found]:
    """What comes of each task, in the order in which they are done, refused if no worker can.

    The address is the scheduler's, ``tcp://HOST:PORT``; ``work``, a function of a module, is done
    with the recording's folder, None where a case makes its own, and a task.
    """
    client = _connected(address)
    try:
        from distributed import KilledWorker, as_completed

        _refuse_other_code(client, address)
        # A task of its own, so that it is made again where the worker that holds it ends.
        shipped = client.submit(Shipped, Shipped.of(folder).files, pure=False)
        asked = [client.submit(_worked, work, shipped, task, pure=False) for task in tasks]
        try:
            for future in as_completed(asked, loop=client.loop):
                yield future.result()
        except KilledWorker as error:
            mend = "give the workers more memory, or leave it out"
            found = f"a case that ended its workers ({error.task})"
            raise fault(f"--dask {address}", found, "workers that last", mend) from None
    finally:
        client.close()


def _connected(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise fault("--dask", "no Dask here", "it installed", INSTALL) from None
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError):
        found, mend = "no scheduler that answers", "start 'dask scheduler' there"
        raise fault(f"--dask {address}", found, "tcp://HOST:PORT of one", mend) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        client.close()
        found, mend = "no worker", f"start 'dask worker {address}'"
        raise fault(f"--dask {address}", found, "at least one", mend) from None
    return client


def _refuse_other_code(client: Client, address: str) -> None:
    """Cases of other code are not this sweep's."""
    here = code_hash()
    there: dict[str, Any] = client.run(code_hash, on_error="return")
    odd = next((worker for worker, code in there.items() if code != here), None)
    if odd is not None:
        raise PlumblineError(
            f"--dask {address}: worker {odd} has another version of plumbline, or none; install "
            "the one that is here"
        )
