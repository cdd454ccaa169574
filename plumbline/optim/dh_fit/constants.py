"""Numbers of the link fit, each with its unit and where it comes from.

What is named "rounding" lies so far from what data can do that an order of magnitude changes no
figure.
"""

import numpy as np
from scipy.special import gammaincinv

# What is asked for
DELTA_LENGTH = 0.01  # [m] half-width of the bounds of d and a, unless stated
DELTA_ANGLE = float(np.radians(5.0))  # [rad] the same of angles
FRAME_SCALE = 0.01  # [m or rad] size of a frame's step: that of the links' bounds
TOOL_SCALE = 0.01  # [m] the same of a tool's
WIDE_BOUNDS = 1e3  # of these sizes: 10 m and beyond one turn, no bound at all

# The losses
MEDIAN = 2.0 * float(gammaincinv(1.5, 0.5))  # of a squared length of Gaussian noise of variance 1
COUNT_OF_DIRECTIONS = 2000  # of a mean over the sphere: moments to 1e-3 where axes are as 1 : 2 : 4

# The steps
FACTOR = 30.0  # between two smoothings of solvers led to the corner: speed alone
FEW = 2000  # readings that solvers are led to the corner on: speed alone

# What the poses can tell
DEPENDENT = 1e-8  # of a column is left where it depends on others; rounding
ABSENT = 1e-10  # of the largest column: without effect; rounding
MOST_POSES = 4000  # poses looked at; of more, evenly spread ones speak for all
PARTNER = 1e-6  # smallest share of a partner; rounding
# Standard errors of a sum: all that a held one's bounds allow widens an interval of 95 % by 0.5
# %.
SLIGHT = 0.1
WHOLE = 1e-2  # a coefficient this near to 1 or -1 is written as a sign
UNBOUNDED = 1e3  # half-widths in place of one: no bound at all

RANK = 1e-12  # of the largest singular value, below which a direction is not told; rounding
ORTHONORMAL = 1e-14  # of a polar factor, from which on it is one; rounding
# What is left
RESTING = 1e-6  # of a bound's half-width: at the bound; rounding
CHANCE = 1e-3  # of chi-square by which noise as stated is called another
STATED_WITHIN = 1.1  # factor to which a stated noise is known: a data sheet's two digits
ROUNDING = 1e-9  # [m] noise below is rounding: nothing is left to be solved
COARSE = 3.0  # stated noises: misfits within them are the device's
LEAST_SOFT = 1e-7  # [rad] of a joint's turn under weight: 1 m sees it as 0.1 um
MOST_SOFT = 1e-2  # [rad] the same as 10 mm: beyond, set-ups are refused
MOST_SOFT_ROWS = 600  # readings looked at; of more, evenly spread ones speak for all

# Gross rows
FALSE_ALARM = 0.01  # chance of a gross row in a recording of Gaussian noise
# Over F's limit, as shape and size come from the same rows: of 480 recordings of 40 to 100 clean
# rows 3 have a false alarm so, 27 without.
SLACK = 1.7
MOST_SHARE = 0.4  # of the rows: more are no exceptions
FEWEST_FREEDOM = 15  # degrees of freedom below which the noise itself is hardly known
FEWEST_ROWS = 20  # with misfits from which a shape is taken; of fewer it is a sphere
SHAPE_ROUNDS = 30  # of Tyler's iteration: 60 rows of axes 1 : 2 : 4 to 4e-10
LEAST_SHAPE = 1e-4  # keeps noise without a third direction from one of no size in it
LOST = 1e-14  # of the largest singular value: a direction that nothing tells; rounding
UNSEEN = 1e-9  # of the largest singular value, or [m/rad] of a column: nothing is seen; rounding
LEAST_LEFT = 0.1  # of V: a row of which the fit leaves less sets its own misfit

# Registration points
COUNT = 4  # points: three fix a frame, a fourth off their plane makes H invertible
FLATTEST = 1e-3  # smallest over largest extent of the four points
SPARE_STEPS = 2  # Newton iterations beyond those that the nominal points need
MOST_STEPS = 40  # Newton iterations at most; 200 draws of points not flat took 6

# Poses to record
CANDIDATES = 400  # random reachable poses that a design is chosen from
TARGETS = 60  # of the space, over which the expected error is taken
SWEEPS = 8  # exchanges of every pose at most; effort
BETTER = (1e-12, 1e-15)  # of a score, and beside it, what an exchange is to gain; rounding
TRIES = 200  # times as many draws as candidates are wanted before a space is refused
VAGUE = 1e-8  # prior precision of the frame, in units of the links'

# Files
AGREES = 1e-9  # [m, or of a rotation's entry] what a file read again may be off; rounding
POSTURES = 20  # at which it is tried
