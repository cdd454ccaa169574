"""The numbers of the link fit, pointing and commands stand where they were set, and say why."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.pointing import HalfSpace, PointingOptions, Solid, plan_sweep, sweep
from plumbline.optim.pointing.between import Between, before_planes
from plumbline.optim.pointing.constants import SLOTS
from plumbline.optim.pointing.statement import SweepWeights, sweep_statement
from plumbline.optim.pointing.surroundings import surroundings
from plumbline.optim.pointing.task import moving, needle_task
from tests.optim.pointing.test_pointing import ARC, NEEDLE, UR3
from tests.optim.pointing.test_pointing_scene import ASLANT, aimed


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
