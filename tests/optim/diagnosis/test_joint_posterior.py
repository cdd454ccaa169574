"""Laws of the joint posterior: on problems small enough to add up, chains find what sums say."""

from dataclasses import replace
from itertools import combinations, product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logit, logsumexp

import plumbline.optim.diagnosis.posterior.one_by_one as one_by_one_module
from plumbline.optim.diagnosis.discrepancy.alternatives import GrossRow
from plumbline.optim.diagnosis.posterior import joint
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.joint import sample
from plumbline.optim.diagnosis.posterior.joint_problem import (
    JointProblem,
    Parts,
    log_slot,
    stated,
)
from plumbline.optim.diagnosis.posterior.one_by_one import best_near, coarsened
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import added_evidence
from plumbline.optim.diagnosis.prior import (
    DEVIATIONS,
    DISPLACED,
    FIRST_SLOT_ODDS,
    GROSS_ODDS,
    LEAST_NAMED,
    LEAST_TOLD,
    LOG_SCALE_WEIGHTS,
    MOVES,
    NEXT_SLOT_ODDS,
    PART_OF_UNLISTED,
    SCALES,
)
from tests.designs import candidates, statistics

N, SIGMA = 30, 0.1
SEEDS = (1,)
STARTS = (frozenset[int](), frozenset[int]({0}))


def one_by_one(asked, state):
    """About a long state, by all that the rows say."""
    return coarsened(asked, state, 1.0, 0)


def drawn(seed, count=7, strength=5.0, causes=2, mixed=0.4):
    """Correlated columns (N, count), each of which usually moves the rows so many sigma in all."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(N, count)) @ (np.eye(count) + mixed * rng.normal(size=(count, count)))
    X *= strength * SIGMA / np.linalg.norm(X, axis=0)
    z = np.zeros(count)
    z[:causes] = rng.choice([-1.0, 1.0], causes)
    return X, X @ z + rng.normal(0.0, SIGMA, N)


def problem(X, t, sizes=None, rows=(), labels=None, noise=None, width=30.0):
    """The joint problem of columns X (N, P), and of some rows that may be gross.

    Args:
        X: Columns.
        t: What they are to explain (N,).
        sizes: How many columns each term has; one each if not given.
        rows: Rows that may be gross.
        labels: Of the terms (L, C); each its own, and whether it is odd, if not given.
        noise: The prior of the noise; known if not given.
        width: Of a row's displacement at its usual size [sigma].
    """
    sizes = sizes or [1] * X.shape[1]
    own = np.zeros((N, len(rows)))
    own[list(rows), np.arange(len(rows))] = width * SIGMA
    listed = candidates(sizes)
    gross = [GrossRow(r, np.array([X.shape[1] + k])) for k, r in enumerate(rows)]
    count = len(listed) + len(gross)
    if labels is None:
        labels = np.array([np.arange(count), np.arange(count) % 2])
    return JointProblem(
        statistics(np.hstack([X, own]), t),
        (*listed, *gross),
        noise or NoisePrior(SIGMA, 1e9),
        np.array([c.log_prior for c in listed] + [-np.inf] * len(gross)),
        np.arange(count) >= len(listed),
        np.asarray(labels),
    )


def by_enumeration(asked, most=4):
    """Marginals of every label and of every gross row, of all sets with so many terms or fewer.

    The noise is known. The widths of all terms of a set are summed over their grids together.
    """
    G, b = asked.linear.G / SIGMA**2, asked.linear.b / SIGMA**2
    logs, sets = [], []
    for size in range(most + 1):
        for chosen in combinations(range(len(asked.candidates)), size):
            mine = [i for i in chosen if not asked.gross[i]]
            log = (size - len(mine)) * np.log(GROSS_ODDS / (1 - GROSS_ODDS))
            log += asked.log_priors[mine].sum()
            # Of a geometric number of causes: k of them may be drawn in k! orders.
            slots = [FIRST_SLOT_ODDS, *(NEXT_SLOT_ODDS * k for k in range(1, most))]
            log += np.log(slots[: len(mine)]).sum()
            logs.append(log + _evidence(G, b, [asked.candidates[i].columns for i in chosen]))
            sets.append(chosen)
    weights = np.exp(np.array(logs) - logsumexp(logs))
    found = [np.zeros(size) for size in asked.sizes]
    gross = np.zeros(len(asked.candidates))
    for weight, chosen in zip(weights, sets, strict=True):
        mine = [i for i in chosen if not asked.gross[i]]
        gross[[i for i in chosen if asked.gross[i]]] += weight
        for level, total in zip(asked.labels, found, strict=True):
            total[np.unique(level[mine])] += weight
        for i in mine:
            found[0][asked.labels[0][i]] -= _part(asked, i, mine) * weight
    return found, gross


def _part(asked, term, mine):
    """Of a listed term beside unlisted ones; none of one elsewhere than which they are far less."""
    if asked.unlisted is None or asked.unlisted[term]:
        return 0.0
    lacked = [i for i in mine if asked.unlisted[i]]
    if not lacked:
        return 0.0
    part = asked.shared.prior ** asked.shared.apart[term, lacked].min()
    if any(asked.labels[1][i] == asked.labels[1][term] for i in lacked):
        return part
    G, b = asked.linear.G[np.ix_(mine, mine)], asked.linear.b[mine]
    z = np.linalg.solve(G + SIGMA**2 * np.eye(len(mine)), b)
    of = [mine.index(term)], [mine.index(i) for i in lacked]
    own, whole = (z[k] @ G[np.ix_(k, k)] @ z[k] for k in of)
    return part * (np.sqrt(own) * DEVIATIONS[0] <= np.sqrt(whole))


def parts(places, beyond=None, driven=False):
    """What tells parts of terms at these places, each driven by its own or all of them alike."""
    at, nothing = np.array(places), statistics(np.zeros((N, len(places))), np.zeros(N))
    apart = (at[:, None] != at).astype(int) + (not driven)
    return Parts(PART_OF_UNLISTED, apart, beyond or (lambda _: nothing))


def _evidence(G, b, columns):
    """Log Bayes factor of some terms against none, their widths summed."""
    if not columns:
        return 0.0
    at = np.concatenate(columns)
    sizes = [len(c) for c in columns]
    s = np.array([np.repeat(w, sizes) for w in product(SCALES, repeat=len(sizes))])
    weights = [sum(w) for w in product(LOG_SCALE_WEIGHTS, repeat=len(sizes))]
    A = np.eye(len(at)) + s[:, :, None] * G[np.ix_(at, at)] * s[:, None, :]
    pulled = s * b[at]
    fit = 0.5 * np.sum(pulled * np.linalg.solve(A, pulled[..., None])[..., 0], axis=1)
    return logsumexp(fit - 0.5 * np.linalg.slogdet(A)[1] + weights)


# Against the sum of all sets


@pytest.mark.parametrize(("seed", "strength"), [(0, 3.0), (1, 6.0)])
def test_what_chains_find_is_what_all_sets_add_up_to(seed, strength):
    asked = problem(*drawn(seed, strength=strength))
    found, expected = sample(asked, STARTS, seed), by_enumeration(asked)[0]
    for ours, theirs in zip(found.marginals, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=0.01)


@pytest.mark.parametrize(
    ("of_place", "first", "seed"), [(np.arange(7) // 2, 1, 0), (np.arange(7), 0, 1)]
)
def test_beside_what_is_unlisted_a_listed_term_may_be_a_part_of_it(of_place, first, seed):
    """Chains and the sum of all sets take it for that with the same probability, and it matters."""
    plain = problem(*drawn(seed, strength=6.0), labels=[np.arange(7), of_place])
    asked = replace(plain, unlisted=np.arange(7) % 2 == first, shared=parts(of_place))
    found, expected = sample(asked, STARTS, seed), by_enumeration(asked)[0]
    for ours, theirs in zip(found.marginals, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=0.01)
    assert np.abs(expected[0] - by_enumeration(plain)[0][0]).max() > 0.1


@pytest.mark.parametrize("asked_how", [sample, one_by_one])
@pytest.mark.parametrize(
    ("places", "driven", "size", "part"),
    [
        ([0, 0], True, 8.0, 1.0),
        ([0, 0], False, 8.0, PART_OF_UNLISTED),
        ([0, 1], True, 2.0, PART_OF_UNLISTED),
        ([0, 1], False, 2.0, PART_OF_UNLISTED**2),
        ([0, 1], True, 8.0, 0.0),
    ],
)
def test_the_more_a_term_shares_with_what_is_unlisted_the_more_it_is_a_part_of_it(
    asked_how, places, driven, size, part
):
    """However plain both are, unless it is far larger elsewhere; its place is as sure as ever."""
    start = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]
    places = [*places, *range(2, 7)]
    X, _ = drawn(0, strength=40.0, mixed=0.1)
    t = size * X[:, 0] + X[:, 1] + np.random.default_rng(0).normal(0.0, SIGMA, N)
    plain = problem(X, t, labels=[np.arange(7), places])
    asked = replace(plain, unlisted=np.arange(7) == 1, shared=parts(places, None, driven))
    first = asked_how(asked, STARTS, 0) if asked_how is sample else asked_how(asked, start)
    assert first.marginals[0][0] == pytest.approx(1.0 - part, abs=0.05)
    assert first.marginals[1][0] > 0.95


def elsewhere(moves, driven=False):
    """A listed term and an unlisted one of another place, which moves half of the rows."""
    X, _ = drawn(0, strength=40.0, mixed=0.0)
    there = np.arange(N) < N // 2  # what the unlisted mechanism's place can move
    X[~there, 1] = 0.0
    X[there if moves == "elsewhere" else ~there, 0] *= 0.1 if moves == "hardly elsewhere" else 0.0
    t = X[:, 0] + X[:, 1] + np.random.default_rng(0).normal(0.0, SIGMA, N)
    if moves == "hardly elsewhere":  # where less is seen of it than chance may hide
        t[~there] -= X[~there, 0]
    plain = problem(X, t, labels=[np.arange(7), np.arange(7)])
    rest = statistics(X[~there], t[~there])
    shared = parts(np.arange(7), lambda _: rest, driven)
    return replace(plain, unlisted=np.arange(7) == 1, shared=shared)


@pytest.mark.parametrize("asked_how", [sample, one_by_one])
@pytest.mark.parametrize(
    ("moves", "driven", "part"),
    [
        ("elsewhere", False, 0.0),
        ("elsewhere", True, 0.0),
        ("there", False, PART_OF_UNLISTED**2),
        ("there", True, PART_OF_UNLISTED),
        ("hardly elsewhere", False, PART_OF_UNLISTED**2),
    ],
)
def test_what_speaks_for_a_cause_where_the_unlisted_moves_nothing_makes_it_no_part(
    asked_how, moves, driven, part
):
    asked, start = elsewhere(moves, driven), [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]
    first = asked_how(asked, STARTS, 0) if asked_how is sample else asked_how(asked, start)
    assert first.marginals[0][0] == pytest.approx(1.0 - part, abs=0.05)


def test_what_the_rest_of_the_rows_says_counts_by_the_likelihood_s_power():
    """As if all rows had been worth that share from the first on: then it is open again."""
    asked, power = elsewhere("elsewhere"), 1e-4
    rest = asked.shared.beyond(frozenset({1})).share(power)
    log = asked.conditional([0], rest)(frozenset({0}))
    [part] = asked.share(power).parts([0, 1]).values()
    assert logit(part) == pytest.approx(logit(PART_OF_UNLISTED**2) - max(log, 0.0))
    assert asked.parts([0, 1])[0] < 1e-6 < 0.1 < part


@pytest.mark.parametrize("size", [0.6, 0.001, 1e-6])
def test_the_least_states_are_not_asked_for_parts_and_have_them_as_the_others_do(size):
    asked = []
    shared = SimpleNamespace(of=lambda _, s: asked.append(s) or ({0: 0.25} if 0 in s else {}))
    some = replace(problem(*drawn(3)), unlisted=np.arange(7) == 1, shared=shared)
    states = [frozenset(k) for n in range(1, 7) for k in combinations(range(7), n)]
    weights = np.random.default_rng(0).permutation(0.9 ** np.arange(len(states)))
    weights *= size / weights.sum()
    found = some.as_parts(states, weights)
    held = sum(weights[states.index(s)] for s in asked)
    np.testing.assert_allclose(found[1:], 0.0)
    least = LEAST_TOLD * max(size, LEAST_TOLD)
    assert size - least <= held <= max(size - 0.5 * least, 0.0)
    assert found[0] == pytest.approx(0.25 if size > least else 0.0)


def test_nothing_is_a_part_of_what_is_unlisted_more_often_than_it_is_beside_it():
    """Its probability was less than nought where the least states, not asked, lack it."""
    shared = SimpleNamespace(of=lambda _, state: {0: 1.0} if 0 in state else {})
    some = replace(problem(*drawn(3)), unlisted=np.arange(7) == 1, shared=shared)
    least = LEAST_TOLD / 8
    shares = {(0, 1): 0.5, (1,): 0.5, (1, 2): least, (1, 3): least, (1, 4): least}
    seen = {frozenset(state): float(np.log(share)) for state, share in shares.items()}
    assert joint._marginals(some, seen)[0][0][0] == pytest.approx(0.0, abs=1e-15)
    assert joint._marginals(some, seen)[0][0].min() >= 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_terms_of_several_columns_and_gross_rows_are_in_the_same_sum(seed):
    X, t = drawn(seed, count=6, causes=1)
    t[4] += 4.0 * SIGMA
    t[20] += 2.5 * SIGMA
    asked = problem(X, t, sizes=[1, 1, 2, 2], rows=(4, 20), width=3.0)
    found = sample(asked, STARTS, seed)
    expected, gross = by_enumeration(asked)
    for ours, theirs in zip(found.marginals, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=0.02)
    np.testing.assert_allclose(found.gross, gross, atol=0.02)


# The chains


@pytest.mark.parametrize("seed", SEEDS)
def test_two_seeds_and_two_starts_agree(seed):
    asked = problem(*drawn(seed))
    one, two = (sample(asked, STARTS, s) for s in (1, 2))
    for first, second in zip(one.marginals, two.marginals, strict=True):
        np.testing.assert_allclose(first, second, atol=0.02)
    assert max(one.apart, two.apart) < 0.02


def test_chains_go_on_until_seeds_agree_on_many_that_resemble_one_another():
    """Twelve columns, correlated, four at work: ten moves a chain would leave a tenth to luck."""
    asked = problem(*drawn(5, count=12, causes=4, mixed=0.7))
    few, enough = (
        np.ptp([sample(asked, STARTS, s, moves).marginals[0] for s in (1, 2, 3)], axis=0).max()
        for moves in (10, MOVES)
    )
    assert few > 0.05
    assert enough < 0.01


def test_chains_that_find_different_things_say_so():
    asked = problem(*apart())
    cut_short = sample(asked, [frozenset({0, 1}), frozenset({2, 3})], 0, moves=0)
    assert cut_short.apart > 0.9
    np.testing.assert_allclose(cut_short.marginals[0], 0.5, atol=0.02)


def apart():
    """Two pairs of columns, each of which together is the target, and no single one is."""
    s, u, v = 20.0 * SIGMA * np.linalg.qr(np.random.default_rng(4).normal(size=(N, 3)))[0].T
    return np.stack([s + 3 * u, s - 3 * u, s + 3 * v, s - 3 * v], axis=1) / 2.0, s


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("unlisted", [False, True])
def test_chains_cross_from_one_term_to_two_that_together_do_as_well(seed, unlisted):
    """Of the two neither goes in alone, and none of them fills the place of the one."""
    X, _ = drawn(2, count=4, mixed=0.0, strength=15.0)
    t = X[:, 0] + X[:, 1] + np.random.default_rng(1).normal(0.0, SIGMA, N)
    X[:, 2] = X[:, 0] + X[:, 1] + 0.2 * X[:, 2]
    asked, one = problem(X, t), frozenset({2})
    expected = by_enumeration(asked)[0][0]
    if unlisted:
        asked = replace(asked, unlisted=np.arange(4) == 2)
    assert 0.05 < expected[:2].min() < expected[:3].max() < 0.95
    np.testing.assert_allclose(sample(asked, [one], seed).marginals[0], expected, atol=0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_one_for_two_and_two_for_one_are_as_often_as_the_posterior_has_them(seed):
    """By these moves alone a chain is in every state as often as that is probable."""
    asked = problem(*drawn(seed, count=4, strength=3.0))
    asked = replace(asked, log_priors=asked.log_priors + 3.0)  # states of two and three count
    rng = np.random.default_rng(seed)
    chain = joint.MarkovChain(asked, rng, frozenset({0}), {})
    states = [frozenset(s) for k in (1, 2, 3, 4) for s in combinations(range(4), k)]
    been = dict.fromkeys(states, 0)
    for _ in range(20000):
        mine = sorted(chain.state)
        chain._part(mine) if rng.random() < 0.5 else chain._join(mine)
        been[chain.state] += 1
    logs = np.array([joint.look_at(asked, s).log_posterior for s in states])
    share = np.array([*been.values()]) / 20000
    np.testing.assert_allclose(share, np.exp(logs - logsumexp(logs)), atol=0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_names_and_order_of_the_terms_change_no_probability(seed):
    X, t = drawn(seed)
    order = np.random.default_rng(9).permutation(X.shape[1])
    plain, mixed = (sample(problem(columns, t), [STARTS[0]], 0) for columns in (X, X[:, order]))
    np.testing.assert_allclose(mixed.marginals[0], plain.marginals[0][order], atol=0.02)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_units_change_no_probability(unit):
    X, t = drawn(0)
    plain = sample(problem(X, t), STARTS, 0)
    other = sample(problem(unit * X, unit * t, noise=NoisePrior(unit * SIGMA, 1e9)), STARTS, 0)
    for ours, theirs in zip(other.marginals, plain.marginals, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_a_state_has_no_more_terms_than_there_are_equations():
    X, t = drawn(0, strength=50.0, causes=7)
    asked = problem(X, t)
    few = replace(asked, linear=replace(asked.linear, n=3.0))
    assert max(map(len, sample(asked, STARTS, 0).seen)) == 7
    assert max(map(len, sample(few, STARTS, 0).seen)) == 3


def test_what_any_term_of_a_place_explains_is_sure_though_no_term_is():
    """Two columns that hardly differ share what is there; their place has all of it."""
    X, _ = drawn(0, count=4, strength=10.0, mixed=0.0)
    X[:, 1] = X[:, 0] + 0.01 * X[:, 1]
    t = X[:, 0] + np.random.default_rng(1).normal(0.0, SIGMA, N)
    labels = np.array([[0, 1, 2, 3], [0, 0, 1, 1]])
    found = sample(problem(X, t, labels=labels), STARTS, 0)
    assert found.marginals[0][:2] == pytest.approx([0.5, 0.5], abs=0.1)
    assert found.marginals[1][0] > 0.99


def test_where_nothing_is_at_work_the_prior_odds_are_left():
    """Rows that say nothing of the terms leave the odds of a slot, shared alike."""
    asked = problem(1e-9 * drawn(0)[0], np.zeros(N))
    found = sample(asked, STARTS, 0)
    alone = FIRST_SLOT_ODDS / 7 / (1 + FIRST_SLOT_ODDS)
    assert found.marginals[0] == pytest.approx(np.full(7, alone), rel=0.15)


def test_prior_odds_three_times_as_high_say_how_much_hangs_on_them():
    """Of one term alone, whose odds the tilt multiplies by three, or divides."""
    X, _ = drawn(0, count=1, causes=0)
    asked = problem(X, 0.5 * X[:, 0], labels=[[0], [0]])
    found = sample(asked, STARTS[:1], 0)
    odds = found.marginals[0] / (1 - found.marginals[0])
    low, high = (p / (1 - p) for p in found.sensitive)
    np.testing.assert_allclose([odds / low, high / odds], 3.0, rtol=1e-6)


def test_a_state_counts_down_to_a_millionth_of_the_best():
    """Of a column that the rows speak against, the share that is left is still told."""
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(N, 3)))[0]
    X = np.array([30.0, 1e3, 1e5]) * SIGMA * X
    t = 30.0 * X[:, 0] / 30.0
    asked = problem(X, t)
    found, expected = sample(asked, STARTS, 0), by_enumeration(asked)[0]
    told = expected[0] > 1e-5
    assert told.sum() > 1
    np.testing.assert_allclose(found.marginals[0][told], expected[0][told], rtol=0.05)


# Gross rows


def test_a_term_that_explains_rows_together_wins_over_gross_rows_one_by_one():
    rows = (3, 9, 14, 22)
    X, t = drawn(2, count=3, causes=0)
    X[:, 2] = 0.0
    X[list(rows), 2] = 10.0 * SIGMA
    t = t + X[:, 2]
    path = frozenset({3, 4, 5, 6})
    found = sample(problem(X, t, rows=rows, width=10.0), [path, frozenset()], 0)
    assert found.marginals[0][2] > 0.99
    assert found.gross.max() < 0.05


def test_rows_that_no_term_explains_are_gross():
    rows = (3, 9, 14)
    X, t = drawn(2, count=3, causes=1, strength=8.0)
    t[list(rows)] += np.array([9.0, -7.0, 11.0]) * SIGMA
    found = sample(problem(X, t, rows=rows, width=10.0), [frozenset({3, 4, 5}), frozenset()], 0)
    assert found.gross[3:].min() > 0.95
    assert found.marginals[0][0] > 0.95
    assert found.marginals[0][1:].max() < 0.2


def test_a_row_that_fits_is_not_gross():
    X, t = drawn(2, count=3, causes=1, strength=8.0)
    found = sample(problem(X, t, rows=(4, 11)), [frozenset({0, 3, 4}), frozenset({0})], 0)
    assert found.gross.max() < 0.05


def test_before_the_data_one_row_in_a_hundred_is_gross():
    X, t = drawn(2, count=2, causes=0)
    found = sample(problem(X, t, rows=(4,), width=1e-9), STARTS[:1], 0)
    assert found.gross[-1] == pytest.approx(GROSS_ODDS, rel=0.3)
    assert 0.005 < GROSS_ODDS < 0.02


# States too long for chains


@pytest.mark.parametrize("seed", SEEDS)
def test_where_one_state_dominates_its_terms_asked_one_by_one_say_the_same(seed):
    asked = problem(*drawn(seed, strength=25.0, mixed=0.1))
    state = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]
    found = one_by_one(asked, state)
    chains = sample(asked, [frozenset({0, 1})], 0)
    for ours, theirs in zip(found.marginals, chains.marginals, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=0.04)
    assert found.states[0][1] == tuple(state)


@pytest.mark.parametrize(
    ("seed", "strength", "resembling", "within"),
    [(0, 3.0, 0.4, 0.05), (1, 3.0, 0.7, 0.04), (0, 6.0, 0.7, 0.15), (1, 6.0, 1.5, 0.06)],
)
def test_chains_about_a_long_state_find_what_all_sets_add_up_to(seed, strength, resembling, within):
    """Where columns resemble one another; the climb's end alone was wrong by three quarters.

    Where one is confounded with two, which no one place shows, chains cross seldom.
    """
    asked = problem(*drawn(seed, strength=strength, mixed=resembling, causes=3))
    found = coarsened(asked, [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)], 1.0, 0)
    for ours, theirs in zip(found.marginals, by_enumeration(asked)[0], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=within)


@pytest.mark.parametrize("seed", SEEDS)
def test_two_for_two_are_as_often_as_the_posterior_has_them(seed):
    """By these moves alone a chain is in every state of as many terms as often as that is."""
    asked = problem(*drawn(seed, count=5, strength=3.0))
    asked = replace(asked, log_priors=asked.log_priors + 3.0)  # places are seldom left empty
    states = [frozenset(s) for s in combinations(range(5), 3)]
    chain = joint.MarkovChain(asked, np.random.default_rng(seed), states[0], {})
    been = dict.fromkeys(states, 0)
    for _ in range(20000):
        chain.two_for_two()
        been[chain.state] += 1
    logs = np.array([joint.look_at(asked, s).log_posterior for s in states])
    share = np.array([*been.values()]) / 20000
    np.testing.assert_allclose(share, np.exp(logs - logsumexp(logs)), atol=0.02)


def test_chains_cross_between_two_terms_and_two_that_do_the_same_together():
    """Of neither pair one alone does it, nor one of each."""
    rng = np.random.default_rng(3)
    u, v, w = np.linalg.qr(rng.normal(size=(N, 3)))[0].T * 20.0 * SIGMA
    X, t = np.stack([u + w, v - w, u - w, v + w], axis=1), u + v
    asked = problem(X, t + rng.normal(0.0, SIGMA, N))
    found = coarsened(asked, [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)], 1.0, 0)
    assert found.apart < 0.2
    np.testing.assert_allclose(found.marginals[0], by_enumeration(asked)[0][0], atol=0.1)


def test_what_fills_no_place_once_in_ten_thousand_is_not_asked_again(monkeypatch):
    """One column that the rows refuse, the less willingly the larger its usual effect is."""
    X, t = drawn(0, count=3, strength=20.0, mixed=0.1)
    state, asked = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)], []
    own_chain = one_by_one_module._chain

    def kept(pairs, *rest):
        asked.append(2 in pairs.problem.asked)
        return own_chain(pairs, *rest)

    def of_size(size):
        return problem(X * [1.0, 1.0, size * SIGMA / np.linalg.norm(X[:, 2])], t)

    def share(size):
        return one_by_one_module._largest(of_size(size), state)[2]

    monkeypatch.setattr(one_by_one_module, "_chain", kept)
    sizes = np.geomspace(100.0, 1e5, 28)
    shares = np.array([share(size) for size in sizes])
    below = int(np.argmax(shares < 1e-4))
    assert 5e-5 < shares[below] < 1e-4 < shares[below - 1] < 2e-4
    for size in sizes[[below - 1, below]]:
        one_by_one(of_size(size), state)
    assert asked[::2] == [True, False]


@pytest.mark.parametrize("seed", [23, 44])
def test_a_climb_from_a_long_state_ends_no_worse_than_it_began(seed):
    """Ten causes of columns much alike, and nothing known of the noise."""
    X, t = drawn(seed, count=12, causes=10, strength=30.0, mixed=0.95)
    asked, state = problem(X, t, noise=NoisePrior()), [SelectedTerm(i, 1.0) for i in range(10)]
    assert stated(asked, one_by_one_module.best_near(asked, state)) >= stated(asked, state)


def test_a_row_far_off_at_its_widest_hides_none_of_a_long_state():
    X, t = drawn(0, count=8, causes=7, strength=30.0)
    t[5] += 1000.0 * SIGMA
    asked = problem(X, t, rows=(5,), noise=NoisePrior())
    for width, kept in ((1.0, False), (float(SCALES[-1]), True)):
        state = [*(SelectedTerm(i, 1.0) for i in range(7)), SelectedTerm(8, width)]
        held = {t.index for t in one_by_one_module._thinned(asked, state)}
        assert held.issuperset(range(7)) == kept


def test_gross_rows_of_a_long_state_stay():
    X, t = drawn(0, count=3, strength=20.0)
    t[5] += 30.0 * SIGMA
    state = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0), SelectedTerm(3, 1.0)]
    found = one_by_one(problem(X, t, rows=(5,)), state)
    assert found.gross.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert found.marginals[0][:2].min() > 0.95


def test_of_two_confounded_terms_one_stays():
    X, t = drawn(3, count=4, causes=1, strength=20.0)
    X[:, 1] = X[:, 0] + 1e-3 * X[:, 1]
    found = one_by_one(problem(X, t), [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)])
    assert len({0, 1} & {term.index for term in found.states[0][1]}) == 1
    assert found.marginals[0][:2].sum() == pytest.approx(1.0, abs=0.05)


def test_a_term_is_asked_beside_what_is_missing_not_for_it():
    """Alone, either slot would hold what is missing, which is larger than both causes."""
    X, t = drawn(1, count=4, causes=3, strength=12.0, mixed=0.3)
    t = t + 4.0 * X[:, 3]
    found = one_by_one(problem(X, t), [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)])
    assert {term.index for term in found.states[0][1]} == {0, 1, 2, 3}
    assert found.marginals[0].min() > 0.95


def test_prior_odds_move_what_is_asked_one_by_one_as_far_as_it_is_open():
    asked = problem(*drawn(2, count=5, strength=6.0))
    found = one_by_one(asked, [SelectedTerm(0, 1.0)])
    low, high = found.sensitive
    assert (low <= found.marginals[0] + 1e-12).all()
    assert (found.marginals[0] <= high + 1e-12).all()
    assert (high - low).max() > 0.01


def test_evidence_of_terms_more_is_that_of_the_states():
    asked = problem(*drawn(0, strength=15.0, mixed=0.1))
    one, two = SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)
    alone = float(asked.odds(asked.reduce([one]))[0][1])
    assert added_evidence(asked, [one], [two]) == pytest.approx(alone, abs=0.5)
    assert added_evidence(asked, [one], []) == 0.0


def test_a_power_of_the_likelihood_says_less():
    asked = problem(*drawn(0, strength=8.0, mixed=0.1))
    state = [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]
    whole, half, none = (coarsened(asked, state, power, 0) for power in (1.0, 0.3, 1e-6))
    assert (half.marginals[0][:2] < whole.marginals[0][:2]).all()
    assert none.marginals[0].max() < FIRST_SLOT_ODDS


def test_many_causes_are_as_probable_as_a_geometric_number_of_them_drawn_in_any_order():
    """Of ten, far more than if each were as rare as the second; and no slot is filled unasked."""
    odds = np.exp([log_slot(k) for k in range(12)])
    ratios = odds[1:6] / np.arange(2, 7)  # of having k causes and having one less
    assert (np.diff(ratios) > 0.0).all()
    assert ratios.max() < NEXT_SLOT_ODDS
    assert odds.max() == FIRST_SLOT_ODDS


def test_a_climb_down_and_one_up_that_end_apart_count_by_their_posterior():
    """Of two terms neither goes alone, though one other is worth both and a little more."""
    X, _ = drawn(2, count=4, mixed=0.0, strength=15.0)
    t = X[:, 0] + X[:, 1] + np.random.default_rng(1).normal(0.0, SIGMA, N)
    X[:, 2] = X[:, 0] + X[:, 1] + 0.2 * X[:, 2]
    asked, two = problem(X, t), [SelectedTerm(0, 1.0), SelectedTerm(1, 1.0)]
    down, up = (best_near(asked, start) for start in (two, []))
    assert [t.index for t in down] == [0, 1]
    assert [t.index for t in up] == [2]
    both, share = one_by_one(asked, two), by_enumeration(asked)[0][0][:2]
    assert 0.05 < share.min() < share.max() < 0.4
    np.testing.assert_allclose(both.marginals[0][:2], share, atol=0.12)  # chains cross seldom
    assert both.states[0][1] == up


def test_a_state_is_asked_anew_without_what_the_library_lacks(monkeypatch):
    """That may hold the places of several causes, none of which alone would win its own back."""
    X, t = drawn(0, strength=15.0, mixed=0.1)
    asked = replace(problem(X, t), unlisted=np.arange(X.shape[1]) == 2)
    begun = []
    monkeypatch.setattr(
        one_by_one_module,
        "best_near",
        lambda p, state: begun.append([s.index for s in state]) or best_near(p, state),
    )
    ends = coarsened(asked, [SelectedTerm(k, 1.0) for k in range(3)], 1.0, 0).states
    assert begun == [[0, 1, 2], [0, 1], []]
    assert ends[0][0] == max(log for log, _ in ends)


# What is named


def of_library(seed, lacked=(), **given):
    """A problem of drawn columns, of which some are of nothing that is listed."""
    X, t = drawn(seed, **given)
    return X, t, np.isin(np.arange(X.shape[1]), lacked)


def named(X, t, lacked):
    asked = replace(problem(X, t), unlisted=lacked)
    found = sample(asked, STARTS, 0)
    return found.named(asked, np.arange(len(asked.listed))), found.marginals[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_each_cause_is_named_that_is_more_probable_than_not(seed):
    X, t, lacked = of_library(seed, strength=12.0, mixed=0.1)
    found, p = named(X, t, lacked)
    assert set(found) == {0, 1}
    assert p[found].min() > LEAST_NAMED


@pytest.mark.parametrize("copies", [1, 2, 4])
def test_of_effects_that_do_the_same_one_is_named_with_its_share(copies):
    """One of them is at work for sure, each with the same probability."""
    X, t, _ = of_library(1, count=3, strength=12.0, causes=2, mixed=0.1)
    X = np.hstack([X, *[X[:, :1]] * copies])
    found, p = named(X, t, np.zeros(X.shape[1], dtype=bool))
    assert found[0] == 1
    assert len(found) == 2
    assert p[found[1]] == pytest.approx(1.0 / (1 + copies), abs=0.05)


def test_where_only_what_is_unlisted_does_it_nothing_is_named():
    X, t, lacked = of_library(2, lacked=(0, 1), strength=12.0, mixed=0.1)
    assert named(X, t, lacked)[0] == []


def test_where_nothing_is_at_work_nothing_is_named():
    """Though each of many may be at work, that any of them is stays less probable than not."""
    X, _, lacked = of_library(3, count=20)
    t = np.random.default_rng(3).normal(0.0, SIGMA, N)
    assert named(X, t, lacked)[0] == []


def test_one_move_in_five_asks_whether_rows_are_gross_and_of_the_rest_one_in_five_asks_two(
    monkeypatch,
):
    """Half of them would leave the terms too few: a probability moves by 0.03."""
    asked = dict.fromkeys(("row", "rows", "terms", "part", "join"), 0)

    def count(kind):
        return lambda *_: asked.update({kind: asked[kind] + 1})

    monkeypatch.setattr(joint.MarkovChain, "_ask_a_row", count("row"))
    monkeypatch.setattr(joint.MarkovChain, "_ask_all_rows", count("rows"))
    monkeypatch.setattr(joint.MarkovChain, "_fill", count("terms"))
    monkeypatch.setattr(joint.MarkovChain, "_part", count("part"))
    monkeypatch.setattr(joint.MarkovChain, "_join", count("join"))
    rows = SimpleNamespace(gross=np.array([False, True]), linear=SimpleNamespace(n=9.0))
    chain = joint.MarkovChain(rows, np.random.default_rng(0), frozenset({0}), {})
    for _ in range(2000):
        chain._move()
    assert (asked["row"] + asked["rows"]) / 2000 == pytest.approx(1 / 5, abs=0.03)
    assert asked["row"] == pytest.approx(asked["rows"], rel=0.3)
    two = asked["part"] + asked["join"]
    assert two / (two + asked["terms"]) == pytest.approx(1 / 5, abs=0.03)
    assert asked["part"] == pytest.approx(asked["join"], rel=0.3)


def test_of_two_terms_for_one_one_is_among_the_first_twelve():
    look = joint.look_at(problem(*drawn(0, count=20, mixed=0.0, causes=0)), frozenset())
    rank = np.argsort(np.argsort(-look.odds[0])).tolist()
    assert max(min(rank[i] for i in two) for two in look.pairs) == 11
    assert sum(look.pairs.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_does_as_well_is_as_probable_whether_or_not_it_was_asked(seed):
    """Of forty equal columns beside a cause whose absence leaves far more, few are asked."""
    X, t = drawn(seed, count=2, strength=300.0)
    copies = np.tile(X[:, :1], 39)
    asked = problem(np.hstack([X, copies]), t, noise=NoisePrior(SIGMA, 100.0))
    found = sample(asked, [frozenset({0, 1})], 0, moves=12)
    np.testing.assert_allclose(np.delete(found.marginals[0], 1), 1.0 / 40.0, atol=0.005)


# Causes of one robot are of few kinds


def of_effects(count, each):
    """A problem of so many effects on so many joints each, of which the rows say nothing."""
    X, t = drawn(0, count=count * each)
    kinds = np.repeat(np.arange(count), each)
    return replace(problem(X, t), of_effect=kinds, effect_shares=np.full(count, 1.0 / count))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_prior_of_a_state_is_that_of_its_terms_one_after_the_other_in_any_order(seed):
    asked, rng = of_effects(4, 5), np.random.default_rng(seed)
    drawn_terms = rng.permutation(20)[:7].tolist()
    total, chosen = 0.0, []
    for k, i in enumerate(drawn_terms):
        total += asked.log_priors[i] + log_slot(k) + asked.alike(chosen)[i]
        chosen.append(SelectedTerm(i, 1.0))
    assert asked.log_prior(drawn_terms) == pytest.approx(total)
    assert asked.log_prior(sorted(drawn_terms)) == pytest.approx(total)


def test_fourteen_causes_of_a_robot_are_of_four_or_five_effects():
    """As those of the UR5 are: of what is there already more are drawn than of all else."""
    asked, rng, kinds = of_effects(20, 14), np.random.default_rng(0), []
    for _ in range(60):
        chosen = []
        for _ in range(14):
            shares = np.exp(asked.log_priors + asked.alike(chosen))
            shares[[t.index for t in chosen]] = 0.0
            chosen.append(SelectedTerm(int(rng.choice(280, p=shares / shares.sum())), 1.0))
        kinds.append(len({asked.of_effect[t.index] for t in chosen}))
    assert 4.0 < np.mean(kinds) < 5.6


def test_a_row_off_by_a_few_tenths_of_a_millimetre_is_gross_where_the_noise_is_far_less():
    """Some five sigma of 0.05 mm: a usual displacement of a third of a metre would not tell it."""
    X, t = drawn(0, count=3, causes=1)
    t[5] += 5.5 * SIGMA
    found = sample(problem(X, t, rows=(5,), width=DISPLACED / 5e-5), STARTS, seed=0)
    assert found.gross[3] > 0.5
