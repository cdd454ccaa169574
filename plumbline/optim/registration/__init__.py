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

from plumbline.optim.registration.answer import Registration as Registration
from plumbline.optim.registration.checks import Condition as Condition
from plumbline.optim.registration.checks import condition_of as condition_of
from plumbline.optim.registration.fiducials import Fiducials as Fiducials
from plumbline.optim.registration.fiducials import build_fiducials as build_fiducials
from plumbline.optim.registration.least_squares import Anisotropic as Anisotropic
from plumbline.optim.registration.least_squares import Fit as Fit
from plumbline.optim.registration.least_squares import Kabsch as Kabsch
from plumbline.optim.registration.least_squares import Method as Method
from plumbline.optim.registration.markers import MarkerNoise as MarkerNoise
from plumbline.optim.registration.registering import METHODS as METHODS
from plumbline.optim.registration.registering import RegistrationOptions as RegistrationOptions
from plumbline.optim.registration.registering import rank_triples as rank_triples
from plumbline.optim.registration.registering import register as register
from plumbline.optim.registration.robust import Robust as Robust
from plumbline.optim.registration.target import TargetError as TargetError
from plumbline.optim.registration.triples import BestTriple as BestTriple
from plumbline.optim.registration.triples import CombinedTriples as CombinedTriples
from plumbline.optim.registration.triples import ThreePoint as ThreePoint
from plumbline.optim.registration.triples import localisation as localisation
from plumbline.optim.registration.triples import three_point as three_point
