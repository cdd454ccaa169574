"""Tables on a narrow terminal: no number is cut off, no word is broken."""

import pytest
from rich.console import Console

from plumbline.experiments.commands.next import _print
from plumbline.experiments.report.page.page import Grid
from plumbline.experiments.report.page.words import table_of
from plumbline.optim.diagnosis.design.next_experiment import NextExperiment, Suggestion


class Named:
    """A recording of three rows."""

    name = "arm"

    def __len__(self):
        return 3


def test_no_joint_of_a_posture_is_cut_off(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    pose = (-1.001, -1.002, -1.003, -1.004, -1.005, -1.006, -1.007)
    row = Suggestion(pose, (1,) * 7, None, None, None, None, ("a", "b"))
    _print(Named(), NextExperiment((row,), ("a", "b"), (0.6, 0.4), None, (), (), ("revolute",) * 7))
    shown = capsys.readouterr().out
    assert all(f"{v:.3f}" in shown for v in pose)
    assert "A from B" in shown


def test_no_probability_of_what_rows_leave_open_is_called_certain(capsys):
    _print(Named(), NextExperiment((), ("a",), (1.0,), None, (), (), ("revolute",)))
    shown = capsys.readouterr().out
    assert "> 99 %" in shown
    assert "100" not in shown


@pytest.mark.parametrize("word", ["recording", "position"])
def test_no_word_of_a_table_is_broken(word, capsys):
    row = ("mon", "tip position", "50", *["0.490 mm"] * 2, "0.0354 mrad", "0.0800 mm (given)", "no")
    columns = (
        "recording",
        "kind",
        "rows",
        "before",
        "after",
        "of the others alone",
        "noise",
        "gross",
    )
    table = table_of(Grid(columns, [row], range(2, 7), sorts=False))
    Console(width=66).print(table)
    assert word in capsys.readouterr().out
