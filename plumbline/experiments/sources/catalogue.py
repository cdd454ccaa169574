"""What is known of a public recording before it is fetched: where, which commit, which hashes.

A file is pinned twice, by the commit in its address and by the SHA-256 of its content,

    https://raw.githubusercontent.com/<repository>/<commit>/<path>,

so a recording is the same bytes for everyone, whoever moves a branch in the meantime.
"""

import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import Any
from urllib.parse import quote


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
    text = (resources.files(__package__) / "catalogue.toml").read_text(encoding="utf-8")
    return {name: _source(name, entry) for name, entry in tomllib.loads(text).items()}


def _source(name: str, entry: dict[str, Any]) -> Source:
    files = tuple(SourceFile(*file) for file in entry["files"])
    return Source(**entry | {"name": name, "files": files, "notes": tuple(entry["notes"])})
