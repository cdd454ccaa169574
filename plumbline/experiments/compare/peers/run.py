"""One way on one set of data, in this process: ``run.py MODULE SUBJECT GIVEN.npz``, JSON out.

Seconds are the processor's, which a machine shared with others does not stretch: of the first call,
and the least of those after it. Memory is the largest that the process ever had, imports included.
"""

import json
import resource
import sys
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RUNS = 3  # after the first, the quickest of which counts
PATIENCE = 20.0  # [s] of one run, from which it is not repeated
FACTORS = {"dh": 1e3, "torque": 1.0, "motion": 1e3}  # mm, N m, mrad


def peak() -> int:
    """The largest memory of this process [byte]; what a parent had before is none of its own."""
    status = Path("/proc/self/status")
    for line in status.read_text(encoding="ascii").splitlines() if status.exists() else ():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def figures(way: Any, subject: str, given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """What is compared, and further figures [mm, mrad, N m, ms]."""
    if subject == "registration":
        there = np.einsum("mij,mj->mi", found[:, :3, :3], given["target_ct"]) + found[:, :3, 3]
        misses = np.linalg.norm(there - given["target_robot"], axis=1)
        return {"error": 1e3 * float(misses.mean())}
    if subject == "hand_eye":
        apart = np.linalg.inv(given["tool"]) @ found
        angle = np.arccos(np.clip((np.trace(apart[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
        place = np.linalg.norm(apart[:, :3, 3], axis=1)
        return {"error": 1e3 * float(place.mean()), "turn": 1e3 * float(angle.mean())}
    if subject == "programme":
        return {key: float(value) for key, value in found.items()}
    misses = getattr(way, f"{subject}_misses")(given, found)
    return {"error": FACTORS[subject] * float(np.sqrt(np.mean(np.square(misses))))}


def main(module: str, subject: str, given_file: str) -> None:
    """Solve, judge and print."""
    with np.load(given_file, allow_pickle=False) as stored:
        given = dict(stored)
    way = import_module(module)
    solve = getattr(way, subject)
    seconds: list[float] = []
    while len(seconds) < 1 + RUNS and (not seconds or seconds[-1] < PATIENCE):
        begun = process_time()
        found = solve(given)
        seconds.append(process_time() - begun)
    told = {
        "version": version(way.PACKAGE),
        "first": seconds[0],
        "seconds": min(seconds[1:], default=seconds[0]),
        "memory": peak(),
        "figures": figures(way, subject, given, found),
    }
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:4])
