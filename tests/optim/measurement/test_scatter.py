"""Laws of joints that do not stand where they read: noise along what each joint moves."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as cs
import numpy as np
import pytest

from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.correlation import (
    RowNoise,
    correlation_of,
    left_by_nothing,
)
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import LEAST_SPREAD
from plumbline.optim.diagnosis.verdict.explanation import _correlation
from plumbline.optim.measurement.observation import build_model, rotation_lever
from plumbline.optim.measurement.refit import before_whitening, in_noise, scattered
from plumbline.optim.measurement.uneven import may_scatter, swings, wider
from plumbline.optim.recording.building import build_recording
from tests.benches import bench
from tests.few_effects import FEW_EFFECTS

SIGMA = 5e-5
KINDS = ("tip_position", "pose", "fixed_point")


def loose(off, seed=0, rows=120, stated=SIGMA):
    """A UR10 whose joints each stand elsewhere than they read, by so much (6,) [rad]."""
    rng = np.random.default_rng(seed)
    q = np.array([0.0, -1.2, 1.3, -1.4, -1.57, 0.4]) + rng.uniform(-1.0, 1.0, (rows, 6))
    tool = np.array([0.02, -0.03, 0.15])
    stands = q + np.array(off) * rng.normal(size=q.shape)
    tip = Robot.bundled("ur10").chain().tips(stands, tool) + SIGMA * rng.normal(size=(rows, 3))
    given = {"observation": "tip_position", "robot": "ur10", "tool_offset": tool}
    return build_recording(q=q, measured=tip, noise_std=stated, **given)


@pytest.mark.parametrize("observation", KINDS)
def test_what_a_joint_that_scatters_moves_is_what_its_zero_moves(observation):
    recording = bench("ur5", observation)
    model = build_model(recording)
    found = swings(recording, rotation_lever(recording))
    ports = Ports.about(model, model.start, np.arange(len(recording)))
    size = np.abs(ports.joint).max()
    np.testing.assert_allclose(found, ports.joint, atol=0.02 * size)  # the bench's arm has a gap


def test_what_a_joint_moves_is_the_derivative_to_nine_digits():
    recording = bench("ur5", "fixed_point")
    chain, q = recording.chain, cs.SX.sym("q", 6)
    T = chain.forward(q)
    J = cs.Function("J", [q], [cs.jacobian(T.R @ recording.tool_offset + T.t, q)])
    exact = np.array([J(row).full().T for row in recording.q])
    np.testing.assert_allclose(swings(recording, 1.0), np.swapaxes(exact, 0, 1), atol=1e-9)


@pytest.mark.parametrize("observation", KINDS)
def test_of_joints_that_scatter_all_is_whitened_alike(observation):
    """The residual of the model, and what moves it; and back."""
    recording = bench("ur5", observation)
    uneven = replace(recording, scatter=np.array([0.0, 3.0, 1.0, 0.0, 2.0, 0.0]))
    r, white = (Mapped(build_model(x).problem) for x in (recording, uneven))
    start = build_model(recording).start
    left, seen = r.residuals(start), white.residuals(start)
    np.testing.assert_allclose(in_noise(uneven, left), seen, atol=1e-12)
    np.testing.assert_allclose(before_whitening(uneven, seen), left, atol=1e-12)
    S = wider(uneven, rotation_lever(uneven))
    drawn = np.mean(np.trace(S, axis1=1, axis2=2)) / S.shape[1]
    assert scattered(uneven) == pytest.approx(np.sqrt(drawn))
    assert scattered(recording) == 1.0


def test_of_several_recordings_markers_and_ranges_no_joint_is_asked():
    assert all(may_scatter(bench("ur5", observation)) for observation in KINDS)
    assert not may_scatter(bench("ur5", "joint_position"))  # each has a noise of its own there


@pytest.mark.parametrize("off", [(0, 2e-4, 0, 0, 0, 0), (1e-4,) * 6, (0, 2e-4, 2e-4, 0, 3e-4, 0)])
def test_what_joints_scatter_by_is_found_joint_by_joint(off):
    recording = loose(off, rows=400)
    moved = swings(recording, 1.0)
    rng = np.random.default_rng(1)
    left = SIGMA * rng.normal(size=moved.shape[1:])
    left += np.einsum("jnm,nj->nm", moved, np.array(off) * rng.normal(size=(400, 6)))
    found, odds = correlation_of(left, recording, NoisePrior.of(SIGMA), moved=moved)
    assert odds > 20.0
    np.testing.assert_allclose(SIGMA * np.array(found.scatter), off, rtol=0.25)
    again = replace(recording, scatter=np.array(found.scatter))
    same, more = correlation_of(left, again, NoisePrior.of(SIGMA), moved=moved)
    np.testing.assert_allclose(same.scatter, found.scatter)
    assert more == 0.0


@pytest.mark.parametrize(("lever", "asked"), [(0.03, False), (0.08, True)])
def test_a_joint_that_moves_the_tip_by_a_twentieth_of_the_most_is_asked(lever, asked):
    """Else one whose axis goes through the tip scatters by radians."""
    recording, rng = loose((0.0,) * 6), np.random.default_rng(3)
    moved = np.zeros((6, 120, 3))
    moved[0, :, 0], moved[1, :, 1] = 1.0, lever
    left = rng.normal(size=(120, 3)) * np.array([1.0, 5.0, 1.0])
    found, _ = correlation_of(left, recording, NoisePrior(), moved=moved)
    assert bool(found.scatter and found.scatter[1] and not found.scatter[0]) is asked


@pytest.mark.parametrize(("axis", "taken"), [(1.0, True), (4.0, False)])
def test_joints_scatter_instead_of_an_axis_that_is_noisier(axis, taken):
    """Which of the two, the rows tell; both at once nobody asks for."""
    recording, rng = loose((0.0,) * 6, rows=300), np.random.default_rng(4)
    moved = swings(recording, 1.0)
    off = 3e-4 if taken else 0.0
    left = SIGMA * rng.normal(size=(300, 3)) * np.array([1.0, 1.0, axis])
    left += np.einsum("jnm,nj->nm", moved[1:3], off * rng.normal(size=(300, 2)))
    spread = np.sqrt(np.mean(left**2, axis=0) / np.mean(left**2))
    found, _ = correlation_of(
        left / spread, recording, NoisePrior.of(SIGMA), moved=moved, spread=spread
    )
    assert bool(found.scatter) is taken


@pytest.mark.parametrize("stated", [None, 1.0])
def test_a_device_has_noise_of_its_own_however_much_joints_scatter(stated):
    """At the least what is stated, or a twentieth: rows in a plane are no joints that scatter."""
    recording, rng = loose((0.0,) * 6, rows=60), np.random.default_rng(5)
    moved = swings(recording, 1.0) * np.array([1.0, 1.0, 0.0])
    left = rng.normal(size=(60, 3)) * np.array([1.0, 1.0, 0.0])
    spread = np.sqrt(np.maximum(np.mean(left**2, axis=0) / np.mean(left**2), LEAST_SPREAD))
    given = {"moved": moved, "spread": spread}
    assert correlation_of(left / spread, recording, NoisePrior.of(stated), **given)[0] == RowNoise()


def test_of_joints_that_stand_where_they_read_nothing_is_asked():
    recording, rng = loose((0.0,) * 6), np.random.default_rng(2)
    moved = swings(recording, 1.0)
    drawn = [rng.normal(size=moved.shape[1:]) for _ in range(40)]
    none = [correlation_of(r, recording, NoisePrior(), moved=moved)[0] for r in drawn]
    assert none.count(RowNoise()) >= 39


@pytest.mark.parametrize(("off", "seed"), [((0, 2e-4, 0, 0, 0, 0), 3), ((1e-4,) * 6, 0)])
def test_joints_that_scatter_are_no_mechanism_and_their_size_is_told(off, seed):
    """They had been a gear's ripple at 0.70, or an unlisted one of the joint's own angle."""
    found = diagnose(loose(off, seed, stated=None), FEW_EFFECTS)
    assert found.verdict.verdict == Outcome.NO_GAP
    assert found.verdict.outside_probability < 0.1
    sigma = found.verdict.noise.sigma / scattered(found.recording)
    assert sigma == pytest.approx(SIGMA, rel=0.15)
    np.testing.assert_allclose(sigma * found.recording.scatter, off, atol=4e-5)
    (said,) = [note for note in found.verdict.notes if "elsewhere than it reads" in note]
    assert ("each joint" in said) == all(off)


@pytest.mark.parametrize("many", [False, True])
def test_where_many_causes_are_at_work_no_joint_is_asked(many):
    """What many causes leave is of more still: the UR5's grid and panda-3 had lost some to it."""
    recording = loose((0, 2e-4, 0, 0, 0, 0))
    model = build_model(recording)
    pool = SimpleNamespace(model=model, noise=NoisePrior.of(SIGMA))
    left = Mapped(model.problem).residuals(model.start)
    alt = SimpleNamespace(
        problem=SimpleNamespace(variance=lambda terms: SIGMA**2),
        rows=np.arange(len(recording)),
        left=lambda terms, variance: left_by_nothing(left),
        spread=np.ones(3),
    )
    found = _correlation(SimpleNamespace(pool=pool), alt, [], many=many)
    assert bool(found.scatter) is not many


def test_what_joints_scatter_by_is_no_noise_that_is_stated():
    """It is beyond the device's, and no mechanism of the library: which joint, a note says."""
    verdict = diagnose(loose((0, 6e-4, 0, 0, 0, 0), rows=60), FEW_EFFECTS).verdict
    assert verdict.verdict == Outcome.OUTSIDE
    assert verdict.gap.noise_floor == pytest.approx(np.sqrt(3.0) * SIGMA)
    assert any("joint 2 by 0.6" in note for note in verdict.notes)
