"""Numbers of the geometry and of the drive, each with unit and reason.

What an effect may be sized is declared with its parameter; what is tried of it stands in its file.
"""

ROUNDING = 1e-15  # [1]: entries of a rotation below it are what doubles leave of none
SAME = 1e-12  # [m, rad]: placements that differ by less are one, an arm's length times rounding
SHORT = 1e-9  # [m, 1]: a length or a sine below it has no direction to speak of
NULL = 1e-9  # [s, 1]: keeps a drive's null apart from a division by nothing; exp(-1e9) is zero
LEAST_LOAD = 0.01  # [N m]: what a joint bears that gravity does not load, for the size of its drive
HOURS = 7200.0  # [s] from which on a moment is told in hours: seconds have five digits
STEP = (0.5, 0.7, 1.4, 2.0)  # of a speed or way, about one that was chosen: a factor of a root of 2
COARSE = (0.3, 0.55, 1.8, 3.0)  # of a width, likewise: the loop changes with its logarithm
TIP_TO_AXIS = 1e-3  # [m]: a tool shorter than that has no direction but the last axis'
UNLIMITED = 1e3  # [m, rad] that a URDF says of a slide without limits, which must have some
COLD = 0.05  # [K] of a recording's span of temperature within which nothing can grow
