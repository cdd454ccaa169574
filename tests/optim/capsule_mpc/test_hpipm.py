"""HPIPM asked directly solves the same programs, with soft rows of its own."""

import numpy as np
import pytest

from plumbline.experiments.benches import mpc
from plumbline.experiments.compare.hpipm import Hpipm, Recording, hpipm_library, race
from plumbline.optim.capsule_mpc import BandedQp, RealTime

pytestmark = pytest.mark.skipif(hpipm_library() is None, reason="this CasADi brings no HPIPM")


@pytest.fixture(scope="module")
def programs():
    """Programs of a course, with the starts of their solvers."""
    recorded = Recording([])
    mpc.drive("recorded", RealTime(recorded, compiled=False), 10, 3, 2, 60)
    return recorded.kept[::6]


def test_both_find_the_same_path(programs):
    found = race(programs)
    assert found.solved == 1.0
    assert found.apart < 0.05
    assert found.hpipm[0] > 0.0
    assert found.banded[0] > 0.0


def test_rows_are_soft_and_no_controls(programs):
    """Rows that cannot be kept: the same shortfall, at the same cost, by six controls a stage."""
    qp, start = programs[-1]
    rows = [int(count) for count in qp.present.sum(axis=1)]
    assert max(rows) > 0
    hard = np.where(qp.present, qp.h + 100.0, qp.h)  # a demand that the speed limits do not allow
    beyond = type(qp)(**{**vars(qp), "h": hard})
    ours = BandedQp(tolerance=1e-5).solve(beyond, start)
    other = Hpipm(hpipm_library(), len(qp.x0), rows, qp.smooth > 0.0)
    other.load(beyond)
    assert other.solve()[0]
    assert ours.slack.max() > 10.0
    assert np.abs(other.path() - ours.x).max() < 0.05


def test_speed_limits_are_bounds_of_the_controls(programs):
    qp, _ = programs[0]
    rows = [int(count) for count in qp.present.sum(axis=1)]
    far = type(qp)(**{**vars(qp), "g": qp.g - 1e4})  # goals far beyond what a step allows
    other = Hpipm(hpipm_library(), len(qp.x0), rows, qp.smooth > 0.0)
    other.load(far)
    assert other.solve()[0]
    steps = np.diff(other.path(), axis=0, prepend=qp.x0[None])
    assert (np.abs(steps) <= qp.step + 1e-3).all()
    assert np.abs(steps).max() > 0.9 * qp.step.max()
