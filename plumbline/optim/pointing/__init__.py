"""Pointing a needle at a lesion from every safe angle: a remote centre of motion in software.

``Aim`` says which arm holds which needle at which lesion, ``safe_angle_map`` which angles are safe,
``plan_sweep`` plans one joint path through many of them. Method: Chen et al., three-marker lesion
localisation and omnidirectional needle pointing with a UR3.
"""

from plumbline.errors import PlumblineError
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.angle_map import AngleMap, safe_angle_map
from plumbline.optim.pointing.body import Box, Capsule, Cylinder, HalfSpace, Sphere
from plumbline.optim.pointing.mesh import Mesh
from plumbline.optim.pointing.needle import Needle, pointed, tip_and_top
from plumbline.optim.pointing.options import PointingOptions
from plumbline.optim.pointing.scene import Scene, Solid
from plumbline.optim.pointing.statement import SweepWeights
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance
from plumbline.optim.pointing.sweep import Sweep, plan_sweep

__all__ = [
    "Aim",
    "AngleMap",
    "Box",
    "Capsule",
    "Clearance",
    "Cylinder",
    "HalfSpace",
    "Mesh",
    "Needle",
    "PlumblineError",
    "PointingOptions",
    "Scene",
    "Solid",
    "Sphere",
    "Status",
    "Sweep",
    "SweepWeights",
    "plan_sweep",
    "pointed",
    "safe_angle_map",
    "tip_and_top",
]
