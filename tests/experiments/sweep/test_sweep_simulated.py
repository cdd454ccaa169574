"""Laws of sweeps over realities that are made up: grids, random designs, tables of two factors."""

import io
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.sweep.outcome import Crossed, Outcome, Sweep
from plumbline.experiments.sweep.simulated import (
    METHODS,
    REALITIES,
    Case,
    Design,
    Truth,
    cases,
    factors_of,
)
from plumbline.experiments.sweep.spec import read_spec
from plumbline.experiments.sweep.sweep import sweep
from plumbline.optim.diagnosis import of_any_kind
from tests.made_up_diagnosis import made_up

MARKERS = """
reality = "fiducials"
[vary]
estimator = ["kabsch", "robust"]
[random]
cases = 6
seed = 3
gap = [1.0, 8.0]
markers = [6, 12]
"""


def written(folder, text):
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def markers(tmp_path_factory):
    """Registrations of simulated heads by two estimators."""
    return sweep(read_spec(written(tmp_path_factory.mktemp("markers"), MARKERS)), jobs=1)


def test_a_random_design_meets_every_stratum_of_every_range_once():
    spans = {"gap": (1.0, 16.0), "rows": (50, 450)}
    drawn = Design(8, 1, spans).drawn(factors_of("arm", "diagnose"))
    octaves = 2.0 * np.log2([d["gap"] for d in drawn])  # from above zero evenly in the logarithm
    assert sorted(np.floor(octaves)) == list(range(8))
    assert all(isinstance(d["rows"], int) and 50 <= d["rows"] <= 450 for d in drawn)
    assert [d["seed"] for d in drawn] == list(range(8))
    assert drawn == Design(8, 1, spans).drawn(factors_of("arm", "diagnose"))


def test_every_point_of_a_design_is_asked_in_every_way_of_the_grid(markers):
    options = [outcome.case.to_dict() for outcome in markers.outcomes]
    assert [o["estimator"] for o in options] == ["kabsch"] * 6 + ["robust"] * 6
    assert [o["gap"] for o in options[:6]] == [o["gap"] for o in options[6:]]
    assert markers.varied == ("seed", "gap", "markers", "estimator")


def test_an_answer_is_judged_by_what_is_true(markers):
    """Of heads with nothing wrong the error is as large as the answer says."""
    ratios = [o.found["error"] / o.found["expected"] for o in markers.outcomes]
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_a_table_by_two_factors_is_that_of_pandas(markers):
    frame = pd.DataFrame([outcome.to_dict() for outcome in markers.outcomes])
    expected = frame.pivot_table("error", "touches", "estimator", aggfunc="median")
    found = markers.table("touches", "estimator", "error")  # six cases a cell
    assert found.down == tuple(map(str, expected.index))
    assert found.across == tuple(expected.columns)
    np.testing.assert_allclose(found.values, expected.to_numpy())
    assert sum(map(sum, found.cases)) == len(frame)
    assert found.plot().axes


@pytest.mark.parametrize("down", [("a",), ("kabsch", "robust"), ("a name of many letters " * 2,)])
def test_a_table_of_one_column_has_room_for_its_picture(down):
    filled = ((1e-4,),) * len(down)
    one = Crossed("estimator", "markers", "error", down, ("8",), filled, ((1,),) * len(down))
    one.plot().savefig(io.BytesIO(), format="svg")


def test_of_many_levels_quarters_of_the_cases_are_lines():
    asked = [Case("arm", "diagnose", (("gap", 0.1 * k), ("kind", "single"))) for k in range(40)]
    made = Sweep("arm", "", tuple(Outcome(c, {"right": k >= 20}) for k, c in enumerate(asked)))
    found = made.table("gap", "kind")
    assert found.figure == "right"
    assert [line[0] for line in found.cases] == [10] * 4
    assert [line[0] for line in found.values] == [0.0, 0.0, 1.0, 1.0]


def test_a_factor_or_a_figure_that_is_not_there_is_refused_by_name(markers):
    with pytest.raises(PlumblineError, match=r"factor.*marker.*best matches: markers"):
        markers.table("marker", "estimator")
    with pytest.raises(PlumblineError, match=r"figure.*eror.*best matches: error"):
        markers.table("markers", "estimator", "eror")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('reality = "ceiling"', r"reality: found 'ceiling', expected one of arm"),
        ('reality = "arm"\nmethod = "register"', r"method: found 'register', expected one of diag"),
        ('reality = "arm"\n[vary]\nmarkers = 3', r"\[vary\] markers"),
        ('reality = "arm"\n[vary]\ngap = -1.0', r"\[vary\] gap.*numbers from 0.001 to 1000"),
        ('reality = "arm"\n[vary]\nrows = 50.5', r"\[vary\] rows.*whole numbers from 20 to 5000"),
        ('reality = "arm"\n[vary]\neffect = "wear"', r"\[vary\] effect.*words of any"),
        ('reality = "arm"\n[random]\ngap = [3.0, 1.0]', r"\[random\] gap.*a range \[LEAST, MOST\]"),
        ('reality = "arm"\n[random]\ncases = 0', r"\[random\] cases.*at least 1"),
        ('reality = "arm"\n[random]\ncases = 20000', r"at most 10000"),
    ],
)
def test_what_cannot_be_made_up_is_refused_in_one_line(text, words, tmp_path):
    with pytest.raises(PlumblineError, match=words) as refused:
        read_spec(written(tmp_path, text))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("reality", list(REALITIES))
def test_whatever_can_be_made_up_may_be_asked_in_its_first_way(reality):
    first = REALITIES[reality].methods[0]
    [case] = cases(reality, first, {}, Design())
    assert set(case.to_dict()) == set(factors_of(reality, first))


def test_a_command_sets_a_figure_out_by_two_factors_and_goes_on_where_it_was(tmp_path, capsys):
    spec, table, picture = written(tmp_path, MARKERS), tmp_path / "t.csv", tmp_path / "p.png"
    wanted = ["sweep", str(spec), "--jobs", "1", "--csv", str(table), "--overwrite"]
    wanted += ["--by", "markers,estimator"]
    assert run([*wanted, "--of", "error", "--plot", str(picture), "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["cases"]) == len(pd.read_csv(table)) == 12
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run([*wanted[:-1], "markers,ceiling"]) == 2
    assert "--by" in capsys.readouterr().err


@pytest.mark.parametrize(("probability", "right"), [(0.51, True), (0.49, False)])
def test_what_the_library_lacks_is_told_once_it_is_likelier_than_not(
    monkeypatch, tmp_path, probability, right
):
    verdict = replace(made_up().verdict, outside_probability=probability)
    monkeypatch.setattr(of_any_kind, "diagnose", lambda *_: SimpleNamespace(verdict=verdict))
    asked = METHODS["diagnose"].ask(tmp_path, {"unlisted": 0.2}, Truth(listed=False))
    assert asked["right"] is right
