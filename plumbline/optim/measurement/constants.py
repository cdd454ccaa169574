"""What rows measured: numbers, each with its unit and where it comes from."""

# Uneven noise
# Share of the way from the row before to the row behind by which a row is off their middle, up to
# which these tell its speed: of a sine of 0.93 radian a row to 14 %. Stops anywhere are off by 0.9.
SMOOTH = 0.25
# [rad or m] by which a joint is turned to see what it moves: of central differences the square of
# the step, 1e-10, is as much as rounding leaves (Nocedal and Wright 2006, Numerical Optimization,
# sec. 8.1; test_scatter.py fails at 1e-3)
TURNED = 1e-5

# Nuisance
FRAME_SCALE = (0.1, 0.1)  # [m], [rad] that a frame is off which was placed by hand
TOOL_SCALE = 0.05  # [m] that a tool is off which was measured by hand
COINCIDENT = 1e-12  # [m]: lost in the rounding of any distance
WIDE_BOUNDS = 1e3  # either side of the start, in units of typical size

# Observation
MASS_PER_METRE = 15.0  # [kg/m] of a link of which no mass is given, as of arms of 5 to 30 kg
# [its mass], 1 sigma of a body whose mass is assumed so: of links beyond 5 cm of 14 arms whose
# masses are in their files, about each arm's own mean, each weighed by its mass
# (tests/kinematics/test_weights.py fails at 0.3 and 0.9; real arms by it: docs/results.md)
ASSUMED = 0.58
ONE_MOTION = 0.05  # of the spread of the rows, below which steps between them are a motion's
# Parts
LEAST_HALF = 1e-3  # [m]: a plane on which all beams meet one spot has no width, and none matters

# Pose noise
WAYS = 6  # of a pose: three of its place, three of its turn
POSE_FREEDOM = 8  # rows that the prior of a pose's noise is worth: the fewest that have a mean

# Registering
# Steps by turns of frame and tool. Of 480 recordings of few joints with a tool of 0.1 or 0.5 m none
# ends elsewhere by 1 to 5, 7 do by none; two more where noise and a gap pull.
REGISTERING_STEPS = 3

# Torque
UNIT = 1e-4  # noise of a weighed residual: as that of a good tracker in metres
