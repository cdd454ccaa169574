"""Public recordings of real robots, each turned into a recording folder.

`list_sources` names them, `fetch` writes one. What a source is stands in `catalogue.toml`, where
its files come from in `cache`, how a folder is written in `folder`; each of the other modules reads
the tables of one repository and knows its units, signs and frames.
"""

import difflib
from importlib import import_module
from pathlib import Path

from plumbline.errors import PlumblineError, fault, shown
from plumbline.experiments.console.places import check_free
from plumbline.experiments.sources.cache import Source, SourceFile, catalogue, local_files
from plumbline.experiments.sources.folder import write

__all__ = ["PlumblineError", "Source", "SourceFile", "example", "fetch", "list_sources"]

_CATALOGUE = catalogue()
EXAMPLES = Path(__file__).parents[1] / "recordings"


def example(name: str = "bench-ur5") -> Path:
    """The folder of a recording that comes with the package.

    Raises:
        PlumblineError: There is none of that name.
    """
    there = sorted(folder.name for folder in EXAMPLES.iterdir() if folder.is_dir())
    if name not in there:
        raise fault("example", shown(name), f"one of {', '.join(there)}", "choose one of them")
    return EXAMPLES / name


def list_sources() -> tuple[Source, ...]:
    """Every public recording that `fetch` can write."""
    return tuple(_CATALOGUE.values())


def fetch(name: str, to: Path | None = None, *, progress: bool = False) -> Path:
    """Write a public recording as a folder of that name.

    Files come from the local cache where they are there already (the folder that the environment
    variable `PLUMBLINE_DATA` names, else the operating system's cache folder), else from the
    source's repository; either way each must have the pinned SHA-256.

    Args:
        name: a name of `list_sources`.
        to: folder to write into, by default the current one.
        progress: name each file on standard error while it is downloaded.

    Returns:
        The recording folder, `to / name`.

    Raises:
        PlumblineError: the name is unknown, the folder holds something already, or a file cannot be
            had or is not the pinned one. The message is one line.
    """
    source = _find(name)
    convert = import_module(f"{__name__}.{source.reader}").convert
    target = (Path.cwd() if to is None else Path(to)) / source.name
    check_free(target)
    return write(source, convert(source, local_files(source, progress=progress)), target)


def _find(name: str) -> Source:
    """Entry of the catalogue, or an error that names the nearest ones."""
    if name in _CATALOGUE:
        return _CATALOGUE[name]
    nearest = difflib.get_close_matches(name, _CATALOGUE, n=3, cutoff=0.0)
    raise PlumblineError(
        f"Source '{name}' not recognised. Best matches are {', '.join(map(repr, nearest))}"
    )
