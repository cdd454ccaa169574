"""Commands near to where joints are wanted: exact, few evaluations each, never far for little."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.model import near as near_commands
from plumbline.optim.model.near import near
from tests.optim.model.test_commands import arm as bare

__all__ = ["bare"]
COUNT = 600


@pytest.fixture(scope="module")
def arm(bare):
    """An arm that is some millimetres off, with ripples of high orders."""
    names = ("joint_offset", "link_geometry", "joint_compliance", "gear_ripple")
    offset, link, soft, gear = (REGISTRY[name] for name in names)
    effects = (
        *(offset(joint=j) for j in range(1, 7)),
        *(link(link=i) for i in (4, 5)),
        *(soft(joint=j) for j in (2, 3)),
        *(gear(joint=j, order=float(n)) for j in (1, 2, 3) for n in (47, 88, 128)),
    )
    sizes = np.concatenate([np.full(12, 2e-3), np.full(2, 1e-5), np.full(18, 1e-5)])
    values = sizes * np.random.default_rng(2).normal(size=len(sizes))
    return replace(bare, effects=effects, values=values, covariance=np.zeros((32, 32)))


@pytest.fixture(scope="module")
def wanted():
    return np.random.default_rng(3).uniform(-1.5, 1.5, (COUNT, 6)) + 1.6 * np.eye(6)[4]


def test_a_tip_comes_to_a_nanometre_and_the_tool_to_its_orientation(arm, wanted):
    found = arm.joint_command(wanted)
    T, goal = arm.placement(found.q), arm.nominal.placement(wanted)
    assert np.linalg.norm(arm.tip(wanted) - goal[:, :3, 3], axis=1).min() > 1e-4
    away = np.linalg.norm(T[:, :3, 3] - goal[:, :3, 3], axis=1)
    assert away.max() <= 1e-9
    np.testing.assert_allclose(found.missed, away, atol=1e-14)
    assert np.median(np.abs(T - goal)[:, :3, :3].max(axis=(1, 2))) < 1e-9


def test_a_posture_takes_five_evaluations_at_the_most(arm, wanted, monkeypatch):
    asked, over_rows = [], near_commands.over_rows

    def listen(function, rows):
        asked.append(len(rows) if function.name() == "away" else 0)
        return over_rows(function, rows)

    monkeypatch.setattr(near_commands, "over_rows", listen)
    rest = near(arm, wanted, arm.nominal.placement(wanted), {}, placed=True)[2]
    assert len(rest) < 0.2 * COUNT
    assert sum(asked) < 4.8 * COUNT


def test_next_to_a_singular_posture_no_joint_goes_far_for_little(arm, wanted):
    straight = wanted.copy()
    straight[:, 4] = np.linspace(1e-5, 3e-2, COUNT)
    found = arm.joint_command(straight)
    assert found.reached.all()
    assert np.abs(found.q - straight).max() < 0.25
    q, _, rest = near(arm, straight, arm.nominal.placement(straight), {}, placed=True)
    done = np.setdiff1d(np.arange(COUNT), rest)
    assert len(rest) > 60
    assert np.abs(q - straight)[done].max(initial=0.0) <= 0.1


@pytest.mark.parametrize("axis", range(3))
def test_a_tool_half_a_turn_away_is_not_there(bare, wanted, axis):
    goal = bare.placement(wanted)
    goal[:, :3, :3] = np.diag(np.where(np.arange(3) == axis, 1.0, -1.0)) @ goal[:, :3, :3]
    _, miss, rest = near(bare, wanted, goal, {}, placed=True)
    assert len(rest) == COUNT
    assert np.isinf(miss[:, 3:]).any(axis=1).all()
    assert len(near(bare, wanted, goal, {}, placed=False)[2]) == 0


def test_a_joint_that_would_leave_its_range_is_left_to_others(arm, wanted):
    at_the_end = np.tile(arm.chain.upper - 1e-4, (4, 1))
    to = at_the_end + np.array([1e-5, -1e-5, 0.0, -2e-3])[:, None]
    q, _, rest = near(arm, at_the_end, arm.placement(to), {}, placed=True)
    done = np.setdiff1d(np.arange(4), rest)
    assert (q[done] <= arm.chain.upper).all()
