r"""Whether bodies that weigh other than a file says do so in each of several motions alike."""

from collections.abc import Iterator, Sequence

import numpy as np

from plumbline.optim.diagnosis.motion.carrying import fits_of_all
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED
from plumbline.optim.diagnosis.motion.masses import MassFit, Telling, fitted_mass
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals, spread
from plumbline.optim.diagnosis.of_recordings import AgainstOthers, Carries, Transfer
from plumbline.optim.model.constants import CHANGED
from plumbline.optim.recording.table import Flags


def masses_carry(
    signals: Signals, joints: Sequence[JointFindings], mine: Flags, name: str
) -> Iterator[Transfer]:
    r"""Every such body as one motion alone says it, and what all others say.

    .. math:: z = \sqrt{d^T (C_k + C_o)^{-1} d / P}

    of differences d of its P values.

    Args:
        signals: States of all motions.
        joints: What was found of drives.
        mine: Which windows (W,) are of the one motion.
        name: What it is called.
    """
    carried = signals.recording.carried
    if not carried.bodies:
        return
    drives = fits_of_all(joints, signals.recording.n)
    tellings = [
        Telling(signals, drives, spread(signals.starts[chosen], MOST_JUDGED))
        for chosen in (mine, ~mine)
    ]
    one, others = (fitted_mass(telling, carried, clock=False) for telling in tellings)
    widths, first = tellings[0].scales(carried), 0
    for body in carried.bodies:
        own = slice(first, first := first + len(body.values))
        off = np.subtract(one.carried.values, others.carried.values)[own]
        both = (one.covariance + others.covariance)[own, own]
        z = float(np.sqrt(off @ np.linalg.solve(both, off) / len(off)))
        told = both[0, 0] < 2 * widths[own][0] ** 2
        carries = Carries.NO if z > CHANGED else Carries.YES if told else Carries.UNTOLD
        sides = zip(body.declared, *(_values(fit, own) for fit in (one, others)), strict=True)
        values = {
            p.name: AgainstOthers(value, std, other, others_std, p.unit)
            for p, (value, std), (other, others_std) in sides
        }
        yield Transfer(body.effect.name, body.link or None, name, carries, z, values)


def _values(fit: MassFit, own: slice) -> list[tuple[float, float]]:
    """Values with their standard errors."""
    std = np.sqrt(np.diag(fit.covariance))[own].tolist()
    return list(zip(fit.carried.values[own], std, strict=True))
