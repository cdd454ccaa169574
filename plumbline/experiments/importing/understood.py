"""The rows as they were understood: of which file, in which unit, and what was left out.

The rows are those of the table that holds what was measured; other tables give each the reading
nearest in time. A row that lacks anything is left out, and counted.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.errors import PlumblineError, fault, listed, shown
from plumbline.experiments.importing import joining, mapping, rotations, targets
from plumbline.experiments.importing.joining import NOBODY, partners
from plumbline.experiments.importing.mapping import Match, Wanted
from plumbline.experiments.importing.tables import Array, Raw
from plumbline.experiments.importing.units import SI, UNITS, Unit
from plumbline.optim.core.quantities import counted

DERIVED = ("velocity", "direction")
LATEST = 1e11  # [s] of a clock: the year 5138 since 1970; stamps of our time in ms are above it


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of the tables."""

    columns: tuple[Wanted, ...] = ()  # lines of the map
    units: tuple[Unit, ...] = ()  # units of whatever has none of its own
    observation: str | None = None  # kind of recording, or None for what the columns make
    joints: tuple[str, ...] = ()  # names of the robot's joints, where it is known
    kinds: tuple[str, ...] = ()  # ``"revolute"`` or ``"prismatic"`` by joint
    followers: tuple[str, ...] = ()  # the joints that mimic another
    # how far apart readings of two tables may be [s]; None where tables are not joined
    gap: float | None = None
    # what is added to a table's clock [s], by its name
    shifts: Mapping[str, float] = field(default_factory=dict)
    derive: tuple[str, ...] = ()  # of :data:`DERIVED`
    still: float = joining.STILL  # motion that counts as none [rad or m]
    # how ``rx,ry,rz`` turn: ``rotvec``, or Euler axes such as ``xyz`` or ``ZYX``
    rotation: str = "rotvec"


@dataclass(frozen=True)
class Source:
    """Where a column is from: a table's column and its unit, or words."""

    place: str
    unit: str


@dataclass(frozen=True, eq=False)
class Understood:
    """Rows as they will be written."""

    observation: str  # kind of recording
    samples: pd.DataFrame  # the rows, in SI units
    sources: Mapping[str, Source]  # where each column is from
    notes: tuple[str, ...]  # what was left out, and why


def understand(raws: list[Raw], request: Request) -> Understood:
    """The rows of a recording (PlumblineError: a column lacks, or tables cannot be joined)."""
    _shifts_are_of(raws, request.shifts)
    mapping.refuse_lost_clocks(raws, request.columns)
    request = _without_followers(raws, request)
    wanted = [want for want in request.columns if want.target != "time"]
    matches = list(mapping.mapped(raws, wanted))
    told, notes = mapping.named(raws, matches, request.joints, request.observation)
    matches += told
    there = {match.target for match in matches}
    if not there:
        columns = [f"{raw.name}@{c}" for raw in raws for c in raw.columns]
        raise PlumblineError(
            f"none of {len(columns)} columns is called as a recording's or a joint of the robot "
            f"({listed(columns, 4)}); say which is which: --map x=COLUMN:mm --map q#=J#:deg"
        )
    kind = request.observation or targets.kind_of(there)
    base = _base(matches)
    _joints_are_told(raws, matches, request, kind)
    joined, left = _joined(base, matches, request)
    table, sources = _converted(base, matches, joined, request)
    table, more = _whole(table, left, base.first)
    table = rotations.turned(table, request.rotation) if "rx" in table else table
    if "pose1" in table:
        table = rotations.posed(table, UNITS[sources["pose1"].unit].factor)
    more += _went_back(table)
    table, copies = _once(_in_order(table))
    more += copies
    table = _derived(table, request)
    for column in [str(c) for c in table if c not in sources]:
        sources[column] = _made(column, sources)
    odd = [note for raw in raws for note in raw.notes]
    unused = _unused(raws, matches, request)
    return Understood(kind, table, sources, (*odd, *notes, *more, *unused))


def _without_followers(raws: Sequence[Raw], request: Request) -> Request:
    """Without the joints that mimic another, where a table has columns of all others alone."""
    free = [k for k, name in enumerate(request.joints) if name not in request.followers]
    names = tuple(request.joints[k] for k in free)
    if not mapping.joints_without(raws, request.joints) or mapping.joints_without(raws, names):
        return request
    return replace(request, joints=names, kinds=tuple(request.kinds[k] for k in free))


def _made(column: str, sources: Mapping[str, Source]) -> Source:
    """Where a column is from that no table has."""
    if "pose1" in sources and column in (*"xyz", *targets.QUATERNION):
        return Source(sources["pose1"].place, sources["pose1"].unit if column in "xyz" else "1")
    unit = "rad/s or m/s" if column.startswith("velocity") else "1"
    return Source("rx, ry, rz" if column in targets.QUATERNION else "derived", unit)


def _joints_are_told(
    raws: list[Raw], matches: Sequence[Match], request: Request, kind: str
) -> None:
    """Refuse an arm's rows without its joints, and say how the columns left over would be these."""
    if kind not in targets.JOINTED or any(match.target == "q1" for match in matches):
        return
    used = {(match.raw.name, match.column) for match in matches}
    left = [f"{raw.name}@{c}" for raw in raws for c in raw.columns if (raw.name, c) not in used]
    joints = f", or columns called {listed(request.joints)}" if request.joints else ""
    lacking = mapping.joints_without(raws, request.joints)
    found = "no column is called as a joint of the robot"
    if len(lacking) < len(request.joints):
        found = f"no column, or more than one, is called as {listed(lacking)}"
    raise PlumblineError(
        f"{kind}: {found}, expected q1..{joints}; left over: "
        f"{listed(left, 4)}; say which: --map 'q#={_numbered_alike(left, len(request.joints))}'"
    )


def _numbered_alike(columns: Sequence[str], count: int) -> str:
    """A pattern that at least so many columns are called by, two if not known."""
    for column in columns:
        for before, first, after in re.findall(r"^(.*?)([01])(\D*)$", column):
            number = range(int(first), int(first) + max(count, 2))
            if all(f"{before}{k}{after}" in columns for k in number):
                return f"{before}#{after}"
    return "COLUMN#:deg' or each: 'q1=COLUMN:deg"


def _base(matches: Sequence[Match]) -> Raw:
    first = {match.target: match.raw for match in reversed(matches)}
    for target in targets.MEASURED:
        if target in first:
            return first[target]
    raise PlumblineError("no column that a recording has; map them: --map x=COLUMN:mm")


def _shifts_are_of(raws: Sequence[Raw], shifts: Mapping[str, float]) -> None:
    """Refuse a shift of a clock that no table has."""
    for name in shifts:
        if not any(name in _names(raw) for raw in raws):
            there = listed(raw.name for raw in raws)
            raise fault(f"--shift {name}", f"no table {shown(name)}", f"one of {there}", "mend it")


def _names(raw: Raw) -> tuple[str, ...]:
    """What a table may be called: its name, and that without its ending."""
    return raw.name, raw.name.split(".")[0], Path(raw.name).stem


def _clock(raw: Raw, request: Request) -> Array | None:
    """A table's clock (N,) [s], nan for none; None if it has none at all."""
    told = mapping.clock_of(raw, request.columns)
    if told is None:
        return None
    column, unit = told
    shift = sum(s for name, s in request.shifts.items() if name in _names(raw))
    dated = raw.seconds(column)
    if dated is not None:
        return dated + shift
    chosen = targets.unit_for("time", unit, request.units, ())
    clock = raw.numbers(column, "a number, or a date as 2026-11-28T10:00:00.5") * chosen.factor
    clock = clock + shift
    latest = np.nanmax(np.abs(clock), initial=0.0)
    if latest > LATEST:
        mend = f"say its unit: --map time={raw.name}@{column}:ns (or us, ms)"
        raise fault(raw.name, f"a clock at {latest:.3g} s", f"at most {LATEST:.0e} s", mend)
    return clock


def _joined(
    base: Raw, matches: Sequence[Match], request: Request
) -> tuple[dict[str, NDArray[np.int64]], dict[str, int]]:
    """The row of each table that goes with each row of the base, and rows left without one.

    Tables without clocks go together row by row where they have as many.
    """
    others = {match.raw.name: match.raw for match in matches if match.raw is not base}
    rows, left = {base.name: np.arange(len(base), dtype=np.int64)}, {}
    for name, raw in others.items():
        clocks = [_clock(base, request), _clock(raw, request)]
        if clocks[0] is None and clocks[1] is None and len(raw) == len(base):
            rows[name], left[name] = rows[base.name], 0
            continue
        bare = [t.name for t, clock in zip((base, raw), clocks, strict=True) if clock is None]
        mapped = " ".join(f"--map time={table}@COLUMN:s" for table in bare)
        if request.gap is None:
            raise PlumblineError(
                f"columns of {listed([base.name, *others])}: expected how far apart in time "
                f"readings may be that belong together; say --gap 0.01 (in s) {mapped}".rstrip()
            )
        if bare:
            raise PlumblineError(f"{bare[0]}: no clock, expected one to join it by; say {mapped}")
        assert clocks[0] is not None
        assert clocks[1] is not None
        rows[name] = partners(clocks[0], clocks[1], request.gap)
        left[name] = int((rows[name] == NOBODY).sum())
        if left[name] == len(base):
            raise PlumblineError(_apart(base.name, clocks[0], name, clocks[1], request.gap))
    return rows, left


def _apart(base: str, clock: Array, name: str, other: Array, gap: float) -> str:
    """Why tables did not meet: how near they come, and where their clocks run, from the base's."""
    start = np.nanmin(clock)
    nearest = other[partners(clock, other, np.inf)] - clock
    off = nearest[np.nanargmin(np.abs(nearest))]
    runs = [f"{np.nanmin(c) - start:.6g} to {np.nanmax(c) - start:.6g} s" for c in (clock, other)]
    late = "late" if off > 0.0 else "early"
    return (
        f"{name}: no row within {gap:g} s of any of {base}, the nearest {abs(off):.4g} s {late}; "
        f"by the first of {base} its clock runs {runs[0]} and this one {runs[1]}; say --shift "
        "NAME=SECONDS, or a larger --gap"
    )


def _converted(
    base: Raw, matches: Sequence[Match], rows: Mapping[str, NDArray[np.int64]], request: Request
) -> tuple[pd.DataFrame, dict[str, Source]]:
    """Columns in SI units, in the order of a recording; nan where there is no reading."""
    found: dict[str, Any] = {}
    sources: dict[str, Source] = {}
    clock = _clock(base, request)
    if clock is not None:
        column, unit = mapping.clock_of(base, request.columns) or ("", None)
        found["time"] = clock
        dated = base.seconds(column) is not None
        shown = "date" if dated else targets.unit_for("time", unit, request.units, ()).name
        sources["time"] = Source(f"{base.name}@{column}", shown)
    n_joints = sum((targets.numbered(m.target) or ("", 0))[0] == "q" for m in matches)
    kinds = request.kinds if len(request.kinds) == n_joints else ()
    for match in sorted(matches, key=lambda m: _order(m.target)):
        values, shown = _values(match, request, kinds)
        partner = rows[match.raw.name]
        found[match.target] = np.where(partner == NOBODY, np.nan, values[partner])
        place = f"{'-' if match.sign < 0 else ''}{match.raw.name}@{match.column}"
        sources[match.target] = Source(place, shown)
    return pd.DataFrame(found), sources


def _values(match: Match, request: Request, kinds: Sequence[str]) -> tuple[NDArray[Any], str]:
    if match.target in targets.LABELS:
        return _labels(match), "1"
    try:
        unit = targets.unit_for(match.target, match.unit, request.units, kinds)
    except PlumblineError as error:
        raise PlumblineError(f"--map {error}") from None
    values = match.raw.numbers(match.column) * unit.factor + unit.offset
    return match.sign * values, unit.name


def _labels(match: Match) -> NDArray[Any]:
    """Labels: whole numbers as they are, words as they are or numbered as they come."""
    try:
        return match.raw.numbers(match.column)
    except PlumblineError:
        cells = pd.Series(match.raw.columns[match.column]).astype(str).str.strip()
    if match.target in targets.WORDS:
        return np.asarray(cells.where(cells != ""), dtype=object)
    return np.asarray(pd.factorize(cells)[0], dtype=float)


def _order(target: str) -> tuple[int, int]:
    """Joints first, then what was measured, then the rest."""
    prefix, number = targets.numbered(target) or (target, 0)
    first = ("label", "role", "u", "q", "m", *targets.LENGTHS, *targets.QUATERNION,
             "velocity", "acceleration", "effort", "direction")  # fmt: skip
    return (first.index(prefix) if prefix in first else len(first), number)


def _whole(
    table: pd.DataFrame, left: Mapping[str, int], first: int
) -> tuple[pd.DataFrame, list[str]]:
    """The rows that lack nothing, and notes on the others, of a table from a row of a file on."""
    empty = [c for c in table if table[c].isna().all() and not str(c).startswith("m")]
    if empty:
        raise PlumblineError(f"column {empty[0]}: no reading in any row; map another, or none")
    asked = table.dropna(axis=1, how="all")
    whole = asked.notna().all(axis=1)
    if not whole.any():
        raise PlumblineError(f"none of {len(table)} rows has all of {listed(asked.columns)}")
    notes = [f"{count:,} of {len(table):,} rows have no partner in {name} within the gap"
             for name, count in left.items() if count]  # fmt: skip
    lacking = int((~whole).sum())
    if lacking > max(left.values(), default=0):
        row = first + int(np.argmax(~whole.to_numpy()))
        notes.append(f"{lacking:,} of {len(table):,} rows lack a reading, row {row} the first")
    notes += [f"{counted(lacking, 'row')} left out"] if lacking else []
    return table[whole].reset_index(drop=True), notes


def _in_order(table: pd.DataFrame) -> pd.DataFrame:
    """Sorted by group and time, the clock from the first row on [s]; whole numbers as such."""
    whole = ("group", "socket", "held_out")
    for name in [c for c in map(str, table) if c in whole or c.startswith("direction")]:
        if (table[name] == table[name].round()).all():
            table = table.assign(**{name: table[name].astype(np.int64)})
    if "time" not in table:
        return table
    keys = ["group", "time"] if "group" in table else ["time"]
    table = table.sort_values(keys, kind="stable").reset_index(drop=True)
    return table.assign(time=(table["time"] - table["time"].min()).round(9))


def _once(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Each row once: what a log holds twice, clock and all, was read once."""
    if "time" not in table:
        return table, []
    copies = table.duplicated()
    said = f"{counted(int(copies.sum()), 'row')} left out: copies of another, clock and all"
    return table[~copies].reset_index(drop=True), [said] * bool(copies.any())


def _went_back(table: pd.DataFrame) -> list[str]:
    """A note on a clock that goes back: rows are sorted by it."""
    if "time" not in table or "group" in table:
        return []
    back = int((np.diff(table["time"]) < 0.0).sum())
    return [f"the clock goes back {counted(back, 'time')}: rows were sorted by it"] if back else []


def _derived(table: pd.DataFrame, request: Request) -> pd.DataFrame:
    joints = [c for c in table if (targets.numbered(str(c)) or ("",))[0] == "q"]
    for what in request.derive:
        if what not in DERIVED:
            raise PlumblineError(f"--derive {what}: expected one of {', '.join(DERIVED)}")
        if not joints:
            raise PlumblineError(f"--derive {what}: no joints q1.. to derive it from; map them")
        if what == "velocity" and "time" not in table:
            raise PlumblineError("--derive velocity: no clock; say --map time=COLUMN:s")
        q = table[joints].to_numpy(dtype=float)
        group = np.asarray(table["group"] if "group" in table else 0 * table.index, np.int64)
        made = (joining.velocities(q, table["time"].to_numpy(), group) if what == "velocity"
                else joining.directions(q, group, request.still))  # fmt: skip
        names = [f"{what}{str(c)[1:]}" for c in joints]
        table = table.assign(**dict(zip(names, made.T, strict=True)))
    return table


def _unused(raws: list[Raw], matches: Sequence[Match], request: Request) -> list[str]:
    used = {(match.raw.name, match.column) for match in matches}
    clocks = {raw.name: (mapping.clock_of(raw, request.columns) or ("",))[0] for raw in raws}
    several = len({name for name, _ in used}) > 1
    left = [
        f"{raw.name}@{c}" if several else c
        for raw in raws
        for c in raw.columns
        if c and (raw.name, c) not in used and clocks[raw.name] != c
        and (several or raw is matches[0].raw)
    ]  # fmt: skip
    return [f"not used: {listed(left)}"] if left else []


def si_of(unit: str) -> str:
    """The SI unit of what a unit measures; the word itself for what is none."""
    return SI[UNITS[unit].dimension] if unit in UNITS else unit
