"""An answer is stored whole, brought back as it was, and refused in one line if damaged."""

import json
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.optim.core import answer as module
from plumbline.optim.core.answer import Answer, kind_of
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.measurement.storing import effect_named
from tests.answer_contract import keeps_the_contract


class Colour(StrEnum):
    RED = "red"


@dataclass(frozen=True)
class Part:
    size: float
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Made(Answer):
    name: str
    points: NDArray[np.float64]
    flags: NDArray[np.bool_]
    part: Part
    parts: tuple[Part, ...]
    least: float
    maybe: float | None
    colour: Colour
    judged: Judgement

    def card(self) -> str:
        return f"<div>{len(self.points)} points</div>"

    def __repr__(self) -> str:
        return f"<Made {self.name}>"


def draw(made: Made) -> Figure:
    return Figure()


DRAWN = {"Made": lambda made: {"only": lambda: draw(made)}}


@pytest.fixture
def made(monkeypatch) -> Made:
    monkeypatch.setattr(module, "DRAWN", [__name__])
    points = np.array([[1.0, np.nan], [np.inf, 1e-300], [0.1, -np.inf]])
    fits = (Judged("a fit", True, 1e-9),)
    return Made(
        "<b>", points, np.zeros((0, 3), dtype=bool), Part(np.nan, ("a", "b")), (Part(1 / 3),),
        -np.inf, None, Colour.RED, Judgement(True, fits),
    )  # fmt: skip


def test_an_answer_keeps_the_contract(made, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__) or __import__(__name__))
    keeps_the_contract(made, tmp_path)


def test_every_number_comes_back_to_the_last_bit(made, tmp_path):
    made.save(tmp_path / "a.json")
    again = Made.load(tmp_path / "a.json")
    np.testing.assert_array_equal(again.points, made.points)
    assert again.flags.shape == (0, 3)
    assert again.flags.dtype == bool
    assert again.parts == made.parts
    assert np.isnan(again.part.size)
    assert again.least == -np.inf
    assert again.maybe is None
    assert again.colour is Colour.RED
    assert again.judged == made.judged


def test_what_is_there_is_not_overwritten_unless_asked(made, tmp_path):
    path = tmp_path / "a.json"
    path.write_text("mine")
    with pytest.raises(PlumblineError, match="overwrite=True"):
        made.save(path)
    assert path.read_text() == "mine"
    made.save(path, overwrite=True)
    assert kind_of(path) == "Made"


def damaged(change):
    def apply(path):
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return apply


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda path: path.unlink(), "cannot be read"),
        (lambda path: path.write_text("{"), "no JSON"),
        (lambda path: path.write_text("[" * 100_000), "no JSON"),
        (lambda path: path.write_text("[1]"), "other JSON"),
        (damaged(lambda c: c.update(kind="Nobody")), "kind 'Nobody'"),
        (damaged(lambda c: c["fields"].pop("least")), "damaged fields"),
        (damaged(lambda c: c["fields"].update(least="much")), "damaged fields"),
        (damaged(lambda c: c["fields"]["points"].update(shape=[7])), "damaged fields"),
        (damaged(lambda c: c["fields"].update(colour="pink")), "damaged fields"),
        (damaged(lambda c: c.update(fields=[])), "damaged fields"),
    ],
)
def test_a_damaged_answer_is_refused_in_one_line(made, tmp_path, damage, words):
    path = tmp_path / "a.json"
    made.save(path)
    damage(path)
    with pytest.raises(PlumblineError, match=words) as caught:
        Made.load(path)
    assert "\n" not in str(caught.value)


def test_what_nobody_draws_is_said(made, monkeypatch):
    monkeypatch.setattr(module, "DRAWN", [])
    with pytest.raises(PlumblineError, match="Made"):
        made.plot()


@dataclass(frozen=True, eq=False)
class Caused(Answer):
    effects: tuple[Effect, ...]
    judged: Judgement

    card = __repr__ = Made.__repr__


del Answer.kinds["Caused"]  # of this file alone: nobody else has to show it


def test_an_effect_that_nobody_has_imported_is_named_with_the_way_out(tmp_path):
    """What an answer knew as its own effect is found again once its module is imported."""
    assert effect_named("joint_offset") is JointOffset
    path = tmp_path / "a.json"
    Caused((JointOffset(joint=2),), Judgement(True, ())).save(path)
    assert Caused.load(path).effects == (JointOffset(joint=2),)
    damaged(lambda c: c["fields"]["effects"][0].update(name="worn_tooth", form="WornTooth"))(path)
    with pytest.raises(PlumblineError, match="effect 'worn_tooth' not recognised") as raised:
        Caused.load(path)
    assert str(raised.value).endswith("; import the module that defines it first")
