"""Bounded fit of link parameters to tip readings of the space that matters.

``fit_dh(recording)`` is the entry; :mod:`plumbline.optim.dh_fit.statement` states the problem.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.optim.dh_fit.answer import DHFit as DHFit
from plumbline.optim.dh_fit.export import as_toml as as_toml
from plumbline.optim.dh_fit.export import as_urdf as as_urdf
from plumbline.optim.dh_fit.fit import fit_dh as fit_dh
from plumbline.optim.dh_fit.local import HeldOut as HeldOut
from plumbline.optim.dh_fit.local import Space as Space
from plumbline.optim.dh_fit.local import held_out as held_out
from plumbline.optim.dh_fit.local import local_and_global as local_and_global
from plumbline.optim.dh_fit.losses import Norms as Norms
from plumbline.optim.dh_fit.losses import Squares as Squares
from plumbline.optim.dh_fit.poses import reachable as reachable
from plumbline.optim.dh_fit.quantities import DHParameter as DHParameter
from plumbline.optim.dh_fit.quantities import Misfit as Misfit
from plumbline.optim.dh_fit.quantities import Quantity as Quantity
from plumbline.optim.dh_fit.quantities import Status as Status
from plumbline.optim.dh_fit.solvers import BY_NAME as BY_NAME
from plumbline.optim.dh_fit.solvers import SOLVERS as SOLVERS
from plumbline.optim.dh_fit.statement import Pass as Pass
from plumbline.optim.dh_fit.statement import Readings as Readings
from plumbline.optim.dh_fit.task import DHOptions as DHOptions
