"""Imports run one way: kinematics <- optim <- experiments <- notebooks, and reality stands apart.

The simulators of ``experiments/reality`` judge the library, so they share no code with it: of this
project they may import themselves only.
"""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# At the root, for readers: nobody imports through them.
LINKS = ("kinematics", "optim", "experiments")
UPWARDS = {
    "plumbline": (*LINKS, "notebooks", "tests"),
    "plumbline.kinematics": ("plumbline.optim", "plumbline.experiments"),
    "plumbline.optim": ("plumbline.experiments",),
    "plumbline.experiments.reality": ("plumbline.kinematics", "plumbline.optim"),
}
REALITY = "plumbline.experiments.reality"
SOURCES = sorted((ROOT / "plumbline").rglob("*.py"))


def module_name(path: Path) -> str:
    """Dotted name of a source file; a package's ``__init__`` keeps that suffix."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def called_imports(node: ast.AST) -> list[str]:
    """Module names in ``import_module("x")`` and ``__import__("x")``."""
    if not isinstance(node, ast.Call) or not node.args:
        return []
    name = getattr(node.func, "attr", getattr(node.func, "id", ""))
    first = node.args[0]
    if name in {"import_module", "__import__"} and isinstance(first, ast.Constant):
        return [str(first.value)]
    return []


@cache
def imports(source: str, module: str) -> set[str]:
    """Absolute names of all that a module imports, at any depth of its code."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        found.update(called_imports(node))
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = module.split(".")[: -node.level] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            found.update({base} | {f"{base}.{alias.name}".lstrip(".") for alias in node.names})
    return found


def within(name: str, package: str) -> bool:
    """Whether a dotted name is the package or lies inside it."""
    return name == package or name.startswith(package + ".")


def against_the_flow(source: str, module: str) -> set[str]:
    """Imports of a module that run the wrong way; only what stands outside uses the face."""
    names = imports(source, module)
    wrong = {
        name
        for home, banned in UPWARDS.items()
        if within(module, home)
        for name in names
        if any(within(name, package) for package in banned)
    }
    if any(within(module, f"plumbline.{room}") for room in LINKS):
        wrong |= names & {"plumbline"}
    if within(module, REALITY):
        ours = {name for name in names if within(name, "plumbline.experiments")}
        wrong |= {name for name in ours - {"plumbline.experiments"} if not within(name, REALITY)}
    return wrong


def test_imports_run_one_way():
    for path in SOURCES:
        wrong = against_the_flow(path.read_text(encoding="utf-8"), module_name(path))
        assert not wrong, f"{path.relative_to(ROOT)} imports {sorted(wrong)}: against the flow"


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("plumbline.kinematics.robot", "import plumbline.optim"),
        (
            "plumbline.kinematics.robot",
            "def f():\n    from plumbline.optim.core.problem import Problem",
        ),
        ("plumbline.kinematics.effects.backlash", "from ... import optim"),
        ("plumbline.kinematics.robot", "from kinematics.frames import skew"),
        ("plumbline.optim.core.problem", "from plumbline import load"),
        ("plumbline.optim.core.problem", "import plumbline.experiments.sources as s"),
        (
            "plumbline.optim.core.solvers.programme",
            "import importlib\nimportlib.import_module('plumbline.experiments')",
        ),
        ("plumbline.experiments.reality.arm", "from plumbline.kinematics.frames import skew"),
        ("plumbline.experiments.reality.arm", "from ..sources import fetch"),
        ("plumbline.experiments.reality.arm", "from plumbline.experiments import withheld"),
    ],
)
def test_an_import_against_the_flow_is_seen(module, source):
    assert against_the_flow(source, module)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        (
            "plumbline.experiments.report.diagnosis.html",
            "from plumbline.optim.diagnosis import verdict\nimport plumbline.kinematics",
        ),
        (
            "plumbline.optim.dh_fit",
            "from plumbline.kinematics.robot import Robot\nfrom .problem import Problem",
        ),
        (
            "plumbline.kinematics.effects.backlash",
            "from .effect import Effect\nfrom ..frames import skew",
        ),
        ("plumbline.kinematics.robot", "import optimagic"),
        (
            "plumbline.experiments.reality.arm",
            "import numpy\nfrom plumbline.experiments.reality import noise",
        ),
        ("plumbline.experiments.reality.arm", "from .noise import draw\nfrom . import noise"),
    ],
)
def test_an_import_with_the_flow_passes(module, source):
    assert not against_the_flow(source, module)


def test_importing_reality_loads_none_of_the_library():
    modules = [m for m in map(module_name, SOURCES) if within(m, "plumbline.experiments.reality")]
    names = [m.removesuffix(".__init__") for m in modules if not m.endswith("__main__")]
    code = (
        "import importlib, sys\n"
        f"for name in {names!r}:\n    importlib.import_module(name)\n"
        "banned = ('plumbline.kinematics', 'plumbline.optim')\n"
        "print(*[m for m in sys.modules if m.startswith(banned)])\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


# Rooms of the diagnosis: each imports those before it alone; its ``__init__`` says what they hold.
ROOMS = (
    "prior",
    "constants",
    "of_recordings",
    "meaning",
    "findings",
    "with_verdict",
    "linearise",
    "posterior",
    "discrepancy",
    "predict",
    "verdict",
    "design",
    "options",
    "motion",
    "answer",
    "proof",
    "diagnose",
    "several",
    "of_any_kind",
    "calibrate",
)
DIAGNOSIS = "plumbline.optim.diagnosis"


def modules() -> dict[str, Path]:
    """All modules by their dotted names, packages by theirs."""
    return {module_name(path).removesuffix(".__init__"): path for path in SOURCES}


def graph() -> dict[str, set[str]]:
    """Which modules each module imports: at any depth of its code, for types alone as well."""
    known = modules()
    edges = {}
    for name, path in known.items():
        found = imports(path.read_text(encoding="utf-8"), module_name(path)) & set(known)
        # To import a name from a package's module is not to import the package.
        edges[name] = {m for m in found if not any(within(n, m) for n in found - {m})} - {name}
    return edges


def circles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Sets of modules each of which imports every other one, by way of others."""
    reached = {name: set(direct) for name, direct in edges.items()}
    for through in edges:
        for name in edges:
            if through in reached[name]:
                reached[name] |= reached[through]
    found = {frozenset(m for m in reached[n] if n in reached[m]) for n in edges if n in reached[n]}
    return [set(circle) for circle in found]


def test_modules_import_each_other_in_no_circle():
    assert circles(graph()) == []


def test_a_circle_is_seen():
    edges = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}
    assert circles(edges) == [{"a", "b", "c"}]


def room_of(module: str) -> str:
    """The room of a module of the diagnosis."""
    return module.removeprefix(DIAGNOSIS + ".").split(".")[0]


def test_rooms_of_the_diagnosis_import_one_way():
    ours = {name: to for name, to in graph().items() if name.startswith(DIAGNOSIS + ".")}
    wrong = [
        (name, other)
        for name, to in ours.items()
        for other in to
        if other.startswith(DIAGNOSIS + ".")
        if ROOMS.index(room_of(other)) > ROOMS.index(room_of(name))
    ]
    assert wrong == []


def test_the_rooms_of_the_diagnosis_are_told_in_their_order():
    said = (ROOT / DIAGNOSIS.replace(".", "/") / "__init__.py").read_text(encoding="utf-8")
    places = [said.index(f"\n``{room}``") for room in ROOMS]
    assert places == sorted(places)
