"""Laws of mechanisms that resemble an effect: as visible as it is, one share, and when they win."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from plumbline.experiments.reality.body_effects import LinkThermal
from plumbline.experiments.reality.end_effects import SensorScale
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.joint_compliance import JointCompliance
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.alternatives import Unlisted
from plumbline.optim.diagnosis.discrepancy.dependence import ANY, Dependence
from plumbline.optim.diagnosis.discrepancy.resembling import (
    _modulated,
    _words,
    resembled,
    resembling,
)
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.joint import sample
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem
from plumbline.optim.diagnosis.posterior.pool import _candidates
from plumbline.optim.diagnosis.prior import DEVIATIONS, RESEMBLING, SCALES, UNLISTED
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.kinds import KINDS
from tests.designs import selection, statistics
from tests.explained import told
from tests.few_effects import FEW_EFFECTS, few_and
from tests.simulated_cases import faultless, recorded, with_fault

N, SIGMA = 120, 1.0


def place(seed=0):
    """An arm of one joint whose angle, load and time are seen, and one column that goes with it."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, (N, 2))
    still = np.tile(np.eye(4), (N, 1, 1))
    chain = SimpleNamespace(placement=lambda q: still, kinds=("revolute", "revolute"))
    recording = SimpleNamespace(
        kind=KINDS["tip_position"],
        q=q,
        chain=chain,
        time=np.arange(N) * 5.0,
        temperature=None,
        stand_in=False,
    )
    own = np.stack([q[:, 0], np.ones(N)])[:, :, None] * np.array([0.7, 0.7, 0.2])
    zeros = np.stack([own[1], own[1]])
    ports = SimpleNamespace(base=own, joint=zeros, target=np.zeros((N, 3)))
    return recording, ports


@pytest.fixture
def beside(monkeypatch):
    """What resembles a scale of joint 1, whose nuisance is an offset."""
    monkeypatch.setattr(
        "plumbline.optim.diagnosis.discrepancy.resembling.loads",
        lambda recording: np.cos(recording.q),
    )
    recording, ports = place()
    family = Dependence(
        "w", "own angle", "joint", 1, np.cos(3.0 * recording.q[:, 0])[None, :, None] * np.ones(3)
    )
    other = Dependence("w", "own angle", "joint", 2, family.columns)
    listed = Candidate(JointScale(joint=1), np.array([0]), -np.log(7.0))
    basis = (ports.base[1].ravel() / np.linalg.norm(ports.base[1]))[:, None]

    def visible(columns):
        return float(np.linalg.norm(left(columns, basis)))

    found = list(resembling([listed], [family, other], recording, ports, visible))
    return recording, ports, basis, found


def left(columns, basis):
    flat = columns.reshape(len(columns), -1)
    return flat - (flat @ basis) @ basis.T


def test_the_deviation_is_as_visible_as_the_effect_or_a_stated_share_of_it(beside):
    _, ports, basis, found = beside
    own = np.linalg.norm(left(ports.base[:1], basis))
    ratios = [np.linalg.norm(left(f.columns[1:], basis)) / own for f in found]
    np.testing.assert_allclose(sorted(set(np.round(ratios, 9))), sorted(DEVIATIONS))
    for f in found:
        np.testing.assert_array_equal(f.columns[0], ports.base[0])


def test_all_that_resembles_an_effect_has_its_part_of_the_effect_s_share(beside):
    found = beside[-1]
    assert np.exp([f.log_prior for f in found]).sum() == pytest.approx(RESEMBLING / 7.0)


def test_it_sits_where_the_effect_sits_and_depends_on_the_same(beside):
    for f in beside[-1]:
        assert (f.stage, f.element, f.on) == ("joint", 1, "own angle")
        assert f.words == "nearly as joint_scale has it, joint 1's error depends on own angle"


def test_what_bends_a_constant_depends_on_what_bends_it(beside):
    """A zero that follows the clock does not depend on the joint's angle.

    Beside a zero what errs along the angle is a mechanism of its own.
    """
    recording, ports, *_ = beside
    listed = Candidate(JointOffset(joint=1), np.array([1]), 0.0)
    clock = Dependence("w", "temperature", "joint", 1, np.ones((1, N, 3)) * ports.base[0])
    turn = Dependence("w", "own angle", "joint", 1, clock.columns)
    found = list(resembling([listed], [clock, turn], recording, ports, lambda c: np.linalg.norm(c)))
    assert {f.on for f in found} == {"load", "time", "temperature"}
    for f in found:
        assert f.words == f"nearly as joint_offset has it, joint 1's error depends on {f.on}"


def test_what_a_zero_does_is_no_deviation_of_what_its_joint_does(beside):
    _, ports, _, found = beside
    for f in found:
        along = np.tensordot(f.columns[1:], ports.joint[0], ((1, 2), (0, 1)))
        np.testing.assert_allclose(along, 0.0, atol=1e-9)


def test_a_family_of_another_place_is_no_deviation(beside):
    """Angle, load, time, and the one unknown function of this joint."""
    assert len(beside[-1]) == 4 * len(DEVIATIONS)


def posterior(beside, strength, form):
    """Probability of the scale when the joint errs by a form of its angle, so many sigma RMS."""
    recording, ports, basis, found = beside
    error = form(recording.q[:, 0])[:, None] * np.array([0.7, 0.7, 0.2])
    seen = left(error[None], basis)
    seen *= strength * SIGMA / np.sqrt(np.mean(seen**2))
    t = seen[0] + np.random.default_rng(3).normal(0.0, SIGMA, seen[0].shape)
    unit = SIGMA / np.sqrt(np.mean(left(ports.base[:1], basis) ** 2))
    X = np.concatenate(
        [unit * left(f, basis) for f in (ports.base[:1], *(d.columns for d in found))]
    )
    sizes = [1, *(len(f.columns) for f in found)]
    ends = np.cumsum([0, *sizes])
    terms = [
        SimpleNamespace(columns=np.arange(a, z), limits=np.array([ANY] * (z - a)), widths=SCALES)
        for a, z in pairwise(ends)
    ]
    shares = [f.log_prior + np.log(UNLISTED) for f in found]
    priors = np.array([np.log((1 - UNLISTED) / 7.0), *shares])
    labels = np.array([[0, *[1] * len(found)]])
    none = np.zeros(len(terms), dtype=bool)
    problem = JointProblem(
        statistics(X.T, t), tuple(terms), NoisePrior(SIGMA, 1e9), priors, none, labels
    )
    return sample(problem, [frozenset[int]()], 0).marginals[0]


def test_the_exact_form_is_sure_once_it_stands_out_and_another_never_is(beside):
    straight = [posterior(beside, s, lambda q: q)[0] for s in (0.2, 1.5, 4.0)]
    assert sorted(straight) == straight
    assert straight[0] < 0.98
    assert straight[-1] > 0.99
    bent = posterior(beside, 3.0, lambda q: q + 0.5 * np.sin(2.0 * q))
    assert bent[0] < 0.2
    assert bent[1] > 0.8


def test_a_variant_that_the_data_refined_has_its_part_of_the_listed_one_s_share(tmp_path):
    """A ripple's order, and all that refine it by the data, have at most the share of two."""
    recording, _ = recorded(faultless(rows=30, seed=1), tmp_path)
    scope = scope_of(recording)
    whole = next(e for e in GearRipple.candidates(scope) if e.joint == 1)
    finer = list(whole.neighbours(scope))
    model = build_model(recording, [whole, *finer], nuisance=nuisances_of(recording))
    found = _candidates(model, 0, GearRipple.candidates(scope))
    listed, *others = (np.exp(c.log_prior) for c in found)
    np.testing.assert_allclose(others, [listed / (1 + len(v.neighbours(scope))) for v in finer])
    assert sum(others) < listed


def test_a_sixteenth_of_the_prior_is_of_what_resembles_an_effect():
    """So a name that nothing confirms yet is not told as sure for its prior's sake alone."""
    alike = UNLISTED * RESEMBLING
    assert 0.03 < alike / (1 - UNLISTED + alike) < 0.1


def test_deviations_run_from_a_third_of_the_effect_to_all_of_it():
    assert 0.2 < min(DEVIATIONS) < 0.5
    assert 0.8 < max(DEVIATIONS) < 1.3


def test_what_resembles_an_effect_has_its_bounds(beside):
    """Play and compliance are positive, and so is what is nearly one of them."""
    recording, ports, *_ = beside
    listed = Candidate(JointCompliance(joint=1), np.array([0]), 0.0)
    for f in resembling([listed], [], recording, ports, lambda c: np.linalg.norm(c)):
        own, *rest = Unlisted(f, np.arange(len(f.columns))).limits
        assert own.tolist() == listed.limits[0].tolist()
        assert own[0] == 0.0
        assert all(tuple(limits) == ANY for limits in rest)


@pytest.mark.parametrize(
    ("on", "may"),
    [
        ("load", True),
        ("another joint's angle", False),
        ("two angles", False),
        ("own angle, locally", False),
        ("moment", False),
    ],
)
def test_what_has_many_forms_of_its_own_is_no_deviation_of_a_listed_effect(on, may, beside):
    """Nearly an effect, but for what may be anything, would be no effect at all."""
    recording, ports, *_ = beside
    listed = Candidate(JointCompliance(joint=1), np.array([0]), 0.0)
    size = (1, *ports.target.shape)
    family = Dependence(on, on, "joint", 1, np.random.default_rng(0).normal(size=size))
    found, none = (
        len(list(resembling([listed], given, recording, ports, lambda c: np.linalg.norm(c))))
        for given in ([family], [])
    )
    assert (found > none) is may


def test_what_resembles_a_ripple_may_have_any_form_of_its_period():
    """Harmonics of its order are among its deviations, whatever the order."""
    recording, _ = place()
    q = recording.q[:, 0]
    own = np.stack([np.sin(32.0 * q), np.cos(32.0 * q)])[:, :, None] * np.ones(3)
    ripple, plain = GearRipple(joint=1, order=32.0), JointScale(joint=1)
    load = np.zeros((N, 2))
    for effect, near in ((ripple, True), (plain, False)):
        spans = [d[:, :, 0] for _, d in _modulated(own, recording, load, effect)]
        third = np.sin(96.0 * q + 0.4)
        left = min(
            np.sum((third - s.T @ np.linalg.lstsq(s.T, third, rcond=1e-9)[0]) ** 2) for s in spans
        )
        assert (left < 1e-9) == near


@pytest.mark.parametrize(
    ("stage", "element", "on", "words"),
    [
        ("registration", None, "time", "the registration's error depends on time"),
        ("registration", 3, "nothing", "marker 3's error is nearly as x has it"),
        ("tool", None, "group", "the tool's error depends on its group or stretch of time"),
    ],
)
def test_a_resemblance_speaks_of_nothing_that_is_not_there(stage, element, on, words):
    """No marker where no element is one, no group where a slip is told by its time."""
    assert words in _words(stage, element, on, "x")


def test_at_each_look_a_handful_of_effects_is_resembled_the_likeliest():
    X = 10.0 * np.linalg.qr(np.random.default_rng(0).normal(size=(N, 9)))[0]
    asked = selection(X, X @ np.linspace(0.2, 1.8, 9), SIGMA)
    found = resembled(SimpleNamespace(selection=asked, candidates=asked.candidates), [[]])
    assert 3 <= len(found) <= 6
    assert [c.effect.joint for c in found] == list(range(9, 9 - len(found), -1))


def test_a_zero_and_an_eccentric_wheel_of_one_joint_are_two_causes_not_one_unlisted():
    """What is unlisted is about its mean: a joint's mean is its zero, which is listed."""
    rng = np.random.default_rng(0)
    robot, tool = Robot.bundled("ur5"), np.array([0.02, -0.03, 0.15])
    q = rng.uniform(-2.0, 2.0, (110, 6))
    real = q.copy()
    real[:, 2] += 8e-4 + 9e-4 * np.sin(q[:, 2] + 2.0)
    tips = robot.chain().tips(real, tool) + rng.normal(0.0, 1e-4, (110, 3))
    verdict = diagnose(build_recording(
        observation="tip_position", robot=robot, q=q, measured=tips, tool_offset=tool,
        noise_std=1e-4,
    ), FEW_EFFECTS).verdict  # fmt: skip
    assert verdict.verdict == Outcome.EXPLAINED
    named = {(c.effect, c.element) for c in verdict.causes}
    assert named == {("joint_offset", 3), ("transmission_ripple", 3)}
    assert min(c.probability for c in verdict.causes) > 0.8


@pytest.mark.parametrize(("seed", "j"), [(0, 2), (6, 1)])
def test_a_zero_and_a_soft_drive_of_one_joint_are_two_causes_not_one_unlisted(seed, j):
    """A zero that depends on the load as a soft drive has it is a zero beside a soft drive."""
    rng = np.random.default_rng(seed)
    robot, tool = Robot.bundled("ur5"), np.array([0.02, -0.03, 0.15])
    q = rng.uniform(-2.0, 2.0, (60, 6))
    load = np.array(
        [pin.computeGeneralizedGravity(robot.model, robot.model.createData(), x) for x in q]
    )
    real = q.copy()
    real[:, j] += 2e-3 - 1.5e-3 * load[:, j] / np.abs(load[:, j]).max()
    tips = robot.chain().tips(real, tool) + rng.normal(0.0, 1e-4, (60, 3))
    found = told(build_recording(
        observation="tip_position", robot=robot, q=q, measured=tips, tool_offset=tool,
        noise_std=1e-4,
    ), FEW_EFFECTS.library)  # fmt: skip
    assert found.named == {("joint_offset", j + 1), ("joint_compliance", j + 1)}
    assert min(found.probabilities[key] for key in found.named) > 0.97


def test_a_device_s_scale_is_a_cause_of_its_own_and_no_deviation_of_warm_links(tmp_path):
    """No links that were too long before they were warm."""
    case, faults, gaps = faultless(100, 6), (LinkThermal(0.0), SensorScale(1.0)), (1.5, 4.0)
    sized = [with_fault(case, f, gap=g).effects[0] for f, g in zip(faults, gaps, strict=True)]
    case = replace(case, kind="pair", effects=tuple(sized), gap_to_noise=gaps)
    found = told(recorded(case, tmp_path)[0], few_and("link_thermal").library)
    assert found.unlisted < 0.1
    assert {effect for effect, _ in found.named} == {f.effect for f in faults}
    assert min(found.probabilities[key] for key in found.named) > 0.9


@pytest.mark.parametrize(
    ("seed", "options"),
    [(4, DiagnosisOptions()), (5, few_and("link_thermal", "sensor_distortion"))],
)
def test_links_that_are_right_at_another_temperature_are_no_scale_of_the_device(
    seed, options, tmp_path
):
    """Nobody knows to a kelvin at what temperature a model's lengths hold.

    At ten times of what is known of that the first is another, at a tenth the second.
    """
    case = with_fault(faultless(100, seed), LinkThermal(0.0, 23.0), gap=4.0)
    found = told(recorded(case, tmp_path)[0], options.library)
    [cause] = found.named
    assert cause == ("link_thermal", None)
    assert found.probabilities[cause] > 0.95
    assert found.unlisted < 0.1
