r"""What is left of a motion that no fit has seen, in windows of either kind.

``python -m plumbline.experiments.benches.anew [--name so101-multisine] [--share 0.6]``

The first share of a recording is diagnosed, the rest judged: along roll-outs that run on, as
verdicts count, and in windows of two seconds that each begin *anew* where the joint was measured,
the last 1.5 s of which count,

.. math:: s_0 = q(t_0), \qquad r_k = \hat q(s_0; u, t_k) - q(t_k), \quad t_k - t_0 > 0.5\,\text{s}.

The latter do not know what goes wrong slowly: what a play or a dead band holds is put right with
every window.
"""

import tempfile
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.sources import fetch
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.fit import evaluated
from plumbline.optim.diagnosis.motion.rollout import Array, Effects, Windows
from plumbline.optim.diagnosis.motion.signals import Signals
from plumbline.optim.diagnosis.motion.tracking import load_drives

WINDOW, SETTLES = 2.0, 0.5  # [s], of which so many do not count


class Anew(Windows):
    """Windows of a joint, each of which begins where it was measured."""

    @cached_property
    def passes(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Every window a roll-out of its own (W,), three times."""
        alone = np.arange(len(self), dtype=np.int64)
        return self.start, np.full(len(self), self.length, np.int64), alone


def anew(signals: Signals, joint: int) -> Anew:
    """Windows of a joint, from 0, whose counted parts follow one another in what was held out."""
    length, settle = (round(seconds / signals.dt) for seconds in (WINDOW, SETTLES))
    held = np.flatnonzero(signals.held)
    start = np.arange(held[0], held[-1] - length + 1, length - settle)
    own = vars(signals.windows(joint, start))
    return Anew(**own | {"length": length, "settle": settle})


def left(windows: Windows, effects: Effects, theta: Array) -> float:
    """Root mean square [mrad] of what drives with these effects leave."""
    return 1e3 * float(np.sqrt(evaluated(windows, effects, theta, slopes=False).square))


@as_command
def bench(
    name: Annotated[str, typer.Option(help="A public motion.")] = "so101-multisine",
    share: Annotated[float, typer.Option(min=0.1, max=0.9, help="Of the time, fitted.")] = 0.6,
) -> Found:
    """Judge a motion's causes along roll-outs that run on, and in windows that begin anew."""
    with tempfile.TemporaryDirectory() as folder:
        r = load_drives(fetch(name, Path(folder)))
    found = diagnose_motion(replace(r, held_out=r.time > r.time[0] + share * np.ptp(r.time)))
    lines = []
    for joint, run_on in zip(found.joints, found.left_out, strict=True):
        fit, short = joint.fit, anew(found.signals, joint.number - 1)
        lines.append({
            "joint": joint.number, "causes": ", ".join(e.name for e in fit.effects),
            "before, run on": 1e3 * np.sqrt(run_on.before.mean()),
            "after, run on": 1e3 * np.sqrt(run_on.after.mean()),
            "before, anew": left(short, (), np.empty(0)),
            "after, anew": left(short, fit.effects, fit.theta),
        })  # fmt: skip
    return {f"{name}, not fitted [mrad]": pd.DataFrame(lines)}


if __name__ == "__main__":
    typer.run(bench)
