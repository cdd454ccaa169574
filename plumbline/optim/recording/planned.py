"""Rows to come in the columns of a recording's own file: the inverse of how columns are read.

A joint that follows another has no column of its own where the file holds the others alone; where
the one that it follows is no joint of the chain, that one's column tells where it is to be. What
known couplings add to a reading is taken off again.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.linkage import mimics_of
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.columns import coupled, joint_columns, with_mimics
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Array, Table


def as_in_file(
    table: Table, robot: Robot, chain: Chain, settings: Section, rows: Mapping[str, Array]
) -> dict[str, Array]:
    """Columns (N,) by their names in the file, of what joints do (N, n) by prefix: ``q`` and so on.

    ``table`` is the file's own, as it was read.
    """
    whole = with_mimics(table, robot, chain)
    numbers, own = joint_columns(whole, robot, chain).numbers, whole is table
    adds = coupled(np.eye(chain.n), numbers, settings)
    found: dict[str, Array] = {}
    for prefix, values in rows.items():
        read = values @ np.linalg.inv(adds) if prefix in ("q", "velocity") else values
        for j, moved in _leaders_last(robot, chain, prefix, read, own=own):
            found[whole.origin.column(f"{prefix}{numbers[j]}")] = moved
    return found


def _leaders_last(
    robot: Robot, chain: Chain, prefix: str, values: Array, *, own: bool
) -> Iterator[tuple[int, Array]]:
    """Joints (from 0) with what their columns hold (N,); ``own`` where each has one."""
    mimics = {} if own else mimics_of(robot.urdf)
    names = chain.joint_names
    for j in sorted(range(chain.n), key=lambda j: names[j] not in mimics):
        _, times, zero = mimics.get(names[j], ("", 1.0, 0.0))
        led = (values[:, j] - (zero if prefix == "q" else 0.0)) / times
        yield j, np.sign(led) if prefix == "direction" else led
