"""Damage to the files of a recording, drawn at random: of bytes, of cells, of whole files.

Each kind of damage takes a file's bytes and a generator, and gives other bytes; those of
:data:`ODD_FILES` put something else than a file in its place.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from plumbline.kinematics.constants import LARGEST_FILE

Generator = np.random.Generator
Damage = Callable[[bytes, Generator], bytes]

# What breaks readers: odd numbers, separators, line ends, marks of CSV, TOML and XML.
NASTY = (
    *("", " ", "nan", "-inf", "-", "1e999", "1e308", "-1e300", "0x10", "1_000", "1,5", "1e-320"),
    *('"', "'", "\0", "#", "true", "[]", "{}", "\ufeff", "\u2028", "\x85", "\u0663", "0", "-0"),
    *("-1", "\r", "\n\n", "=", "..", "[[robot.dh]]", "q1", "x", "<", "&a;", "\\", "\x1b[31m"),
    *("9" * 400, "2" * 5000, "1979-05-27", "[1, [2, [3]]]", "-1e-9", "1e12", "\U0001f9ea", ";"),
)
NUMBERS = (0.0, -1.0, 1e-3, 1e3, 1e2, 180.0 / np.pi, 1e-30, 1e30, 1e300, np.inf, np.nan, 1.001)
KEYS = (
    *('always = ["frame"]', "always = []", 'always = ["joint_offset", "tool"]', "distance = -1"),
    *("noise_std = 1e-300", "noise_std = 1e300", "noise_std_rotation = 0", "measured_joints = [3]"),
    *("measured_joints = []", "measured_joints = [9, 9]", 'tip_frame = "lamp"', "gravity = 9.81"),
    *(
        "gravity = [0, 0, 0]",
        "offset = [1e9, 0, 0]",
        'urdf = "../robot.urdf"',
        'urdf = "/dev/zero"',
    ),
    *('bundled = "ur3"', 'bundled = "panda"', "pairs = [[0, 1], [1, 1]]", "name = [3]"),
    *('observation = "pose"', 'observation = "fixed_point"', 'observation = "fiducials"'),
    *('observation = "plane_range"', 'observation = "tracking"', 'observation = "joint_position"'),
    *("d = 1e9", "alpha = 90", 'kind = "fixed"', 'kind = "prismatic"', "ct_std = -1", "a = nan"),
)


def insert(data: bytes, rng: Generator) -> bytes:
    """A nasty word somewhere."""
    at = rng.integers(len(data) + 1)
    return data[:at] + _nasty(rng) + data[at:]


def replace(data: bytes, rng: Generator) -> bytes:
    """A nasty word instead of one of the words."""
    return _at_one(rb"[^,\n\"\[\]= ]+", data, rng, lambda word: _nasty(rng))


def cut(data: bytes, rng: Generator) -> bytes:
    """The file ends early."""
    return data[: rng.integers(len(data) + 1)]


def flip(data: bytes, rng: Generator) -> bytes:
    """Some bytes are others."""
    found = bytearray(data)
    for at in rng.integers(len(data), size=rng.integers(1, 6)) if data else ():
        found[at] = rng.integers(256)
    return bytes(found)


def drop(data: bytes, rng: Generator) -> bytes:
    """A line is missing."""
    return _at_one(rb"[^\n]*\n", data, rng, lambda line: b"")


def double(data: bytes, rng: Generator) -> bytes:
    """A line stands there several times."""
    times = int(rng.choice([2, 3, 2000]))
    return _at_one(rb"[^\n]*\n", data, rng, lambda line: times * line)


def shuffle(data: bytes, rng: Generator) -> bytes:
    """Lines in another order, the first one's aside."""
    first, *rest = data.split(b"\n")
    return b"\n".join([first, *(rest[k] for k in rng.permutation(len(rest)))])


def blanks(data: bytes, rng: Generator) -> bytes:
    """A long run of one mark: what a regular expression may look through again and again."""
    at = rng.integers(len(data) + 1)
    mark = str(rng.choice(list("[{(<.,= \t\"'#&\\-0a\n"))).encode()
    opened = mark + b" " * int(rng.choice([4000, 50_000])) if rng.random() < 0.5 else mark
    return data[:at] + (opened if opened != mark else mark * 50_000) + data[at:]


def line_ends(data: bytes, rng: Generator) -> bytes:
    """Line ends of another system."""
    return data.replace(b"\n", bytes(rng.choice([b"\r\n", b"\r", b"\n\r", b"\n\n"])))


def encoding(data: bytes, rng: Generator) -> bytes:
    """Another encoding, with or without its mark."""
    kind = str(rng.choice(["utf-16", "utf-8-sig", "utf-16-le", "utf-32", "utf-7", "cp500"]))
    return data.decode("utf-8", "replace").encode(kind, "replace")


def zeros(data: bytes, rng: Generator) -> bytes:
    """A page of zeros, as a crash of a file system leaves it."""
    at = rng.integers(len(data) + 1)
    return data[:at] + bytes(4096) + data[at + 4096 :]


def noise(data: bytes, rng: Generator) -> bytes:
    """No text at all."""
    return rng.bytes(int(rng.integers(0, 3000)))


def column(data: bytes, rng: Generator) -> bytes:
    """A column times a factor, or constant, or sorted, or another's."""
    rows = [line.split(b",") for line in data.split(b"\n")]
    width = len(rows[0])
    k, other = rng.integers(width, size=2)
    cells = [row[k] for row in rows[1:] if len(row) == width]
    how, factor = rng.integers(5), float(rng.choice(NUMBERS))
    if how == 0:
        cells = [_times(cell, factor) for cell in cells]
    elif how == 1:
        cells = [cells[0] if cells else b""] * len(cells)
    elif how == 2:
        cells = sorted(cells)
    elif how == 3:
        cells = [row[other] for row in rows[1:] if len(row) == width]
    else:
        cells = [b""] * len(cells)
    full = iter(cells)
    for row in rows[1:]:
        if len(row) == width:
            row[k] = next(full)
    return b"\n".join(b",".join(row) for row in rows)


def columns(data: bytes, rng: Generator) -> bytes:
    """Columns more, fewer, swapped, or of other names."""
    rows = [line.split(b",") for line in data.split(b"\n")]
    width = len(rows[0])
    how = rng.integers(4)
    if how == 0:
        count = int(rng.choice([1, 400, 20_000]))
        rows = [
            row + [b"c%d" % j if i == 0 else b"1" for j in range(count)] if len(row) > 1 else row
            for i, row in enumerate(rows)
        ]
    elif how == 1:
        k = rng.integers(width)
        rows = [row[:k] + row[k + 1 :] for row in rows]
    elif how == 2:
        order = rng.permutation(width)
        rows[0] = [rows[0][k] for k in order]
    else:
        names = (b"q1", b"q7", b"m1", b"group", b"held_out", b"time", b"payload", b"z", b"mark")
        rows[0][rng.integers(width)] = names[rng.integers(len(names))]
    return b"\n".join(b",".join(row) for row in rows)


def few(data: bytes, rng: Generator) -> bytes:
    """Some rows only, perhaps none."""
    lines = data.split(b"\n")
    return b"\n".join(lines[: 1 + int(rng.integers(0, 12))]) + b"\n"


def key(data: bytes, rng: Generator) -> bytes:
    """A line of the settings is another one."""
    new = str(rng.choice(KEYS)).encode() + b"\n"
    return _at_one(rb"[^\n]*\n", data, rng, lambda line: new if rng.random() < 0.5 else line + new)


def nested(data: bytes, rng: Generator) -> bytes:
    """Tables in tables in tables, or a key of very many parts."""
    deep = int(rng.choice([90, 3000, 100_000]))
    part = (b"x = " + b"[" * deep, b".".join([b"a"] * deep) + b" = 1", b"[" + b"a." * deep + b"a]",
            b"x = " + b"{a = " * deep)[rng.integers(4)]  # fmt: skip
    return part + b"\n" + data if rng.random() < 0.5 else data + b"\n" + part + b"\n"


def links(data: bytes, rng: Generator) -> bytes:
    """Very many links, one after another or around in a ring."""
    count = int(rng.choice([20, 499, 6000]))
    kind = rng.choice([b"fixed", b"revolute", b"prismatic", b"continuous"])
    more = b"".join(
        b'<link name="n%d"/><joint name="k%d" type="%s"><parent link="%s"/><child link="n%d"/>'
        b'<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        % (k, k, kind, b"n%d" % (k - 1) if k else b"tip", k)
        for k in range(count)
    )
    return data.replace(b"</robot>", more + b"</robot>")


def entities(data: bytes, rng: Generator) -> bytes:
    """Entities that grow, or that are another file."""
    bomb = b"".join(b'<!ENTITY e%d "%s">' % (k + 1, b"&e%d;" % k * 10) for k in range(9))
    said = (b'<!ENTITY e0 "lol">' + bomb, b'<!ENTITY e9 SYSTEM "file:///etc/passwd">')
    head = b"<!DOCTYPE robot [" + said[rng.integers(2)] + b"]><robot"
    return data.replace(b"<robot", head, 1).replace(b'"upper"', b'"&e9;"', 1)


def attributes(data: bytes, rng: Generator) -> bytes:
    """Very many attributes, or elements in elements."""
    if rng.random() < 0.5:
        many = b" ".join(b'a%d="1"' % k for k in range(30_000))
        return data.replace(b'<link name="base"/>', b'<link name="base" ' + many + b"/>")
    return data.replace(b"</robot>", b"<a>" * 40_000 + b"</a>" * 40_000 + b"</robot>")


ANYWHERE = (
    insert, replace, cut, flip, drop, double, shuffle, blanks, line_ends, encoding, zeros, noise,
)  # fmt: skip
OWN: Mapping[str, tuple[Damage, ...]] = {
    "samples.csv": (column, column, columns, few),
    "dataset.toml": (key, key, nested),
    "robot.urdf": (links, entities, attributes),
}


def _huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(LARGEST_FILE + 1)


ODD_FILES: Mapping[str, Callable[[Path], object]] = {  # what stands in a file's place
    "pipe": os.mkfifo,  # that nobody writes to
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "loop": lambda path: path.symlink_to(path),
    "folder": Path.mkdir,
    "nowhere": lambda path: path.symlink_to(path.with_name("gone")),
    "huge": _huge,  # longer than any recording's, and empty
    "missing": lambda path: None,
}


def _nasty(rng: Generator) -> bytes:
    if rng.random() < 0.25:
        return repr(float(rng.choice(NUMBERS))).encode()
    return NASTY[rng.integers(len(NASTY))].encode("utf-8", "surrogatepass")


def _at_one(pattern: bytes, data: bytes, rng: Generator, new: Callable[[bytes], bytes]) -> bytes:
    """Bytes with one match of a pattern replaced; none is no change."""
    spans = [match.span() for match in re.finditer(pattern, data)]
    if not spans:
        return data
    a, b = spans[rng.integers(len(spans))]
    return data[:a] + new(data[a:b]) + data[b:]


def _times(cell: bytes, factor: float) -> bytes:
    try:
        return repr(float(cell) * factor).encode()
    except ValueError:
        return cell
