"""The numbers of the link fit, pointing and commands stand where they were set, and say why."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.dh_fit import constants as of_links
from plumbline.optim.model import command as of_commands
from plumbline.optim.model import near, pathed
from plumbline.optim.pointing import HalfSpace, PointingOptions, Solid, plan_sweep, sweep
from plumbline.optim.pointing import constants as of_pointing
from plumbline.optim.pointing.between import Between
from plumbline.optim.pointing.collision import moving
from plumbline.optim.pointing.constants import SLOTS
from plumbline.optim.pointing.planes import before_planes
from plumbline.optim.pointing.statement import SweepWeights, sweep_statement
from plumbline.optim.pointing.surroundings import surroundings
from plumbline.optim.pointing.task import needle_task
from tests.optim.pointing.test_pointing import ARC, NEEDLE, UR3
from tests.optim.pointing.test_pointing_scene import ASLANT, aimed

LINKS = {
    "DELTA_LENGTH": 0.01, "DELTA_ANGLE": np.radians(5.0), "FRAME_SCALE": 0.01, "TOOL_SCALE": 0.01,
    "WIDE_BOUNDS": 1e3, "MEDIAN": 2.3659738843753377, "COUNT_OF_DIRECTIONS": 2000, "ROUGH": 1e-3,
    "LEAST_DAMPING": 1e-9, "NARROWING": 10.0, "NEAR": 1e-2, "QUICK": 6, "PATIENCE": 3,
    "NEWTON_DAMPING": 1e-6, "FLOOR": 1e-3, "FACTOR": 30.0, "DEPENDENT": 1e-8, "ABSENT": 1e-10,
    "MOST_POSES": 4000, "PARTNER": 1e-6, "SLIGHT": 0.1, "WHOLE": 1e-2, "UNBOUNDED": 1e3,
    "RESTING": 1e-6, "CHANCE": 1e-3, "STATED_WITHIN": 1.1, "ROUNDING": 1e-9, "COARSE": 3.0,
    "LEAST_SOFT": 1e-7, "MOST_SOFT": 1e-2, "MOST_SOFT_ROWS": 600, "FALSE_ALARM": 0.01,
    "SLACK": 1.7, "MOST_SHARE": 0.4, "FEWEST_FREEDOM": 15, "FEWEST_ROWS": 20, "SHAPE_ROUNDS": 30,
    "LEAST_SHAPE": 1e-4, "LEAST_LEFT": 0.1, "COUNT": 4, "FLATTEST": 1e-3, "SPARE_STEPS": 2,
    "MOST_STEPS": 40, "CANDIDATES": 400, "TARGETS": 60, "SWEEPS": 8, "TRIES": 200, "VAGUE": 1e-8,
    "AGREES": 1e-9, "POSTURES": 20,
}  # fmt: skip
POINTING = {
    "LEAST_JOINTS": 5, "ROW": 7, "EQUATIONS": 5, "DAMPING": 1e-9, "RIGHT_ANGLE": np.pi / 2,
    "TURN": 2 * np.pi, "MM": 1e3, "PARALLEL": 1e-9, "ZERO": 1e-16, "ITERATIONS": 60, "STALLED": 5,
    "STARTS": 24, "TRIES": 4, "MAP_ROUNDS": 6, "WHY_STARTS": 16, "LARGEST_RCM_ERROR": 1e-5,
    "LARGEST_TURN": 1e-4, "ANCHORS": 3, "TRACK_STARTS": 48, "MORE_ANCHORS": 2, "ASKED": 8,
    "FEW_STARTS": 12, "MOST_TRACKS": 12, "NEWTON_STEPS": 6, "LONGEST_STEP": 0.5, "HELD": 1e-14,
    "LOOKS": 8, "HELD_WITHIN": 1e-6, "LARGEST": 5.0, "POINT": 1e-3, "LEAST_SIZE": 1e-6,
    "LARGEST_FILE": 200_000_000, "CHUNK": 2_000_000, "LEAST_VOLUME": 1e-12, "SHORTEST": 1e-6,
    "SAMPLES": 64, "ROUNDING": 1e-9, "STILL": 1e-9, "RESOLUTION": 1e-4, "SLOTS": 16, "NEAR": 30e-3,
    "SPARE": 3e-4, "PENALTY": 1e2, "ROUNDS": 4, "PATIENCE": 2, "NEAREST": 3,
}  # fmt: skip
COMMANDS = {
    "FIRST_STEPS": 12, "STEPS": 30, "SETTLED": 1e-11, "FAR_STEPS": 60, "LONGEST": 0.4,
    "PLACE_FIRST": 100.0, "EASED": 10.0, "STARTS": 12, "REACHED": 1e-6, "SLACK": 1e-9,
}  # fmt: skip
NEAR_COMMANDS = {
    "LEVER": 0.1, "DAMPING": 1e-3, "NEAR_STEPS": 12, "PLACED": 1e-9, "STILL": 1e-8, "FARTHEST": 0.1,
}  # fmt: skip
PATHED = {"ROUNDS": 8, "NARROWEST": 1e-6}


@pytest.mark.parametrize(
    ("module", "stand"),
    [
        (pathed, PATHED),
        (of_links, LINKS),
        (of_pointing, POINTING),
        (of_commands, COMMANDS),
        (near, NEAR_COMMANDS),
    ],
)
def test_every_number_stands_where_it_was_set_and_says_why(module, stand):
    lines = Path(module.__file__).read_text().splitlines()
    found = [(k, line) for k, line in enumerate(lines) if re.match(r"[A-Z_]+ = ", line)]
    assert {line.split(" ")[0] for _, line in found} == set(stand)
    for name, value in stand.items():
        assert getattr(module, name) == pytest.approx(value, rel=1e-12), name
    for k, line in found:
        assert "  # " in line or lines[k - 1].startswith("# "), f"{line}: no unit, no source"


@pytest.mark.parametrize(("away", "asked"), [(2 / 3, True), (4 / 3, False)])
def test_a_pair_gets_a_row_below_thirty_millimetres_of_spare_clearance(away, asked):
    """A table so far below the arm that the spare clearance is two or four thirds of them."""
    q, limit = np.array([[0.0, -1.2, 1.0, -1.0, -1.5, 0.0]]), PointingOptions().least_clearance

    def below(height):
        """The aim, its pairs, and the arm's least clearance from the table [m]."""
        aim = aimed(room=(Solid("table", HalfSpace((0.0, 0.0, height))),), body=None)
        around, segments = surroundings(aim, limit), moving(UR3, NEEDLE, q)[0]
        arm = [p for p, own in zip(around.pairs, around.of_arm, strict=True) if own]
        tables = [p for p in arm if p.second == "table"]
        return aim, around, tables, min(around.distance(segments, p) for p in tables)

    deep = below(-5.0)[-1]
    aim, around, tables, least = below(-5.0 + deep - limit - away * 30e-3)
    assert least - limit == pytest.approx(away * 30e-3, abs=1e-6)
    ways = Between(np.full((1, len(around.pairs)), np.inf), np.zeros((1, len(around.pairs))))
    planes = before_planes(aim, around, needle_task(UR3, NEEDLE.axis), q, ways, 0.0)
    assert bool(planes.pairs & {pair.name for pair in tables}) is asked


def test_rows_ask_for_three_tenths_of_a_millimetre_more_and_double_that(monkeypatch):
    asked = []

    def listen(*given):
        asked.append(given[-1])
        return before_planes(*given)

    monkeypatch.setattr(sweep, "before_planes", listen)
    wall = Solid("wall", HalfSpace((0.0, 0.0, 0.35)))
    plan_sweep(aimed(needle=ASLANT, room=[wall]), ARC[0], ARC[1][::6])
    assert asked
    np.testing.assert_allclose(asked, 3e-4 * 2.0 ** np.arange(len(asked)))


def test_a_metre_of_slack_costs_a_hundred():
    statement = sweep_statement(needle_task(UR3, NEEDLE.axis), 3, SweepWeights(), keeps_off=True)
    data = np.random.default_rng(0).normal(size=statement.width * 3)
    problem = replace(statement.problem, data=data)
    x = np.concatenate([np.full(18, 0.3), np.zeros(3 * SLOTS)])
    slope = Mapped(problem).objective(x)[1]
    np.testing.assert_allclose(slope[18:], 1e2)
