"""Where is the lesion in the robot's frame? Markers seen in CT and by the robot say it.

- :func:`register`: a recording, or its folder, and :class:`RegistrationOptions` give a
  :class:`Registration`: ``T_RC``, ``fre``, ``misfits``, ``calculation_error``, ``condition``,
  ``notes``; ``map(points)``, ``tre(lesion)`` and ``tre_rms(points)``.
- :func:`build_fiducials`: a recording from arrays.
- :class:`ThreePoint`, :class:`Kabsch`, :class:`Anisotropic`, :class:`Robust`, :class:`BestTriple`,
  :class:`CombinedTriples`: methods, frozen options, by name in ``METHODS``.
  ``method.batch(ct (..., n, 3), robot, noise)`` returns ``T_RC`` (..., 4, 4) of many draws,
  unchecked and without errors.
- :func:`rank_triples`: every triple as a registration, the best for a lesion first.
- :class:`MarkerNoise`: by ``from_std(ct=, robot=)``, ``from_resolution([5e-3, 1e-3, 1e-3],
  robot_std)``, or covariances; left out, its size is estimated.
- :class:`TargetError`: ``covariance``, ``rms``, ``semi_axes(share)``, ``holds(errors, share)``.
- :func:`localisation`: the three-point frame as a CasADi function of 18 coordinates and a target.

Lengths in m, angles in rad; ``T_RC`` maps CT's coordinates to the robot's.
"""

from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.checks import Condition, condition_of
from plumbline.optim.registration.fiducials import Fiducials, build_fiducials
from plumbline.optim.registration.least_squares import Anisotropic, Kabsch
from plumbline.optim.registration.markers import MarkerNoise
from plumbline.optim.registration.method import Fit, Method
from plumbline.optim.registration.registering import (
    METHODS,
    RegistrationOptions,
    rank_triples,
    register,
)
from plumbline.optim.registration.robust import Robust
from plumbline.optim.registration.target import TargetError
from plumbline.optim.registration.three_point import ThreePoint, localisation, three_point
from plumbline.optim.registration.triples import BestTriple, CombinedTriples

__all__ = [
    "METHODS",
    "Anisotropic",
    "BestTriple",
    "CombinedTriples",
    "Condition",
    "Fiducials",
    "Fit",
    "Kabsch",
    "MarkerNoise",
    "Method",
    "Registration",
    "RegistrationOptions",
    "Robust",
    "TargetError",
    "ThreePoint",
    "build_fiducials",
    "condition_of",
    "localisation",
    "rank_triples",
    "register",
    "three_point",
]
