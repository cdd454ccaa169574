"""Laws of unusual arms and clocks: slides, arms in a plane, seconds since 1970."""

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.building import build_recording
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import causes

NOISE = 1e-4
SLIDE = (
    {"d": 0.4, "a": 0.1, "alpha": np.pi / 2},
    {"a": 0.3, "alpha": np.pi / 2},
    {"d": 0.2, "kind": "prismatic"},
)


def read(rows, q, joints=None, moved=0.0, **given):
    """Tips of an arm of these DH rows whose joints stand elsewhere, or its readings as given."""
    robot = Robot.from_dh(list(rows))
    y = robot.chain().tips(q if joints is None else joints, (0.0, 0.03, 0.0)) + moved
    y += np.random.default_rng(1).normal(0.0, NOISE, y.shape)
    return build_recording(
        observation="tip_position", robot=robot, q=q, measured=y,
        tool_offset=(0.0, 0.03, 0.0), noise_std=NOISE, **given,
    )  # fmt: skip


def sliding():
    """60 postures of the arm with a slide, and the sides that they were approached from."""
    rng = np.random.default_rng(2)
    q = np.column_stack([rng.uniform(-1.5, 1.5, (60, 2)), rng.uniform(0.1, 0.5, 60)])
    return q, rng.choice([-1.0, 1.0], (60, 3))


def test_what_a_slide_does_wrong_is_told_in_metres():
    q, side = sliding()
    found = diagnose(read(SLIDE, q, q - [0.0, 0.0, 0.5e-3] * side, direction=side))
    [cause] = found.verdict.causes
    assert (cause.effect, cause.element) == ("backlash", 3)
    assert cause.parameters["play"].unit == "m"
    assert cause.parameters["play"].value == pytest.approx(1e-3, rel=0.1)


def test_what_the_encoder_of_a_slide_misses_is_told_in_metres():
    q, side = sliding()
    link = np.full_like(q, np.nan)
    link[:, 2] = q[:, 2] - 0.5e-3 * side[:, 2]
    link[:, 2] += np.random.default_rng(1).normal(0.0, NOISE, 60)
    verdict = diagnose(
        build_recording(
            observation="joint_position",
            robot=Robot.from_dh(list(SLIDE)),
            q=q,
            measured=link,
            noise_std=NOISE,
            direction=side,
        )
    ).verdict
    assert verdict.gap.unit == "m"
    assert [(c.effect, c.element) for c in verdict.causes] == [("backlash", 3)]


def test_joints_that_turn_keep_their_units():
    chain = Robot.from_dh(list(SLIDE)).chain()
    for name in ("joint_offset", "backlash", "joint_compliance"):
        turns, slides = (REGISTRY[name](joint=j) for j in (1, 3))
        for p in turns.parameters:
            assert turns.unit_of(p, chain) == p.unit
            assert slides.unit_of(p, chain).replace("m/N", "m").startswith("m")


def test_an_arm_in_one_plane_is_diagnosed_in_that_plane():
    """A camera in the plane would see nothing; the depth is 0 in every row."""
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (60, 3))
    rows = [{"a": length} for length in (0.4, 0.3, 0.2)]
    recording = read(rows, q, q * [1.0, 1.003, 1.0])
    flat = recording.measured * [1.0, 1.0, 0.0]
    flat = build_recording(
        observation="tip_position", robot=recording.robot, q=q, measured=flat,
        tool_offset=(0.0, 0.03, 0.0), noise_std=NOISE,
    )  # fmt: skip
    assert causes(diagnose(flat))[:1] == [("joint_scale", 2)]


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_every_bump_keeps_its_estimates_whatever_the_clock_starts_from(start):
    robot, time = Robot.bundled("ur5"), 10.0 * np.arange(120.0)
    q = np.random.default_rng(7).uniform(-1.5, 1.5, (120, 6))
    moved = (time > 395.0)[:, None] * [6e-4, 0.0, 0.0] + (time > 805.0)[:, None] * [0, -7e-4, 0]
    y = robot.chain().tips(q, (0.0, 0.02, 0.1)) + moved
    y += np.random.default_rng(1).normal(0.0, NOISE, y.shape)
    found = diagnose(
        build_recording(
            observation="tip_position",
            robot=robot,
            q=q,
            measured=y,
            noise_std=NOISE,
            tool_offset=(0.0, 0.02, 0.1),
            time=time + start,
        ),
        FEW_EFFECTS,
    )
    [cause] = found.verdict.causes
    assert cause.effect == "base_bump"
    assert len(cause.parameters) == sum(len(e.parameters) for e in found.effects)
    assert len({e.moment for e in found.effects}) == 2
