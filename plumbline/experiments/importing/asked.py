"""What an import is asked: options of a command, a TOML file of the same, or both.

The TOML file is ``dataset.toml`` as it shall be, with a table ``[columns]`` and, where wanted,
``units``, ``gap``, ``derive``, ``still``, ``rotation`` and ``[shift]``; an option goes before it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError, one_line, shown
from plumbline.experiments.importing import joining, mapping, units
from plumbline.experiments.importing.tables import Raw
from plumbline.experiments.importing.understood import Request
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.files import read_file, reason
from plumbline.kinematics.linkage import mimics_of
from plumbline.kinematics.robot import Robot, bundled_names, makers_joints
from plumbline.optim.recording.settings import read_settings

AMOUNT = re.compile(r"^\s*(?P<numbers>[-+.\deE,\s]+?)\s*:?\s*(?P<unit>[A-Za-z]*)\s*$")
OWN = ("columns", "units", "gap", "derive", "still", "rotation", "shift")
LARGEST_MAP = 1_000_000  # [byte]


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked of the tables, and what ``dataset.toml`` will say."""

    request: Request  # what is asked of the tables
    settings: Mapping[str, Any]  # keys and tables of ``dataset.toml``
    # files to copy, by the name that they get
    files: Mapping[str, Path] = field(default_factory=dict)


def asked(
    options: Mapping[str, Any], lines: Sequence[str], toml: Path | None, raws: Sequence[Raw] = ()
) -> Asked:
    """What options ask, over a TOML file, over what the tables say of the robot; else refused.

    ``options`` are values by name, as in the TOML file, None for what was not given; ``robot`` is
    a name or a file, ``tool`` and ``noise`` are texts with units. A line is
    ``TARGET=COLUMN:UNIT``.
    """
    base = _of_file(toml) if toml else {}
    given = {**base, **{k: v for k, v in options.items() if v not in (None, (), [], {})}}
    if "robot" not in given:
        given |= _told_robot(raws)
    settings = {k: v for k, v in given.items() if k not in (*OWN, "tip_frame", "noise", "tool")}
    if "tool" in given:
        tool = given["tool"]
        tool = tool if isinstance(tool, dict) else {"offset": _amount(tool, "--tool", 3)}
        settings["tool"] = tool
    settings |= {"noise_std": _amount(given["noise"], "--noise", 1)[0]} if "noise" in given else {}
    table, files, robot = named_robot(given.get("robot"), toml)
    if given.get("tip_frame"):
        table["tip_frame"] = given["tip_frame"]
    settings |= {"robot": table} if table else {}
    chain = robot.chain(table.get("tip_frame")) if robot else None
    columns = {want.target: want for want in _columns(base)} if toml else {}
    clocks = [mapping.parse(line) for line in lines]
    kept = [want for target, want in columns.items() if target not in {c.target for c in clocks}]
    request = Request(
        columns=(*kept, *clocks),
        units=tuple(map(units.unit, _words(given.get("units"), "units"))),
        observation=settings.get("observation"),
        joints=_names(table, chain) if chain else (),
        kinds=chain.kinds if chain else (),
        followers=tuple(mimics_of(robot.urdf)) if robot else (),
        gap=None if given.get("gap") is None else _length_of_time(given["gap"]),
        shifts={str(k): _number(v, "shift") for k, v in dict(given.get("shift", {})).items()},
        derive=_words(given.get("derive"), "derive"),
        still=_number(given.get("still", joining.STILL), "still"),
        rotation=str(given.get("rotation", "rotvec")),
    )
    return Asked(request, settings, files)


def shift(word: str) -> tuple[str, float]:
    """``NAME=SECONDS`` (PlumblineError: it is not of that form)."""
    name, equals, seconds = word.partition("=")
    if not equals:
        raise PlumblineError(f"--shift {word}: expected NAME=SECONDS")
    return name.strip(), _number(seconds, "shift")


def _told_robot(raws: Sequence[Raw]) -> dict[str, str]:
    told = next((raw for raw in raws if raw.robot not in ("", "unknown")), None)
    if told is None:
        return {}
    word = told.robot.lower().removesuffix("_follower")  # of a leader and a follower, the arm
    try:
        _made(_source_of(word), {})
    except PlumblineError as error:
        why = f"{told.name}: its robot {shown(told.robot)} is none known here: {error}"
        raise PlumblineError(f"{one_line(why)}; say which: --robot NAME, or a file") from None
    return {"robot": word}


def _number(value: object, what: str) -> float:
    try:
        number = float(str(value))
    except ValueError:
        number = float("nan")
    if not abs(number) < float("inf"):
        raise PlumblineError(f"{what} {shown(value)}: expected a finite number")
    return number


def _length_of_time(value: object) -> float:
    gap = _number(value, "gap")
    if gap < 0.0:
        raise PlumblineError(f"gap {gap:g}: expected seconds, 0 or more")
    return gap


def _words(value: object, what: str) -> tuple[str, ...]:
    """Words of a list, or of one text with commas between them."""
    if value is None:
        return ()
    words = value.split(",") if isinstance(value, str) else value
    if not isinstance(words, list | tuple) or not all(isinstance(word, str) for word in words):
        raise PlumblineError(f"{what}: found {shown(value)}, expected a list of words")
    return tuple(part.strip() for word in words for part in word.split(",") if part.strip())


def _amount(value: object, what: str, count: int) -> list[float]:
    """Lengths [m] of ``0.1mm`` or ``0,0,200 mm``, or of bare numbers in m."""
    match = AMOUNT.match(value) if isinstance(value, str) else None
    if isinstance(value, int | float):
        return [float(value)]
    words = match["numbers"].replace(",", " ").split() if match else []
    if match is None or len(words) != count:
        numbers = "a number" if count == 1 else "three numbers"
        raise PlumblineError(f"{what} {shown(value)}: expected {numbers} and a unit, such as mm")
    unit = units.unit(match["unit"] or "m")
    if unit.dimension not in ("length", "angle"):
        raise PlumblineError(
            f"{what} {value}: {unit.name} is of {unit.dimension}, expected mm or m"
        )
    return [_number(word, what) * unit.factor for word in words]


def _of_file(path: Path) -> dict[str, Any]:
    try:
        data = read_file(path, LARGEST_MAP)
    except (OSError, ValueError) as error:
        raise PlumblineError(f"{path}: a map that cannot be read ({reason(error)})") from None
    return dict(read_settings(path.name, data).values)


def _columns(base: Mapping[str, Any]) -> list[mapping.Wanted]:
    table = base.get("columns", {})
    if not isinstance(table, dict) or not all(isinstance(v, str) for v in table.values()):
        raise PlumblineError('[columns]: expected lines such as x = "tip_x:mm"')
    return [mapping.parse(f"{target}={source}") for target, source in table.items()]


def named_robot(
    given: object, toml: Path | None = None
) -> tuple[dict[str, Any], dict[str, Path], Robot | None]:
    """``[robot]``, the files that it needs, and the robot of a name or a file, refused if none."""
    if given is None:
        return {}, {}, None
    table = dict(given) if isinstance(given, dict) else _source_of(str(given))
    mapped = toml if isinstance(given, dict) else None
    where, files = f"{mapped.name}: [robot]" if mapped else "--robot", dict[str, Path]()
    for key, name in (("urdf", "robot.urdf"), ("mjcf", "robot.xml")):
        if key in table:
            files[name] = (mapped.parent if mapped else Path()) / table[key]
            table[key] = name
            if not files[name].is_file():
                raise PlumblineError(f"{where}: {files[name]}: found no such file; check the path")
    try:
        return table, files, _made(table, files)
    except PlumblineError as error:
        raise PlumblineError(one_line(f"{where}: {error}")) from None


def _names(table: Mapping[str, Any], chain: Chain) -> tuple[str, ...]:
    """Names of the joints, as the robot's maker calls them where that is known."""
    maker = makers_joints(str(table["bundled"])) if "bundled" in table else ()
    return maker or chain.joint_names


def _source_of(word: str) -> dict[str, Any]:
    """A file by its ending, a bundled robot by its name, any other name a description."""
    ending = Path(word).suffix.lower()
    if ending in (".urdf", ".xacro"):
        return {"urdf": word}
    if ending in (".xml", ".mjcf"):
        return {"mjcf": word}
    return {"bundled": word} if word in bundled_names() else {"description": word}


def _made(table: Mapping[str, Any], files: Mapping[str, Path]) -> Robot | None:
    if "urdf" in table:
        return Robot.from_urdf(files["robot.urdf"])
    if "mjcf" in table:
        return Robot.from_mjcf(files["robot.xml"])
    if "bundled" in table:
        return Robot.bundled(str(table["bundled"]))
    if "description" in table:
        return Robot.described(str(table["description"]))
    rows = table.get("dh")
    return Robot.from_dh(rows) if isinstance(rows, list) else None
