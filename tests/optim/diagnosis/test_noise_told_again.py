"""Laws of asking again how rows know of each other, once what was told of it has been assumed."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.optim.diagnosis import diagnose
from plumbline.optim.diagnosis.diagnose import _told_apart
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.correlation import RowNoise
from plumbline.optim.diagnosis.prior import ROUNDS
from plumbline.optim.recording.recording import Recording
from tests.benches import bench

OPTIONS = DiagnosisOptions()
SCATTER = RowNoise(scatter=(0.2,) * 6)


@dataclass(frozen=True)
class Asked:
    """A task of which only the rows count."""

    recording: Recording
    folds: object = None


@pytest.fixture(scope="module")
def rows():
    return replace(bench("ur5", "tip_position"), group=None)


def found(rows, told):
    """What explains the rows, of which only what it tells of their noise counts."""
    explanation = SimpleNamespace(correlation=told)
    return SimpleNamespace(options=OPTIONS, task=Asked(rows), explanation=explanation, bad=None)


@pytest.fixture
def asked(monkeypatch):
    """The rows that were explained, by what a function of them tells of their noise."""

    def by(told):
        seen = []

        def explained(_options, task, *_):
            seen.append(task.recording)
            return found(task.recording, told(task.recording))

        monkeypatch.setattr(diagnose, "find_causes", lambda *_: (None, None))
        monkeypatch.setattr(diagnose, "_explained", explained)
        return seen

    return by


def test_copies_are_that_however_little_so_few_of_them_tell(rows):
    first = found(replace(rows, alike=1.0), RowNoise())
    assert _told_apart(first) is first


@pytest.mark.parametrize(
    "noise", [SCATTER, RowNoise(wander=0.6), RowNoise(alike=0.5), RowNoise(jitter=0.01)]
)
def test_noise_that_is_told_only_while_it_is_not_assumed_is_not_told(rows, asked, noise):
    seen = asked(lambda _: RowNoise())
    first = found(rows, noise)
    assert _told_apart(first) is first
    assert len(seen) == 1  # what would follow was asked before


def test_noise_that_stands_once_it_is_assumed_is_told(rows, asked):
    seen = asked(lambda _: SCATTER)
    last = _told_apart(found(rows, SCATTER))
    np.testing.assert_array_equal(last.task.recording.scatter, SCATTER.scatter)
    assert len(seen) == 1


def test_noise_that_never_settles_is_asked_for_so_often(rows, asked):
    seen = asked(lambda r: RowNoise(jitter=2.0 * r.jitter))
    assert _told_apart(found(rows, RowNoise(jitter=1.0))).task.recording is seen[-1]
    assert len(seen) == ROUNDS
