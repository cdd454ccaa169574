"""Models to take home: numbers, each with its unit and where it comes from."""

# Apply
MARGIN = 0.02  # of its range by which a column may leave it: two rows in a hundred would by chance
CHANGED = 4.0  # standard errors from which a cause counts as changed: 6e-5 by chance, times causes
WORTH = 0.1  # share of the gap that a change must explain: less may be anything
NAMED = 3  # of many changes or lacks; JSON, and the head of a file, name all
STILL_HOLDS = 1.5  # times its own held-out gap up to which a model holds: other rows, other noise
UNSHOWN_CHANGE = 1e-10  # of the largest eigenvalue: a change that no row tells; rounding

# Command
FIRST_STEPS = 12  # towards both: what stays of the place is for the steps that follow
STEPS = 30  # with the nominal arm's slope each leaves some hundredths of what the last has left
SETTLED = 1e-11  # [rad or m] of a step after which no other is needed
FAR_STEPS = 60  # steps from another posture
LONGEST = 0.4  # [rad or m] of one step from another posture, within which an arm is near linear
PLACE_FIRST = 100.0  # times as dear is the place where the orientation cannot be had with it
# times as free after a step that brought the tool nearer, as dear after another (Marquardt 1963)
EASED = 10.0
STARTS = 12  # postures of the recording that are tried for a pose
REACHED = 1e-6  # [m] from its goal within which a tip has arrived: far below any arm's noise
SLACK = 1e-9  # [rad or m] beyond a limit that rounding makes

ORTHONORMAL = 1e-6  # of a rotation that is asked for: six digits
# Driven
LOAD_ROUNDS = 2  # of rolling out: the loads of the first are those at the commands

# Drives mjcf
STIFF = 300.0  # [rad/s] of a servo that gives way to nothing: its error is late by 7 ms
DAMPED = 1.0  # of critical: the least that does not overshoot
LEAST_DAMPED = 0.4  # of critical, where a soft spring would be later than what was found
MJCF_STEP = 1e-3  # [s] of the simulation: a third of a radian of the stiffest spring
SPAN = 20.0  # [s] of commands that the size of what a file lacks is judged by
SAMPLE = 0.02  # [s] of such commands: 50 a second, as hobby servos take them

# Exported
ONE_WITH = 1e-9  # of the largest singular value: frame and tool move the tips as others do
AGREES = 1e-9  # of a placement read again [m, or a rotation's entry]: beyond what text loses

# Geometry
ASKED = 40  # rows drawn over the fitted ranges, so that what changed at one moment is met
SAME_CONSTANT = 1e-12  # [m or rad] that rounding makes of a constant

# Mjcf
LEAST_MASS, LEAST_INERTIA = 1e-3, 1e-6  # [kg], [kg m^2] of a body without: MuJoCo needs some
# Of a rotation's entries: MuJoCo reads a site whose quaternion is within 1e-6 of its body's as not
# turned (user_model.cc, IsSamePose).
UNTURNED = 4e-6

# Replay
REST = 1.0  # [s] for which the first command is held before, so that filters and delays are full

# Table
SLIDE_STEP = 1e-3  # [m] of a slide's curve
MOST_POINTS = 2_000  # a joint: five turns
SHAKEN = 0.37  # [rad or m] by which all other readings are moved to see whether they matter

# Making
WIDE = 1e3  # of a typical size: what is as wide as this is not told at all

# Near
NEAR_LEVER = 0.1  # [m]: a milliradian of orientation counts as much as 0.1 mm of place
NEAR_DAMPING = 1e-3  # [m/rad]: a joint of less leverage than this is not moved for a small gain
NEAR_STEPS = 12  # each leaves some thousandths of what the last has left (cost only)
PLACED = 1e-9  # [m] that a tip may stay from its goal
STILL = 1e-8  # [rad or m] of the step that would be next
FARTHEST = 0.1  # [rad or m] that a joint may go: next to a singular posture damping decides

# Pathed
LAG_ROUNDS = 8  # of lags told anew (cost only)
NARROWEST = 1e-6  # of its width: a play that is undone whole has none left (rounding of its path)

# Reading
NO_TURN = 1e-6  # [rad] of a rotation vector: the series' next term is rounding
HEAD = 10_000  # [byte] of a file of drives, within which it says so
LARGEST_MODEL = 64_000_000  # [byte]: a thousand unknowns take 10 MB, a URDF at most 16
MOST_EFFECTS = 2_000  # 23 joints with 40 ripple orders each, twice over

LONGEST_WORD = 500  # characters of a name in a stored model
# Rows
SAMPLES = 100  # rows of the recording that a model keeps: enough for a mean over its postures
LARGEST = 1e9  # no angle, time or load of an arm is larger [SI]
