"""Which reader a file is for, by its ending."""

from pathlib import Path

from plumbline.errors import fault, listed, shown
from plumbline.experiments.importing import bags, matlab, parquet, text
from plumbline.experiments.importing.tables import Raw

FEWEST = 2  # rows of a table
FORMS = (".csv", ".txt", ".tsv", ".parquet", ".db3", ".mcap", ".bag", ".mat")


def read(path: Path) -> list[Raw]:
    """The tables of a file, by its ending; of a folder, those of a bag or of a LeRobot data set.

    Raises:
        PlumblineError: It is not there, of no known form, or cannot be read.
    """
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
