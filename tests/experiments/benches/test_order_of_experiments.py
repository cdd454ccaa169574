"""Folders of the experiments import downwards only: a line of ORDER stands on those above."""

import ast
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).resolve().parents[3] / "plumbline" / "experiments"
PACKAGE = "plumbline.experiments"
ORDER = (
    {"console", "reality", "slicer"},
    {"importing"},
    {"sources"},
    {"mpc"},
    {"reproduce"},
    {"report"},
    {"withheld"},
    {"sweep"},
    {"commands"},
    {"benches"},
    {"compare"},
)
RANK = {folder: rank for rank, folders in enumerate(ORDER) for folder in folders}
FOLDERS = sorted(p.parent.name for p in EXPERIMENTS.glob("*/__init__.py"))


def imported(source):
    """Folders of the experiments that a module imports from, at its top or within a function."""
    modules = [n.module or "" for n in ast.walk(ast.parse(source)) if isinstance(n, ast.ImportFrom)]
    parts = [module.split(".") for module in modules if module.startswith(f"{PACKAGE}.")]
    return {part[2] for part in parts}


def upwards(folder, source):
    """Imports of a module that do not lead to its own folder or to a lower one."""
    return {other for other in imported(source) - {folder} if RANK[other] >= RANK[folder]}


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_imports_from_lower_ones_alone(folder):
    for path in (EXPERIMENTS / folder).rglob("*.py"):
        assert not upwards(folder, path.read_text(encoding="utf-8")), path


def test_every_folder_has_its_place():
    assert set(FOLDERS) == set(RANK)


def test_an_import_upwards_is_seen():
    assert upwards("reproduce", f"from {PACKAGE}.commands.app import run") == {"commands"}
    assert upwards("reproduce", f"def f():\n    from {PACKAGE}.report import Table") == {"report"}
    assert not upwards("withheld", f"from {PACKAGE}.report.style import INK")
