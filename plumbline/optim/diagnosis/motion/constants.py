"""Every number of a motion's diagnosis, with its unit and where it is from.

Parameters' ranges and scales stand with the effects.
"""

from plumbline.kinematics.law import Law

# Windows: length and the stretch in which what nobody measured settles [s]. A lag of 0.3 s is
# forgotten to 1 % in the first; what integrates drifts with the square of a window's length.
LENGTH = {
    Law.POSITION: 5.0,
    Law.SMOOTH: 5.0,
    Law.HELD: 5.0,
    Law.SERVO: 1.0,
    Law.HELD_SERVO: 1.0,
    Law.VELOCITY: 1.0,
    Law.RATE: 1.0,
    Law.TORQUE: 0.3,
    Law.SAMPLED_TORQUE: 0.3,
}
SETTLE = {
    Law.POSITION: 1.5,
    Law.SMOOTH: 1.5,
    Law.HELD: 1.5,
    Law.SERVO: 0.2,
    Law.HELD_SERVO: 0.2,
    Law.VELOCITY: 0.2,
    Law.RATE: 0.2,
    Law.TORQUE: 0.05,
    Law.SAMPLED_TORQUE: 0.05,
}
# What integrates starts at a measured place, and with inertia at a measured speed: their noise is
# no drive's, so so many moments of a window, its mean and its slope, say nothing.
OPEN = {Law.VELOCITY: 1, Law.RATE: 1, Law.TORQUE: 2, Law.SAMPLED_TORQUE: 2}
LONGEST_DELAY = 0.25  # [s] no window starts earlier in its run: actuation_delay's upper bound
LOOKED_AT = 120.0  # [s] of motion that a fit takes of a recording, spread over it
LEAST_WINDOWS, MOST_WINDOWS = 24, 60  # which that comes to
BLOCK = 4  # windows in a row among these: some 15 s of commands in one roll-out
MOST_SAMPLES = 500  # of a window: faster clocks are thinned, no drive of a joint needs more
# [samples] of a window where commands stand and jump, one every 5 ms: a jump between two samples is
# late by some of one (test_motion_held.py fails at 500; more is memory alone).
MOST_HELD = 1000
SMOOTH = 0.1  # [s] over which speeds and accelerations are smoothed (Savitzky and Golay 1964)
CUBIC = 3  # their polynomials
POSTURE = 0.3  # [s] the same of the places at which loads are worked out: bodies swing slower
# [degree] of the polynomials of those places: of a swing of 2 Hz cubics take 4 % away, these 0.1 %
# (Savitzky and Golay 1964; test_motion_clocks.py fails at 3).
QUINTIC = 5
# [rad/s] up to where states follow readings, whatever torques make of bodies, in the first of so
# many passes: noise alone takes a quarter off in each, and 5 rad/s is what no window sees. What a
# wrong drive gives ends at its own, some 100 rad/s, from any of 10 to 100
# (test_motion_states.py fails at 3 passes).
KNOWN, PASSES = 30.0, 8
# [1] stiffness, at most, of what torques make beside a reading's in the equations of states: these
# lose as many digits as that has, and of doubles 2e-16 * 1e13 = 0.2 % of a step is lost (Higham
# 2002, Accuracy and Stability of Numerical Algorithms, sec. 10.1). Of less, ideal drives leave more
# than noise of seven joints (test_motion_states.py fails at 1e11, and at 1e17).
BELIEVED = 1e13
AT_ONCE = 20000  # samples of states that are found at once: some 400 MB of seven joints
LEAST_INERTIA = 1e-3  # [kg m^2] a motor's rotor behind its gear, where the file states less
# [kg m^2] where torques act, as much or less is none stated: by hand, between a ball of 10 g, 1 cm
# (2/5 m r^2 = 1e-7) and a grain of 1 g and 1 mm across (1e-10), which no joint turns about itself.
# test_motion_light_joints.py fails at 4e-10 (a placeholder is moved) and 3e-9 (a link is not).
UNSTATED = 1e-9

# Fits
ITERATIONS = 40  # of Levenberg and Marquardt; warm starts take 5 to 10
ENOUGH = 1e-4  # of the square: a step that gains less ends a fit in the search
ENDED = 1e-10  # of the square: the same for the fits behind a verdict

# Evidence
PRESENT = 0.15  # prior probability of an effect at a joint: one or two of nine at work
LEAST_GAIN = 0.02  # of the square, a seventh of what is left: an effect of less is negligible
LEAST_SHARE = 0.05  # of what is left: an unlisted function that takes less is negligible
BUMPS = 8  # of an unlisted function along its variable: features a tenth of its range wide
PASTS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.25, 0.35, 0.5)  # [s] after which drives have answered
MEMORIES = (0.02, 0.05, 0.1, 0.2, 0.4)  # [s] over which what is left before foretells what is
RESEMBLES = 0.8  # of what nobody has listed: loops, heat, grip and buses look like lag, gain, play
DEVIATIONS = (0.1, 0.3, 1.0)  # of that effect's own size, by which its form is another
WIDTHS = (0.05, 0.2, 1.0, 4.0)  # prior widths of such functions, in residual RMS
LONGEST_GAP = 3.0  # times the usual step: a clock that leaps by more begins a new run
# At which loads are worked out, 7 microseconds each with seven joints. On lines between every other
# row, 5 ms each, a wrist errs by a seventh of an encoder's noise (test_motion_light_joints.py fails
# at 20,000); more take time and 0.5 KB each, no more.
MOST_STATES = 100_000
MOVES = 6  # exchanges and drops after the climb, searches by what neighbours give; two are usual
RIVAL_FROM = 1.5  # of the effective samples, in log evidence: a square that falls to a twentieth
SEARCHED = 0.4  # of these windows the search looks at; what it finds is fitted to all of them
SEARCH_SAMPLES = 250  # of such a window where commands are positions: 50 a second
SEARCH_ITERATIONS = 10  # of a fit of the search
RACE = 3  # steps after which the best of several starts goes on alone
CONTENDS = 30.0  # nats on the windows of the search: what is farther behind is not fitted to all
WORTH_A_FIT = 2.0  # nats of likelihood: noise makes one effect in twenty bring more
MOST_JUDGED = 400  # windows that a joint is judged by, over all folds
STEPS = 0.005  # of what a planned way does: as much as twice as many steps change
RATIO_STEP = 1e-6  # of a lag's samples and one: its derivative by forward differences
OWN_PAST = 0.3  # of what is left, foretold by the sample before: noise of an encoder has no past
CORRELATED = 0.95  # of two estimates: the recording tells their sum, hardly which is which
CONFOUNDED = 0.05  # probability from which another effect is named as what it may be instead

# Masses
# Numbers of a mass at the tip, of a point elsewhere and of any body: mass, first moment, inertia
# (Atkeson, An, Hollerbach 1986, sec. 2).
OF_A_TIP = POINT, ASIDE, BODY = 1, 4, 10
# [1] numbers of a link: how much more it weighs, its shape its file's, and where its centre is
# besides (the same, sec. 2; test_motion_masses.py fails without either).
OF_A_LINK = 1, 4
# [1] of a body's inertia about its joint that its second moments may lack of nothing: by hand, far
# above what noise makes of a point's, a hundredth of what lets states run off
# (test_motion_masses.py fails at 1e-1 and at 1e-5).
ROUNDED_OFF = 1e-3

# Diagnose
STILL = 1e-6  # [rad] a command and an encoder that move less tell nothing of a drive

# Proposals
SECONDS = 30.0  # [s] of one motion: three periods of its slowest wave
CHIRP = (0.1, 5.0)  # [Hz] from where delay and lag are one to where they part

# Recording
AXIS_LEVER = (
    0.1  # [m/rad] of a tip that far behind its trocar: what a radian of an axis is in metres
)
LEAP = 10.0  # times what readings usually are off the line of their neighbours: no noise is that
ROUNDED = 0.01  # of a step: stamps of a tenth of a millisecond at 100 Hz
SMOOTHER = 5.0  # standard errors by which an even clock is smoother: chance in one of 3 million
LISTED_ROWS = 5  # rows that a note names
LEAST_ROWS = 50  # one second at 50 Hz; a window takes half of it

# Rollout
TOGETHER = 240  # windows that are rolled out at once: some 50 MB
PIECE, PIECES, ABREAST = 10, 20, 12  # samples of a compiled piece, these and windows of a call
WAYS = 8  # planned ways that windows keep: of a fit's values and of differences to both sides
STRETCH = 2000  # samples of one long run a call: 100,000 in one took 2.5 times as long
WIDE = 0.03  # of a parameter, or of its width: differences of a planned way

# Set up
STATED = 1e3  # [rad or m] what a file without limits has for one is far beyond
ALIKE, SAME_UNIT = 0.9, 1.5  # correlation and ratio of motions that may differ by their unit alone
LATEST = 1.0  # [s]: no drive obeys later

# Unlisted
APART = 2  # samples: neighbours on an even clock may be averages of the same reading

# Forward, under torques
# [s] that a part of a row is long at most, rounds to the middle of each and rounds in turn of the
# drives: so three joints that swing by radians are within 0.3 mrad of MuJoCo's after 1.5 s
# (test_drives_pushed.py fails at 2.5 ms, 2 and 1; less and more is cost).
PART, MIDDLES, IN_TURN = 1.25e-3, 3, 2
