"""Ranges and fiducials of the simulators in ``reality/parts``, and what the diagnosis says of them.

The simulators share no code with the library: a board bulges as a sphere, a spot is read ray by
ray, slices are cut by rounding down, and a chest breathes with the cube of half a sine.
"""

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

from plumbline.experiments.reality.arms import arm
from plumbline.experiments.reality.parts.drawing import RangePlan, draw_fiducials, draw_ranges
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.loading import load_to_diagnose

POSES = RangePlan(rows=120, motions=6, poses=True)
JOINTS = RangePlan(rows=150, motions=5)


@lru_cache(maxsize=64)
def ranges(name, gap=2.5, seed=3, plan=POSES):
    """Folder and truth of a recording of ranges."""
    folder = Path(mkdtemp()) / f"{name}-{seed}"
    return folder, draw_ranges(folder, arm("lbr"), name, gap, seed, plan)


@lru_cache(maxsize=64)
def fiducials(name, gap=2.5, seed=3, markers=8, touches=4):
    """Folder and truth of a recording of fiducials."""
    folder = Path(mkdtemp()) / f"{name}-{seed}"
    return folder, draw_fiducials(folder, name, gap, seed, markers, touches)


@lru_cache(maxsize=64)
def diagnosed(folder):
    """What the diagnosis says of a folder."""
    return diagnose(load_to_diagnose(folder))


def first(verdict):
    """Effect and element of the first cause; none of either where none is named."""
    return (verdict.causes[0].effect, verdict.causes[0].element) if verdict.causes else (None, None)
