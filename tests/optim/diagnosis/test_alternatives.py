"""Laws of what may be at work besides the causes: shares, noise of axes, shifts, projection."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import comb

from plumbline.experiments.reality.joint_effects import JointScale
from plumbline.experiments.reality.outside_effects import CrossRipple
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale as ModelledScale
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.constants import GRID
from plumbline.optim.diagnosis.discrepancy import design
from plumbline.optim.diagnosis.discrepancy.alternatives import (
    GrossRow,
    Unlisted,
    _log_shares,
    _shared_shift,
    alternatives,
    key_of,
    not_listed,
    rows_compared,
    spread_of_noise,
)
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence
from plumbline.optim.diagnosis.discrepancy.dependences import dependences
from plumbline.optim.diagnosis.discrepancy.functions import nearness
from plumbline.optim.diagnosis.discrepancy.listed import scale_of
from plumbline.optim.diagnosis.discrepancy.spectra import Spectrum
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.parts import apart
from plumbline.optim.diagnosis.prior import FULLEST, MOST_FAMILIES, REACHES, UNLISTED
from plumbline.optim.measurement.observation import build_model
from tests.explained import searched
from tests.simulated_cases import faultless, recorded, with_fault

N = 60
MOST_OF_AN_EFFECT = 12


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Where a search ends whose joint 2 has a wrong scale and whose row 8 is grossly off."""
    case = with_fault(faultless(rows=N, seed=5), JointScale(0.0, 2), gap=3.0)
    recording, _ = recorded(case, tmp_path_factory.mktemp("alternatives"))
    spoilt = recording.measured.copy()
    spoilt[[7, 30]] += 30.0 * recording.noise_std
    object.__setattr__(recording, "measured", spoilt)
    return searched(recording)[0]


@pytest.fixture(scope="module")
def asked(place):
    """What may be at work there."""
    return alternatives(place.pool, place.chosen, UNLISTED)


@pytest.fixture(scope="module")
def offered(place):
    """Ports and families there."""
    pool = place.pool
    rows = rows_compared(pool)
    ports = Ports.about(pool.model, pool.x, rows, pool.always)
    recording = pool.model.recording.select(rows)
    found = [f for f in dependences(recording, ports) if f.columns.any()]
    found += _shared_shift(recording.chain.placement(recording.q)[:, :3, :3], ports)
    return ports, found


def test_a_unit_at_a_port_moves_what_it_does_beside_all_candidates_at_their_nulls(place):
    model, x = place.pool.model, place.pool.x
    rows = np.arange(10)
    ports = Ports.about(model, x, rows)
    effects = [*(t.effect for t in model.terms), JointOffset(joint=2)]
    wide = build_model(model.recording, effects, nuisance=model.nuisance).problem
    J = next(Mapped(wide.on(wide.rows[rows])).jacobians(np.append(x, 0.0)))[2]
    np.testing.assert_allclose(ports.joint[1], J[..., -1], rtol=1e-9, atol=1e-12)
    assert (x != model.start)[model.fixed :].any()  # about what was found, not about nothing


# Shares


def of_none(term):
    return isinstance(term, Unlisted)


def unlisted_priors(asked):
    terms = zip(asked.problem.log_priors.tolist(), asked.problem.candidates, strict=True)
    return [log for log, term in terms if of_none(term)]


@pytest.mark.parametrize("unlisted", [0.02, 0.6])
def test_what_the_library_lacks_has_the_share_that_is_stated(unlisted, place, asked, monkeypatch):
    monkeypatch.setattr(design.prior, "MOST_FAMILIES", 1)
    other = alternatives(place.pool, place.chosen, unlisted)
    library = np.exp(place.pool.selection.log_priors)
    ours = np.exp(other.problem.log_priors[: asked.library])
    np.testing.assert_allclose(ours, library * (1 - unlisted))
    [one] = unlisted_priors(other)
    lacked = np.array(unlisted_priors(asked)) - np.log(UNLISTED)
    assert np.isclose(one - np.log(unlisted), lacked).any()
    assert (asked.problem.log_priors[asked.problem.gross] == -np.inf).all()


def test_all_that_the_library_lacks_shares_one(offered):
    """A shift of chosen rows has but its part of all choices of as many rows."""
    _, found = offered
    assert np.exp(_log_shares(found)).sum() == pytest.approx(1.0, rel=0.1)


def test_half_the_odds_of_a_joint_s_dependence_are_of_what_is_as_simple_as_an_effect(offered):
    _, found = offered
    kinds = [("joint", on) for on in ("own angle", "load", "direction")]
    for stage, on in (*kinds, ("link", "load")):
        own = [f for f in found if (f.stage, f.on, f.element) == (stage, on, 2)]
        simple = [f for f in own if len(f.columns) <= 2]
        assert np.exp([f.log_prior for f in simple]).sum() == pytest.approx(0.5)
        assert min(len(f.columns) for f in simple) == 1


def test_what_the_library_lists_it_does_not_lack(place, offered):
    """A joint's scale is lacked where it is not listed; other forms have its share where it is."""
    ports, found = offered
    short = [c for c in place.pool.candidates if c.effect.name != "joint_scale"]
    without = replace(place.pool, candidates=tuple(short))
    angle = about_joint_2(found)[1]
    kept = [not_listed(pool, ports, found) for pool in (place.pool, without)]
    lacked = [any(np.array_equal(f.columns, angle.columns) for f in fs) for fs in kept]
    assert lacked == [False, True]
    for families in kept:
        shares = [f.log_prior for f in families if (f.on, f.element) == ("own angle", 2)]
        assert np.exp(shares).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("on", "name"), [("load", "joint_compliance"), ("direction", "backlash")])
def test_what_each_joint_does_as_listed_all_together_do_not_lack(on, name, place, offered):
    """Nor if alike, but the other way; of one joint that is not listed nobody knows."""
    ports, found = offered
    short = [c for c in place.pool.candidates if (c.effect.name, c.effect.element) != (name, 3)]
    without = replace(place.pool, candidates=tuple(short))

    def of_all(pool):
        kept = not_listed(pool, ports, found) if pool else found
        return [f.limits for f in kept if (f.stage, f.on, f.element) == ("joint", on, None)]

    assert of_all(None) == of_all(without) == [(), ()]
    (limits,) = of_all(place.pool)
    assert limits in [((0.0, np.inf),), ((-np.inf, 0.0),)]


def test_the_other_side_of_an_effect_of_one_side_is_listed_nowhere(place, offered):
    """A drive yields to its load: one that rises against it, as under a balancer, is lacked."""
    ports, found = offered
    yields = next(
        c for c in place.pool.candidates
        if (c.effect.name, c.effect.element) == ("joint_compliance", 2)
    )  # fmt: skip
    column = ports.base.reshape(len(ports.base), -1)[yields.columns[0]]
    rises = [
        f for f in not_listed(place.pool, ports, found)
        if (f.stage, f.on, f.element) == ("joint", "load", 2) and f.limits
    ]  # fmt: skip
    (f,) = [f for f in rises if abs(np.corrcoef(f.columns.ravel(), column)[0, 1]) > 0.99]
    assert yields.limits[0, 0] == 0.0
    other = (-np.inf, 0.0) if f.columns.ravel() @ column > 0.0 else (0.0, np.inf)
    assert f.limits == (other,)
    (whole,) = [g for g in found if g.words == f.words and np.array_equal(g.columns, f.columns)]
    of = [g.log_prior for g in found if (g.stage, g.on, g.element) == ("joint", "load", 2)]
    assert np.exp(f.log_prior) >= 0.5 * np.exp(whole.log_prior)
    assert np.exp(of).sum() == pytest.approx(1.0)


@pytest.fixture(scope="module")
def seen(place, offered):
    """What tells how large columns (k, N, m) are beyond the nuisances there."""
    pool, ports = place.pool, offered[0]
    shared = Linear.about(pool.shared, pool.x, pool.model.problem.scale)
    return design.FamilyDesign.of(ports, np.ones(3), shared, pool, rows_compared(pool))


def nearly(columns, off, seen):
    """Columns (1, N, m) with a share that is anything else."""
    more = np.random.default_rng(0).normal(size=columns.shape)
    return columns + off * seen.visible(columns) / seen.visible(more) * more


@pytest.mark.parametrize(("off", "lacked"), [(0.02, False), (0.05, True)])
def test_a_form_is_a_listed_effect_to_three_hundredths_of_it(place, offered, seen, off, lacked):
    ports, found = offered
    angle = about_joint_2(found)[1]
    form = replace(angle, columns=nearly(angle.columns, off, seen))
    assert bool(not_listed(place.pool, ports, [form])) is lacked


@pytest.mark.parametrize(("off", "gone"), [(0.02, True), (0.05, False)])
@pytest.mark.parametrize("beside", [False, True])
def test_of_a_deviation_goes_what_is_the_device_s_scale_to_as_much(
    place, offered, seen, off, gone, beside
):
    """Alone, or together with what it deviates from; whatever else is listed there."""
    scale = scale_of(place.pool, offered[0])
    other, more = np.random.default_rng(1).normal(size=(2, 2, *scale.shape)) * np.abs(scale).max()
    alike = nearly(scale[None], off, seen)
    block = np.concatenate([alike - other[:1] if beside else alike, other[1:]])
    left = seen.without(other[:1], np.stack([*more, scale]))(block)
    assert (seen.visible(left[:1]) < 0.1 * seen.visible(block[:1])) is gone
    assert seen.visible(left[1:]) > 0.9 * seen.visible(block[1:])


def held(block, one, seen):
    """The share of columns (k, N, m) in the span of which one (N, m) lies, nuisances apart."""
    span, flat = seen._seen(block).T, seen._seen(one[None])[0]
    left = flat - span @ np.linalg.lstsq(span, flat, rcond=1e-10)[0]
    return 1.0 - float(np.sum(left**2) / np.sum(flat**2))


def test_no_deviation_is_what_another_listed_effect_does(place, asked, offered, seen):
    """What is nearly a listed effect and is it beside another one is both of them."""
    base, near = offered[0].base, 0
    for term in asked.problem.candidates:
        if not of_none(term) or not term.family.words.startswith("nearly as"):
            continue
        family, own = term.family, term.family.words.split()[2]
        for c in place.pool.candidates:
            at = (str(c.effect.stage), c.effect.element) == (family.stage, family.element)
            if at and c.effect.name != own and not c.effect.scanned:
                assert max(held(family.columns, base[k], seen) for k in c.columns) < 1 - 1e-6
                near += 1
    assert near > 50


def test_what_depends_on_angle_and_load_is_about_its_mean(offered, seen):
    """As what depends on the angle alone: with a constant one term would be a zero besides."""
    ports, found = offered
    own = [f for f in found if (f.on, f.element) == ("own angle and load", 3)]
    zero = ports.joint[2]
    assert [held(f.columns, zero, seen) < 0.9 for f in own] == [True]


def about_joint_2(found):
    """The forms of its own angle that have one column: a constant, and the angle."""
    own = [f for f in found if (f.on, f.element) == ("own angle", 2)]
    return [f for f in own if len(f.columns) == 1]


def test_a_fifth_is_the_share_of_what_the_library_lacks():
    assert 0.1 < UNLISTED < 0.4


def test_every_kind_of_dependence_is_as_likely_as_any_other_then_its_elements():
    def family(on, element, log_prior=0.0):
        return Dependence("words", on, "joint", element, np.ones((1, 1, 1)), log_prior)

    half = -np.log(2.0)
    found = [
        family("own angle", 1, half),
        family("own angle", 1, half),
        family("own angle", 2),
        family("time", None),
    ]
    np.testing.assert_allclose(np.exp(_log_shares(found)), [0.125, 0.125, 0.25, 0.5])


def test_labels_say_stage_element_dependence_and_effect(asked):
    for i, term in enumerate(asked.problem.candidates):
        label, at, _, odd = (int(level[i]) for level in asked.problem.labels)
        mechanism = asked.mechanisms[label]
        assert asked.places[at] == mechanism[:2]
        assert asked.term(i) is term
        if isinstance(term, Candidate | Spectrum):
            assert key_of(mechanism) == (term.effect.name, term.effect.element)
            assert mechanism[2] == term.effect.depends_on
        else:
            assert key_of(mechanism) is None
            assert odd == of_none(term)
    assert set(asked.gross_rows) == {7, 30}


# Noise of axes


@pytest.mark.parametrize(
    ("sizes", "alike"),
    [((1.0, 1.0, 1.0), True), ((1.0, 1.15, 0.9), True), ((1.0, 3.0, 1.0), False)],
)
def test_axes_have_noise_of_their_own_where_the_rows_say_so(sizes, alike):
    r = np.random.default_rng(1).normal(size=(200, 3)) * sizes
    gross, live = np.zeros(200, dtype=bool), np.ones(r.shape, dtype=bool)
    ports = SimpleNamespace(target=r, base=np.zeros((0, 200, 3)), gross=gross, live=live)
    pool = SimpleNamespace(noise=NoisePrior(), columns=lambda _: np.arange(0))
    found = spread_of_noise(pool, (), ports)
    if alike:
        np.testing.assert_array_equal(found, 1.0)
    else:
        expected = np.array(sizes) / np.sqrt(np.mean(np.square(sizes)))
        np.testing.assert_allclose(found, expected, rtol=0.1)


@pytest.mark.parametrize("alike", [True, False])
def test_an_axis_is_noisier_only_where_no_mechanism_explains_it_better(alike):
    """By 50 log odds the axes differ here, or so."""
    r = np.random.default_rng(1).normal(size=(200, 3)) * [1.0, 3.0, 1.0]
    gross, live = np.zeros(200, dtype=bool), np.ones(r.shape, dtype=bool)
    ports = SimpleNamespace(target=r, base=np.zeros((0, 200, 3)), gross=gross, live=live)
    pool = SimpleNamespace(noise=NoisePrior(), columns=lambda _: np.arange(0))
    better = 1e3 if alike else 10.0
    found = spread_of_noise(pool, (), ports, lambda spread: better if (spread == 1).all() else 0.0)
    assert (found == 1.0).all() == alike


# One shift of several rows


def shifted(rows, R=None):
    gross = np.zeros(N, dtype=bool)
    gross[list(rows)] = True
    R = np.tile(np.eye(3), (N, 1, 1)) if R is None else R
    body = np.tile(np.eye(3)[:, None, :], (1, N, 1))
    ports = SimpleNamespace(gross=gross, shift=np.zeros((3, N, 3)), body=body)
    return R, _shared_shift(R, ports)


def test_rows_of_one_shift_are_named_from_one_and_are_one_choice_of_many():
    _, [found] = shifted([0, 4])
    assert found.words == "rows 2, 6: one shift of the tool explains them"
    assert (found.stage, found.on) == ("tool", "moment")
    assert np.exp(found.log_prior) == pytest.approx(1.0 / comb(N, 2))


def test_a_shift_turns_with_the_tool_and_moves_no_other_row():
    from scipy.spatial.transform import Rotation

    R = Rotation.random(N, rng=np.random.default_rng(0)).as_matrix()
    _, [found] = shifted([2, 9, 40], R)
    ratio = found.columns[:, 9] / np.linalg.norm(found.columns[0, 9])
    np.testing.assert_allclose(ratio, R[9].T, atol=1e-12)
    assert not np.delete(found.columns, [2, 9, 40], axis=1).any()


def test_one_row_alone_shares_no_shift():
    assert shifted([3])[1] == []
    assert shifted([])[1] == []


# The linear problem


def test_the_linear_problem_is_what_least_squares_leaves_of_nuisances(place, asked, offered):
    """Every column and the target, against residuals of dense least squares on the nuisances."""
    pool = place.pool
    ports, _ = offered
    found = [t.family for t in asked.problem.candidates if of_none(t)]
    spread = spread_of_noise(pool, place.chosen, ports)
    blocks = [ports.base, *(f.columns for f in found)]
    flat = [(block / spread).reshape(len(block), -1) for block in blocks]
    nuisances, target = flat[0][: pool.always].T, (ports.target / spread).ravel()
    families = np.concatenate(flat[1:]).T
    left = families - nuisances @ np.linalg.lstsq(nuisances, families, rcond=None)[0]
    rest = target - nuisances @ np.linalg.lstsq(nuisances, target, rcond=None)[0]
    linear = asked.problem.linear
    columns = np.concatenate([t.columns for t in asked.problem.candidates if of_none(t)])
    size = np.linalg.norm(left, axis=0)
    kept = size > 1e-6 * size.max()
    size, columns, left = size[kept], columns[kept], left[:, kept]
    error = (linear.G[np.ix_(columns, columns)] - left.T @ left) / np.outer(size, size)
    assert np.abs(error).max() < 1e-5
    error = linear.b[columns] - left.T @ rest
    assert np.abs(error).max() < 1e-5 * size.max() * np.linalg.norm(rest)
    assert linear.tt == pytest.approx(rest @ rest, rel=1e-6)


@pytest.mark.parametrize(
    ("on", "other", "beside", "elsewhere"),
    [
        ("own angle", "two angles", 0, 2),
        ("own angle", "own angle and direction", 0, 2),
        ("own angle", "own angle, across the axis", 0, 2),
        ("own angle", "own angle, locally", 0, 2),
        ("moment", "time", 0, 1),
        ("load", "load, mounted otherwise", 0, 1),
        ("another joint's angle", "own angle", 1, 2),
        ("nothing", "angle", 1, 2),
        ("direction", "own angle and direction", 0, 1),
        ("velocity", "direction", 0, 1),
        ("history", "direction", 0, 1),
        ("temperature", "time", 0, 1),
        ("place", "place, locally", 0, 1),
        ("load", "own angle and load", 0, 1),
        ("load", "time", 1, 2),
    ],
)
def test_mechanisms_differ_in_place_and_in_what_drives_them(on, other, beside, elsewhere):
    """A joint's angle is its own; what drives it else may drive others."""
    one, near, far = (("joint", j, word, None) for j, word in ((1, on), (1, other), (2, other)))
    assert apart([one, near, far])[0].tolist() == [0, beside, elsewhere]
    assert (apart([one, near, far]) == apart([one, near, far]).T).all()


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_what_a_joint_may_do_is_gone_where_it_moves_nothing_and_what_others_do_is_not(asked, joint):
    """Whatever it does, row by row; of a place that may move anything nothing is left."""
    problem = asked.problem
    rest = problem.shared.beyond(frozenset({asked.places.index(("joint", joint))}))
    none = problem.shared.beyond(frozenset({asked.places.index(("sensor", None))}))
    before, after, last = (np.diag(each.G) for each in (problem.linear, rest, none))
    others = []
    for term in problem.candidates[: asked.library]:
        seen = before[term.columns].sum()
        left = after[term.columns].sum() / max(seen, 1e-300)
        if (str(term.effect.stage), term.effect.element) == ("joint", joint):
            assert left < 1e-9
        elif seen and term.effect.name == "joint_scale":
            others.append(left)
        assert last[term.columns].sum() <= 1e-9 * seen
    assert np.median(others) > 0.1  # of joints whose axes meet there, nothing
    assert rest.n == pytest.approx(problem.linear.n - 2 * len(asked.rows), abs=6)


def test_a_gross_row_s_columns_move_that_row_alone(place, asked):
    [number] = asked.gross_rows[7]
    term = asked.problem.candidates[number]
    assert isinstance(term, GrossRow)
    assert len(term.columns) == 3


# The first look


def test_families_that_go_on_include_the_best(tmp_path, monkeypatch):
    fault = CrossRipple(0.0, 2, 3, order=0.0, mesh=2.0, phase=0.4)
    recording, _ = recorded(with_fault(faultless(rows=60, seed=2), fault), tmp_path)
    selected = searched(recording, [ModelledScale])[0]
    monkeypatch.setattr(design.prior, "MOST_FAMILIES", 1)
    found = alternatives(selected.pool, selected.chosen, UNLISTED)
    [only] = [t.family for t in found.problem.candidates if of_none(t)]
    assert only.words == "joint 2's error depends on joint 3's angle"


def test_no_more_families_go_on_than_may(asked):
    assert len(unlisted_priors(asked)) == MOST_FAMILIES


def test_columns_of_a_family_are_its_leading_ones(asked):
    """And of what resembles an effect as many besides the effect's own."""
    found = [t for t in asked.problem.candidates if of_none(t)]
    alike = [t for t in found if t.family.words.startswith("nearly as")]
    assert max(len(t.columns) for t in found if t not in alike) <= FULLEST
    assert alike
    assert max(len(t.columns) for t in alike) <= FULLEST + MOST_OF_AN_EFFECT


# A smooth function of an angle


@pytest.mark.parametrize("reach", REACHES)
def test_what_is_near_errs_alike_and_what_is_far_does_not(reach):
    """The process has the squared-exponential covariance that it states."""
    angle = np.random.default_rng(0).uniform(-2.0, 2.0, 80)
    features = nearness(angle, reach)
    wanted = np.exp(-0.5 * ((angle[:, None] - angle) / reach) ** 2)
    np.testing.assert_allclose(features.T @ features, wanted, atol=0.06)


def test_reaches_run_from_a_few_teeth_to_a_quarter_turn():
    assert min(REACHES) < 0.3
    assert max(REACHES) > 1.2
    assert GRID * min(REACHES) > 2 * np.pi
