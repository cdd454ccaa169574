r"""Seals: hashes written down before anything is opened.

.. math:: \text{recording} = \mathrm{SHA256}(\text{name}_1, \text{size}_1, \text{bytes}_1, \dots),
          \qquad \text{truth} = \mathrm{SHA256}(\text{bytes of the truth file})

The ledger is a text file of one JSON object a line: a head, then one line a case. It lies beside
the cases, a copy of it beside the truth, and a run copies it beside its verdicts; the three must
agree. Its own hash, published before the run, seals the whole set. A truth carries the secret seed
that it was drawn with, so its hash cannot be guessed from the few causes that there are.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError
from plumbline.experiments.withheld.truth import read_truth

LEDGER = "ledger.jsonl"
PLAN = "plan.json"  # beside the truth: what a set was drawn from
RUN = "run.json"  # beside the verdicts: what they are on
FORMAT = 1  # of the ledger


@dataclass(frozen=True)
class Entry:
    """One sealed case."""

    case: str  # name of its folder
    truth: str  # SHA-256 of its truth file [hex]
    recording: str  # SHA-256 of its recording [hex]
    # effects that are to be taken out of the library for this case. It says nothing of whether the
    # case has them.
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Ledger:
    """All sealed cases of a set."""

    plan: str  # SHA-256 of what the set was drawn from; empty for a set made elsewhere
    entries: tuple[Entry, ...]  # the cases
    sha256: str  # hash of the ledger itself

    @property
    def by_case(self) -> dict[str, Entry]:
        """Entries by the name of their case."""
        return {entry.case: entry for entry in self.entries}


def hash_of_file(path: Path) -> str:
    """SHA-256 [hex] of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def hash_of_recording(folder: Path) -> str:
    """SHA-256 [hex] over all files of a recording, names and sizes too; links are refused."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            raise PlumblineError(f"{path}: is a link; put the file itself there")
        if path.is_file():
            content = path.read_bytes()
            digest.update(f"{path.relative_to(folder).as_posix()}\n{len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def recordings_in(cases: Path) -> list[Path]:
    """Folders of the recordings, by name (PlumblineError: there is none)."""
    if not cases.is_dir():
        raise PlumblineError(f"{cases}: no such folder; make one with 'plumbline withheld make'")
    found = sorted(p.parent for p in cases.glob("*/dataset.toml"))
    if not found:
        raise PlumblineError(f"{cases}: no recordings; expected folders with a dataset.toml each")
    return found


def head(plan: str) -> str:
    """The ledger's first line."""
    return json.dumps({"ledger": FORMAT, "plan": plan}) + "\n"


def line(entry: Entry) -> str:
    """One case's line."""
    return json.dumps(asdict(entry)) + "\n"


def make_folder(path: Path) -> None:
    """Make a folder, with all above it, and refuse one that cannot be written into."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise PlumblineError(
            f"{path}: no folder that can be written into ({reason}); name another place"
        ) from None


def append(path: Path, text: str) -> None:
    """Write a line and see it onto the disk before anything else happens."""
    make_folder(path.parent)
    with path.open("a", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def read_ledger(folder: Path) -> Ledger | None:
    """The ledger of a folder, refused if damaged; None if it has none."""
    path = folder / LEDGER
    if not path.is_file():
        return None
    content = path.read_bytes()
    try:
        lines = [json.loads(text) for text in content.decode("utf-8").splitlines()]
        first, entries = lines[0], tuple(_entry(fields) for fields in lines[1:])
        plan, version = str(first["plan"]), first["ledger"]
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError):
        raise PlumblineError(f"{path}: damaged; expected one JSON object a line") from None
    if version != FORMAT or len({e.case for e in entries}) < len(entries):
        raise PlumblineError(f"{path}: format {version} or a case twice; expected {FORMAT}, once")
    return Ledger(plan, entries, hashlib.sha256(content).hexdigest())


def _entry(fields: dict[str, Any]) -> Entry:
    case = str(fields["case"])
    if Path(case).name != case or case in {".", ".."}:
        raise PlumblineError(f"case: found {case!r}, expected a plain name; mend it")
    return Entry(
        case, str(fields["truth"]), str(fields["recording"]), tuple(map(str, fields["without"]))
    )


def seal_folder(cases: Path, truth: Path, without: tuple[str, ...] = ()) -> Ledger:
    """Write the ledger of a set made elsewhere, beside cases and truths, refused if one lacks."""
    check_apart(cases, truth)
    if read_ledger(cases) is not None:
        raise PlumblineError(f"{cases}: sealed already; a ledger is written once")
    entries = []
    for folder in recordings_in(cases):
        file = truth / f"{folder.name}.json"
        if not file.is_file():
            raise PlumblineError(f"{file}: no such truth; every recording needs one to be sealed")
        read_truth(file, without)  # what is sealed cannot be mended
        hashes = hash_of_file(file), hash_of_recording(folder)
        entries.append(Entry(folder.name, *hashes, without))
    text = head("") + "".join(map(line, entries))
    for place in (cases, truth):
        (place / LEDGER).write_text(text, encoding="utf-8")
    sealed = read_ledger(cases)
    assert sealed is not None
    return sealed


def check_apart(cases: Path, truth: Path) -> None:
    """Refuse a truth within the cases, and cases within the truth."""
    try:
        here, there = cases.resolve(), truth.resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise PlumblineError(
            f"{cases}, {truth}: no usable paths ({type(error).__name__})"
        ) from None
    if here == there or here in there.parents or there in here.parents:
        raise PlumblineError(f"truth {truth} and cases {cases} share a folder: keep them apart")


def check_seal(entry: Entry, recording: Path | None = None, truth: Path | None = None) -> None:
    """Refuse what was changed on the disk after it was sealed."""
    pairs: Iterable[tuple[Path | None, str, str]] = (
        (recording, entry.recording, "recording"),
        (truth, entry.truth, "truth"),
    )
    for path, sealed, what in pairs:
        if path is None:
            continue
        if not path.exists():
            raise PlumblineError(f"{path}: the {what} is not there, but the ledger lists it")
        found = hash_of_recording(path) if path.is_dir() else hash_of_file(path)
        if found != sealed:
            raise PlumblineError(
                f"{path}: the {what} was changed after it was sealed (hash {found[:12]}, ledger "
                f"{sealed[:12]}); bring back the sealed one"
            )
