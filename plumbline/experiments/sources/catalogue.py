"""What is known of a public recording before it is fetched: where, which commit, which hashes.

A file is pinned twice, by the commit in its address and by the SHA-256 of its content,

    https://raw.githubusercontent.com/<repository>/<commit>/<path>,

so a recording is the same bytes for everyone, whoever moves a branch in the meantime.
"""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import quote


@dataclass(frozen=True)
class SourceFile:
    """One file of a source."""

    path: str  # path inside the repository, `/` between folders
    sha256: str  # SHA-256 of the content, 64 hexadecimal digits


def pinned(path: str, sha256: str) -> tuple[SourceFile]:
    """The only file of a source."""
    return (SourceFile(path, sha256),)


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

    @property
    def url(self) -> str:
        """Address of the repository at the pinned commit, for people."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"

    def file_url(self, file: SourceFile) -> str:
        """Address of one file at the pinned commit, spaces and the like quoted."""
        return (
            f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{quote(file.path)}"
        )
