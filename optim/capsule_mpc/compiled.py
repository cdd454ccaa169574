r"""C where there is a compiler, the same without where there is none.

Code is compiled once and kept in the user's own cache folder under the SHA-256 of all that it
depends on: source, compiler, flags and processor. It is written under another name and moved into
place in one step, so that two processes cannot read each other's half. A folder that belongs to
somebody else, or that others may write to, is not used: what lies there would be executed.
``PLUMBLINE_COMPILER`` names another compiler; set to nothing, nothing is compiled.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
FLAGS = ("-O2", "-march=native", "-shared", "-fPIC")
PATIENCE = 300.0  # [s] that a compiler may take


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
    said = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
    features = ""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        features = platform.processor()
    return "\n".join([said.stdout, platform.machine(), features, *FLAGS])


@cache
def folder() -> Path | None:
    """The cache folder, made if need be; None if no safe one can be had."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    target = Path(base) / "plumbline" / "compiled"
    try:
        target.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _private(target):
            return target
    except OSError:
        pass
    try:
        return Path(tempfile.mkdtemp(prefix="plumbline-"))
    except OSError:
        return None


def _private(path: Path) -> bool:
    found = path.stat()
    own = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    return own and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def library(source: str, name: str, more: tuple[str, ...] = ()) -> Path | None:
    """The shared library of a C source; None where it cannot be made.

    Args:
        source: The C code.
        name: How its file begins.
        more: Flags behind the usual ones.
    """
    path, home = compiler(), folder()
    if path is None or home is None:
        return None
    flags = [*FLAGS, *more]
    key = hashlib.sha256("\n".join([source, _signature(path), *flags]).encode()).hexdigest()
    target = home / f"{name}-{key[:32]}.so"
    if target.exists() and _private(target):
        return target
    try:
        with tempfile.TemporaryDirectory(dir=home) as scratch:
            code, made = Path(scratch) / f"{name}.c", Path(scratch) / f"{name}.so"
            code.write_text(source, encoding="utf-8")
            command = [path, *flags, "-o", str(made), str(code), "-lm"]
            subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
            os.replace(made, target)
    except (OSError, subprocess.SubprocessError):
        return None
    return target


@dataclass(frozen=True, eq=False)
class Compiled:
    """A CasADi function that reads and writes NumPy memory.

    Attributes:
        function: Compiled, or CasADi's own machine.
        native: Whether it was compiled.
    """

    function: cs.Function
    native: bool
    _inputs: list[Array] = field(init=False, repr=False)
    _outputs: list[Array] = field(init=False, repr=False)
    _run: Callable[[], None] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Fix the memory that the function works on: its buffer keeps addresses only."""
        f = self.function
        inputs = [np.zeros(f.nnz_in(i)) for i in range(f.n_in())]
        outputs = [np.zeros(f.nnz_out(i)) for i in range(f.n_out())]
        handle: Any = f.buffer()
        buffer, run = handle
        for i, values in enumerate(inputs):
            buffer.set_arg(i, values.data)
        for i, values in enumerate(outputs):
            buffer.set_res(i, values.data)
        for name, value in (("_inputs", inputs), ("_outputs", outputs), ("_run", run)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_buffer", buffer)

    def __call__(self, *inputs: ArrayLike) -> list[Array]:
        """The outputs, column by column and flat, in memory that the next call overwrites."""
        for own, values in zip(self._inputs, inputs, strict=True):
            own[:] = np.asarray(values).ravel()
        self._run()
        return self._outputs


def native_function(function: cs.Function, wanted: bool = True) -> tuple[cs.Function, bool]:
    """A function, compiled if wanted and possible, and whether it was."""
    if not wanted or compiler() is None:
        return function, False
    generator = cs.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    made = library(generator.dump(), function.name())
    if made is None:
        return function, False
    return cs.external(function.name(), str(made)), True
