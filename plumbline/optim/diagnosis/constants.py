"""Diagnosis: numbers that are no priors, each with its unit and where it comes from."""

# Recalibration
FLAT = 1e-12  # relative error of the line: no digit that is shown depends on it

# Simulation
TRIES = 60  # draws of causes, until some have an effect (effort)

# Future rows
DRAW_ROUNDS = 40  # of as many postures as are asked for, until enough are in reach (cost only)
PLACES = 8  # at which a joint is tried when it alone is changed
RESTS = (0.0, 0.0, 0.0, 0.0, 1 / 3, 1.0)  # waits to draw from, over the recording's length
REACHING_STEPS, NEAR = 25, 1e-6  # of bringing a tip into a socket, and how near it must come [m]

# Next experiment
# Numbers of random rows that are tried, each a fifth more (effort).
RANDOM_COUNTS = (12, 18, 24, 30, 36, 48, 60, 80, 100)
ORDERS = 6  # random orders that are averaged (effort)

# Rows
# Rows of an experiment, postures drawn for them, explanations told apart (effort).
ROWS, POOL, MOST_RIVALS = 12, 3000, 20
GLANCE = 400  # rows looked at for each choice (effort)
EXCHANGES = 6  # rounds in which chosen rows are exchanged for others (effort)

# Diagnose
NOTHING = 1e-9  # of a parameter's scale: what a bound at its null leaves of it

# Functions
UNMOVED = 1e-9  # [rad or m] of travel below which a joint stood; rounding
GRID = 60  # places of an angle at which its process is worked out (cost only)
NYSTROM = 1e-3  # share of a process's variance below which a feature is left out (cost only)

# Resembling
VARIANTS_SEEN = 8  # of each of the best effects, so that enough effects are among them (cost only)

# Findings
LISTED = 3  # causes, or orders of a ripple, that a line names

# Linear
JITTER = 1e-12  # of the diagonal, that a factor needs it to be larger; rounding
FLATTEST = 1e-100  # precision of a prior where no row shows anything; its inverse has a square

# Options
LARGEST_SEED = 2**32 - 1  # what every generator takes

# Scan
TWIST = 6  # columns of the base's own motion, behind those of the joints

# Proof
MOST_ROWS = 2_000  # that the causes are fitted to again: a proof shall not take as long as a search
MOST_SECONDS = 60.0  # of a motion that is replayed

# Together
OWN_SHARE = 0.4  # of the time, for the recordings one by one (progress only)

# Transfer
FLATTEST_TOLD = 1e-9  # of a precision's largest: directions below it are not told

# Confounding
MOST_TOLD = 100.0  # nats: more is no number to anyone

# Curves
POINTS = 721  # of a curve, at most: half a degree of a whole turn
A_PERIOD = 8  # points that show a sine's shape

# Friction
SPEEDS = 60  # points of a curve on either side of standstill

# Judge
MOST_LISTED = 60  # candidates that a verdict lists

# Parts
LEFT_OPEN = 1.0  # standard error of a direction [typical sizes] from which the rows do not tell it

# Words
SHOWN = 0.01  # probability from which a branch of the tree is shown: as it is told, to a percent
MOST_PLACES = 5  # of the tree that are shown with their mechanisms
