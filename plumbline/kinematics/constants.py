"""Numbers of the geometry and of the drive, each with unit and reason.

What an effect may be sized is declared with its parameter; what is tried of it stands in its file.
"""

ROUNDING = 1e-15  # [1]: entries of a rotation below it are what doubles leave of none
SAME = 1e-12  # [m, rad]: placements that differ by less are one, an arm's length times rounding
SHORT = 1e-9  # [m, 1]: a length or a sine below it has no direction to speak of
NULL = 1e-9  # [s, 1]: keeps a drive's null apart from a division by nothing; exp(-1e9) is zero
# [its mass], 1 sigma: files are of drawings, without cables, covers and what was changed; by hand.
MISSTATED = 0.1
LEAST_LOAD = 0.01  # [N m]: what a joint bears that gravity does not load, for the size of its drive
HOURS = 7200.0  # [s] from which on a moment is told in hours: seconds have five digits
# Between two that are tried of a frequency, width, speed or time constant [their distance]: of a
# thousand rows that breathe by two sigma a quarter leaves more than noise, a 64th does not.
FINER = tuple(side * 0.5**k for k in range(1, 7) for side in (-1.0, 1.0))
TIP_TO_AXIS = 1e-3  # [m]: a tool shorter than that has no direction but the last axis'
UNLIMITED = 1e3  # [m, rad] that a URDF says of a slide without limits, which must have some
COLD = 0.05  # [K] of a recording's span of temperature within which nothing can grow

# Geometry
PARALLEL = 0.05  # sine of an angle between axes, below which a common normal is worthless
DRAWN = 1e-9  # [m, 1] that a table of links may be off the chain that it is drawn of; rounding
# [rad^2]: below, five terms of a series are exact; the quotients that they stand for lose digits
SERIES_BELOW = 1e-4
TINY = 1e-12  # [length^2] keeps the quotients of zero-length segments finite
ALONG = 1e-12  # share of |u|^2 |v|^2, below which two directions count as parallel; rounding
SHORTEST = 1e-3  # [m] of a bone that gets a capsule: it is within its neighbours' else

# Files
LARGEST = 1e12  # no length, angle or mass of a robot is larger [SI]
LARGEST_FILE = 64_000_000  # [byte]: a table of 5 million readings, some 2 GB as cells
LARGEST_URDF = 16_000_000  # [byte]: a page a joint, and room for what nobody reads
STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2] of a base that stands upright
# Pinocchio and urdfdom walk a chain by recursion and end the process at 4,000 joints; the largest
# humanoids with hands have some 100, those that hold a frame for every sensor some 300.
MOST_JOINTS = 500
# An element's attributes are looked through for each one that is added: 100,000 take 25 s.
MOST_ATTRIBUTES = 100
LONGEST_NAME = 60  # characters of a name that a message repeats

# Evaluation: cost only
BLOCK_NUMBERS = 20_000  # of inputs and outputs at a call: what a core keeps at hand
FEWEST_ROWS, MOST_ROWS = 500, 10_000  # of a column: it shall outweigh the call of an operation
MOST_WORK, AT_HAND = 4000, 8_000_000  # columns of a program, their numbers: 64 MB

# Chained
# Fadings of a lag and its servo that differ by less in a sample are told by a series, whose ninth
# term is then below 1e-13; their quotients would lose more.
EQUAL, TERMS = 0.1, 8  # [1]
PLANNED = 8  # steps of a sample of a planned way; twice as many change its parameters by 0.05 %
