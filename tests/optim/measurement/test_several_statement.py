"""Several recordings in one statement: every row reads as its own recording has it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import plumbline
from plumbline.kinematics.effects.confined import confined, parts_of, plain
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import make_pool
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.refit import candidates_of
from plumbline.optim.recording.session import joined, named_row
from tests.several import recorded

KINDS = ("tip_position", "pose", "fixed_point", "joint_position")
EFFECTS = (JointScale(joint=2), JointOffset(joint=3))
VALUES = np.array([2e-3, 1e-3])


@pytest.fixture(scope="module")
def session():
    """One recording of each kind, two tips with other tools and tip frames among them."""
    parts = [recorded(kind, 5 + k, rows=9) for k, kind in enumerate(KINDS)]
    other = recorded("tip_position", 11, rows=9, tool=(0.0, 0.05, 0.2))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), [0.01, 0.02, -0.03]
    elsewhere = replace(other, chain=replace(other.chain, T_last_tip=T))
    return plumbline.build_session([*parts, elsewhere])


@pytest.fixture(scope="module")
def joint(session):
    return joined(session, [1.0] * len(session))


def own_and_joint(session, joint, k):
    """Residuals of recording k alone and in the session, at the same nuisances and effects."""
    part, rng = session.parts[k], np.random.default_rng(3)
    alone = build_model(part, EFFECTS)
    all_of = build_model(joint, EFFECTS)
    x = all_of.start + 1e-2 * rng.normal(size=all_of.start.shape) * all_of.problem.scale
    x[all_of.fixed :] = VALUES
    own = all_of.nuisance.own[k].columns
    mine = Mapped(alone.problem).residuals(np.concatenate([x[own], VALUES]))
    return mine, Mapped(all_of.problem).residuals(x)[joint.part == k], own, all_of, x


@pytest.mark.parametrize("k", range(5))
def test_a_row_reads_what_its_own_recording_alone_would_have_it_read(session, joint, k):
    mine, together, *_ = own_and_joint(session, joint, k)
    live = session.live(k)
    assert np.abs(mine).max() > 1e-4
    assert np.allclose(together[:, live], mine, atol=1e-12)
    assert not together[:, ~live].any()


@pytest.mark.parametrize("k", range(5))
def test_a_recording_s_own_nuisances_move_no_row_of_another(session, joint, k):
    *_, own, model, x = own_and_joint(session, joint, k)
    J = np.concatenate([J for _, _, J in Mapped(model.problem).jacobians(x)])
    assert not J[joint.part != k][:, :, own].any()


def test_the_gram_matrices_of_recordings_add(session, joint):
    model = build_model(joint, EFFECTS)
    mapped = Mapped(model.problem)
    each, (whole,) = mapped.grams(model.start, joint.part), mapped.grams(model.start)
    assert np.allclose(sum(g.matrix for g in each), whole.matrix)
    counts = [9 * 3, 9 * 6, 9 * 3, 9 * 6, 9 * 3]
    assert [g.count for g in each] == counts
    effects = slice(model.fixed, None)
    for k, gram in enumerate(each):
        (alone,) = Mapped(build_model(session.parts[k], EFFECTS).problem).grams(
            build_model(session.parts[k], EFFECTS).start
        )
        assert np.allclose(gram.matrix[effects, effects], alone.matrix[-2:, -2:], rtol=1e-6)


def test_what_is_shared_is_one_unknown(session):
    two = [recorded("tip_position", s, rows=9) for s in (1, 2)]
    apart = nuisances_of(joined(plumbline.build_session(two)))
    shared = nuisances_of(joined(plumbline.build_session(two, shared=("tool",))))
    assert (apart.size, shared.size) == (18, 15)
    assert "tool x" in shared.names
    assert "frame x of tip_position 1" in shared.names


def test_a_confined_effect_is_at_work_in_its_recordings_alone(joint):
    effect = confined(JointScale(joint=2), (1,), "in the second")
    model = build_model(joint, [effect])
    at = model.start.copy()
    at[model.fixed :] = 2e-3
    moved = Mapped(model.problem).residuals(at) - Mapped(model.problem).residuals(model.start)
    assert not moved[joint.part != 1].any()
    everywhere = build_model(joint, [plain(effect)])
    wholly = Mapped(everywhere.problem).residuals(at)
    assert np.allclose(
        wholly[joint.part == 1], Mapped(model.problem).residuals(at)[joint.part == 1]
    )
    assert (effect.label, effect.variant) == ("joint_scale 2", "in the second")
    assert plain(effect) == JointScale(joint=2) != effect


def test_noise_is_each_recording_s_own(session):
    two = [recorded("tip_position", 1, rows=9), recorded("tip_position", 2, rows=9, noise=3e-4)]
    made = joined(plumbline.build_session(two))
    sigma = made.noise_std * made.noise_shape
    assert np.allclose(sigma[made.part == 0], 1e-4)
    assert np.allclose(sigma[made.part == 1], 3e-4)
    assert np.isclose(np.mean(made.noise_shape**2), 1.0)
    alike = [two[0], recorded("tip_position", 3)]
    assert joined(plumbline.build_session(alike)).noise_shape is None


def test_a_recording_without_noise_leaves_that_of_all_unknown():
    two = [recorded("tip_position", 1), recorded("tip_position", 2, noise_std=None)]
    assert joined(plumbline.build_session(two), [1e-4, 2e-4]).noise_std is None


def test_what_follows_a_clock_is_each_recording_s_own():
    timed = recorded("tip_position", 1, slip=(1e-3, 0.0, 0.0))
    joint = joined(plumbline.build_session([timed, recorded("tip_position", 2)]))
    found = candidates_of(joint, plumbline.EFFECTS)
    assert {parts_of(e) for e in found if e.name in ("tool_slip", "base_bump")} == {(0,)}
    assert {parts_of(e) for e in found if e.name == "joint_scale"} == {None}


def test_what_only_some_can_show_is_confined_to_them(joint):
    found = candidates_of(joint, plumbline.EFFECTS)
    assert {parts_of(e) for e in found if e.name == "sensor_scale"} == {(0, 1, 4)}
    assert {parts_of(e) for e in found if e.name == "link_geometry"} == {(0, 1, 2, 4)}


def test_a_cause_in_one_recording_alone_costs_its_share_of_the_prior():
    parts = [recorded("joint_position", seed, rows=12) for seed in (1, 2)]
    suspect = confined(JointScale(joint=2), (1,), "in the second")
    session = replace(plumbline.build_session(parts), suspects=(suspect,))
    recording = joined(session)
    model = build_model(recording, [])
    folds, noise = np.arange(len(recording)) % 2, NoisePrior.of(1e-4)
    library = [JointScale]
    pool = make_pool(model, model.start, folds, noise, library=library)
    log = {c.effect: c.log_prior for c in pool.candidates}
    price = log[JointScale(joint=2)] - log[suspect]
    assert np.isclose(price, np.log(2 / 0.1))
    assert log[JointScale(joint=2)] == log[JointScale(joint=3)]


def test_a_row_is_named_by_its_recording(session, joint):
    assert named_row(joint, 10) == f"{session.parts[0].name} 10"
    assert named_row(joint, 11) == f"{session.parts[1].name} 2"


def other_gravity():
    one = recorded("tip_position", 1)
    chain = replace(one.chain, gravity=np.array([0.0, 0.0, 9.81]))
    return replace(one, chain=chain, name="hung", sha256="")


@pytest.mark.parametrize(
    ("others", "words"),
    [
        (lambda a: [a], "given twice (as tip_position 1, 60 rows alike), once expected"),
        (
            lambda a: [plumbline.build_recording(name="small", observation="tip_position",
                robot="ur3", q=a.q, measured=a.measured)],
            "small, robot: found ur3 with joints placed or turning otherwise, expected ur5",
        ),
        (
            lambda a: [plumbline.build_recording(name="five", observation="tip_position",
                robot="bh7", q=a.q[:, :5] / 9, measured=a.measured)],
            "five, joints: found 5, expected 6 as in tip_position 1",
        ),
        (lambda a: [other_gravity()], "hung, gravity: found [0. 0. 9.81], expected [ 0. 0. -9.81]"),
    ],
)  # fmt: skip
def test_recordings_that_are_not_of_one_robot_are_refused_in_one_line(others, words):
    first = recorded("tip_position", 1)
    with pytest.raises(plumbline.PlumblineError) as caught:
        plumbline.build_session([first, *others(first)])
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def in_common(share):
    """A recording whose first rows are another's own, as of logs that overlap."""
    one, other = (recorded("tip_position", seed, rows=20) for seed in (1, 2))
    rows = round(share * 20)
    return [one, replace(
        other,
        q=np.vstack([one.q[:rows], other.q[rows:]]),
        measured=np.vstack([one.measured[:rows], other.measured[rows:]]),
    )]  # fmt: skip


def test_rows_most_of_which_another_recording_has_are_refused():
    with pytest.raises(plumbline.PlumblineError, match="as tip_position 1, 15 rows alike"):
        plumbline.build_session(in_common(0.75))


def test_rows_of_which_another_recording_has_the_fewest_are_taken():
    assert len(plumbline.build_session(in_common(0.4)).parts) == 2
