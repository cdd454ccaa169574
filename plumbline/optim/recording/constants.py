"""Every limit and plausibility of a recording, with its unit and where it is from.

Those of other set-ups stand where they are tried (:mod:`plumbline.optim.recording.set_up`).
"""

import numpy as np

# Files
LARGEST = 1e12  # no SI reading of a robot is larger
MOST_ROWS = 1_000_000  # an hour at 278 Hz; as cells of text they take some 2 s and 1 GB
MOST_COLUMNS = 10_000  # every kind of column of 500 joints, twice
LARGEST_SETTINGS = 1_000_000  # [byte]: a hundred times what a recording's settings take
LONGEST_REASON = 200  # characters of what tomllib says
# tomllib keeps every beginning of a dotted key or title: time and memory grow with its square.
MOST_PARTS = 100

# Rows
SAME_POSTURE = 1e-6  # [rad or m]: encoders do not resolve less
BETTER_ROWS = 3  # times the least rows: fewer are said to be few
STILL = 1e-9  # [m or rad]: what moves less was not measured

# Joints
TURNS = 4.0 * np.pi  # [rad]: no joint of an arm is read beyond two turns unless its limits say so
SLACK = 0.1  # [rad or m]: beyond a limit by this much is a note
BEYOND_LIMIT = 1e-6  # [rad or m]: what six written digits round
MILLIMETRES = 31.6  # of a slide's travel: midway, as a factor, between 1 and the 1000 of a unit
LARGEST_TWIST = 7.0  # [rad]: of a DH row; one turn, rounded up
# Shares of turning joints' cells: outside if taken as degrees, beyond two turns, outside as given.
AS_DEGREES, EXTREME, OUTSIDE = 0.05, 0.1, 0.5

# Robot
LARGEST_ARM = 100.0  # [m]: longer than any arm
LARGEST_TOOL = 1.0  # [m], or the arm's reach where that is more
LARGEST_GRAVITY = 50.0  # [m/s^2]: twice Jupiter's; in mm/s^2 it is above
EARTH = (9.7, 9.9)  # [m/s^2]: 9.76 to 9.83 over the earth's surface

# Tips
MEETS = 0.2  # of the tips' spread: further off, they do not meet the predicted ones
CONVERTED = 0.1  # of the misfit is left, at most, in the unit that is right
SMALLEST_SPREAD = 1e-3  # [m]: below, a ratio of spreads says nothing
SCALES = (
    (1000.0, "millimetres: divide by 1000"),
    (100.0, "centimetres: divide by 100"),
    (1.0 / 0.0254, "inches: multiply by 0.0254"),
)
NEAR_SCALE = 3.0  # as a factor: midway between the units, 10 apart
FARTHEST = 2.4  # of reach and tool: across the ball that an arm reaches, and a fifth
HUGE = 0.05  # of the tips' spread: no robot that is one misses its model so far
# Of it, from where a verdict is not to be relied on: tips that know nothing of a UR5 miss it by 0.9
# or more, those of one with all zeros off by 0.1 rad (1 sigma) by up to 0.24, of 20 draws each.
UNMET = 0.25
FEWEST = 5  # rows: frame and tool fit almost any four
OUT_OF_BASE = 0.25  # of the tips' spread: readings so far off are not in the robot's base frame
# [rad or m] that a second encoder's zero is off when it is no joint's error: three times the widest
# width that a joint's zero has before the data (32 mrad), beyond which no prior of ours reaches.
MOUNTED = 0.1

# Noise
LEAST_NOISE = 1e-8  # [m or rad]: less than any device reads
COARSE = 0.01  # of the reach, or of a radian: coarser is said

# Quaternions
UNIT_TOLERANCE = 1e-3  # of a quaternion's norm
ODD = 0.1  # [rad]: beyond this some convention may be wrong
BETTER = 0.2  # of that is left in the right one
ALIKE = 0.02  # [rad]: conventions that leave no more than this are told together
LINE = 0.02  # second spread of the tips over the first: below, they fix no frame

# Rates
LARGEST_SPEED = 1e3  # [rad/s or m/s]: a spindle of 10,000 rpm turns at that
LARGEST_ACCELERATION = 1e6  # [rad/s^2 or m/s^2]: a hundred times a blow on a tool
LARGEST_EFFORT = 1e6  # [N m or N]: a hundred times the heaviest arm's

# Surroundings
KELVIN, FAHRENHEIT = 200.0, 60.0  # [degC]: medians that are no room's
TEMPERATURES = (-60.0, 120.0)  # [degC]: machines stand in no colder and no hotter place
LARGEST_PAYLOAD = 5000.0  # [kg]: the heaviest robots carry 2300

# Motions
# [Hz] of derived accelerations: what arms are driven with ends below 5 Hz (Swevers, Verdonck, De
# Schutter 2007), their joints' elasticity begins above 10.
BANDWIDTH = 10.0
LEAST_WINDOW = 4  # samples either side: a quintic through fewer smooths nothing
GAP_IN_TIME = 5.0  # usual steps beyond which a new run begins
SURE_SPEED = 5e-3  # of the fastest: slower, a joint's sense of turning is not sure
# A sensor's end: rows that read it, more than twice those within so many of its steps (a slow sine
# about its crest reads as many), where the model's efforts spread over so much of it.
AT_ITS_END, ENDS_WITHIN, ENDS_OFF = 10, 3.5, 0.05
# Where noise is added to what has ended: shares of rows [all rows] beyond an end that are tried, by
# hand, up to a half (test_filtered_efforts.py fails with the last alone).
BEYOND_ENDS = (0.005, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
SURELY = 3.0  # standard errors that an effort is beyond an end, or within
FLAT = 1.5  # of an effort's noise: what reads an end scatters by less than a slow crest
# Nats, of which dry friction without an end had 12 once in 60 draws (test_filtered_efforts.py fails
# at 3 and 600).
SURELY_ENDS = 20.0
UNSIGNED = 0.98  # share of efforts of one sign where the model's change it: no signs were recorded
FEWEST_EFFORTS = 20  # rows from which the signs of efforts say anything
LEAST_EFFORT_NOISE = 1e-6  # of a joint's efforts: less than 20 bits resolve
# Times a stated noise by which efforts scatter from row to row: one is known to a sixth, and what
# is up to a few times as large is told beside causes.
BELIED = 3.0
INERTIA_ROWS = 200  # postures over which an inertia is averaged (cost only)
EFFORT_ROWS = 3000  # rows from which the efforts' noise is estimated (cost only)

CHANGES = (0.2, 0.8)  # share of a model's larger efforts of one sign, between which it changes
# Derivatives
# Of the polynomials of smoothed derivatives (Savitzky and Golay 1964): of a sine of 1 Hz cubics of
# the same bandwidth take 1 % of the acceleration away, which masses then explain; these 0.01 %.
ORDER = 5
USUAL = 0.99  # of steps, which a motion in fifty rows at most leaves out
SPEEDS_UP = 3.0  # times the largest of a motion's own steps: no joint moves so for one row
SHORTEST = 50  # rows of a run, on average: what leaps more often is no motion
MEDIAN = 0.6745  # of the size of normal noise of one
# The same of third differences (1, 3, 3, 1) of white noise.
THIRD_DIFFERENCE = MEDIAN * 20**0.5

# Efforts
ONE_COURSE = 0.9  # cosine of what differs by its unit alone, noise of an encoder beside it

# Late
LATEST = 0.2  # [s]: filters of drives and loggers' queues take less
# Nats of likelihood: one channel in twenty is late (3), by some hundredth of the latest either way
# (5). Noise and smoothing made at most 4 of 48 that were not (test_late_channels.py).
SURELY_LATE = 10.0
# Times the latest, of successive rows: the rows on either side of a block, which are asked with
# it, are a fifth of it. At 5 a block is two fifths longer, at 20 a log of 5 ms is asked at three
# places alone, not seven (test_late_channels.py fails at both).
BLOCK = 10
FEWEST_BLOCKS = 3  # [1]: a log's beginning, middle and end, whichever the robot stands still in
HARDLY = 1e-9  # of orthonormal columns' squares: what the rows asked do not have of them
LEAST = 0.05  # of a row: less is of the smoothing and of the parabola
AGAIN = 6  # times that a place is found from one nearer, each half as far off
# [nats] of likelihood by which a filter must beat a queue: as strong evidence (Jeffreys 1961).
# Queues alone gave 0 in 11 of 12 draws (test_filtered_efforts.py fails at 0 and 30).
SURELY_FILTERED = 3.0
# [s] of filters that are tried, by hand, a half more each: some rows of usual logs to the latest
# (test_filtered_efforts.py fails with the last alone).
FILTERS = (0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2)
FINER = 9  # times between three of these, about whose best a parabola finds it (cost only)
FORGOTTEN = 3  # of these latest: by then a filter has forgotten 95 % of how a run began, and more
FINE = 401  # places between the rows before and after the best: 0.1 ms of rows 20 ms apart

# Mixed up
# Ratio of squares between unit vectors, 2 (1 - c), at which columns are mixed up: a third of the
# distance. A reversed column is refused from c = -0.8 on; two joints that carry the same weight,
# whose columns run with each other at 0.85, are told apart where the right ones reach 0.984.
MIXED_UP = 9.0
ROUNDING = 0.01  # of a cosine: rows at the ends, which do not meet another

# Noise shape
TIP_AXES = 3  # axes of a place

# Origin
FIRST_ROW = 2  # of a table, as an editor counts lines: the header is row 1

# Recording
SOCKETS = 1_000_000  # by which the sockets of one recording are told from those of the next

# Repeated
REPEATED = 0.1  # of the rows in which joints move: as many that bring nothing new are no chance
FEW = 5  # rows that may bring nothing new by chance
UNDER_WAY = 3.0  # times the least step of an encoder, on both sides of a row: a joint is under way
EVEN = 2.0  # ratio of these two steps: it neither stops nor sets off between them

# Session
ONE_ROBOT = 0.01  # of joints' placements, within which two models are one robot's [m] and [rad]
SAME_GRAVITY = 0.1  # [m/s^2] by which one mounting's may differ: half a degree, and the earth's own
# Of the rows of the smaller [1]: with a half of 120 in common a ripple alone was named, as without,
# with three quarters four more (test_several_statement.py fails at 0.3 and 0.8).
MOST_IN_COMMON = 0.5
NO_SOCKET = -1  # of a row that is in none

# Set up
PLAUSIBLE = 0.01  # of the robot's reach, of a radian for encoders: see plausible()
ASKED = 0.1  # of the plausible: the sign of a joint with a short lever misses by little
MENDED = 0.1  # of the misfit is left, at most, by the set-up that is right
FEWEST_POSTURES = 10  # postures: the best of two hundred set-ups may fit fewer by chance
MOST_SIGNS = 7  # joints of which all patterns of signs are tried: 127 of them
# Of the misfit: two set-ups that leave less are one, such as a half turn of a shoulder.
ONE_SET_UP = 1e-3
WINDOWS = 40  # of successive rows, one of which meets the model as it is (cost only)
# Rows next to a part that is right that make a slip, not gross errors: a frame that is known leaves
# a tenth of three axes' misfit by chance in one of 1e3 rows (test_from_a_row_on.py fails at 1, 7).
FEWEST_MENDED = 4
# Share [1] of such rows that a frame of their own meets: a fifth may be gross, as many as are ever
# distrusted (MOST_GROSS_SHARE of a diagnosis; test_from_a_row_on.py fails at 0.5 and 0.95).
WHOLE = 0.8
# Mean length [1] on the unit circle of what a joint is off by: exp(-s^2 / 2) of angles that scatter
# by s, wrapped normal (Mardia and Jupp 2000, Directional Statistics), 26 degrees; what is random
# has 0.1 in 100 rows (test_from_a_row_on.py fails at 0.8 and 0.97).
ONE_ANGLE = 0.9
# [rows] by which measurements of a part may be late or early: by hand, what loggers drop at once or
# one leaves out; more are two recordings (test_from_a_row_on.py fails at 2 and 4).
ROWS_OFF = 3
IN_A_SOCKET = 4  # rows, at least: k-means then left a fifth of 300 drawn scatters at the least
SOCKET_STARTS = 20  # of k-means
LISTED_SET_UPS = 3  # set-ups that a line names
LEVER = 0.3  # [m]: an angle counts as the way that it moves a tip so far off

# Slips
FRAME_STEPS = 8  # of Gauss and Newton for frame and tool
HARDLY_TOLD = 1e-3  # of the largest singular value: a tool's direction that hardly any row tells

# Stand in
MOST_NAMED = 30  # labels that a note lists
SLIDE = 1.0 / 3.0  # [m] of travel, so that the reach of all three is a metre
