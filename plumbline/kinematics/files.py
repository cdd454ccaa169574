r"""Files read within bounds, and files written whole or not at all.

A file is read if it is a regular one of at most so many bytes. What is named like a file may be a
pipe that nobody writes to, or a link to a device without an end: to open either would hang.

A file is written beside its place under another name and then renamed, which POSIX does at one
moment: a reader, a crash or a second writer meets the old content or the new, never half of one.
"""

import errno
import os
import secrets
import stat
from pathlib import Path

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.constants import LARGEST_FILE

NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0)
BINARY = getattr(os, "O_BINARY", 0)
KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class OddFileError(OSError):
    """A file that is none that may be read, ``strerror`` saying why in words."""


def read_file(path: str | Path, largest: int = LARGEST_FILE) -> bytes:
    """The bytes of a regular file, ``largest`` at most (OSError, its ``strerror``; ValueError)."""
    _refuse_odd(os.stat(path), largest)  # before it is opened: opening a device may act on it
    with open(os.open(path, os.O_RDONLY | NOT_BLOCKING | BINARY), "rb") as file:
        _refuse_odd(os.fstat(file.fileno()), largest)
        data = file.read(largest + 1)
    if len(data) > largest:  # it grows, or hides how long it is
        raise _odd(_too_long(len(data), largest, "more than "))
    return data


def _refuse_odd(found: os.stat_result, largest: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise _odd(f"{KINDS.get(stat.S_IFMT(found.st_mode), 'something else')}, no regular file")
    if found.st_size > largest:
        raise _odd(_too_long(found.st_size, largest))


def _too_long(size: int, largest: int, more: str = "") -> str:
    return f"{more}{size / 1e6:,.1f} MB, at most {largest / 1e6:,.1f} MB are read"


def _odd(words: str) -> OddFileError:
    return OddFileError(errno.EINVAL, words)


def reason(error: Exception) -> str:
    """Why a file cannot be read or written, in a few words."""
    return getattr(error, "strerror", None) or type(error).__name__


def write_whole(path: str | Path, data: str | bytes) -> None:
    """Write a file so that it is there whole or not at all (OSError); text as UTF-8.

    What was there stays if anything fails. A link stays a link: the file that it leads to is
    written. A device or a pipe is written to as it is.
    """
    content = data.encode("utf-8", "replace") if isinstance(data, str) else data
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        target.write_bytes(content)
        return
    check_writable(target)
    half = _beside(target)
    try:
        with open(half, "xb") as file:
            file.write(content)
        if target.exists():
            half.chmod(stat.S_IMODE(target.stat().st_mode))
        half.replace(target)
    finally:
        half.unlink(missing_ok=True)


def new_file(path: str | Path, text: str, *, overwrite: bool) -> None:
    """Write a file of text, whole or not at all (PlumblineError: not, or there is one already)."""
    target = Path(path)
    if target.exists() and not overwrite:
        raise fault(str(target), "a file", "a new one", "name another, or overwrite=True")
    try:
        write_whole(target, text)
    except OSError as error:
        raise PlumblineError(f"{target}: cannot be written ({reason(error)})") from None


def check_writable(path: str | Path) -> None:
    """See whether a file can be written, by making another beside it for a moment (OSError)."""
    target = Path(os.path.realpath(path))
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    if target.is_file() or not target.exists():
        half = _beside(target)
        half.touch(exist_ok=False)
        half.unlink()


def _beside(target: Path) -> Path:
    return target.with_name(f".plumbline-{secrets.token_hex(6)}.part")


def is_file(place: Path) -> bool:
    """Whether a path leads to a file; one that no system would take does not."""
    try:
        return place.is_file()
    except (OSError, ValueError):
        return False


def is_folder(place: Path) -> bool:
    """Whether a path leads to a folder; one that no system would take does not."""
    try:
        return place.is_dir()
    except (OSError, ValueError):
        return False
