"""The first rows as they were understood, in words, before anything is written."""

from collections.abc import Iterator

from plumbline.errors import MOST_LISTED, listed
from plumbline.experiments.importing.tables import Raw
from plumbline.experiments.importing.understood import Understood, si_of

FIRST = 3  # rows shown


def words(raws: list[Raw], understood: Understood) -> str:
    """Tables read, columns with their source and unit, the first rows, and what was left out."""
    places = [source.place for source in understood.sources.values()]
    used = {place.rpartition("@")[0].removeprefix("-") for place in places}
    tables = [f"{raw.name}: {len(raw):,} rows, {raw.form}" for raw in raws if raw.name in used]
    others = [raw.name for raw in raws if raw.name not in used]
    body = _aligned(list(_lines(understood, len(tables) > 1)))
    tables += [f"not used: {listed(others, MOST_LISTED)}"] if others else []
    rows = f"{understood.observation}, {len(understood.samples):,} rows"
    return "\n".join([*tables, "", *body, "", rows, *understood.notes])


def _lines(understood: Understood, several: bool) -> Iterator[list[str]]:
    table = understood.samples
    yield ["column", "from", "unit", *(f"row {k + 1}" for k in range(min(FIRST, len(table))))]
    for column in table:
        source = understood.sources[str(column)]
        unit, to = source.unit, si_of(source.unit)
        unit = to if unit == to else f"{unit} -> {to}"
        first = table[column].head(FIRST)
        cells = [f"{value:.7g}" if isinstance(value, float) else str(value) for value in first]
        minus = "-" * source.place.startswith("-")
        place = source.place if several else minus + source.place.rpartition("@")[2]
        yield [str(column), place, "" if unit == "1" else unit, *cells]


def _aligned(lines: list[list[str]]) -> list[str]:
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    aligned = [[cell.ljust(width) if k < 3 else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))]
               for line in lines]  # fmt: skip
    return ["  ".join(line).rstrip() for line in aligned]
