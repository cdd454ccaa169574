"""Which column means what: ``--map x=tip_x:mm``, ``--map q#=J#:deg``, or what names say alone.

``#`` stands for a number, from 1 (or 0) on, or else for the k-th column of that beginning. A minus
turns the sign: ``q2=-J2``. What is mapped goes before what a name says, and a name before nothing:
a column that no name tells is left out.
"""

import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from plumbline.errors import PlumblineError, best_matches, shown
from plumbline.experiments.importing import units
from plumbline.experiments.importing.tables import Raw, find
from plumbline.experiments.importing.targets import check_target, from_one, is_target
from plumbline.experiments.importing.units import Unit

CLOCKS = ("time", "timestamp", "stamp", "t", "clock", "zeit", "secs", "seconds")
COMMANDS = ("motion", "tracking")  # kinds that have commands u
INDEXED = re.compile(r"^([a-z]+)[_\[(]([0-9]{1,3})[\])]?$")  # ``q_1``, ``q[1]``: ``q1``
MOST_NUMBERED = 200  # columns of one kind; a humanoid with hands has 70 joints (bounds work only)


@dataclass(frozen=True)
class Wanted:
    """One line of a map: ``target=source:unit``."""

    target: str
    source: str
    unit: Unit | None = None
    sign: float = 1.0


@dataclass(frozen=True, eq=False)
class Match:
    """A column of a recording and the column of a table that it is made of."""

    target: str
    raw: Raw
    column: str
    unit: Unit | None
    sign: float = 1.0
    by: str = "map"


def parse(line: str) -> Wanted:
    """One line of a map (PlumblineError: it has no ``=`` or names no column of a recording)."""
    target, equals, source = (part.strip() for part in line.partition("="))
    if not equals or not target or not source:
        raise PlumblineError(f"--map {line}: expected TARGET=COLUMN or TARGET=COLUMN:UNIT")
    check_target(target.replace("#", "1"))
    column, colon, word = source.rpartition(":")
    unit = units.known(word) if colon else None
    column = column if unit else source
    sign = -1.0 if column.startswith("-") else 1.0
    return Wanted(target, column.removeprefix("-") if sign < 0 else column, unit, sign)


def mapped(raws: list[Raw], wanted: Iterable[Wanted]) -> Iterator[Match]:
    """The columns that a map names (PlumblineError: one is not there)."""
    wanted = list(wanted)
    own = {want.source for want in wanted if "#" not in want.target}
    for want in wanted:
        try:
            sources = _family(raws, want, own) if "#" in want.target else [want.source]
            matches = [
                _match(raws, want, want.target.replace("#", str(k)), source)
                for k, source in enumerate(sources, start=1)
            ]
        except PlumblineError:
            _, colon, word = want.source.rpartition(":")
            if colon:  # no column of that name: what follows its colon was meant as a unit
                units.unit(word)
            raise
        yield from matches


def _match(raws: list[Raw], want: Wanted, target: str, source: str) -> Match:
    raw, column = find(raws, source)
    return Match(target, raw, column, want.unit or _unit(raw, column), want.sign)


def _family(raws: list[Raw], want: Wanted, own: Container[str]) -> list[str]:
    """The columns that ``J#`` stands for, in order, but for those that have a line of their own."""
    table, at, pattern = want.source.rpartition("@")
    before, mark, after = pattern.partition("#")
    names = [
        name for raw in raws if not at or raw.name == table or raw.name.startswith(f"{table}.")
        for name in raw.columns if name not in own and f"{raw.name}@{name}" not in own
    ]  # fmt: skip
    if not mark:
        raise PlumblineError(
            f"--map {want.target}={want.source}: expected # in {shown(pattern)}, for the number "
            f"of a column; best matches: {best_matches(pattern, names)}"
        )
    for first in (0, 1):
        numbers = [f"{before}{k}{after}" for k in range(first, MOST_NUMBERED)]
        there = [n for k, n in enumerate(numbers) if n in names and set(numbers[:k]) <= set(names)]
        if there:
            return [f"{table}{at}{name}" for name in there]
    found = [n for n in dict.fromkeys(names) if n.startswith(before) and n.endswith(after)]
    if not found or not (before or after):
        raise PlumblineError(
            f"--map {want.target}={want.source}: no column like {shown(pattern)}; name them one "
            f"by one; best matches: {best_matches(pattern, names)}"
        )
    return [f"{table}{at}{name}" for name in found]


def named(
    raws: list[Raw], taken: Sequence[Match], joints: Sequence[str], kind: str | None
) -> tuple[list[Match], list[str]]:
    """The columns that their names tell, and notes on those that two tables have."""
    have = {match.target for match in taken}
    used = {(match.raw.name, match.column) for match in taken}
    found: dict[str, list[Match]] = {}
    for raw in raws:
        for column, (target, by) in _told(raw, joints).items():
            commands = target.startswith("u") and kind not in (None, *COMMANDS)
            free = target not in have and (raw.name, column) not in used
            if free and target != "time" and not commands:
                match = Match(target, raw, column, _unit(raw, column), by=by)
                found.setdefault(target, []).append(match)
    single = [matches[0] for matches in found.values() if len(matches) == 1]
    notes = [
        f"{target} could be {' or '.join(f'{m.raw.name}@{m.column}' for m in matches[:3])}: "
        f"left out; --map {target}=... says which"
        for target, matches in found.items()
        if len(matches) > 1
    ]
    return single, notes


def _told(raw: Raw, joints: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Column of the table -> column of a recording, and by what it is told."""
    told: dict[str, tuple[str, str]] = {}
    by_joint = _by_joint(raw, joints)
    headers = {column: units.of_header(column)[0].lower() for column in raw.columns}
    plains = {column: INDEXED.sub(r"\1\2", header) for column, header in headers.items()}
    for column, name in plains.items():
        plain = from_one(name, plains.values())
        if column in by_joint:
            told[column] = by_joint[column], "joint name"
        elif is_target(plain) and (not by_joint or plain not in by_joint.values()):
            told[column] = plain, "name"
        elif column in raw.roles and raw.roles[column] not in by_joint.values():
            told[column] = raw.roles[column], "form"
    doubled = [target for target, _ in told.values()]
    return {c: t for c, t in told.items() if doubled.count(t[0]) == 1}


def _by_joint(raw: Raw, joints: Sequence[str]) -> Mapping[str, str]:
    """Columns called by the robot's joints, alone or behind ``position.`` and the like."""
    prefixes = {
        "": "q", "position.": "q", "velocity.": "velocity", "effort.": "effort",
        "acceleration.": "acceleration", "observation.state.": "q", "action.": "u",
    }  # fmt: skip
    found: dict[str, str] = {}
    plain = {units.of_header(column)[0].removesuffix(".pos"): column for column in raw.columns}
    for before, prefix in prefixes.items():
        names = [f"{before}{joint}" for joint in joints]
        if names and set(names) <= set(plain) and prefix not in {v[:-1] for v in found.values()}:
            found |= {plain[name]: f"{prefix}{k}" for k, name in enumerate(names, start=1)}
    return found


def joints_without(raws: Iterable[Raw], joints: Sequence[str]) -> list[str]:
    """The joints after which not exactly one column of any table is called, of the best table."""
    prefixes = ("", "position.", "observation.state.", "q.")
    least = list(joints)
    for raw in raws:
        plain = [units.of_header(column)[0].removesuffix(".pos") for column in raw.columns]
        for before in prefixes:
            there = [plain.count(f"{before}{joint}") == 1 for joint in joints]
            lacking = [joint for joint, one in zip(joints, there, strict=True) if not one]
            least = min(least, lacking, key=len)
    return least


def _unit(raw: Raw, column: str) -> Unit | None:
    said = raw.units.get(column)
    return units.known(said) if said else units.of_header(column)[1]


def clock_of(raw: Raw, wanted: Iterable[Wanted]) -> tuple[str, Unit | None] | None:
    """The column with a table's clock and its unit, or None: as a map says, else by its name."""
    for want in wanted:
        if want.target == "time" and (column := _mapped_clock(raw, want)):
            return column, want.unit or _unit(raw, column)
    for column in raw.columns:
        told = units.of_header(column)[0].lower() in CLOCKS or raw.roles.get(column) == "time"
        if told:
            return column, _unit(raw, column)
    return None


def _mapped_clock(raw: Raw, want: Wanted) -> str | None:
    """The column of a table that a line of a map says is the clock; None if it means another's."""
    table, at, column = want.source.rpartition("@")
    mine = not at or table in (raw.name, raw.name.rpartition(".")[0])
    called = [name for name in raw.columns if units.of_header(name)[0] == column]
    there = [column] if column in raw.columns else called
    return there[0] if mine and there else None


def refuse_lost_clocks(raws: list[Raw], wanted: Iterable[Wanted]) -> None:
    """Refuse a map of a clock that no table has; one may be the clock of several."""
    for want in wanted:
        lost = not any(_mapped_clock(raw, want) for raw in raws)
        if want.target == "time" and lost:
            find(raws, want.source)
