"""Go2's chirp: reading a torch archive without torch and without running what is in it.

Such a file is a zip: ``data/0``, ``data/1``, ... are raw little-endian numbers, and ``data.pkl``
says in the language of pickles what they are called. That language can call any function; here it
is only taken apart (``pickletools``), and names and storages are read off.
"""

import pickletools
import zipfile
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft, Value

NAMES = {"time": "time", "command": "des_dof_pos", "q": "dof_pos"}
GAINS: dict[str, Value] = {"command": "position", "kp": 20.0, "kd": 1.5}  # [N m/rad], [N m s/rad]
DIGITS = 6  # of a time in single precision: 0.004999999888 s is 0.005 s
LARGEST = 100_000_000  # [byte] of one array


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of the chirp: commanded and measured positions of twelve joints."""
    arrays = tensors(local[source.files[0].path])
    time = np.round(arrays[NAMES["time"]].ravel(), DIGITS)
    columns = {"time": time}
    for letter, name in (("u", NAMES["command"]), ("q", NAMES["q"])):
        values = arrays[name].reshape(len(time), -1)
        columns |= {f"{letter}{j + 1}": values[:, j] for j in range(values.shape[1])}
    tables: dict[str, dict[str, Value]] = {"robot": {"description": "go2"}, "motion": GAINS}
    return Draft("motion", {}, tables, pd.DataFrame(columns))


def tensors(file: Path) -> dict[str, NDArray[np.float64]]:
    """Arrays of single precision by name, flat, in the file's order, refused if it has none."""
    try:
        with zipfile.ZipFile(file) as archive:
            (index,) = [n for n in archive.namelist() if n.endswith("/data.pkl")]
            folder = index.removesuffix("data.pkl")
            found = {}
            for name, key in _storages(archive.read(index)).items():
                entry = archive.getinfo(f"{folder}data/{key}")
                if entry.file_size > LARGEST:
                    raise ValueError(f"{name} of {entry.file_size:,} bytes")
                found[name] = np.frombuffer(archive.read(entry), "<f4").astype(float)
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        reason = " ".join(str(error).split())[:100]
        raise PlumblineError(
            f"{file.name}: no archive of plain float arrays ({reason}); fetch it again"
        ) from None
    return found


def _storages(pickled: bytes) -> dict[str, str]:
    """Which storage each name has: a word, then the word ``storage`` or its echo, then a number."""
    words = [str(arg) for _, arg, _ in pickletools.genops(pickled) if isinstance(arg, str)]
    plain = [w for w in words if w not in ("storage", "cpu") and " " not in w]
    return {name: key for name, key in pairwise(plain) if key.isdecimal()}
