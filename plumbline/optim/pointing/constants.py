"""Numbers of pointing, each with its unit and where it comes from.

What is named "rounding" lies so far from what arms do that an order of magnitude changes no figure;
"effort" is how hard is looked, and shows where something is missed.
"""

import numpy as np

# The task
LEAST_JOINTS = 5  # a point and a direction: three and two equations
ROW = 7  # lesion (3), wanted direction of the needle (3), l + r
EQUATIONS = 5  # of a posture
DAMPING = 1e-9  # of a step of least motion: far below the singular values allowed; rounding
RIGHT_ANGLE = np.pi / 2  # [rad]
TURN = 2 * np.pi  # [rad]
MM = 1e3  # [mm/m]
PARALLEL = 1e-9  # share of a direction across a face below which it runs along it; rounding

# Postures
ZERO = 1e-16  # sum of squares at which the six equations hold: 0.01 um at 1 m; rounding
ITERATIONS = 60  # of damped steps from one start; effort
STALLED = 5  # steps that gain nearly nothing; effort
STARTS = 24  # postures from which an angle of a map is sought; effort
TRIES = 4  # postures of one angle that are judged until one is safe; effort
MAP_ROUNDS = 6  # of asking the neighbours; effort
WHY_STARTS = 16  # postures from which an angle out of reach is sought again; effort
# [m] off the lesion a posture does not hold the needle: a hundredth of its radius.
LARGEST_RCM_ERROR = 1e-5
LARGEST_TURN = 1e-4  # [rad] the same of its direction: 0.05 mm of a needle of 0.5 m

LEAST_DAMPING = 1e-12  # below it the damping does not fall; rounding
FIRST_DAMPING, MOST_DAMPING = 1e-2, 1e3  # of a step, of curvatures of about one: effort
SOFTER, HARDER = 5.0, 4.0  # times, after a step that helped, and after one that did not: effort
GAINS = 0.999  # of a sum of squares: a step that leaves more of it has stalled; effort
SETTLINGS = 15  # steps towards the middle of the ranges; effort
PULL = 0.5  # of the way there, and [rad] at most, in one of them; effort
ALIKE = 0.1  # [rad] of every joint, within which two postures are one; branches are farther apart
SAME_VALUE = 1e-6  # of a singular value: what two searches of one branch differ by; rounding
ORTHONORMAL = 1e-6  # of a rotation that is given: six digits
BEYOND = 1.001  # of the longest step: what a solver's tolerance leaves, and 1 mrad is no leap
# Branches along a sweep
ANCHORS = 3  # angles at which branches are sought; effort
TRACK_STARTS = 48  # postures from which they are; effort
MORE_ANCHORS = 2  # where angles are left that no branch holds; effort
ASKED = 8  # of these angles that are asked whether they can be reached; effort
FEW_STARTS = 12  # from so many postures; effort
MOST_TRACKS = 12  # branches followed: a six-joint arm has 8 at most
NEWTON_STEPS = 6  # from one angle to the next; effort
LONGEST_STEP = 0.5  # [rad] of one such step
HELD = 1e-14  # sum of squares at which a branch holds the needle: 0.1 um at 1 m
LOOKS = 8  # angles of a branch at which coal is asked before it is chosen; effort
HELD_WITHIN = 1e-6  # [m] a path that is farther off lets go of the needle

# What stands around
LARGEST = 5.0  # [m] a solid or a needle that is larger, a lesion that is farther, is in mm
POINT = 1e-3  # [mm] radius of the ball that stands for a point where coal is asked
LEAST_SIZE = 1e-6  # [m] below it a direction or a length is a slip of the pen
LARGEST_FILE = 200_000_000  # [byte] a segmentation of four million triangles
CHUNK = 2_000_000  # pairs of a point and a triangle that are worked on at once: memory
LEAST_VOLUME = 1e-12  # [m^3] a cube of 0.1 mm
SHORTEST = 1e-6  # [m] capsules shorter than this are the ends of others
SAMPLES = 64  # postures that show which links the flange never leaves
ROUNDING = 1e-9  # [m, 1] a bound in metres may be that much off one in millimetres; of a direction
ANGLE_ROUNDING = 1e-12  # [rad] by which an angle that is asked may be off its range
STILL = 1e-9  # [m] what moves less is the arm's mounting; rounding
RESOLUTION = 1e-4  # [m] what a clearance between angles is told to

# Planes in front of it
SLOTS = 16  # rows an angle: eight links beside solids, or four beside the needle
# [m] spare clearance below which a pair gets a row: farther than a replanned path moves.
NEAR = 30e-3
SPARE = 3e-4  # [m] asked beyond the limit, for arcs between the angles; doubled each round
PENALTY = 1e2  # [1/m] of slack; multipliers of rows that can be kept stay far below it
ROUNDS = 4  # of planning again in front of planes; effort
PATIENCE = 2  # of them without gain; effort

# What is shown
NEAREST = 3  # pairs that a card or a page names
