"""The commands share this: where output goes.

``--json OUT`` writes a file, ``--json -`` prints JSON on standard output and nothing else there;
``--quiet`` leaves out words and progress. No command writes into a recording's folder. JSON and a
report take the place of what plumbline wrote there before, which its key ``generator`` tells; any
other file stays unless ``--overwrite`` is said.
"""

import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

import typer

from plumbline.errors import PlumblineError
from plumbline.kinematics.files import check_writable, reason, write_whole

STDOUT = "-"
Json = Annotated[
    str | None, typer.Option("--json", metavar="OUT", help="Write JSON to this file, or to - .")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print no words and no progress.")]
Report = Annotated[
    Path | None, typer.Option(metavar="OUT.html", help="Write a report, one page for a browser.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that are there.")]
OWN = {"generator": "plumbline"}  # begins JSON that plumbline wrote
OWN_JSON = re.compile(rb'\s*\{\s*"generator"\s*:\s*"plumbline"')
OWN_LIST = "\n \n"  # ends a list, which has no keys; it ended all JSON before there was the key
OWN_PAGE = '<meta name="generator" content="plumbline">'  # in the head of a report
HEAD = 4096  # bytes at the start of a file in which these are looked for
COMMAND: ContextVar[str] = ContextVar("COMMAND", default="")  # what a report says it was made by


def check_output(
    path: str | Path | None, option: str, folders: Sequence[Path] = (), *, overwrite: bool
) -> None:
    """Refuse an output of an option that cannot be written before anything is computed.

    It lies in a missing folder or one that takes no files, is a folder, lies inside of one that no
    output is written into, is a file that must stay, or is standard output, where only JSON goes.
    """
    if path is None or (str(path) == STDOUT and option == "--json"):
        return
    if str(path) == STDOUT:
        raise PlumblineError(f"{option} -: standard output is for --json; name a file")
    try:
        target = Path(path).resolve()
        missing, taken = not target.parent.is_dir(), target.is_dir()
        inside = [f for f in folders if target.is_relative_to(f.resolve())]
    except (OSError, RuntimeError, ValueError) as error:
        raise PlumblineError(f"{option} {path}: no usable path ({type(error).__name__})") from None
    if inside:
        raise PlumblineError(
            f"{option} {path}: lies inside of {inside[0]}, which is never written to; choose a "
            "file elsewhere"
        )
    if missing:
        raise PlumblineError(f"{option} {path}: no folder {Path(path).parent}; make it first")
    if taken:
        raise PlumblineError(f"{option} {path}: is a folder; name a file")
    try:
        check_writable(target)
    except OSError as error:
        raise PlumblineError(f"{option} {path}: cannot be written ({reason(error)})") from None
    check_new(Path(path), option, overwrite=overwrite)


def check_new(path: Path, option: str, *, overwrite: bool) -> None:
    """Refuse to replace a file unless that was asked for, or it is an earlier report or JSON."""
    if overwrite or not path.is_file() or _may_go(path):
        return
    raise PlumblineError(
        f"{option} {path}: is there already; choose another name, or add --overwrite"
    )


def _may_go(path: Path) -> bool:
    """Whether a file is empty, or JSON or a report as plumbline wrote it."""
    with open(path, "rb") as file:
        head = file.read(HEAD)
        file.seek(-min(path.stat().st_size, len(OWN_LIST)), os.SEEK_END)
        ours = OWN_JSON.match(head) or OWN_PAGE.encode() in head
        return not head or bool(ours) or file.read() == OWN_LIST.encode()


def check_outputs(
    outputs: Mapping[str, str | Path | None],
    folders: Sequence[Path] = (),
    *,
    inputs: Mapping[str, Path] | None = None,
    overwrite: bool,
) -> None:
    """Refuse outputs that cannot be, or that have the name of another or of what is read."""
    for option, path in outputs.items():
        check_output(path, option, folders, overwrite=True)
    check_distinct({**(inputs or {}), **outputs})
    for option, path in outputs.items():
        check_output(path, option, folders, overwrite=overwrite)


def check_distinct(outputs: Mapping[str, str | Path | None]) -> None:
    """Refuse two outputs into one file."""
    seen: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None or str(path) == STDOUT:
            continue
        other = seen.setdefault(Path(path).resolve(), option)
        if other != option:
            raise PlumblineError(f"{other} and {option} both name {path}; name two files")


def write_text(path: str | Path, text: str | bytes, option: str) -> None:
    """Write a file, whole or not at all (PlumblineError: it cannot be; what was there stays)."""
    try:
        write_whole(path, text)
    except OSError as error:
        raise PlumblineError(f"{option} {path}: cannot be written ({reason(error)})") from None


def write_json(path: str | None, content: Any) -> None:
    """Write JSON to a file or to standard output, refused if it cannot be; nothing if no path."""
    if path is None:
        return
    keyed = isinstance(content, Mapping)
    text = json.dumps({**OWN, **content} if keyed else content, indent=1, allow_nan=False)
    if path == STDOUT:
        if sys.stdout is None:
            raise PlumblineError("--json -: standard output is closed; name a file")
        sys.stdout.write(text + "\n")
    else:
        write_text(path, text + ("\n" if keyed else OWN_LIST), "--json")


def talks(json_path: str | None, quiet: bool) -> bool:
    """Whether words go to standard output."""
    return not quiet and json_path != STDOUT
