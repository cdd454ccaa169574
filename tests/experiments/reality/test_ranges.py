"""The table of ranges that simulators draw from."""

from pathlib import Path

import numpy as np
import pytest

import plumbline.experiments.reality
from plumbline.experiments.reality.ranges import TABLES, Ranges

SOURCES = [
    path.read_text() for path in Path(plumbline.experiments.reality.__file__).parent.rglob("*.py")
]
EVERY = [(kind, name) for kind, table in TABLES.items() for name in table]


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_range_has_a_unit_a_reason_and_room_and_is_drawn_from(kind, name):
    low, high, unit, why, law = TABLES[kind][name]
    assert low < high
    assert unit
    assert len(why) > 5
    assert law in ("uniform", "log")
    fields = "RANGES.one(field" if kind == "drive" else f'"{name}"'
    assert any(
        f'Ranges("{kind}")' in text and (f'"{name}"' in text or fields in text) for text in SOURCES
    )


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_what_is_drawn_fills_its_range_evenly(kind, name):
    low, high, _, _, law = TABLES[kind][name]
    ends = np.log([low, high]) if law == "log" else np.array([low, high], dtype=float)
    drawn = Ranges(kind).many(name, np.random.default_rng(0), 2000)
    share = ((np.log(drawn) if law == "log" else drawn) - ends[0]) / np.ptp(ends)
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    assert np.quantile(share, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.04)


def test_whole_numbers_are_drawn_up_to_both_ends():
    rng = np.random.default_rng(0)
    assert {Ranges("session").whole("sockets", rng) for _ in range(100)} == {2, 3, 4}
