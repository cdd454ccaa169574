"""Laws of blame: shares of the explained gap, what cannot be told apart, what cannot be seen."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.reality.joint_effects import JointOffset as RealOffset
from plumbline.experiments.reality.joint_effects import TransmissionRipple as RealRipple
from plumbline.kinematics.effects import EFFECTS, REGISTRY
from plumbline.kinematics.effects.friction import Friction
from plumbline.kinematics.effects.joint_compliance import JointCompliance
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.respiration import Respiration
from plumbline.kinematics.effects.sensor_scale import SensorScale
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.verdict.confounding import rivals
from plumbline.optim.diagnosis.verdict.where import expected_shares, explained_by, shares
from plumbline.optim.recording.building import build_recording
from tests.benches import bench
from tests.designs import selection
from tests.simulated_cases import causes, faultless, recorded, with_fault

N, SIGMA = 60, 0.1


def noise(rng):
    return rng.normal(0.0, SIGMA, N)


# Shares


def three_joints(order=(0, 1, 2)):
    """Joints 1 to 3, two of them correlated; in any order of the columns."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(N, 3))
    X[:, 1] += 0.8 * X[:, 0]
    t = X @ [1.0, 0.6, 0.3] + noise(rng)
    variants = [JointOffset(joint=k + 1) for k in order]
    asked = selection(X[:, list(order)], t, SIGMA, variants=variants)
    return asked, [SelectedTerm(k, 1.0) for k in range(3)]


def test_shares_sum_to_one_and_are_ranked():
    found = shares(*three_joints())
    assert sum(p.share for p in found) == pytest.approx(1.0)
    assert all(p.share > 0 for p in found)
    assert [p.share for p in found] == sorted((p.share for p in found), reverse=True)
    assert {(p.stage, p.element) for p in found} == {("joint", 1), ("joint", 2), ("joint", 3)}


def test_a_share_belongs_to_the_element_whatever_its_place_in_the_list():
    straight = {p.element: p.share for p in shares(*three_joints())}
    turned = {p.element: p.share for p in shares(*three_joints((2, 0, 1)))}
    for element, share in straight.items():
        assert turned[element] == pytest.approx(share, rel=1e-9)


def test_places_of_causes_that_do_the_same_have_the_weight_of_their_states():
    asked, (first, second, third) = three_joints()
    states = ((np.log(0.6), (first,)), (np.log(0.4), (second,)), (np.log(0.005), (third,)))
    found = {p.element: p.share for p in expected_shares(asked, states)}
    assert found == pytest.approx({1: 0.6, 2: 0.4})
    both = ((-3.0, (first, second)),)
    assert expected_shares(asked, both) == shares(asked, both[0][1])


def test_elements_alike_have_shares_alike():
    """Two joints with the same signal and the same overlap are to blame in equal parts."""
    rng = np.random.default_rng(2)
    u, v, w = np.sqrt(N) * np.linalg.qr(rng.normal(size=(N, 3)))[0].T
    X = np.column_stack([u + w, v + w])
    asked = selection(X, X @ [1.0, 1.0], SIGMA)
    found = shares(asked, [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)])
    assert found[0].share == pytest.approx(0.5, abs=0.02)


def test_without_overlap_a_share_is_the_square_that_its_element_explains():
    rng = np.random.default_rng(3)
    X = np.sqrt(N) * np.linalg.qr(rng.normal(size=(N, 2)))[0]
    asked = selection(X, X @ [0.6, 0.8], SIGMA)
    found = {
        p.element: p.share for p in shares(asked, [SelectedTerm(0, 30.0), SelectedTerm(1, 30.0)])
    }
    assert found[1] == pytest.approx(0.36, abs=1e-3)
    assert found[2] == pytest.approx(0.64, abs=1e-3)


def test_the_drops_add_up_to_all_that_is_explained():
    asked, chosen = three_joints()
    drops = explained_by(asked, chosen, ["a", "b", "c"])
    assert sum(drops.values()) == pytest.approx(asked.linear.tt - asked.reduce(chosen).tt, rel=1e-3)


def test_effects_of_one_element_share_one_place():
    rng = np.random.default_rng(4)
    X = rng.normal(size=(N, 3))
    variants = [JointOffset(joint=2), JointScale(joint=2), SensorScale()]
    asked = selection(X, X @ [0.5, 0.5, 0.1], SIGMA, variants=variants)
    found = shares(asked, [SelectedTerm(k, 1.0) for k in range(3)])
    assert [(p.stage, p.element) for p in found] == [("joint", 2), ("sensor", None)]


def test_where_nothing_was_chosen_nothing_is_to_blame():
    assert shares(three_joints()[0], []) == ()


def test_a_planted_fault_has_the_whole_share_of_its_joint(tmp_path):
    case = with_fault(faultless(rows=60, seed=5), RealRipple(0.0, 3, once=(1.0, 0.5)))
    diagnosis = diagnose(recorded(case, tmp_path)[0], ZERO_OR_WHEEL)
    assert [(p.stage, p.element, p.share) for p in diagnosis.verdict.where] == [("joint", 3, 1.0)]


def test_two_planted_faults_have_the_shares_of_their_gaps(tmp_path):
    """Gaps of 5 and 2.5 sigma, hardly correlated: four fifths and one."""
    case = faultless(rows=48, seed=6)
    strong = with_fault(case, RealRipple(0.0, 2, once=(1.0, 0.5)), gap=5.0)
    weak = with_fault(case, RealOffset(0.0, 4), gap=2.5)
    both = (*strong.effects, *weak.effects)
    case = replace(strong, effects=both, gap_to_noise=(5.0, 2.5))
    diagnosis = diagnose(recorded(case, tmp_path)[0], ZERO_OR_WHEEL)
    assert set(causes(diagnosis)) == {("transmission_ripple", 2), ("joint_offset", 4)}
    found = {p.element: p.share for p in diagnosis.verdict.where}
    assert sum(found.values()) == pytest.approx(1.0)
    assert found[2] == pytest.approx(0.8, abs=0.1)


# What cannot be told apart


def test_a_rival_is_what_could_have_made_the_signal():
    rng = np.random.default_rng(7)
    X = rng.normal(size=(N, 3))
    X[:, 1] = X[:, 0] + 0.01 * rng.normal(size=N)
    asked = selection(X, 0.5 * X[:, 0] + noise(rng), SIGMA)
    own = [SelectedTerm(0, 1.0)]
    [rival] = rivals(asked, asked.reduce(own), own)
    assert (rival.effect, rival.element) == ("joint_offset", 2)
    assert rival.why.endswith("times as probable")


def test_the_stronger_the_signal_the_fewer_rivals():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(N, 2))
    X[:, 1] = X[:, 0] + 0.3 * rng.normal(size=N)
    counts = []
    for size in (0.05, 1.0):
        asked = selection(X, size * X[:, 0] + 0.1 * noise(rng), SIGMA)
        own = [SelectedTerm(0, 1.0)]
        counts.append(len(rivals(asked, asked.reduce(own), own)))
    assert counts == [1, 0]


def test_a_strong_signal_is_told_from_a_rival_that_almost_holds_it():
    rng = np.random.default_rng(12)
    X = rng.normal(size=(N, 2))
    X[:, 1] = X[:, 0] + 0.1 * X[:, 1]  # a squared correlation of 0.99
    weak, strong = (selection(X, size * X[:, 0] + noise(rng), SIGMA) for size in (0.1, 1.0))
    assert rivals(weak, weak.reduce([SelectedTerm(0, 1.0)]), [SelectedTerm(0, 1.0)])
    assert rivals(strong, strong.reduce([SelectedTerm(0, 1.0)]), [SelectedTerm(0, 1.0)]) == []


def test_the_less_rows_are_worth_the_more_rivals():
    """Where blocks of rows agree on a fiftieth of what they say, names are told by that alone."""
    rng = np.random.default_rng(12)
    X = rng.normal(size=(N, 2))
    X[:, 1] = X[:, 0] + 0.1 * X[:, 1]
    strong = selection(X, X[:, 0] + noise(rng), SIGMA)
    weak = replace(strong, linear=strong.linear.share(0.02))
    own = [SelectedTerm(0, 1.0)]
    assert [len(rivals(of, of.reduce(own), own)) for of in (strong, weak)] == [0, 1]


def test_what_is_not_allowed_is_no_rival():
    rng = np.random.default_rng(9)
    X = rng.normal(size=(N, 2))
    X[:, 1] = X[:, 0]
    asked = selection(X, 0.5 * X[:, 0], SIGMA, allowed=[True, False])
    assert rivals(asked, asked.reduce([SelectedTerm(0, 1.0)]), [SelectedTerm(0, 1.0)]) == []


ZERO_OR_WHEEL = DiagnosisOptions(library=(JointOffset, REGISTRY["transmission_ripple"]))
LIBRARY = (JointOffset, JointCoupling, JointCompliance)


def offset_of_joint_5(spread):
    """A recording with joint 5's zero off, joint 4 moving by so many radians only."""
    clean = bench("ur5", "tip_position", columns=())
    rng = np.random.default_rng(10)
    q = clean.q.copy()
    q[:, 3] = 1.0 + rng.uniform(-spread, spread, len(q))
    true = q.copy()
    true[:, 4] += 4e-3
    measured = bench("ur5", "tip_position", columns=(), q=true).measured
    measured = measured + rng.normal(0.0, 1e-4, measured.shape)
    tool = clean.tool_offset
    return build_recording(
        observation="tip_position", robot=clean.robot, q=q, measured=measured, tool_offset=tool,
        noise_std=1e-4,
    )  # fmt: skip


def test_a_coupling_to_a_joint_that_hardly_moves_is_an_offset_by_another_name():
    [cause] = diagnose(offset_of_joint_5(1e-3), DiagnosisOptions(library=LIBRARY)).verdict.causes
    named = {(cause.effect, cause.element)} | {(b.effect, b.element) for b in cause.confounded_with}
    assert named == {("joint_offset", 5), ("joint_coupling", 5)}


def test_a_coupling_to_a_joint_that_moves_is_told_from_an_offset():
    [cause] = diagnose(offset_of_joint_5(1.5), DiagnosisOptions(library=LIBRARY)).verdict.causes
    assert (cause.effect, cause.element) == ("joint_offset", 5)
    assert cause.confounded_with == ()


# What cannot be seen


@pytest.fixture(scope="module")
def blind():
    """A clean recording with nothing but joint readings and tips."""
    recording = bench("ur5", "tip_position", columns=())
    shaken = recording.measured + np.random.default_rng(11).normal(0.0, 1e-4, (60, 3))
    return diagnose(
        replace(recording, measured=shaken, noise_std=1e-4), DiagnosisOptions(library=EFFECTS)
    )


def test_an_offset_of_the_first_or_last_joint_is_absorbed_by_frame_or_tool(blind):
    unseen = {(b.effect, b.element): b.why for b in blind.verdict.unobservable}
    for joint in (1, 6):
        assert unseen["joint_offset", joint] == "what is always fitted absorbs it"
    assert not {("joint_offset", joint) for joint in (2, 3, 4, 5)} & set(unseen)


def test_a_vertical_joint_carries_no_weight(blind):
    unseen = {(b.effect, b.element): b.why for b in blind.verdict.unobservable}
    assert unseen["joint_compliance", 1] == "no row excites it"
    assert ("joint_compliance", 2) not in unseen


def test_an_effect_without_its_column_says_which(blind):
    unseen = {b.effect: b.why for b in blind.verdict.unobservable}
    assert unseen["base_drift"] == "needs the column time"
    assert unseen["latency"] == "needs the column velocity"
    assert unseen["link_thermal"] == "needs the column temperature, or time"
    assert unseen["coupled_play"] == "needs the column direction, or velocity"


@pytest.mark.parametrize(
    ("seconds", "why"),
    [
        (4.0, "lasts 4 s, not the 10 s of a slow breath"),
        (
            7200.0,
            "lasts 7200 s, and a breath is looked for in up to 5000 s: diagnose a part of the rows",
        ),
    ],
)
def test_a_recording_too_short_or_too_long_for_a_breath_says_so(seconds, why):
    quiet = bench("ur5", "tip_position")
    shaken = quiet.measured + np.random.default_rng(11).normal(0.0, 1e-4, (60, 3))
    timed = replace(quiet, measured=shaken, noise_std=1e-4, time=np.linspace(0.0, seconds, 60))
    verdict = diagnose(timed, DiagnosisOptions(library=[Respiration, JointOffset])).verdict
    assert {b.effect: b.why for b in verdict.unobservable}["respiration"] == why


def test_what_is_always_fitted_is_said_to_be_never_blamed():
    recording = replace(bench("ur5", "joint_position"), always=("joint_offset",))
    unseen = {b.effect: b.why for b in diagnose(recording).verdict.unobservable}
    assert unseen["joint_offset"] == "is always fitted, so never blamed"


def test_an_encoder_cannot_see_what_the_links_do():
    recording = bench("ur5", "joint_position")
    unseen = {b.effect: b.why for b in diagnose(recording).verdict.unobservable}
    assert unseen["link_geometry"] == "a recording of joint_position cannot show it"
    assert unseen["base_drift"] == "a recording of joint_position cannot show it"


def test_friction_at_separate_postures_is_said_to_need_a_motion_or_a_velocity(blind):
    def why(recording):
        verdict = diagnose(recording, DiagnosisOptions(library=[Friction, JointOffset])).verdict
        return next(b.why for b in verdict.unobservable if b.effect == "friction")

    still = replace(blind.recording, velocity=np.zeros_like(blind.recording.q))
    assert why(blind.recording) == "needs the column velocity"
    assert "no farther from one to the next than a twentieth" in why(still)


def test_a_candidate_says_by_how_much_the_rows_move_its_odds(tmp_path):
    """What no row shows is as probable as before, however improbable that was."""
    recording, _ = recorded(faultless(rows=60, seed=3), tmp_path)
    found = diagnose(recording, DiagnosisOptions(library=(JointOffset, JointScale))).verdict
    assert not found.causes
    said = {(c.effect, c.element): c.why for c in found.candidates}
    times = {key: float(why.split()[-2]) for key, why in said.items()}
    assert times["joint_offset", 1] < 1.6  # the frame absorbs it
    assert times["joint_offset", 6] < 1.6  # and the tool this one
    assert times["joint_offset", 3] > 3.0
    assert "lower" in said["joint_offset", 3]
