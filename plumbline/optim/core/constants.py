"""Statements and solvers: numbers, each with its unit and where it comes from."""

# Answer
LARGEST_ANSWER = 500_000_000  # [byte]: a fit of 100,000 rows with all its arrays takes a tenth

# Judged
STILL = 0.1  # standard errors: what moves by less changes no figure by half a per cent
STATIONARY = 1e-5  # of the scales: ten times what solvers are asked for
FEASIBLE = 1e-8  # of a bound or constraint, in the unknowns' own units: what rounding leaves
LEAST_RESIDUAL = 1e-9  # [the residual's unit] below lies rounding, which no step makes smaller
# Of the largest curvature: below, a direction is not told by the rows. Sixty places known to
# 0.05 mm tell it to 0.6 m there, such as an upright tool's length beside the frame's height.
SINGULAR = 1e-10
# Of the largest diagonal entry, what that of an unknown counts as which nothing tells; rounding.
LEAST_DIAGONAL = 1e-12
LISTED = 4  # unknowns at a bound that a line names

NO_CURVATURE = 1e-13  # of a scaled matrix, times its size: an eigenvalue below is rounding's
LOST = 1e-6  # of a unit unknown, in directions that nothing tells, from which it is not known
# Mapped
CHUNK_NUMBERS = 4_000_000  # of a block of rows that is worked on at once: 32 MB (cost only)
NEARBY = 0.1  # of a step, for differences along it (Transtrum and Sethna 2012, sec. 3.2)

# Shares
LEVEL = 0.95  # of every interval here; the field's habit
SIDES = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # quantiles between which it lies

BARELY = 0.005  # of a share, from 0 or 1, within which it would read 0 or 100 %
SURE = 1e-9  # of a probability, from 0 or 1: no data make it more

# Solution
NEAR = 1e-6  # of a scale or a constraint's size, within which an unknown stands at its bound

# Levenberg and Marquardt
GROWTH = 2.0  # of the damping where a step fails, doubled each time it fails again (Nielsen)
LEAST = 0.1  # of the damping that stays where a step keeps its promise; Nielsen takes a third
KEPT = 0.5  # of a step's promise; who keeps less goes along a valley that bends
MOST_TURN = 0.75  # of a step, twice its turn (Transtrum and Sethna 2012, eq. 15)

LEAST_DAMPING = 1e-14  # below it the damping does not fall; rounding
HOPELESS = 1e8  # damping at which no step is seen to help any more
# Programme
LEAST_COST = 1e-30  # of a row: below it F_0 is rounding

# Rigid matches
SAMPLE = 500  # rows that are enough to tell units
