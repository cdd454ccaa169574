"""Local copies of a source's files: use what is there, fetch what is not, trust neither.

The cache is the folder that the environment variable `PLUMBLINE_DATA` names, else the one that the
operating system keeps for caches. A file `F` of source folder `D` lies at `<cache>/D/F`. It is
hashed before every use and downloaded at most once; a file already there is never replaced.

A file is pinned twice, by the commit in its address and by the SHA-256 of its content,

    https://raw.githubusercontent.com/<repository>/<commit>/<path>,

so a recording is the same bytes for everyone, whoever moves a branch in the meantime.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pooch

from plumbline.errors import PlumblineError
from plumbline.experiments.console.tables import table

ENVIRONMENT_VARIABLE = "PLUMBLINE_DATA"


def cache_folder() -> Path:
    """Folder that holds the local copies; it need not exist."""
    given = os.environ.get(ENVIRONMENT_VARIABLE)
    if given:
        return Path(given).expanduser()
    return Path(pooch.os_cache("plumbline"))


def local_files(source: Source, *, progress: bool = False) -> dict[str, Path]:
    """Local copy of a source's files by path in the repository, refused if not the pinned ones."""
    return {file.path: _local_file(source, file, progress) for file in source.files}


def _local_file(source: Source, file: SourceFile, progress: bool) -> Path:
    local = cache_folder() / source.folder / file.path
    if local.is_file():
        _check(local, file)
    else:
        _download(source, file, local, progress)
    return local


def _check(local: Path, file: SourceFile) -> None:
    try:
        found = pooch.file_hash(str(local), alg="sha256")
    except OSError as error:
        raise PlumblineError(
            f"{local} cannot be read ({error.strerror}): mend its permissions, or remove it to "
            "have it fetched again"
        ) from error
    if found != file.sha256:
        raise PlumblineError(
            f"{local} has SHA-256 {found[:12]}..., expected {file.sha256[:12]}...: "
            "remove it to have it fetched again"
        )


def _download(source: Source, file: SourceFile, local: Path, progress: bool) -> None:
    url = source.file_url(file)
    if not _writable(local.parent):
        raise PlumblineError(
            f"{local} is missing and {cache_folder()} cannot be written to: put {url} there, or "
            f"let {ENVIRONMENT_VARIABLE} name a folder that can be written to"
        )
    try:
        with _download_log(progress):
            pooch.retrieve(
                url, known_hash=f"sha256:{file.sha256}", fname=local.name, path=str(local.parent)
            )
    except (OSError, ValueError) as error:
        # Network errors of requests are OSErrors; a ValueError is pooch's hash mismatch.
        reason = " ".join(str(error).partition(" with url")[0].split())[:200]
        raise PlumblineError(
            f"{url} could not be fetched ({reason}): try again, or put the file at {local}"
        ) from error


def _writable(folder: Path) -> bool:
    """Whether files can be made in a folder, or in the nearest folder above it that exists.

    A folder without any write bit counts as read-only even for root, who could override it.
    """
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    has_write_bit = bool(folder.stat().st_mode & 0o222)
    return folder.is_dir() and has_write_bit and os.access(folder, os.W_OK)


@contextmanager
def _download_log(progress: bool) -> Iterator[None]:
    """Let pooch name each file that it downloads, or keep it silent, for the time being."""
    logger = pooch.get_logger()
    # A filter, not a level: pooch's logger stands outside logging's tree, so that a level once
    # looked up there is remembered for good.
    if not progress:
        logger.addFilter(_is_warning)
    try:
        yield
    finally:
        logger.removeFilter(_is_warning)


def _is_warning(record: logging.LogRecord) -> bool:
    """Whether a line of the log says that something went wrong."""
    return record.levelno >= logging.WARNING


@dataclass(frozen=True)
class SourceFile:
    """One file of a source."""

    path: str  # path inside the repository, `/` between folders
    sha256: str  # SHA-256 of the content, 64 hexadecimal digits


@dataclass(frozen=True)
class Source:
    """A public recording of a real robot."""

    name: str  # the name that `fetch` takes
    robot: str  # what was measured
    instrument: str  # what measured it
    rows: int  # number of samples in the recording folder
    licence: str  # licence of the data, with its copyright line
    repository: str  # gitHub repository, `owner/name`
    commit: str  # commit of the repository, 40 hexadecimal digits
    folder: str  # folder of the local cache that holds this repository's files
    files: tuple[SourceFile, ...]  # the files that the recording is made from
    citation: str  # what to cite when the recording is used
    description: str  # one line on what it holds
    notes: tuple[str, ...]  # what was done to its tables and why, a comment line each
    reader: str  # the module that reads its tables

    @property
    def url(self) -> str:
        """Address of the repository at the pinned commit, for people."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"

    def file_url(self, file: SourceFile) -> str:
        """Address of one file at the pinned commit, spaces and the like quoted."""
        return (
            f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{quote(file.path)}"
        )


def catalogue() -> dict[str, Source]:
    """Every source of ``catalogue.toml`` by its name."""
    told = table("plumbline.experiments.sources", "catalogue.toml")
    return {name: _source(name, entry) for name, entry in told.items()}


def _source(name: str, entry: dict[str, Any]) -> Source:
    files = tuple(SourceFile(*file) for file in entry["files"])
    return Source(**entry | {"name": name, "files": files, "notes": tuple(entry["notes"])})
