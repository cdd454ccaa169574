"""Bounded fit of link parameters to tip readings of the space that matters.

``fit_dh(recording)`` is the entry; :mod:`plumbline.optim.dh_fit.statement` states the problem.
"""

from plumbline.errors import PlumblineError
from plumbline.optim.dh_fit.answer import DHFit
from plumbline.optim.dh_fit.export import as_toml, as_urdf
from plumbline.optim.dh_fit.fit import fit_dh
from plumbline.optim.dh_fit.local import HeldOut, Space, held_out, local_and_global
from plumbline.optim.dh_fit.losses import Norms, Squares
from plumbline.optim.dh_fit.poses import reachable
from plumbline.optim.dh_fit.quantities import DHParameter, Misfit, Quantity, Status
from plumbline.optim.dh_fit.solvers import BY_NAME, SOLVERS
from plumbline.optim.dh_fit.statement import Readings
from plumbline.optim.dh_fit.sums import Pass
from plumbline.optim.dh_fit.task import DHOptions

__all__ = [
    "BY_NAME",
    "SOLVERS",
    "DHFit",
    "DHOptions",
    "DHParameter",
    "HeldOut",
    "Misfit",
    "Norms",
    "Pass",
    "PlumblineError",
    "Quantity",
    "Readings",
    "Space",
    "Squares",
    "Status",
    "as_toml",
    "as_urdf",
    "fit_dh",
    "held_out",
    "local_and_global",
    "reachable",
]
