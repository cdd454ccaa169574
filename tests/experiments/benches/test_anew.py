"""Windows that begin anew know where the joint was, and nothing of what came before."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.experiments.benches.anew import anew, left
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.optim.diagnosis.motion.signals import signals_of
from tests.motions import recorded


def test_what_a_joint_kept_to_itself_is_put_right_where_windows_begin_anew():
    recording = recorded([{"play": 0.05}, {}], seconds=40, noise=1e-5, size=0.01)
    held = recording.time > 24.0
    q = recording.q + 0.02 * held[:, None]  # by hand, within its play: no roll-out knows
    signals = signals_of(replace(recording, q=q, held_out=held))
    windows = anew(signals, 0)
    np.testing.assert_array_equal(windows.q[windows.start], windows.q[windows.passes[0]])
    assert signals.held[windows.start].all()
    np.testing.assert_array_equal(np.diff(windows.samples.ravel()), 1)
    run_on = signals.windows(0, signals.starts[signals.folds == 0])
    play = (ActuationPlay(),), np.array([0.05])
    assert left(windows, *play) < 0.1
    assert left(run_on, *play) == pytest.approx(20.0, rel=0.01)
