"""Every threshold of the hand-eye calibration and of the scan, with its unit and where it is from.

*Paper* is Zeng et al. (2017); *200 set-ups* are those of ``plumbline reproduce hand-eye``, *300
set-ups* those of ``plumbline.experiments.benches.hand_eye_coverage``.
"""

import numpy as np

# What is a reading
LONGEST = 20.0  # [m]: no arm's range finder reads farther, but in millimetres it seems to
LARGEST_NOISE = 0.1  # [m]: of noise_std and incidence_bias_std; in millimetres either is above it
LARGEST_ANGLE = 12.0  # [rad]: two turns, rounded down; more is degrees
SAME_TURN = 2e-3  # [rad]: orientations that agree to this are one orientation
SAME_POSE = 1e-6  # [m, 1]: no arm tells closer poses apart
SKEWED = 1e-4  # of |R R^T - 1|: what matrices written with four digits leave
LEAST_ROWS = 8  # readings: five unknowns of the beam and three of a plane
SPARE = 8  # readings beyond the unknowns, to judge by
LEAST_ON_PLANE = 3  # readings: a plane's unknowns
LEAST_FACE = 4  # readings of a face: three for its plane, one to judge by

# Closed form on one plane (paper, eqs. 13-15)
FLAT = 1e-3  # least spread of a group's translations over the largest: below, one is missing
ALIKE = 1e-3  # the same of the normals that give v, and of the equations that give r
LEAST_GROUP = 4  # readings: a first one, and three translations
LEAST_GROUPS = 3  # orientations: v has three components
PARALLEL = np.deg2rad(5.0)  # [rad]: planes closer than this are one direction

# Robust fit
CAUCHY = 2.385  # sigmas: 95 % efficiency on normal errors (Holland and Welsch 1977)
TO_SIGMA = 1.4826  # of a normal's median absolute deviation
ROBUST_ROUNDS = 40  # at most (effort)
ROBUST_SETTLED = 1e-5  # largest step over the unknowns' scale that ends the robust rounds
INNER = 1.5  # robust sigmas within which readings place the frames
SCATTER_SETTLED = 0.98  # of the scatter before: less gained than that ends the refinement
REFINEMENTS = 12  # at most (effort)
# Wrong starts on a fifth of wrong boards left 0.7 mm and more, right ones 0.3 mm at most.
SURE_SCATTER = 0.5e-3  # [m]: scatter that no wrong start leaves
BEYOND, FEW = 4.5, 0.2  # robust sigmas, and the share of readings beyond them that is no matter
# A tenth of all samples of ten readings is clean where a fifth of the readings is not.
TRIALS, SAMPLE, TRIAL_ROUNDS, KEPT = 120, 10, 12, 4
THREES = 300  # of points: with half of them gross an even three comes up but for 1e-17
MOST_MISFIT = 20e-3  # [m]: robust scatter beyond which rows and planes do not belong together
SUSPECT = 1e-3  # [m]: scatter of half a percent of the ranges, that no finder on boards has
BETTER = 5.0  # times less scatter that shows how the poses were meant
# [readings] of a half that tells beam and planes by itself, for each unknown of theirs. Of ranges
# shuffled at random 0.7 for each fit surely in 12 of 12 draws, 1.1 in none; this is nearly twice
# that (test_hand_eye_robust.py fails at 1 and 3).
FOR_EACH_UNKNOWN = 2

# Statement and variances
SHAPES, ARM_SHAPES = 16, 48  # smooth shapes of a board, of the arm: chosen
GROSS = 4.5  # sigmas: one good reading of 150,000 lies beyond
SCALE_TOLD = 3.0  # sigmas: chance alone tells of a scale in one of 370 calibrations
MAD_EFFICIENCY = 0.37  # of a normal's median absolute deviation (Rousseeuw and Croux 1993)
NORMAL_95 = 1.96  # sigmas of a normal that hold 95 %
GROSS_ROUNDS = 3  # of fit and of gross readings left out
LEAST_FREE = 0.05  # share of a reading that its fit leaves over, at the least
# A quarter of a spot of 1.6 mm: a slanted beam is read from somewhere within its spot. At 30 deg
# that is 0.06 mm; makers state more (0.5 % of the range at 30 deg: Micro-Epsilon, optoNCDT 1700).
BIAS_STD = 0.4e-3  # [m]
BOARD_REACH = 0.4  # length of correlation over the largest distance on the board
LEAST_BOWED = 20  # readings on a plane: below that many a bow is not looked for
ARM_SHIFT = 0.3  # [m]: l_t, a link of the arms that carry range finders
ARM_TURN = 0.3  # [rad]: l_R; at 1 rad errors stated across the beam held 89 % (300 set-ups)
READINGS_A_SHAPE = 4  # of the arm, at the least
VARIANCE_ROUNDS = 8  # at most (effort)
VARIANCE_FLOOR = 0.05  # of the variance at normal incidence, and of the mean
LEAST_SLANT = 1e-3  # of sin^2 of the largest incidence: below, no slope is told
LINEAR_ROUNDS, LIKELY_ROUNDS = 3, 15  # by squares, then by likelihood, at most (effort)
VARIANCE_SETTLED = 1e-3  # relative change of a variance that ends the rounds

# What is said and refused
LOST_R, LOST_V = 20e-3, 50e-3  # [m], [rad]: standard errors beyond which nothing is known
INFINITE = 1.0  # [m]: no finder sits farther from its flange, so that nothing is known
POOR_R, POOR_V = 0.5e-3, 2e-3  # [m], [rad]: beyond which it is said
PATCH = 0.03  # width of all points on a plane over the mean range: one patch
LINE = PATCH / 3.0  # of the second width: one line
ALONG = np.cos(np.deg2rad(20.0))  # an axis within this of the beam is along it
LEAST_TURN = 5.0 * SAME_TURN  # [rad]: less is no rotation at all
ONE_TURN = 5e-3  # [rad]: turns whose root mean square is less show r by no more than its noise
ONE_AXIS = 0.02  # of the largest turn: turns about a second axis that are less are none
MANY_GROSS = 0.2  # share of gross readings that is said
FEW_READINGS = 2  # times the unknowns: fewer are said to be few
UNDERSTATED = 2.0  # scatter over the stated noise beyond which something else is at work
OVERSTATED = 5.0  # stated noise over the scatter beyond which the statement is odd

# Next poses
POSES, MOST_POSES = 5, 50  # looked for by default, and at most
TRIES = 400  # candidates
LARGEST_TILT = np.deg2rad(60.0)  # [rad]: of a candidate from a pose that was measured
LEAST_INCIDENCE = np.deg2rad(30.0)  # [rad]: allowed in any case: a finder reads boards so
REACH_STEPS, LONGEST_STEP = 12, 0.4  # of Newton's; [rad or m]
ARRIVED = 1e-5  # [m, rad]

# Scan and surface
LEAST_ROBUST = 10  # readings of a face: fewer cannot tell which of them is gross
FACE_GROSS = 6.0  # robust sigmas: a median of ten readings is itself a quarter off
LEAST_GROSS = 0.5e-3  # [m]: ten sigmas of the paper's finder; nearer is no gross reading
LOST_EDGE = 10e-3  # [m]: standard error at the scan's edge beyond which nothing is fixed
LEAST_SINE = 1e-3  # faces this near to parallel have no angle's derivative
NEIGHBOURS = 12  # points that tell a surface's normal
FIRST_REACH, LAST_REACH = 20e-3, 3e-3  # [m]: how far a match may be, first and last
SURFACE_GAP = 3.0  # spacings: between points drawn at random no place is farther from all of them
SURFACE_DAMPING = 1e-6  # of the mean curvature: ten heads' least is 0.014 to 0.025
SURFACE_STEPS, SURFACE_REST = 60, 1e-9  # at most; [rad, m]: a thousandth of a standard error
LEAST_MATCHED = 0.5  # share of the scanned points
SURFACE_POINTS = 30_000  # on a head's surface, of 0.15 m^2: 2 mm apart
LEAST_SURFACE = 100  # points: normals and matches need neighbours
LARGEST_SURFACE = 3.0  # [m]: no patient and no phantom is larger, but in millimetres it is
LEAST_POINTS = 4  # of another instrument: three are left for a fit
LEAST_LANDMARKS = 3  # points that hold a rigid frame

# Design
DESIGN_DAMPING = 1e-6  # [1 or m^2] of a step to a pose: it stays finite at a singular posture

# Direct
# r [m], v, normals, offsets [m], shapes of boards [m], bias [m], shapes of the arm [m]
SIZES = (1e-2, 1e-1, 1e-1, 1e-2, 1e-4, 1e-3, 1e-4)
FIXED = 14  # numbers of a row that do not depend on planes and shapes: R', t', d, 1
BOW, ARM, BIAS = 0, 1, 2  # kinds of the prior's rows

# Reweighting
BEAM = 5  # first unknowns of the statement: r and the slope of v
NUISANCE_RANK = 1e-10  # of the largest singular value: what no row shows
KNOWN = 1e-13  # of the largest eigenvalue: what is less is rounding's
RESTED = 1e-6  # of the scales, a step after which residuals and slopes are not taken anew
NOTHING = 1e-12  # singular value [scaled] below which nothing is known: an error of 10^10 m
LEAST = 1e-12  # of the largest square: no reading is exact
VANISHING = 1e-12  # [m, m^2] keeps quotients by what has no extent finite; rounding
LEAST_SIGMA = 1e-9  # [m]: perfect data shall not divide by zero

# Scan
SCAN_STEP = 1e-6  # of r [m] and v: derivatives of angles by differences

# Shapes
BOARD_PERCENT = 98.0  # of squared distances: a board's, which no gross reading's place stretches
LEAST_BOARD = 1e-6  # [m] of its size: readings at one place have no shape
LEAST_SPAN = 1e-9  # of a column [1 or m]: below, no reading has it

# Surface
# z of drawn balls, pipes and planes is at most 3.1, of drawn heads and boxes 6.7 at the least (8
# draws each of 60 to 1000 points).
SHOWN = 4.0
FINEST_NORMAL = 1e-3  # [rad]: no normal of a dozen points of CT is known better
SLIDE = 0.3  # of a motion's way at the scan's edge: what turns by less slides

# Three planes
MILLIMETRES = 1e3  # [mm/m]: the weights of the paper are for lengths in mm
