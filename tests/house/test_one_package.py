"""One package, ``plumbline``; the folders at the root are links that nobody imports through."""

import importlib
import inspect
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from setuptools import find_packages

import plumbline
from plumbline.experiments.commands.app import run
from tests.house.test_import_direction import LINKS, ROOT, imports, within

TESTS = sorted((ROOT / "tests").rglob("*.py"))
FACE = Path(plumbline.__file__).with_suffix(".pyi")
BARE = re.compile(rf"(?<![\w.])({'|'.join(LINKS)})\b")  # as whoever imports through one writes it
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("name", LINKS)
def test_a_room_at_the_root_is_a_link_into_the_package(name):
    assert (ROOT / name).is_symlink()
    assert (ROOT / name).readlink() == Path("plumbline") / name


def test_nothing_that_a_command_wrote_stands_at_the_root():
    """An answer that was left there by chance is told before it is kept for ever."""
    if not (ROOT / ".git").exists() or (git := shutil.which("git")) is None:
        pytest.skip("no checkout, or no git: what is kept cannot be told from what is not")
    listed = subprocess.run([git, "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    kept = {line.split("/")[0] for line in listed.stdout.splitlines()}
    files = {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile", "README.md"}
    folders = {"docs", "notebooks", "plumbline", "tests", *LINKS}
    assert {k for k in kept if k[0] != "."} == {*files, *folders, "pyproject.toml"}


def test_no_test_imports_through_a_link():
    for path in TESTS:
        if not BARE.search(text := path.read_text(encoding="utf-8")):
            continue
        names = imports(text, f"tests.{path.stem}")
        assert not [n for n in names if any(within(n, link) for link in LINKS)], path.name


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_notebook_reaches_through_a_link(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    lines = [line for cell in cells if cell["cell_type"] == "code" for line in cell["source"]]
    through = re.compile(rf"""(import|from) ({"|".join(LINKS)})\b|["']({"|".join(LINKS)})["'.]""")
    assert not [line for line in lines if through.search(line)]


def test_nothing_else_is_installed():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found = find_packages(str(ROOT), **_find(settings))
    assert {name.split(".")[0] for name in found} == {"plumbline"}


def _find(settings):
    return {"include": settings["tool"]["setuptools"]["packages"]["find"]["include"]}


def test_a_folder_with_rooms_of_the_same_names_does_not_matter(tmp_path):
    for name in LINKS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('somebody else')")
    code = "import plumbline; plumbline.diagnose; plumbline.fit_dh; print(plumbline.__version__)"
    command = [sys.executable, "-c", f"import sys; sys.path.append({str(ROOT)!r}); {code}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == plumbline.__version__


def test_what_the_face_offers_is_there_with_words_of_its_own():
    for name in plumbline.__all__:
        offered = getattr(plumbline, name)
        assert name in dir(plumbline)
        assert isinstance(offered, str | tuple) or offered.__doc__, name


def test_the_face_loads_what_type_checkers_read():
    for name, (place, own) in plumbline._HOME.items():
        module = importlib.import_module(place)
        assert getattr(plumbline, name) is getattr(module, own), name
    again = re.findall(r" as (\w+)$|^(\w+) [=:]|^(__version__)", FACE.read_text(), re.MULTILINE)
    assert sorted("".join(names) for names in again) == plumbline.__all__  # one by one


def test_the_reference_names_all_that_the_face_offers():
    text = (ROOT / "docs/reference/face.md").read_text(encoding="utf-8")
    assert [n for n in plumbline.__all__ if not re.search(rf"plumbline\.{n}\b", text)] == []


def test_the_face_says_all_that_it_takes():
    """No ``**options: Any``: further keywords are those of a declared table."""
    for name in plumbline.__all__:
        offered = getattr(plumbline, name)
        if inspect.isfunction(offered):
            for part in inspect.signature(offered).parameters.values():
                table = str(part.annotation).startswith(("Unpack[", "*", "typing.Unpack["))
                assert table or part.kind != part.VAR_KEYWORD, f"{name}: {part}"


def test_what_the_face_lacks_is_named():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = plumbline.nonsense


def test_the_version_is_that_of_the_distribution(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"plumbline {plumbline.__version__}\n"
