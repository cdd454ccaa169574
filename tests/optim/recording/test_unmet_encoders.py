"""Second encoders that know nothing of their joints make a verdict that is not to be relied on."""

from bisect import bisect_left

import numpy as np

from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.disagreement import unmet
from tests.few_effects import FEW_EFFECTS

ROWS = 40


def read(off=1e-4, still=None, mixed=False):
    """Joints of a UR5 and their second encoders, off by so much [rad]; one may stand still."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (ROWS, 6))
    if still is not None:
        q[:, still] = 0.3
    measured = q + off * rng.normal(size=q.shape)
    measured = measured[rng.permutation(ROWS)] if mixed else measured
    given = {"observation": "joint_position", "robot": "ur5", "name": "read"}
    return build_recording(**given, q=q, measured=measured)


def about(values):
    return np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def test_a_quarter_of_its_way_is_what_a_joint_may_be_missed_by():
    sizes = np.linspace(0.05, 0.6, 200)
    doubted = bisect_left(sizes, True, key=lambda size: bool(unmet(read(size))))
    kept, lost = (
        np.max(about(r.measured - r.q) / about(r.measured))
        for r in map(read, sizes[[doubted - 1, doubted]])
    )
    assert 0.24 < kept < 0.25 < lost < 0.26


def test_encoders_of_rows_of_another_time_make_a_verdict_that_is_not_to_be_relied_on():
    found = diagnose(read(mixed=True), FEW_EFFECTS)
    assert found.verdict.warnings[0].startswith("not to be relied on: m1 misses q1 by")


def test_a_joint_that_stands_still_is_not_doubted_for_less_than_encoders_may_be_coarse_by():
    assert not unmet(read(0.01, still=2))
    assert unmet(read(0.03, still=2)).startswith("m3 misses q3")
