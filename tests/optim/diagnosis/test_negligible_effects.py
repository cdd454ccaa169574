"""Laws of negligible effects: which causes rows left out can spare, each and together."""

from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.predict import negligible

LARGE = 5.0  # times by which the held-out RMS rises without the large cause, the first
MANY = 30_000  # residuals
TOGETHER = 1.01  # ratio of the held-out RMS up to which what is spared is not missed


def worthy(rises, monkeypatch, count=MANY, both=(), gone_before=(), named=()):
    """Which causes stay, and the RMS then, if each multiplies the RMS by its rise when it goes.

    Of ``both`` it does so only once all of them have gone; some may have gone before.
    """
    rises = np.array([LARGE, *rises])

    def square(_, terms, __):
        gone = np.setdiff1d(np.arange(len(rises)), [c.index for c in terms])
        lone = [k for k in gone if k not in both or set(both) <= set(gone.tolist())]
        return float(np.prod(rises[lone]) ** 2)

    def without(_, terms, groups, __):
        return [square(None, [t for t in terms if t not in group], None) for group in groups]

    monkeypatch.setattr(negligible, "square_with", square)
    monkeypatch.setattr(negligible, "squares_without", without)
    chosen = [SelectedTerm(k, 1.0) for k in range(len(rises))]
    selection = SimpleNamespace(
        candidates=[SimpleNamespace(key=("some", k)) for k in range(len(rises))],
        variance=lambda _: 1.0,
    )
    gram = SimpleNamespace(count=count)
    found = SimpleNamespace(
        selection=selection, pool=None, chosen=chosen, best=SimpleNamespace(gram=gram)
    )
    named = [("some", k) for k in named]
    kept = negligible.worth_while(found, [c for c in chosen if c.index not in gone_before], named)
    return {c.index for c in kept}, np.sqrt(square(None, kept, None))


def test_a_cause_that_many_rows_left_out_can_spare_is_spared(monkeypatch):
    kept, _ = worthy([1.003, 1.002, 1.2], monkeypatch)
    assert kept == {0, 3}


@pytest.mark.parametrize("rise", [1.002, 1.004, 1.008])
def test_negligible_effects_are_spared_only_as_far_as_they_are_negligible_together(
    rise, monkeypatch
):
    """Forty of them are needed for the figure; the slightest are spared, as many as may be."""
    rises = rise + 1e-6 * np.arange(40)
    kept, rms = worthy(rises, monkeypatch)
    gone = set(range(41)) - kept
    assert rms <= TOGETHER < rms * rise
    assert gone == set(range(1, len(gone) + 1))


def test_of_two_that_are_confounded_one_stays(monkeypatch):
    kept, _ = worthy([1.2, 1.2], monkeypatch, both=(1, 2))
    assert len(kept) == 2
    assert 0 in kept


@pytest.mark.parametrize("named", [1, 2])
def test_what_is_named_stays_where_what_is_not_does_the_same(named, monkeypatch):
    kept, _ = worthy([1.2, 1.2], monkeypatch, both=(1, 2), named=(0, named))
    assert kept == {0, named}


def test_what_the_figure_does_not_need_goes_even_where_it_is_poor_already(monkeypatch):
    kept, _ = worthy([1.2, 1.0, 1.0], monkeypatch, gone_before=(1,))
    assert kept == {0}


def test_of_few_rows_a_small_cause_is_left_to_the_evidence(monkeypatch):
    kept, _ = worthy([1.003, 1.002], monkeypatch, count=300)
    assert kept == {0, 1, 2}
