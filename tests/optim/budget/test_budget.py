"""A gap budget adds up, tells covariances, and holds in sealed sessions."""

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from tests.answer_contract import keeps_the_contract

Source, add_up = plumbline.budget.Source, plumbline.budget.add_up
LINKS = ("markers", "hand-eye", "arm", "needle")


def paper():
    """Calculation 1.43 mm, control 0.1 mm, needle and breathing 0.5 mm RMS."""
    cured = Source.of_rms("calculation", 0.4e-3)
    return [
        Source.of_rms("calculation", 1.43e-3, dof=12).mended(cured),
        Source.of_rms("control", 0.1e-3),
        Source.of_rms("needle and breathing", 0.5e-3, dof=6),
    ]


def test_shares_sum_to_one_and_squares_to_the_whole():
    budget = add_up(paper())
    assert sum(part.share for part in budget.parts) == pytest.approx(1.0)
    assert budget.rms == pytest.approx(np.sqrt(1.43**2 + 0.1**2 + 0.5**2) * 1e-3)
    assert budget.rms_after == pytest.approx(np.sqrt(0.4**2 + 0.1**2 + 0.5**2) * 1e-3)
    assert budget.first[0].name == "calculation"
    assert budget.parts[0].share == pytest.approx(1.43**2 / (1.43**2 + 0.01 + 0.25))


def test_shares_after_the_cure_have_intervals_too():
    budget = add_up(paper())
    whole = 0.4**2 + 0.1**2 + 0.5**2
    for part, own in zip(budget.parts, (0.16, 0.01, 0.25), strict=True):
        low, high = part.interval_after
        assert part.share_after == pytest.approx(own / whole)
        assert low < part.share_after < high
    assert sum(part.share_after for part in budget.parts) == pytest.approx(1.0)
    exact = add_up([Source.of_rms("a", 1e-3), Source.of_rms("b", 1e-3)])
    assert exact.parts[0].interval_after == pytest.approx((0.5, 0.5))


def test_systematic_errors_add_as_lengths_do():
    push = [1e-3, 0.0, 0.0]
    both = add_up([Source.of("a", mean=push), Source.of("b", mean=push)])
    assert both.rms == pytest.approx(2e-3)
    against = add_up([Source.of("a", mean=push), Source.of("b", mean=[-5e-4, 0.0, 0.0])])
    assert against.rms == pytest.approx(5e-4)
    assert against.parts[1].share == pytest.approx(-1.0)  # it compensates
    assert against.parts[1].gain == pytest.approx(-5e-4)  # to take it away would cost


def test_a_covariance_of_two_links_is_shared_in_halves():
    C = 1e-8 * np.eye(3)
    links = [Source.of("a", covariance=C), Source.of("b", covariance=C)]
    budget = add_up(links, {("a", "b"): 0.5 * C})
    assert budget.rms**2 == pytest.approx(9e-8)
    assert [part.share for part in budget.parts] == pytest.approx([0.5, 0.5])
    assert add_up(links, {("a", "b"): -C}).rms == pytest.approx(0.0, abs=1e-12)


def test_links_at_many_points_are_averaged():
    mean = np.array([[1e-3, 0, 0], [0, 2e-3, 0]])
    budget = add_up([Source.of("arm", mean=mean), Source.of_rms("tracker", 1e-3)])
    assert budget.points == 2
    assert budget.rms == pytest.approx(np.sqrt(2.5e-6 + 1e-6))


def session(rng):
    """A chain of random links, what 40 to 100 readings of each tell of it, and its true shares."""
    spread = rng.uniform(0.1e-3, 1.0e-3, len(LINKS))
    push = rng.normal(0.0, 0.4e-3, (len(LINKS), 3))
    dof = 3 * rng.integers(40, 100, len(LINKS))  # readings of an error in space
    known = 0.03e-3
    square = push @ push.sum(axis=0) + 3 * spread**2
    sources = [
        Source.of(
            name,
            mean=push[k] + rng.normal(0.0, known, 3),
            covariance=spread[k] ** 2 * rng.chisquare(dof[k]) / dof[k],
            mean_covariance=known**2,
            dof=dof[k],
        )
        for k, name in enumerate(LINKS)
    ]
    return sources, square / square.sum()


def test_shares_are_within_five_points_of_the_truth_in_sealed_sessions():
    """Two hundred sessions; means and spreads are told by readings, the truth by what drew them."""
    rng = np.random.default_rng(11)
    near, inside = [], []
    for _ in range(200):
        sources, truth = session(rng)
        budget = add_up(sources)
        shares = np.array([part.share for part in budget.parts])
        near.append(np.abs(shares - truth).max() <= 0.05)
        inside += [
            p.interval[0] <= t <= p.interval[1] for p, t in zip(budget.parts, truth, strict=True)
        ]
    assert np.mean(near) >= 0.9
    assert 0.9 <= np.mean(inside) <= 0.99


def test_an_arm_s_cure_leaves_what_its_model_is_not_sure_of():
    model = plumbline.diagnose(plumbline.example()).model()
    q = model.samples["q"][:30]
    budget = add_up([Source.of_arm("arm", model, q), Source.of_rms("needle", 2e-4)])
    arm = budget.parts[0]
    assert 2e-4 < arm.rms < 1e-3
    assert arm.rms_after < 0.2 * arm.rms
    assert budget.first[0].name == "arm"
    assert budget.points == 30


def test_a_budget_keeps_the_contract_of_every_answer(tmp_path):
    keeps_the_contract(add_up(paper()), tmp_path)
    assert "calculation" in add_up(paper()).table()


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: add_up([]), "no link, expected at least one"),
        (lambda: add_up([Source.of_rms("a", 1e-3)] * 2), "two links 'a'"),
        (lambda: Source.of_rms("a", -1.0), "a length of at least 0"),
        (lambda: Source.of("a", covariance=-np.eye(3)), "a negative variance"),
        (lambda: Source.of("a", mean=[1.0, 2.0]), r"expected \(3,\) or \(N, 3\)"),
        (lambda: add_up([Source.of_rms("a", 1e-3)], {("a", "b"): np.eye(3)}), "expected two of a"),
        (
            lambda: add_up([Source.of(n, mean=np.zeros((k, 3))) for n, k in (("a", 2), ("b", 3))]),
            "links at 2 and 3 points",
        ),
    ],
)
def test_what_is_no_budget_is_refused_in_one_line(ask, words):
    with pytest.raises(PlumblineError, match=words) as error:
        ask()
    assert "\n" not in str(error.value)
