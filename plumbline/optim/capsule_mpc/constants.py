"""Numbers of the capsule controllers, each with its unit and where it comes from.

Lengths are in mm, times in s, as inside of the controllers, but for what a body is made from. What
is named "rounding" lies so far from what instruments do that an order of magnitude changes nothing;
"effort" is how hard is looked.
"""

MM = 1e3  # [mm/m]: SI units at the door, mm inside
# No instrument of an operating room is longer or farther off, no shaft, clearance or error larger;
# in millimetres each of them is.
LONGEST, WIDEST = 5.0, 0.1  # [m]
# No drive waits or lags so long, no tip or outer end is faster, speeds up or jerks more, no tracker
# errs by more; in ms, mm/s, and mm each does.
SLOWEST = 1.0  # [s]
BRISKEST = 2.0, 50.0, 5000.0  # [m/s], [m/s^2], [m/s^3]
ROUGHEST = 0.01  # [m]
OBSTACLE = 10  # numbers of an obstacle: both ends, the radius, and its motion in a step or a second
FAR = 1e6  # [mm] where obstacles are that are not there
STILL = (0.0, 0.0, 0.0)  # [m/s]

# Bodies and arms
A_MAX = 1.0  # [m/s^2]: from 60 mm/s a stop takes 60 ms and 1.8 mm, less than d_s
J_MAX = 50.0  # [m/s^3]: that acceleration is there after 20 ms, one step
V_OUTER = 0.25  # [m/s], what ISO 10218-1 calls reduced speed, beside which people may stand
CONE = 80.0  # [degrees]: beyond it a shaft would lie along the wall of the body
# [degrees], least cone that is meant so: any in rad, up to half a turn (pi), is less, and in 3
# degrees a tip 100 mm deep has 5 mm to either side (test_capsule_mpc_safety.py fails at 3).
NARROWEST = 3.15
SHALLOW = 1.0  # [mm] of depth below which a shaft's direction is not to be relied on
REVOLUTE, PRISMATIC = 1e-2, 1 / MM  # [rad], [m] of one unit of the state
# A tip brought through its trocar: the distance at which it is there [mm], the damping of a step
# [its square], the longest one and the room that is kept to a limit [units of the state]; effort.
ARRIVED, EASED, STRIDE, INSIDE = 1e-8, 1e-3, 10.0, 1e-3

# Pairs
# Of the norm, which exceeds the largest of four by 4^(1/8), 19 % of its square, at most: solvers of
# the nonlinear program do not converge on the kink of a maximum.
POWER = 8
# Of the distance of two trocars that are nearer than D, what their shafts are to keep: to keep all
# of it, they would have to stay at right angles to the line between the trocars.
KEPT = 0.95
TURN = 5.0  # tangent of the most that a plane's normal turns along each side of its chart
REGULAR = 1e-6  # weight of what the statement does not weigh: planes, the last step; rounding

# One step, linearised
ABSENT, DROPPED = -1e9, -1e8  # right-hand side of a row that cannot become active; the test for it
TOUCHING = 1e-9  # [mm] below which the direction between nearest points means nothing; rounding
# Times the cost of a mm of a distance, what a mm beyond a limit costs: no distance that cannot be
# kept is a reason to leave the body.
LIMITS = 10.0
# Of a bound on a step's norm, what a step may have across that of the path: it may turn by 27
# degrees from one step to the next; what is too long by then is shortened.
ACROSS = 0.5
COMMON = 1e-3  # [mm^2], product of two axes across each other, below which they count as parallel
CURVATURE = 1e-6  # of what the program does not weigh: some solvers need a positive Hessian
INFINITE = 1e4  # [mm] a bound that hpipm takes for none
ROD = 8.0  # [mm] of a rod that is written out as code: any length that is no sphere's
COMES = 7.0  # where a value will stand in a pattern: any number that is neither 0 nor 1

# The nonlinear program
# [mm] from its D, below which an obstacle is taken at once; any value is correct, this one takes
# few that prove too far and misses few that prove too near.
WATCH = 8.0
SHORT = 1e-3  # [mm] by which a solution may come too near to an obstacle that was left out
ROUNDS = 3  # of taking in what was left out; effort
# [mm^2], of what IPOPT makes least; FATROP's, which otherwise iterates on what the penalty of slack
# leaves of its dual residual.
IPOPT_TOLERANCE, FATROP_TOLERANCE = 1e-4, 5e-2
# A loop's program is nearly solved where it begins: a small barrier, kept from being raised, and a
# start that is not pushed off its bounds.
IPOPT: tuple[tuple[str, float | str], ...] = (
    ("acceptable_tol", 1e-6),
    ("acceptable_iter", 15),
    ("mu_strategy", "monotone"),
    ("mu_init", 1e-5),
    ("warm_start_init_point", "yes"),
    ("warm_start_bound_push", 1e-6),
    ("warm_start_slack_bound_push", 1e-6),
    ("warm_start_mult_bound_push", 1e-6),
    # The system is small and well scaled: orderings for large ones take longer than it does,
    # and so does refining a residual that is small already.
    ("min_refinement_steps", 0),
    ("mumps_permuting_scaling", 0),
    ("mumps_scaling", 0),
    ("mumps_pivot_order", 2),
)

# The controller, its net and its stop
OFF = 1e-2  # [mm], or as it is stated, by which what is held may be off without a report
SLACK = 1e-3  # [mm] of slack, or inside of a margin, that is worth a report
HALVINGS = 4  # of a rate that the net does not let pass; effort
ROUNDING = 1e-9  # of the largest speed, or of a step's number
PASSES, SHORTER = 8, 0.98  # of holding a rate within its limits; how much slower the next try is
HOLDING = 0.1  # of the acceleration, what holding a trocar may take beyond it
# [mm] by which a rate may take a pair deeper into its margin than the stop at hand: what
# linearising a step leaves over is no reason to stop.
WORSE = 5e-3
SUBSTEPS = 4  # of a step: at the largest speeds the bound is within 0.1 mm of the truth
REST = 1e-6  # of the largest rate, below which a stop has ended; rounding
MOST_OF_A_STOP = 60  # steps that a stop may take at most
AT_REST = 1e-18  # [(mm/s)^2, (mm/s^2)^2] keeps the slope of a length finite at rest; rounding
NO_WAY = 1e-30  # below which a squared way is none; rounding
EXACT = 1e-6  # [mm, or of a shaft] to which what is held is, and a way's ends are; rounding
CREEP = 0.1  # of friction: a rate below that gets its share of what it takes, against chatter
# [edge of a dead band] that is asked for so that it is passed: an edge of 2 mm/s is scanned to 0.1
# (test_shafts.py, test_play.py and test_identified.py fail at 1 or 2).
PASSED = 1.05
# A plant from a log
OVER = 0.5  # [s] over which places are compared: 0.02 of 15 mm/s is twice a noise of 0.05 mm
ROWS = 5000  # of a log, at most; effort
STEPS = 3  # of Gauss and Newton's after a scan; effort
# [m/s] by which dead bands are wider, coarsely and then finely.
EDGES = tuple(1e-3 * k for k in range(-12, 13)), tuple(1e-4 * k for k in range(-9, 10))
TELLS = 0.05  # of the square of what is off, that a dead band takes away at least
# Fields that are fitted: a step of a difference and 1 sigma about what was diagnosed, as far
# as what axes take of each other, or friction in turned axes, had taken it.
FITTED = {
    "delay": (1e-3, 0.02),  # [s]
    "lag": (1e-3, 0.02),  # [s]
    "dry": (2e-4, 3e-3),  # [m/s]
    "play": (2e-5, 3e-4),  # [m]
    "offset": (1e-4, 1e-3),  # [m/s]
}
SHARE = 2e-3  # step of a difference of what axes take; rounding
ACROSS_AXES = 0.05  # 1 sigma of what an axis takes of another
MEDIAN = 1.4826  # 1 sigma of a normal deviate, in median sizes
FINEST = 1e-7  # [m] of what is off, below which nothing is told; rounding
NO_LAG = 1e-4  # [s] of a lag that is none; rounding
# How late rates act beyond what is told
GRAIN = 0.01  # [s] between two latenesses that are tried; at 60 mm/s a parabola leaves 0.1 mm
LATEST = 0.2  # [s] that are looked for beyond what is told: what waits longer is no servo loop
LATE = 0.1  # [s], 1 sigma of what is not told, before anything is seen
GAINS = 0.1  # 1 sigma of a gain, before anything is seen
LEARNT = 60.0  # [mm] of way by which e-fold is forgotten: a second at the largest speed
SEEN_FROM = 0.01  # [mm], 1 sigma of noise that is not stated; rounding
STANDARD = 3.0  # sigmas within which a lateness may be true
# [largest speed] below which dry friction that nobody told may hold a drive: 1 to 4 of 60 mm/s in
# the plants that are learnt (docs/howto/capsule_mpc.md; test_underway.py fails on either side).
HELD = 0.1
# [way that an axis is sent beyond what friction may hold], the least that it does: drives with
# a gain 0.4 too low do 0.6, a reading of something else does nothing, a drive turned round less
# (test_obeying.py fails on either side).
OBEYED = 0.5
ASTRAY = 2.0  # [mm, or units] that may be short of it: the usual d_s
# [s] over which that is looked at, and between two looks: what is 0.2 s late is known by 0.5 s, and
# a reading that leaps for less than the second is one look's.
WATCHED, BETWEEN_LOOKS = 1.0, 0.1
NO_SEAT = 1e6  # [mm] of gap where there is nothing

# What a smooth command and its horizon are tuned to
SMOOTHING = 0.106  # [s], time constant of a command
SEEN = 0.53  # of the horizon that it may take at most
DAMPING = 0.7  # cost of effort [root of the cost of changes], unless it is stated

# Sweeps that are foreseen
# [s] that obstacles are foreseen: shafts hit by ones at 60 mm/s could be saved 1.0 s before, by
# some constant rate, and 0.8 s before no more.
AHEAD = 1.2
STRAIGHT = 1.0  # [mm] by which an obstacle may be beside its way and still go straight on
TURNED = 1.0  # [mm] by which a way is longer than its extent where it has turned
CHANGED = 0.1  # of its squared speed, of which a spring is to be seen
UNEVEN = 0.2  # of the changes of its squared speed, that a spring may leave over
FEWEST_LOOKS, RECENT_LOOKS = 5, 25  # from which on that is to be seen; that show it
# [mm/s] beyond which a place is that of another obstacle: twice what was tried (docs: up to 1 m/s)
FASTEST = 2000.0
MEMORY = 10.0  # [s] that places are remembered: a period of 60 mm at 38 mm/s

# Ways out and detours
EVERY = 0.04  # [s] between two looks: at 60 mm/s the least distance is off by 0.1 mm
# [mm] beyond D that waypoints keep, and a way out, where it can: barriers slow it where it has less
ROOM = 2.0
FINER = 8  # times as often the likeliest are looked at: at 400 mm/s what passes is 1 mm from a look
LIKELY = 8  # ways out that are looked at closely; effort
ASIDE = 0.35  # tangent of the angle by which ways about the best are turned: 19 deg of 45 apart
SHARES = (1.0, 0.5)  # of the largest speed, that are tried; effort
SAMPLES = 17  # shafts along a sweep; effort
DIRECTIONS = 12  # of detours; effort
BESIDE = (0.5, 0.25, 0.75, 0.0, 1.0)  # of the straight way, beside which detours pass; effort
OFFSETS = (10.0, 18.0, 28.0, 40.0, 55.0)  # [mm] of detours from the straight way

THERE = 3.0  # [mm] from a waypoint that counts as there
STALL, PROGRESS = 25, 1.0  # steps in which a tip must come so much closer to where it goes [mm]
EXTRA = 1.5  # [mm] of clearance that ways keep beyond d_s
BACK = 35.0  # [mm] of the tip behind the trocar when drawn back
# The same, as a share of the shaft's length, where shafts meet outside: what is in the way over the
# trocars is passed with as little of the shaft there as inside.
DEEP = 0.5

# The compiler
PATIENCE = 300.0  # [s] that a compiler may take
MOMENT = 20.0  # [s] for its version, or for loading what it made
