"""Notebooks use the face alone, need nothing from the net and are stored with light outputs."""

import ast
import base64
import json
import re
from pathlib import Path

import pytest

from plumbline.experiments.report.writing import card_of
from tests.made_up_diagnosis import made_up

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
EACH = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
# [byte]: whoever clones carries them along for good.
LARGEST = 400_000
LARGEST_PICTURE = {"image/png": 60_000, "image/gif": 100_000}  # a film is a GIF
SHOWN = {"text/plain", "text/html", "text/markdown", *LARGEST_PICTURE}
PLACE = re.compile(r"(?<![\w.])/(home|root|tmp|work|usr|var|Users)/| at 0x[0-9a-f]+")
NETWORK = re.compile(r"\b(requests|urllib|pooch|fetch)\b")


def code(path):
    """The code cells of a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 2


def imported(cell):
    """Whole names of the modules that a cell imports; its magics aside."""
    lines = "".join(cell["source"]).splitlines()
    tree = ast.parse("\n".join(line for line in lines if not line.startswith("%")))
    plain = [n.names for n in ast.walk(tree) if isinstance(n, ast.Import)]
    names = {alias.name for aliases in plain for alias in aliases}
    return names | {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}


@EACH
def test_a_notebook_begins_with_the_face_numpy_and_matplotlib_alone(path):
    first = imported(code(path)[0])
    assert "plumbline" in first
    assert {name.split(".")[0] for name in first} <= {"plumbline", "numpy", "matplotlib"}


@EACH
def test_a_notebook_reaches_everything_through_the_face(path):
    inside = re.compile(r"\bplumbline\.(kinematics|optim|experiments)\.")
    for cell in code(path):
        assert not [name for name in imported(cell) if name.startswith("plumbline.")]
        assert not inside.search("".join(cell["source"]))
        assert not re.search(r"^\s*from plumbline import", "".join(cell["source"]), re.MULTILINE)


def data_of(cell):
    """What a cell's outputs carry: kind (MIME) and content, text joined."""
    for output in cell["outputs"]:
        if output["output_type"] == "stream":
            yield "text/plain", "".join(output["text"])
        for kind, content in output.get("data", {}).items():
            yield kind, "".join(content)


def outputs(path):
    """What a notebook shows."""
    return [pair for cell in code(path) for pair in data_of(cell)]


@EACH
def test_a_notebook_shows_what_it_computes(path):
    assert [c["execution_count"] for c in code(path)] == list(range(1, len(code(path)) + 1))
    assert len(outputs(path)) >= len(code(path)) // 2
    assert not [o for c in code(path) for o in c["outputs"] if o["output_type"] == "error"]
    assert not [o for c in code(path) for o in c["outputs"] if o.get("name") == "stderr"]


@EACH
def test_a_notebook_is_light(path):
    assert path.stat().st_size <= LARGEST
    pictures = [pair for pair in outputs(path) if pair[0] in LARGEST_PICTURE]
    assert not [k for k, p in pictures if len(base64.b64decode(p)) > LARGEST_PICTURE[k]]


@EACH
def test_a_notebook_shows_text_cards_and_pictures_of_no_certain_place(path):
    assert {kind for kind, _ in outputs(path)} <= SHOWN
    texts = [content for kind, content in outputs(path) if kind.startswith("text/")]
    assert not [text for text in texts if PLACE.search(text)]
    assert not [text for text in texts if "<svg" in text]  # a picture is one line, not hundreds
    assert not [cell for cell in code(path) if "execution" in cell["metadata"]]  # times of day


@EACH
def test_a_notebook_runs_on_the_plain_kernel(path):
    metadata = json.loads(path.read_text(encoding="utf-8"))["metadata"]
    assert metadata["kernelspec"]["name"] == "python3"


@EACH
def test_a_notebook_needs_no_network(path):
    assert not NETWORK.search("\n".join("".join(cell["source"]) for cell in code(path)))


def test_a_verdict_shows_itself_as_its_card():
    verdict = made_up().verdict
    assert verdict._repr_html_() == card_of(verdict)
    assert "joint_compliance of joint 2" in verdict._repr_html_()
