"""One way on one set of data, in this process: ``python run.py NAME GIVEN.npz``, JSON out.

Seconds are the processor's, which a machine shared with others does not stretch: of the first call,
and the least of those after it. Memory is the largest that the process ever had, imports included.
"""

from __future__ import annotations

import json
import resource
import sys
from importlib import import_module
from pathlib import Path
from time import process_time

import numpy as np

RUNS = 3  # after the first, the quickest of which counts
PATIENCE = 20.0  # [s] of one run, from which it is not repeated


def peak() -> int:
    """The largest memory of this process [byte]; what a parent had before is none of its own."""
    status = Path("/proc/self/status")
    for line in status.read_text(encoding="ascii").splitlines() if status.exists() else ():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(name: str, given_file: str) -> None:
    """Solve, judge and print."""
    with np.load(given_file, allow_pickle=False) as stored:
        given = dict(stored)
    way = import_module(name)
    seconds: list[float] = []
    while len(seconds) < 1 + RUNS and (not seconds or seconds[-1] < PATIENCE):
        begun = process_time()
        found = way.fit(given)
        seconds.append(process_time() - begun)
    print(
        json.dumps(
            {
                "version": str(way.version()),
                "first": seconds[0],
                "seconds": min(seconds[1:], default=seconds[0]),
                "memory": peak(),
                "figures": {k: float(v) for k, v in way.figures(given, found).items()},
            }
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:3])
