"""C where there is a compiler: made once, kept safely, and never needed."""

import os
import stat

import casadi as cs
import numpy as np
import pytest

from plumbline.optim.capsule_mpc import compiled

SOURCE = "int answer(void) { return 42; }\n"
NEEDED = pytest.mark.skipif(compiled.compiler() is None, reason="no C compiler here")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache folder of its own, and nothing remembered."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compiled, "_said", [])
    remembered = (
        compiled.folder,
        compiled.spare_folder,
        compiled.compiler,
        compiled._signature,
    )
    for one in remembered:
        one.cache_clear()
    yield tmp_path / "plumbline" / "compiled"
    for one in remembered:
        one.cache_clear()


def square():
    """x -> x^2."""
    x = cs.SX.sym("x", 3)
    return cs.Function("square", [x], [cs.densify(x * x)])


@NEEDED
def test_a_library_is_made_once_and_found_again(cache):
    first = compiled.library(SOURCE, "answer")
    made = first.stat().st_mtime_ns
    assert first.parent == cache
    assert compiled.library(SOURCE, "answer") == first
    assert first.stat().st_mtime_ns == made
    assert compiled.library(SOURCE + "\n", "answer") != first
    assert compiled.library(SOURCE, "answer", ("-O3",)) != first
    assert sorted(p.suffix for p in cache.iterdir()) == [".so"] * 3


@NEEDED
def test_the_folder_is_for_its_owner_alone(cache):
    compiled.library(SOURCE, "answer")
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@NEEDED
def test_a_folder_that_others_may_write_to_is_not_used(cache):
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    assert compiled.library(SOURCE, "answer").parent != cache
    assert not any(cache.iterdir())


@NEEDED
def test_source_that_does_not_compile_gives_nothing(cache):
    with pytest.warns(compiled.NotCompiledWarning, match="failed on answer.c"):
        assert compiled.library("int answer(void) { return", "answer") is None


@NEEDED
def test_compiled_and_not_a_function_gives_the_same(cache):
    function, native = compiled.native_function(square())
    assert native
    values = np.random.default_rng(0).normal(size=3)
    own = compiled.Compiled(function, native)
    assert np.array_equal(own(values)[0], compiled.Compiled(square(), False)(values)[0])


def test_a_home_that_cannot_be_written_is_no_obstacle(cache, monkeypatch):
    blocked = cache.parent.parent / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    compiled.folder.cache_clear()
    home = compiled.folder()
    assert home is not None
    assert os.access(home, os.W_OK)
