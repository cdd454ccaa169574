r"""Couplings that are known: joints that mimic another, and readings that another joint moves.

.. math:: q_m = k\, q_j + c \quad\text{(mimic joints of a URDF)}, \qquad
          q_i \leftarrow q_i + k\, q_j \quad\text{(``[robot] couplings'')}

Both are the robot as it is meant to be; what deviates from them is a ``joint_coupling``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeGuard
from xml.etree import ElementTree

import numpy as np

from plumbline.errors import shown
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.origin import Array
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Table

MOVING = ("velocity", "acceleration")  # that follow with the multiplier alone
DEFAULTS = (("multiplier", "1"), ("offset", "0"))
Mimic = tuple[str, float, float]  # the joint that is followed, multiplier, offset [rad or m]


def mimics_of(robot: Robot) -> dict[str, Mimic]:
    """The joints of a robot's URDF that follow another, by name."""
    if robot.urdf is None:
        return {}
    found: dict[str, Mimic] = {}
    for joint in ElementTree.fromstring(robot.urdf).findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            k, c = (float(mimic.get(key, default)) for key, default in DEFAULTS)
            found[str(joint.get("name"))] = (str(mimic.get("joint")), k, c)
    return found


def with_mimics(table: Table, robot: Robot, chain_joints: int) -> Table:
    """The table with columns of the joints that follow others, where it holds the others alone.

    Args:
        table: Columns ``q1..qk``, one for each joint that moves on its own, in the model's order.
        robot: The robot.
        chain_joints: Joints of the chain; a table of that many columns is of those.
    """
    mimics = mimics_of(robot)
    movable = [str(name) for name in robot.model.names][1:]
    free = [name for name in movable if name not in mimics]
    count = sum(f"q{k}" in table for k in range(1, len(movable) + 1))
    if len(free) == len(movable) or count != len(free) or count == chain_joints:
        return table
    place = {name: k for k, name in enumerate(free, start=1)}
    columns = dict(table.columns)
    for prefix in ("q", *MOVING, "direction", "effort", "m"):
        if f"{prefix}1" not in table:
            continue
        for k in range(1, len(free) + 1):
            columns.pop(f"{prefix}{k}", None)
        for number, name in enumerate(movable, start=1):
            columns[f"{prefix}{number}"] = _cells(table, prefix, name, place, mimics)
    return replace(table, columns=columns)


def _cells(
    table: Table, prefix: str, name: str, place: dict[str, int], mimics: dict[str, Mimic]
) -> Sequence[str]:
    """A joint's own cells, or what follows from those of the joint that it mimics."""
    if name in place:
        return table.columns[f"{prefix}{place[name]}"]
    leader, k, c = mimics[name]
    if leader not in place or prefix in ("effort", "m"):
        return ["" if prefix == "m" else "0"] * len(table)
    values = table.numbers(f"{prefix}{place[leader]}")
    follow = {"q": k * values + c, "direction": np.sign(k) * values}
    return [repr(float(v)) for v in follow.get(prefix, k * values)]


def coupled(values: Array, numbers: Sequence[int], settings: Section) -> Array:
    """Readings (N, n) or velocities with what other joints add to them.

    Args:
        values: Columns of the chain's joints (N, n).
        numbers: Their numbers in the file (n), from 1.
        settings: The recording's; ``[robot] couplings`` lists ``[joint, by, gain]``.

    Raises:
        PlumblineError: An entry is no coupling of two joints of the chain.
    """
    section = settings.section("robot")
    found = values.copy()
    entries = section.values.get("couplings", [])
    for entry in entries if isinstance(entries, list) else [entries]:
        if not _is_coupling(entry, numbers):
            expected = f"[joint, by, gain] of two joints of the chain, not {shown(entry)}"
            raise section.fault("couplings", expected, "write couplings = [[5, 4, -0.5]]")
        joint, by, gain = entry
        found[:, list(numbers).index(joint)] += gain * values[:, list(numbers).index(by)]
    return found


def _is_coupling(entry: object, numbers: Sequence[int]) -> TypeGuard[list[Any]]:
    if not isinstance(entry, list) or len(entry) != 3 or entry[0] == entry[1]:
        return False
    gain = isinstance(entry[2], int | float) and not isinstance(entry[2], bool)
    return gain and all(type(j) is int and j in numbers for j in entry[:2])
