"""Whatever a recording lacks, it is diagnosed in numbers or refused in one line."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects.payload import Payload
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.linearise.linear import cholesky
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.building import build_recording
from tests.benches import bench, every_column, readings
from tests.degenerate_recordings import degenerate, no_numbers
from tests.few_effects import FEW_EFFECTS
from tests.random_trees import Tree

SMALL = Robot.from_urdf(Tree(3, ("revolute",) * 3).urdf())
OF_MANY_CAUSES = 1010  # of all effects its chains take as long as all others
FEW = (1003, 1004, 1005, 1006, 1007, 1008, OF_MANY_CAUSES, 1011, 1012)


def missing(verdict):
    """Where a verdict has no number though one belongs there; rivals have no figures of a fit."""
    content = asdict(verdict)
    for rival in content["candidates"]:
        rival["before"] = rival["after"] = 0.0
    return list(no_numbers(content))


def diagnosed(recording, options=None):
    verdict = diagnose(recording, replace(options or DiagnosisOptions(), force=True)).verdict
    assert missing(verdict) == []
    return verdict


@pytest.mark.parametrize("seed", FEW)
def test_a_degenerate_recording_is_diagnosed_or_refused(seed):
    try:
        diagnosed(degenerate(seed), FEW_EFFECTS if seed == OF_MANY_CAUSES else None)
    except PlumblineError as error:
        refusal = str(error)
    else:
        refusal = ""
    assert "\n" not in refusal


@pytest.mark.parametrize("noise", [None, 1e-4])
def test_encoders_of_which_none_is_named_may_have_rows_kept_back(noise):
    held_out = np.arange(40) % 4 == 0
    q = readings(SMALL.chain(), 40)
    recording = bench(SMALL, "joint_position", q=q, columns=(), held_out=held_out, noise_std=noise)
    assert diagnosed(recording).causes == ()


def test_a_tiny_noise_of_few_rows_is_no_error():
    q = readings(SMALL.chain(), 5)
    recording = bench(SMALL, "tip_position", q=q, columns=("payload",), noise_std=1e-15)
    off = np.random.default_rng(0).normal(0.0, 0.01, recording.measured.shape)
    diagnosed(
        replace(recording, measured=recording.measured + off), DiagnosisOptions(library=(Payload,))
    )


def test_a_part_of_a_cause_that_is_not_there_bounds_nothing():
    """Viscous friction alone: what dry friction or creeping would add rests at none."""
    time = np.arange(200) * 0.05
    phase = np.outer(time, [0.7, 1.1, 0.9]) + np.arange(3.0)
    q, rate = 0.8 * np.sin(phase), 0.8 * np.array([0.7, 1.1, 0.9]) * np.cos(phase)
    rng = np.random.default_rng(1)
    bare = bench(SMALL, "joint_position", q=q, columns=(), velocity=rate, time=time, noise_std=1e-4)
    read = q + rng.normal(0.0, 1e-4, q.shape)
    read[:, 1] -= 1e-3 * rate[:, 1]
    verdict = diagnosed(replace(bare, measured=read))
    friction = next(c for c in verdict.causes if c.effect == "friction")
    assert min(friction.parameters["dry"].value, friction.parameters["slow"].value) == 0.0
    assert not any(e.at_bound for e in friction.parameters.values())
    assert verdict.verdict == Outcome.EXPLAINED


@pytest.mark.parametrize("effect", ["backlash", "latency", "friction"])
def test_an_effect_that_no_row_shows_may_always_be_fitted(effect):
    still = {k: np.zeros_like(v) for k, v in every_column(3, 30).items()}
    still["time"] = np.linspace(0.0, 90.0, 30)
    q = readings(SMALL.chain(), 30)
    recording = bench(SMALL, "joint_position", q=q, columns=(), **still, always=(effect,))
    verdict = diagnosed(recording)
    assert all(np.isfinite(c.probability) for c in verdict.candidates)


def test_more_unknowns_than_readings_are_refused_by_the_effect_that_takes_them():
    q = readings(SMALL.chain(), 20)
    always = ("frame", "tool", "gear_ripple")
    recording = bench(SMALL, "tip_position", q=q, columns=(), always=always)
    with pytest.raises(PlumblineError, match=r"of them for gear_ripple, and the rows .* hold 60"):
        diagnose(recording)


def test_sockets_that_start_at_one_place_have_a_derivative():
    """Their distance is stated; where they are, nothing tells yet."""
    q = np.repeat(readings(SMALL.chain(), 10), 2, axis=0)
    recording = bench(SMALL, "fixed_point", q=q, columns=(), socket_distance=0.1)
    alike = replace(recording, socket=np.arange(20) % 2)
    model = build_model(alike)
    gram = Mapped(model.problem).gram(model.start)
    assert np.isfinite(gram.matrix).all()
    assert np.isfinite(gram.vector).all()


def test_a_factor_that_rounding_has_spoilt_is_one_of_a_matrix_nearby():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(5, 3))
    G = A @ A.T * np.outer(*[10.0 ** np.arange(0, -10, -2)] * 2)
    spoilt = G - 1e-16 * np.diag(np.diag(G))
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(spoilt)
    lower = cholesky(spoilt, np.diag(G))
    assert np.array_equal(lower, np.tril(lower))
    assert (np.diag(lower) > 0.0).all()
    size = np.sqrt(np.outer(np.diag(G), np.diag(G)))
    np.testing.assert_allclose(lower @ lower.T / size, spoilt / size, atol=1e-14)


def test_a_factor_of_a_good_matrix_is_numpy_s_own():
    A = np.random.default_rng(0).normal(size=(6, 4))
    G = A.T @ A
    assert np.array_equal(cholesky(G, np.diag(G)), np.linalg.cholesky(G))


@pytest.mark.parametrize("turned", [False, True])
def test_a_tool_that_kept_one_orientation_is_said_to_be_open_with_the_frame(turned):
    """Of a gantry: where the tip sits and where the device stands are one."""
    slide = {"kind": "prismatic", "d": 0.1, "lower": -1.0, "upper": 1.0}
    rows = [{**slide, "alpha": np.pi / 2}, {**slide, "alpha": np.pi / 2}, slide]
    robot = Robot.from_dh([*rows, {"a": 0.1, "alpha": 1.0}, {"a": 0.1}] if turned else rows)
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.3, 0.3, (30, len(robot.chain().lower)))
    tips = robot.chain().tips(q, [0.01, 0.02, 0.1]) + rng.normal(0.0, 1e-4, (30, 3))
    recording = build_recording(
        observation="tip_position", robot=robot, q=q, measured=tips, noise_std=1e-4
    )
    notes = " ".join(diagnose(recording, FEW_EFFECTS).verdict.notes)
    assert ("3 of 9 unknowns" in notes and "turn the tool more" in notes) is not turned
    assert ("left open" in notes) is not turned
