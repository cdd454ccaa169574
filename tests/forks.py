"""Scripts, each in a fork of one process that has imported already what they all need."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SERVER = """
import os, runpy, sys, traceback
{preload}
for script in map(str.strip, sys.stdin):
    child = os.fork()
    if not child:
        said = os.open(script + ".said", os.O_WRONLY | os.O_CREAT)
        os.dup2(said, 1), os.dup2(said, 2)
        os.chdir(os.path.dirname(script))
        sys.path[0], code = os.path.dirname(script), 0
        try:
            runpy.run_path(script, run_name="__main__")
        except BaseException:
            traceback.print_exc()
            code = 1
        sys.stdout.flush(), sys.stderr.flush(), os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@dataclass(frozen=True)
class Forks:
    """The process that forks."""

    server: subprocess.Popen[str]

    def run(self, script: Path, text: str) -> tuple[int, str]:
        """Exit code and words of a script, which stands in its own folder."""
        script.write_text(text, encoding="utf-8")
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        print(script, file=self.server.stdin, flush=True)
        code = int(self.server.stdout.readline())
        said = Path(f"{script}.said")
        words = said.read_text(encoding="utf-8")
        said.unlink()
        return code, words


@contextmanager
def forking(preload: str, *flags: str) -> Iterator[Forks]:
    """A process that has run ``preload`` and is ready to fork."""
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, *flags, "-c", SERVER.format(preload=preload)], env={**os.environ, **alone},
        text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as server:  # fmt: skip
        yield Forks(server)
        assert server.stdin is not None
        server.stdin.close()
