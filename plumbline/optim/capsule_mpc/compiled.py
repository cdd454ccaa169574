r"""C where there is a compiler, the same without where there is none.

Code is compiled once and kept in the user's own cache folder under the SHA-256 of all that it
depends on: source, compiler, flags and processor, and under its own: a file that was damaged is
made anew. What a compiler made is first loaded in another process, so that junk harms nobody, and
moved into place in one step, so that two processes cannot read each other's half. A folder that
belongs to somebody else, or that others may write to, is not used: what lies there would be
executed; nor is one from which nothing may be executed. Wherever any of this fails, the same is
computed without compiled code, some ten times slower, and one warning says so.
``PLUMBLINE_COMPILER`` names another compiler; set to nothing, nothing is compiled nor said.
"""

import hashlib
import os
import platform
import shutil
import stat
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.capsule_mpc.constants import MOMENT, PATIENCE
from plumbline.optim.core.problem import Array

FLAGS = ("-O2", "-march=native", "-shared", "-fPIC")
LOAD = "import ctypes, sys; ctypes.CDLL(sys.argv[1])[sys.argv[2]]"


class NotCompiledWarning(RuntimeWarning):
    """Compiled code was wanted and is not there; what is computed is the same, only slower."""


class _FaultError(Exception):
    """Why there is no compiled code."""


_said: list[str] = []


def say_not_compiled(reason: str) -> None:
    """Warn, once a process."""
    if not _said and os.environ.get("PLUMBLINE_COMPILER") != "":
        _said.append(reason)
        words = (
            f"{reason}; planning runs in CasADi's own machine, some ten times slower: install a "
        )
        words += "C compiler, point PLUMBLINE_COMPILER at one, or set it to nothing to hear no more"
        warnings.warn(words, NotCompiledWarning, stacklevel=2)


def backend(*native: bool) -> str:
    """What a planner runs on: ``"compiled"`` if all of its parts are, else ``"casadi"``."""
    return "compiled" if all(native) else "casadi"


@cache
def compiler() -> str | None:
    """Path of the C compiler; None if there is none."""
    wanted = os.environ.get("PLUMBLINE_COMPILER")
    if wanted is not None:
        return shutil.which(wanted) if wanted else None
    return next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)


@cache
def _signature(path: str) -> str:
    """The compiler's version and the processor's features, which -march=native looks at."""
    said = subprocess.run(
        [path, "--version"], capture_output=True, check=False, timeout=MOMENT
    ).stdout.decode("utf-8", "replace")
    features = ""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        features = platform.processor()
    return "\n".join([said, platform.machine(), features, *FLAGS])


@cache
def folder() -> Path | None:
    """The cache folder, made if need be; None if no safe one can be had."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    target = Path(base) / "plumbline" / "compiled"
    try:
        target.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _private(target) and os.access(target, os.W_OK | os.X_OK):
            return target
    except OSError:
        pass
    return spare_folder()


@cache
def spare_folder() -> Path | None:
    """A folder for this process alone; None if there is none."""
    try:
        return Path(tempfile.mkdtemp(prefix="plumbline-"))
    except OSError:
        return None


def _private(path: Path) -> bool:
    found = path.stat()
    own = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    return own and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _whole(path: Path) -> bool:
    """Whether a file is its owner's alone and has the content that its name says."""
    return _private(path) and path.stem.rpartition("-")[2] == _digest(path.read_bytes())


def _loads(path: Path, name: str) -> bool:
    """Whether another process can load a library and finds a function in it."""
    command = [sys.executable, "-I", "-S", "-c", LOAD, str(path), name]
    return not subprocess.run(command, capture_output=True, check=False, timeout=MOMENT).returncode


def _compile(source: str, name: str, flags: list[str], scratch: str) -> Path:
    """Compile in a folder."""
    code, made = Path(scratch) / f"{name}.c", Path(scratch) / f"{name}.so"
    code.write_text(source, encoding="utf-8")
    command = [compiler() or "", *flags, "-o", str(made), str(code), "-lm"]
    try:
        done = subprocess.run(command, check=False, capture_output=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise _FaultError(f"{command[0]} timed out on {name}.c after {PATIENCE:g} s") from None
    if done.returncode or not made.is_file():
        raise _FaultError(f"{command[0]} failed on {name}.c with exit code {done.returncode}")
    return made


def _kept(source: str, name: str, flags: list[str]) -> Path:
    """The library of a source, in the cache or in a folder of this process."""
    key = _digest("\n".join([source, _signature(compiler() or ""), *flags]).encode())
    homes = [home for home in (folder(), spare_folder()) if home is not None]
    for home in homes:
        for kept in sorted(home.glob(f"{name}-{key}-*.so")):
            if _whole(kept):
                return kept
        with tempfile.TemporaryDirectory(dir=home) as scratch:
            made = _compile(source, name, flags, scratch)
            if _loads(made, name):  # else, perhaps, nothing may be executed in this folder
                target = home / f"{name}-{key}-{_digest(made.read_bytes())}.so"
                os.replace(made, target)
                return target
    raise _FaultError(f"what {compiler()} made of {name}.c cannot be loaded")


def library(source: str, name: str, more: tuple[str, ...] = ()) -> Path | None:
    """The shared library of a C source, by a function in it; None, and a warning, where none is."""
    if compiler() is None:
        say_not_compiled("no C compiler was found")
        return None
    try:
        return _kept(source, name, [*FLAGS, *more])
    except (OSError, ValueError, subprocess.SubprocessError, _FaultError) as error:
        say_not_compiled(first_line(error))
        return None


def first_line(error: Exception) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]


class Compiled:
    """A CasADi function that reads and writes NumPy memory."""

    def __init__(self, function: cs.Function, native: bool) -> None:
        """Of a function that was compiled (``native``), or runs in CasADi's own machine."""
        self._function, self.native = function, native  # the buffer needs it alive
        self._inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        handle: Any = function.buffer()
        self._buffer, self._run = handle
        for i, values in enumerate(self._inputs):
            self._buffer.set_arg(i, values.data)
        for i, values in enumerate(self._outputs):
            self._buffer.set_res(i, values.data)

    def __call__(self, *inputs: ArrayLike) -> list[Array]:
        """The outputs, column by column and flat, in memory that the next call overwrites."""
        for own, values in zip(self._inputs, inputs, strict=True):
            own[:] = np.asarray(values).ravel()
        self._run()
        return self._outputs


def native_function(function: cs.Function, wanted: bool = True) -> tuple[cs.Function, bool]:
    """A function, compiled if wanted and possible, and whether it was."""
    if not wanted:
        return function, False
    generator = cs.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    made = library(generator.dump(), function.name())
    if made is None:
        return function, False
    try:
        return cs.external(function.name(), str(made)), True
    except RuntimeError as error:
        say_not_compiled(first_line(error))
        return function, False
