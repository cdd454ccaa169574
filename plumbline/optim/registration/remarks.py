"""What is odd about an answer but no fault, one line each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.checks import doubtful, exchange, misfit
from plumbline.optim.registration.condition import condition_of
from plumbline.optim.registration.constants import (
    ASIDE,
    DOUBTFUL,
    FLAT,
    MUCH,
    NEARLY_ON_A_LINE,
    WIDE_TURN,
)
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.relabelling import Relabelling, best_relabelling
from plumbline.optim.rigid import rigid_match


def remarks(markers: Markers, answer: Registration) -> Iterator[str]:
    """What is odd but no fault, one line each."""
    yield from _nearly_on_a_line(answer)
    yield from _flat(markers, answer)
    yield from _stretched(markers)
    yield from _unsure_labels(markers)
    if answer.rotation_std > WIDE_TURN:
        yield (
            f"the rotation is known to {np.degrees(answer.rotation_std):.2g} deg (1 sigma) only: "
            "predicted errors, which are first order, are rough"
        )


def _nearly_on_a_line(answer: Registration) -> Iterator[str]:
    shape = answer.condition
    if shape.angle >= NEARLY_ON_A_LINE:
        return
    names = ", ".join(answer.labels[k] for k in answer.used)
    line = answer.T_RC[:3, :3] @ shape.axis / answer.scale
    aside = np.linalg.svd(line[None])[2][1:] * ASIDE  # two arms square to the line
    inverse = np.linalg.inv(answer.T_RC)
    ct = (answer.centre + aside) @ inverse[:3, :3].T + inverse[:3, 3]
    worst = float(answer.tre_rms(ct).max())
    yield (
        f"markers {names} are nearly on one line ({shape.angle:.1f} deg, sine at the first "
        f"{shape.sine:.3f}): a point {ASIDE * 1e3:.0f} mm off it is found to {worst * 1e3:.2g} mm "
        "RMS; move one marker off the line"
    )


def _flat(markers: Markers, answer: Registration) -> Iterator[str]:
    shape = condition_of(markers.ct)
    if len(markers) == 3:
        yield (
            "three markers lie in one plane: a mirrored CT would go unnoticed; check one more point"
        )
    elif shape.thickness < FLAT * shape.spread[1]:
        yield (
            f"the markers lie in one plane within {shape.thickness * 1e3:.2g} mm: a mirrored CT "
            "would go unnoticed; put one marker higher"
        )


def _stretched(markers: Markers) -> Iterator[str]:
    """Distances that differ by a common factor, where the noise is known to be smaller."""
    if not (markers.known and doubtful(markers)):
        return
    scaled = rigid_match(markers.ct, markers.robot, scale=True)
    scale = float(np.cbrt(np.linalg.det(scaled[:3, :3])))
    left = markers.ct @ scaled[:3, :3].T + scaled[:3, 3] - markers.robot
    after = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    if after * MUCH < misfit(markers):
        yield (
            f"distances are {abs(scale - 1) * 100:.2g} % {'longer' if scale > 1 else 'shorter'} by "
            "the robot than in CT: check CT's pitch"
        )


def _unsure_labels(markers: Markers) -> Iterator[str]:
    """Labels that could be exchanged unseen, or seem to be."""
    other = best_relabelling(markers.ct, markers.robot)
    plain = misfit(markers)
    if other.misfit * MUCH < plain and doubtful(markers):
        yield (
            f"other labels fit better ({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm): "
            f"perhaps {exchange(markers, other)}"
        )
    elif markers.known and _as_good(markers, other):
        yield (
            f"nearly symmetric markers: that {exchange(markers, other)} would go unnoticed "
            f"({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm)"
        )


def _as_good(markers: Markers, other: Relabelling) -> bool:
    """Whether exchanged labels, too, agree with the stated noise.

    Whitened squares sum up to no less than the plain ones over the largest variance.
    """
    order = list(other.order)
    largest = np.linalg.eigvalsh(markers.ct_cov + markers.robot_cov)[:, -1].max()
    least = len(markers) * other.misfit**2 / (2 * largest)
    if least > chdtri(3 * len(markers) - 6, DOUBTFUL):
        return False
    exchanged = replace(markers, ct=markers.ct[order], ct_cov=markers.ct_cov[order])
    return not doubtful(exchanged)
