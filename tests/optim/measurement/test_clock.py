"""Laws of rows whose clock is uncertain: they err along their way, by so much times their speed."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.posterior.correlation import RowNoise, correlation_of
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import JITTERS
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.refit import smear
from plumbline.optim.measurement.uneven import along, may_jitter, rates, whitened, widened
from plumbline.optim.recording.building import build_recording
from tests.benches import bench, residuals
from tests.few_effects import FEW_EFFECTS
from tests.scanned import scanned_as_modelled

SIGMA, TAU = 1e-4, 1e-3
KINDS = ("tip_position", "pose", "joint_position")


def on_its_way(seed=0, rows=160, jitter=TAU, observation="tip_position", step=0.1):
    """A UR5 that goes its way, read by a clock that is off by so much."""
    rng = np.random.default_rng(seed)
    t = step * np.arange(rows)
    size, order, phase = (rng.uniform(low, 1.0, (2, 6)) for low in (0.5, 0.05, 0.0))

    def places(at):
        turn = np.multiply.outer(at, 1.5 * order) + 6.3 * phase
        return np.array([0.0, -1.2, 1.4, 0.0, 0.9, 0.0]) + 0.4 * np.sum(size * np.sin(turn), axis=1)

    late = places(t + jitter * rng.normal(size=rows))
    given = {"observation": observation, "robot": "ur5", "time": t, "noise_std": SIGMA}
    q = places(t)
    if observation == "joint_position":
        return build_recording(q=q, measured=late + SIGMA * rng.normal(size=q.shape), **given)
    tool, T = np.array([0.0, 0.05, 0.1]), Robot.bundled("ur5").chain().placement(late)
    tip = T[:, :3, 3] + T[:, :3, :3] @ tool
    noisy = tip + SIGMA * rng.normal(size=tip.shape)
    return build_recording(q=q, measured=noisy, tool_offset=tool, **given)


def test_what_is_wider_along_some_ways_is_white_again():
    moved = np.random.default_rng(0).normal(size=(2, 5, 3))
    S = along(moved)
    for row, a, b in zip(S, *moved, strict=True):
        np.testing.assert_allclose(row, np.eye(3) + np.outer(a, a) + np.outer(b, b))
        root = whitened(np.eye(3)[:, None], row[None])[:, 0]
        np.testing.assert_allclose(root @ row @ root, np.eye(3), atol=1e-12)
    values = np.random.default_rng(1).normal(size=(4, 5, 3))
    np.testing.assert_allclose(widened(whitened(values, S), S), values)


@pytest.mark.parametrize("observation", KINDS)
def test_rates_are_those_of_the_residuals_along_the_way(observation):
    """As differences of what the chain foretells, by the rows before and behind, of one group."""
    recording = replace(bench("sweeping", observation), group=np.arange(60) // 30)
    if observation != "joint_position":
        model = build_model(recording)
        r = Mapped(model.problem).residuals(model.start)[:, :3]
        recording = replace(recording, measured=np.hstack([
            recording.measured[:, :3] + r, recording.measured[:, 3:]]))  # fmt: skip
    v = rates(recording, 0.3)
    assert v.shape == residuals(recording).shape
    step = recording.measured[12, :3] - recording.measured[10, :3]
    np.testing.assert_allclose(v[11, :3], step / np.ptp(recording.time[10:13]))
    edge = recording.measured[29, :3] - recording.measured[28, :3]
    np.testing.assert_allclose(v[29, :3], edge / np.ptp(recording.time[28:30]))
    edge = recording.measured[31, :3] - recording.measured[30, :3]
    np.testing.assert_allclose(v[30, :3], edge / np.ptp(recording.time[30:32]))
    part = recording.select(np.arange(0, 60, 7))
    np.testing.assert_allclose(rates(part, 0.3), v[::7])


@pytest.mark.parametrize("wide", [{"jitter": 3.0}, {"scatter": np.linspace(0.0, 5.0, 6)}])
@pytest.mark.parametrize("name", ["respiration", "base_bump", "gear_ripple"])
def test_what_is_scanned_is_whitened_as_the_model_is(name, wide):
    recording = replace(bench("sweeping", "tip_position", columns=("time",)), **wide)
    scanned_as_modelled(name, recording)


def test_the_uncertainty_that_was_drawn_is_found_and_white_noise_is_asked_for_none():
    recording = on_its_way()
    v, rng = rates(recording, 0.3), np.random.default_rng(1)
    for ratio in (1.0, 8.0):
        size = ratio / np.sqrt(np.mean(v**2))
        left = rng.normal(size=v.shape) + size * v * rng.normal(size=(len(v), 1))
        found, odds = correlation_of(left, recording, NoisePrior.of(1.0), v)
        assert found == RowNoise(jitter=found.jitter)
        assert found.jitter == pytest.approx(size, rel=0.25)
        assert odds > 5.0
    drawn = [rng.normal(size=v.shape) for _ in range(40)]
    none = [correlation_of(left, recording, NoisePrior(), v)[0] == RowNoise() for left in drawn]
    assert sum(none) >= 39


def test_steps_of_what_is_tried_tell_a_variance_to_a_fifth_from_a_tenth_of_the_noise_on():
    """From -6 to 20 quarters of an octave: a clock that adds less than a tenth is no matter."""
    assert JITTERS[0] ** 2 == pytest.approx(1.0 / 8.0)
    assert JITTERS[-1] == pytest.approx(32.0)
    np.testing.assert_allclose(np.divide(JITTERS[1:], JITTERS[:-1]), 2.0**0.25)


@pytest.mark.parametrize(("radians", "told"), [(0.88, True), (0.97, False)])
def test_rows_tell_a_speed_up_to_a_seventh_of_a_sine_from_one_to_the_next(radians, told):
    q = np.sin(radians * np.arange(60.0)[:, None] + np.arange(6.0))
    recording = replace(bench("ur5", "tip_position"), q=q)
    assert may_jitter(recording) is told
    assert may_jitter(replace(recording, time=None)) is told  # rows count where no clock does
    assert not may_jitter(bench("ur5", "tip_position"))  # which stops anywhere


@pytest.mark.parametrize("observation", ["tip_position", "joint_position"])
def test_a_clock_that_jitters_is_noise_and_its_size_is_told(observation):
    recording = on_its_way(observation=observation)
    found = diagnose(recording, replace(FEW_EFFECTS, force=True))
    assert found.verdict.verdict == Outcome.NO_GAP
    assert found.recording.jitter * found.verdict.noise.sigma == pytest.approx(TAU, rel=0.25)
    assert any("grows with the speed" in note for note in found.verdict.notes)
    # The figures are as measured, of a noise that is more than the device's alone.
    gap = found.verdict.gap
    assert gap.noise_floor == pytest.approx(gap.after, rel=0.15)
    assert gap.noise_floor > 1.3 * SIGMA * (1.0 if observation == "joint_position" else 3.0**0.5)
    assert smear(recording, 3) == 1.0


def test_of_rows_without_a_time_the_same_is_told_in_rows():
    timed = on_its_way(step=0.125)
    bare = replace(timed, time=None)
    np.testing.assert_allclose(rates(bare, 0.3), rates(timed, 0.3) * 0.125)
    found = diagnose(bare, replace(FEW_EFFECTS, force=True))
    assert found.verdict.verdict == Outcome.NO_GAP
    off = found.recording.jitter * found.verdict.noise.sigma
    assert off == pytest.approx(TAU / 0.125, rel=0.25)
    assert any(f"by {off:.2g} of a row" in note for note in found.verdict.notes)


def test_of_a_clock_that_is_right_nothing_is_said():
    found = diagnose(on_its_way(jitter=0.0), replace(FEW_EFFECTS, force=True))
    assert found.recording.jitter == 0.0
    assert found.verdict.verdict == Outcome.NO_GAP
