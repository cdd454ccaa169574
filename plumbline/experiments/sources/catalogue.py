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
    """One file of a source.

    Attributes:
        path: path inside the repository, `/` between folders.
        sha256: SHA-256 of the content, 64 hexadecimal digits.
    """

    path: str
    sha256: str


@dataclass(frozen=True)
class Source:
    """A public recording of a real robot.

    Attributes:
        name: the name that `fetch` takes.
        robot: what was measured.
        instrument: what measured it.
        rows: number of samples in the recording folder.
        licence: licence of the data, with its copyright line.
        repository: GitHub repository, `owner/name`.
        commit: commit of the repository, 40 hexadecimal digits.
        folder: folder of the local cache that holds this repository's files.
        files: the files that the recording is made from.
        citation: what to cite when the recording is used.
        description: one line on what it holds.
    """

    name: str
    robot: str
    instrument: str
    rows: int
    licence: str
    repository: str
    commit: str
    folder: str
    files: tuple[SourceFile, ...]
    citation: str
    description: str

    @property
    def url(self) -> str:
        """Address of the repository at the pinned commit, for people."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"

    def file_url(self, file: SourceFile) -> str:
        """Address of one file at the pinned commit, spaces and the like quoted."""
        return (
            f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{quote(file.path)}"
        )
