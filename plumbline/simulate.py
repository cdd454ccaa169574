"""What is not measured but made up: arms, range finders and instruments, and loops on them.

``plumbline.simulate.session`` and so on; what simulates shares no code with what it judges.
"""

from plumbline.experiments.mpc import campaign as campaign
from plumbline.experiments.mpc import closed_loop as closed_loop
from plumbline.experiments.mpc import passes as passes
from plumbline.experiments.mpc import tracked as tracked
from plumbline.experiments.reality import arms as arms
from plumbline.experiments.reality import bench as bench
from plumbline.experiments.reality import cases as cases
from plumbline.experiments.reality import drives as drives
from plumbline.experiments.reality import mpc_scenarios as mpc_scenarios
from plumbline.experiments.reality import recorder as recorder
from plumbline.experiments.reality import scene as scene
from plumbline.experiments.reality import session as session
from plumbline.experiments.reality import tip_readings as tip_readings
from plumbline.experiments.reality.parts import drawing as drawing
from plumbline.experiments.reality.ranging import finder as finder
from plumbline.experiments.reality.ranging import phantoms as phantoms
from plumbline.experiments.reality.ranging import writing as writing
from plumbline.experiments.withheld import design as design
from plumbline.experiments.withheld import making as making
