"""Where compiled code cannot be had, the same is computed without it, and one warning says so."""

import os
import stat
import warnings
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from plumbline.optim.capsule_mpc import (
    BandedQp,
    Noise,
    OneStep,
    RealTime,
    Settings,
    Statement,
    TipInstrument,
    compiled,
    linearised,
)
from plumbline.optim.capsule_mpc import planning as banded_qp
from tests.in_mm import Controller

NEEDED = pytest.mark.skipif(compiled.compiler() is None, reason="no C compiler here")
REMEMBERED = (
    compiled.folder,
    compiled.spare_folder,
    compiled.compiler,
    compiled._signature,
    banded_qp._native,
    linearised._mapped,
)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache folder of its own, nothing remembered, and nothing said yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled, "_said", [])
    for remembered in REMEMBERED:
        remembered.cache_clear()
    yield tmp_path / "cache" / "plumbline" / "compiled"
    for remembered in REMEMBERED:
        remembered.cache_clear()


def own_compiler(tmp_path, monkeypatch, body):
    """Another compiler: a shell script."""
    path = tmp_path / "own-cc"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    monkeypatch.setenv("PLUMBLINE_COMPILER", str(path))
    compiled.compiler.cache_clear()


def square():
    """x -> x^2, and whether it runs as compiled code."""
    x = cs.SX.sym("x", 3)
    function, native = compiled.native_function(cs.Function("square", [x], [cs.densify(x * x)]))
    assert compiled.Compiled(function, native)([1.0, 2.0, 3.0])[0].tolist() == [1.0, 4.0, 9.0]
    return native


JUNK = {
    "a text file": 'while [ "$1" != -o ]; do shift; done; echo junk > "$2"',
    "an empty file": 'while [ "$1" != -o ]; do shift; done; : > "$2"',
    "the beginning of a library": 'cc "$@" && while [ "$1" != -o ]; do shift; done; '
    'head -c 5000 "$2" > "$2.x" && mv "$2.x" "$2"',
    "a library without the function": 'while [ "$1" != -o ]; do shift; done; '
    'echo "int other;" > "$2.c"; cc -shared -o "$2" "$2.c"',
    "nothing": "exit 0",
    "an error": "exit 3",
    "words that are no text": r"printf '\377\376'; exit 1",
}


@pytest.mark.parametrize("body", JUNK.values(), ids=JUNK)
def test_a_compiler_that_makes_junk_is_done_without(cache, tmp_path, monkeypatch, body):
    own_compiler(tmp_path, monkeypatch, body)
    with pytest.warns(compiled.NotCompiledWarning, match="PLUMBLINE_COMPILER"):
        assert not square()
    assert not list(cache.glob("*.so"))


def test_a_compiler_that_is_no_program_is_done_without(cache, tmp_path, monkeypatch):
    own_compiler(tmp_path, monkeypatch, "")
    (tmp_path / "own-cc").write_bytes(b"\x7fELF junk")
    with pytest.warns(compiled.NotCompiledWarning):
        assert not square()


def test_a_compiler_that_never_ends_is_done_without(cache, tmp_path, monkeypatch):
    own_compiler(tmp_path, monkeypatch, '[ "$1" = --version ] || exec sleep 60')
    monkeypatch.setattr(compiled, "PATIENCE", 0.2)
    with pytest.warns(compiled.NotCompiledWarning, match="timed out"):
        assert not square()


@NEEDED
@pytest.mark.parametrize("damage", [b"", b"\x7fELF", b"junk" * 2000])
def test_a_damaged_file_is_made_anew(cache, damage):
    assert square()
    (kept,) = cache.glob("*.so")
    whole = kept.read_bytes()
    kept.chmod(stat.S_IRUSR | stat.S_IWUSR)
    kept.unlink()  # what is loaded keeps its pages
    kept.write_bytes(damage or whole[: len(whole) // 2])
    assert square()
    assert any(p.read_bytes()[:4] == b"\x7fELF" and compiled._whole(p) for p in cache.glob("*.so"))


@NEEDED
def test_a_cache_that_may_not_execute_is_not_used(cache, monkeypatch):
    loads = compiled._loads
    monkeypatch.setattr(compiled, "_loads", lambda p, n: cache not in p.parents and loads(p, n))
    assert square()
    assert not list(cache.glob("*.so"))
    assert list(compiled.spare_folder().glob("*.so"))


@NEEDED
def test_where_nothing_may_execute_nothing_is_compiled(cache, monkeypatch):
    monkeypatch.setattr(compiled, "_loads", lambda path, name: False)
    with pytest.warns(compiled.NotCompiledWarning, match="cannot be loaded"):
        assert not square()


@NEEDED
def test_what_cannot_be_loaded_after_all_is_done_without(cache, tmp_path, monkeypatch):
    junk = tmp_path / "junk.so"
    junk.write_text("junk")
    for module in (compiled, banded_qp):
        monkeypatch.setattr(module, "library", lambda *_: junk)
    with pytest.warns(compiled.NotCompiledWarning):
        assert not square()
    assert not banded_qp.native()


@NEEDED
def test_without_a_folder_nothing_is_compiled(cache, monkeypatch):
    monkeypatch.setattr(compiled, "folder", lambda: None)
    monkeypatch.setattr(compiled, "spare_folder", lambda: None)
    with pytest.warns(compiled.NotCompiledWarning):
        assert not square()


def statement(**noise):
    """Two instruments."""
    tools = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
    return Statement(tools, 0, Settings(p=3, noise=Noise(**noise)))


TIPS, GOALS = [-30.0, 0, -120.0, 35.0, 0, -115.0], [40.0, 10.0, -110.0, -40.0, 5.0, -120.0]


def test_a_controller_without_a_compiler_says_so_once_and_in_a_field(cache, monkeypatch):
    monkeypatch.setenv("PLUMBLINE_COMPILER", "no-such-compiler")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        controllers = [Controller(statement(), planner) for planner in (RealTime(), OneStep())]
        commands = [controller.step(TIPS, GOALS) for controller in controllers]
    assert len(said) == 1
    assert "\n" not in str(said[0].message)
    assert [controller.backend for controller in controllers] == ["casadi", "casadi"]
    assert all(np.abs(command.rate).max() > 1.0 for command in commands)


def test_who_wants_no_compiler_hears_nothing(cache, monkeypatch):
    monkeypatch.setenv("PLUMBLINE_COMPILER", "")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not square()
        assert Controller(statement(), RealTime()).backend == "casadi"


@NEEDED
def test_a_compiled_controller_says_so(cache):
    assert Controller(statement()).backend == "compiled"
    assert Controller(statement(), RealTime()).backend == "compiled"
    assert Controller(statement(), OneStep()).backend == "compiled"
    part = RealTime(BandedQp(compiled=False))
    assert Controller(statement(), part).backend == "casadi"
    assert Controller(statement(), RealTime(compiled=False)).backend == "casadi"


def test_the_level_of_noise_is_a_parameter_and_no_reason_to_build_again():
    one, other = statement(measured=1e-4), statement(measured=2e-4, bias=3e-4)
    assert one.shape == other.shape
    assert hash(one.shape) == hash(other.shape)
    assert not np.array_equal(one.stages(GOALS, []), other.stages(GOALS, []))
    longer = replace(one, settings=replace(one.settings, p=4))
    assert one.shape != longer.shape


def test_a_cache_that_cannot_be_written_is_no_obstacle(cache, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert compiled.folder() == compiled.spare_folder()
    assert os.access(compiled.spare_folder(), os.W_OK)
