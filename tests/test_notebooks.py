"""Notebooks are stored as source: no outputs, a kernel that everyone has, nothing from the net."""

import json
import re
from pathlib import Path

import pytest

from plumbline.experiments.report.diagnosis.card import card
from tests.made_up_diagnosis import made_up

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
EACH = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
NETWORK = re.compile(r"\b(requests|urllib|pooch|fetch)\b")


def code(path):
    """The code cells of a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 2


@EACH
def test_a_notebook_is_stored_without_outputs(path):
    assert code(path)
    assert not [c for c in code(path) if c["outputs"] or c["execution_count"] is not None]


@EACH
def test_a_notebook_runs_on_the_plain_kernel(path):
    metadata = json.loads(path.read_text(encoding="utf-8"))["metadata"]
    assert metadata["kernelspec"]["name"] == "python3"


@EACH
def test_a_notebook_needs_no_network(path):
    assert not NETWORK.search("\n".join("".join(cell["source"]) for cell in code(path)))


def test_a_verdict_shows_itself_as_its_card():
    verdict = made_up().verdict
    assert verdict._repr_html_() == card(verdict)
    assert "joint_compliance of joint 2" in verdict._repr_html_()
