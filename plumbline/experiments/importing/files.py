"""Files of a laboratory into a recording: which reader a file is for, its rows shown, the folder.

:func:`import_files` is the command ``import`` in one call, unasked. A folder is written whole and
checked, or not at all.
"""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, TypeVar, Unpack

from plumbline.errors import MOST_LISTED, PlumblineError, fault, listed, shown
from plumbline.experiments.console.places import place
from plumbline.experiments.importing import bags, matlab, parquet, tables, text
from plumbline.experiments.importing.asked import asked
from plumbline.experiments.importing.tables import Raw
from plumbline.experiments.importing.understood import Understood, si_of, understand
from plumbline.experiments.importing.units import UNITS
from plumbline.kinematics.toml_text import document
from plumbline.optim.loading import load

FEWEST = 2  # rows of a table
FORMS = (".csv", ".txt", ".tsv", ".parquet", ".db3", ".mcap", ".bag", ".mat")
FIRST = 3  # rows shown
Found = TypeVar("Found")


class Asked(TypedDict, total=False):
    """What else an import may be told, as by the command's options of these names."""

    units: str | Sequence[str]  # of what has none of its own; else SI
    observation: str  # kind of recording, where columns tell not
    robot: str  # a known one's name, or a file of URDF or MJCF
    tip_frame: str
    tool: str  # the tip in the tip frame, "0,0,200mm"
    noise: str | float  # the instrument's 1 sigma per axis, "0.1mm" or m
    gap: float  # [s] within which readings of several files belong together
    shift: Mapping[str, float]  # [s] to add to a file's clock
    derive: str | Sequence[str]  # what to derive from the path: velocity, acceleration, direction
    still: float  # [rad] of motion that counts as none
    rotation: str  # how rx, ry, rz turn: rotvec, xyz, ZYX, ...


def import_files(
    files: str | Path | Sequence[str | Path],
    to: str | Path,
    columns: Mapping[str, str] | None = None,
    **options: Unpack[Asked],
) -> Any:
    """Files as a recording's folder, and that recording, checked.

    Args:
        files: CSV, Parquet, MATLAB, bags or MCAP.
        to: The folder; it must not exist, or be empty.
        columns: What columns mean, ``{"q#": "J#:deg", "x": "tip x:mm"}``.
        **options: ``units``, ``robot``, ``noise``, ...: see :class:`Asked`.

    Raises:
        PlumblineError: They cannot be understood, or make no recording; one line says why.
    """
    paths = [files] if isinstance(files, str | Path) else files
    target = Path(to)
    lines = [f"{name}={source}" for name, source in (columns or {}).items()]
    raws = tables.told_apart([raw for path in paths for raw in read(Path(path))])
    request = asked(options, lines, None, raws)
    found = understand(raws, request.request)
    settings = described(target, found, request.settings)
    return write(found, settings, request.files, target, load)


def read(path: Path) -> list[Raw]:
    """Tables of a file by its ending, of a bag's folder or a LeRobot data set's; else refused."""
    if not path.exists():
        raise fault(str(path), "no such file", "a CSV, Parquet, MATLAB or bag", "check the path")
    ending = path.suffix.lower()
    if path.is_dir():
        found = parquet.read_dataset(path) if (path / "meta").is_dir() else _bag(path)
    elif ending == ".parquet":
        found = parquet.read(path)
    elif ending in (".db3", ".mcap", ".bag"):
        found = bags.read(path)
    elif ending == ".mat":
        found = matlab.read(path)
    elif ending in (".csv", ".txt", ".tsv", ".dat", ".asc", ".log"):
        found = text.read(path)
    else:
        mend = "export it as CSV"
        raise fault(path.name, f"ending {shown(ending)}", f"one of {listed(FORMS)}", mend)
    kept = [raw for raw in found if len(raw) >= FEWEST]
    if not kept:
        raise fault(path.name, "no table of two rows or more", "rows", "record it again")
    return kept


def _bag(folder: Path) -> list[Raw]:
    if not (folder / "metadata.yaml").is_file():
        there = listed(sorted(path.name for path in folder.iterdir())) or "nothing"
        found, mend = f"a folder (there: {there})", "name the files of the log"
        raise fault(str(folder), found, "a bag's or a LeRobot data set's", mend)
    return bags.read(folder)


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


def described(target: Path, understood: Understood, asked: Mapping[str, Any]) -> dict[str, Any]:
    """What ``dataset.toml`` says: name, kind, the asked, amperes if all efforts are in them."""
    told = {"name": target.resolve().name, "observation": understood.observation, **asked}
    efforts = [name for name in understood.sources if name.startswith("effort")]
    amperes = [UNITS[understood.sources[e].unit].dimension == "current" for e in efforts]
    if any(amperes):
        if not all(amperes):
            raise PlumblineError(f"{efforts[amperes.index(False)]}: not in A, as others are")
        told["motion"] = {"effort_unit": "A", **asked.get("motion", {})}
    return told


def write(
    understood: Understood,
    settings: Mapping[str, Any],
    files: Mapping[str, Path],
    target: Path,
    accept: Callable[[Path], Found],
) -> Found:
    """Write a recording folder, whole, if it can be used; what ``accept`` found of it.

    ``settings`` are what ``dataset.toml`` says, ``files`` are copied under the names that they get;
    ``accept`` looks at the folder before it is put in its place, and raises if it cannot be used.
    """
    found: list[Found] = []

    def fill(folder: Path) -> None:
        (folder / "dataset.toml").write_text(document(settings), encoding="utf-8")
        # Twelve digits keep a micrometre in a kilometre, and a microsecond in a week.
        understood.samples.to_csv(
            folder / "samples.csv", index=False, float_format="%.12g", lineterminator="\n"
        )
        for name, path in files.items():
            shutil.copyfile(path, folder / name)
        found.append(accept(folder))

    place(target, fill)
    return found[0]
