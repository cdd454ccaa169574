"""Laws of the house: short files and functions, everything frozen, nothing in data is executed."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILE_LINES = 400
FUNCTION_LINES = 59
SOURCES = sorted((ROOT / "plumbline").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
# Spelt in halves, so that this file keeps its own law.
SILENCERS = ("# no" + "qa", "# type: " + "ignore", "TO" + "DO", "FIX" + "ME")
NUMBERS = {"constants.py", "prior.py"}  # of a method
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}
UNSAFE_CALLS = {"eval", "exec", "compile"}


def label(path: Path) -> str:
    """A file's path from the project's root."""
    return path.relative_to(ROOT).as_posix()


def long_functions(tree: ast.AST) -> Iterator[str]:
    """Functions longer than the house allows, docstring included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > FUNCTION_LINES:
                yield f"{node.name}: {length} lines, at most {FUNCTION_LINES}"


def thawed_dataclasses(tree: ast.AST) -> Iterator[str]:
    """Dataclasses that are not declared ``frozen=True``."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.ClassDef):
            continue
        for decorator in node.decorator_list:
            text = ast.unparse(decorator)
            if text.split("(")[0].endswith("dataclass") and "frozen=True" not in text:
                yield f"{node.name}: declare it frozen=True"


def swallowed_errors(tree: ast.AST) -> Iterator[str]:
    """Handlers that catch everything."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ExceptHandler) and node.type is None:
            yield f"line {node.lineno}: name the exception"


def unsafe_code(tree: ast.AST) -> Iterator[str]:
    """Ways to run what is written in a file of data."""
    for node in ast.walk(tree):
        names: set[str] = set()
        if isinstance(node, ast.Import):
            names = {alias.name.split(".")[0] for alias in node.names} & UNSAFE_MODULES
        elif isinstance(node, ast.ImportFrom):
            names = {(node.module or "").split(".")[0]} & UNSAFE_MODULES
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            names = {node.func.id} & UNSAFE_CALLS
        elif isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            names = {"allow_pickle"} if ast.unparse(node.value) != "False" else set()
        yield from (f"line {getattr(node, 'lineno', '?')}: {name}" for name in sorted(names))


@cache
def text_of(path: Path) -> str:
    """A file's text, read once for all laws."""
    return path.read_text(encoding="utf-8")


@cache
def tree_of(path: Path) -> ast.Module:
    """A module, parsed once for all laws."""
    return ast.parse(text_of(path))


LAWS = (long_functions, thawed_dataclasses, swallowed_errors, unsafe_code)


@pytest.mark.parametrize("law", LAWS)
def test_every_module_keeps_the_law(law):
    broken = [f"{label(path)}: {found}" for path in SOURCES for found in law(tree_of(path))]
    assert not broken


@pytest.mark.parametrize(
    ("law", "source"),
    [
        (long_functions, "def f():\n" + "    x = 1\n" * FUNCTION_LINES),
        (thawed_dataclasses, "@dataclass\nclass A:\n    x: int"),
        (thawed_dataclasses, "@dataclasses.dataclass(slots=True)\nclass A:\n    x: int"),
        (swallowed_errors, "try:\n    f()\nexcept:\n    pass"),
        (unsafe_code, "from pickle import load"),
        (unsafe_code, "def f(text):\n    return eval(text)"),
        (unsafe_code, "np.load(path, allow_pickle=True)"),
    ],
)
def test_a_broken_law_is_seen(law, source):
    assert list(law(ast.parse(source)))


def test_rooms_refuse_by_the_one_class_of_errors():
    rooms = {"kinematics", "optim", "reality", "mpc", "sweep", "withheld", "compare"}
    raised = [
        f"{label(path)}: {ast.unparse(node)[:60]}"
        for path in SOURCES
        if rooms & set(path.parts)
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Raise) and ast.unparse(node).startswith("raise ValueError")
    ]
    assert not raised


def is_number(node: ast.expr | None) -> bool:
    """Whether an expression is a number, or numbers, written out."""
    if isinstance(node, ast.Tuple):
        return bool(node.elts) and all(is_number(part) for part in node.elts)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def numbers_of(tree: ast.Module) -> Iterator[ast.Assign | ast.AnnAssign]:
    """Statements that name a number of a module."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value):
            yield node


def own_numbers(path: Path, tree: ast.Module) -> Iterator[str]:
    """Numbers of a method that stand outside its module of them; a file's version may."""
    if ROOT / "plumbline/optim" in path.parents and path.name not in NUMBERS:
        found = (ast.unparse(node).split(" = ")[0] for node in numbers_of(tree))
        yield from (name for name in found if name != "VERSION")


def test_numbers_of_a_method_stand_in_one_place():
    broken = [f"{label(p)}: {name}" for p in SOURCES for name in own_numbers(p, tree_of(p))]
    assert not broken
    method = ROOT / "plumbline/optim/hand_eye/made_up.py"
    source = "VERSION = 1\nHALF: float = 1 / 2\nBOTH = A, B = -1, 2.0\nNAME = 'a'\nSIX = (F,)"
    assert list(own_numbers(method, ast.parse(source))) == ["HALF: float", "BOTH"]


def untold_numbers(path: Path) -> Iterator[str]:
    """Numbers of a module without words behind or above them: what of, in which unit, whence."""
    lines = text_of(path).splitlines()
    for node in numbers_of(tree_of(path)):
        above, own = lines[node.lineno - 2], "\n".join(lines[node.lineno - 1 : node.end_lineno])
        if "  # " not in own and not above.startswith(("# ", "#: ")):
            yield f"{label(path)}: {own}"


def test_every_number_in_its_place_says_what_it_is():
    """Those of a method in its module of them, those of experiments where they are used."""
    rooms = [p for p in SOURCES if p.name in NUMBERS or "experiments" in p.parts]
    assert not [number for path in rooms for number in untold_numbers(path)]


def test_half_of_all_functions_have_seven_lines_or_fewer():
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [n for path in SOURCES for n in ast.walk(tree_of(path)) if isinstance(n, kinds)]
    assert median((n.end_lineno or n.lineno) - n.lineno + 1 for n in nodes) <= 7


def test_every_module_is_short_and_says_what_it_is():
    for path in SOURCES:
        lines = len(text_of(path).splitlines())
        assert lines <= FILE_LINES, f"{label(path)}: {lines} lines, at most {FILE_LINES}; split it"
        assert ast.get_docstring(tree_of(path)), f"{label(path)}: open it with a docstring"


def test_nothing_is_silenced_or_put_off():
    for path in (*SOURCES, *TESTS):
        assert not [word for word in SILENCERS if word in text_of(path)], label(path)


def test_what_a_class_leaves_open_is_abstract():
    """An object that cannot do its work is refused when it is made, not when it is asked."""
    for path in SOURCES:
        assert "raise NotImplementedError" not in text_of(path), label(path)


def test_every_folder_of_modules_is_a_package():
    bare = {label(path.parent) for path in SOURCES if not (path.parent / "__init__.py").exists()}
    assert not bare, f"{sorted(bare)}: add an __init__.py, or the installed package lacks them"


def test_the_citation_names_the_project_s_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    version = project.split('\nversion = "')[1].split('"')[0]
    assert f"\nversion: {version}\n" in citation


def test_a_release_is_checked_and_tried_before_it_is_published():
    workflow = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    steps = [
        workflow.index(step) for step in (".ci/run", "make dist", "needs: build", "pypi-publish")
    ]
    assert steps == sorted(steps)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert "python -m build" in makefile.split("\ndist: ## ")[1].split("\n\n")[0]
