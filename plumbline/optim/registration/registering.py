r"""Registers markers, and judges the size of the noise by what the fit leaves over.

FRE says nothing of TRE (Fitzpatrick 2009, SPIE 7261), so it only serves to estimate the size of the
noise over the stated one,

.. math:: s^2 = \frac{\nu_0 + Q}{\nu_0 + \nu}, \qquad Q = \sum_i |r_i|^2, \quad \nu = 3 n - 6,

r being whitened by the stated noise, which is worth :math:`\nu_0` freedoms (Gelman et al. 2013,
Bayesian Data Analysis, sec. 2.6: the scaled inverse chi-square), and none where Q belies it or
where none was stated. A region's limit is :math:`3 F_{3, \nu_0 + \nu}`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from plumbline.declared import Declared
from plumbline.errors import best_matches, fault, shown
from plumbline.optim.registration import triples
from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.checks import check, condition_of, misfit, spread_of
from plumbline.optim.registration.constants import DOUBTFUL, FEWEST_UNSTATED, NO_PAIR
from plumbline.optim.registration.fiducials import Fiducials, load_fiducials
from plumbline.optim.registration.least_squares import Anisotropic, Fit, Kabsch, Method, best_fit
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.robust import Robust
from plumbline.optim.registration.target import Unstated
from plumbline.optim.registration.words import remarks, trust

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        triples.ThreePoint(), Kabsch(), Anisotropic(), Robust(),
        triples.BestTriple(), triples.CombinedTriples(),
    )
}  # fmt: skip


@dataclass(frozen=True)
class RegistrationOptions(Declared):
    """By which method, and how well markers were read.

    Raises:
        PlumblineError: There is no such method.
    """

    #: a method such as ``ThreePoint((0, 2, 1))``, or the name of one: ``robust``, the weighted fit
    #: of the markers that agree; ``anisotropic``, ``kabsch``, ``three-point``, ``best-triple`` (for
    #: the recording's first target) or ``combined``
    method: Method | str = "robust"
    #: how well markers were read; None takes what the recording states
    noise: MarkerNoise | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.method, str) and self.method not in METHODS:
            near = f"Best matches are {best_matches(str(self.method), METHODS)}"
            raise fault("method", shown(self.method), "a method or its name", near)

    @property
    def chosen(self) -> Method:
        """The method itself."""
        return METHODS[self.method] if isinstance(self.method, str) else self.method


def register(
    recording: Fiducials | str | Path, options: RegistrationOptions | None = None
) -> Registration:
    """Check the markers, register them, and say how far the result can be trusted.

    Args:
        recording: Markers and targets in CT and by the robot, or their folder.
        options: By which method, and how well they were read if the recording does not say.

    Raises:
        PlumblineError: The folder cannot be used, or no frame can be built from the markers; one
            line says why and the way out.
    """
    given = options or RegistrationOptions()
    recording = load_fiducials(recording) if isinstance(recording, str | Path) else recording
    if not isinstance(recording, Fiducials):
        mend = "make one by plumbline.build_fiducials(ct, robot)"
        raise fault("recording", f"a {type(recording).__name__}", "markers, or their folder", mend)
    if given.noise is not None:
        recording = replace(recording, noise=given.noise)
    method = _for_target(given.chosen, recording)
    markers = recording.checked()
    check(markers)
    fit = method.fit(markers)
    answer = _judged(recording, method.name, markers, fit)
    odd = (*fit.notes, *fit.judged.failures, *remarks(markers, answer), *answer.notes)
    targets = zip(recording.targets.ct, recording.targets.labels, strict=True)
    said = tuple(trust(answer, answer.tre(place, None), label, markers) for place, label in targets)
    return replace(answer, notes=(*recording.notes, *odd), trust=said)


def rank_triples(recording: Fiducials, lesion: ArrayLike) -> tuple[Registration, ...]:
    """Every usable triple, registered, the best for a lesion (3,) in CT [m] first; or refused."""
    markers = recording.checked()
    check(markers)
    frames = triples.TripleFrames.of(markers, triples.usable_triples(markers))
    best: dict[tuple[int, ...], triples.Triple] = {}
    for k in np.argsort(frames.tre_squares(np.asarray(lesion, dtype=float)), kind="stable"):
        a, b, c = (int(v) for v in frames.triples[k])
        best.setdefault(tuple(sorted((a, b, c))), (a, b, c))
    found = [register(recording, RegistrationOptions(triples.ThreePoint(t))) for t in best.values()]
    return tuple(sorted(found, key=lambda answer: answer.tre(lesion).rms))


def _for_target(method: Method, recording: Fiducials) -> Method:
    """The best triple is the one for the first target, if none is named."""
    if isinstance(method, triples.BestTriple) and method.lesion is None and len(recording.targets):
        x, y, z = recording.targets.ct[0]
        return triples.BestTriple((float(x), float(y), float(z)))
    return method


def _judged(recording: Fiducials, name: str, markers: Markers, fit: Fit) -> Registration:
    """The report of a fit, its quality worked out from the markers alone."""
    kept = [k for k in range(len(markers)) if k not in fit.shifted]
    rest = markers.select(kept)
    dof = 3.0 * len(kept) - 6.0
    square = best_fit(rest)[1]
    surprise = float(chdtrc(dof, square)) if markers.known else np.nan
    agrees = markers.known and surprise >= DOUBTFUL
    size, freedoms = _size(square, dof, markers.freedoms if agrees else 0.0)
    some = markers.known or markers.ct_cov.any()  # was stated of the noise, if only its proportions
    unstated = None if some else Unstated.of(rest, fit.jacobian[:, kept])
    if unstated is not None:
        size, covariance = unstated.size, unstated.covariance
        reading, unknown = np.diag(unstated.variances), unstated.unknown or _unknown(rest, False)
    else:
        J = fit.jacobian
        covariance = np.einsum("anc,ncd,bnd->ab", J, markers.covariance, J) * size**2
        reading, unknown = rest.ct_cov.mean(axis=0) * size**2, _unknown(rest, agrees)
    return Registration(
        recording=recording,
        method=name,
        T_RC=fit.T_RC,
        scale=fit.scale,
        used=fit.used,
        shifted=tuple(markers.labels[k] for k in fit.shifted),
        condition=condition_of(markers.ct[list(fit.used)]),
        centre=fit.centre,
        covariance=covariance,
        noise_scale=size,
        dof=freedoms,
        surprise=surprise,
        notes=_widened(size) if markers.known and not agrees else (),
        reading=reading,
        unknown="; ".join(fit.judged.failures) or fit.doubt or unknown,
        unstated=unstated,
        judged=fit.judged,
    )


def _size(square: float, dof: float, stated: float) -> tuple[float, float]:
    """The noise over the stated one by whitened squares of so many freedoms, and all freedoms."""
    if np.isinf(stated):
        return 1.0, np.inf
    return float(np.sqrt((stated + square) / (stated + dof))), stated + dof


def _widened(size: float) -> tuple[str, ...]:
    return (
        f"markers misfit {size:.3g} times as much as the stated noise allows: a marker moved, or "
        "the noise is larger; predicted errors are widened by as much, and doubtful until mended",
    )


def _unknown(rest: Markers, agrees: bool) -> str:
    """Why misfits that nothing stated explains say nothing of the noise."""
    if agrees:
        return ""
    if len(rest) < FEWEST_UNSTATED:
        return (
            "three markers cannot show how large the noise is: mend what is stated, or add markers"
        )
    left, spread = misfit(rest), spread_of(rest.robot)
    if left > NO_PAIR * spread:
        return (
            f"the markers misfit by {left * 1e3:.2g} mm over a spread of {spread * 1e3:.2g} mm: "
            "labels went astray, or too many markers moved; read them again"
        )
    return ""
