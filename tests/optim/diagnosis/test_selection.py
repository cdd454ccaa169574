"""Laws of the selection: what is found, what is not, and what probabilities it gives."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from plumbline.kinematics.effects.coulomb_friction import CoulombFriction
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.stribeck_friction import StribeckFriction
from plumbline.kinematics.effects.viscous_friction import ViscousFriction
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.selection import restricted, select
from plumbline.optim.diagnosis.posterior.slots import added_evidence, climbed
from tests.designs import selection

N, SIGMA = 60, 0.1


def unit(rng, count):
    """Orthogonal columns (N, count) whose entries have a mean square of one."""
    return np.sqrt(N) * np.linalg.qr(rng.normal(size=(N, count)))[0]


def noise(rng):
    return rng.normal(0.0, SIGMA, N)


def indices(chosen):
    return sorted(c.index for c in chosen)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_there_is_found_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(N, 25))
    asked = selection(X, 0.2 * X[:, 3] - 0.15 * X[:, 17] + noise(rng), SIGMA)
    assert indices(select(asked)) == [3, 17]
    assert indices(select(asked, thorough=False)) == [3, 17]


def test_what_may_not_be_chosen_is_not_asked_and_moves_nothing_that_may():
    rng = np.random.default_rng(0)
    X, some = rng.normal(size=(N, 9)), np.arange(9) % 3 > 0
    whole = selection(X, 0.2 * X[:, 4] + noise(rng), SIGMA)
    few = restricted(whole, some)
    before, after = (p.odds(p.reduce([SelectedTerm(4, 1.0)]))[0] for p in (whole, few))
    np.testing.assert_allclose(after[some], before[some])
    assert np.isneginf(after[~some]).all()
    assert [batch.members.tolist() for batch in few.gathered] == [np.flatnonzero(some).tolist()]


@pytest.mark.parametrize("seed", range(3))
def test_a_pair_that_only_works_together_is_found(seed):
    """Two columns almost alike, each at its usual size, and a signal that is their difference."""
    rng = np.random.default_rng([seed, 1])
    u, w, *rest = unit(rng, 12).T
    X = np.column_stack([0.4 * u + 0.06 * w, 0.4 * u - 0.06 * w, *rest])
    asked = selection(X, X[:, 0] - X[:, 1] + noise(rng), SIGMA)
    assert not select(asked, thorough=False)  # neither is worth anything alone
    assert indices(select(asked)) == [0, 1]
    before = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]  # about an earlier fit
    assert indices(select(asked, thorough=False, before=before)) == [0, 1]
    assert not select(asked, thorough=False, before=[SelectedTerm(5, 1.0)])


@pytest.mark.parametrize("seed", [1, 2])
def test_forms_of_friction_give_way_to_the_two_that_are_at_work_on_every_joint(seed):
    """The root of the speed is the best single one; others make up for it, and none leads back."""
    rng, count = np.random.default_rng(seed), 600
    rates = (0.01, 0.02, 0.041, 0.05, 0.084, 0.119, 0.17, 0.35, 0.5)
    sizes = ((3.1, 0.17), (0.71, 0.135), (1.54, 0.115), (6.0, 0.07), (7.8, 0.068), (8.2, 0.1))
    forms, blocks, read = [], [], []
    for joint, (dry, sigma) in enumerate(sizes, start=1):
        swings, waves = rng.uniform(0.4, 1, 5), rng.uniform(0.05, 0.8, 5)
        swings /= (1 + 3 * waves) / (2 * np.pi * waves) * np.sum(swings / (1 + 3 * waves))
        turns = np.outer(np.arange(count) * 0.01, 2 * np.pi * waves) + rng.uniform(0, 6.28, 5)
        speed = np.cos(turns) @ swings
        size = np.abs(speed)
        shapes = [size**0.5, size, np.ones(count), *(np.exp(-((size / r) ** 2)) for r in rates)]
        block = np.stack(shapes, axis=1) * np.sign(speed)[:, None] / sigma
        forms += [ViscousFriction(joint, 1.0, power=0.5), ViscousFriction(joint, 1.0)]
        forms += [CoulombFriction(joint, 1.0), *(StribeckFriction(joint, 1.0, r) for r in rates)]
        blocks.append(block)
        read.append(dry * (block[:, 2] + 0.8 * block[:, 1]) + rng.normal(size=count))
    asked = selection(block_diag(*blocks), np.concatenate(read), 1.0, variants=forms)
    assert indices(select(asked)) == [12 * j + k for j in range(6) for k in (1, 2)]


def test_of_two_columns_alike_one_is_kept():
    rng = np.random.default_rng(4)
    X = rng.normal(size=(N, 8))
    X[:, 5] = X[:, 2]
    asked = selection(X, 0.3 * X[:, 2] + noise(rng), SIGMA)
    assert len(select(asked)) == 1
    kept = climbed(asked, [SelectedTerm(2, 1.0), SelectedTerm(5, 1.0)], 4)
    assert len(kept) == 1
    assert kept[0].index in (2, 5)


def test_a_cause_is_weighed_with_all_its_variants_and_stands_by_the_best_of_them():
    X = np.random.default_rng(6).normal(size=(N, 3))
    variants = [JointCoupling(joint=3, by=2), JointCoupling(joint=3, by=4), GearRipple(joint=1)]
    asked = selection(X, X[:, 0], SIGMA, variants=variants)
    assert asked.best(np.array([3.0, 3.1, 3.4])) == 1  # two of one cause against a better third
    assert asked.best(np.array([3.0, 3.1, 4.4])) == 2
    assert asked.best(np.array([-np.inf, 3.1, 3.4])) == 2


def test_pure_noise_names_nothing():
    """Two false alarms in forty would be five in a hundred."""
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 9])
        X = rng.normal(size=(N, 40))
        alarms += bool(select(selection(X, noise(rng), SIGMA)))
    assert alarms <= 2


def test_noise_of_unknown_size_names_nothing_either():
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 10])
        X = rng.normal(size=(N, 40))
        alarms += bool(select(selection(X, noise(rng), None)))
    assert alarms <= 2


def test_what_is_not_allowed_is_never_chosen():
    rng = np.random.default_rng(12)
    X = rng.normal(size=(N, 10))
    X[:, 7] = X[:, 2] + 0.05 * rng.normal(size=N)
    t = 0.4 * X[:, 2] + 0.2 * X[:, 5] + noise(rng)
    allowed = np.ones(10, dtype=bool)
    assert indices(select(selection(X, t, SIGMA, allowed=allowed))) == [2, 5]
    allowed[[2, 5]] = False
    asked = selection(X, t, SIGMA, allowed=allowed)
    chosen = select(asked)
    assert 7 in indices(chosen)  # the next best
    assert not set(indices(chosen)) & {2, 5}


def test_nothing_allowed_names_nothing():
    rng = np.random.default_rng(13)
    X = rng.normal(size=(N, 3))
    assert select(selection(X, X[:, 0], SIGMA, allowed=[False] * 3)) == []


def test_what_a_path_gains_does_not_depend_on_its_order_much():
    rng = np.random.default_rng(14)
    X = rng.normal(size=(N, 6))
    asked = selection(X, 0.3 * X[:, 0] + 0.3 * X[:, 1] + noise(rng), SIGMA)
    pair = [SelectedTerm(0, 0.3), SelectedTerm(1, 0.3)]
    ahead, back = (added_evidence(asked, [], p) for p in (pair, pair[::-1]))
    assert ahead > 50
    assert back == pytest.approx(ahead, rel=0.2)


def test_a_term_that_is_asked_alone_has_the_odds_that_it_has_among_all():
    rng = np.random.default_rng(16)
    X = rng.normal(size=(N, 6))
    asked = selection(X, 0.3 * X[:, 0] + noise(rng), SIGMA, allowed=[True] * 5 + [False])
    given = [SelectedTerm(0, 0.3)]
    every = asked.odds(asked.reduce(given))[0]
    for k in range(6):
        alone = asked.odds(asked.reduce(given, [k]))[0]
        assert alone[k] == pytest.approx(every[k], rel=1e-12)
        assert np.isneginf(np.delete(alone, k)).all()


def test_the_order_of_candidates_does_not_matter():
    rng = np.random.default_rng(15)
    X = rng.normal(size=(N, 15))
    t = 0.2 * X[:, 4] + 0.1 * X[:, 11] + noise(rng)
    found = set(indices(select(selection(X, t, SIGMA))))
    backwards = {14 - k for k in indices(select(selection(X[:, ::-1], t, SIGMA)))}
    assert found == backwards == {4, 11}
