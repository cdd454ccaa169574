"""``plumbline.load`` reads every kind of folder and every stored answer; rooms know no circle."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.reality.ranging.phantoms import block
from plumbline.experiments.reality.ranging.writing import write_survey
from plumbline.optim.hand_eye.recording import RangeRecording
from plumbline.optim.hand_eye.scan_recording import ScanRecording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.registration.fiducials import Fiducials
from tests.optim.registration.test_fiducials import phantom
from tests.phantoms import save_fiducials
from tests.ranging_scenes import room_of, surveyed, write_block
from tests.recording_folders import write_folder

ROOT = Path(plumbline.__file__).parent
WITHOUT_CIRCLE = ("optim/core", "optim/recording", "optim/measurement", "optim/hand_eye")
ABOVE = ("recording", "measurement", "registration", "hand_eye", "dh_fit", "diagnosis", "pointing")


def imports(path):
    """Modules that a file imports anywhere, within functions and for types, too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


def module(path):
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize("room", WITHOUT_CIRCLE)
def test_no_module_of_a_room_imports_itself_by_a_detour(room):
    own = {module(path): path for path in (ROOT / room).rglob("*.py")}
    graph = {name: {m for m in imports(path) if m in own} for name, path in own.items()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"a circle: {' -> '.join(error.args[1])}")


def test_the_core_and_the_rigid_match_lie_below_every_method():
    low = [*(ROOT / "optim" / "core").rglob("*.py"), ROOT / "optim" / "rigid.py"]
    upper = tuple(f"plumbline.optim.{name}" for name in ABOVE)
    found = [(module(p), m) for p in low for m in imports(p) if m.startswith(upper)]
    assert not found


def tips(place):
    return write_folder(place)


def ranges(place):
    room, survey, _ = surveyed(0)
    return write_survey(place / "bench", room, survey)


def scan(place):
    room = room_of(0)
    return write_block(place / "block", room, block(room, np.random.default_rng(5)))


def fiducials(place):
    return save_fiducials(phantom(), place / "phantom")


@pytest.mark.parametrize(
    ("write", "kind"),
    [(tips, Recording), (ranges, RangeRecording), (scan, ScanRecording), (fiducials, Fiducials)],
)
def test_a_folder_is_read_by_what_was_observed(tmp_path, write, kind):
    assert type(plumbline.load(write(tmp_path))) is kind


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda place: place / "nowhere", "no such folder"),
        (lambda place: place / ("x" * 3000), "no such folder"),
        (lambda place: tips(place) / "samples.csv", "no JSON"),
        (lambda place: place, "no such file in"),
    ],
)
def test_what_is_neither_a_recording_nor_an_answer_is_refused_in_one_line(tmp_path, write, words):
    with pytest.raises(PlumblineError, match=words) as caught:
        plumbline.load(write(tmp_path))
    assert "\n" not in str(caught.value)


def test_an_answer_of_an_unknown_kind_is_refused(tmp_path):
    path = tmp_path / "answer.json"
    path.write_text('{"format": "plumbline answer", "kind": "Prophecy", "fields": {}}')
    with pytest.raises(PlumblineError, match="kind 'Prophecy'"):
        plumbline.load(path)
