"""A recording that passes its checks is diagnosed, however short it is and whatever its clock."""

import numpy as np
import pytest

from plumbline.kinematics.effects import EFFECTS
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.loading import load_recording
from tests.recording_folders import with_columns


@pytest.mark.parametrize("rows", [4, 5])
def test_the_fewest_rows_that_pass_are_diagnosed(tmp_path, rows):
    columns = [f"q{j}" for j in range(1, 7)] + list("xyz")
    folder = with_columns(tmp_path, lambda table: {name: table[name][:rows] for name in columns})
    assert diagnose(load_recording(folder)).verdict.gap.unit == "m"


def still(table):
    return table | {"time": np.full(len(table["q1"]), 3.0)}


def test_a_clock_that_stands_still_is_noted(tmp_path):
    recording = load_recording(with_columns(tmp_path, still))
    assert any("the clock stands still" in note for note in recording.notes)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_what_runs_with_time_is_not_offered_where_time_stands_still(tmp_path, effect):
    scope = scope_of(load_recording(with_columns(tmp_path, still)))
    assert not any("time" in one.needs for one in effect.candidates(scope))
