"""An answer in words: how far to trust it at a target, and what is odd about it but no fault."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from plumbline.optim.registration import checks, constants
from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.target import TargetError
from plumbline.optim.rigid import rigid_match


def trust(
    answer: Registration, error: TargetError, label: str, markers: Markers | None = None
) -> str:
    """One sentence: how far off the target may be, and what limits it; labels, of markers given."""
    if error.unknown:
        return f"{label}: not known; {error.unknown}"
    far = error.reach
    elsewhere = _elsewhere(answer, error, markers) if markers else ""
    grade = "doubtful" if elsewhere else _grade(answer, far)
    sentence = (
        f"{label}: {grade}{elsewhere}; in 95 of 100 cases it lies within {far * 1e3:.2g} mm of "
        f"where the transform puts it (RMS {error.rms * 1e3:.2g} mm)"
    )
    limits = _limits(answer, error)
    return f"{sentence}{'; ' if limits else ''}{' and '.join(limits)}"


def _elsewhere(answer: Registration, error: TargetError, markers: Markers) -> str:
    """Where labels exchanged unseen would put the target, if that is out of its region."""
    at = answer.T_RC[:3, :3] @ error.ct + answer.T_RC[:3, 3]
    worst, words = error.reach, ""
    for other in checks.relabellings(markers.ct, markers.robot):
        if _unseen(markers, other):
            T = rigid_match(markers.ct[list(other.order)], markers.robot)
            away = float(np.linalg.norm(T[:3, :3] @ error.ct + T[:3, 3] - at))
            if away > worst:
                worst, found = away, checks.exchange(markers, other)
                words = f": were labels exchanged ({found}), none would notice, and it would lie "
                words += f"{away * 1e3:.2g} mm from there; check one more point"
    return words


def _grade(answer: Registration, far: float) -> str:
    """What the region's reach [m] is worth; misfits that belie what was stated make it doubtful."""
    if answer.surprise < constants.DOUBTFUL:
        return "doubtful"
    unsure = (
        _freedoms(answer) < constants.ENOUGH_FREEDOMS
        or _unchecked(answer)
        or answer.surprise < constants.SURPRISING
    )
    if far <= constants.FINE and not unsure:
        return "good"
    return "fair" if far <= constants.COARSE else "poor"


def _freedoms(answer: Registration) -> float:
    """Freedoms by which misfits tell the noise, or check what was stated of it."""
    if answer.unstated is not None:
        return float(answer.unstated.freedoms.min())
    return np.inf if np.isinf(answer.dof) else 3.0 * _kept(answer) - 6.0


def _kept(answer: Registration) -> int:
    return len(answer.labels) - len(answer.shifted)


def _unchecked(answer: Registration) -> bool:
    """Three markers fit a moved one as well."""
    return _kept(answer) == 3


def _limits(answer: Registration, error: TargetError) -> list[str]:
    """What keeps it from being better, or from being known better."""
    found = []
    if 2.0 * answer.tre(error.ct).rms ** 2 < error.rms**2:
        found.append("most of it is how well the target itself is read in CT")
    arm = float(np.linalg.norm(error.robot - answer.centre))
    turned = arm * np.sqrt(np.trace(answer.covariance[3:6, 3:6]))
    if turned > 2.0 * np.sqrt(np.trace(answer.covariance[:3, :3])):
        found.append(
            f"most of the transform's part comes from the rotation over an arm of {arm * 1e3:.0f} "
            "mm: put markers farther apart, and around the target"
        )
    if np.isnan(answer.surprise):
        found.append(
            f"the noise itself is estimated from {answer.dof:.0f} misfits: state the CT's "
            "resolution and the robot's std"
        )
    if _unchecked(answer):
        mirrored = "or that an axis of CT is mirrored"
        found.append(f"three markers cannot show that one of them moved, {mirrored}")
    elif answer.unstated is None and _freedoms(answer) < constants.ENOUGH_FREEDOMS:
        found.append(f"{_kept(answer)} markers hardly check what was stated of the noise")
    if answer.surprise < constants.DOUBTFUL:
        found.append("the markers misfit more than the stated noise allows, so it may be worse")
    elif answer.surprise < constants.SURPRISING:
        found.append(
            f"fewer than {constants.SURPRISING:.0%} of markers misfit so much under the stated "
            f"noise: it is taken for {answer.noise_scale:.2g} times as large; check what was stated"
        )
    return found


def remarks(markers: Markers, answer: Registration) -> Iterator[str]:
    """What is odd but no fault, one line each."""
    yield from _nearly_on_a_line(answer)
    yield from _flat(markers, answer)
    yield from _stretched(markers)
    yield from _unsure_labels(markers)
    if answer.rotation_std > constants.WIDE_TURN:
        yield (
            f"the rotation is known to {np.degrees(answer.rotation_std):.2g} deg (1 sigma) only: "
            "predicted errors, which are first order, are rough"
        )


def _nearly_on_a_line(answer: Registration) -> Iterator[str]:
    shape = answer.condition
    if shape.angle >= constants.NEARLY_ON_A_LINE:
        return
    names = ", ".join(answer.labels[k] for k in answer.used)
    line = answer.T_RC[:3, :3] @ shape.axis / answer.scale
    aside = np.linalg.svd(line[None])[2][1:] * constants.ASIDE  # two arms square to the line
    inverse = np.linalg.inv(answer.T_RC)
    ct = (answer.centre + aside) @ inverse[:3, :3].T + inverse[:3, 3]
    worst = float(answer.tre_rms(ct).max())
    yield (
        f"markers {names} are nearly on one line ({shape.angle:.1f} deg, sine at the first "
        f"{shape.sine:.3f}): a point {constants.ASIDE * 1e3:.0f} mm off it is found to "
        f"{worst * 1e3:.2g} mm RMS; move one marker off the line"
    )


def _flat(markers: Markers, answer: Registration) -> Iterator[str]:
    shape = checks.condition_of(markers.ct)
    if len(markers) == 3:
        yield (
            "three markers lie in one plane: a mirrored CT would go unnoticed; check one more point"
        )
    elif shape.thickness < constants.FLAT * shape.spread[1]:
        yield (
            f"the markers lie in one plane within {shape.thickness * 1e3:.2g} mm: a mirrored CT "
            "would go unnoticed; put one marker higher"
        )


def _stretched(markers: Markers) -> Iterator[str]:
    """Distances that differ by a common factor, where the noise is known to be smaller."""
    if not (markers.known and checks.doubtful(markers)):
        return
    scaled = rigid_match(markers.ct, markers.robot, scale=True)
    scale = float(np.cbrt(np.linalg.det(scaled[:3, :3])))
    left = markers.ct @ scaled[:3, :3].T + scaled[:3, 3] - markers.robot
    after = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    if after * constants.MUCH < checks.misfit(markers):
        yield (
            f"distances are {abs(scale - 1) * 100:.2g} % {'longer' if scale > 1 else 'shorter'} by "
            "the robot than in CT: check CT's pitch"
        )


def _unsure_labels(markers: Markers) -> Iterator[str]:
    """Labels that could be exchanged unseen, or seem to be."""
    other = checks.best_relabelling(markers.ct, markers.robot)
    plain = checks.misfit(markers)
    if other.misfit * constants.MUCH < plain and checks.doubtful(markers):
        yield (
            f"other labels fit better ({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm): "
            f"perhaps {checks.exchange(markers, other)}"
        )
    elif _unseen(markers, other):
        yield (
            f"nearly symmetric markers: that {checks.exchange(markers, other)} would go unnoticed "
            f"({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm)"
        )


def _unseen(markers: Markers, other: checks.Relabelling) -> bool:
    """Whether exchanged labels, too, agree with the noise: as stated, or as misfits tell it."""
    if not markers.known:
        return other.misfit <= constants.MUCH * checks.misfit(markers)
    order = list(other.order)
    largest = np.linalg.eigvalsh(markers.ct_cov + markers.robot_cov)[:, -1].max()
    least = len(markers) * other.misfit**2 / (2 * largest)
    if least > chdtri(3 * len(markers) - 6, constants.DOUBTFUL):
        return False
    exchanged = replace(markers, ct=markers.ct[order], ct_cov=markers.ct_cov[order])
    return not checks.doubtful(exchanged)
