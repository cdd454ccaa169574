"""Linear algebra of a diagnosis goes on one thread, and what was set before is set again."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from plumbline import diagnose
from plumbline.optim.core.threads import one_thread
from plumbline.optim.hand_eye import calibrate
from tests.benches import bench
from tests.few_effects import only
from tests.motions import recorded


def threads():
    """Of every library of linear algebra that is loaded."""
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def two():
    """As it is where nobody says how many."""
    with one_thread(), threadpool_limits(limits=2, user_api="blas"):
        yield


@pytest.mark.parametrize("made", [lambda: bench("ur5", "tip_position"), lambda: recorded([{}, {}])])
def test_a_diagnosis_goes_on_one_thread_and_leaves_as_many_as_there_were(made, two):
    recording, seen = made(), set()
    assert threads() == {2}
    diagnose(recording, only("joint_offset"), progress=lambda *_: seen.update(threads()))
    assert seen == {1}
    assert threads() == {2}


def test_a_hand_eye_calibration_goes_on_one_thread_too(two, monkeypatch):
    """Two take a third longer, and twice the processor."""
    seen = set()
    monkeypatch.setattr(calibrate, "refuse_degenerate", lambda _: seen.update(threads()) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        calibrate.calibrate(None)
    assert seen == {1}
    assert threads() == {2}


def test_where_a_diagnosis_is_refused_as_many_threads_are_left(two):
    with pytest.raises(ValueError, match="refused"), one_thread():
        raise ValueError("refused")
    assert threads() == {2}
