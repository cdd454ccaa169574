"""Commands of joints that remember their path: every posture of it is met, turns and all."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.model import Model
from plumbline.optim.model import command as commands
from tests.optim.model.test_commands import arm as bare

__all__ = ["bare"]
SOME = np.array([0.3, 0.4, 0.5, 0.6, 0.45, 0.7])  # [rad/s]


def path(rows=1500):
    t = np.linspace(0.0, 30.0, rows)[:, None]
    return np.sin(t * SOME + [0, 1, 2, 3, 0.5, 5]) * 0.8 + [0, -1, 1, 0, 1.2, 0]


def lagging(bare, *plays):
    """Plays ``(joint, width, how far it moves the link)`` on an arm that yields, zeros off."""
    lag, soft, offset = (REGISTRY[n] for n in ("hysteresis", "joint_compliance", "joint_offset"))
    effects = [lag(joint=j, width=width) for j, width, _ in plays]
    values = np.array([*(size for *_, size in plays), 1e-5, 2e-3])
    effects += [soft(joint=2), offset(joint=4)]
    covariance = np.zeros((len(values), len(values)))
    return replace(bare, effects=tuple(effects), values=values, covariance=covariance)


@pytest.mark.parametrize("size", [0.3e-3, 0.9e-3, 1e-3])
def test_a_path_is_met_at_its_turns_too(bare, size):
    """A link that lags by less than its play is wide, and by all of it."""
    arm, q = lagging(bare, (2, 1e-3, size)), path()
    command = arm.joint_command(q)
    assert command.missed.max() <= 2e-9
    np.testing.assert_allclose(arm.tip(command.q), bare.tip(q), atol=2e-9)
    back = np.abs(np.diff(command.q - q, axis=0))[:, 1].max()
    assert (back > 0.99 * size) == (size == 1e-3)  # all of the play is gone through at once


def test_plays_of_several_joints_are_met_without_the_careful_way(bare, monkeypatch):
    arm = lagging(bare, (1, 5e-4, 5e-4), (2, 1e-3, 1e-3), (3, 2e-3, 1.2e-3))
    monkeypatch.setattr(commands, "_walk", None)
    assert arm.joint_command(path()).missed.max() <= 2e-9


def test_a_joint_that_rests_while_others_move_arrives(bare):
    """What the others' loads do to it turns it back and forth by less than its play."""
    arm, q = lagging(bare, (2, 1e-3, 1e-3)), path(60)
    q[20:40, 1] = q[19, 1]
    assert arm.joint_command(q).reached.all()


def test_play_that_began_nobody_knows_where_is_stored(bare, tmp_path):
    arm, q = lagging(bare, (2, 1e-3, 1e-3)), path(60)
    arm.save(tmp_path / "arm.toml")
    again = Model.load(tmp_path / "arm.toml")
    assert again.effects == arm.effects
    np.testing.assert_array_equal(again.tip(q), arm.tip(q))
