"""Pointing a needle at a lesion from every safe angle: a remote centre of motion in software.

``Aim`` says which arm holds which needle at which lesion, ``safe_angle_map`` which angles are safe,
``plan_sweep`` plans one joint path through many of them. Method: Chen et al., three-marker lesion
localisation and omnidirectional needle pointing with a UR3.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.optim.pointing.aim import Aim as Aim
from plumbline.optim.pointing.aim import Needle as Needle
from plumbline.optim.pointing.aim import pointed as pointed
from plumbline.optim.pointing.aim import tip_and_top as tip_and_top
from plumbline.optim.pointing.angle_map import AngleMap as AngleMap
from plumbline.optim.pointing.angle_map import safe_angle_map as safe_angle_map
from plumbline.optim.pointing.body import Box as Box
from plumbline.optim.pointing.body import Capsule as Capsule
from plumbline.optim.pointing.body import Cylinder as Cylinder
from plumbline.optim.pointing.body import HalfSpace as HalfSpace
from plumbline.optim.pointing.body import Sphere as Sphere
from plumbline.optim.pointing.mesh import Mesh as Mesh
from plumbline.optim.pointing.mesh import Scene as Scene
from plumbline.optim.pointing.mesh import Solid as Solid
from plumbline.optim.pointing.options import PointingOptions as PointingOptions
from plumbline.optim.pointing.statement import SweepWeights as SweepWeights
from plumbline.optim.pointing.status import Status as Status
from plumbline.optim.pointing.surroundings import Clearance as Clearance
from plumbline.optim.pointing.sweep import Sweep as Sweep
from plumbline.optim.pointing.sweep import plan_sweep as plan_sweep
