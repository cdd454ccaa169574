"""Bodies that weigh other than a robot's file says, as a verdict tells them: over all joints."""

from collections.abc import Iterator, Sequence

import numpy as np

from plumbline.optim.diagnosis.findings import Cause
from plumbline.optim.diagnosis.motion.carried import Off
from plumbline.optim.diagnosis.motion.carrying import MassFindings
from plumbline.optim.diagnosis.motion.left_out import LeftOut
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.prior import LEAST_NAMED, PART_OF_UNLISTED

Bodies = Sequence[tuple[Off, float]]


def probable(mass: MassFindings | None, joints: Sequence[JointFindings]) -> Bodies:
    """Bodies with their probability: of what is unlisted and at work they may be parts."""
    if mass is None:
        return []
    spared = 1 - PART_OF_UNLISTED * max((joint.outside for joint in joints), default=0.0)
    pairs = zip(mass.carried.bodies, mass.probability, strict=True)
    return [(body, p * spared) for body, p in pairs]


def causes_of(
    mass: MassFindings | None, bodies: Bodies, together: Sequence[LeftOut]
) -> Iterator[Cause]:
    """Those that are probable as causes, by what all joints were left out of."""
    for k, (body, p) in enumerate(bodies):
        if mass is not None and p >= LEAST_NAMED:
            pairs = ((judged.without[body.label], judged.after) for judged in together)
            roots = (np.sqrt(np.concatenate(x).mean()) for x in zip(*pairs, strict=True))
            without, after = map(float, roots)
            yield mass.cause(k, p, without, after)


def taken(together: Sequence[LeftOut]) -> float:
    """What masses take of the square of what is left, of all joints [rad^2]."""
    return sum(float(judged.before.sum() - judged.begun.sum()) for judged in together)


def shares(bodies: Bodies, together: Sequence[LeftOut]) -> Iterator[tuple[Off, float]]:
    """Of that, each body's part: by what is left more without it alone [rad^2]."""
    more = [
        max(sum(float((j.without[b.label] - j.after).sum()) for j in together), 0.0)
        for b, _ in bodies
    ]
    for (body, _), own in zip(bodies, more, strict=True):
        yield body, max(taken(together), 0.0) * own / (sum(more) or 1.0)
