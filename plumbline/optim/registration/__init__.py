"""Where is the lesion in the robot's frame? Markers seen in CT and by the robot say it.

- :class:`ThreePoint`, :class:`Kabsch`, :class:`Anisotropic`, :class:`Robust`, :class:`BestTriple`,
  :class:`CombinedTriples`: methods, frozen options, by name in ``METHODS``. Called as
  ``method(ct (n, 3), robot (n, 3), noise, labels)`` they return a :class:`Registration`;
  ``method.batch(ct (..., n, 3), robot, noise)`` returns ``T_RC`` (..., 4, 4) of many draws,
  unchecked and without errors.
- :func:`rank_triples`: every triple as a registration, the best for a lesion first.
- :class:`Noise`: ``Noise.from_std(ct=, robot=)``, ``Noise.from_resolution([5e-3, 1e-3, 1e-3],
  robot_std)``, or covariances; left out, its size is estimated.
- :class:`Registration`: ``T_RC``, ``fre``, ``misfits``, ``calculation_error``, ``condition``,
  ``notes``; ``map(points)``, ``tre(lesion)`` and ``tre_rms(points)``.
- :class:`TargetError`: ``covariance``, ``rms``, ``semi_axes(share)``, ``holds(errors, share)``.
- :class:`PlumblineError`: markers that no frame can be built from, in one line.
- :func:`localisation`: the three-point frame as a CasADi function of 18 coordinates and a target.

Lengths in m, angles in rad; ``T_RC`` maps CT's coordinates to the robot's.
"""

from collections.abc import Mapping

from plumbline.errors import PlumblineError
from plumbline.optim.registration.anisotropic import Anisotropic
from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.condition import Condition, condition_of
from plumbline.optim.registration.markers import Markers, Noise
from plumbline.optim.registration.method import Fit, Method
from plumbline.optim.registration.registering import register
from plumbline.optim.registration.rigid import Kabsch
from plumbline.optim.registration.robust import Robust
from plumbline.optim.registration.target import TargetError
from plumbline.optim.registration.three_point import (
    ThreePoint,
    localisation,
    marker_frame,
    three_point,
)
from plumbline.optim.registration.triples import BestTriple, CombinedTriples, rank_triples

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        ThreePoint(),
        Kabsch(),
        Anisotropic(),
        Robust(),
        BestTriple(),
        CombinedTriples(),
    )
}

__all__ = [
    "METHODS",
    "Anisotropic",
    "BestTriple",
    "CombinedTriples",
    "Condition",
    "Fit",
    "Kabsch",
    "Markers",
    "Method",
    "Noise",
    "PlumblineError",
    "Registration",
    "Robust",
    "TargetError",
    "ThreePoint",
    "condition_of",
    "localisation",
    "marker_frame",
    "rank_triples",
    "register",
    "three_point",
]
