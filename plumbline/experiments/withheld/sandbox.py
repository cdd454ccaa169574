"""A process that can open its own folder, what Python is made of, and nothing else.

Two walls. Python's audit hooks (PEP 578) refuse to open or list a path outside of given folders, to
change anything outside of the process's own, to start another program and to reach the network;
they cannot be taken down again. Where Linux has Landlock (kernel 5.13 and later), the kernel
refuses the same files to compiled code as well.
"""

import ctypes
import os
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

RECORDING, VERDICT = "recording", "verdict.json"  # what lies in a blind process's folder
PACKAGE = "plumbline"
SYSTEM = ("/usr", "/lib", "/lib64", "/bin", "/etc", "/proc", "/sys", "/dev", "/System", "/Library")
LOOKING = {"open", "os.listdir", "os.scandir"}
CHANGING = {  # which of the arguments name what is changed
    **dict.fromkeys(("os.truncate", "os.remove", "os.mkdir", "os.rmdir"), (0,)),
    **dict.fromkeys(("os.chmod", "os.chown", "os.utime", "os.setxattr", "os.removexattr"), (0,)),
    **dict.fromkeys(("os.rename", "os.link"), (0, 1)),
    "os.symlink": (1,),
}
PATHS = (str, bytes, os.PathLike)
FOR_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
NEVER = {
    "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.startfile",
    "sqlite3.connect", "socket.connect", "socket.bind", "socket.sendto", "socket.getaddrinfo",
}  # fmt: skip

CREATE, ADD, RESTRICT = 444, 445, 446  # numbers of Landlock's system calls
BELOW, NO_NEW_PRIVILEGES = 1, 38  # of Linux: LANDLOCK_RULE_PATH_BENEATH, prctl's option
READ, EVERYTHING = 0b1101, (1 << 13) - 1  # execute, read files, list folders; all of version 1


def library_folders() -> tuple[Path, ...]:
    """Folders that Python and this project's packages are loaded from."""
    project = Path(__file__).resolve().parents[3]
    places = {sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), *SYSTEM}
    found = {Path(p).resolve() for p in places if Path(p).is_dir()}
    return (*sorted(found), project / PACKAGE)


def confine(own: Path) -> bool:
    """Shut this process in: `own` may be read and written, the library read, no more.

    Whether the kernel holds the wall as well as Python.
    """
    folders = (own.resolve(), *library_folders())
    held = _landlock(folders[:1], folders[1:])
    _hook(_inside(folders[:1]), _inside(folders))
    return held


def _inside(folders: Sequence[Path]) -> tuple[str, ...]:
    """How paths within folders begin."""
    return tuple(str(folder).rstrip(os.sep) + os.sep for folder in folders)


def _hook(own: tuple[str, ...], readable: tuple[str, ...]) -> None:
    """Refuse, for the rest of this process's life, what lies outside of the folders."""

    def watch(event: str, args: tuple[object, ...]) -> None:
        if event in NEVER:
            raise PermissionError(f"a blind process must not use {event}")
        if event in CHANGING:
            for k in CHANGING[event]:
                _refuse("change", args[k], own)
        elif event in LOOKING and args:
            writes = event == "open" and isinstance(args[2], int) and args[2] & FOR_WRITING
            _refuse("write" if writes else "open", args[0], own if writes else readable)

    sys.addaudithook(watch)


def _refuse(what: str, path: object, inside: tuple[str, ...]) -> None:
    """Refuse a path that lies elsewhere; a number is a file that is open already."""
    if isinstance(path, int):
        return
    place = os.path.realpath(os.fsdecode(path if isinstance(path, PATHS) else os.curdir)) + os.sep
    if not place.startswith(inside):
        raise PermissionError(f"a blind process must not {what} {place[:-1]}")


class _Rules(ctypes.Structure):
    _fields_ = (("handled", ctypes.c_uint64),)


class _Below(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def _landlock(writable: Sequence[Path], readable: Sequence[Path]) -> bool:
    """Ask the kernel for the same wall; false where it knows none."""
    if not sys.platform.startswith("linux"):
        return False
    system = ctypes.CDLL(None, use_errno=True)
    rules = _Rules(EVERYTHING)
    size = ctypes.c_size_t(ctypes.sizeof(rules))
    handle = int(system.syscall(CREATE, ctypes.byref(rules), size, 0))
    if handle < 0:
        return False
    for folders, allowed in ((writable, EVERYTHING), (readable, READ)):
        for folder in folders:
            place = os.open(folder, os.O_PATH | os.O_CLOEXEC)
            rule = _Below(allowed, place)
            system.syscall(ADD, handle, BELOW, ctypes.byref(rule), 0)
            os.close(place)
    system.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    held = int(system.syscall(RESTRICT, handle, 0)) == 0
    os.close(handle)
    return held
