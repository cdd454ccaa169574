"""What every answer must keep: asked of each method's answers in that method's own tests."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from plumbline.errors import PlumblineError
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement
from plumbline.optim.diagnosis.findings import Outcome, Verdict
from plumbline.optim.diagnosis.prior import LEAST_NAMED


def keeps_the_contract(answer: Answer, tmp_path) -> None:
    """Raises an assertion where an answer is not judged, shown, drawn, stored or brought back."""
    assert isinstance(answer.judged, Judgement)
    assert answer.judged.fits or answer.judged.converged
    assert "\n" not in repr(answer)
    assert repr(answer).startswith("<")
    assert len(repr(answer)) < 200
    assert answer.card().startswith("<div")
    assert answer._repr_html_() == answer.card()
    assert isinstance(answer.plot(), Figure)
    json.dumps(answer.to_dict(), allow_nan=False)
    path = tmp_path / "answer.json"
    answer.save(path)
    with pytest.raises(PlumblineError, match="overwrite"):
        answer.save(path)
    again = type(answer).load(path)
    assert repr(again) == repr(answer)
    assert again.card() == answer.card()
    same(again.to_dict(), answer.to_dict())
    if isinstance(verdict := getattr(answer, "verdict", answer), Verdict):
        contradicts_nothing(verdict)


def contradicts_nothing(verdict: Verdict) -> None:
    """Raises an assertion where what earns its probability is neither a cause nor said why not.

    So nothing is outside of the library that one of its effects has earned.
    """
    causes = verdict.causes
    told = {
        (c.effect, c.element) for c in (*causes, *(r for c in causes for r in c.confounded_with))
    }
    notes = " ".join(n for n in verdict.notes if "not named" in n)
    for c in verdict.candidates:
        if c.probability >= LEAST_NAMED and (c.effect, c.element) not in told:
            assert c.effect in notes, c
    if verdict.verdict == Outcome.OUTSIDE:
        shrinks = verdict.gap.shrink_ci95[0] > 0.0  # by effects none of which is sure
        assert shrinks or verdict.outside_probability >= LEAST_NAMED


def same(left, right) -> None:
    """Plain data alike to the last bit but for rounding."""
    assert type(left) is type(right)
    if isinstance(left, dict):
        assert left.keys() == right.keys()
        for key in left:
            same(left[key], right[key])
    elif isinstance(left, list):
        assert len(left) == len(right)
        for a, b in zip(left, right, strict=True):
            same(a, b)
    elif isinstance(left, float):
        np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-15)
    else:
        assert left == right
