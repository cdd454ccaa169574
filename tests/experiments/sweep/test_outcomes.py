"""Laws of what is said of cases: refused ones apart, units, figures that are not there."""

from types import SimpleNamespace

import pytest

from plumbline import PlumblineError
from plumbline.experiments.commands.sweep import Tables
from plumbline.experiments.sweep.outcome import Outcome, Sweep


def case(number):
    return SimpleNamespace(to_dict=lambda: {"seed": number, "rows": 30})


def swept(*found, refused=0):
    told = [Outcome(case(k), one) for k, one in enumerate(found)]
    out = [Outcome.refusal(case(-k), "too few rows") for k in range(refused)]
    return Sweep("made up", "", tuple(told + out))


def test_cases_that_were_refused_found_nothing_wrong_in_no_robot():
    quiet, loud = {"verdict": "no-gap"}, {"verdict": "explained", "cause": "backlash of joint 2"}
    found = swept(quiet, loud, loud, refused=4)
    assert (
        found.agreement
        == "explained in 2 of 3; first backlash of joint 2 in 2 of 3; 4 of 7 refused"
    )
    assert swept({"error": 1e-3}).agreement == "1 case"
    assert swept({"error": 1e-3}, refused=1).agreement == "1 case; 1 of 2 refused"


@pytest.mark.parametrize(
    ("figure", "also", "unit"),
    [
        ("error", {}, "m"),
        ("step_p99", {}, "s"),
        ("before", {"unit": "rad"}, "rad"),
        ("before", {}, "m"),
        ("probability", {}, ""),
    ],
)
def test_a_figure_is_told_in_its_unit(figure, also, unit):
    table = swept({figure: 0.5, **also}, refused=1).table("seed", "rows", figure)
    assert table.unit == unit
    assert table.of.startswith(f"{figure} [{unit}] by" if unit else f"{figure} by")


def test_a_gap_in_two_units_has_none():
    one, other = ({"before": 0.5, "unit": unit} for unit in ("m", "rad"))
    assert swept(one, other).table("seed", "rows", "before").unit == ""


def test_a_figure_that_is_not_there_is_refused_with_the_first_case_and_not_with_the_last():
    first = swept({"error": 1e-3, "expected": None})
    with pytest.raises(PlumblineError, match=r"found 'erorr'.*best matches: error"):
        Tables(None, None, "erorr").stand(lambda: first)
    Tables(None, None, "expected").stand(lambda: first)  # the first has none, others may
    asked = Tables(None, None, "erorr")
    asked.stand(lambda: swept(refused=1))  # nothing is known yet
    with pytest.raises(PlumblineError):
        asked.stand(lambda: first)
