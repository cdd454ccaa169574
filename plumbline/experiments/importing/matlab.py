"""MATLAB files: every array as long as the longest, structures taken apart; 7.3 through h5py.

A matrix lies with its rows along time, whichever way it was stored; ``rec.pos`` of six columns is
``rec.pos.1`` to ``rec.pos.6``. Objects and functions are left alone; nothing is run.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from plumbline.errors import fault, one_line
from plumbline.experiments.importing.tables import Raw

MOST_COLUMNS = 200  # of a matrix: a wider one is a picture, no table
SHORTEST = 2  # rows
LARGEST = 2**31  # [byte] of an array of version 7.3, which may say to be larger than its file


def read(path: Path) -> list[Raw]:
    """The table of a MATLAB file, refused if none: arrays of the commonest length, long first."""
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        content = _hdf5(path)
    except (OSError, ValueError, TypeError, MatReadError, KeyError, MemoryError) as error:
        found = f"no MATLAB file ({one_line(str(error))[:80]})"
        raise fault(path.name, found, "a .mat file", "save it again with -v7") from None
    arrays = dict(_arrays(content, ""))
    length = _rows(arrays)
    columns = {name: part for key, a in arrays.items() for name, part in _columns(key, a, length)}
    return [Raw(path.name, columns, f"MATLAB, arrays of {length:,} rows")]


def _hdf5(path: Path) -> dict[str, Any]:
    """The arrays of a file of version 7.3 as they lie in MATLAB; no link is followed."""
    mend = "save it again in MATLAB: save('file.mat', '-v7')"
    try:
        h5py = import_module("h5py")
    except ImportError:
        mend = f"{mend}, or pip install h5py"
        raise fault(path.name, "MATLAB 7.3 (HDF5)", "version 7 or h5py", mend) from None
    found: dict[str, Any] = {}

    def take(name: str, part: Any) -> None:
        text = getattr(part, "attrs", {}).get("MATLAB_class") == b"char"
        if isinstance(part, h5py.Dataset) and not (text or name.startswith("#")):
            found[name.replace("/", ".")] = part[()].T if part.nbytes <= LARGEST else None

    try:
        with h5py.File(path, "r") as content:
            content.visititems(take)
    except (OSError, ValueError, TypeError, KeyError, RuntimeError, MemoryError) as error:
        why = f"MATLAB 7.3 that cannot be read ({one_line(str(error))[:80]})"
        raise fault(path.name, why, "a whole file", mend) from None
    return found


def _arrays(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, NDArray[Any]]]:
    for key, value in content.items():
        name = f"{prefix}{key}"
        if str(key).startswith("__"):
            continue
        if isinstance(value, dict):
            yield from _arrays(value, f"{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim in (1, 2):
            yield name, value


def _rows(arrays: Mapping[str, NDArray[Any]]) -> int:
    """The length that most arrays share, weighed by how much they hold."""
    weight: Counter[int] = Counter()
    for array in arrays.values():
        weight[max(array.shape)] += array.size
    return weight.most_common(1)[0][0] if weight else 0


def _columns(
    name: str, array: NDArray[Any], length: int
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    if length < SHORTEST or length not in array.shape:
        return
    table = array.reshape(length, -1) if array.shape[0] == length else array.T
    if table.shape[1] > MOST_COLUMNS:
        return
    for k in range(table.shape[1]):
        yield (name if table.shape[1] == 1 else f"{name}.{k + 1}"), table[:, k].astype(float)
