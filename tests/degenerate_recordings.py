"""Recordings at the edge of what may be diagnosed: too few rows, too much fitted, nothing moving.

One seed is one recording: kind of observation, robot, rows, noise, columns and what is wrong with
them are drawn alike often; the readings come from the nominal model, from the model with a gap, or
from nowhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording
from tests.benches import measured, readings, sweep
from tests.random_trees import Tree

OBSERVATIONS = ("tip_position", "pose", "fixed_point", "joint_position")
ROBOTS = (
    lambda: Robot.bundled("laparoscopic"),
    lambda: Robot.from_urdf(Tree(3, ("revolute",) * 3).urdf()),
    lambda: Robot.from_urdf(Tree(5, ("revolute", "prismatic", "revolute")).urdf()),
    lambda: Robot.bundled("ur5"),
)
NOISES = (None, None, 1e-15, 1e-10, 1e-7, 1e-4, 3e-2, 0.9)
SIZES = (0.0, 1e-13, 1e-7, 1e-4, 1e-2, 1.0)
ROWS = (4, 5, 6, 7, 8, 10, 14, 25)
MAY_BE_NO_NUMBER = ("removable", "std", "unlisted")


def degenerate(seed: int) -> Recording:
    """The recording of a seed; a PlumblineError where it is refused."""
    rng = np.random.default_rng(seed)
    observation = OBSERVATIONS[seed % len(OBSERVATIONS)]
    robot = ROBOTS[int(rng.choice(len(ROBOTS), p=(0.12, 0.42, 0.42, 0.04)))]()
    chain, rows = robot.chain(), int(rng.choice(ROWS))
    q = (sweep if rng.random() < 0.2 else readings)(chain, rows)
    q = _stiff(q, rng)
    context = _context(chain.n, rows, rng)
    if observation == "fixed_point":
        context["socket"] = _sockets(rows, rng)
        if rng.random() < 0.3:
            context["socket_distance"] = float(rng.choice([1e-3, 0.1, 0.7]))
    noise = NOISES[rng.integers(len(NOISES))]
    return build_recording(
        name=f"degenerate-{seed}",
        observation=observation,
        robot=robot,
        q=q,
        measured=_measured(chain, q, observation, rng),
        tool_offset=rng.normal(0.0, rng.choice([0.0, 0.1]), 3),
        noise_std=noise,
        always=_always(rng),
        **context,
    )


def _stiff(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Some joints stand still, some postures are repeated, some rows are one posture."""
    q = q.copy()
    still = rng.random(q.shape[1]) < rng.choice([0.0, 0.0, 0.4, 0.8])
    q[:, still] = q[0, still]
    if rng.random() < 0.3:
        q = q[np.arange(len(q)) % rng.integers(2, len(q) + 1)]
    if rng.random() < 0.1:
        q[:, rng.integers(q.shape[1])] *= 1e-7
    return q


def _measured(
    chain: Any, q: np.ndarray, observation: str, rng: np.random.Generator
) -> np.ndarray | None:
    """What a device reads: exact, with a gap, rounded, the same in each row, or of other rows."""
    off = rng.normal(0.0, rng.choice(SIZES), chain.n) * (rng.random(chain.n) < 0.4)
    read = measured(chain, q + off, observation)
    if read is None:
        return None
    size = 3 if observation == "pose" else read.shape[1]
    read[:, :size] += rng.normal(0.0, rng.choice(SIZES[:-1]), (len(q), size))
    odd = rng.random()
    if odd < 0.1:
        read = read[rng.permutation(len(read))]
    elif odd < 0.2:
        read[rng.integers(len(read)), :size] += 10.0 ** rng.integers(-3, 3)
    elif odd < 0.25:
        read[:, :size] = np.round(read[:, :size], 3)
    if observation == "joint_position" and rng.random() < 0.6:
        unseen = rng.random(chain.n) < 0.5
        unseen[rng.integers(chain.n)] = False
        read[:, unseen] = np.nan
    return read


def _sockets(rows: int, rng: np.random.Generator) -> np.ndarray:
    count = int(rng.integers(1, max(rows // 2, 2)))
    return rng.permutation(np.arange(rows) % count)


def _context(n: int, rows: int, rng: np.random.Generator) -> dict[str, Any]:
    """Optional columns, each there or not, and then constant, of one row, or as it should be."""
    columns = {
        "time": np.linspace(0.0, 90.0, rows),
        "temperature": rng.uniform(18.0, 35.0, rows),
        "payload": rng.uniform(0.0, 3.0, rows),
        "direction": rng.choice([-1.0, 0.0, 1.0], (rows, n)),
        "velocity": rng.normal(0.0, 0.5, (rows, n)),
        "effort": rng.normal(0.0, 20.0, (rows, n)),
    }
    there = {k: v for k, v in columns.items() if rng.random() < 0.35}
    for values in there.values():
        odd = rng.random()
        if odd < 0.3:
            values[:] = values[0]
        elif odd < 0.4:
            values[:-1] = values[0]
    if rng.random() < 0.4:
        there["group"] = np.arange(rows) // rng.integers(1, rows)
    if rng.random() < 0.4:
        there["held_out"] = _held_out(rows, rng)
    return there


def _held_out(rows: int, rng: np.random.Generator) -> np.ndarray:
    """Kept back: the last rows, single ones, or all but as many as can be fitted."""
    flags = np.zeros(rows, dtype=int)
    flags[rng.permutation(rows)[: rng.integers(1, max(rows // 2, 2))]] = 1
    return np.sort(flags) if rng.random() < 0.5 else flags


def _always(rng: np.random.Generator) -> tuple[str, ...]:
    usual = [("frame", "tool"), ("frame", "tool"), ("frame",), ("tool",), ()]
    more = rng.choice(list(REGISTRY), rng.choice([0, 0, 0, 1, 2, 4]), replace=False)
    return (*usual[rng.integers(len(usual))], *map(str, more))


def no_numbers(value: Any, path: str = "") -> Iterator[str]:
    """Paths in a verdict's dictionary at which there is no number where one belongs."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in MAY_BE_NO_NUMBER:
                yield from no_numbers(inner, f"{path}.{key}")
    elif isinstance(value, list | tuple):
        for k, inner in enumerate(value):
            yield from no_numbers(inner, f"{path}[{k}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield path
