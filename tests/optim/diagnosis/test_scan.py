"""Laws of dense families: what is scanned is the model itself, and a clock only orders rows."""

from dataclasses import replace

import numpy as np
import pytest

import plumbline.optim.diagnosis.posterior.shortlists as shortlists
from plumbline.experiments.reality.body_effects import BaseBump as Bumped
from plumbline.kinematics.effects import EFFECTS
from plumbline.kinematics.effects.base_bump import EDGE, MOST, BaseBump
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.screw_ripple import ScrewRipple
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import make_pool
from plumbline.optim.diagnosis.posterior.scan import Family, Given, families
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of
from tests.benches import bench
from tests.designs import statistics
from tests.explained import searched
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import causes, faultless, recorded, with_fault

SCANNED = [cls for cls in EFFECTS if cls.scanned]


def moments(recording):
    return sorted({e.moment for e in BaseBump.candidates(scope_of(recording))})


def at_other_times(recording, seconds):
    return replace(recording, time=np.asarray(seconds, dtype=float))


@pytest.mark.parametrize("observation", ["tip_position", "pose"])
def test_families_are_scanned_together_with_the_columns_of_the_model_itself(observation):
    recording = bench("ur5", observation)
    weights = np.linspace(0.2, 1.0, len(recording))
    nuisance, scope = nuisances_of(recording), scope_of(recording)
    alone = build_model(recording, (), nuisance=nuisance, weights=weights)
    folds, P = np.arange(len(recording)) % 3, alone.problem.size
    variants = [e for cls in SCANNED for e in cls.candidates(scope)[::40]]
    at = alone.start + 0.1 * alone.problem.scale
    found, linears = families(alone, at, folds, variants)
    assert sum(len(family.effects) for family in found) == len(variants)
    for family in found:
        for v, effect in enumerate(family.effects):
            model = build_model(recording, (effect,), nuisance=nuisance, weights=weights)
            x = np.concatenate([at, model.start[P:]])
            for f, gram in enumerate(Mapped(model.problem).grams(x, folds)):
                told = Linear.about(gram, x, model.problem.scale)
                size = np.sqrt(np.outer(np.diag(told.G), np.diag(told.G))) + 1e-30
                seen = np.hstack([family.cross[f, v], family.blocks[f, v]])
                np.testing.assert_allclose(seen / size[P:], told.G[P:] / size[P:], atol=1e-9)
                np.testing.assert_allclose(family.target[f, v], told.b[P:], rtol=1e-6, atol=1e-9)
    for linear, gram in zip(linears, Mapped(alone.problem).grams(at, folds), strict=True):
        told = Linear.about(gram, at, alone.problem.scale)
        np.testing.assert_allclose(linear.b, told.b, rtol=1e-9)
        assert (linear.tt, linear.n) == pytest.approx((told.tt, told.n))


def test_base_columns_left_out_are_as_if_they_had_never_been_there():
    rng = np.random.default_rng(4)
    X, t = rng.normal(size=(40, 6)), rng.normal(size=40)
    whole, kept = statistics(X, t), [0, 2, 3, 5]
    found, told = Given.of(whole).without(np.array([1, 4])), Given.of(statistics(X[:, kept], t))
    np.testing.assert_allclose(found.inverse[np.ix_(kept, kept)], told.inverse, atol=1e-12)
    np.testing.assert_allclose(found.values[kept], told.values, atol=1e-12)
    assert not found.inverse[[1, 4]].any()
    assert not found.values[[1, 4]].any()
    assert (found.tt, found.n) == pytest.approx((told.tt, told.n))


@pytest.mark.parametrize("columns", [[1], [1, 4]])
def test_base_columns_show_what_a_variant_with_them_would_without(columns):
    """Whether it is asked by its own products with the others, or by what all of them have told."""
    rng = np.random.default_rng(4)
    X, t = rng.normal(size=(40, 6)), rng.normal(size=40)
    whole, noise = statistics(X, t + X[:, 1]), NoisePrior()
    cross, target = whole.G[columns][None, None], whole.b[columns][None, None]
    blocks = cross[..., columns]
    family, given = Family((), blocks, cross, target), Given.of(whole)
    [asked] = family.evidence(given, [0], noise, np.array(columns))
    assert given.shows(np.array(columns), noise) == pytest.approx(asked, abs=1e-9)


def test_a_bump_is_looked_for_between_all_rows_but_the_first_and_last_few():
    recording = bench("ur5", "tip_position")
    few = recording.select(np.arange(len(recording)) < 40)
    before = [int((few.time <= moment).sum()) for moment in moments(few)]
    assert before == list(range(EDGE, 40 - EDGE + 1))


def test_of_many_rows_bumps_are_looked_for_evenly_and_then_between_those():
    recording = bench("ur5", "tip_position")
    many = recording.select(np.arange(600) % len(recording))
    many = at_other_times(many, np.arange(600.0))
    found, scope = moments(many), scope_of(many)
    assert len(found) == MOST
    assert np.ptp(np.diff(found)) <= 1.0
    near = [e.moment for e in BaseBump(moment=found[50]).neighbours(scope)]
    assert found[48] < min(near) < found[50] < max(near) < found[52]


def test_a_long_pause_changes_nothing_about_which_rows_a_bump_may_part():
    recording = bench("ur5", "tip_position").select(np.arange(30))
    clock = recording.time + np.where(np.arange(30) > 20, 1e5, 0.0)
    paused = at_other_times(recording, clock)
    parted = [[r.time > m for m in moments(r)] for r in (recording, paused)]
    np.testing.assert_array_equal(*parted)


def test_a_bump_is_found_where_it_was_whatever_pause_was_made(tmp_path):
    case = with_fault(
        faultless(rows=60, seed=4), Bumped(0.0, (1.0, -0.6, 0.8, 0.5, 1.0, 0.7), 0.2), gap=2.0
    )
    recording, _ = recorded(case, tmp_path)
    late = np.arange(60) >= 45
    found = diagnose(at_other_times(recording, recording.time + 3600.0 * late), FEW_EFFECTS)
    assert causes(found) == [("base_bump", None)]
    [effect] = found.effects
    true = recording.time[0] + 0.2 * np.ptp(recording.time)
    assert (recording.time > effect.moment).sum() == (recording.time > true).sum()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("cls", SCANNED, ids=lambda cls: cls.__name__)
def test_no_short_list_turns_away_what_has_been_chosen(cls, seed):
    """Beside itself it has nothing left to explain, so others come before it there."""
    quiet = bench(arm_of(cls), "tip_position")
    noise = np.random.default_rng(seed).normal(0.0, 1e-4, quiet.measured.shape)
    recording = replace(quiet, measured=quiet.measured + noise, noise_std=1e-4)
    variants = cls.candidates(scope_of(recording))
    chosen = variants[len(variants) // 3]
    model = build_model(recording, (chosen,), nuisance=nuisances_of(recording))
    folds = np.arange(len(recording)) % 5
    pool = make_pool(model, model.start, folds, NoisePrior.of(1e-4))
    [mine] = [k for k, c in enumerate(pool.candidates) if c.effect == chosen]
    assert pool.shortlists[-1, mine]
    others = [k for k, c in enumerate(pool.candidates) if isinstance(c.effect, cls) and k != mine]
    assert not pool.shortlists[:, others].all()


def strongly(chosen, strength=5.0, quiet=None):
    """A recording with some effects at so many times their usual size, and its model there."""
    quiet = quiet or bench("ur5", "tip_position")
    model = build_model(quiet, chosen, nuisance=nuisances_of(quiet))
    strong = model.start.copy()
    strong[model.fixed :] = strength * model.problem.scale[model.fixed :]
    shift = np.subtract(*(Mapped(model.problem).residuals(x) for x in (strong, model.start)))
    noise = np.random.default_rng(1).normal(0.0, 1e-4, shift.shape)
    recording = replace(quiet, measured=quiet.measured + shift + noise, noise_std=1e-4)
    return build_model(recording, chosen, nuisance=nuisances_of(recording)), strong


def arm_of(cls):
    """An arm that has joints of the kind."""
    return "laparoscopic" if cls is ScrewRipple else "ur5"


def listed_everywhere(chosen, arm="ur5"):
    """Whether every short list, on all folds or without one, holds every one of them."""
    model, strong = strongly(chosen, quiet=bench(arm, "tip_position"))
    pool = make_pool(model, strong, np.arange(60) % 5, NoisePrior.of(1e-4))
    mine = [k for k, c in enumerate(pool.candidates) if c.effect in chosen]
    assert len(mine) == len(chosen)
    return pool.shortlists[:, mine].all()


@pytest.mark.parametrize("cls", SCANNED, ids=lambda cls: cls.__name__)
def test_folds_that_see_for_themselves_list_what_has_been_chosen(cls):
    """A strong effect shows in every part of the rows; every fifth row left out hides none."""
    variants = cls.candidates(scope_of(bench(arm_of(cls), "tip_position")))
    assert listed_everywhere((variants[len(variants) // 3],), arm_of(cls))


def test_folds_list_all_strong_orders_of_a_gear_however_short_the_list(monkeypatch):
    monkeypatch.setattr(shortlists.prior, "MOST_COLUMNS", 12)
    assert listed_everywhere(tuple(GearRipple(joint=2, order=10.0 * k) for k in range(1, 10)))


@pytest.mark.parametrize("strength", [0.0, 5.0])
def test_a_fold_may_choose_finer_orders_where_it_lists_the_one_that_they_refine(strength):
    chosen = GearRipple(joint=2, order=20.0)
    model, strong = strongly((chosen,), strength)
    finer = chosen.neighbours(scope_of(model.recording))
    pool = make_pool(model, strong, np.arange(60) % 5, NoisePrior.of(1e-4))
    allowed = {c.effect: row for c, row in zip(pool.candidates, pool.shortlists.T, strict=True)}
    assert len(finer) == 5  # four orders near by, and with the overtone
    for variant in finer:
        np.testing.assert_array_equal(allowed[variant], allowed[chosen])
    assert allowed[chosen][:-1].all() == (strength > 0.0)


@pytest.mark.parametrize(("causes", "offered"), [(6, True), (7, False)])
def test_an_overtone_is_offered_where_chains_look_at_whole_states(causes, offered):
    chosen = [
        GearRipple(joint=2, order=20.0),
        *(JointOffset(joint=j + 1) for j in range(causes - 1)),
    ]
    finer = shortlists.nearby(chosen, bench("ur5", "tip_position"))[chosen[0]]
    assert any(variant.doubled for variant in finer) == offered


def test_no_fold_is_told_the_moment_of_a_bump_to_the_row():
    """Of many rows it is refined on all of them; in a stretch left out that would be the answer."""
    quiet = bench("ur5", "tip_position").select(np.arange(300) % 60)
    quiet = at_other_times(quiet, np.arange(300.0))
    on_grid = BaseBump.candidates(scope_of(quiet))
    [chosen, *_] = on_grid[40].neighbours(scope_of(quiet))
    model, strong = strongly((chosen,), quiet=quiet)
    pool = make_pool(model, strong, np.arange(300) // 60, NoisePrior.of(1e-4))
    bumps = [k for k, c in enumerate(pool.candidates) if isinstance(c.effect, BaseBump)]
    off_grid = [k for k in bumps if pool.candidates[k].effect not in on_grid]
    assert chosen not in on_grid
    assert pool.shortlists[-1, off_grid].all()
    assert not pool.shortlists[:-1, off_grid].any()
    assert pool.shortlists[:-1, bumps].any(axis=1).all()


def test_gross_rows_do_not_fill_the_short_lists(tmp_path):
    bump = Bumped(0.0, (1.0, -0.6, 0.8, 0.5, 1.0, 0.7), moment=0.6)
    recording, _ = recorded(with_fault(faultless(rows=45, seed=4), bump, gap=0.7), tmp_path)
    spoilt = recording.measured.copy()
    spoilt[10] += 40.0 * recording.noise_std
    found, _ = searched(replace(recording, measured=spoilt), FEW_EFFECTS.library)
    true = recording.time[0] + 0.6 * np.ptp(recording.time)
    after = int((recording.time > true).sum())
    listed = [
        int((recording.time > c.effect.moment).sum())
        for c, allowed in zip(found.pool.candidates, found.pool.shortlists[-1], strict=True)
        if isinstance(c.effect, BaseBump) and allowed
    ]
    assert after in listed
