r"""Is it this robot, this order of joints, these units? No links explain a wrong set-up.

As given, and with each likely slip undone, the misfit is what the best frame and tool leave of the
*nominal* robot,

.. math:: m = \min_{R, t, d} \operatorname{median}_i |R\,a_i + t - p(q_i) - R(q_i)\, d| ,

the minimum by squares. Where one slip undone leaves a small part of it, that slip was made. Where
none does and even fitted links leave what no robot that is this one could, it is another robot, or
another recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit.statement import Readings
from plumbline.optim.recording.slips import Slip, matched, signs, swaps, zeros

SUSPECT = 0.01  # of the reach: nominal links that miss less are taken as they are
IMPLAUSIBLE = 0.01  # of the reach: fitted links that miss more are of no robot that is this one
DOUBTFUL = 0.001  # of the reach: more than measuring devices err
PLAUSIBLE = 0.03  # of the reach: nominal links of this robot, set up rightly, miss less
MENDED = 0.2  # of the misfit is left where a slip undone is the right one
ALIKE = 1.5  # of the least misfit: slips that cannot be told from the likeliest
SHOWN = 3
ROWS = 60  # that are enough to tell


@dataclass(frozen=True, eq=False)
class Task:
    """What a set-up is judged by."""

    chain: Chain  # the nominal chain
    tool: Array  # nominal tip in the tip frame (3,) [m]
    fit_tool: bool  # whether the tool is free
    readings: Readings  # some of the readings

    @classmethod
    def of(cls, chain: Chain, tool: Array, readings: Readings, *, fit_tool: bool) -> Task:
        """From all readings, of which evenly spread ones speak for all."""
        rows = np.unique(np.linspace(0, len(readings) - 1, min(len(readings), ROWS)).astype(int))
        return cls(chain, tool, fit_tool, readings.select(list(rows)))

    def missed(self, q: Array, tips: Array) -> float:
        """Median misfit [m] of readings, some of them changed, after the best frame and tool."""
        T = self.chain.placement(q)
        R, p = T[:, :3, :3], T[:, :3, 3]
        _, away = matched(R, p + R @ self.tool, tips, self.fit_tool)
        return float(np.median(np.linalg.norm(away, axis=1)))


def reach(chain: Chain, tool: Array, q: Array) -> float:
    """How far the tip can be from the base [m]: all links in line, slides where they were."""
    links = [np.linalg.norm(joint.T_parent_joint[:3, 3]) for joint in chain.joints]
    slides = [np.abs(q[:, j]).max() for j, kind in enumerate(chain.kinds) if kind != "revolute"]
    rest = np.linalg.norm(chain.T_last_tip[:3, 3]) + np.linalg.norm(tool)
    return float(sum(links) + sum(slides) + rest)


def slip(task: Task) -> str | None:
    """What was likely done wrong, in words; None where the set-up is as it should be."""
    q, tips = task.readings.q, task.readings.tips
    given = task.missed(q, tips)
    if not given > SUSPECT * reach(task.chain, task.tool, q):
        return None
    tried = [(task.missed(*other), words) for words, other in _slips(task)]
    least = min(missed for missed, _ in tried)
    if not least < min(MENDED * given, PLAUSIBLE * reach(task.chain, task.tool, q)):
        return None
    # A wrist turned over looks like another joint's slip: all that mend as well are named.
    alike = [words for missed, words in tried if missed <= ALIKE * least]
    said = f"the tips miss the nominal robot by {_mm(given)}, but by {_mm(least)}"
    return f"{said} {', or '.join(alike[:SHOWN])}"


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"


def _slips(task: Task) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Likely slips in words, with readings in which each is undone."""
    q, tips = task.readings.q, task.readings.tips
    turning = np.array([kind == "revolute" for kind in task.chain.kinds])
    yield (
        "as a mirror image: the device's frame is left-handed; turn the sign of one axis",
        (q, tips * np.array([1.0, 1.0, -1.0])),
    )
    yield "with x, y, z in mm: give them in m", (q, 1e-3 * tips)
    yield "with x, y, z times 1000: give them in m", (q, 1e3 * tips)
    if turning.any():
        yield "with the joints in degrees: give rad", (np.where(turning, np.deg2rad(q), q), tips)
    if not turning.all():
        yield "with the slides in mm: give them in m", (np.where(turning, q, 1e-3 * q), tips)
    reverse = Slip("the joints in reverse order", "mend the columns", q[:, ::-1])
    for other in itertools.chain(swaps(q), [reverse], signs(q), zeros(q, turning.tolist())):
        yield f"with {other.change}: {other.mend}", (other.q, tips)
